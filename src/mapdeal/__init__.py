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

from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from mapdeal.version import __version__ as __version__


@cache
def _homes() -> dict[str, str]:
    """Return the module of each public name, from the imports of the stub beside this file."""
    import ast  # costs as much as a small command's own modules

    homes: dict[str, str] = {}
    for node in ast.parse(Path(__file__).with_suffix(".pyi").read_text("utf-8")).body:
        if isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                names = [alias.name]
                if alias.name == "*":
                    public = vars(import_module(node.module))
                    names = [name for name in public if not name.startswith("_")]
                homes |= dict.fromkeys(names, node.module)
    return homes


def __getattr__(name: str) -> Any:
    if name == "__all__":
        return sorted(_homes())
    if name.startswith("__") or name not in _homes():
        raise AttributeError(f"module 'mapdeal' has no attribute {name!r}")
    value = getattr(import_module(_homes()[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(_homes())
