"""mapdeal: batch processing of robot map files without ROS.

Read and write: `read_map`, `write_map`, `read_bit_map`, `write_bit_map`, `read_shapes`,
`read_cloud`, `read_poses`.
Grids: `OccupancyGrid`, `Costmap`, `DistanceField`, `PotentialField`, `BitMap`, each with its
`Frame`.
Stages: `active_region`, `inflate`, `esdf`, `field_view`, `exponential_cost`, `threshold_cost`,
`ring_cost`, `potential`; a robot's `Footprint`; `apply_keepout_mask`.
Maps from sensors: `local_map`, and `LocalMapper` with `LocalOptions` for clouds that come in
parts, which gives a `LocalMap`; `build_map` of laser scans, which gives a `BuiltMap`, and
`MapBuilder` with `BeamLimits` for `Scans` that come in parts.
Questions: `DistanceField.query`, which gives `FieldSamples`; `shortest_route` and `descend`, which
give a `Route`.
Changes: `draw` with `Polygon`, `Line`, `Circle`; `blank`, `window`, `shift_origin`,
`reset_region`.

Everything public is loaded on first use, so that ``import mapdeal`` costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from mapdeal.version import __version__

if TYPE_CHECKING:
    from mapdeal.editing.draw import draw
    from mapdeal.editing.window import blank, reset_region, shift_origin, window
    from mapdeal.errors import (
        FileAccessError,
        FindingError,
        MalformedInputError,
        MapdealError,
        MapdealWarning,
        ParameterError,
    )
    from mapdeal.formats.bit_maps import read_bit_map, write_bit_map
    from mapdeal.formats.clouds.reader import read_cloud
    from mapdeal.formats.maps import read_map, write_map
    from mapdeal.formats.poses import read_poses
    from mapdeal.formats.shapes import read_shapes
    from mapdeal.grid.bit_map import BitMap
    from mapdeal.grid.costmap import Costmap
    from mapdeal.grid.field import DistanceField, FieldSamples
    from mapdeal.grid.footprint import Footprint
    from mapdeal.grid.frame import Frame, xy_ahead
    from mapdeal.grid.occupancy import OccupancyGrid
    from mapdeal.grid.potential import PotentialField
    from mapdeal.grid.route import Route
    from mapdeal.grid.shapes import Circle, Line, Polygon
    from mapdeal.mapping.beams import BeamLimits, Scans
    from mapdeal.mapping.build import BuiltMap, MapBuilder, build_map
    from mapdeal.mapping.local_map import LocalMap, LocalMapper, LocalOptions, local_map
    from mapdeal.planning.astar import shortest_route
    from mapdeal.planning.descent import descend
    from mapdeal.stages.active import active_region
    from mapdeal.stages.esdf import esdf, field_view
    from mapdeal.stages.exponential_cost import exponential_cost
    from mapdeal.stages.inflate import inflate
    from mapdeal.stages.keepout import apply_keepout_mask
    from mapdeal.stages.potential import potential
    from mapdeal.stages.ring_cost import ring_cost
    from mapdeal.stages.threshold_cost import threshold_cost

_HOMES = {
    "BeamLimits": "mapdeal.mapping.beams",
    "BitMap": "mapdeal.grid.bit_map",
    "BuiltMap": "mapdeal.mapping.build",
    "Circle": "mapdeal.grid.shapes",
    "Costmap": "mapdeal.grid.costmap",
    "DistanceField": "mapdeal.grid.field",
    "FieldSamples": "mapdeal.grid.field",
    "FileAccessError": "mapdeal.errors",
    "FindingError": "mapdeal.errors",
    "Footprint": "mapdeal.grid.footprint",
    "Frame": "mapdeal.grid.frame",
    "Line": "mapdeal.grid.shapes",
    "LocalMap": "mapdeal.mapping.local_map",
    "LocalMapper": "mapdeal.mapping.local_map",
    "LocalOptions": "mapdeal.mapping.local_map",
    "MalformedInputError": "mapdeal.errors",
    "MapBuilder": "mapdeal.mapping.build",
    "MapdealError": "mapdeal.errors",
    "MapdealWarning": "mapdeal.errors",
    "OccupancyGrid": "mapdeal.grid.occupancy",
    "ParameterError": "mapdeal.errors",
    "Polygon": "mapdeal.grid.shapes",
    "PotentialField": "mapdeal.grid.potential",
    "Route": "mapdeal.grid.route",
    "Scans": "mapdeal.mapping.beams",
    "active_region": "mapdeal.stages.active",
    "apply_keepout_mask": "mapdeal.stages.keepout",
    "blank": "mapdeal.editing.window",
    "build_map": "mapdeal.mapping.build",
    "descend": "mapdeal.planning.descent",
    "draw": "mapdeal.editing.draw",
    "esdf": "mapdeal.stages.esdf",
    "exponential_cost": "mapdeal.stages.exponential_cost",
    "field_view": "mapdeal.stages.esdf",
    "inflate": "mapdeal.stages.inflate",
    "local_map": "mapdeal.mapping.local_map",
    "potential": "mapdeal.stages.potential",
    "read_bit_map": "mapdeal.formats.bit_maps",
    "read_cloud": "mapdeal.formats.clouds.reader",
    "read_map": "mapdeal.formats.maps",
    "read_poses": "mapdeal.formats.poses",
    "read_shapes": "mapdeal.formats.shapes",
    "reset_region": "mapdeal.editing.window",
    "ring_cost": "mapdeal.stages.ring_cost",
    "shift_origin": "mapdeal.editing.window",
    "shortest_route": "mapdeal.planning.astar",
    "threshold_cost": "mapdeal.stages.threshold_cost",
    "window": "mapdeal.editing.window",
    "write_bit_map": "mapdeal.formats.bit_maps",
    "write_map": "mapdeal.formats.maps",
    "xy_ahead": "mapdeal.grid.frame",
}

__all__ = [
    "BeamLimits",
    "BitMap",
    "BuiltMap",
    "Circle",
    "Costmap",
    "DistanceField",
    "FieldSamples",
    "FileAccessError",
    "FindingError",
    "Footprint",
    "Frame",
    "Line",
    "LocalMap",
    "LocalMapper",
    "LocalOptions",
    "MalformedInputError",
    "MapBuilder",
    "MapdealError",
    "MapdealWarning",
    "OccupancyGrid",
    "ParameterError",
    "Polygon",
    "PotentialField",
    "Route",
    "Scans",
    "__version__",
    "active_region",
    "apply_keepout_mask",
    "blank",
    "build_map",
    "descend",
    "draw",
    "esdf",
    "exponential_cost",
    "field_view",
    "inflate",
    "local_map",
    "potential",
    "read_bit_map",
    "read_cloud",
    "read_map",
    "read_poses",
    "read_shapes",
    "reset_region",
    "ring_cost",
    "shift_origin",
    "shortest_route",
    "threshold_cost",
    "window",
    "write_bit_map",
    "write_map",
    "xy_ahead",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'mapdeal' has no attribute {name!r}")
    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
