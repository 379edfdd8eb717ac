"""Maps in files, merged into one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from mapdeal.compare.align import bytes_to_align
from mapdeal.editing.merge import (
    FEWEST,
    ChosenLayers,
    Merged,
    Rule,
    check_is_map,
    chosen_layers,
    lattice_around,
    merged_on,
    placed,
    remarks_on,
    without_layers,
)
from mapdeal.errors import FindingError, ParameterError, emit_warning, one_line
from mapdeal.files.budget import claim, holding
from mapdeal.grid.display import count_text
from mapdeal.grid.frame import Transform
from mapdeal.grid.framed import Figures
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.maps.npz import read_evidence
from mapdeal.maps.png import write_indexed_png
from mapdeal.maps.reading import Source, output_paths, write_grid
from mapdeal.pictures.canvas import Image
from mapdeal.pictures.comparisons import merge_image
from mapdeal.pipeline.inputs import bytes_of, errors_named, outputs_of, read_summed
from mapdeal.pipeline.settings import Settings
from mapdeal.sensors.points import TransformFile, read_transform, transform_document


@dataclass(frozen=True)
class Known:
    """Source files of a map that was read."""

    path: Path
    sums: Mapping[str, str]

    def is_of(self, sums: Mapping[str, str]) -> bool:
        """Return whether these are its checksums, whatever its files are called."""
        return sorted(self.sums.values()) == sorted(sums.values())


def transforms_by_files(files: Sequence[Path], maps: Sequence[Known]) -> list[Transform]:
    """Return the transform from the first map's frame to that of each other map."""
    # A file with checksums is between the two maps that have them, in whatever order these are
    # given, and transforms are chained: from A to B and from C to B place C, too. One without is
    # from the first map to the second, third, ..., as it is the first, second, ... of the files.
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
    """Return the transforms that `transforms_by_files` returns, of maps that are aligned."""
    # A map that has too little in common with the first one is placed on another that is placed.
    from mapdeal.compare.align import align

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


_PER_CELL, _OF_EVIDENCE = 22, 26
"""Bytes for each cell of the result, and more of them for sums; each map takes another one."""

_OF_PICTURE = 2
"""Bytes more for a picture, besides its own."""

By = Literal["frames", "align"]


@dataclass(frozen=True)
class MergeReport:
    """What was merged, and how."""

    merged: Merged
    maps: tuple[Known, ...]
    transforms: tuple[Transform, ...]
    rule: Rule

    @property
    def figures(self) -> Figures:
        return self.merged.grid.figures()

    def document(self) -> dict[str, Any]:
        return {
            "rule": self.rule,
            "merged": [
                {
                    "file": str(one.path),
                    "sha256": dict(one.sums),
                    "transform": transform_document(transform),
                    **asdict(counts),
                    "conflicts": counts.conflicts,
                    "conflict_share": counts.conflict_share,
                }
                for one, transform, counts in zip(
                    self.maps, self.transforms, self.merged.maps, strict=True
                )
            ],
            "common": self.merged.common,
            "conflicts": self.merged.conflict_count,
            "figures": self.figures,
        }


def merge_files(
    paths: Sequence[Path],
    output: Path,
    options: Settings,
    *,
    by: By | Sequence[Path] = "frames",
    rule: Rule = "occupied",
) -> MergeReport:
    outputs = output_paths(output)
    if len(paths) < FEWEST:
        raise ParameterError("takes two maps or more", source="merge", got=len(paths))
    sources, layers = _read(paths, options, rule)
    grids = [check_is_map(one.grid, str(path)) for one, path in zip(sources, paths, strict=True)]
    maps = tuple(Known(path, one.sums) for path, one in zip(paths, sources, strict=True))
    files = [file for one in sources for file in one.files]
    if not isinstance(by, str):
        files += by
    with outputs_of(outputs, files, options) as transaction:
        with options.memory(), holding(sum(map(bytes_of, grids))):
            transforms = _transforms(by, grids, maps)
        frames = placed(grids, transforms)
        with errors_named(paths[0]):
            lattice = lattice_around(grids, frames)
        held = sum(map(bytes_of, grids)) + sum(v.nbytes for one in layers for v in one.values())
        per_cell = _PER_CELL + len(maps) + _OF_EVIDENCE * (rule == "evidence")
        per_cell += _OF_PICTURE * (options.image is not None)
        with options.memory():
            what = f"{lattice.width} x {lattice.height} cells around all maps"
            claim(paths[0], held + per_cell * lattice.height * lattice.width, what=what)
        merged = merged_on(lattice, grids, frames, rule=rule, evidence=layers)
        advice = "; --by align places maps by their walls" if by == "frames" else ""
        names = [str(path) for path in paths]
        for text in remarks_on(merged, names, rule, without_layers(layers), advice=advice):
            emit_warning(text, stacklevel=2)
        metadata = sources[0].metadata
        more = None if merged.log_odds is None else {"log_odds": merged.log_odds}
        write_grid(
            transaction,
            output,
            merged.grid,
            extra=dict(metadata.extra) if metadata else {},
            more=more,
        )
        if options.image is not None:
            image = _picture(merged, paths, options)
            transaction.write(
                options.image, lambda file: write_indexed_png(file, image.indices, image.palette)
            )
    return MergeReport(merged, maps, (Transform(), *transforms), rule)


def _read(
    paths: Sequence[Path], options: Settings, rule: Rule
) -> tuple[list[Source], list[ChosenLayers]]:
    """Return the maps in files, and the layers of evidence where they are asked for."""
    sources: list[Source] = []
    layers: list[ChosenLayers] = []
    with ExitStack() as stack:
        stack.enter_context(options.memory())
        for path in paths:
            source = read_summed(path, options)
            stack.enter_context(holding(bytes_of(source.grid)))
            own: ChosenLayers = {}
            if rule == "evidence" and source.metadata is None:
                found = read_evidence(path, max_cells=options.max_cells)
                try:
                    own = chosen_layers(found, source.grid.shape)
                except ParameterError as error:
                    raise error.in_file(path) from None
                stack.enter_context(holding(sum(layer.nbytes for layer in own.values())))
            sources.append(source)
            layers.append(own)
    return sources, layers


def _picture(merged: Merged, paths: Sequence[Path], options: Settings) -> Image:
    names = [path.stem for path in paths]
    if len(set(names)) < len(names):
        names = [f"map {number}" for number in range(1, len(names) + 1)]
    return merge_image(
        merged.grid,
        merged.conflicts,
        names=[one_line(name) for name in names],
        image_extent=options.image_extent,
    )


def _transforms(
    by: By | Sequence[Path], grids: Sequence[OccupancyGrid], maps: Sequence[Known]
) -> list[Transform]:
    if by == "frames":
        return [Transform() for _ in maps[1:]]
    if by == "align":
        return transforms_by_walls(grids, [one.path for one in maps])
    return transforms_by_files([Path(path) for path in by], maps)
