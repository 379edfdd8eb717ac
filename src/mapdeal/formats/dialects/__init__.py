"""How the three map_server readers in use turn pixels into occupancy, one module each.

Every rule depends on a small integer only, a grey level or a sum of samples; so each module
fills a table in exactly the precision of its reader, and indexes it.

References
----------
Read off and checked against the readers of ROS 1 (``map_server/image_loader.cpp``), of Nav2
humble and of Nav2 jazzy and later (``nav2_map_server/map_io.cpp`` with GraphicsMagick).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from mapdeal.formats.dialects import humble, nav2, ros1
from mapdeal.formats.map_yaml import Dialect, MapMetadata
from mapdeal.formats.picture import Picture

Reader = Callable[[Picture, MapMetadata], NDArray[np.int8]]

DIALECTS: dict[Dialect, Reader] = {
    "nav2": nav2.occupancy_of,
    "humble": humble.occupancy_of,
    "ros1": ros1.occupancy_of,
}
