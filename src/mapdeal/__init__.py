"""mapdeal: batch processing of robot map files without ROS.

Files: `read_map` and `write_map`; `read_map` returns an `OccupancyGrid`, a `Costmap`, a
`DistanceField`, a `PotentialField` or a `Reach`.
Robots: `costmap(map, robot)`, `read_robot_parameters`, `footprint_costs`, `cost_curve`, `reach`.
Stages, from grid to grid: `active_region`, `inflate`, `esdf`, `layered_cost`, `exponential_cost`,
`potential`, `clean`, `window`, `rotate`, `rescale`, `draw`.
Sensors: `build_map`, `build_map_from_log`, `cloud_map`, `local_map`.
Commands, on files or grids: `run`, `lint`, `diff`, `score`, `align`, `merge`, `route`, `graph`,
`info`, `write_picture`, `write_report`.

``help(mapdeal.reach)`` describes one of them, ``dir(mapdeal)`` lists all public names. They are
loaded on first use, so that ``import mapdeal`` costs nothing.
"""

from __future__ import annotations

import sys
from functools import cache

from mapdeal.version import __version__ as __version__

# Names are imported on demand, because every command imports this module.


@cache
def _modules() -> dict[str, str]:
    """Return the module of each name that the stub beside this file imports.

    A module with a star import is listed under its own name.
    """
    import ast
    from pathlib import Path

    tree = ast.parse(Path(__file__).with_suffix(".pyi").read_text("utf-8"))
    imports = (node for node in tree.body if isinstance(node, ast.ImportFrom) and node.module)
    pairs = ((alias.name, str(node.module)) for node in imports for alias in node.names)
    return {module if name == "*" else name: module for name, module in pairs}


def _module_of(name: str) -> str | None:
    if name in _modules():
        return _modules()[name]
    star_imports = (module for listed, module in _modules().items() if listed == module)
    return next((module for module in star_imports if name in _names_in(module)), None)


def _names_in(module: str) -> list[str]:
    from importlib import import_module

    return [name for name in vars(import_module(module)) if not name.startswith("_")]


def _draw(drawable: object) -> bytes | None:
    from mapdeal.commands.draw_picture import png_of

    return png_of(drawable)


def __getattr__(name: str) -> object:
    from importlib import import_module
    from importlib.util import find_spec

    # Python imports modules itself, and looks for special names
    is_other = name.startswith("__") or "." in name or find_spec(f"{__name__}.{name}")
    module_name = None if is_other else _module_of(name)
    if module_name is None:
        raise AttributeError(f"module 'mapdeal' has no attribute {name!r}")
    value = getattr(import_module(module_name), name)
    if "mapdeal.grid.values" in sys.modules:  # grids cannot import the module that draws them
        import_module("mapdeal.grid.values").draw_with(_draw)
    if getattr(value, "__annotations__", None) and not isinstance(value, type):
        if not hasattr(value, "__wrapped__"):  # stages check their own arguments
            value = import_module("mapdeal.command").with_plain_errors(value)
            setattr(sys.modules[value.__module__], name, value)  # where pickle looks for it
        _show_plain_types(value)
    globals()[name] = value
    return value


def _show_plain_types(function: object) -> None:
    """Set a signature for tooltips, with plain types in place of annotated ones."""
    import inspect
    import re
    import typing

    known: typing.Any = function
    hints = typing.get_type_hints(inspect.unwrap(known))
    signature = inspect.signature(known)
    parameters = []
    for name, item in signature.parameters.items():
        if name in hints and item.kind is not item.VAR_KEYWORD:
            plain = re.sub(r"\b[\w.]*\.", "", inspect.formatannotation(hints[name]))
            item = item.replace(annotation=plain)
        parameters.append(item)
    known.__signature__ = signature.replace(parameters=parameters)


def __dir__() -> list[str]:  # no __all__: help(mapdeal) would print the help of every name
    named = (_names_in(module) if name == module else [name] for name, module in _modules().items())
    return sorted(name for names in named for name in names)
