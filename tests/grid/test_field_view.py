"""The view of a field as a grid, and on its way through files."""

import numpy as np
import pytest

import mapdeal
from drawn import grid_from_text

GRID = mapdeal.OccupancyGrid([[100, 0, 0, 0, 0, -1], [-1, 0, 0, 30, 0, 100]], 0.25, (1.0, 2.0, 0.3))
METRIC = mapdeal.field_view(mapdeal.esdf(GRID), view_range=0.7)
PER_MAP = mapdeal.field_view(mapdeal.esdf(GRID, strength=1.3), view="per-map")


@pytest.mark.parametrize("ending", [".yaml", ".png", ".npz"])
@pytest.mark.parametrize("view", [METRIC, PER_MAP])
def test_a_view_comes_back_from_its_files(tmp_path, ending, view):
    mapdeal.write_map(tmp_path / f"v{ending}", view)
    back = mapdeal.read_map(tmp_path / ("v.yaml" if ending == ".png" else f"v{ending}"))
    assert isinstance(back, mapdeal.FieldView)
    assert np.array_equal(back.occupancy, view.occupancy)
    assert (back.scale, back.origin, back.resolution) == (view.scale, view.origin, view.resolution)


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


def test_a_view_of_obstacles_and_free_cells_alone_is_still_raw(tmp_path):
    view = mapdeal.field_view(mapdeal.esdf(grid_from_text("#...\n....", 5.0)), view_range=1.0)
    assert set(np.unique(view.occupancy)) == {0, 100}
    mapdeal.write_map(tmp_path / "v.yaml", view)
    assert "mode: raw" in (tmp_path / "v.yaml").read_text()
    assert isinstance(mapdeal.read_map(tmp_path / "v.yaml"), mapdeal.FieldView)


def test_another_mode_makes_it_a_map(tmp_path):
    with pytest.warns(mapdeal.MapdealWarning, match="lost in mode trinary"):
        mapdeal.write_map(tmp_path / "t.yaml", METRIC, mode="trinary")
    assert "layer" not in (tmp_path / "t.yaml").read_text()
    assert type(mapdeal.read_map(tmp_path / "t.yaml")) is mapdeal.OccupancyGrid


@pytest.mark.parametrize(
    ("key", "value", "rule"),
    [
        ("view", None, "needs key view"),
        ("view", "polar", "must be metric or per-map"),
        ("view_range", None, "needs key view_range"),
        ("view_range", "0", "above 0"),
        ("view_range", ".inf", "must be"),
        ("view_range", "wide", "must be"),
        ("view", "per-map", "needs keys farthest, deepest"),
        ("mode", "trinary", "needs mode raw"),
        ("cost_scale", "costmap2d", "no cost_scale"),
    ],
)
def test_a_view_that_is_described_wrongly_is_refused(tmp_path, key, value, rule):
    path = tmp_path / "v.yaml"
    mapdeal.write_map(path, METRIC)
    lines = [line for line in path.read_text().splitlines() if not line.startswith(f"{key}:")]
    path.write_text("\n".join([*lines, *([f"{key}: {value}"] if value is not None else [])]))
    with pytest.raises(mapdeal.MalformedInputError, match=rule):
        mapdeal.read_map(path)


def test_another_layer_is_no_view(tmp_path):
    path = tmp_path / "v.yaml"
    mapdeal.write_map(path, METRIC)
    path.write_text(path.read_text().replace("esdf_view", "height"))
    assert type(mapdeal.read_map(path)) is mapdeal.OccupancyGrid


def test_a_part_of_a_view_is_a_view():
    corner = tuple(METRIC.frame.window(0, 1, 1, 1).origin[:2])
    part = mapdeal.window(METRIC, size_xy=(0.5, 0.5), corner_xy=corner)
    assert isinstance(part, mapdeal.FieldView)
    assert part.scale == METRIC.scale
    assert part.origin[:2] == pytest.approx(corner)
    assert part.occupancy.tolist() == METRIC.occupancy[:2, 1:3].tolist()
    assert type(METRIC.as_amcl_sees_it()) is mapdeal.OccupancyGrid


@pytest.fixture
def files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    mapdeal.write_map("m.yaml", GRID)
    return tmp_path


@pytest.mark.parametrize("view", [["--view", "per-map"], ["--view-range", "1.5"]])
def test_costs_of_the_view_are_those_of_the_field(command, files, view):
    assert command("esdf", "m.yaml", "-o", "e.npz", "--strength", "1.3")[0] == 0
    assert command("esdf", "m.yaml", "-o", "e.yaml", "--strength", "1.3", *view)[0] == 0
    words = ["--model", "threshold", *view, "--down", "20", "--up", "50", "--up-factor", "1"]
    for name in ("e.npz", "e.yaml"):
        code, _, err = command("cost", name, "-o", f"{name}.cost.npz", *words)
        assert (code, err) == (0, "")
    assert (files / "e.npz.cost.npz").read_bytes() == (files / "e.yaml.cost.npz").read_bytes()
    asked = {"view": "per-map"} if "per-map" in view else {"view_range": 1.5}
    field = mapdeal.esdf(GRID, strength=1.3)
    expected = mapdeal.threshold_cost(field, down=20, up=50, up_factor=1, **asked)
    assert np.array_equal(mapdeal.read_map("e.yaml.cost.npz").cost, expected.cost)


TAKEN = "warning: v.yaml: is the 0..100 view of a distance field; its values are read as a map's\n"


@pytest.mark.parametrize(
    "words",
    ["active v.yaml -o o.npz", "inflate v.yaml -o o.npz", "esdf v.yaml -o o.npz",
     "run v.yaml -o o", "run v.yaml -o o --recipe design-sim", "run v.yaml -o o --recipe arena",
     "local --map v.yaml --pose 1,2,0 --size 1,1 -o o", "pack v.yaml -o o.pbm",
     "query v.yaml --at 1,2", "diff v.yaml m.yaml", "score v.yaml", "score m.yaml --truth v.yaml",
     "align v.yaml m.yaml", "route v.yaml --from 1.5,2.5 --to 1.5,2.5"],
)  # fmt: skip
def test_what_takes_maps_says_that_it_takes_the_values_of_a_view(command, files, words):
    mapdeal.write_map("v.yaml", METRIC)
    assert command(*words.split())[2].count(TAKEN) == 1


@pytest.mark.parametrize("recipe", ["default", "nav2"])
def test_a_strict_run_does_not_take_a_view_for_a_map(command, files, recipe):
    mapdeal.write_map("v.yaml", METRIC)
    code, _, err = command("run", "v.yaml", "-o", "o", "--strict", "--recipe", recipe)
    assert (code, err.count(TAKEN)) == (1, 1)
    assert "--strict allows none; nothing was written" in err
    assert not (files / "o").exists()


@pytest.mark.parametrize(
    "words",
    ["clean v.yaml -o o.yaml", "merge v.yaml m.yaml -o o.yaml", "potential v.yaml -o o.npz",
     "reach v.yaml --from 1.5,2.5"],
)  # fmt: skip
def test_what_needs_a_map_refuses_a_view(command, files, words):
    mapdeal.write_map("v.yaml", METRIC)
    code, _, err = command(*words.split())
    assert code == 2
    assert "error: v.yaml: " in err


def test_info_tells_the_view(command, files):
    mapdeal.write_map("v.yaml", METRIC)
    out = command("info", "v.yaml")[1]
    assert "view of a distance field" in out
    assert "metric, 0 at 0.7 m" in out


def test_another_layer_of_an_npz_is_refused(tmp_path):
    path = tmp_path / "v.npz"
    mapdeal.write_map(path, METRIC)
    np.savez(path, **{**np.load(path), "layer": np.array("height")})
    with pytest.raises(mapdeal.MalformedInputError, match="layer: must be one of esdf_view"):
        mapdeal.read_map(path)
