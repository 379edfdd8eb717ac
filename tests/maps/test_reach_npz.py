"""What a robot can reach, in npz files: written, described, and read as the map it is of."""

import json

import numpy as np
import pytest

import mapdeal
from drawn import grid_from_text
from mapdeal import Footprint, MalformedInputError, MapdealWarning, ParameterError, Reach
from mapdeal.grid.canvas import on_canvas
from mapdeal.maps.npz import read_reach
from mapdeal.pipeline.folder import summary_of

MAP = grid_from_text("""
    #...?
    #.#.?
    #####
""", 0.25)  # fmt: skip
SHAPE = Footprint.polygon([(0.2, 0.1), (-0.1, 0.1), (-0.1, -0.1)])


def reach(**more):
    """A reach by hand: all free cells except one are open, and the two on the left are reached."""
    is_free = MAP.occupancy == 0
    headings = is_free * np.uint8(8)
    headings[2, 3] = 0
    reachable = is_free * np.uint8(1)
    reachable[:, 2:] = 0
    clearance = np.where(MAP.occupancy == 100, 0, 0.25).astype(np.float32)
    chosen = {"start": (1.5, -2.0, 0.5), "robot": SHAPE, "heading_count": 8, **more}
    return Reach(reachable, headings, clearance, clearance * reachable, MAP.occupancy, 0.25,
                 MAP.origin, **chosen)  # fmt: skip


@pytest.fixture
def path(tmp_path):
    mapdeal.write_map(tmp_path / "r.npz", reach())
    return tmp_path / "r.npz"


@pytest.mark.parametrize("more", [
    {},
    {"start": (1.5, -2.0), "robot": Footprint.circle(0.1), "through_unknown": True},
    {"robot": None, "heading_count": 255},
])  # fmt: skip
def test_it_is_read_as_it_was_written(tmp_path, more):
    grid = reach(**more)
    mapdeal.write_map(tmp_path / "r.npz", grid)
    again = read_reach(tmp_path / "r.npz")
    for name in Reach.layer_names:
        np.testing.assert_array_equal(getattr(again, name), getattr(grid, name))
        assert getattr(again, name).dtype == getattr(grid, name).dtype
    for name in ("resolution", "origin", *Reach.parameter_names):
        assert getattr(again, name) == getattr(grid, name), name
    with np.load(tmp_path / "r.npz") as arrays:  # as any other program sees it
        assert arrays["start"].tolist() == list(grid.start)


def test_as_a_map_it_is_the_one_that_was_looked_at_with_one_warning(path):
    with pytest.warns(MapdealWarning, match="is a result of reach; only its map is used") as caught:
        again = mapdeal.read_map(path)
    assert len(caught) == 1
    assert (type(again), again.frame) == (mapdeal.OccupancyGrid, MAP.frame)
    np.testing.assert_array_equal(again.occupancy, MAP.occupancy)


def test_info_names_the_layers(command, path):
    code, out, err = command("info", path)
    assert (code, err) == (0, "")
    lines = dict(line.split(maxsplit=1) for line in out.splitlines()[1:])
    layers = "reachable, headings, clearance, widest, occupancy"
    assert (lines["kind"], lines["layers"]) == ("reach", layers)
    # 5 free cells of 1/16 m2, 4 of them open, 2 reached
    assert lines["area"] == "from 1.5, -2 the robot reaches 0.125 of 0.25 m2 open to it"
    assert "8 headings, unknown closed" in out
    report = json.loads(command("info", path, "--json")[1])
    assert (report["free_m2"], report["start"]) == (5 / 16, [1.5, -2.0, 0.5])
    assert report["share"] == pytest.approx(2 / 5)
    assert not {"goals", "passages", "closed_passages"} & set(report)


def test_the_answers_are_summed_up_in_a_line():
    passage = mapdeal.Passage(1.5, -2.0, 0.8, 12.0, False, ((1.0, -2.0), (2.0, -2.0)))
    goals = [
        mapdeal.GoalReach(mapdeal.Goal(k, 0.5, name), k == 0, k == 0, 0.4)
        for k, name in enumerate(["kitchen", "hall", None, "lift", "stairs"])
    ]
    summary = summary_of(reach(goals=tuple(goals), passages=(passage,)).figures())
    assert summary == (
        "from 1.5, -2 the robot reaches 0.125 of 0.25 m2 open to it; "
        "1 of 5 goals (not hall, 2,0.5, lift and 1 more); 1 passage, 1 closed"
    )


@pytest.mark.parametrize(("name", "value", "message"), [
    ("start", np.array([1.0, np.nan]), "start: must be finite"),
    ("start", np.array([1.0]), r"start: must have shape \(2,\)"),
    ("heading_count", np.uint8(0), "heading_count: must be from 1 to 255"),
    ("widest", np.zeros((2, 5), np.float32), "of one shape"),
    ("headings", np.zeros((3, 5), np.int32), "headings: must be uint8"),
    ("robot", np.zeros((3, 5)), r"robot: must have shape \(3, 2\)"),
    ("clearance", None, "clearance: missing key"),
])  # fmt: skip
def test_damaged_ones_are_refused(command, path, name, value, message):
    with np.load(path) as arrays:
        remaining = {key: arrays[key] for key in arrays if key != name}
    np.savez(path, **remaining, **({} if value is None else {name: value}))
    with pytest.raises((MalformedInputError, ParameterError), match=message):
        read_reach(path)
    code, _, err = command("info", path)
    assert (code, err.count("\n")) == (3, 1)


def test_it_only_fits_an_npz_and_a_byte_counts_no_more_headings(tmp_path):
    with pytest.raises(ParameterError, match=r"heading_count: must be from 1 to 255"):
        reach(heading_count=256)
    with pytest.raises(ParameterError, match="a reach is written as npz"):
        mapdeal.write_map(tmp_path / "r.yaml", reach())


@pytest.mark.parametrize(("through_unknown", "free_area"), [(False, 5 / 16), (True, 7 / 16)])
def test_on_a_larger_canvas_nothing_around_it_is_counted(through_unknown, free_area):
    grid = reach(through_unknown=through_unknown, start=(1.5, -2.0))
    extended = on_canvas(grid, grid.frame.window(-1, -2, 6, 9))
    for name in ("reachable_area", "open_area", "free_area", "share"):
        assert getattr(extended, name) == getattr(grid, name)
    assert extended.free_area == pytest.approx(free_area)
