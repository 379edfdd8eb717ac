"""mapdeal: batch processing of robot map files without ROS.

`read_map` returns an `OccupancyGrid`, a `Costmap`, a `DistanceField`, a `PotentialField` or a
`Reach`; stages such as `inflate`, `esdf` and `layered_cost` make one of another, and `write_map`
writes it. Functions named like commands (`run`, `lint`, `align`, `score`) take files or grids.
``dir(mapdeal)`` lists all names; the stub beside this file says where each is defined.

All public names are loaded on first use, so that ``import mapdeal`` costs nothing.
"""

from __future__ import annotations

import sys

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
    from mapdeal.commands.draw_picture import png_of

    return png_of(shown)


def __getattr__(name: str) -> object:
    from importlib import import_module

    if name == "__all__":
        return __dir__()
    home = None if name.startswith("__") else _home_of(name)
    if home is None:
        raise AttributeError(f"module 'mapdeal' has no attribute {name!r}")
    value = getattr(import_module(home), name)
    if "mapdeal.grid.values" in sys.modules:  # grids lie below what draws them
        import_module("mapdeal.grid.values").draw_with(_draw)
    if getattr(value, "__annotations__", None) and not isinstance(value, type):
        value = import_module("mapdeal.command").with_plain_errors(value)
        _show_plain_types(value)
        setattr(sys.modules[value.__module__], name, value)  # where pickle looks for it
    globals()[name] = value
    return value


def _show_plain_types(function: object) -> None:
    """Give a function a signature for tooltips, without the marks of its parameters."""
    import inspect
    import re
    import typing

    known: typing.Any = function
    hints = typing.get_type_hints(inspect.unwrap(known))
    signature = inspect.signature(known)
    parameters = [
        one.replace(annotation=re.sub(r"\b[\w.]*\.", "", inspect.formatannotation(hints[name])))
        if name in hints and one.kind is not one.VAR_KEYWORD
        else one
        for name, one in signature.parameters.items()
    ]
    known.__signature__ = signature.replace(parameters=parameters)


def __dir__() -> list[str]:
    named = (_names_in(module) if name == module else [name] for name, module in _homes().items())
    return sorted(name for names in named for name in names)
