"""Transforms between the frames of several maps, from files or by aligning their walls."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from mapdeal.alignment.memory import bytes_to_align
from mapdeal.errors import FindingError, ParameterError, emit_warning
from mapdeal.formats.budget import claim
from mapdeal.formats.transforms import TransformFile, read_transform
from mapdeal.grid.display import count_text
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.transform import Transform
from mapdeal.pipeline.files import errors_named
from mapdeal.records import dataclass


@dataclass(frozen=True)
class Known:
    """Source files of a map that was read."""

    path: Path
    sums: Mapping[str, str]

    def is_of(self, sums: Mapping[str, str]) -> bool:
        """Return whether these are its checksums, whatever its files are called."""
        return sorted(self.sums.values()) == sorted(sums.values())


def transforms_by_files(files: Sequence[Path], maps: Sequence[Known]) -> list[Transform]:
    """Return the transform from the first map's frame to that of each other map.

    Notes
    -----
    A file with checksums is between the two maps that have them, in whatever order these are
    given, and transforms are chained: from A to B and from C to B place C, too. One without is
    from the first map to the second, third, ..., as it is the first, second, ... of the files.
    """
    if len(files) >= len(maps):
        rule = f"{len(files)} files are given, and {count_text(len(maps) - 1, 'map')} to place"
        raise ParameterError(rule, source="--by")
    own = [next(k for k, one in enumerate(maps) if one.is_of(other.sums)) for other in maps]
    steps = [
        _step(read_transform(path), path, number, maps) for number, path in enumerate(files, 1)
    ]
    found = {0: Transform()}
    while more := dict(_next_to(found, [(own[a], own[b], step) for a, b, step in steps])):
        found |= more
    for one, first in zip(maps, own, strict=True):
        if first not in found:
            rule = f"no transforms lead from {maps[0].path} to {one.path}"
            hint = "pass --by once for each map but the first"
            raise ParameterError(rule, source="--by", hint=hint)
    return [found[first] for first in own[1:]]


def transforms_by_walls(grids: Sequence[OccupancyGrid], paths: Sequence[Path]) -> list[Transform]:
    """Return the transforms that `transforms_by_files` returns, of maps that are aligned.

    A map that has too little in common with the first one is placed on another that is placed.
    """
    from mapdeal.alignment.align import align

    cells = [grid.frame.height * grid.frame.width for grid in grids]
    claim(paths[0], bytes_to_align(sorted(cells)[-2:]), what="maps that are aligned")
    found = {0: Transform()}
    reasons: dict[int, str] = {}
    new = [0]
    while new:
        placed, new = new, []
        for number in range(1, len(grids)):
            for base in placed:
                if number in found:
                    break
                with errors_named(paths[number]):
                    step = align(grids[base], grids[number])
                if step.same_place:
                    found[number] = step.transform.after(found[base])
                    new.append(number)
                else:
                    reasons.setdefault(number, str(step.reason))  # that of the first map
    for number, reason in reasons.items():
        if number not in found:
            path = paths[number]
            others = " or on another" if len(found) > 1 else ""
            rule = f"its placement on {paths[0]}{others} is uncertain: {reason}"
            hint = f"mapdeal align {paths[0]} {path} shows the result; --by FILE.json uses it"
            raise FindingError(rule, source=path, hint=hint)
    return [found[number] for number in range(1, len(grids))]


def _next_to(
    found: Mapping[int, Transform], steps: Sequence[tuple[int, int, Transform]]
) -> Iterator[tuple[int, Transform]]:
    """Yield the maps that are a step away from those that are placed."""
    for first, second, step in steps:
        if first in found and second not in found:
            yield second, step.after(found[first])
        elif second in found and first not in found:
            yield first, step.inverse().after(found[second])


def _step(
    told: TransformFile, path: Path, number: int, maps: Sequence[Known]
) -> tuple[int, int, Transform]:
    """Return which maps a transform is between, and the transform."""
    ends = [
        next((k for k, one in enumerate(maps) if one.is_of(sums)), None)
        for sums in (told.first, told.second)
    ]
    if ends[0] is not None and ends[1] is not None:
        return ends[0], ends[1], told.transform
    if told.first or told.second:
        text = (
            f"{path}: its checksums are not those of the maps; used as the transform from "
            f"{maps[0].path} to {maps[number].path}"
        )
        emit_warning(text, stacklevel=2)
    return 0, number, told.transform
