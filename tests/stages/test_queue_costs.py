import numpy as np
import pytest

from mapdeal import OccupancyGrid, esdf, exponential_cost
from mapdeal.pipeline.step import make_step
from mapdeal.stages.layered_cost import costs_spread, queue_difference, raise_by_queue
from recorded_costmaps import exponential_parameters, recorded_costmaps, sum_of

pytestmark = pytest.mark.usefixtures("mapdeal_warnings")


@pytest.mark.parametrize("every", [6, pytest.param(1, marks=pytest.mark.thorough)])
def test_the_queue_makes_the_costmaps_of_ros_1_and_of_older_nav2(real_maps, every):
    """Byte for byte; and as many cells as in the recording differ from exact distances."""
    count = 0
    for case in list(recorded_costmaps(real_maps))[::every]:
        about = case.about
        older = about.get("legacy") or about["ros1"]
        layers = tuple(case.layers("exact"))
        given = {"model": "layers", "layers": layers, "default_cost": case.default_cost}
        short = exponential_parameters(layers, case.default_cost)
        if count % 2 and short is not None:
            given = {"model": "exponential", **short}
        parameters = make_step("cost", given).parameters
        if count % 3 == 0:
            made = costs_spread(case.grid, parameters, raise_by_queue)
            assert sum_of(made) == older["sha256"], about["id"]
        difference = queue_difference(case.grid, parameters)
        if "exact_distances" in older:
            exact = older["exact_distances"]
            expected = (exact["cells_that_differ"], exact["largest_difference"])
            assert tuple(difference) == expected, about["id"]
        else:
            assert difference == (0, 0), about["id"]
        count += 1
    assert count >= 120 // every


def scattered(resolution=0.05):
    values = np.zeros((200, 230), np.int8)
    values[np.random.default_rng(1).random(values.shape) < 0.004] = 100
    return OccupancyGrid(values, resolution, (1.5, -2.0, 0.4))


def test_only_costs_around_cells_that_the_queue_reaches_late_differ():
    grid = scattered()
    parameters = make_step("cost", {"inflation_radius": 1.0, "cost_scaling_factor": 3.0}).parameters
    exact = exponential_cost(grid, **parameters).cost
    queued = costs_spread(grid, parameters, raise_by_queue)
    assert (queued <= exact).all()  # a longer distance is a lower cost
    cells, largest = queue_difference(grid, parameters)
    assert cells == np.count_nonzero(queued != exact) > 0
    assert largest == int((exact.astype(int) - queued).max()) < 10
    assert queue_difference(esdf(grid), parameters) == (cells, largest)


def test_nothing_differs_where_the_layer_has_no_queue_or_no_reach():
    for given in ({"lookup": "nav2"}, {"inflation_radius": 0.0}):
        parameters = make_step("cost", {"cost_scaling_factor": 1.0, **given}).parameters
        assert queue_difference(scattered(), parameters) == (0, 0)
    for lookup, differs in (("nav2", False), ("exact", True)):
        inflation = {"inflation_radius": 1.0, "cost_scaling_factor": 1.0, "lookup": lookup}
        layers = ["static", {"inflation": inflation}]
        parameters = make_step("cost", {"model": "layers", "layers": layers}).parameters
        assert (queue_difference(scattered(), parameters).cells > 0) == differs
