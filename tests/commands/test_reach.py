import json
import warnings
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import mapdeal
from drawn import grid_from_text
from mapdeal import Goal, reach, read_map, write_map
from mapdeal.commands.reach import Reachability

ROOMS = """
    ################
    #......##......#
    #......##......#
    #..............#
    #......##......#
    #......##......#
    ################
"""


def place(grid, row, col):
    x, y = grid.frame.xy_from_rowcol([(row, col)])[0].round(6).tolist()
    return f"{x},{y}"


@pytest.fixture
def at(here):
    """Where a row and column of the map of rooms lie."""
    grid = grid_from_text(ROOMS)  # 0.25 m, origin and yaw not 0
    write_map("rooms.yaml", grid)
    return lambda row, col: place(grid, row, col)


def test_the_answer_on_stdout(sh, at):
    line = f"reach rooms.yaml --from {at(3, 2)} --to {at(3, 12)} kitchen={at(1, 13)}"
    answer = json.loads(sh.ok(f"{line} --robot-radius 0.24 --min-area 0.2"))
    keys = ["map", "costmap", "robot", "start", "through_unknown", "reachable_m2", "open_m2"]
    assert list(answer) == [*keys, "free_m2", "share", "goals", "passages"]
    grid = read_map("rooms.yaml")
    free = np.count_nonzero(grid.occupancy == 0) * 0.25**2
    assert answer["robot"] == {"radius": 0.24, "headings": 72}
    assert answer["reachable_m2"] == answer["free_m2"] == pytest.approx(free)
    assert answer["share"] == 1.0
    first, second = answer["goals"]
    assert (first["reachable"], first["heading_count"], second["name"]) == (True, 72, "kitchen")
    assert first["widest_radius_m"] == 0.25
    assert first["limited_by"]["width_m"] == 0.5
    (passage,) = answer["passages"]
    assert (passage["open"], passage["width_m"]) == (True, 0.5)
    # the door is two cells deep: its middle is that of one of them
    middles = grid.frame.xy_from_rowcol([(3, 7), (3, 8)])
    assert min(np.hypot(*(middles - [passage["x"], passage["y"]]).T)) < 1e-6


def test_a_goal_that_is_cut_off_ends_with_1(sh, at):
    line = f"reach rooms.yaml --from {at(3, 2)} --to kitchen={at(3, 12)} --robot-radius 0.25"
    code, out, err = sh(f"{line} -o out.json --layers out.npz --image out.png")
    assert (code, "0 of 1 goal (not kitchen)" in out) == (1, True)
    assert "(kitchen) is not reachable: a passage at" in err
    assert "is 0.5 m wide; the robot needs more than 0.5 m" in err
    answer = json.loads(Path("out.json").read_text())
    assert not answer["goals"][0]["reachable"]
    with np.load("out.npz") as file:
        layers = dict(file)
    types = {"reachable": "uint8", "headings": "uint8", "clearance": "float32", "widest": "float32"}
    assert {name: str(layers[name].dtype) for name in types} == types
    assert layers["reachable"].sum() * 0.25**2 == answer["reachable_m2"]
    assert Path("out.png").read_bytes()[:4] == b"\x89PNG"


def test_goals_and_passages_are_lines_on_a_terminal():
    grid = grid_from_text(ROOMS)
    start, far = grid.frame.xy_from_rowcol([(3, 2), (3, 12)]).round(6).tolist()
    goals = [Goal(*far, "lab"), Goal(*start)]
    found = reach(grid, start=start, goals=goals, radius=0.25, min_area=0.2)
    assert [*Reachability(SimpleNamespace(name="m.yaml"), found, "reach").lines()] == [
        ("m.yaml, reach: from 1.734922, -0.950685 the robot reaches 0.8125 of 1.625 m2 "
         "open to it; 1 of 2 goals (not lab); 1 passage, 1 closed"),
        "  goal lab 4.037575,0.022861: not reached; a passage at 2.886,-0.4639 is 0.5 m wide",
        "  goal 1.734922,-0.950685: reached; the room at the start is 1 m wide",
        "  passage 2.886,-0.4639: 0.5 m wide, closed, 0.8125 m2 behind it",
    ]  # fmt: skip


def test_closed_cells_are_refused_with_the_nearest_open_one(sh, at):
    line = "reach rooms.yaml --robot-radius 0.26 --from"
    err = sh.err(f"{line} {at(3, 0)}", 2)
    assert "lies in a closed cell (an obstacle)" in err
    assert "the nearest open cell is 0.5 m away" in err
    message = "0.25 m from an obstacle, the robot's radius is 0.26 m"
    assert message in sh.err(f"{line} {at(3, 1)}", 2)


def test_goals_in_closed_cells_are_not_reached_and_the_others_are_answered(sh, at):
    goals = f"--to wall={at(3, 0)} {at(3, 4)} lab={at(3, -4)}"
    line = f"reach rooms.yaml --from {at(3, 2)} {goals} --robot-radius 0.24 --image out.png"
    code, out, err = sh(line)
    message = "its cell is an obstacle; 1 more of 3 goals is not reachable"
    assert (code, f"(wall) is not reachable: {message}" in err) == (1, True)
    goals = json.loads(out)["goals"]
    assert [goal["reachable"] for goal in goals] == [False, True, False]
    assert [goal["reason"] for goal in goals] == ["an obstacle", None, "outside of the map"]
    x, y = map(float, at(3, 1).split(","))
    near = {"x": pytest.approx(x, abs=2e-6), "y": pytest.approx(y, abs=2e-6)}
    assert [goal["nearest_open"] for goal in goals] == [near, None, near]
    assert f"hint: the nearest open cell is at {x},{y}" in err


@pytest.mark.parametrize(("words", "code", "message"), [
    ("--robot-radius 5", 3, "no cell is open to a robot of radius 5 m"),
    ("", 0, "no start is given: it is"),
    ("", 0, "no robot is given"),
    ("--footprint [[0.9,0.1],[0.9,-0.1],[0.5,-0.1],[0.5,0.1]]", 0, "lies outside"),
])  # fmt: skip
def test_odd_robots_and_defaults_are_reported(sh, at, words, code, message):
    assert message in sh.err(f"reach rooms.yaml {words}", code)


def test_goals_from_a_file_by_name(sh, at):
    (x, y), (west, south) = at(3, 12).split(","), at(3, 2).split(",")
    lines = f'{at(3, 2)}\nkitchen={at(3, 2)}\n{{"name": "lab", "x": {x}, "y": {y}}}\n'
    Path("goals.csv").write_text(lines)
    goals = sh.json("reach rooms.yaml --points goals.csv --robot-radius 0.2")["goals"]
    found = [(goal.get("name"), goal["reachable"]) for goal in goals]
    assert found == [(None, True), ("kitchen", True), ("lab", True)]
    Path("goals.csv").write_text(f"name,x,y\nkitchen,{x},{y}\nlab,{west},{south}\n")
    points = [
        {"type": "Feature", "properties": {"name": name}, "geometry": {
            "type": "Point", "coordinates": [float(xy[0]), float(xy[1])]}}
        for name, xy in (("kitchen", (x, y)), ("lab", (west, south)))
    ]  # fmt: skip
    document = {"type": "FeatureCollection", "features": points}
    Path("goals.geojson").write_text(json.dumps(document))
    for name in ("goals.csv", "goals.geojson"):
        line = f"reach rooms.yaml --points {name} --robot-radius 0.2"
        both = [(goal["name"], goal["x"], goal["y"]) for goal in sh.json(line)["goals"]]
        assert both == [("kitchen", float(x), float(y)), ("lab", float(west), float(south))]
        chosen = sh.json(f"{line} --to lab dock={at(3, 2)}")["goals"]
        assert [goal["name"] for goal in chosen] == ["lab", "dock"]
        told = f"error: --to: {name} has no such name, got 'kichen'\nhint: did you mean kitchen?\n"
        assert sh.err(f"{line} --to kichen", 2) == told
        sh.ok(f"run rooms.yaml -o out --force --points {name} --to lab")
    for text, message in (("1,2\nkitchen\n", "line 2"), ("", "holds no points")):
        Path("goals.csv").write_text(text)
        assert message in sh.err("reach rooms.yaml --points goals.csv", 3)
    for place in ([], [1], 1, ["a", 2]):
        points[1]["geometry"]["coordinates"] = place
        Path("goals.geojson").write_text(json.dumps(document))
        assert "features[1].geometry.coordinates" in sh.err(line, 3)
    told = sh.err("reach rooms.yaml --robot-radius 0.2 --to lab", 2)
    assert told.endswith("hint: a name alone is that of a point in --points FILE\n")


def write_robot(tracks, layers="", more=""):
    Path("robot.yaml").write_text(
        "global_costmap: {global_costmap: {ros__parameters: {robot_radius: 0.2, "
        f"track_unknown_space: {tracks}, plugins: [static_layer{layers}], "
        f'static_layer: {{plugin: "nav2_costmap_2d::StaticLayer"}}{more}}}}}}}\n'
    )


@pytest.mark.parametrize("tracks", [True, False])
def test_the_map_of_a_robot_s_own_parameters(sh, here, tracks):
    """Unknown is free where the costmap does not track it."""
    grid = grid_from_text("#####\n#.?.#\n#####", resolution=0.5)
    write_map("map.yaml", grid)
    write_robot(str(tracks).lower())
    ends = f"--from {place(grid, 1, 1)} --to {place(grid, 1, 3)}"
    code, out, err = sh(f"reach map.yaml {ends} --params-file robot.yaml")
    message = "costmap treats unknown cells as free, 6.67 % of the map: the robot drives through"
    assert (code, message in err) == (int(tracks), not tracks)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        mapdeal.costmap("map.yaml", "robot.yaml")
    assert any(message in str(warning.message) for warning in caught) != tracks
    lines = ("run map.yaml -o o", "cost map.yaml -o c.npz", f"route map.yaml {ends}",
             f"plan map.yaml {ends}", "graph map.yaml -o g.geojson", "diff map.yaml")  # fmt: skip
    for line in lines:
        more = " --against robot.yaml" if line.startswith("diff") else ""
        assert sh(f"{line} --params-file robot.yaml{more}")[2].count(message) == (not tracks), line
    radius = json.loads(out)["robot"]["radius"]
    assert radius == pytest.approx((0.2 + 0.01) * np.cos(np.pi / 16), abs=0.01)


@pytest.mark.parametrize(
    ("goal", "ending"), [((1, 2), ""), ((1, 4), ", but it is not reachable either")]
)
def test_the_hint_of_a_goal_in_a_wall_names_an_open_cell_and_if_it_is_reached(
    sh, here, goal, ending
):
    grid = grid_from_text("########\n#.###..#\n########", resolution=0.5)
    write_map("map.yaml", grid)
    err = sh(f"reach map.yaml --from {place(grid, 1, 1)} --to {place(grid, *goal)}")[2]
    near = place(grid, 1, 1 if goal[1] == 2 else 5)
    assert err.endswith(f"hint: the nearest open cell is at {near}{ending}\n")
    err = sh(f"reach map.yaml --from {place(grid, 1, 1)} --to {place(grid, 1, 6)}")[2]
    assert err.endswith("hint: --image shows where the robot can go\n")  # nothing is unknown
    divided = grid_from_text("########\n#.#?#..#\n########", resolution=0.5)
    write_map("map.yaml", divided, force=True)
    line = f"reach map.yaml --from {place(grid, 1, 1)} --to {place(grid, 1, 6)}"
    for more in ("", " --through-unknown"):
        assert ("unknown cells are closed" in sh(line + more)[2]) == (not more)


def test_costs_around_obstacles_hide_no_unknown_cells(sh, here):
    grid = grid_from_text("#######\n#.....#\n#.....#\n#??...#\n#######", resolution=0.25)
    write_map("map.yaml", grid)
    inflation = '{plugin: "nav2_costmap_2d::InflationLayer", inflate_unknown: true, '
    inflation += "inflation_radius: 0.6}"
    write_robot("true", ", inflation_layer", f", inflation_layer: {inflation}")
    line = f"reach map.yaml --from {place(grid, 2, 2)} --params-file robot.yaml --layers out.npz"
    assert sh.json(line)["free_m2"] == 13 * 0.25**2
    with np.load("out.npz") as file:
        assert file["occupancy"][1].tolist() == [100, -1, -1, 0, 0, 0, 100]


@pytest.mark.parametrize("around", ["true", "false"])
@pytest.mark.parametrize("tracks", ["true", "false"])
def test_reach_is_that_of_the_robot_s_own_costmap_and_lint_has_its_graph(sh, here, tracks, around):
    rows = ["#" * 40, *["#" + "." * 20 + "?" * 9 + "." * 9 + "#"] * 20, "#" * 40]
    write_map("map.yaml", grid_from_text("\n".join(rows), resolution=0.1))
    inflation = f'{{plugin: "nav2_costmap_2d::InflationLayer", inflate_around_unknown: {around}}}'
    write_robot(tracks, ", inflation_layer", f", inflation_layer: {inflation}")
    sh("run map.yaml -o out --params-file robot.yaml --no-images")
    start = f"--from {place(read_map('map.yaml'), 10, 8)}"
    own = sh.json(f"reach out/map/cost.npz {start} --robot-radius 0.2 --json")
    found = sh.json(f"reach map.yaml {start} --params-file robot.yaml --json")
    assert found["reachable_m2"] == own["reachable_m2"]
    sh(f"graph map.yaml {start} --params-file robot.yaml -o g.geojson")
    line = "lint map.yaml --graph g.geojson --params-file robot.yaml --select graph"
    assert sh.ok(line).endswith("0 errors, 0 warnings, 0 notes\n")


@pytest.fixture
def along(here):
    """Two long rooms and the door between them."""
    walls, rooms = ["#" * 60], ["#" + "." * 28 + "##" + "." * 28 + "#"] * 9
    grid = grid_from_text("\n".join([*walls, *rooms, *["#" + "." * 58 + "#"] * 3, *rooms, *walls]))
    write_map("rooms.yaml", grid)
    return lambda row, col: place(grid, row, col)


def test_the_graph_its_figures_and_its_picture(sh, along):
    line = f"graph rooms.yaml --robot-radius 0.24 --from {along(5, 5)} --to dock={along(9, 50)}"
    found = json.loads(sh.ok(f"{line} -o g.geojson --image g.png --json"))
    document = json.loads(Path("g.geojson").read_text())
    assert found["nodes"] + found["edges"] == len(document["features"])
    assert (found["parts"], found["kinds"]["goal"]) == (1, 1)
    assert found["covered_m2"] == found["reachable_m2"]
    assert found["min_clearance_m"] > 0.24
    out = sh.ok("lint rooms.yaml --graph g.geojson --robot-radius 0.24 --select graph")
    assert out.endswith("1 map: 0 errors, 0 warnings, 0 notes\n")


def test_a_goal_in_a_wall_ends_with_1_and_a_point_is_warned_of(sh, here, along):
    line = "graph rooms.yaml -o g.geojson"
    assert "goal wall is not reachable" in sh.err(f"{line} --robot-radius 0.2 --to wall=0,0", 1)
    assert not list(here.glob("g.*"))
    assert "no robot is given" in sh.err(line)


def test_a_route_goes_by_the_graph(sh, along):
    sh.ok(f"graph rooms.yaml --robot-radius 0.24 --to dock={along(9, 50)} -o g.geojson")
    ends = f"--from {along(3, 3)} --to {along(18, 55)}"
    line = f"route rooms.yaml --robot-radius 0.24 {ends}"
    found = json.loads(sh.ok(f"{line} --graph g.geojson --image r.png"))
    alone = json.loads(sh.ok(line))
    assert (found["method"], found["reached"]) == ("graph", True)
    assert alone["length_m"] <= found["length_m"] + 0.5 < 1.3 * alone["length_m"]
    nodes = {tuple(feature["geometry"]["coordinates"])
             for feature in json.loads(Path("g.geojson").read_text())["features"]
             if feature["geometry"]["type"] == "Point"}  # fmt: skip
    assert sum(tuple(point) in nodes for point in found["points"]) > 5
    sh.ok("report rooms.yaml g.geojson -o page.html")
    assert "graph needs --graph" in sh.err(f"{line} --method graph", 2)
    assert "does not apply to method astar" in sh.err(f"{line} --method astar --graph g.geojson", 2)
    text = Path("g.geojson").read_text().replace('"startid": 1,', '"startid": 99999,')
    Path("g.geojson").write_text(text)
    assert "starts at node 99999, which does not exist" in sh.err(f"{line} --graph g.geojson", 3)
