"""Effects of layers on a map file, in words and in cells."""

import math

import numpy as np
import pytest

from mapdeal import Footprint, RobotParameters
from mapdeal.layers.denoise import DenoiseLayer
from mapdeal.layers.inflation import InflationLayer
from mapdeal.layers.static import StaticLayer
from mapdeal.ros.robot import ListedLayer, effect_of, on_map


def _robot(*layers, track=True):
    listed = tuple(
        layer if isinstance(layer, ListedLayer) else ListedLayer(layer.name, "a::B", layer)
        for layer in layers
    )
    shape = Footprint.circle(0.3)
    return RobotParameters(
        "nav2", "global", "/a", shape, 0.0, 0.3, track, False, listed, (), 0.3, 0.4
    )


USUAL = "occupancy 100 is lethal, all else free, unknown stays unknown"
REPLACED = "no effect: a layer above it replaces all costs"
BELOW = InflationLayer("below", 0.3, 0.7, 3.0)
FAR = "cost 253 as far as 0.3 m from obstacles, then falling with cost_scaling_factor 3 "
FAR += "as far as 0.7 m"
IDLE_LAYERS = [
    ListedLayer("off", "a::B", InflationLayer("off"), is_enabled=False),
    ListedLayer("sonar", "a::C", None, why_ignored="needs sensor data"),
    InflationLayer("zero", 0.3, 0.0),
]
PLAIN = StaticLayer(trinary_costmap=False, lethal_cost_threshold=70, track_unknown_space=False,
                    inscribed_obstacle_cost_value=99)  # fmt: skip


@pytest.mark.parametrize(("layers", "effects"), [
    ([PLAIN], [("occupancy 70..100 is lethal, 99 inscribed, less costs its share of 254, "
               "unknown becomes free")]),
    ([StaticLayer(unknown_cost_value=0)],
     [("occupancy 100 is lethal, all else free; 0 counts as unknown, and -1 as lethal, "
      "unknown stays unknown")]),
    ([StaticLayer("one"), BELOW, StaticLayer("two"), InflationLayer("i", 0.3, 0.7, 3.0)],
     [REPLACED, REPLACED, USUAL, FAR]),
    ([StaticLayer("one"), BELOW, StaticLayer("two", use_maximum=True)],
     [USUAL, FAR, f"{USUAL}; costs are only raised"]),
    ([DenoiseLayer(), DenoiseLayer("b", 5, 4), DenoiseLayer("c", 1)],
     ["frees groups of fewer than 2 obstacle cells that share an edge or a corner",
      "frees groups of fewer than 5 obstacle cells that share an edge",
      "no effect: minimal_group_size is 1"]),
    ([StaticLayer("injected_static"), *IDLE_LAYERS],
     [f"not in the file, put in front: {USUAL}", "switched off", "ignored: needs sensor data",
      "no effect: inflation_radius is 0"]),
    ([InflationLayer("i", 0.3, 0.7, 3.0, inflate_unknown=True)],
     [f"{FAR}; unknown cells take costs, too"]),
])  # fmt: skip
def test_effects_name_what_layers_do_and_why_some_do_nothing(layers, effects):
    robot = _robot(*layers)
    assert [effect_of(listed, robot) for listed in robot.layers] == effects


@pytest.mark.parametrize(
    ("radius", "resolution", "cells"),
    # float32(0.03) is a little less than 0.03, float32(0.05) a little more
    [(0.45, 0.03, 16), (0.55, 0.05, 11), (0.551, 0.05, 12), (0.0, 0.05, 0), (0.01, 0.05, 1)],
)
def test_the_reach_is_counted_in_cells_of_the_message(radius, resolution, cells):
    robot = _robot(StaticLayer(), InflationLayer(inflation_radius=radius))
    assert on_map(robot, resolution)[0]["cell_inflation_radius"] == cells
    assert math.ceil(radius / float(np.float32(resolution))) == cells


def test_inflation_on_a_map_has_its_reach_and_circumscribed_cost():
    (entry,) = on_map(_robot(StaticLayer(), InflationLayer("i", 0.3, 0.85, 2.5)), 0.15)
    assert (entry["layer"], entry["cell_inflation_radius"]) == ("i", 6)
    assert entry["reach"] == 6 * float(np.float32(0.15))
    assert entry["circumscribed_cost"] == int(252 * math.exp(-2.5 * (0.4 - 0.3))) == 196
    (short,) = on_map(_robot(InflationLayer("i", 0.3, 0.35, 2.5)), 0.15)
    assert short["circumscribed_cost"] == 0
    (edge,) = on_map(_robot(InflationLayer("i", 0.3, 0.4, 2.5)), 0.15)  # the radius is within
    assert edge["circumscribed_cost"] == 196
