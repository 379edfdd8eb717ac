"""Where one map lies in the frame of another."""

from __future__ import annotations

from collections.abc import Sequence

from mapdeal.api.maps import Map, occupancy_of, transform_of
from mapdeal.compare.align import Alignment
from mapdeal.compare.align import align as align_grids
from mapdeal.grid.frame import Transform
from mapdeal.maps.map_yaml import Dialect
from mapdeal.pipeline.settings import Settings


def align(
    first: Map,
    second: Map,
    *,
    prior: Transform | Sequence[float] | None = None,
    rotations: Sequence[float] | None = None,
    dialect: Dialect = "nav2",
    max_cells: int | None = None,
    max_memory: int | None = None,
) -> Alignment:
    """Find where a map lies in the frame of another map of the same place.

    Parameters
    ----------
    first, second : path, str or grid
        Maps A and B: ``.yaml``, ``.pbm`` or ``.npz`` files, as for `read_map`, or grids. They may
        differ in size, resolution, origin, yaw and the part of the place that they cover.
    prior : Transform or sequence of float, optional
        Approximate transform, or its x, y (metres) and yaw (radians). The search covers 30
        degrees and 5 m (for large maps a tenth of the diagonal) around it.
    rotations : sequence of float, optional
        Rotations to search, radians; each with a tolerance of 3 degrees. By default all are
        searched.
    dialect, max_cells, max_memory
        As for `read_map`; they apply to files.

    Returns
    -------
    Alignment
        Best alignment found, whether or not it is certain; see `Alignment.same_place`.

    Raises
    ------
    FileAccessError, MalformedInputError
        If a file cannot be read.
    ParameterError
        If a number is not finite, or `rotations` is empty.

    Notes
    -----
    Candidates are the peaks of correlations (by FFT) over all shifts: at the rotations that make
    the walls parallel and, on coarser cells, at rotations all around. Each candidate is refined by
    minimising the distances between walls. All are then judged by their wall faces: a face agrees
    if it lies on a wall of the other map with free space on the same side, and contradicts if it
    lies in the other map's free space. The score measures how much more agrees than at wrong
    alignments: it is the Kullback-Leibler divergence of the two shares for each 2 m of wall (less
    in small maps). An alignment is certain if its score is at least 3, the maps overlap by a
    tenth, and no other alignment reaches 0.75 of its score, or 0.35 where walls agree as well.

    References
    ----------
    S. Carpin, "Fast and accurate map merging for multi-robot systems", Autonomous Robots 25,
    2008, for rotations from wall directions.

    Examples
    --------
    >>> import numpy as np
    >>> from mapdeal import OccupancyGrid
    >>> walls = np.zeros((40, 60), dtype=np.int8)
    >>> walls[[0, -1]] = walls[:, [0, -1]] = walls[12, :35] = walls[12:30, 22] = 100
    >>> room = OccupancyGrid(walls, 0.1, (1.0, 2.0, 0.0))
    >>> found = align(room, OccupancyGrid(walls[::-1, ::-1], 0.1))
    >>> found.same_place, round(abs(found.transform.yaw), 3)
    (True, 3.142)
    """
    about = transform_of(prior, place="prior")
    settings = Settings(dialect=dialect, max_cells=max_cells, max_memory=max_memory)
    grids = [
        occupancy_of(one, settings, place="align", name=f"map {name}")
        for one, name in ((first, "A"), (second, "B"))
    ]
    return align_grids(*grids, prior=about, rotations=rotations)
