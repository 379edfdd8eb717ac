"""Effects of layers on a map file, in words and in cells, and robots' footprints."""

import math

import numpy as np
import pytest

from mapdeal import Footprint, RobotParameters
from mapdeal.layers.denoise import DenoiseLayer
from mapdeal.layers.inflation import InflationLayer
from mapdeal.layers.keepout import KeepoutFilter
from mapdeal.layers.static import StaticLayer
from mapdeal.ros import robot
from mapdeal.ros.robot import (
    FootprintStringError,
    ListedLayer,
    corners_of_string,
    effect_of,
    on_map,
    radii_of,
)


def _robot(*layers):
    listed = tuple(layer if isinstance(layer, ListedLayer) else
                   ListedLayer(layer.name, "a::B", layer) for layer in layers)  # fmt: skip
    return RobotParameters("nav2", "global", "/a", Footprint.circle(0.3), 0.0, 0.3, True, False,
                           listed, (), 0.3, 0.4)  # fmt: skip


USUAL = "occupancy 100 is lethal, all else free, unknown stays unknown"
REPLACED = "no effect: a layer above it replaces all costs"
BELOW = InflationLayer("below", 0.3, 0.7, 3.0)
FAR = "cost 253 as far as 0.3 m from obstacles, then falling with cost_scaling_factor 3 "
FAR += "as far as 0.7 m"
IDLE_LAYERS = [ListedLayer("off", "a::B", InflationLayer("off"), is_enabled=False),
               ListedLayer("sonar", "a::C", None, why_ignored="needs sensor data"),
               InflationLayer("zero", 0.3, 0.0)]  # fmt: skip
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


def test_a_keepout_mask_is_unused_below_a_layer_that_overwrites_it():
    lost = "a layer after the keepout filter overwrites its costs"
    assert _robot(KeepoutFilter(), StaticLayer()).why_mask_unused == lost
    assert _robot(StaticLayer(), KeepoutFilter()).why_mask_unused is None


READ = {
    "[[0.3,0.2],[0.3,-.2],[-3e-1,+0.2]]": ((0.3, 0.2), (0.3, -0.2), (-0.3, 0.2)),
    "[[1 2][3\t4]  [5, 6]]": ((1, 2), (3, 4), (5, 6)),
    "[[1,\t2],\t[3, 4],[5\t6]]": ((1, 2), (3, 4), (5, 6)),
    "[[1-2], [3+4], [5.5.5]]": ((1, -2), (3, 4), (5.5, 0.5)),
    "[[1,\n2], [3, 4], [5.,6e0]]": ((1, 2), (3, 4), (5, 6)),
    ",,[[1,,2],,[3,4],[5,6],],": ((1, 2), (3, 4), (5, 6)),
    "[[1, 2], [3, 4], [5, 1e-60]]": ((1, 2), (3, 4), (5, 0)),
}


@pytest.mark.parametrize("text", READ)
def test_texts_are_read_as_a_stream_of_c_reads_them(text):
    assert corners_of_string(text) == tuple(map(tuple, np.float32(READ[text]).tolist()))


REFUSED = {
    "": "needs three points",
    "[]": "needs three points",
    "[[1, 2], [3, 4]]": "needs three points or more, has 2",
    "[[1, 2], [3, 4], [5, 6]": "a bracket is not closed",
    "[[1, 2], [3, 4], [5, 6]]]": "more closing than opening",
    "[[[1, 2], [3, 4], [5, 6]]]": "nested deeper than two",
    "[1, 2, 3, 4, 5, 6]": "'1' stands outside",
    "[[1, 2], [3, 4], [5, 6]]\n": "'\\n' stands outside",
    "[[1, 2], [3, 4], [5]]": "pairs of numbers",
    "[[1, 2], [3, 4], [5, 6, 7]]": "pairs of numbers",
    "[[1, 2], [3, 4m], [5, 6]]": "'m' is not a number",
    "[[1, 2], [3, nan], [5, 6]]": "'nan' is not a number",
    "[[1, 2], [3, 1e], [5, 6]]": "'1e' is not a number",
    "[[1, 2], [3, .], [5, 6]]": "'.' is not a number",
    "[[1, 2], [3, 1e39], [5, 6]]": "'1e39' is too large",
    "[[0.3; 0.2], [1; 2], [3; 4]]": "is not a number",
}


@pytest.mark.parametrize("text", REFUSED)
def test_texts_without_a_footprint_are_refused(text):
    with pytest.raises(FootprintStringError) as caught:
        corners_of_string(text)
    assert REFUSED[text] in str(caught.value)


@pytest.mark.slow
def test_long_texts_take_no_long_time():
    for text in ("1" * 300_000, "1 " * 200_000):
        with pytest.raises(FootprintStringError):
            corners_of_string("[[" + text)


def test_padding_moves_each_coordinate_by_its_own_sign():
    padded = robot.padded_corners(((1.0, -2.0), (0.0, 3.0), (-1.0, 0.0)), 0.25)
    assert padded == ((1.25, -2.25), (0.0, 3.25), (-1.25, 0.0))
    (corner,) = robot.padded_corners(((1.0, 0.0),), float("inf"))  # without a warning of numpy's
    assert [*map(str, corner)] == ["inf", "nan"]  # which is refused later


@pytest.mark.parametrize(("corners", "inscribed", "circumscribed"), [
    (((1, 1), (-1, 1), (-1, -1), (1, -1)), 1, 2**0.5),
    (((1, 1), (1, 1), (-1, 1), (-1, -1), (1, -1)), 1, 2**0.5),
    # the lines of two edges are 1 m away, but the edges end before that
    (((3, 1), (1, 1), (1, 3)), 2**0.5, 10**0.5),
    (((1, 1), (2, 1.5), (1.5, 2)), 2**0.5, 2.5),
])  # fmt: skip
def test_radii_are_those_of_edges_and_corners(corners, inscribed, circumscribed):
    found = radii_of(tuple((float(x), float(y)) for x, y in corners))
    assert found == pytest.approx((inscribed, circumscribed), rel=1e-15)
