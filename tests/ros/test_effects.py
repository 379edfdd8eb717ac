"""What layers do to a map that is a file, in words and in cells."""

import math

import numpy as np
import pytest

from mapdeal import Footprint, RobotParameters
from mapdeal.grid.costmap import DenoiseLayer, InflationLayer, StaticLayer
from mapdeal.ros.robot import ListedLayer, effect_of, on_map, reach_of


def _robot(*layers, track=True):
    listed = tuple(
        one if isinstance(one, ListedLayer) else ListedLayer(one.name, "a::B", one)
        for one in layers
    )
    shape = Footprint.circle(0.3)
    return RobotParameters(
        "nav2", "global", "/a", shape, 0.0, 0.3, track, False, listed, (), 0.3, 0.4
    )


def _effects(*layers):
    robot = _robot(*layers)
    return [effect_of(one, robot) for one in robot.layers]


def _no_effects(*layers):
    return [text.startswith("no effect: a static layer above") for text in _effects(*layers)]


def test_static_layers_say_what_values_become():
    assert _effects(StaticLayer()) == [
        "occupancy 100 is lethal, all else free, unknown stays unknown"
    ]
    plain = StaticLayer(trinary_costmap=False, lethal_cost_threshold=70, track_unknown_space=False,
                        inscribed_obstacle_cost_value=99)  # fmt: skip
    parts = ["occupancy 70..100 is lethal", "99 inscribed", "less costs its share of 254"]
    assert _effects(plain) == [", ".join([*parts, "unknown becomes free"])]
    assert "0 counts as unknown, and -1 as lethal" in _effects(StaticLayer(unknown_cost_value=0))[0]


def test_what_a_static_layer_replaces_has_no_effect():
    below = InflationLayer("below", 0.3, 0.7, 3.0)
    two, above = StaticLayer("two"), InflationLayer("above")
    assert _no_effects(StaticLayer("one"), below, two, above) == [True, True, False, False]
    two = StaticLayer("two", use_maximum=True)
    assert not any(_no_effects(StaticLayer("one"), below, two))
    assert _effects(StaticLayer("one"), below, two)[2].endswith("costs are only raised")


def test_denoise_layers_say_which_groups_go():
    effects = _effects(StaticLayer(), DenoiseLayer(), DenoiseLayer("b", 5, 4), DenoiseLayer("c", 1))
    assert effects[1:] == [
        "frees groups of fewer than 2 obstacle cells that share an edge or a corner",
        "frees groups of fewer than 5 obstacle cells that share an edge",
        "no effect: minimal_group_size is 1",
    ]


def test_layers_that_are_off_ignored_or_put_there_say_so():
    off = ListedLayer("off", "a::B", InflationLayer("off"), is_enabled=False)
    sensor = ListedLayer("sonar", "a::C", None, why_ignored="needs sensor data")
    effects = _effects(
        StaticLayer("injected_static"), off, sensor, InflationLayer("zero", 0.3, 0.0)
    )
    assert effects[0].startswith("not in the file, put in front: occupancy 100 is lethal")
    assert effects[1:] == [
        "switched off", "ignored: needs sensor data", "no effect: inflation_radius is 0"
    ]  # fmt: skip


def test_inflation_says_how_far_and_how_steep():
    text = _effects(StaticLayer(), InflationLayer("i", 0.25, 0.8, 2.5, inflate_unknown=True))[1]
    assert text == (
        "cost 253 as far as 0.25 m from obstacles, then falling by 2.5 per metre as far as 0.8 m; "
        "unknown cells take costs, too"
    )


@pytest.mark.parametrize(
    ("radius", "resolution", "cells"),
    # float32(0.03) is a little less than 0.03, float32(0.05) a little more
    [(0.45, 0.03, 16), (0.55, 0.05, 11), (0.551, 0.05, 12), (0.0, 0.05, 0), (0.01, 0.05, 1)],
)
def test_the_reach_is_counted_in_cells_of_the_message(radius, resolution, cells):
    assert reach_of(InflationLayer(inflation_radius=radius), resolution) == cells
    assert math.ceil(radius / float(np.float32(resolution))) == cells


def test_what_inflation_comes_to_on_a_map():
    (one,) = on_map(_robot(StaticLayer(), InflationLayer("i", 0.3, 0.85, 2.5)), 0.15)
    assert (one["layer"], one["cell_inflation_radius"]) == ("i", 6)
    assert one["reach"] == 6 * float(np.float32(0.15))
    assert one["circumscribed_cost"] == int(252 * math.exp(-2.5 * (0.4 - 0.3))) == 196
    (short,) = on_map(_robot(InflationLayer("i", 0.3, 0.35, 2.5)), 0.15)
    assert short["circumscribed_cost"] == 0
    (edge,) = on_map(_robot(InflationLayer("i", 0.3, 0.4, 2.5)), 0.15)  # the radius is within
    assert edge["circumscribed_cost"] == 196
