"""A robot's layers as stages, against costmap_2d's layers applied one after the other."""

import numpy as np
import pytest
from hypothesis import example, given, strategies as st

from mapdeal import Footprint, OccupancyGrid, RobotParameters, apply_recipe, load_recipe
from mapdeal.errors import ParameterError
from mapdeal.layers.inflation import InflationLayer
from mapdeal.layers.static import StaticLayer
from mapdeal.pipeline.recipe import step_for
from mapdeal.ros.robot import ListedLayer
from oracles import master_grid
from strategies import LAYERS, examples, occupancies

pytestmark = pytest.mark.filterwarnings("ignore::mapdeal.MapdealWarning")


def _robot(*layers, track=True):
    listed = tuple(ListedLayer(layer.name, "a::B", layer) for layer in layers)
    shape = Footprint.polygon([(0.3, 0.2), (0.3, -0.2), (-0.2, -0.2), (-0.2, 0.2)])
    return RobotParameters(
        "nav2", "global", "/a", shape, 0.0, None, track, False, listed, (), 0.2, 0.36
    )


TWO_MAPS = [StaticLayer(lethal_cost_threshold=0), StaticLayer(
    unknown_cost_value=0, use_maximum=True, unknown_is_highest=True, track_unknown_space=False
)]  # fmt: skip
"""Unknown cells are lethal of the second one alone."""


@pytest.mark.slow
@examples(80)
@given(st.lists(LAYERS, max_size=4), st.booleans(), occupancies())
@example(TWO_MAPS, True, np.int8([[-1]]))
def test_the_recipe_of_a_robot_makes_its_master_grid(layers, track, occupancy):
    robot = _robot(*layers, track=track)
    products = apply_recipe(OccupancyGrid(occupancy, 0.1, (1.5, -2.0, 0.4)), robot)
    expected = master_grid(occupancy, 0.1, layers, 255 if track else 0)
    np.testing.assert_array_equal(products["cost"].cost, expected)


def test_one_static_and_one_inflation_layer_become_model_exponential():
    inflation = InflationLayer("i", 0.2, 0.7, 3.0, lookup="nav2")
    recipe = load_recipe(_robot(StaticLayer("s", lethal_cost_threshold=70), inflation))
    esdf, cost = (next(iter(step.values())) for step in recipe.described())
    assert (esdf["lethal_threshold"], cost["lethal_threshold"]) == (70, 70)
    assert (cost["model"], cost["lookup"], cost["inflation_radius"]) == ("exponential", "nav2", 0.7)
    assert cost["circumscribed_radius"] == 0.36


def test_another_shape_changes_the_radii_but_not_one_that_the_file_chose():
    own, custom = InflationLayer("a", 0.2, 0.7), InflationLayer("b", 0.25, 0.9)
    robot = _robot(StaticLayer(), own, custom).with_shape(Footprint.circle(0.5))
    assert [layer.inscribed_radius for layer in robot.inflation_layers] == [0.5, 0.25]
    assert (robot.inscribed_radius, robot.circumscribed_radius) == (0.5, 0.5)


@pytest.mark.parametrize(("stage", "chosen", "expected"), [
    ("cost", {"inflation_radius": 0.9, "lookup": "nav2"},
     {"inflation_radius": 0.9, "inscribed_radius": 0.2, "cost_scaling_factor": 3.0}),
    ("inflate", {}, {"radius": pytest.approx((0.3**2 + 0.2**2) ** 0.5), "lethal_threshold": 60}),
    ("cost", {"model": "rings"}, {"lethal_threshold": 60}),
])  # fmt: skip
def test_parameters_that_are_given_win_over_the_robots(stage, chosen, expected):
    robot = _robot(StaticLayer("s", lethal_cost_threshold=60), InflationLayer("i", 0.2, 0.7, 3.0))
    parameters = step_for(stage, robot, chosen).parameters
    assert {name: parameters[name] for name in expected} == expected


def test_a_chosen_model_follows_the_robots_layers_or_is_refused():
    static, inflation = StaticLayer("s"), InflationLayer("i", 0.2, 0.7, 3.0, lookup="nav2")
    step = step_for("cost", _robot(static, inflation), {"model": "layers"})
    assert step.parameters["layers"] == (static, inflation)
    two = _robot(static, inflation, InflationLayer("j", 0.2, 0.9))
    with pytest.raises(ParameterError, match="cannot make what the layers") as caught:
        step_for("cost", two, {"model": "exponential"})
    assert "model layers can" in caught.value.hint
    # parameters of one inflation, and of other models
    with pytest.raises(ParameterError, match=r"needs exactly one inflation layer, found: i, j"):
        step_for("cost", two, {"inflation_radius": 0.9})
    with pytest.raises(ParameterError, match="is a parameter of model rings, not of layers"):
        step_for("cost", two, {"values": (90, 70)})


@pytest.mark.parametrize("by_set", [False, True])
def test_layers_take_what_is_given_by_hand(by_set):
    robot = _robot(StaticLayer(unknown_cost_value=0), InflationLayer("a", 0.2, 0.7, lookup="nav2"))

    def layers(**chosen):
        if not by_set:
            return step_for("cost", robot, chosen).parameters["layers"]
        changes = {f"cost.{name}": value for name, value in chosen.items()}
        return load_recipe(robot, changes).steps[-1].parameters["layers"]

    static, inflation = layers(inflation_radius=0.9, lookup="exact", lethal_threshold=50)
    assert (inflation.inflation_radius, inflation.lookup) == (0.9, "exact")
    assert (static.lethal_cost_threshold, static.unknown_cost_value) == (50, 0)
    with pytest.raises(ParameterError, match="must be a finite number"):
        layers(inflation_radius=-1)
    two = _robot(StaticLayer(), InflationLayer("a"), InflationLayer("b", lookup="nav2"))
    found = step_for("cost", two, {"lookup": "exact"}).parameters["layers"]
    assert [layer.lookup for layer in found[1:]] == ["exact", "exact"]
