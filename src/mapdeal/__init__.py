"""mapdeal: batch processing of robot map files without ROS.

Files: `read_map`, `write_map`, `read_bit_map`, `write_bit_map`, `read_shapes`, `read_cloud`,
`read_poses`, `read_map_from_bag`.
Grids: `OccupancyGrid`, `Costmap`, `DistanceField`, `PotentialField` and `Reach` (together: `Grid`)
and `BitMap`, each with a `Frame`; `FieldView` with a `ViewScale`.
Stages: `active_region`, `inflate`, `esdf`, `field_view`, `exponential_cost`, `threshold_cost`,
`ring_cost`, `layered_cost` with `StaticLayer` and `InflationLayer`, `potential`, `reach`; also
`apply_keepout_mask`.
Robots: `Footprint`; `read_robot_parameters` reads `RobotParameters` from a robot's own files.
Maps from sensors: `local_map`, and for clouds that arrive in parts `LocalMapper` with
`LocalOptions`, return a `LocalMap`; `RollingMapper` processes sequences. `build_map`,
`build_map_from_log` and `build_map_from_bag` return a `BuiltMap` from laser scans; `MapBuilder`
with `BeamLimits` accepts `Scans` in parts.
Queries: `DistanceField.query` returns `FieldSamples`; `footprint_costs` returns a robot's costs at
poses; `cost_curve` returns a `CostCurve`; `shortest_route` and `descend` return a `Route`, `route`
a `PlannedRoute`. A `Reach` contains a `GoalReach` with a
`Bottleneck` for each `Goal`, and every `Passage`.
Counterparts of the commands: `run` returns a `RunReport`; `load_recipe` returns a `Recipe`, and
`apply_recipe` applies it to grids in memory; `lint` returns a `LintReport` of `Finding`, with a
`MapReport` for each map; `diff` returns a `DiffReport` with `WallShift` and `Bound`; `score`
returns a `Score` with `ScoreBound`; `info` returns a dict; `write_report` returns a
`WrittenReport`.
Pictures: `draw_picture` returns a `Picture`; `write_picture`. Notebooks display grids and reports
as pictures.
Editing: `draw` with `Polygon`, `Line`, `Circle`; `blank`, `window`, `shift_origin`,
`reset_region`; `rotate`, `straighten` with `yaw_to_straighten`, `rescale`; `clean` returns a
`Cleaned`; `xy_ahead` of a pose.
Several maps of one place: `align` returns an `Alignment`; `merge` returns a `Merged` with
`MapCounts` for each map; a `Transform` relates the frames of two maps.
Errors: `MapdealError` and its subclasses `ParameterError`, `MalformedInputError`,
`FileAccessError` and `FindingError`; `MapdealWarning`.

All public names are loaded on first use, so that ``import mapdeal`` costs nothing.
"""

from __future__ import annotations

from mapdeal.version import __version__ as __version__

# Nothing is imported here but for whoever asks for a name: each command passes through.
_known: dict[str, str] = {}


def _homes() -> dict[str, str]:
    """Return the module of each name that the stub beside this file imports.

    A module of which it imports all stands under its own name.
    """
    if not _known:
        _known.update(_read_stub())
    return _known


def _read_stub() -> dict[str, str]:
    import ast
    from pathlib import Path

    tree = ast.parse(Path(__file__).with_suffix(".pyi").read_text("utf-8"))
    imports = (node for node in tree.body if isinstance(node, ast.ImportFrom) and node.module)
    pairs = ((alias.name, str(node.module)) for node in imports for alias in node.names)
    return {module if name == "*" else name: module for name, module in pairs}


def _home_of(name: str) -> str | None:
    if name in _homes():
        return _homes()[name]
    whole = (module for one, module in _homes().items() if one == module)
    return next((module for module in whole if name in _names_in(module)), None)


def _names_in(module: str) -> list[str]:
    from importlib import import_module

    return [name for name in vars(import_module(module)) if not name.startswith("_")]


def _draw(shown: object) -> bytes | None:
    from mapdeal.api.picture import png_of

    return png_of(shown)


def __getattr__(name: str) -> object:
    from importlib import import_module

    from mapdeal.grid.display import draw_with

    draw_with(_draw)  # grids lie below what draws them; commands never come here
    if name == "__all__":
        return __dir__()
    home = None if name.startswith("__") else _home_of(name)
    if home is None:
        raise AttributeError(f"module 'mapdeal' has no attribute {name!r}")
    value = getattr(import_module(home), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    named = (_names_in(module) if name == module else [name] for name, module in _homes().items())
    return sorted(name for names in named for name in names)
