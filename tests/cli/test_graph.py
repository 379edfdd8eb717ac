"""``mapdeal graph`` and ``route --graph``: what they print and write, and how they end."""

import json
from pathlib import Path

import pytest

from drawn import grid_from_text
from mapdeal import read_map, write_map

ROOMS = "\n".join(["#" * 60, *["#" + "." * 28 + "##" + "." * 28 + "#"] * 9,
                   *["#" + "." * 58 + "#"] * 3,
                   *["#" + "." * 28 + "##" + "." * 28 + "#"] * 9, "#" * 60])  # fmt: skip


@pytest.fixture
def at(here):
    write_map("rooms.yaml", grid_from_text(ROOMS))
    frame = read_map("rooms.yaml").frame

    def place(row, col):
        return ",".join(map(str, frame.xy_from_rowcol([(row, col)])[0].round(6).tolist()))

    return place


def test_the_graph_its_figures_and_its_picture(sh, at):
    line = f"graph rooms.yaml --robot-radius 0.24 --from {at(5, 5)} --to dock={at(9, 50)}"
    found = json.loads(sh.ok(f"{line} -o g.geojson --image g.png --json"))
    document = json.loads(Path("g.geojson").read_text())
    assert found["nodes"] + found["edges"] == len(document["features"])
    assert (found["parts"], found["kinds"]["goal"]) == (1, 1)
    assert found["covered_m2"] == found["reachable_m2"]
    assert found["min_clearance_m"] > 0.24
    assert sh.ok("lint rooms.yaml --graph g.geojson --robot-radius 0.24 --select graph").endswith(
        "1 map: 0 errors, 0 warnings, 0 notes\n"
    )


def test_a_goal_in_a_wall_ends_with_1_and_a_point_is_warned_of(sh, here, at):
    line = "graph rooms.yaml -o g.geojson"
    told = "goal wall is not reachable"
    assert told in sh.err(f"{line} --robot-radius 0.2 --to wall=0,0", 1)
    assert not list(here.glob("g.*"))
    assert "no robot is given" in sh.err(line)


def test_a_route_goes_by_the_graph(sh, at):
    sh.ok(f"graph rooms.yaml --robot-radius 0.24 --to dock={at(9, 50)} -o g.geojson")
    ends = f"--from {at(3, 3)} --to {at(18, 55)}"
    line = f"route rooms.yaml --robot-radius 0.24 {ends}"
    found = json.loads(sh.ok(f"{line} --graph g.geojson --image r.png"))
    alone = json.loads(sh.ok(line))
    assert (found["method"], found["reached"]) == ("graph", True)
    assert alone["length_m"] <= found["length_m"] + 0.5 < 1.3 * alone["length_m"]
    nodes = {tuple(one["geometry"]["coordinates"])
             for one in json.loads(Path("g.geojson").read_text())["features"]
             if one["geometry"]["type"] == "Point"}  # fmt: skip
    assert sum(tuple(point) in nodes for point in found["points"]) > 5
    sh.ok("report rooms.yaml g.geojson -o page.html")
    assert "graph needs --graph" in sh.err(f"{line} --method graph", 2)
    assert "does not apply to method astar" in sh.err(f"{line} --method astar --graph g.geojson", 2)
    text = Path("g.geojson").read_text().replace('"startid": 1,', '"startid": 99999,')
    Path("g.geojson").write_text(text)
    assert "starts at node 99999, which does not exist" in sh.err(f"{line} --graph g.geojson", 3)
