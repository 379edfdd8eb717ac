"""All planners that are modelled: the classes that the modules of this package define."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from pkgutil import iter_modules

from mapdeal import planners
from mapdeal.planners.planner import Planner


def _planner_classes() -> Iterator[type[Planner]]:
    for module in sorted(found.name for found in iter_modules(planners.__path__)):
        for member in vars(import_module(f"{planners.__name__}.{module}")).values():
            is_planner = isinstance(member, type) and issubclass(member, Planner)
            if is_planner and member.plugin_names and member.__module__.endswith(f".{module}"):
                yield member


PLANNERS: dict[str, type[Planner]] = {
    name: planner for planner in _planner_classes() for name in planner.plugin_names
}
"""Planner classes by their plugins' names."""
