"""mapdeal: batch processing of robot map files without ROS.

Everything public is loaded on first use, so that ``import mapdeal`` costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from mapdeal.version import __version__

if TYPE_CHECKING:
    from mapdeal.errors import (
        FileAccessError,
        MalformedInputError,
        MapdealError,
        MapdealWarning,
        ParameterError,
    )
    from mapdeal.formats.maps import read_map, write_map
    from mapdeal.grid.costmap import Costmap
    from mapdeal.grid.field import DistanceField
    from mapdeal.grid.footprint import Footprint
    from mapdeal.grid.frame import Frame
    from mapdeal.grid.occupancy import OccupancyGrid
    from mapdeal.stages.active import active_region
    from mapdeal.stages.esdf import esdf, field_view
    from mapdeal.stages.exponential_cost import exponential_cost
    from mapdeal.stages.inflate import inflate
    from mapdeal.stages.ring_cost import ring_cost
    from mapdeal.stages.threshold_cost import threshold_cost

_HOMES = {
    "Costmap": "mapdeal.grid.costmap",
    "DistanceField": "mapdeal.grid.field",
    "FileAccessError": "mapdeal.errors",
    "Footprint": "mapdeal.grid.footprint",
    "Frame": "mapdeal.grid.frame",
    "MalformedInputError": "mapdeal.errors",
    "MapdealError": "mapdeal.errors",
    "MapdealWarning": "mapdeal.errors",
    "OccupancyGrid": "mapdeal.grid.occupancy",
    "ParameterError": "mapdeal.errors",
    "active_region": "mapdeal.stages.active",
    "esdf": "mapdeal.stages.esdf",
    "exponential_cost": "mapdeal.stages.exponential_cost",
    "field_view": "mapdeal.stages.esdf",
    "inflate": "mapdeal.stages.inflate",
    "read_map": "mapdeal.formats.maps",
    "ring_cost": "mapdeal.stages.ring_cost",
    "threshold_cost": "mapdeal.stages.threshold_cost",
    "write_map": "mapdeal.formats.maps",
}

__all__ = [
    "Costmap",
    "DistanceField",
    "FileAccessError",
    "Footprint",
    "Frame",
    "MalformedInputError",
    "MapdealError",
    "MapdealWarning",
    "OccupancyGrid",
    "ParameterError",
    "__version__",
    "active_region",
    "esdf",
    "exponential_cost",
    "field_view",
    "inflate",
    "read_map",
    "ring_cost",
    "threshold_cost",
    "write_map",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'mapdeal' has no attribute {name!r}")
    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
