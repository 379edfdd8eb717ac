"""Comparisons from Python: what the command says, of files and of grids."""

import hashlib
import json

import numpy as np
import pytest

import mapdeal
from drawn import grid_from_text
from mapdeal.commands.report_documents import read_results

BEFORE = """
    ????????
    ?.#....?
    ?.#....?
    ?......?
"""
AFTER = """
    ????????
    ?..#...?
    ?..#...?
    ?.....??
"""


@pytest.fixture
def files(tmp_path):
    paths = [tmp_path / "before.yaml", tmp_path / "after.yaml"]
    for path, text in zip(paths, (BEFORE, AFTER), strict=True):
        mapdeal.write_map(path, grid_from_text(text))
    return paths


def without_names(report):
    return {**report.document(), "first": None, "second": None}


def test_what_differs_is_counted_by_hand(files):
    report = mapdeal.diff(*files)
    assert report.confusion["free"] == {"occupied": 2, "free": 13, "unknown": 1, "between": 0}
    assert report.confusion["occupied"] == {"occupied": 0, "free": 2, "unknown": 0, "between": 0}
    assert repr(report) == (
        "DiffReport(different, 5 of 32 common cells differ, "
        "directed Hausdorff distance A to B: 0.25 m, directed Hausdorff distance B to A: 0.25 m)"
    )


def test_the_document_is_what_the_command_prints(files, command):
    files[1].write_text(files[1].read_text().replace("0.65", "0.6"))
    # Walls are 0.25 m away, and 5 of 32 cells differ: 15.6 %.
    for words, arguments, beyond, passes in [
        (["--tolerance", 1], {"tolerance": 1}, 0, True),
        (["--max-shift", 0.25], {"max_shift": 0.25}, 5, True),
        (["--max-shift", 0.2], {"max_shift": 0.2}, 5, False),
        (["--max-differing", 16], {"max_differing": 16}, 5, True),
        (["--max-shift", 1, "--max-differing", 15],
         {"max_shift": 1, "max_differing": 15}, 5, False),
        ([], {}, 5, False),
    ]:  # fmt: skip
        code, out, _ = command("diff", *files, "--json", *words)
        report = mapdeal.diff(*files, **arguments)
        assert report.document() == json.loads(out)
        assert (report.differing, report.beyond_tolerance) == (5, beyond)
        assert (code == 0, report.passes) == (passes, passes)
        if report.bounds:
            assert ("within the bounds" if passes else "beyond the bounds") in repr(report)
    assert report.metadata == {"occupied_thresh": (0.65, 0.6)}
    assert "occupied_thresh 0.65 -> 0.6" in repr(report)


def test_grids_and_files_are_compared_alike(files):
    grids = [mapdeal.read_map(path) for path in files]
    by_files = mapdeal.diff(*files)
    for pair in (grids, (files[0], grids[1]), (grids[0], str(files[1]))):
        report = mapdeal.diff(*pair)
        assert without_names(report) == without_names(by_files)
        assert np.array_equal(report.changes, by_files.changes)
        assert report.frame == by_files.frame
    assert mapdeal.diff(grids[0], grids[0]).is_equal


def test_costs_are_compared_as_ros_publishes_them(files):
    grid = mapdeal.read_map(files[0])
    costs = mapdeal.exponential_cost(grid, inflation_radius=0.25)
    with pytest.warns(mapdeal.MapdealWarning, match="map B: contains costs"):
        report = mapdeal.diff(grid, costs)
    assert report.confusion["occupied"]["occupied"] == 2
    assert mapdeal.diff(grid, mapdeal.esdf(grid)).is_equal


def test_the_maps_are_named_with_the_checksums_of_their_files(
    files, command, monkeypatch, tmp_path
):
    monkeypatch.chdir(tmp_path)
    mapdeal.write_map("fields.npz", mapdeal.read_map(files[1]))
    code, out, _ = command("diff", "before.yaml", "fields.npz", "--json")
    assert code == 1
    document = json.loads(out)

    def sums(*names):
        return {name: hashlib.sha256((tmp_path / name).read_bytes()).hexdigest() for name in names}

    assert document["first"] == {
        "file": "before.yaml", "sha256": sums("before.yaml", "before.pgm"),
    }  # fmt: skip
    assert document["second"] == {"file": "fields.npz", "sha256": sums("fields.npz")}
    from_python = mapdeal.diff("before.yaml", "fields.npz").document()
    assert from_python == document
    (tmp_path / "d.json").write_text(out)
    _, second = read_results(tmp_path / "d.json").maps
    assert (second.file, second.sha256) == ("fields.npz", sums("fields.npz"))
    grids = mapdeal.diff(*map(mapdeal.read_map, files)).document()
    assert (grids["first"], grids["second"]) == (None, None)
