import json
import threading
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

import mapdeal
from drawn import grid_from_text
from mapdeal import Costmap, OccupancyGrid, clean, graph, write_map
from mapdeal.errors import MalformedInputError, MapdealWarning, capture_warnings, emit_warning
from mapdeal.pipeline.recipe import load_recipe
from mapdeal.pipeline.run import run_map
from mapdeal.pipeline.settings import Settings, adding_warnings
from mapdeal.pipeline.step import make_step

KEYS = "resolution: 0.25\norigin: [1.5, -2, 0.3]\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
NO_NEGATE = "missing: negate (ROS requires it); assuming 0"


def make_map(folder, name, more=""):
    (folder / f"{name}.pgm").write_bytes(b"P5\n4 3\n255\n" + bytes([254] * 9 + [0] + [205] * 2))
    (folder / f"{name}.yaml").write_text(f"image: {name}.pgm\n{KEYS}{more}")
    return folder / f"{name}.yaml"


def test_runs_in_threads_hear_their_own_warnings_and_leave_the_filters_alone(tmp_path):
    recipe, settings = load_recipe("default"), Settings(images=False, threads=1)
    names = [f"{kind}{index}" for index in range(2) for kind in ("odd", "good")]
    paths = {name: make_map(tmp_path, name, "negate: 0\n" * ("good" in name)) for name in names}
    start = threading.Barrier(len(names))

    def work(name):
        start.wait()
        for turn in range(2):
            run_map(paths[name], tmp_path / "out" / f"{name}-{turn}", recipe, settings)

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", MapdealWarning)
        filters, show = list(warnings.filters), warnings.showwarning
        threads = [threading.Thread(target=work, args=(name,)) for name in names]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert (list(warnings.filters), warnings.showwarning) == (filters, show)
        messages = [str(warning.message) for warning in caught if NO_NEGATE in str(warning.message)]
    assert sorted(messages) == sorted(
        f"{paths[name]}: {NO_NEGATE}" for name in names if "odd" in name for _ in range(2)
    )
    for path in (tmp_path / "out").rglob("manifest.json"):
        name = path.parent.name.partition("-")[0]
        mine = [text for text in json.loads(path.read_text())["warnings"] if NO_NEGATE in text]
        assert mine == ([f"{name}.yaml: {NO_NEGATE}"] if "odd" in name else [])


def test_warnings_before_an_error_are_printed(tmp_path):
    path = make_map(tmp_path, "short")
    path.with_suffix(".pgm").write_bytes(b"P5\n4 3\n255\n123")
    with (
        pytest.warns(MapdealWarning, match="assuming 0"),
        pytest.raises(MalformedInputError, match="end early"),
    ):
        run_map(path, tmp_path / "out", load_recipe("default"), Settings())


@pytest.mark.parametrize("action", ["ignore", "error", "once"])
def test_filters_of_who_calls_decide_what_becomes_of_warnings(action):
    texts = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter(action, MapdealWarning)
        try:
            for _ in range(2):
                with adding_warnings(texts):
                    emit_warning("odd")
        except MapdealWarning as error:
            assert (action, str(error)) == ("error", "odd")
    assert texts == ["odd"] * (1 if action == "error" else 2)
    assert len(caught) == (action == "once")


def test_a_warning_is_about_the_code_that_calls_mapdeal(recwarn):
    clean(WALL)
    with adding_warnings([]):
        graph(WALL)
    lines = [Path(warning.filename).read_text().splitlines()[warning.lineno - 1].strip()
             for warning in recwarn]  # fmt: skip
    assert {line.partition("(")[0] for line in lines} == {"clean", "graph"}


def test_warnings_that_are_captured_twice_keep_their_place():
    with capture_warnings() as captured, adding_warnings(texts := []):
        emit_warning(MapdealWarning("odd", "image.lossy"))
    assert (texts, [warning.check for warning in captured]) == (["odd"], ["image.lossy"])


WALL = OccupancyGrid([[100, *[0] * 199]] * 3, 0.05, (1.5, -2.0, 0.4))
NEAR = OccupancyGrid(WALL.occupancy[:, :60], 0.05)
EMPTY = OccupancyGrid(np.zeros((3, 7), np.int8), 0.05, (1.5, -2.0, 0.4))


@pytest.mark.slow
@pytest.mark.parametrize(("scale", "dtype", "costs"), [
    ("costmap2d", np.uint8, [0, 1, 99, 100, 253, 254, 255]),
    ("occupancy", np.int8, [-1, 0, 1, 98, 99, 100]),
])  # fmt: skip
@given(data=st.data())
def test_the_most_common_cost_equals_brute_force(scale, dtype, costs, data):
    shapes = array_shapes(min_dims=2, max_dims=2, max_side=12)
    cost = data.draw(arrays(dtype, shapes, elements=st.sampled_from(costs)))
    found = Costmap(cost, 0.3, (1.0, 2.0, 0.5), scale).figures()["most_common"]
    values = cost.ravel().tolist()
    if scale == "occupancy":
        besides = [value for value in values if value not in (-1, 100)]
        if besides and besides.count(99) / len(besides) > 0.98:
            assert found == {"cost": 99, "share": besides.count(99) / len(besides)}
            return
    closed = {253, 254, 255} if scale == "costmap2d" else {-1, 99, 100}
    open_ = [value for value in values if value not in closed]
    if not open_:
        assert found is None
    else:
        shares = {value: open_.count(value) / len(open_) for value in open_}
        assert found == {"cost": found["cost"], "share": max(shares.values())}
        assert shares[found["cost"]] == found["share"]


@pytest.mark.parametrize("name", ["esdf", "inflate", "potential", "ring_cost", "layered_cost"])
def test_stages_warn_of_maps_without_obstacles_and_recipes_once(name):
    with pytest.warns(MapdealWarning, match=r"^\w+: there is no obstacle$"):
        figures = getattr(mapdeal, name)(EMPTY).figures()
    assert make_step(name.rpartition("_")[2], {}).remark_on(figures)
    with pytest.warns(MapdealWarning, match=r"^cost: 100 % .* there is no obstacle$") as caught:
        mapdeal.apply_recipe(EMPTY)
    assert len(caught) == 1


def remark_on(grid, parameters):
    step = make_step("cost", parameters)
    return step.remark_on(step.apply(grid, "m.yaml").figures())


@pytest.mark.parametrize(("grid", "parameters", "advice"), [
    (WALL, {"inflation_radius": 0.1}, "cost 0: raise inflation_radius (0.1 m)"),
    (WALL, {"inflation_radius": 0.0}, "or list an inflation layer last"),
    (WALL, {"cost_scaling_factor": 90.0}, "cost 0: lower cost_scaling_factor (90)"),
    (WALL, {"cost_scaling_factor": 0.0, "inflation_radius": 20.0},
     "cost 252: raise cost_scaling_factor (0)"),
    (WALL, {"model": "rings"}, "cost 0: give more values; 90,70,50 reach 3 cells"),
    *[(EMPTY, model, "cost 0: there is no obstacle") for model in ({}, {"model": "rings"})],
    (grid_from_text("####"), {},
     "every known cell is lethal or inscribed: lower inscribed_radius, or the radius of inflate"),
    (grid_from_text("????"), {}, "every cell is unknown"),
    # graded ones
    (NEAR, {}, None), (NEAR, {"model": "threshold", "up_factor": 1.0}, None),
    (NEAR, {"model": "rings", "values": (90, 70, 50, 30)}, None),
])  # fmt: skip
def test_the_remark_says_which_parameter_to_change(grid, parameters, advice):
    remark = remark_on(grid, parameters)
    assert remark is None or remark.startswith("cost: ")
    assert remark is advice or remark.endswith(advice)


FAR = {"down_distance": 1.5, "up_distance": 1.5}
AT_WALL = {"down_distance": 0.15, "up_distance": 0.0}


@pytest.mark.parametrize(("parameters", "advice", "changes"), [
    ({"down": 96, "up": 97},
     "cost 0: lower up (97) and down (96), or give up_distance and down_distance in metres",
     [{"down": 20, "up": 30}, {"down": None, "up": None, **FAR}]),
    ({"down": 96, "up": 97, "down_factor": 1.0},
     "cost 0: lower down (96), or give down_distance in metres", [{"down": 20}]),
    ({"down": 0, "up": 97}, "cost 0: lower up (97), or give up_distance in metres", [{"up": 30}]),
    (AT_WALL, "cost 0: raise up_distance (0 m)", [FAR]),
    ({**FAR, "up_distance": 0.0}, "cost 0: raise up_distance (0 m)", [{"up_distance": 1.5}]),
    ({**AT_WALL, "down_factor": 1.0}, "cost 0: raise down_distance (0.15 m)",
     [{"down_distance": 1.5}]),
    ({**AT_WALL, "up_distance": 0.15}, "cost 0: raise up_distance (0.15 m) and down_distance", []),
    ({**AT_WALL, "down_factor": 1.0, "view_range": 0.15},
     "cost 0: raise down_distance (0.15 m) and view_range", []),
    ({"up_factor": 0.01}, "cost 0: raise up_factor (0.01)", [{"up_factor": 1.0}]),
    ({"down": 0, "up": 0, "view_range": 0.15},
     "cost 0: raise up_factor and down_factor, or view_range", [{"view_range": 2.0}]),
    ({"view_range": 1000.0}, "cost 99: lower up_factor (1.5)", []),
    ({"view": "per-map", "down": 0, "up": 0, "up_factor": 900.0},
     "cost 99: view per-map is scaled by the extremes of the map; take view metric", []),
    ({"down": 0, "up": 100, "down_factor": 0.01, "view_range": 1000.0},
     "cost 0: raise up_factor and down_factor, or view_range", []),
])  # fmt: skip
def test_what_the_remark_on_thresholds_says_makes_a_difference(parameters, advice, changes):
    model = {"model": "threshold", **parameters}
    assert remark_on(WALL, model).endswith(advice)
    for change in changes:
        options = {name: value for name, value in {**model, **change}.items() if value is not None}
        assert remark_on(WALL, options) is None


def test_exactly_98_percent_are_not_too_many():
    step = make_step("cost", {})
    for graded, is_remarked in ((2, False), (1, True)):
        cost = np.zeros((1, 101), np.uint8)
        cost[0, 0], cost[0, 1 : 1 + graded] = 254, 7
        assert (step.remark_on(Costmap(cost, 0.1).figures()) is not None) == is_remarked


@pytest.fixture
def wall(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_map("m.yaml", WALL)
    write_map("n.yaml", EMPTY)
    return tmp_path


def test_a_run_warns_once_and_its_manifest_and_a_second_run_say_it_again(command, wall):
    words = ["run", "m.yaml", "-o", "o", "--no-images", "--set", "inflate.radius=0.05",
             "--set", "cost.inflation_radius=0.1"]  # fmt: skip
    code, _, err = command(*words)
    assert (code, err.count("warning"), err.count("% of the open cells")) == (0, 1, 1)
    manifest = json.loads((wall / "o" / "m" / "manifest.json").read_text())
    (message,) = manifest["warnings"]
    assert message.startswith("m.yaml: cost: ")
    assert err == f"warning: {message}\n"
    share = manifest["figures"]["cost"]["most_common"]["share"]
    assert share == np.mean(np.load(wall / "o" / "m" / "cost.npz")["cost"][:, 2:] == 0)
    assert command(*words)[1:] == ("m.yaml -> o/m: unchanged\n", err)


def test_cost_and_batches_warn(command, wall):
    _, _, err = command("cost", "m.yaml", "-o", "c.npz", "--inflation-radius", "0.1")
    assert err.count("open cells cost 0: raise inflation_radius (0.1 m)") == 1
    code, _, err = command("run", "m.yaml", "n.yaml", "-o", "b", "--no-images", "--recipe", "nav2")
    assert code == 0
    assert err.count("n.yaml: cost: 100 % of the open cells cost 0") == 1
    m, n = json.loads((wall / "b" / "summary.json").read_text())["maps"]
    assert "warnings" not in m
    assert "n.yaml: cost: 100 % of the open cells" in n["warnings"][0]
