"""The memory that may be used.

A small file can ask for any amount of memory, by the numbers in its header or because it is
compressed. So every reader says what it is about to take, and the answer may be an error.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from pathlib import Path

from mapdeal.errors import MalformedInputError, ParameterError

_MEMINFO = Path("/proc/meminfo")
_OWN_GROUP = Path("/proc/self/cgroup")
_GROUPS = Path("/sys/fs/cgroup")


def free_memory(
    meminfo: Path = _MEMINFO, own_group: Path = _OWN_GROUP, groups: Path = _GROUPS
) -> int | None:
    """Return the bytes that are available before anything is swapped out or killed."""
    # The smaller of what the machine has and what is left of the limits of the control groups
    # (version 2) that the process is in, as containers set them.
    match = re.search(r"^MemAvailable:\s+(\d+) kB", _text(meminfo), re.MULTILINE)
    if match is None:
        return None
    free = int(match[1]) * 1024
    group = re.search(r"^0::/(.*)$", _text(own_group), re.MULTILINE)
    folder = groups / (group[1] if group else "")
    while True:
        limit, used = _text(folder / "memory.max").strip(), _text(folder / "memory.current").strip()
        if limit.isdecimal() and used.isdecimal():
            # files that were read stay in memory as long as nobody else needs it
            cached = re.search(r"^inactive_file (\d+)", _text(folder / "memory.stat"), re.MULTILINE)
            free = min(free, int(limit) - int(used) + (int(cached[1]) if cached else 0))
        if folder in (groups, folder.parent):
            return max(free, 0)
        folder = folder.parent


def _text(path: Path) -> str:
    """Return what a file says, nothing if it cannot be read: it may not be there."""
    try:
        return path.read_text()
    except (OSError, UnicodeDecodeError):
        return ""


MOST_EXPANSION = 1000
"""Times their size that compressed data may expand to."""

BLANK_EXPANSION = 1400
"""The same, of images: an empty map comes to 1032 at most by deflate, to 1366 by LZW."""

_HARMLESS = 1 << 25
"""Bytes that compressed data may expand to in any case: an empty fax is next to nothing."""

PIECES = 1 << 24
"""Bytes that readers take for pieces of a file, where they never hold all of it."""

OF_JSON = 30
"""Times the length of a JSON text that what it says takes, at most."""

_INTERPRETER = 50_000_000
"""Bytes that are taken before anything is read."""

_LITTLE = 1 << 22
"""Bytes that are nothing beside those: they are never refused."""

_LEAST = 128_000_000
_SMALL = 256_000_000
"""All of little memory is taken, and the least in any case, also by each of many jobs."""


@dataclass(frozen=True)
class _Budget:
    """Memory that may be used."""

    limit: int | None
    origin: str = ""
    held: int = 0


SHARE_OF_JOB = " (by default this job's share of the memory)"
"""Note in the refusal of a job that could have more memory if it ran alone."""

_current: ContextVar[_Budget | None] = ContextVar("budget", default=None)


def default_limit(jobs: int = 1) -> int | None:
    """Return the bytes that each of some jobs may take: its part of half of what is free."""
    # None if it is not known what is free.
    free = free_memory()
    if free is None:
        return None
    if jobs > 1:
        return max(free // 2 // jobs, _LEAST)
    return max(free // 2, min(free, _SMALL), _LEAST)


@contextmanager
def use_memory(
    limit: int | None, *, is_chosen: bool = True, anew: bool = False
) -> Iterator[None]:  # fmt: skip
    """Limit the memory of readers within a ``with`` block."""
    is_new = anew and limit is None
    token = _current.set(_by_default() if is_new else _budget_of(limit, is_chosen=is_chosen))
    try:
        yield
    finally:
        _current.reset(token)


def _budget_of(limit: int | None, *, is_chosen: bool = True) -> _Budget:
    if limit is None:
        return _current.get() or _by_default()
    return _Budget(limit, "" if is_chosen else SHARE_OF_JOB)


def _by_default() -> _Budget:
    return _Budget(default_limit(), " (by default half of what is free now)")


@contextmanager
def holding(count: int) -> Iterator[None]:
    """Count bytes that were read as taken within a ``with`` block."""
    # Below 0 they are bytes that readers claim, and that are not taken, since nobody keeps what is
    # made of them.
    budget = _budget_of(None)
    token = _current.set(replace(budget, held=budget.held + count))
    try:
        yield
    finally:
        _current.reset(token)


def memory_limit() -> tuple[int | None, str]:
    """Return the bytes that may be used, None if there is no limit, and how a message says why."""
    budget = _budget_of(None)
    return budget.limit, budget.origin


def room() -> int | None:
    """Return the bytes that `claim` would grant; None if there is no limit."""
    budget = _budget_of(None)
    if budget.limit is None:
        return None
    return max(budget.limit - _INTERPRETER - budget.held, _LITTLE)


def claim(path: Path | str, count: int, *, what: str = "", hint: str = "") -> None:
    """Refuse what would take more memory than may be used."""
    most, budget = room(), _budget_of(None)
    if most is None or budget.limit is None or count <= most:
        return
    needed = _INTERPRETER + budget.held + count
    amounts = f"{size_text(needed)} of memory, {size_text(budget.limit)} may be used"
    rule = f"{what} need {amounts}" if what else f"needs {amounts}"
    more = (
        f"--max-memory {size_text(needed).replace(' ', '')} allows more, if that much is available"
    )
    raise MalformedInputError(
        rule + budget.origin, source=path, hint=f"{more}; {hint}" if hint else more
    )


def most_expanded(stored: int) -> int:
    """Return the bytes that compressed data may expand to where they do not say to how many."""
    most, budget = room(), _budget_of(None)
    by_rule = max(_HARMLESS, MOST_EXPANSION * stored)
    if most is None:
        return by_rule
    return most // 2 if not budget.origin else min(by_rule, most // 2)


def check_expansion(
    path: Path | str, stored: int, expanded: int, *, most: int = MOST_EXPANSION, place: str = "",
    on_disk: bool = False,
) -> None:  # fmt: skip
    """Refuse compressed data that expand as those of no honest file do."""
    budget = _budget_of(None)
    is_chosen = budget.limit is not None and not budget.origin and not on_disk
    if expanded <= max(_HARMLESS, most * stored) or is_chosen:
        return
    rule = f"{stored} bytes would expand to {expanded}, more than {most} times as many"
    hint = "--max-memory SIZE reads it within that size, if you trust the file"
    if on_disk:
        hint = "if you trust the file, expand it first: zstd -d"
    raise MalformedInputError(rule, source=path, place=place or None, hint=hint)


def size_text(count: int) -> str:
    """Return a number of bytes as messages show it, rounded up, so that it is enough."""
    step = 10 ** max(len(str(count)) - 3, 0)
    rounded = -(-count // step) * step
    unit, name = (10**9, "GB") if rounded >= 10**9 else (10**6, "MB")
    return f"{rounded / unit:.6f}".rstrip("0").rstrip(".") + f" {name}"


def size_of(text: str, name: str | None = None) -> int:
    """Return a number of bytes: ``500M`` and ``4GiB`` are of 1024, ``4GB`` of 1000."""
    match = re.fullmatch(
        r"([0-9]{1,9}(?:\.[0-9]*)?)\s*([kmgt]?)(i?b)?", text.strip(), re.IGNORECASE
    )
    if match is None:
        raise ParameterError("must be a size such as 4G or 500M", place=name, got=text)
    number, unit, ending = float(match[1]), match[2].lower(), (match[3] or "").lower()
    size = int(number * (1000 if ending == "b" else 1024) ** " kmgt".index(unit or " "))
    if size < 1:
        raise ParameterError("must be above 0", place=name, got=text)
    return size
