import json
import math
from dataclasses import asdict

import numpy as np
import pytest
from hypothesis import example, given, strategies as st

import mapdeal
import oracles
from drawn import grid_from_text
from engines import ENGINES
from mapdeal import MapdealWarning, OccupancyGrid, esdf, exponential_cost, layered_cost
from mapdeal.kernels import engine
from mapdeal.kernels.blocks import lazy_layer
from mapdeal.layers.inflation import InflationLayer
from mapdeal.layers.obstacle import ObstacleLayer
from mapdeal.layers.static import StaticLayer
from mapdeal.pipeline.recipe import load_recipe
from mapdeal.pipeline.step import make_step
from recorded_costmaps import exponential_parameters, recorded_costmaps, sum_of
from strategies import LAYERS, examples, occupancies

pytestmark = pytest.mark.usefixtures("mapdeal_warnings")


@pytest.mark.parametrize("name", ENGINES)
def test_costs_are_those_that_the_real_code_has_made_of_robots_files(real_maps, monkeypatch, name):
    """Nav2's, byte for byte; those of older layers with the exact distances of the recording."""
    monkeypatch.setenv(engine.VARIABLE, name)
    count, in_blocks_every = 0, 90 if name == "scipy" else 10  # it is slow
    for case in recorded_costmaps(real_maps):
        about, grid = case.about, case.grid
        older = about.get("legacy") or about["ros1"]
        recorded = {"exact": older.get("exact_distances", older)}
        if about["flavour"] == "nav2":
            recorded["nav2"] = about["distance_transform"]
        for lookup, costs in recorded.items():
            count += 1
            if name == "scipy" and (lookup == "exact" or count % 24):
                continue
            layers = tuple(case.layers(lookup))
            parameters = exponential_parameters(layers, case.default_cost)
            in_blocks = lazy_layer(grid.shape, np.int8, grid.occupancy.__getitem__, block_height=97)
            sources = [grid, OccupancyGrid(in_blocks, grid.resolution, grid.origin)]
            for source in sources[: 2 if count % in_blocks_every == 0 else 1]:
                found = layered_cost(source, layers=layers, default_cost=case.default_cost)
                assert sum_of(np.asarray(found.cost)) == costs["sha256"], (about["id"], lookup)
                if parameters is not None and count % 3 == 0:
                    if source is not grid:
                        source = esdf(source, lethal_threshold=parameters["lethal_threshold"])
                    found = exponential_cost(source, **parameters)
                    assert sum_of(np.asarray(found.cost)) == costs["sha256"], (about["id"], lookup)
    assert count >= 240


def test_small_groups_go_as_the_real_denoise_layer_takes_them(real_maps, tmp_path):
    cases = json.loads((real_maps / "expected" / "denoise.json").read_text())["cases"]
    grids = {name: mapdeal.read_map(real_maps / name) for name in {case["map"] for case in cases}}
    for number, case in enumerate(cases):
        grid = grids[case["map"]]
        path = tmp_path / "nav2.yaml"
        path.write_text(case["params"])
        layers = mapdeal.read_robot_parameters(path).costmap_layers
        if number % 5 == 0:
            lazy = lazy_layer(grid.shape, np.int8, grid.occupancy.__getitem__, block_height=37)
            grid = OccupancyGrid(lazy, grid.resolution, grid.origin)
        found = layered_cost(grid, layers=layers.layers, default_cost=layers.default_cost)
        assert sum_of(np.asarray(found.cost)) == case["sha256"], case["params"]
    assert len(cases) == 88


@pytest.mark.slow
@examples(80)
@given(occupancies(), st.sampled_from([0.04, 0.1, 0.25, 0.7]), st.lists(LAYERS, max_size=5),
       st.sampled_from([0, 255]), st.integers(1, 13))  # fmt: skip
@example(np.int8([[0, 100, -1]]), 0.1, [StaticLayer(unknown_cost_value=0), ObstacleLayer()], 0, 1)
def test_any_sequence_of_layers_equals_brute_force(
    occupancy, resolution, layers, default_cost, block_height
):
    grid = OccupancyGrid(occupancy, resolution, (1.5, -2.0, 0.4))
    lazy = lazy_layer(grid.shape, np.int8, occupancy.__getitem__, block_height=block_height)
    expected = oracles.master_grid(occupancy, resolution, layers, default_cost)
    for source in (grid, OccupancyGrid(lazy, resolution, grid.origin)):
        found = layered_cost(source, layers=layers, default_cost=default_cost)
        assert np.array_equal(np.asarray(found.cost), expected)
    parameters = exponential_parameters(layers, default_cost)
    if parameters is not None:
        for source in (grid, esdf(grid, lethal_threshold=parameters["lethal_threshold"])):
            assert np.array_equal(exponential_cost(source, **parameters).cost, expected)


def test_unknown_cells_that_a_field_counts_as_obstacles_are_lethal():
    grid = grid_from_text("?...", resolution=0.5)
    layers = ["static", {"inflation": {"inflation_radius": 0.5, "cost_scaling_factor": 0.0}}]
    assert layered_cost(esdf(grid), layers=layers).cost.tolist() == [[255, 0, 0, 0]]
    counted = esdf(grid, unknown="occupied")
    assert layered_cost(counted, layers=layers).cost.tolist() == [[254, 252, 0, 0]]


def test_the_circumscribed_cost_is_that_of_the_last_inflation():
    grid = OccupancyGrid([[100] + [0] * 11], 0.05)
    radii = {"inscribed_radius": 0.2, "inflation_radius": 0.55}
    layers = ["static", {"inflation": {"inflation_radius": 0.1}}, {"inflation": radii}]
    found = layered_cost(grid, layers=layers, circumscribed_radius=0.35)
    assert found.circumscribed_cost == int(252 * math.exp(-10 * (0.35 - 0.2)))
    assert layered_cost(grid, layers=["static"]).circumscribed_cost is None
    with pytest.warns(MapdealWarning, match="inscribed_radius 0.6 m is larger"):
        layered_cost(grid, layers=[{"inflation": {"inscribed_radius": 0.6}}])
    # the default layers are costmap_2d's
    plain = exponential_cost(grid, float32_resolution=True)
    assert np.array_equal(layered_cost(grid).cost, plain.cost)


LAYERS = [
    {"static": {"name": "map", "track_unknown_space": False, "lethal_cost_threshold": 65}},
    {"inflation": {"inflation_radius": 0.7, "cost_scaling_factor": 3.0, "lookup": "nav2"}},
    "static",
]


def test_layers_in_recipes_settings_and_manifests(tmp_path):
    step = make_step("cost", {"model": "layers", "layers": LAYERS})
    assert step.parameters["layers"] == (
        StaticLayer("map", track_unknown_space=False, lethal_cost_threshold=65),
        InflationLayer(inflation_radius=0.7, cost_scaling_factor=3.0, lookup="nav2"),
        StaticLayer(),
    )
    document = json.loads(json.dumps(step.described()))
    assert document["cost"]["layers"][2] == {"static": asdict(StaticLayer())}
    path = tmp_path / "recipe.yaml"
    path.write_text(json.dumps({"stages": [document]}))
    assert load_recipe(str(path)).described() == [document]
    text = (
        "[{static: {name: map, track_unknown_space: no, lethal_cost_threshold: 65}}, "
        "{inflation: {inflation_radius: 7e-1, cost_scaling_factor: 3, lookup: nav2}}, static]"
    )
    for more, values in (([], {}), (["cost.default_cost=255"], {"default_cost": 255})):
        changes = [f"cost.layers={text}", "cost.model=layers", *more]
        described = load_recipe("default", changes=changes).described()[-1]
        assert described == {"cost": {**document["cost"], **values}}
