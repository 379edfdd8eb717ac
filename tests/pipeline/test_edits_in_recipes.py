"""Stages that change a map before others work on it: cleaned, cut out, turned, on other cells."""

import json

import numpy as np
import pytest

import mapdeal
from drawn import grid_from_text
from mapdeal import MalformedInputError, ParameterError, read_map, write_map

ROOM = "\n".join(
    ["#" * 30, *["#" + "." * 28 + "#"] * 4, "#" + "." * 14 + "?" + "." * 13 + "#",
     *["#..#" + "." * 25 + "#"] * 4, "#" * 30]
)  # fmt: skip
STAGES = {
    "clean": {"min_free": 0},
    "window": {"size": [2.0, 0.8], "at": [3.0, -1.5]},
    "rotate": {"yaw": 0.3},
    "rescale": {"resolution": 0.2, "rule": "nearest"},
    "shift": {"origin": [2.5, -1.0], "default": 100},
}


@pytest.fixture
def room(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_map("room.yaml", grid_from_text(ROOM, 0.1, (1.5, -2.0, 0.0)))
    return read_map("room.yaml")


def recipe_of(**stages):
    with open("r.yaml", "w") as file:
        json.dump({"stages": [{name: values} for name, values in stages.items()]}, file)
    return "r.yaml"


def test_each_works_on_what_the_one_before_it_made(room, command):
    expected = {"cleaned.yaml": mapdeal.clean(room, min_free=0).grid}
    for name, call in {
        "window.yaml": lambda grid: mapdeal.window(grid, size_xy=(2, 0.8), center_xy=(3, -1.5)),
        "turned.yaml": lambda grid: mapdeal.rotate(grid, 0.3),
        "rescaled.yaml": lambda grid: mapdeal.rescale(grid, 0.2, rule="nearest"),
        "shifted.yaml": lambda grid: mapdeal.shift_origin(grid, (2.5, -1.0), default=100),
        "esdf.npz": mapdeal.esdf,
    }.items():
        expected[name] = call([*expected.values()][-1])
    words = "run", "room.yaml", "-o", "out", "--recipe", recipe_of(**STAGES, esdf={})
    assert command(*words)[0] == 0
    for name, grid in expected.items():
        written = read_map(f"out/room/{name}")
        assert written.frame == grid.frame
        assert np.array_equal(written.layer, grid.layer), name
    assert "unchanged" in command(*words)[1]


def test_a_map_is_straightened_before_others_work_on_it(room):
    crooked = mapdeal.rotate(room, 0.3)
    products = mapdeal.apply_recipe(crooked, recipe_of(rotate={"straighten": True}))
    assert np.array_equal(products["rotate"].occupancy, mapdeal.straighten(crooked).occupancy)


def test_the_frame_of_another_map_can_be_written_out(room):
    like = {"height": 6, "width": 9, "resolution": 0.1, "origin": [1.7, -1.8, 0]}
    window = mapdeal.apply_recipe(room, recipe_of(window={"like": like}))["window"]
    assert window.frame == mapdeal.Frame(6, 9, 0.1, (1.7, -1.8, 0.0))
    for wrong in ({**like, "height": 0}, {"height": 6}, "room.yaml", {**like, "width": 10**9}):
        with pytest.raises(ParameterError, match=r"window\.like"):
            mapdeal.load_recipe(recipe_of(window={"like": wrong}))


def test_costs_and_fields_are_edited_as_the_maps_that_they_are_of(room):
    costs = mapdeal.exponential_cost(room)
    with pytest.warns(mapdeal.MapdealWarning, match="occupancy that ROS would publish"):
        products = mapdeal.apply_recipe(costs, recipe_of(rescale={"resolution": 0.2}))
    assert isinstance(products["rescale"], mapdeal.OccupancyGrid)
    with pytest.raises(ParameterError, match="window: cannot follow cost"):
        mapdeal.load_recipe(recipe_of(cost={}, window=STAGES["window"]))


def test_the_whole_extent_is_that_of_the_map_that_was_moved(room):
    recipe = recipe_of(window={"size": [9.0, 9.0], "corner": [0.0, -5.0]}, active={})
    products = mapdeal.apply_recipe(room, recipe, canvas="full")
    assert products["active"].frame == products["window"].frame
    assert products["window"].shape == (90, 90)


@pytest.mark.parametrize("more", [{}, {"inflate": {}}])
def test_a_map_that_grows_too_large_is_refused_before_it_is_made(room, more):
    recipe = recipe_of(rescale={"resolution": 0.0005}, **more)
    with pytest.raises(MalformedInputError, match=r"room.yaml: .* of memory"):
        mapdeal.run("room.yaml", "out", recipe, max_memory=60_000_000)
