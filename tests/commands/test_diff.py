import json
from pathlib import Path

import numpy as np
import pytest

import mapdeal
from drawn import grid_from_text

FILES = ("before.yaml", "after.yaml")


@pytest.fixture(autouse=True)
def files(here):
    before, after = "?.#....?\n?.#....?\n?......?", "?..#...?\n?..#...?\n?.....??"
    for path, text in zip(FILES, (before, after), strict=True):
        mapdeal.write_map(path, grid_from_text(f"????????\n{text}"))


def test_what_differs_is_counted_by_hand():
    report = mapdeal.diff(*FILES)
    assert report.confusion["free"] == {"occupied": 2, "free": 13, "unknown": 1, "between": 0}
    assert report.confusion["occupied"] == {"occupied": 0, "free": 2, "unknown": 0, "between": 0}
    assert repr(report) == (
        "DiffReport(different, 5 of 32 common cells differ, "
        "directed Hausdorff distance A to B: 0.25 m, directed Hausdorff distance B to A: 0.25 m)"
    )


# Walls are 0.25 m away, and 5 of 32 cells differ: 15.6 %.
@pytest.mark.parametrize(("arguments", "beyond", "passes"), [
    ({"tolerance": 1}, 0, True), ({"max_shift": 0.25}, 5, True), ({"max_shift": 0.2}, 5, False),
    ({"max_differing": 16}, 5, True), ({"max_shift": 1, "max_differing": 15}, 5, False),
    ({}, 5, False),
], ids=str)  # fmt: skip
def test_the_document_is_what_the_command_prints(command, arguments, beyond, passes):
    after = Path("after.yaml")
    after.write_text(after.read_text().replace("0.65", "0.6"))
    words = [f"--{name.replace('_', '-')}={value}" for name, value in arguments.items()]
    code, out, _ = command("diff", *FILES, "--json", *words)
    report = mapdeal.diff(*FILES, **arguments)
    assert report.document() == json.loads(out)
    assert (report.differing, report.beyond_tolerance) == (5, beyond)
    assert bool(report.document()["changes"]) == (beyond > 0)
    assert (code == 0, report.passes) == (passes, passes)
    if report.bounds:
        assert ("within the bounds" if passes else "beyond the bounds") in repr(report)
    assert report.metadata == {"occupied_thresh": (0.65, 0.6)}
    assert "occupied_thresh 0.65 -> 0.6" in repr(report)


def test_grids_and_files_are_compared_alike():
    grids = [mapdeal.read_map(path) for path in FILES]
    by_files = mapdeal.diff(*FILES)
    for pair in (grids, (FILES[0], grids[1]), (grids[0], Path(FILES[1]))):
        report = mapdeal.diff(*pair)
        nameless = {"first": None, "second": None}
        assert {**report.document(), **nameless} == {**by_files.document(), **nameless}
        assert np.array_equal(report.changes, by_files.changes)
        assert report.frame == by_files.frame
    assert mapdeal.diff(grids[0], grids[0]).is_equal


def test_costs_are_compared_as_ros_publishes_them():
    grid = mapdeal.read_map(FILES[0])
    costs = mapdeal.exponential_cost(grid, inflation_radius=0.25)
    with pytest.warns(mapdeal.MapdealWarning, match="map B: contains costs"):
        report = mapdeal.diff(grid, costs)
    assert report.confusion["occupied"]["occupied"] == 2
    assert mapdeal.diff(grid, mapdeal.esdf(grid)).is_equal
