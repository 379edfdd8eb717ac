"""``lint --graph``: findings in a route graph on its map."""

import json

import pytest

import mapdeal
from drawn import grid_from_text
from mapdeal import Footprint, write_map
from mapdeal.checks.findings import CHECKS
from maps.geojson import collection, edge, node

HALL = """
    ####################
    #........#.........#
    #........#.........#
    #........#.........#
    #..................#
    #..................#
    #........#.........#
    #........#......????
    ####################
"""
CELLS = {0: (1.5, 2.5), 1: (4.0, 5.0), 2: (4.0, 14.0), 3: (6.5, 14.0)}
"""Nodes by continuous row and column, rows from the south."""


@pytest.fixture
def linted(tmp_path):
    grid = grid_from_text(HALL)
    write_map(tmp_path / "hall.yaml", grid)

    def run(cells, edges, *, robot=0.2, shift=0.0, **properties):
        points = grid.frame.xy_from_continuous_rowcol(list(cells.values())).round(6).tolist()
        nodes = [node(number, x + shift, y, **properties)
                 for number, (x, y) in zip(cells, points, strict=True)]  # fmt: skip
        path = tmp_path / "g.geojson"
        lines = [edge(100 + k, *ends) for k, ends in enumerate(edges)]
        path.write_text(json.dumps(collection(*nodes, *lines)))
        return mapdeal.lint(tmp_path / "hall.yaml", graph=path, select=["graph", "file"],
                            footprint=Footprint.circle(robot))  # fmt: skip

    return run


def both(*pairs):
    return [*pairs, *((b, a) for a, b in pairs)]


ROUND = both((0, 1), (1, 2), (2, 3))
CASES = [
    ("graph.node-closed", {**CELLS, 3: (0.5, 14.0)}, ROUND, {}, "in an obstacle"),
    ("graph.node-closed", {**CELLS, 3: (1.5, 17.5)}, ROUND, {}, "in unknown space"),
    ("graph.node-closed", {**CELLS, 3: (4.0, 25.0)}, ROUND, {}, "outside of the map"),
    ("graph.node-closed", {**CELLS, 0: (1.5, 1.5)}, ROUND, {"robot": 0.3}, "too near"),
    ("graph.edge-blocked", CELLS, both((0, 1), (1, 2), (2, 3), (0, 2)), {}, "cannot pass"),
    ("graph.parts", CELLS, both((0, 1), (2, 3)), {}, "2 nodes (2, 3) not connected"),
    ("graph.missing-end", CELLS, [*ROUND, (2, 9)], {}, "edge 106 ends at node 9, which does not"),
    ("graph.one-way", CELLS, [*both((0, 1), (1, 2)), (2, 3)], {}, "(3) can be entered"),
    ("graph.one-way", CELLS, [*both((0, 1), (1, 2)), (3, 2)], {}, "(3) can be left"),
    ("graph.other-frame", CELLS, ROUND, {"shift": 900.0},
     ("4 of 4 nodes lie outside of the map: they cover x 901.9 .. 904.3, y -1.411 .. 0.8597, "
      "the map x 0.6238 .. 6.105, y -2 .. 2.019; coordinates must be metres in the frame map")),
    ("graph.other-frame", CELLS, ROUND, {"frame": "odom"}, "odom"),
]  # fmt: skip


@pytest.mark.parametrize(("check", "cells", "edges", "options", "text"), CASES)
def test_a_mistake_is_found_where_it_is(linted, check, cells, edges, options, text):
    finding, *extra = linted(cells, edges, **options)
    assert not extra or options == {"robot": 0.3}  # the door is too narrow for it, too
    assert finding.check == check
    assert text in finding.message
    assert finding.file.endswith("g.geojson")
    assert bool(finding.places) is (check != "graph.other-frame")


def test_every_check_of_graphs_has_a_case():
    of_files = {"refused", "double-id", "shared-id", "whole-number", "mixed-limits"}
    covered = {case[0] for case in CASES} | {f"graph.{name}" for name in of_files}
    assert covered == {name for name in CHECKS if name.startswith("graph.")}


def test_a_good_graph_has_no_finding_and_many_of_a_check_are_summarised(linted):
    assert list(linted(CELLS, ROUND)) == []
    found = list(linted({number: (0.5, 1 + number / 4) for number in range(60)}, both((0, 1))))
    closed = [finding for finding in found if finding.check == "graph.node-closed"]
    assert len(closed) == 21
    assert closed[-1].message.startswith("40 more of the same")
    assert len(closed[-1].places) == 40


def test_findings_of_a_graph_stand_in_the_map_s_entry(command, tmp_path, linted, monkeypatch):
    monkeypatch.chdir(tmp_path)
    linted({**CELLS, 3: (0.5, 14.0)}, ROUND)
    code, out, _ = command("lint", "hall.yaml", "--graph", "g.geojson", "--format", "json")
    (entry,) = json.loads(out)["maps"]
    assert (code, entry["file"]) == (1, "hall.yaml")
    assert [finding["file"] for finding in entry["findings"] if "file" in finding] == ["g.geojson"]
    code, out, _ = command("lint", "hall.yaml", "--graph", "g.geojson", "--format", "sarif")
    results = json.loads(out)["runs"][0]["results"]
    locations = [result["locations"][0]["physicalLocation"] for result in results]
    assert "g.geojson" in [location["artifactLocation"]["uri"] for location in locations]
    for words in (["--graph", "g.geojson"], ["hall.yaml", "no.yaml", "--graph", "g.geojson"],
                  ["hall.yaml", "--graph", "g.geojson", "--fix", "--in-place"]):  # fmt: skip
        assert command("lint", *words)[0] == 2
    assert command("lint", "hall.yaml", "--graph", "no.geojson")[0] == 1
