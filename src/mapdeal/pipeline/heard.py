"""Warnings that are heard on their way: manifests and pages keep them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

from mapdeal.errors import heard_warnings, one_line

Item = TypeVar("Item")


@contextmanager
def heard(texts: list[str]) -> Iterator[None]:
    """Add the texts of mapdeal's warnings in the block to a list when it ends."""
    with heard_warnings() as told:
        try:
            yield
        finally:
            texts += map(str, told)


def heard_from(items: Iterable[Item], texts: list[str]) -> Iterator[Item]:
    """Yield items; add the texts of the warnings that come up while each is made, see `heard`."""
    rest = iter(items)
    while True:
        with heard(texts):
            try:
                item = next(rest)
            except StopIteration:
                return
        yield item


def portable(texts: Iterable[str], files: Iterable[Path]) -> list[str]:
    """Return warnings as they read wherever the files lie, each once: by their names alone."""
    return _renamed(texts, {str(file): file.name for file in files})


def located(texts: Iterable[str], files: Iterable[Path]) -> list[str]:
    return _renamed(texts, {file.name: str(file) for file in files})


def _renamed(texts: Iterable[str], names: dict[str, str]) -> list[str]:
    """Return each text once, on one line, with another name of the file that it begins with."""
    # A colon is behind the name, and a line may follow.
    renamed: dict[str, None] = {}
    for text in texts:
        old = next((name for name in names if text.startswith(f"{name}:")), None)
        renamed[one_line(text if old is None else names[old] + text.removeprefix(old))] = None
    return list(renamed)
