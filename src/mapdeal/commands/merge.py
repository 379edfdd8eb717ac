"""``mapdeal merge``: several maps of one place as one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import compress
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray

from mapdeal import errors, records
from mapdeal.command import AT_LEAST_0, METRES, OnlyInPython, Output, Result, Words, command
from mapdeal.commands import two_maps
from mapdeal.compare import align, merge as merging
from mapdeal.compatibility import Unpack
from mapdeal.files.source import bytes_of_lines, claim, holding
from mapdeal.grid import occupancy, values
from mapdeal.grid.frame import Transform
from mapdeal.kernels.lookup import histogram
from mapdeal.maps.formats import format_of
from mapdeal.maps.reading import open_map, output_paths, write_grid
from mapdeal.pictures import canvas, comparisons
from mapdeal.pipeline import folder, inputs
from mapdeal.sensors.points import transform_document

_BYTES_PER_CELL = 26  # of the result; one more for each map
_EVIDENCE_BYTES_PER_CELL = 26  # additional ones for the sums
_PICTURE_BYTES_PER_CELL = 2  # additional ones besides the picture itself
_BYTES_PER_WALL_CELL = 60  # of the maps
_BYTES_PER_ROW = 350  # for the corners of known cells


@records.dataclass(frozen=True, eq=False, repr=False)
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

    grid: occupancy.OccupancyGrid
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
        conflicts = values.count_text(self.conflict_count, "conflict")
        yield f"{len(self.maps)} maps, {width} x {height} cells, {conflicts}"

    @property
    def conflict_count(self) -> int:
        """Number of cells that are occupied in one map and free in another."""
        return int(np.count_nonzero(self.conflicts))

    def document(self) -> dict[str, Any]:
        merged = []
        for source, transform, cells in zip(self.inputs, self.transforms, self.maps, strict=True):
            named = source.document() or {"file": None, "sha256": None}
            placed = {"transform": transform_document(transform), **records.asdict(cells)}
            conflicts = {"conflicts": cells.conflicts, "conflict_share": cells.conflict_share}
            merged.append({**named, **placed, **conflicts})
        counts = {"common": self.common, "conflicts": self.conflict_count}
        figures = {"thickness": self.thickness, "kept": self.kept, "figures": self.grid.figures()}
        return {"rule": self.rule, "merged": merged, **counts, **figures}

    def summary(self, output: Path) -> Iterator[str]:
        yield folder.written_line(output, self.grid.figures(), with_origin=True)
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
            text += f"the result; {100 * counts.within_cell:.1f} % within a cell of its walls"
            if counts.same_wall:
                share = 100 * (counts.within_same_wall or 0.0)
                text += f", {share:.1f} % within {counts.same_wall:.3g} m"
            yield text

    def drawn(self, *, title: str | None = None, **look: Any) -> canvas.Image:
        names = [source.title for source in self.inputs]
        if len(set(names)) < len(names):
            names = [f"map {number}" for number in range(1, len(names) + 1)]
        look["title"] = None if title is None else errors.one_line(title)
        return comparisons.merge_image(self.grid, self.conflicts, names=names, **look)

    def write(self, transaction: Any, output: Path) -> None:
        metadata = self.inputs[0].metadata
        extra = dict(metadata.extra) if metadata else {}
        more = None if self.log_odds is None else {"log_odds": self.log_odds}
        write_grid(transaction, output, self.grid, extra=extra, more=more)


def _placing(words: list[str]) -> Literal["align"] | list[Path] | None:
    for word in ("frames", "align"):
        if word in words and len(words) > 1:
            raise errors.ParameterError(f"{word} cannot be given together with others", got=words)
    if words == ["frames"]:
        return None
    return "align" if words == ["align"] else [Path(word) for word in words]


@command(
    group="Two maps of one place",
    output=Output(
        "OUT", "The result: .yaml or .pgm (a pgm pair), .png (a pair), or .npz.", paths=output_paths
    ),
    example="""\
mapdeal merge examples/maps/office.yaml examples/maps/office_cartographer.yaml \\
    --by align -o out/merged.yaml --image out/merged.png""",
)
def merge(
    maps: Annotated[Sequence[inputs.Map], Words("MAP...")],
    *,
    transforms: Annotated[
        Literal["align"] | Sequence[Transform | str | PathLike[str] | None] | None,
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
    values.check_choice(rule, merging.Rule, "rule")
    errors.require(len(maps) >= merging.FEWEST, "takes two maps or more", "maps", got=len(maps))
    names = [f"map {number}" for number in range(1, len(maps) + 1)]
    named = () if transforms is None or isinstance(transforms, str) else transforms
    files = [Path(file) for file in named if isinstance(file, str | PathLike)]
    sources = inputs.open_inputs(*maps, names=names, also=files, **reading)
    grids = [merging.check_is_map(source.grid, source.name) for source in sources]
    settings = inputs.settings_of(**reading)
    with settings.reading(), holding(sum(map(inputs.bytes_of, grids))):
        claim(sources[0].name, max(bytes_of_lines(grid.shape, _BYTES_PER_ROW) for grid in grids))
        layers = _evidence_of(sources, rule, evidence, settings.max_cells)
        by_walls = transforms == "align"
        placed = _by_walls(grids, sources) if by_walls else _transforms_of(transforms, sources)
    frames = [
        grid.frame if transform is None else transform.inverse().frame(grid.frame)
        for grid, transform in zip(grids, placed, strict=True)
    ]
    frames[1:] = [merging.snapped(frame, frames[0]) for frame in frames[1:]]
    with inputs.errors_named(sources[0].name):
        lattice = merging.lattice_around(grids, frames)
    per_cell = _BYTES_PER_CELL + len(grids) + _EVIDENCE_BYTES_PER_CELL * (rule == "evidence")
    per_cell += _PICTURE_BYTES_PER_CELL * (settings.image is not None)
    wall_cells = sum(int(histogram(grid.occupancy)[values.OCCUPIED]) for grid in grids)
    needed = sum(map(inputs.bytes_of, grids)) + _bytes_in(layers)
    needed += _BYTES_PER_WALL_CELL * wall_cells + per_cell * lattice.height * lattice.width
    with settings.reading():
        size = f"{lattice.width} x {lattice.height} cells around all maps"
        claim(sources[0].name, needed, what=size)
    parts = merging.merged_on(lattice, grids, frames, rule, layers, same_wall)
    from_first = tuple(transform or Transform() for transform in placed)
    merged = Merged(**parts, inputs=tuple(sources), rule=rule, transforms=from_first)
    advice = _warn_of_frames(sources) if transforms is None else ""
    for text in _remarks_on(merged, [not layer for layer in layers], advice):
        errors.emit_warning(text)
    return merged


def _transforms_of(transforms: Any, maps: Sequence[inputs.MapInput]) -> list[Transform | None]:
    """Return the transform from the first map's frame to that of each map; None is the same."""
    if transforms is None:
        return [None] * len(maps)
    first, *later = maps
    if (is_text := isinstance(transforms, str)) or len(transforms) != len(later):
        rule = f"must be {len(later)}, one for each map except the first{', or align' * is_text}"
        got = transforms if is_text else len(transforms)
        raise errors.ParameterError(rule, place="transforms", got=got)
    found: list[Transform | None] = [None]
    for transform, source in zip(transforms, later, strict=True):
        known, files = two_maps.given_transform(transform, place="transforms")
        placed = None if known is None else two_maps.transform_in(known, files, [first, source])
        found.append(placed)
    return found


def _warn_of_frames(sources: Sequence[inputs.MapInput]) -> str:
    """Warn of maps that hardly share their frame; return the advice for maps that contradict."""
    is_shell = inputs.Work.current.get() is not None
    by_walls = ("--by align" if is_shell else "transforms='align'") + " places maps by their walls"
    pairs = [(sources[0], second) for second in sources[1:]]
    is_warned = [two_maps.warn_of_frames(pair, by_walls) for pair in pairs]
    return f"; {by_walls}" if is_shell and not any(is_warned) else ""


def _evidence_of(
    maps: Sequence[inputs.MapInput], rule: merging.Rule,
    layers_given: Sequence[merging.Layers | None] | None, max_cells: int | None,
) -> list[merging.ChosenLayers]:  # fmt: skip
    if layers_given is not None:
        if rule != "evidence":
            raise errors.ParameterError("is for rule evidence alone", place="evidence")
        text, count = f"must be {len(maps)}, one for each map", len(layers_given)
        errors.require(count == len(maps), text, "evidence", got=count)
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
        except errors.ParameterError as error:
            raise error.found_in(source.name) if path is None else error.in_file(path) from None
    return chosen


def _bytes_in(layers: Sequence[merging.ChosenLayers]) -> int:
    return sum(layer.nbytes for entry in layers for layer in entry.values())


def _by_walls(
    grids: Sequence[occupancy.OccupancyGrid], maps: Sequence[inputs.MapInput]
) -> list[Transform | None]:
    # A map that overlaps the first one too little is aligned with another map that is placed.
    cells = [grid.frame.height * grid.frame.width for grid in grids]
    claim(maps[0].name, align.bytes_to_align(sorted(cells)[-2:]), what="maps that are aligned")
    from_first = {0: Transform()}
    reasons: dict[int, str] = {}
    bases = [0]
    while bases:
        known = set(from_first)
        for number in range(1, len(grids)):
            for base in bases:
                if number in from_first:
                    break
                with inputs.errors_named(maps[number].name):
                    alignment = align.placed(grids[base], grids[number])
                if alignment.same_place:
                    from_first[number] = alignment.transform.after(from_first[base])
                else:
                    reasons.setdefault(number, str(alignment.reason))  # that of the first map
        bases = [number for number in from_first if number not in known]
    unplaced = [number for number in reasons if number not in from_first]
    if unplaced:
        number = unplaced[0]
        first, name = maps[0].name, maps[number].name
        elsewhere = " or on another" if len(from_first) > 1 else ""
        rule = f"its placement on {first}{elsewhere} is uncertain: {reasons[number]}"
        hint = f"mapdeal align {first} {name} shows the result; --by FILE.json uses it"
        raise errors.FindingError(rule, source=name, hint=hint)
    return [None, *(from_first[number] for number in range(1, len(grids)))]


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
            share = 100 * counts.conflict_share
            text = f"{name}: contradicts the other maps on {share:.1f} % of the "
            text += f"cells that it shares with them, and only {counts.met} of its {counts.walls} "
            yield f"{text}wall cells there have a wall of theirs near: it is hardly aligned{advice}"
