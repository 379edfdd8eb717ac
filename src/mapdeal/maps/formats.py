"""The table of all formats of maps."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from mapdeal.errors import ParameterError
from mapdeal.files.source import BIT_MAP
from mapdeal.grid.values import join_words
from mapdeal.maps import map_file, map_server, npz, pbstream

FORMATS = (map_server.PAIR, npz.NPZ, map_server.BITS, pbstream.PBSTREAM)
MAP_ENDINGS = tuple(ending for entry in FORMATS for ending in entry.endings)


def format_of(path: Path) -> map_file.MapFormat:
    """Return the format of a map by its ending; files without a known one are read as YAML."""
    ending = path.suffix.lower()
    return next((entry for entry in FORMATS if ending in entry.endings), map_server.PAIR)


def output_format(output: Path, more: Sequence[str] = ()) -> map_file.MapFormat:
    """Return the format that an output's ending names; errors list `more` endings, too."""
    written = [entry for entry in FORMATS if entry.write is not None]
    for entry in written:
        if output.suffix in (*entry.endings, *entry.images):
            return entry
    endings = [entry.endings[0] for entry in written]
    endings += [ending for entry in written for ending in entry.images]
    hint = "mapdeal pack makes a bit map of a map" if output.suffix == BIT_MAP else None
    rule = f"an output must end in {join_words([*endings, *more])}"
    raise ParameterError(rule, source=output, hint=hint)


def written_endings(kind: type) -> tuple[str, ...]:
    return tuple(e for entry in FORMATS if entry.can_hold(kind) for e in entry.endings)


def or_other_formats(pairs: str) -> str:
    """Return a text on pairs, continued by the endings of the other formats of written maps."""
    formats = [entry for entry in FORMATS if entry.write is not None and not entry.images]
    *more, last = (ending for entry in formats for ending in entry.endings)
    return f"{', '.join([pairs, *more])}, or {last}"


def named(endings: Iterable[str]) -> Iterable[str]:
    """Return the endings that texts list."""
    return (ending for ending in endings if ending != ".yml")
