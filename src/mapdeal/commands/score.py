"""The score of the map in a file, on its own or against a true one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from mapdeal.commands.diff import ComparedMap
from mapdeal.compare.align import bytes_to_align
from mapdeal.compare.bounds import ScoreBound, checked_bounds, judged
from mapdeal.compare.score import (
    UNKNOWN,
    Comparison,
    States,
    bytes_alone,
    bytes_to_compare,
    compare_to_truth,
    metres_of,
    score_alone,
    states_of,
)
from mapdeal.errors import FindingError, ParameterError, emit_warning, one_line
from mapdeal.files.budget import claim
from mapdeal.files.json_values import SCORE_FORMAT
from mapdeal.grid.display import count_text
from mapdeal.grid.frame import Frame, Transform
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import FREE, OCCUPIED
from mapdeal.kernels.lookup import histogram
from mapdeal.kernels.threads import use_threads
from mapdeal.maps.png import write_indexed_png
from mapdeal.maps.reading import Source, as_occupancy
from mapdeal.pictures.comparisons import ScoredWalls, score_image
from mapdeal.pipeline.inputs import bytes_of, errors_named, outputs_of, read_together
from mapdeal.pipeline.settings import Settings
from mapdeal.sensors.points import TransformFile, read_transform, transform_document

Way = Literal["frames", "transform", "align"]
"""How the maps were placed: by their files, by a transform, or by aligning them."""

_HINT = "--align finds how the maps lie, --transform takes it from a file"


@dataclass(frozen=True)
class Asked:
    """Bounds and placement requested for a score."""

    minimum: Mapping[str, float]
    maximum: Mapping[str, float]
    transform: Transform | None = None
    transform_file: Path | None = None
    align: bool = False

    def bounds(self, *, with_truth: bool) -> list[tuple[str, Any, float]]:
        """Return the bounds, checked; see `checked_bounds`."""
        given = self.transform is not None or self.transform_file is not None
        if given and self.align:
            rule = "cannot be given together with a transform"
            raise ParameterError(rule, source="--align")
        if not with_truth:
            for name, value in (("--align", self.align), ("--transform", given)):
                if value:
                    raise ParameterError("needs --truth, a map to bring this one onto", source=name)
        return checked_bounds(self.minimum, self.maximum, with_truth=with_truth)

    def with_file_read(self) -> Asked:
        """Return the same with the transform that a file holds, whatever maps it is between."""
        if self.transform_file is None:
            return self
        return Asked(self.minimum, self.maximum, read_transform(self.transform_file).transform)


@dataclass(frozen=True, eq=False)
class ScoreReport:
    """A score."""

    values: dict[str, Any]
    bounds: tuple[ScoreBound, ...]
    frame: Frame
    states: States
    comparison: Comparison | None = None
    transform: Transform | None = None
    way: Way = "frames"
    maps: tuple[ComparedMap | None, ComparedMap | None] = (None, None)

    @property
    def passes(self) -> bool:
        return all(bound.holds for bound in self.bounds)

    def document(self) -> dict[str, Any]:
        named, truth = (None if one is None else asdict(one) for one in self.maps)
        transform = None
        if self.transform is not None:
            transform = {**transform_document(self.transform), "by": self.way}
        return {
            "format": SCORE_FORMAT,
            "map": named,
            "truth": truth,
            "transform": transform,
            "lattice": {
                "width": self.frame.width,
                "height": self.frame.height,
                "resolution": self.frame.resolution,
                "origin": list(self.frame.origin),
            },
            "values": self.values,
            "bounds": [{**asdict(bound), "holds": bound.holds} for bound in self.bounds],
            "passes": self.passes,
        }


def score_grids(
    estimate: OccupancyGrid,
    truth: OccupancyGrid | None,
    asked: Asked,
    *,
    names: tuple[str, str] = ("the map", "the truth"),
) -> ScoreReport:
    bounds = asked.bounds(with_truth=truth is not None)
    _warn_of_values(estimate, names[0])
    if truth is None:
        states = states_of(estimate.occupancy)
        values = score_alone(states, estimate.frame)
        if not values["wall_cells"]:
            emit_warning(f"{names[0]}: has no occupied cells", stacklevel=2)
        return ScoreReport(values, tuple(judged(bounds, values)), estimate.frame, states)
    _warn_of_values(truth, names[1])
    transform, way = _brought_together(estimate, truth, asked, names)
    found = compare_to_truth(estimate, truth, transform)
    _warn_of(found, estimate, names)
    return ScoreReport(
        found.values,
        tuple(judged(bounds, found.values)),
        found.frame,
        found.estimate,
        found,
        transform,
        way,
    )


def score_files(
    path: Path, truth: Path | None, options: Settings, asked: Asked
) -> ScoreReport:  # fmt: skip
    """Return the score of the map in a file; draw it if a picture is asked for."""
    asked.bounds(with_truth=truth is not None)  # before anything is read
    if truth is None and options.image is not None:
        raise ParameterError("needs --truth, a map to compare with", source="--image")
    paths = [path] if truth is None else [path, truth]
    told = None if asked.transform_file is None else read_transform(asked.transform_file)
    sources = read_together(paths, options)
    grids = [as_occupancy(source.grid, one) for source, one in zip(sources, paths, strict=True)]
    with options.memory(), use_threads(options.threads):
        _claim(paths[-1], sources, grids, options, aligns=asked.align)
    files = [file for source in sources for file in source.files]
    if asked.transform_file is not None:
        files.append(asked.transform_file)
    if told is not None:
        asked = _with_transform(asked, told, sources)
    with (
        outputs_of([], files, options) as transaction,
        use_threads(options.threads),
        errors_named(path),
    ):
        report = score_grids(
            grids[0], grids[1] if truth is not None else None, asked, names=(str(path), str(truth))
        )
        if options.image is not None and report.comparison is not None:
            image = score_image(
                walls_of(report.comparison),
                title=title_of(path, truth),
                image_extent=options.image_extent,
            )
            transaction.write(
                options.image, lambda file: write_indexed_png(file, image.indices, image.palette)
            )
    maps = list(map(ComparedMap.of, paths, sources))
    return replace(report, maps=(maps[0], maps[1] if truth is not None else None))


def walls_of(found: Comparison) -> ScoredWalls:
    to_truth, missed = (
        metres_of(squares, found.frame.resolution) for squares in (found.wall_squares, found.missed)
    )
    return ScoredWalls(found.frame, found.estimate, found.truth, to_truth, missed)


def title_of(path: Path, truth: Path | None) -> str:
    """Return what stands above the picture of two files."""
    return one_line(f"{path.stem} on {truth.stem if truth else ''}: how far off its walls are")


def _claim(
    path: Path,
    sources: list[Source],
    grids: list[OccupancyGrid],
    options: Settings,
    *,
    aligns: bool,
) -> None:
    """Refuse what takes too much memory."""
    shape = grids[-1].shape
    walls = sum(int(histogram(grid.occupancy)[OCCUPIED]) for grid in grids)
    if len(grids) > 1:
        needed = bytes_to_compare(shape, walls, is_drawn=options.image is not None)
        if aligns:
            cells = [grid.shape[0] * grid.shape[1] for grid in grids]
            needed = max(needed, bytes_to_align(cells))
    else:
        needed = bytes_alone(shape, walls)
    held = sum(bytes_of(source.grid) for source in sources)
    claim(path, held + needed, what=f"{shape[1]} x {shape[0]} cells")


def _with_transform(asked: Asked, told: TransformFile, sources: list[Source]) -> Asked:
    """Return what is asked with the transform of a file, turned round if it goes the other way."""
    transform, source = told.transform, asked.transform_file
    sums = [dict(one.sums) for one in sources]
    if told.first and told.second:
        ends = [set(of.values()) for of in (told.first, told.second)]
        own = [set(of.values()) for of in sums]
        if ends == own[::-1] and ends != own:
            text = f"{source}: leads from the truth to the map; its inverse is used"
            emit_warning(text, stacklevel=2)
            transform = transform.inverse()
        elif ends != own:
            text = f"{source}: is between other maps: the checksums are not those of these two"
            emit_warning(text, stacklevel=2)
    return Asked(asked.minimum, asked.maximum, transform)


def _brought_together(
    estimate: OccupancyGrid, truth: OccupancyGrid, asked: Asked, names: tuple[str, str]
) -> tuple[Transform, Way]:
    if asked.transform is not None:
        return asked.transform, "transform"
    if not asked.align:
        return Transform(), "frames"
    from mapdeal.compare.align import align

    found = align(estimate, truth)
    if not found.same_place:
        rule = f"cannot be aligned to {names[1]} with certainty: {found.reason}"
        raise FindingError(rule, source=names[0], hint="--transform uses a transform as it is")
    return found.transform, "align"


def _warn_of_values(grid: OccupancyGrid, name: str) -> None:
    between = int(histogram(grid.occupancy)[FREE + 1 : OCCUPIED].sum())
    if between:
        verb = "counts" if between == 1 else "count"
        text = f"{name}: {count_text(between, 'cell')} of 1..99 {verb} as unknown"
        emit_warning(text, stacklevel=3)


def _warn_of(found: Comparison, estimate: OccupancyGrid, names: tuple[str, str]) -> None:
    own, truth = names
    if not (found.truth != UNKNOWN).any():
        emit_warning(
            f"{truth}: has no known cell, so there is nothing to compare with", stacklevel=3
        )
    elif not (found.estimate != UNKNOWN).any():
        text = f"{own}: has no known cell on {truth}; {_HINT}"
        emit_warning(text, stacklevel=3)
    elif not found.values["known_in_both"]:
        text = f"{own}: has no known cell in common with {truth}; {_HINT}"
        emit_warning(text, stacklevel=3)
    else:
        for walls, name in ((found.wall_squares, own), (found.missed, truth)):
            if not len(walls):
                text = f"{name}: has no occupied cell there, so no distances can be measured"
                emit_warning(text, stacklevel=3)
    cell, true_cell = estimate.resolution, found.frame.resolution
    if not np.isclose(cell, true_cell, rtol=1e-6, atol=0):
        text = (
            f"{own}: has cells of {cell:g} m, {truth} of {true_cell:g} m; what counts is its cell "
            "at the centre of each of theirs"
        )
        emit_warning(text, stacklevel=3)
