"""Memory of tables whose length depends on the map: of basins, of components."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_claim: ContextVar[Callable[[int], object]] = ContextVar("claim", default=lambda _: None)


@contextmanager
def tables_claimed(claim: Callable[[int], object]) -> Iterator[None]:
    token = _claim.set(claim)
    try:
        yield
    finally:
        _claim.reset(token)


def claim_tables(size: int) -> None:
    """Report the bytes of tables before they are allocated; the caller's limit may refuse them."""
    _claim.get()(size)
