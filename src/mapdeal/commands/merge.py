"""``mapdeal merge``: several maps of one place as one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import compress
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray

from mapdeal.command import AT_LEAST_0, METRES, OnlyInPython, Output, Result, Words, command
from mapdeal.commands import two_maps
from mapdeal.compare import merge as merging
from mapdeal.compare.align import bytes_to_align, placed as placed_on
from mapdeal.compatibility import Unpack
from mapdeal.errors import FindingError, ParameterError, emit_warning, one_line
from mapdeal.files.source import bytes_of_lines, claim, holding
from mapdeal.grid.frame import Transform
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import check_choice, count_text
from mapdeal.maps.formats import format_of
from mapdeal.maps.reading import open_map, output_paths, write_grid
from mapdeal.pictures.canvas import Image
from mapdeal.pictures.comparisons import merge_image
from mapdeal.pipeline import inputs
from mapdeal.pipeline.folder import written_line
from mapdeal.sensors.points import read_transform, transform_document

_PER_CELL, _OF_EVIDENCE, _PER_WALL = 26, 26, 60
"""Bytes for each cell of the result, more of them for sums, and for each wall cell of a map; each
map takes another one for each cell."""

_PER_LINE = 350  # bytes of corners of known cells, for each row
_OF_PICTURE = 2  # bytes more for a picture, besides its own

Placing = Sequence[Transform | str | PathLike[str] | None]


@dataclass(frozen=True, eq=False, repr=False)
class Merged(Result):
    """Result of `merge`: several maps combined into one.

    Parameters
    ----------
    grid : OccupancyGrid
        Merged map.
    conflicts : numpy.ndarray of uint8, shape of the grid
        1 where the first map is occupied and another free, 2 where the first is free and another
        occupied, 3 where only other maps contradict each other; 0 elsewhere.
    maps : tuple of MapCounts
        Counts for each map, in the order given.
    common : int
        Number of cells known in two or more maps.
    log_odds : numpy.ndarray of float64, shape of the grid, optional
        Sum that decided each cell under rule ``evidence``, on the scale of `build_map`: 50 is
        even, nan where nothing is known. None under other rules.
    inputs : tuple of MapInput
        The maps that were merged.
    transforms : tuple of Transform
        From the first map's frame to the frame of each map.
    rule : {'occupied', 'newest', 'evidence'}
        How the values were combined.
    thickness : float or None
        Mean thickness of the walls of the result, metres.
    kept : int
        Number of cells of the result that the last map does not know.
    """

    grid: OccupancyGrid
    conflicts: NDArray[np.uint8]
    maps: tuple[merging.MapCounts, ...]
    common: int
    log_odds: NDArray[np.float64] | None
    inputs: tuple[inputs.MapInput, ...]
    transforms: tuple[Transform, ...]
    rule: merging.Rule
    thickness: float | None = None
    kept: int = 0

    def _repr_parts(self) -> Iterator[str]:
        height, width = self.grid.shape
        conflicts = count_text(self.conflict_count, "conflict")
        yield f"{len(self.maps)} maps, {width} x {height} cells, {conflicts}"

    @property
    def conflict_count(self) -> int:
        """Number of cells that are occupied in one map and free in another."""
        return int(np.count_nonzero(self.conflicts))

    def document(self) -> dict[str, Any]:
        return {
            "rule": self.rule,
            "merged": [
                {
                    **(self.inputs[k].document() or {"file": None, "sha256": None}),
                    "transform": transform_document(self.transforms[k]), **asdict(counts),
                    "conflicts": counts.conflicts, "conflict_share": counts.conflict_share,
                }
                for k, counts in enumerate(self.maps)
            ],
            "common": self.common, "conflicts": self.conflict_count, "thickness": self.thickness,
            "kept": self.kept, "figures": self.grid.figures(),
        }  # fmt: skip

    def summary(self, output: Path) -> Iterator[str]:
        yield written_line(output, self.grid.figures(), with_origin=True)
        yield from self.lines()

    def lines(self) -> Iterator[str]:
        line = f"  {self.common} cells are known in several maps"
        if self.common:
            count, share = self.conflict_count, 100 * self.conflict_count / self.common
            line += f"; {count} of them ({share:.2f} %) are occupied in one and free in another"
        yield line
        for number, (source, counts) in enumerate(zip(self.inputs, self.maps, strict=True)):
            text = f"  {source.name}: {counts.known} cells known"
            text += f", {counts.added} added" if number else ""
            if counts.common:
                text += f"; of {counts.common} that others know, {counts.occupied_here} are "
                text += f"occupied here and free there, {counts.free_here} vice versa"
            if counts.common and counts.walls:
                share = 100 * counts.met / counts.walls
                text += f"; {share:.0f} % of its walls there are also in others"
            yield text
        if self.rule == "newest":
            last, count = self.inputs[-1].name, self.kept
            yield f"  {last} decides where it knows a cell; {count} cells are from before it"
        for source, counts in zip(self.inputs, self.maps, strict=True):
            if counts.thickness is None or counts.within_cell is None:
                continue
            thick = "none left" if self.thickness is None else f"{self.thickness:.3g} m"
            text = f"  {source.name}: walls {counts.thickness:.3g} m thick on average, {thick} in "
            text += f"the result, which has {100 * counts.within_cell:.1f} % of them within a cell"
            if counts.same_wall:
                share = 100 * (counts.within_same_wall or 0.0)
                text += f", {share:.1f} % within {counts.same_wall:.3g} m"
            yield text

    def drawn(self, *, title: str | None = None, **look: Any) -> Image:
        names = [source.title for source in self.inputs]
        if len(set(names)) < len(names):
            names = [f"map {number}" for number in range(1, len(names) + 1)]
        title = None if title is None else one_line(title)
        return merge_image(self.grid, self.conflicts, names=names, title=title, **look)

    def write(self, transaction: Any, output: Path) -> None:
        metadata = self.inputs[0].metadata
        extra = dict(metadata.extra) if metadata else {}
        more = None if self.log_odds is None else {"log_odds": self.log_odds}
        write_grid(transaction, output, self.grid, extra=extra, more=more)


def _placing(words: list[str]) -> Literal["align"] | list[Path] | None:
    for word in ("frames", "align"):
        if word in words and len(words) > 1:
            raise ParameterError(f"{word} cannot be given together with others", got=words)
    if words == ["frames"]:
        return None
    return "align" if words == ["align"] else [Path(word) for word in words]


@command(
    group="Two maps of one place",
    output=Output(
        "OUT", "The result: .yaml or .pgm (a pgm pair), .png (a pair), or .npz.",
        paths=output_paths,
    ),
    example="""\
mapdeal merge examples/maps/office.yaml examples/maps/office_cartographer.yaml \\
    --by align -o out/merged.yaml --image out/merged.png""",
)  # fmt: skip
def merge(
    maps: Annotated[Sequence[inputs.Map], Words("MAP...")],
    *,
    transforms: Annotated[
        Literal["align"] | Placing | None,
        Words("frames|align|FILE.json", _placing, "by", is_repeated=True),
    ] = None,
    rule: merging.Rule = "occupied",
    same_wall: Annotated[float | None, AT_LEAST_0, METRES] = None,
    evidence: Annotated[Sequence[merging.Layers | None] | None, OnlyInPython] = None,
    **reading: Unpack[inputs.Reading],
) -> Merged:
    """Merge maps of one place into one.

    The result has the lattice of the first map, whose cells keep their places, extended by whole
    cells to the known area of the others. These may have any resolution, origin and yaw: they are
    resampled so that no obstacle is lost.

    Rule occupied: occupied wins over free, and free over unknown. Rule newest: the last map that
    knows a cell wins. Rule evidence: the evidence for and against an obstacle is summed, from the
    layers of mapdeal build --layers; a map without them has one vote per cell, and a tie is
    decided by rule occupied.

    Cells that are occupied in one map and free in another are conflicts: they are counted, and
    coloured in the picture. With --by align the exit code is 1, and nothing is written, if the
    placement of a map is uncertain.

    Parameters
    ----------
    maps : sequence of path, str or grid
        Two maps or more: .yaml, .pbm or .npz. In Python, grids serve as well.
    transforms : 'align' or sequence of Transform, path or None, optional
        How the maps are placed: by their frames (the default), by their walls (align), or by files
        of mapdeal align, one for each map except the first. In Python, a `Transform` from the first
        map's frame to that of the map, p_map = T p_first, serves as well; None is the same frame.
    rule : {'occupied', 'newest', 'evidence'}
        Which value wins: the largest, that of the last map that knows the cell, or the evidence.
    same_wall : float, optional
        Walls of two maps within this distance are one wall, metres. By default the
        distance that 85 % of their walls have and a cell, at most 0.3 m; 0 draws all of them.
    evidence : sequence of mapping, optional
        Layers of each map for rule ``evidence``, as returned by `build_map`: ``log_odds``, or
        ``hits`` and ``misses``; none for a map without. By default those in the maps' files.
    **reading
        As for `read_map`; dialect, max_cells and max_memory apply to files.

    Returns
    -------
    Merged
        The merged map, the conflicts, and the counts for each map.

    Raises
    ------
    FileAccessError, MalformedInputError
        If a file cannot be read.
    FindingError
        If the maps are to be aligned, and the placement of one is uncertain.
    ParameterError
        If there are fewer than two maps, one of them is not a map, `transforms` or `evidence` do
        not fit the maps or the rule, or the maps are too far apart.

    Warns
    -----
    MapdealWarning
        If a map adds nothing, has no known cell in common with another, contradicts the others so
        strongly that it is probably misaligned, or has no layers under rule ``evidence``.

    Notes
    -----
    For a map on another lattice, ``occupied`` and ``newest`` mark every cell that overlaps one of
    its obstacles, however little, and use the value at the centre of all other cells. Conflicts
    and votes use the value at the centre, or, if the map is finer than the result, any obstacle in
    the cell; there a cell is occupied at 65 and above and free at 25 and below, the defaults of
    Nav2's map_saver. Layers of evidence are sampled at the centre.

    The unit of evidence is one passing beam. ``log_odds`` count from 50, a vote weighs 1, and a hit
    in ``hits`` 7/3: the sum is positive above a share of hits of 0.3, as in method ``counting``.

    References
    ----------
    ``updateWithMax`` of costmap_2d also lets the largest value win. The sum follows H. Moravec and
    A. Elfes, "High Resolution Maps from Wide Angle Sonar", 1985.

    Examples
    --------
    >>> from mapdeal import OccupancyGrid
    >>> before = OccupancyGrid([[100, 0, 0, -1]], 0.5, (1.0, 2.0, 0.0))
    >>> after = OccupancyGrid([[0, 100, 100, 0]], 0.5, (1.5, 2.0, 0.0))
    >>> merged = merge([before, after])
    >>> merged.grid.occupancy.tolist(), merged.conflicts.tolist()
    ([[100, 0, 100, 100, 0]], [[0, 0, 2, 0, 0]])
    >>> merge([before, after], rule="newest").grid.occupancy.tolist()
    [[100, 0, 100, 100, 0]]
    """
    check_choice(rule, merging.Rule, "rule")
    if len(maps) < merging.FEWEST:
        raise ParameterError("takes two maps or more", place="maps", got=len(maps))
    names = [f"map {number}" for number in range(1, len(maps) + 1)]
    files: list[Path] = []
    if transforms is not None and not isinstance(transforms, str):
        files = [Path(place) for place in transforms if isinstance(place, str | PathLike)]
        if 0 < len(files) < len(transforms):
            raise ParameterError("must be files, or transforms", place="transforms")
    sources = inputs.open_inputs(*maps, names=names, also=files, **reading)
    grids = [merging.check_is_map(source.grid, source.name) for source in sources]
    settings = inputs.settings_of(**reading)
    with settings.reading(), holding(sum(map(inputs.bytes_of, grids))):
        claim(sources[0].name, max(bytes_of_lines(grid.shape, _PER_LINE) for grid in grids))
        layers = _evidence_of(sources, rule, evidence, settings.max_cells)
        if files:
            places = _by_files(files, sources)
        elif transforms == "align":
            places = _by_walls(grids, sources)
        else:
            places = _checked_transforms(transforms, len(maps) - 1)
    frames = [grid.frame if place is None else place.inverse().frame(grid.frame)
              for grid, place in zip(grids, places, strict=True)]  # fmt: skip
    frames[1:] = [merging.snapped(frame, frames[0]) for frame in frames[1:]]
    with inputs.errors_named(sources[0].name):
        lattice = merging.lattice_around(grids, frames)
    needed = sum(map(inputs.bytes_of, grids)) + _bytes_in(layers)
    needed += _PER_WALL * sum(int(np.count_nonzero(grid.occupied())) for grid in grids)
    per_cell = _PER_CELL + len(maps) + _OF_EVIDENCE * (rule == "evidence")
    per_cell += _OF_PICTURE * (settings.image is not None)
    needed += per_cell * lattice.height * lattice.width
    with settings.reading():
        size = f"{lattice.width} x {lattice.height} cells around all maps"
        claim(sources[0].name, needed, what=size)
    parts = merging.merged_on(lattice, grids, frames, rule, layers, same_wall)
    placed = tuple(place or Transform() for place in places)
    merged = Merged(**vars(parts), inputs=tuple(sources), transforms=placed, rule=rule)
    advice = ""
    if transforms is None:
        by_walls = "--by align places maps by their walls"
        pairs = [(sources[0], second) for second in sources[1:]]
        is_warned = [two_maps.warn_of_frames(pair, by_walls) for pair in pairs]
        if inputs.Work.current.get() is not None and not any(is_warned):
            advice = f"; {by_walls}"
    for text in _remarks_on(merged, [not layer for layer in layers], advice):
        emit_warning(text)
    return merged


def _checked_transforms(transforms: Any, count: int) -> list[Transform | None]:
    """Return one transform or None for each map, checked; None for the first map."""
    if transforms is None:
        return [None] * (count + 1)
    if len(transforms) != count or isinstance(transforms, str):
        rule = f"must be {count}, one for each map except the first"
        raise ParameterError(rule, place="transforms", got=len(transforms))
    return [None, *(inputs.transform_of(transform, place="transforms") for transform in transforms)]


def _evidence_of(
    maps: Sequence[inputs.MapInput], rule: merging.Rule,
    layers_given: Sequence[merging.Layers | None] | None, max_cells: int | None,
) -> list[merging.ChosenLayers]:  # fmt: skip
    if layers_given is not None and rule != "evidence":
        raise ParameterError("is for rule evidence alone", place="evidence")
    if layers_given is not None and len(layers_given) != len(maps):
        text = f"must be {len(maps)}, one for each map"
        raise ParameterError(text, place="evidence", got=len(layers_given))
    chosen: list[merging.ChosenLayers] = []
    for source, layers in zip(maps, layers_given or [None] * len(maps), strict=True):
        path = source.path if layers_given is None and rule == "evidence" else None
        path = path if path is not None and not format_of(path).is_yaml else None
        try:
            with holding(_bytes_in(chosen)):
                found = layers
                if path is not None:
                    with open_map(path, max_cells=max_cells) as file:
                        found = file.evidence()
                chosen.append(merging.chosen_layers(found or {}, source.grid.shape))
        except ParameterError as error:
            raise error.found_in(source.name) if path is None else error.in_file(path) from None
    return chosen


def _bytes_in(layers: Sequence[merging.ChosenLayers]) -> int:
    return sum(layer.nbytes for entry in layers for layer in entry.values())


def _by_files(files: Sequence[Path], maps: Sequence[inputs.MapInput]) -> list[Transform | None]:
    # A file with checksums is between the two maps that have them, in whatever order these are
    # given, and transforms are chained: from A to B and from C to B place C, too. One without is
    # from the first map to the second, third, ..., as it is the first, second, ... of the files.
    if len(files) >= len(maps):
        rule = f"{len(files)} files are given, and {count_text(len(maps) - 1, 'map')} to place"
        raise ParameterError(rule, place="transforms")
    own = [k if (first := _number_of(source.sums, maps)) is None else first
           for k, source in enumerate(maps)]  # fmt: skip
    steps = [_step(path, number, maps) for number, path in enumerate(files, 1)]
    edges = [edge for a, b, step in steps
             for edge in ((own[a], own[b], step), (own[b], own[a], step.inverse()))]  # fmt: skip
    found = {0: Transform()}
    while more := {
        b: step.after(found[a]) for a, b, step in edges if a in found and b not in found
    }:
        found |= more
    for source, first in zip(maps, own, strict=True):
        if first not in found:
            rule = f"no transforms lead from {maps[0].name} to {source.name}"
            hint = "pass --by once for each map but the first"
            raise ParameterError(rule, place="transforms", hint=hint)
    return [None, *(found[first] for first in own[1:])]


def _number_of(sums: Mapping[str, str], maps: Sequence[inputs.MapInput]) -> int | None:
    sums_sorted = sorted(sums.values())
    known = [sorted(source.sums.values()) for source in maps]
    return known.index(sums_sorted) if sums_sorted and sums_sorted in known else None


def _by_walls(
    grids: Sequence[OccupancyGrid], maps: Sequence[inputs.MapInput]
) -> list[Transform | None]:
    # A map that has too little in common with the first one is placed on another that is placed.
    cells = [grid.frame.height * grid.frame.width for grid in grids]
    claim(maps[0].name, bytes_to_align(sorted(cells)[-2:]), what="maps that are aligned")
    found = {0: Transform()}
    reasons: dict[int, str] = {}
    new = [0]
    while new:
        placed, new = new, []
        for number in range(1, len(grids)):
            for base in placed:
                if number in found:
                    break
                with inputs.errors_named(maps[number].name):
                    step = placed_on(grids[base], grids[number])
                if step.same_place:
                    found[number] = step.transform.after(found[base])
                    new.append(number)
                else:
                    reasons.setdefault(number, str(step.reason))  # that of the first map
    for number, reason in reasons.items():
        if number not in found:
            first, name = maps[0].name, maps[number].name
            elsewhere = " or on another" if len(found) > 1 else ""
            rule = f"its placement on {first}{elsewhere} is uncertain: {reason}"
            hint = f"mapdeal align {first} {name} shows the result; --by FILE.json uses it"
            raise FindingError(rule, source=name, hint=hint)
    return [None, *(found[number] for number in range(1, len(grids)))]


def _step(path: Path, number: int, maps: Sequence[inputs.MapInput]) -> tuple[int, int, Transform]:
    transform = read_transform(path)
    first, second = _number_of(transform.first, maps), _number_of(transform.second, maps)
    if first is not None and second is not None:
        return first, second, transform.transform
    if transform.first or transform.second:
        text = f"{path}: its checksums are not those of the maps; used as the transform from "
        emit_warning(f"{text}{maps[0].name} to {maps[number].name}")
    return 0, number, transform.transform


def _remarks_on(merged: Merged, is_bare: Sequence[bool], advice: str) -> Iterator[str]:
    names = [source.name for source in merged.inputs]
    if merged.rule == "evidence" and all(is_bare):
        yield "no map has evidence layers; each of their cells counts as one vote"
    elif merged.rule == "evidence":
        for name in compress(names, is_bare):
            yield f"{name}: has no evidence layers; each of its cells counts as one vote"
    for name, counts in zip(names[1:], merged.maps[1:], strict=True):
        if not counts.common:
            yield f"{name}: knows no cell that another map knows"
        elif not counts.added and (merged.rule == "occupied" or not counts.conflicts):
            yield f"{name}: adds nothing: the maps before it know all of its cells and obstacles"
        if counts.is_contradicted:
            yield (
                f"{name}: contradicts the other maps on {100 * counts.conflict_share:.1f} % of the "
                f"cells that it shares with them, and only {counts.met} of its {counts.walls} wall "
                f"cells there have a wall of theirs near: it is hardly aligned{advice}"
            )
