"""Fields: distances and gradients at points, and the view as a grid, also through files."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st

import mapdeal
import oracles
from drawn import grid_from_text
from mapdeal import DistanceField, OccupancyGrid, esdf
from mapdeal.kernels.threads import use_threads
from strategies import RESOLUTIONS

ROOM = esdf(grid_from_text("......#\n.#.....\n.....?.\n...#...", 0.25, (1.5, -2.0, 0.0)))


@given(st.integers(0, 2**32 - 1), RESOLUTIONS, st.floats(-3.1, 3.1))
def test_distances_and_gradients_are_those_of_the_interpolant_in_the_map_frame(
    seed, resolution, yaw
):
    rng = np.random.default_rng(seed)
    values = rng.uniform(-3, 3, (5, 7)).astype(np.float32)
    grid = OccupancyGrid(np.zeros((5, 7), np.int8), resolution, (1.5, -2.0, yaw))
    field = DistanceField(values, grid.occupancy, resolution, grid.origin)
    places = rng.uniform(0.01, 0.99, (20, 2)) * grid.shape
    found = field.query(grid.frame.xy_from_continuous_rowcol(places))
    value, up, right = np.transpose([oracles.bilinear(values, *place) for place in places])
    turned = (right + 1j * up) * np.exp(1j * yaw) / resolution
    assert found.distance == pytest.approx(value, abs=1e-6)
    expected = np.stack([turned.real, turned.imag], axis=1)
    assert found.gradient == pytest.approx(expected, rel=1e-6, abs=1e-6 / resolution)


def test_points_outside_are_marked_and_have_no_number():
    upper = [1.5 + 7 * 0.25, -2.0 + 4 * 0.25]
    far = [[np.nan, 0], [np.inf, 0], [1e300, 0]]
    points = [[1.4, -1.9], upper, [1.6, upper[1]], *far, [1.6, -1.9]]
    distance, gradient, inside = ROOM.query(points)
    assert inside.tolist() == [False] * 6 + [True]
    assert np.isnan(distance[:6]).all()
    assert np.isnan(gradient[:6]).all()
    assert np.isfinite(distance[6])
    assert ROOM.query(np.empty((0, 2))).gradient.shape == (0, 2)


@pytest.mark.parametrize(("drawing", "distance"), [("...", math.inf), ("###", -math.inf)])
def test_a_map_of_one_kind_has_infinite_distances_and_no_gradient(drawing, distance):
    found = esdf(grid_from_text(drawing, 0.5, (0.0, 0.0, 0.0))).query([[0.6, 0.3], [0.75, 0.25]])
    assert found.distance.tolist() == [distance, distance]
    assert np.isnan(found.gradient).all()
    assert found.inside.all()


def test_a_clip_stays():
    field = esdf(OccupancyGrid([[100, 0, 0, 0, 0, 0]], 0.5), max_distance=1.0, strength=3.0)
    distance, gradient, _ = field.query([[0.75, 0.25], [1.0, 0.25], [2.5, 0.25]])
    assert distance == pytest.approx([1.5, 2.25, 3.0])
    assert gradient[:, 0] == pytest.approx([3.0, 3.0, 0.0])


def test_many_points_in_threads_are_the_same_points():
    shares = np.random.default_rng(1).random((30_001, 2)) * 1.4 - 0.2
    points = ROOM.frame.xy_from_continuous_rowcol(shares * ROOM.shape)
    results = []
    for threads in (1, 3):
        with use_threads(threads):
            results.append([part.tobytes() for part in ROOM.query(points)])
    assert results[0] == results[1]
    alone = [ROOM.query(point).distance[0] for point in points[::2000]]
    assert np.array_equal(ROOM.query(points).distance[::2000], alone, equal_nan=True)


@pytest.mark.parametrize("origin", [(0.1, 0.7, 0.0), (-3.3, 2.2, 0.4), (500000.3, 4.2e6, 1.1)])
def test_at_centres_rounding_does_not_choose_the_side_of_the_gradient(origin):
    grid = OccupancyGrid([[0, 0, 0, 100, 0, 0, 0]] * 5, 0.1, origin)
    field = esdf(grid)
    distance, gradient, _ = field.query(grid.frame.xy_from_rowcol(np.argwhere(np.ones(grid.shape))))
    assert np.array_equal(distance.astype(np.float32), field.distance.ravel())
    along = gradient @ [math.cos(origin[2]), math.sin(origin[2])]
    # towards the next column, which the last one has not
    expected = np.append(np.diff(field.distance[0]), 0) / 0.1
    assert along.reshape(grid.shape) == pytest.approx(np.tile(expected, (5, 1)), abs=1e-6)


def test_figures_of_a_field_are_its_range_and_obstacles_those_of_a_map_every_kind_of_cell():
    distance = np.array([[-0.5, -0.25, 1.5], [0.75, 2.25, 0.5]], np.float32)
    occupancy = np.array([[100, 100, 0], [-1, 0, 50]], np.int8)
    field = DistanceField(distance, occupancy, 0.25, (1.5, -2.0, 0.4), convention="border")
    assert field.figures() == {
        "width": 3, "height": 2, "resolution": 0.25, "origin": [1.5, -2.0, 0.4],
        "convention": "border", "obstacles": 2, "lowest_distance": -0.5, "highest_distance": 2.25,
    }  # fmt: skip
    assert replace(field, lethal_threshold=50, unknown="occupied").figures()["obstacles"] == 4
    for endless in (np.inf, -np.inf):
        figures = replace(field, distance=np.where(distance == 0.75, endless, distance)).figures()
        assert (figures["lowest_distance"], figures["highest_distance"]) == (None, None)
    figures = OccupancyGrid([[100, 100, 100, 0, 0], [-1, 1, 99, 50, 98]], 0.25).figures()
    names = ("occupied", "free", "unknown", "between", "width", "height")
    assert [figures[name] for name in names] == [3, 2, 1, 4, 5, 2]


def test_a_cost_curve_ends_at_its_reach_and_rounds_to_the_nearest_distance():
    curve = mapdeal.cost_curve(0.05, inflation_radius=1e300, cost_scaling_factor=0.0)
    assert (curve.reach > 1e12, curve.cost_at_reach) == (True, 252)
    curve = mapdeal.cost_curve(0.05, inflation_radius=2e3, cost_scaling_factor=3.0, lookup="nav2")
    assert (curve.reach, curve.cost_at_reach) == (pytest.approx(2e3), 0)
    assert len(curve.document()["curve"]) < 600
    assert curve.cost_near(np.array([0.49, 0.51, 1.21, 1e9])).tolist() == [254, 216, 203, 0]


GRID = mapdeal.OccupancyGrid([[100, 0, 0, 0, 0, -1], [-1, 0, 0, 30, 0, 100]], 0.25, (1.0, 2.0, 0.3))
METRIC = mapdeal.field_view(mapdeal.esdf(GRID), view_range=0.7)
PER_MAP = mapdeal.field_view(mapdeal.esdf(GRID, strength=1.3), view="per-map")


def test_the_yaml_says_what_the_values_are(tmp_path):
    mapdeal.write_map(tmp_path / "m.yaml", METRIC)
    mapdeal.write_map(tmp_path / "s.yaml", PER_MAP)
    lines = (tmp_path / "m.yaml").read_text().splitlines()
    assert lines[1] == "mode: raw"
    assert lines[-3:] == ["layer: esdf_view", "view: metric", "view_range: 0.7"]
    # (0, 3) and (1, 2) lie farthest from an obstacle, a cell across and two along
    farthest, deepest = PER_MAP.scale.farthest, PER_MAP.scale.deepest
    assert (farthest, deepest) == (pytest.approx(1.3 * 0.25 * 5**0.5), 0.25)
    assert (tmp_path / "s.yaml").read_text().splitlines()[-4:] == [
        "layer: esdf_view", "view: per-map", f"farthest: {farthest!r}", "deepest: 0.25",
    ]  # fmt: skip


def test_another_mode_or_layer_makes_it_a_map(files):
    with pytest.warns(mapdeal.MapdealWarning, match="lost in mode trinary"):
        mapdeal.write_map("t.yaml", METRIC, mode="trinary")
    assert "layer" not in (files / "t.yaml").read_text()
    path = files / "v.yaml"
    path.write_text(path.read_text().replace("esdf_view", "height"))
    for name in ("t.yaml", "v.yaml"):
        assert type(mapdeal.read_map(name)) is mapdeal.OccupancyGrid
    assert type(METRIC.as_amcl_sees_it()) is mapdeal.OccupancyGrid


@pytest.mark.parametrize(("key", "value", "rule"), [
    ("view", None, "needs key view"), ("view", "polar", "must be metric or per-map"),
    ("view", "per-map", "needs keys farthest, deepest"), ("mode", "trinary", "needs mode raw"),
    ("view_range", None, "needs key view_range"), ("view_range", "0", "above 0"),
    ("view_range", ".inf", "must be"), ("cost_scale", "costmap2d", "no cost_scale"),
])  # fmt: skip
def test_a_view_that_is_described_wrongly_is_refused(files, key, value, rule):
    path = files / "v.yaml"
    lines = [line for line in path.read_text().splitlines() if not line.startswith(f"{key}:")]
    path.write_text("\n".join([*lines, *([f"{key}: {value}"] if value is not None else [])]))
    with pytest.raises(mapdeal.MalformedInputError, match=rule):
        mapdeal.read_map(path)


def test_a_part_of_a_view_is_a_view():
    corner = tuple(METRIC.frame.window(0, 1, 1, 1).origin[:2])
    part = mapdeal.window(METRIC, size_xy=(0.5, 0.5), corner_xy=corner)
    assert isinstance(part, mapdeal.FieldView)
    assert part.scale == METRIC.scale
    assert part.occupancy.tolist() == METRIC.occupancy[:2, 1:3].tolist()


@pytest.fixture
def files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    mapdeal.write_map("m.yaml", GRID)
    mapdeal.write_map("v.yaml", METRIC)
    return tmp_path


@pytest.mark.parametrize("view", [{"view": "per-map"}, {"view_range": 1.5}], ids=str)
def test_costs_of_the_view_are_those_of_the_field(command, files, view):
    ((name, value),) = view.items()
    options = [f"--{name.replace('_', '-')}", value]
    words = ["--model", "threshold", *options, "--down", "20", "--up", "50", "--up-factor", "1"]
    for name, more in (("e.npz", []), ("e.yaml", options)):
        assert command("esdf", "m.yaml", "-o", name, "--strength", "1.3", *more)[0] == 0
        assert command("cost", name, "-o", f"{name}.cost.npz", *words)[::2] == (0, "")
    assert (files / "e.npz.cost.npz").read_bytes() == (files / "e.yaml.cost.npz").read_bytes()
    field = mapdeal.esdf(GRID, strength=1.3)
    expected = mapdeal.threshold_cost(field, down=20, up=50, up_factor=1, **view)
    assert np.array_equal(mapdeal.read_map("e.yaml.cost.npz").cost, expected.cost)


READ_AS_A_MAP = (
    "warning: v.yaml: is the 0..100 view of a distance field; its values are read as a map's\n"
)
NEEDS_A_MAP = "error: v.yaml: "


@pytest.mark.parametrize("words", [
    "active v.yaml -o o.npz", "inflate v.yaml -o o.npz", "esdf v.yaml -o o.npz",
    "run v.yaml -o o --recipe design-sim", "run v.yaml -o o --recipe arena",
    "local --map v.yaml --pose 1,2,0 --size 1,1 -o o", "pack v.yaml -o o.pbm",
    "query v.yaml --at 1,2", "diff v.yaml m.yaml", "score v.yaml", "score m.yaml --truth v.yaml",
    "align v.yaml m.yaml", "route v.yaml --from 1.5,2.5 --to 1.5,2.5",
])  # fmt: skip
def test_what_takes_maps_says_that_it_takes_the_values_of_a_view(command, files, words):
    assert command(*words.split())[2].count(READ_AS_A_MAP) == 1


@pytest.mark.parametrize(("words", "code", "message"), [
    ("run v.yaml -o o --strict", 1, READ_AS_A_MAP),
    ("run v.yaml -o o --strict --recipe nav2", 1, "--strict allows none; nothing was written"),
    ("clean v.yaml -o o.yaml", 2, NEEDS_A_MAP),
    ("merge v.yaml m.yaml -o o.yaml", 2, NEEDS_A_MAP),
    ("potential v.yaml -o o.npz", 2, NEEDS_A_MAP),
    ("reach v.yaml --from 1.5,2.5", 2, NEEDS_A_MAP),
])  # fmt: skip
def test_what_needs_a_map_refuses_a_view(command, files, words, code, message):
    found, _, err = command(*words.split())
    assert (found, err.count(message)) == (code, 1)
    assert not list(files.glob("o*"))


def test_info_tells_the_view(command, files):
    out = command("info", "v.yaml")[1]
    assert "view of a distance field" in out
    assert "metric, 0 at 0.7 m" in out


def test_another_layer_of_an_npz_is_refused(tmp_path):
    path = tmp_path / "v.npz"
    mapdeal.write_map(path, METRIC)
    np.savez(path, **{**np.load(path), "layer": np.array("height")})
    with pytest.raises(mapdeal.MalformedInputError, match="layer: must be one of esdf_view"):
        mapdeal.read_map(path)
