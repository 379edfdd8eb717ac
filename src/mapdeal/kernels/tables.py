"""Tables whose length the cells of a map decide: of basins, of components."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_claim: ContextVar[Callable[[int], object]] = ContextVar("claim", default=lambda _: None)


@contextmanager
def tables_claimed(claim: Callable[[int], object]) -> Iterator[None]:
    """Have `claim_tables` call a function, which may refuse, within a ``with`` block."""
    token = _claim.set(claim)
    try:
        yield
    finally:
        _claim.reset(token)


def claim_tables(size: int) -> None:
    """Report the bytes of tables before they are made; whoever limits the memory may refuse."""
    _claim.get()(size)
