"""The view of a field as a grid, and on its way through files."""

import numpy as np
import pytest

import mapdeal
from drawn import grid_from_text

GRID = mapdeal.OccupancyGrid([[100, 0, 0, 0, 0, -1], [-1, 0, 0, 30, 0, 100]], 0.25, (1.0, 2.0, 0.3))
METRIC = mapdeal.field_view(mapdeal.esdf(GRID), view_range=0.7)
PER_MAP = mapdeal.field_view(mapdeal.esdf(GRID, strength=1.3), view="per-map")
STEPS = mapdeal.field_view(mapdeal.esdf(grid_from_text("#...\n....", 5.0)), view_range=1.0)
"""Obstacles and free cells alone, which is written raw all the same."""


@pytest.mark.parametrize("ending", [".yaml", ".npz"])
@pytest.mark.parametrize("view", [METRIC, PER_MAP, STEPS])
def test_a_view_comes_back_from_its_files(tmp_path, ending, view):
    mapdeal.write_map(tmp_path / f"v{ending}", view)
    back = mapdeal.read_map(tmp_path / f"v{ending}")
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
    ("view", None, "needs key view"),
    ("view", "polar", "must be metric or per-map"),
    ("view_range", None, "needs key view_range"),
    ("view_range", "0", "above 0"),
    ("view_range", ".inf", "must be"),
    ("view", "per-map", "needs keys farthest, deepest"),
    ("mode", "trinary", "needs mode raw"),
    ("cost_scale", "costmap2d", "no cost_scale"),
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
    assert command("esdf", "m.yaml", "-o", "e.npz", "--strength", "1.3")[0] == 0
    assert command("esdf", "m.yaml", "-o", "e.yaml", "--strength", "1.3", *options)[0] == 0
    words = ["--model", "threshold", *options, "--down", "20", "--up", "50", "--up-factor", "1"]
    for name in ("e.npz", "e.yaml"):
        assert command("cost", name, "-o", f"{name}.cost.npz", *words)[::2] == (0, "")
    assert (files / "e.npz.cost.npz").read_bytes() == (files / "e.yaml.cost.npz").read_bytes()
    field = mapdeal.esdf(GRID, strength=1.3)
    expected = mapdeal.threshold_cost(field, down=20, up=50, up_factor=1, **view)
    assert np.array_equal(mapdeal.read_map("e.yaml.cost.npz").cost, expected.cost)


READ_AS_A_MAP = (
    "warning: v.yaml: is the 0..100 view of a distance field; its values are read as a map's\n"
)
NEEDS_A_MAP = "error: v.yaml: "


@pytest.mark.parametrize(
    "words",
    ["active v.yaml -o o.npz", "inflate v.yaml -o o.npz", "esdf v.yaml -o o.npz",
     "run v.yaml -o o --recipe design-sim", "run v.yaml -o o --recipe arena",
     "local --map v.yaml --pose 1,2,0 --size 1,1 -o o", "pack v.yaml -o o.pbm",
     "query v.yaml --at 1,2", "diff v.yaml m.yaml", "score v.yaml", "score m.yaml --truth v.yaml",
     "align v.yaml m.yaml", "route v.yaml --from 1.5,2.5 --to 1.5,2.5"],
)  # fmt: skip
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
