"""The costmaps that the real code has made of robots' parameter files, and their layers."""

import hashlib
import json
import warnings
from dataclasses import dataclass

import numpy as np

import mapdeal
from mapdeal.layers.inflation import InflationLayer
from mapdeal.layers.stack import CostmapLayers
from mapdeal.layers.static import StaticLayer
from mapdeal.stages.catalogue import models_of


@dataclass(frozen=True)
class Recorded:
    """A case of params.json that has costs."""

    about: dict
    default_cost: int
    grid: mapdeal.OccupancyGrid

    def layers(self, lookup):
        """The layers that are switched on, as the real code has resolved them, in their order."""
        about, resolved = self.about, self.about["resolved"]
        static = resolved.get("static_layers", about.get("static_layers", {}))
        inflation = {
            name.rpartition("/")[2]: layer for name, layer in resolved["inflation_layers"].items()
        }
        names = resolved.get("plugins") or [layer["name"] for layer in about["plugins"]]
        for name in names:
            settings = static.get(name) or inflation.get(name)
            if settings is None or not settings["enabled"]:
                continue
            if name in static:
                keys = "track_unknown_space", "trinary_costmap", "use_maximum"
                yield StaticLayer(
                    name, **{key: settings[key] for key in keys},
                    lethal_cost_threshold=min(max(settings["lethal_cost_threshold"], 0), 100),
                    unknown_cost_value=settings["unknown_cost_value"] % 256,
                    inscribed_obstacle_cost_value=settings.get("inscribed_obstacle_cost_value"),
                )  # fmt: skip
            else:
                # Nav2's older layer does not know custom_inscribed_radius
                radius = settings["inscribed_radius_used"]
                keys = "inflation_radius", "cost_scaling_factor", "inflate_unknown"
                yield InflationLayer(
                    name, **{key: settings[key] for key in keys}, lookup=lookup,
                    inscribed_radius=radius if lookup == "nav2" else resolved["inscribed_radius"],
                    inflate_around_unknown=settings.get("inflate_around_unknown", False),
                )  # fmt: skip


def recorded_costmaps(data):
    """Yield the cases that have costs; each map is read once."""
    grids = {}
    for about in json.loads((data / "expected" / "params.json").read_text())["cases"]:
        if not (about.get("distance_transform") or about.get("ros1")):
            continue
        if about["map"] not in grids:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", mapdeal.MapdealWarning)
                grids[about["map"]] = mapdeal.read_map(data / about["map"])
        default = 255 if about["resolved"]["track_unknown_space"] else 0
        yield Recorded(about, default, grids[about["map"]])


def sum_of(cost):
    """The sha256 of costs, as the cases have it."""
    return hashlib.sha256(np.ascontiguousarray(cost).tobytes()).hexdigest()


def exponential_parameters(layers, default_cost=0):
    """The parameters of model exponential that do what layers do, None if it cannot."""
    from_layers = models_of("cost")["exponential"].parameters_from_layers
    return from_layers(CostmapLayers(tuple(layers), default_cost))
