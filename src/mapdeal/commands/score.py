"""``mapdeal score``: how good a map is, on its own or against a true one."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

from mapdeal.command import Result, Words, command, is_plain
from mapdeal.commands import two_maps
from mapdeal.compare import score as scoring
from mapdeal.compatibility import Unpack
from mapdeal.errors import ParameterError, emit_warning, one_line
from mapdeal.files.json_values import SCORE_FORMAT
from mapdeal.files.source import bytes_of_lines
from mapdeal.grid.frame import Frame, Transform
from mapdeal.grid.values import FREE, OCCUPIED, count_text
from mapdeal.kernels.lookup import histogram
from mapdeal.pictures.canvas import Image
from mapdeal.pictures.comparisons import ScoredWalls, score_image
from mapdeal.pipeline import inputs
from mapdeal.records import asdict, dataclass
from mapdeal.sensors.points import transform_document

# How the maps were placed: by their files, by a transform, or by aligning them.
Placement = Literal["frames", "transform", "align"]
Bounds = Mapping[str, float] | None

_COLUMNS = (
    ("n", "n", scoring.COUNT, 9),
    *((name, name, scoring.METRES, 13) for name in ("mean", "median", "p95", "max")),
    ("within 0.1 m", "share_le_0p1", scoring.SHARE, 14),
)
_AFTER_THICKNESS = (
    "share_one_cell_thick", "corners", "enclosed_areas", "enclosed_m2", "enclosed_pockets"
)  # fmt: skip

_BYTES_PER_LINE = 40  # of labels and distances, per row and column
_HINT = "--align finds how the maps lie, --transform takes it from a file"


@dataclass(frozen=True, eq=False, repr=False)
class Score(Result):
    """Quality of a map, on its own or compared with a ground-truth map.

    Parameters
    ----------
    values : dict
        Figures by name, as in ``mapdeal score --json``: numbers or groups of numbers, None where
        there was nothing to measure. ``cells`` are rows and columns.
    bounds : tuple of ScoreBound
        Result for each bound that was given.
    frame : Frame
        Geometry of the cells that were counted: that of the truth, or of the map without a truth.
    maps : tuple of MapInput
        The map, and the truth if there is one.
    transform : tuple of float or None
        x, y (metres) and yaw (radians) of the transform from the map's frame to the frame of the
        truth; None without a truth.
    placement : {'frames', 'transform', 'align'}
        How the maps were placed: by their frames, by a transform, or by aligning them.
    comparison : Comparison or None
        The cells of both maps, and the distances between their walls; None without a truth.
    faults : tuple of Fault
        Faults of the map, the worst first: ghost walls, missing area, faded walls, noise, or a
        bend. Empty without a truth or without walls.
    """

    values: dict[str, Any]
    bounds: tuple[scoring.ScoreBound, ...]
    frame: Frame
    maps: tuple[inputs.MapInput, ...]
    transform: tuple[float, float, float] | None = None
    placement: Placement = "frames"
    comparison: scoring.Comparison | None = None
    faults: tuple[scoring.Fault, ...] = ()

    @property
    def passes(self) -> bool:  # type: ignore[override]
        """Whether all bounds hold; True if there are none."""
        return all(bound.holds for bound in self.bounds)

    @property
    def is_drawn(self) -> bool:
        """Whether there is a picture: walls over those of a truth, coloured by their distance."""
        return self.comparison is not None

    def document(self) -> dict[str, Any]:
        """Return what ``--json`` prints; ``map`` and ``truth`` are None for grids."""
        transform = None
        if self.transform is not None:
            transform = {**transform_document(Transform(*self.transform)), "by": self.placement}
        lattice = {key: getattr(self.frame, key) for key in ("width", "height", "resolution")}
        return {
            "format": SCORE_FORMAT,
            "map": self.maps[0].document(),
            "truth": self.maps[1].document() if len(self.maps) > 1 else None,
            "transform": transform,
            "lattice": {**lattice, "origin": list(self.frame.origin)},
            "verdict": scoring.verdict(self.faults) if self.values.get("known_in_both") else None,
            "faults": scoring.document_of(self.faults),
            "values": self.values,
            "bounds": [{**asdict(bound), "holds": bound.holds} for bound in self.bounds],
            "passes": self.passes,
        }

    def lines(self) -> Iterator[str]:
        frame = self.frame
        size = f"{frame.width} x {frame.height} cells of {frame.resolution:.6g} m"
        yield f"{' against '.join(source.name for source in self.maps)}: {size}"
        if self.transform is not None:
            yield f"  transform  {_transform_text(self.transform, self.placement)}"
            if self.values["known_in_both"]:
                yield from scoring.lines_of(self.faults)
            else:
                yield f"  verdict   none: {scoring.NOTHING_COMPARED}"
            yield from self._distances()
        yield from self._figures()
        for bound in self.bounds:
            yield f"  bound     {self._bound_text(bound)}"

    def drawn(self, *, title: str | None = None, **look: Any) -> Image:
        comparison = self.comparison
        if comparison is None:
            raise ParameterError("of a map on its own has no picture", place="a score")
        frame = comparison.frame
        to_truth = scoring.metres_of(comparison.wall_squares, frame.resolution)
        to_estimate = scoring.metres_of(comparison.missed, frame.resolution)
        walls = ScoredWalls(frame, comparison.estimate, comparison.truth, to_truth, to_estimate)
        named = " on ".join(source.title for source in self.maps)
        title = one_line(title or f"{named}: how far off its walls are")
        return score_image(walls, title=title, **look)

    def _distances(self) -> Iterator[str]:
        name_width = max(len(meaning) for meaning in scoring.DISTANCES.values())
        head = f"  {'distance to the nearest wall':<{name_width}}"
        yield ""
        yield head + "".join(f"{title:>{width}}" for title, _, _, width in _COLUMNS)
        for name, meaning in scoring.DISTANCES.items():
            row = f"  {meaning:<{name_width}}"
            for _, key, unit, width in _COLUMNS:
                row += scoring.figure_text(self.values[name][key], unit).rjust(width)
            yield f"{row}  {name}"
        yield ""

    def _figures(self) -> Iterator[str]:
        figures = scoring.figures_named(with_truth=self.is_drawn)
        order = list(scoring.AGAINST_TRUTH)
        if not self.is_drawn:
            order = [name for name in scoring.ALONE if name not in _AFTER_THICKNESS]
            order += [f"{scoring.THICKNESS}.{key}" for key in ("mean", "median", "p95")]
            order += _AFTER_THICKNESS
        name_width = max(len(figures[name][1]) for name in order)
        for name in order:
            unit, meaning = figures[name]
            value = scoring.figure_text(scoring.figure_in(self.values, name), unit)
            yield f"  {meaning:<{name_width}}  {value:<10}  {name}"

    def _bound_text(self, bound: scoring.ScoreBound) -> str:
        unit = scoring.unit_of(bound.name, with_truth=self.is_drawn)
        text = f"--{bound.side} {bound.name}={bound.allowed:g}{unit}: "
        text += "holds" if bound.holds else "missed"
        if bound.found is None:
            return f"{text}, not measured: {scoring.why_missing(bound.name, self.values)}"
        # 9 digits: a figure that is shown as the bound itself is within it
        return f"{text}, found {bound.found:.9g}{unit}"

    def _repr_parts(self) -> Iterator[str]:
        if self.transform is None:
            yield f"{self.values['corners']} corners"
            yield f"{self.values['enclosed_areas']} enclosed areas"
            yield f"{self.values['specks']} small components"
        else:
            mean, coverage = self.values["dist_est_to_truth_m"]["mean"], self.values["coverage"]
            yield "no walls to measure" if mean is None else f"walls {mean:.4g} m off in the mean"
            yield "" if coverage is None else f"{100 * coverage:.4g} % covered"
        if self.bounds:
            yield "within the bounds" if self.passes else "beyond the bounds"


def _transform_text(pose: tuple[float, float, float], placement: Placement) -> str:
    if placement == "frames":
        return "none: both maps are taken to be in one frame"
    x, y, yaw = pose
    origin = "found by align" if placement == "align" else "as given"
    return f"x {x:.6g} m, y {y:.6g} m, yaw {math.degrees(yaw):.6g} deg, {origin}"


def _bounds(texts: Iterable[str]) -> dict[str, float]:
    bounds: dict[str, float] = {}
    for text in texts:
        name, _, value = (word.strip() for word in text.partition("="))
        if name in bounds:
            raise ParameterError(f"{name} is given twice")
        try:
            bounds[name] = float(value if name and is_plain(value) else "")
        except ValueError:
            raise ParameterError("must be NAME=VALUE, with a number", got=text) from None
    return bounds


@command(
    group="Two maps of one place",
    texts={"image": "Write a picture of the distances between walls."},
    example="""\
mapdeal score examples/maps/office_cartographer.yaml \\
    --truth examples/maps/office.yaml --align --min coverage=0.9""",
)
def score(
    map: inputs.Map,  # noqa: A002 - what it is
    truth: Annotated[inputs.Map | None, Words("MAP", name="truth")] = None,
    *,
    align: bool = False,
    transform: Annotated[two_maps.TransformLike, Words("FILE.json", Path)] = None,
    minimum: Annotated[Bounds, Words("NAME=VALUE", _bounds, "min", is_repeated=True)] = None,
    maximum: Annotated[Bounds, Words("NAME=VALUE", _bounds, "max", is_repeated=True)] = None,
    **reading: Unpack[inputs.Reading],
) -> Score:
    """Score a map, on its own or against a true map.

    With --truth: the distances between its walls and the true ones, the share of the known area
    that it covers, the agreement of cells. Without: shares of cells, thickness of walls, corners,
    enclosed areas. Exit code 1 if a bound is missed.

    Parameters
    ----------
    map : path, str or grid
        A map_server .yaml, a .pbm with its .yaml, or an .npz written by mapdeal. In Python, a grid
        serves as well. Fields and costs are scored as the maps that ROS would publish.
    truth : path, str or grid, optional
        True map to compare with.
    align : bool
        Align the map with the true one first.
    transform : path, str, Transform or sequence of float, optional
        Or apply a transform from its frame to that of the true map, as align writes it. In Python
        x, y (metres) and yaw (radians) serve as well. By default the maps are in one frame.
    minimum : mapping of str to float, optional
        Pass if a figure is at least this value, such as coverage=0.9; can be repeated. In Python
        values by name; dots lead into groups: ``{"dist_est_to_truth_m.mean": 0.1}``.
    maximum : mapping of str to float, optional
        Pass if a figure is at most this value, dist_est_to_truth_m.mean=0.1 for instance.
    **reading
        As for `read_map`; dialect, max_cells and max_memory apply to files.

    Returns
    -------
    Score
        Score on the lattice of the truth; the map is sampled at the centres of its cells. 100
        counts as occupied, 0 as free, everything else as unknown.

    Raises
    ------
    FileAccessError, MalformedInputError
        If a file cannot be read.
    FindingError
        If `align` is true and the maps may not show the same place.
    ParameterError
        If a bound names no figure, or an argument requires a truth.

    Warns
    -----
    MapdealWarning
        If a choice had to be made while reading a file, or the figures mean little because
        nothing overlaps or there are no walls.

    Notes
    -----
    With a truth, over all cells of its lattice:

    - ``ssim_uniform7`` and ``ssim_gauss``: structural similarity as in scikit-image, with its
      defaults and with the weights of Wang et al. (2004); unknown cells are grey.
    - ``dist_est_to_truth_m``, ``dist_truth_to_est_m``: distances between the centres of occupied
      cells, metres; a second set counts only cells that the other map knows.
    - ``iou_``..., ``precision_``..., ``recall_``..., ``mcc_``... and ``confusion_``...: agreement
      of cells; ``coverage``: share of the cells known in the truth that are known in both.

    The verdict names the fault that exceeds its limit most: ghost walls (5 % of the map's walls in
    free space of the truth), missing area (5 % of its known cells unknown), faded walls (10 % of
    its walls that the map should show but does not), noise (3 % of the walls in components of
    fewer than 5 cells in its free space), and a bend (0.1 m or two cells).

    Without a truth: figures after Filatov et al., "2D SLAM quality evaluation methods" (2017).

    Examples
    --------
    >>> from mapdeal import OccupancyGrid
    >>> truth = OccupancyGrid([[100, 0, 0, 100], [100, 0, 0, 100]], 0.5)
    >>> found = score(OccupancyGrid([[0, 100, 0, 100], [-1, 100, 0, 100]], 0.5), truth)
    >>> found
    Score(walls 0.25 m off in the mean, 87.5 % covered)
    >>> found.values["confusion_known_in_both"]
    {'tp': 2, 'tn': 2, 'fp': 2, 'fn': 1}
    """
    if align and transform is not None:
        raise ParameterError("cannot be given together with a transform", place="align")
    if truth is None:
        work, rule = inputs.Work.current.get(), "needs --truth, a map to compare with"
        image = {} if work is None else {"--image": work.settings.image}
        inputs.refuse(rule, align=align, transform=transform, **image)
    limits = scoring.checked_bounds(minimum or {}, maximum or {}, with_truth=truth is not None)
    known, files = two_maps.given_transform(transform, place="transform")
    named = {"the map": map} if truth is None else {"the map": map, "the truth": truth}
    maps = inputs.open_inputs(*named.values(), names=list(named), also=files, **reading)
    _claim(maps, aligns=align)
    estimate, *truths = (source.occupancy for source in maps)
    with inputs.errors_named(maps[0].name):
        for source in maps:
            between = int(histogram(source.occupancy.occupancy)[FREE + 1 : OCCUPIED].sum())
            if between:
                cells = f"{count_text(between, 'cell')} of 1..99 count{'s' * (between == 1)}"
                emit_warning(f"{source.name}: {cells} as unknown")
        if not truths:
            values = scoring.score_alone(scoring.states_of(estimate.occupancy), estimate.frame)
            if not values["wall_cells"]:
                emit_warning(f"{maps[0].name}: has no occupied cells")
            return Score(values, scoring.judged(limits, values), estimate.frame, tuple(maps))
        placement: Placement = "align" if align else "frames" if known is None else "transform"
        move = Transform()
        if known is not None:
            move = two_maps.transform_in(known, files, maps)
        elif align:
            move = two_maps.aligned(maps, hint="--transform uses a transform as it is")
        else:
            two_maps.warn_of_frames(maps, "--align places the map by its walls")
        comparison = scoring.compare_to_truth(estimate, truths[0], move)
        _warn_of_overlap(comparison, maps)
    values, frame = comparison.values, comparison.frame
    faults = scoring.faults_of(comparison.estimate, comparison.truth, frame)
    judged = scoring.judged(limits, values)
    return Score(values, judged, frame, tuple(maps), move.pose, placement, comparison, faults)


def _claim(maps: Sequence[inputs.MapInput], *, aligns: bool) -> None:
    grids = [source.occupancy for source in maps]
    shape = grids[-1].shape
    walls = sum(int(histogram(grid.occupancy)[OCCUPIED]) for grid in grids)
    needed = scoring.bytes_alone(shape, walls)
    of_picture = 0
    if len(grids) > 1:
        needed = scoring.bytes_to_compare(shape, walls)
        of_picture = scoring.bytes_to_compare(shape, walls, is_drawn=True)
    lines = bytes_of_lines(shape, _BYTES_PER_LINE)
    needed = max(needed + lines, two_maps.bytes_to_place(maps) if aligns else 0)
    inputs.claim_for(maps, needed, f"{shape[1]} x {shape[0]} cells", of_picture=of_picture + lines)


def _warn_of_overlap(comparison: scoring.Comparison, maps: Sequence[inputs.MapInput]) -> None:
    name, true_name = (source.name for source in maps)
    if not (comparison.truth != scoring.UNKNOWN).any():
        emit_warning(f"{true_name}: has no known cell, so there is nothing to compare with")
    elif not (comparison.estimate != scoring.UNKNOWN).any():
        emit_warning(f"{name}: has no known cell on {true_name}; {_HINT}")
    elif not comparison.values["known_in_both"]:
        emit_warning(f"{name}: has no known cell in common with {true_name}; {_HINT}")
    else:
        for file, squares in ((name, comparison.wall_squares), (true_name, comparison.missed)):
            if not len(squares):
                emit_warning(f"{file}: has no occupied cell there, so no distances can be measured")
    cell, true_cell = maps[0].occupancy.resolution, comparison.frame.resolution
    if not np.isclose(cell, true_cell, rtol=1e-6, atol=0):
        sizes = f"{name}: has cells of {cell:g} m, {true_name} of {true_cell:g} m"
        emit_warning(f"{sizes}; the map is sampled at the centres of the true map's cells")
