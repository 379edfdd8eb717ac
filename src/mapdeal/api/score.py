"""How good a map is, on its own or against a true one."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any

from mapdeal.api.maps import Map, occupancy_of, transform_of
from mapdeal.commands.score import Asked, ScoreReport, score_files, score_grids, title_of, walls_of
from mapdeal.compare.bounds import ScoreBound
from mapdeal.compare.score import Comparison
from mapdeal.errors import ParameterError, one_line
from mapdeal.grid.display import Drawn
from mapdeal.grid.frame import Frame, Transform
from mapdeal.maps.map_yaml import Dialect
from mapdeal.pictures.canvas import Image
from mapdeal.pictures.comparisons import score_image
from mapdeal.pipeline.settings import Settings


@dataclass(frozen=True, eq=False, repr=False)
class Score(Drawn):
    """Quality of a map, on its own or compared with a ground-truth map.

    Parameters
    ----------
    values : dict
        Figures by name, as in ``mapdeal score --json``: numbers or groups of numbers, None where
        there was nothing to measure. ``cells`` are rows and columns.
    passes : bool
        Whether all bounds hold; True if there are none.
    bounds : tuple of ScoreBound
        Result for each bound that was given.
    frame : Frame
        Geometry of the cells that were counted: that of the truth, or of the map without a truth.
    transform : tuple of float or None
        x, y (metres) and yaw (radians) of the transform from the map's frame to the frame of the
        truth; None without a truth.

    Notes
    -----
    A score with a truth is shown as a picture in notebooks and can be drawn with `draw_picture`:
    the walls of the map over the truth, coloured by their distance from it.
    """

    values: dict[str, Any]
    passes: bool
    bounds: tuple[ScoreBound, ...]
    frame: Frame
    transform: tuple[float, float, float] | None
    _document: dict[str, Any] = field(default_factory=dict)
    _comparison: Comparison | None = None
    _title: str = "how far off its walls are"

    def document(self) -> dict[str, Any]:
        """Return the score as the JSON-serialisable dict that ``mapdeal score --json`` prints.

        The entries ``map`` and ``truth``, paths with checksums, are None unless the maps were
        given as files.
        """
        return copy.deepcopy(self._document)

    def drawn(self, *, title: str | None = None, **look: Any) -> Image:
        """Return the picture that `draw_picture` draws, with its options.

        Raises
        ------
        ParameterError
            If there is no truth.
        """
        if self._comparison is None:
            raise ParameterError("of a map on its own has no picture", place="a score")
        return score_image(walls_of(self._comparison), title=one_line(title or self._title), **look)

    @property
    def is_drawn(self) -> bool:
        """Whether there is a picture, which requires a truth."""
        return self._comparison is not None

    def _told(self) -> Iterator[str]:
        if self.transform is None:
            yield f"{self.values['corners']} corners"
            yield f"{self.values['enclosed_areas']} enclosed areas"
            yield f"{self.values['specks']} small components"
        else:
            mean = self.values["dist_est_to_truth_m"]["mean"]
            yield "no walls to measure" if mean is None else f"walls {mean:.4g} m off in the mean"
            coverage = self.values["coverage"]
            yield "" if coverage is None else f"{100 * coverage:.4g} % covered"
        if self.bounds:
            yield "within the bounds" if self.passes else "beyond the bounds"


def score(
    map: Map,  # noqa: A002 - what it is
    truth: Map | None = None,
    *,
    align: bool = False,
    transform: str | PathLike[str] | Transform | Sequence[float] | None = None,
    minimum: Mapping[str, float] | None = None,
    maximum: Mapping[str, float] | None = None,
    dialect: Dialect = "nav2",
    max_cells: int | None = None,
    max_memory: int | None = None,
) -> Score:
    """Score a map, on its own or against a ground-truth map.

    Parameters
    ----------
    map : path, str or grid
        Map to score: a ``.yaml``, ``.pbm`` or ``.npz`` file, as for `read_map`, or a grid. Fields
        and costs are scored as the maps that ROS would publish.
    truth : path, str or grid, optional
        Ground-truth map.
    align : bool
        Whether to align the map with the truth first.
    transform : path, str, Transform or sequence of float, optional
        Transform from the map's frame to the frame of the truth: a file written by ``mapdeal
        align``, or x, y (metres) and yaw (radians). With neither `align` nor `transform`, both
        maps are assumed to share one frame.
    minimum, maximum : mapping of str to float, optional
        Lower and upper bounds that figures must keep for the score to pass, by name; dots lead
        into groups: ``{"dist_est_to_truth_m.mean": 0.1}``.
    dialect, max_cells, max_memory
        As for `read_map`; they apply to files.

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

    Without a truth: shares, walls, small components, wall thickness, corners and enclosed areas,
    after Filatov et al., "2D SLAM quality evaluation methods" (2017).

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
    is_file = isinstance(transform, str | PathLike)
    asked = Asked(
        dict(minimum or {}),
        dict(maximum or {}),
        None if is_file else transform_of(transform, place="transform", or_file=True),
        Path(transform) if isinstance(transform, str | PathLike) else None,
        align,
    )
    settings = Settings(dialect=dialect, max_cells=max_cells, max_memory=max_memory)
    named = [one for one in (map, truth) if one is not None]
    paths = [Path(one) for one in named if isinstance(one, str | PathLike)]
    if len(paths) == len(named):
        other = (*paths[1:], None)[0]
        return _scored(score_files(paths[0], other, settings, asked), title_of(paths[0], other))
    asked.bounds(with_truth=truth is not None)
    grids = [occupancy_of(one, settings, place="score", name="the map") for one in named]
    return _scored(score_grids(grids[0], (*grids[1:], None)[0], asked.with_file_read()))


def _scored(report: ScoreReport, title: str = "how far off its walls are") -> Score:
    return Score(
        values=report.values,
        passes=report.passes,
        bounds=report.bounds,
        frame=report.frame,
        transform=None if report.transform is None else report.transform.pose,
        _document=report.document(),
        _comparison=report.comparison,
        _title=title,
    )
