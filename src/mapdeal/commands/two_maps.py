"""How two maps lie to each other: as their files say, by a transform, or by their walls."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from os import PathLike
from pathlib import Path

import numpy as np

from mapdeal.compare.align import bytes_to_align, placed
from mapdeal.compare.difference import Bound
from mapdeal.compatibility import Unpack
from mapdeal.errors import FindingError, MalformedInputError, ParameterError, emit_warning
from mapdeal.files.source import claim
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.frame import Transform
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.kernels.distance import within_distance
from mapdeal.pipeline import inputs
from mapdeal.sensors.points import TransformFile, read_transform

TransformLike = str | PathLike[str] | Transform | Sequence[float] | None

_NEAR = 0.15  # metres, and 1.5 cells at least, within which walls of two maps count as one
_MUCH_BETTER = 0.3  # of all walls: the share that must meet more than before
_MOST_WALLS = 20_000
_MEET_ANYWAY = 0.7  # share of walls that meet where maps certainly lie in one frame


def given_transform(
    by: TransformLike, *, place: str
) -> tuple[TransformFile | Transform | None, list[Path]]:
    if isinstance(by, str | PathLike):
        return read_transform(Path(by)), [Path(by)]
    return inputs.transform_of(by, place=place), []


def transform_in(
    source: TransformFile | Transform, files: Sequence[Path], maps: Sequence[inputs.MapInput]
) -> Transform:
    """Return the transform of a file, turned round if it goes the other way between two files."""
    if isinstance(source, Transform):
        return source
    ends = [set(sums.values()) for sums in (source.first, source.second)]
    own = [set(source_map.sums.values()) for source_map in maps]
    if not all(ends) or any(source_map.path is None for source_map in maps) or ends == own:
        return source.transform
    is_other_way = ends == own[::-1]
    rule = "is between other maps: the checksums are not those of these two"
    if is_other_way:
        rule = f"leads from {maps[1].title} to {maps[0].title}; its inverse is used"
    emit_warning(f"{files[0]}: {rule}")
    return source.transform.inverse() if is_other_way else source.transform


def opened_in_one_frame(
    first: inputs.Map, second: inputs.Map, *, align: bool, by: TransformLike,
    **reading: Unpack[inputs.Reading],
) -> tuple[list[inputs.MapInput], Transform | None]:  # fmt: skip
    if align and by is not None:
        raise ParameterError("cannot be given together with --by", place="align")
    transform, files = given_transform(by, place="by")
    maps = inputs.open_inputs(first, second, names=("map A", "map B"), also=files, **reading)
    if align:
        inputs.claim_for(maps, bytes_to_place(maps), "maps that are aligned")
        return maps, aligned(maps, hint="--by FILE uses a transform as it is")
    return maps, None if transform is None else transform_in(transform, files, maps)


def are_costs(maps: Sequence[inputs.MapInput]) -> bool:
    return all(isinstance(source.grid, Costmap) for source in maps)


def names_of_two(first: Path, second: Path) -> list[str]:
    """Return the names of two files without endings, with folders where the names are equal."""
    a, b = (path.with_suffix("").parts for path in (first, second))
    count = next((k for k in range(1, max(len(a), len(b)) + 1) if a[-k:] != b[-k:]), 1)
    return ["/".join(names[-count:]) for names in (a, b)]


def moved_line(transform: Transform) -> str:
    x, y, yaw = (round(value, 4) + 0.0 for value in transform.pose)
    return f"  moved     A by x {x:g} m, y {y:g} m, yaw {yaw:g} rad"


def warn_of_uncovered(
    maps: Sequence[inputs.MapInput], bounds: Sequence[Bound], not_compared: int
) -> None:
    if bounds and not_compared:
        text = f"does not cover {not_compared} known cells of {maps[0].name}"
        emit_warning(f"{maps[1].name}: {text}, which are not compared")


def aligned(maps: Sequence[inputs.MapInput], *, hint: str) -> Transform:
    found = placed(maps[0].occupancy, maps[1].occupancy)
    if not found.same_place:
        rule = f"cannot be aligned to {maps[1].name} with certainty: {found.reason}"
        raise FindingError(rule, source=maps[0].name, hint=hint)
    return found.transform


def bytes_to_place(maps: Sequence[inputs.MapInput]) -> int:
    return bytes_to_align([math.prod(source.grid.shape) for source in maps])


def warn_of_frames(maps: Sequence[inputs.MapInput], advice: str) -> bool:
    """Warn of two maps whose walls do not meet where they lie, but do once aligned."""
    first, second = (source_map.occupancy for source_map in maps)
    before = _meeting(first, second, Transform())
    if before is None or before >= _MEET_ANYWAY:
        return False
    found = None
    with suppress(MalformedInputError):  # without the memory for aligning, omit this advice
        claim(maps[0].name, bytes_to_place(maps))
        found = placed(first, second)
    if found is None or not found.same_place:
        return False
    after = _meeting(first, second, found.transform) or 0.0
    if after - before < _MUCH_BETTER:
        return False
    x, y, yaw = (round(value, 3) + 0.0 for value in found.transform.pose)
    text = f"{maps[0].name}, {maps[1].name}: do not lie in one frame: {100 * before:.0f} % of the "
    text += f"walls of the first lie on walls of the second, and {100 * after:.0f} % once it is "
    emit_warning(f"{text}moved by x {x:g} m, y {y:g} m, yaw {yaw:g} rad; {advice}")
    return True


def _meeting(first: OccupancyGrid, second: OccupancyGrid, transform: Transform) -> float | None:
    """Return the share of the first map's walls on walls of the second, if both have walls."""
    walls = np.flatnonzero(first.occupied())
    there = second.occupied()
    if not len(walls) or not there.any():
        return None
    walls = walls[:: -(-len(walls) // _MOST_WALLS)]
    cells = np.stack(np.divmod(walls, first.shape[1]), axis=1)
    points = transform.points(first.frame.xy_from_rowcol(cells))
    at, is_inside = second.frame.bounded_rowcol_from_xy(points)
    near = max(_NEAR, 1.5 * max(first.resolution, second.resolution)) / second.resolution
    meets = within_distance(there, int(near * near))[at[:, 0], at[:, 1]]
    return float(np.mean(meets & is_inside))
