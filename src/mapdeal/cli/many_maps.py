"""What commands on many maps have in common."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mapdeal.cli import terminal
from mapdeal.inputs.listing import MapListing
from mapdeal.kernels.threads import available_threads

_MOST_PER_PROCESSOR = 4
_LEAST_CAP = 8


def say_listing(listing: MapListing, done: str) -> None:
    """Report what was left out of the maps that names stand for, and what is done to each once."""
    if listing.left_out:
        _say_some(
            listing.left_out,
            "YAML file without the key image was left out",
            "YAML files without the key image were left out",
        )
    if listing.repeated:
        _say_some(
            listing.repeated,
            f"map was named more than once, and is {done} once",
            f"maps were named more than once, and are {done} once",
        )


def _say_some(paths: Sequence[Path], one: str, many: str) -> None:
    if len(paths) == 1:
        terminal.remark([f"note: 1 {one}: {paths[0]}"])
        return
    terminal.remark([f"note: {len(paths)} {many}, such as {paths[0]}; -v names all"])
    for path in paths:
        terminal.detail(f"{many.rsplit(' ', 2)[0]}: {path}")


def jobs_at_once(wanted: int | None, maps: int) -> int:
    """Return how many jobs there are at the same time: not more than can be of use."""
    processors = available_threads()
    most = max(_LEAST_CAP, _MOST_PER_PROCESSOR * processors)
    if wanted is not None and wanted > most:
        terminal.remark([f"note: --jobs {wanted}: using {most}, as there are {processors} cores"])
    return min(wanted or processors, maps, most)
