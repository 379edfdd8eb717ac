"""Where one map lies in the frame of another."""

from __future__ import annotations

from collections.abc import Sequence

from mapdeal.alignment.align import Alignment
from mapdeal.alignment.align import align as align_grids
from mapdeal.api.maps import Map, occupancy_of, transform_of
from mapdeal.formats.map_yaml import Dialect
from mapdeal.grid.transform import Transform
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
        A and B: ``.yaml``, ``.pbm`` or ``.npz`` files as of `read_map`, or grids. Size,
        resolution, origin and yaw may differ, and what they show of the place.
    prior : Transform or sequence of float, optional
        About what the transform is, or its x, y (metres) and yaw (radians): places within 30
        degrees and 5 m (of large maps a tenth of the diagonal) of it are looked at.
    rotations : sequence of float, optional
        The only turns to look at, radians; 3 degrees either way are left for what the maps are
        off.
    dialect, max_cells, max_memory
        As of `read_map`, for files.

    Returns
    -------
    Alignment
        The best place, sure or not: `Alignment.same_place` says which.

    Raises
    ------
    FileAccessError, MalformedInputError
        If a file cannot be read.
    ParameterError
        If a number is not finite, or there are no rotations in the list.

    Notes
    -----
    Candidates are the peaks of correlations (by FFT) over all shifts: at the turns where the
    walls run in the same directions, and, on coarser cells, all around. Each is moved to where
    walls lie nearest to walls. All are then judged by the faces of walls: one agrees if it lies
    on a wall of the other map with free space on the same side, and contradicts if it lies in
    the other map's free space. The score says how much more agrees than at wrong places: it is
    the divergence (Kullback and Leibler) of the two shares, for each 2 m of wall, in small maps
    for less. A place is sure if its score is at least 3, the maps overlap by a tenth, and no
    place elsewhere has 0.75 of its score, or 0.35 where walls agree as well as there.

    References
    ----------
    S. Carpin, "Fast and accurate map merging for multi-robot systems", Autonomous Robots 25,
    2008, for turns by the directions of walls.

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
