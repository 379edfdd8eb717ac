"""How good a map is, on its own or against a true one."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field
from os import PathLike
from pathlib import Path
from typing import Any

from mapdeal.api.maps import Map, occupancy_of, transform_of
from mapdeal.errors import ParameterError, one_line
from mapdeal.formats.map_yaml import Dialect
from mapdeal.grid.display import Drawn
from mapdeal.grid.frame import Frame
from mapdeal.grid.transform import Transform
from mapdeal.pipeline.score import Asked, ScoreReport, score_files, score_grids, title_of, walls_of
from mapdeal.pipeline.settings import Settings
from mapdeal.records import dataclass
from mapdeal.render.pen import Image
from mapdeal.render.score import score_image
from mapdeal.scoring.bounds import ScoreBound
from mapdeal.scoring.compare import Comparison


@dataclass(frozen=True, eq=False, repr=False)
class Score(Drawn):
    """How good a map is, on its own or against a true one.

    Parameters
    ----------
    values : dict
        The figures by name, those of ``mapdeal score --json``: numbers, groups of them, None
        where there was nothing to measure. ``cells`` are rows and columns.
    passes : bool
        Whether all bounds hold; True without any.
    bounds : tuple of ScoreBound
        Each bound that was given, what was found, and whether it holds.
    frame : Frame
        The cells that were counted: those of the truth; without one the map's.
    transform : tuple of float or None
        x, y (metres) and yaw (radians) of the transform from the map's frame to that of the
        truth; None without one.

    Notes
    -----
    With a truth notebooks show its picture, and `draw_picture` draws it: the walls of the map
    over the truth, coloured by how far off they are.
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
        """Return the score as JSON can hold it, as ``mapdeal score --json`` prints it.

        Its `map` and `truth`, the files and their checksums, are None unless they are files.
        """
        return copy.deepcopy(self._document)

    def drawn(self, *, title: str | None = None, **look: Any) -> Image:
        """Return the picture, as `draw_picture` gives it, with what shapes it.

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
        """Whether it has a picture: with a truth."""
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
    """Score a map, on its own or against a true one.

    Parameters
    ----------
    map : path, str or grid
        The map: a ``.yaml``, ``.pbm`` or ``.npz`` file as of `read_map`, or a grid. Of fields
        and costs the map that ROS would have is scored.
    truth : path, str or grid, optional
        The true one.
    align : bool
        Whether to find how the map lies on the true one, and to bring it there.
    transform : path, str, Transform or sequence of float, optional
        Or the transform from the map's frame to that of the truth: a file as ``mapdeal align``
        writes it, or x, y (metres) and yaw (radians). The frames are taken for the same if
        neither is given.
    minimum, maximum : mapping of str to float, optional
        What figures must be, at least or at most, for it to pass, by their names; with dots into
        groups: ``{"dist_est_to_truth_m.mean": 0.1}``.
    dialect, max_cells, max_memory
        As of `read_map`, for files.

    Returns
    -------
    Score
        Cells are those of the truth's lattice; of the map the cell at their centre counts. 100
        is occupied, 0 free, everything else unknown.

    Raises
    ------
    FileAccessError, MalformedInputError
        If a file cannot be read.
    FindingError
        If the maps are to be aligned, and may not show one place.
    ParameterError
        If there is no figure of a bound's name, or something needs a truth.

    Warns
    -----
    MapdealWarning
        Of what reading a file had to choose, and where figures say little: without overlap,
        without walls.

    Notes
    -----
    Against a truth, over all cells of its lattice:

    - ``ssim_uniform7`` and ``ssim_gauss``: structural similarity, as of scikit-image with its
      defaults and with the weights of Wang et al. (2004); unknown is grey.
    - ``dist_est_to_truth_m``, ``dist_truth_to_est_m``: distances between the centres of occupied
      cells, metres; once more only from cells that the other map knows.
    - ``iou_``..., ``precision_``..., ``recall_``..., ``mcc_``... and ``confusion_``...: how cells
      agree; ``coverage``: known in both, of those known in the truth.

    Without one: shares, walls, specks, thickness of walls, corners and enclosed areas, after
    Filatov et al., "2D SLAM quality evaluation methods" (2017).

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
