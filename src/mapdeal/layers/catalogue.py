"""All costmap layers: the classes that the modules of this package define."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from pkgutil import iter_modules

from mapdeal import layers
from mapdeal.layers.layer import CostmapLayer


def _layer_classes() -> Iterator[type[CostmapLayer]]:
    for module in sorted(found.name for found in iter_modules(layers.__path__)):
        for member in vars(import_module(f"{layers.__name__}.{module}")).values():
            is_layer = isinstance(member, type) and issubclass(member, CostmapLayer)
            if is_layer and member.key and member.__module__.endswith(f".{module}"):
                yield member


LAYERS: tuple[type[CostmapLayer], ...] = tuple(_layer_classes())
KINDS: dict[str, type[CostmapLayer]] = {layer.key: layer for layer in LAYERS}
"""Layer classes by their key in recipes."""
NAV2_PLUGINS = {plugin: layer for layer in LAYERS for plugin in layer.nav2_plugins}
ROS1_PLUGINS = {plugin: layer for layer in LAYERS for plugin in layer.ros1_plugins}


def class_name(plugin: str) -> str:
    return plugin.replace("/", "::").rpartition("::")[2]


def layer_named(name: str) -> type[CostmapLayer] | None:
    plugins = {**ROS1_PLUGINS, **NAV2_PLUGINS}
    return {class_name(plugin): layer for plugin, layer in plugins.items()}.get(name)
