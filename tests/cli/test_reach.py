"""``mapdeal reach``: what it prints, what it writes, and how it ends."""

import json

import numpy as np
import pytest

from drawn import grid_from_text
from mapdeal import write_map

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
def rooms(tmp_path):
    grid = grid_from_text(ROOMS)  # 0.25 m, origin and yaw not 0
    write_map(tmp_path / "rooms.yaml", grid)
    return grid, tmp_path / "rooms.yaml"


def test_the_answer_on_stdout(command, rooms):
    grid, path = rooms
    code, out, err = command(
        "reach", path, "--from", place(grid, 3, 2), "--to", place(grid, 3, 12),
        f"kitchen={place(grid, 1, 13)}", "--robot-radius", 0.24, "--min-area", 0.2,
    )  # fmt: skip
    answer = json.loads(out)
    assert (code, err) == (0, "")
    assert list(answer) == [
        "robot", "start", "through_unknown", "reachable_m2", "open_m2", "free_m2", "share",
        "goals", "passages",
    ]  # fmt: skip
    free = np.count_nonzero(grid.occupancy == 0) * 0.25**2
    assert answer["robot"] == {"radius": 0.24, "headings": 72}
    assert answer["reachable_m2"] == answer["free_m2"] == pytest.approx(free)
    assert answer["share"] == 1.0
    first, second = answer["goals"]
    assert (first["reachable"], first["heading_count"], second["name"]) == (True, 72, "kitchen")
    assert first["widest_radius_m"] == 0.25
    assert first["limited_by"]["width_m"] == 0.5
    (passage,) = answer["passages"]
    assert passage["open"]
    assert passage["width_m"] == 0.5
    # the door is two cells deep: its middle is that of one of them
    middles = grid.frame.xy_from_rowcol([(3, 7), (3, 8)])
    assert min(np.hypot(*(middles - [passage["x"], passage["y"]]).T)) < 1e-6


def test_a_goal_that_is_cut_off_ends_with_1(command, rooms, tmp_path):
    grid, path = rooms
    code, out, err = command(
        "reach", path, "--from", place(grid, 3, 2), "--to", f"kitchen={place(grid, 3, 12)}",
        "--robot-radius", 0.25, "-o", tmp_path / "out.json", "--layers", tmp_path / "out.npz",
        "--image", tmp_path / "out.png",
    )  # fmt: skip
    assert code == 1
    assert "0 of 1 goal, not kitchen" in out
    assert "(kitchen) is not reachable: a passage at" in err
    assert "is 0.5 m wide; the robot needs more than 0.5 m" in err
    answer = json.loads((tmp_path / "out.json").read_text())
    assert not answer["goals"][0]["reachable"]
    with np.load(tmp_path / "out.npz") as file:
        layers = dict(file)
    types = {"reachable": "uint8", "headings": "uint8", "clearance": "float32", "widest": "float32"}
    assert {name: str(layers[name].dtype) for name in types} == types
    assert layers["reachable"].sum() * 0.25**2 == answer["reachable_m2"]
    assert (tmp_path / "out.png").read_bytes()[:4] == b"\x89PNG"


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--from", "50,50"], "start: lies outside of the map"),
        (["--headings", "3"], "headings"),
        (["--from", "1"], "--from: must be two numbers X,Y, got '1'"),
        (["--from", "1,2,"], "--from: must be three numbers X,Y,YAW, got '1,2,'"),
        (["--from", "1,2,x"], "--from: must be three numbers X,Y,YAW, got '1,2,x'"),
        (["--from", "1,2,3,4"], "--from: must be three numbers X,Y,YAW, got '1,2,3,4'"),
        (["--to", "kitchen=1"], "--to"),
        (["--to", "kitchen=1,2,lab=3,4"], "--to: must be [NAME=]X,Y"),  # one goal of an odd name
        (["-o", "out.txt"], "must end in .json"),
        (["--layers", "out.json"], "must end in .npz"),
        (["--robot-radius", "-1"], "radius"),
        (["--robot-radius", "1001"], "radius must be a finite number of metres above 0, 1000 at"),
        (["--points", "none.csv"], "none.csv"),
    ],
)
def test_what_is_refused(command, rooms, words, told):
    code, out, err = command("reach", rooms[1], *words)
    assert code == (4 if "--points" in words else 2)
    assert out == ""
    assert told in err


def test_closed_cells_are_refused_with_the_nearest_open_one(command, rooms):
    grid, path = rooms
    code, out, err = command("reach", path, "--from", place(grid, 3, 0), "--robot-radius", 0.26)
    assert (code, out) == (2, "")
    assert "lies in a closed cell (an obstacle)" in err
    assert "the nearest open cell is 0.5 m away" in err
    code, _, err = command("reach", path, "--from", place(grid, 3, 1), "--robot-radius", 0.26)
    assert code == 2
    assert "0.25 m from an obstacle, the robot's radius is 0.26 m" in err


def test_goals_in_closed_cells_are_not_reached_and_the_others_are_answered(
    command, rooms, tmp_path
):
    grid, path = rooms
    wall, ahead, beyond = place(grid, 3, 0), place(grid, 3, 4), place(grid, 3, -4)
    code, out, err = command(
        "reach", path, "--from", place(grid, 3, 2), "--to", f"wall={wall}", ahead, f"lab={beyond}",
        "--robot-radius", 0.24, "--image", tmp_path / "out.png",
    )  # fmt: skip
    assert code == 1
    assert "(wall) is not reachable: its cell is an obstacle; nor are 1 more of 3 goals" in err
    goals = json.loads(out)["goals"]
    assert [one["reachable"] for one in goals] == [False, True, False]
    assert [one["reason"] for one in goals] == ["an obstacle", None, "outside of the map"]
    x, y = map(float, place(grid, 3, 1).split(","))
    near = {"x": pytest.approx(x, abs=2e-6), "y": pytest.approx(y, abs=2e-6)}
    assert [one["nearest_open"] for one in goals] == [near, None, near]
    assert f"hint: the nearest open cell is at {x},{y}" in err
    (tmp_path / "out.json").write_text(out)
    code, _, _ = command("report", path, tmp_path / "out.json", "-o", tmp_path / "out.html")
    assert code == 0
    assert "goal wall: not reachable: its cell is an obstacle" in (tmp_path / "out.html").read_text(
        encoding="utf-8"
    )


def test_a_map_without_an_open_cell_is_malformed(command, rooms):
    code, out, err = command("reach", rooms[1], "--robot-radius", 5)
    assert (code, out) == (3, "")
    assert "no cell is open to a robot of radius 5 m" in err


def test_what_the_tool_chose_is_said(command, rooms):
    _, _, err = command("reach", rooms[1])
    assert "no start is given: it is" in err
    assert "no robot is given" in err


def test_goals_from_a_file(command, rooms, tmp_path):
    grid, path = rooms
    goals = tmp_path / "goals.csv"
    goals.write_text(f"{place(grid, 3, 2)}\n{place(grid, 3, 12)}\n")
    code, out, _ = command("reach", path, "--points", goals, "--robot-radius", 0.2)
    assert code == 0
    assert [goal["reachable"] for goal in json.loads(out)["goals"]] == [True, True]
    x, y = place(grid, 3, 12).split(",")
    lab = f'{{"name": "lab", "x": {x}, "y": {y}}}'
    goals.write_text(f"kitchen={place(grid, 3, 2)}\n{lab}\n")
    code, out, _ = command("reach", path, "--points", goals, "--robot-radius", 0.2)
    assert code == 0
    assert [goal["name"] for goal in json.loads(out)["goals"]] == ["kitchen", "lab"]
    for text, told in (("1,2\nkitchen\n", "line 2"), ("", "holds no points")):
        goals.write_text(text)
        code, _, err = command("reach", path, "--points", goals, "--robot-radius", 0.2)
        assert code == 3
        assert told in err


def test_a_footprint_around_another_place_is_warned_of(command, rooms):
    ahead = "[[0.9,0.1],[0.9,-0.1],[0.5,-0.1],[0.5,0.1]]"
    code, _, err = command("reach", rooms[1], "--footprint", ahead)
    assert code == 0
    assert "lies outside" in err


def test_the_map_of_a_robot_s_own_parameters(command, tmp_path):
    """Unknown is free where the costmap does not track it, and 40 is lethal where the file says."""
    grid = grid_from_text("#####\n#.?.#\n#####", resolution=0.5)
    write_map(tmp_path / "map.yaml", grid)
    parameters = tmp_path / "robot.yaml"
    for tracks in (True, False):
        parameters.write_text(
            "global_costmap: {global_costmap: {ros__parameters: {robot_radius: 0.2, "
            f"track_unknown_space: {str(tracks).lower()}, plugins: [static_layer], "
            'static_layer: {plugin: "nav2_costmap_2d::StaticLayer"}}}}\n'
        )
        code, out, err = command(
            "reach", tmp_path / "map.yaml", "--from", place(grid, 1, 1), "--to", place(grid, 1, 3),
            "--params-file", parameters,
        )  # fmt: skip
        assert code == int(tracks)
        told = "costmap treats unknown cells as free, 6.67 % of the map: the robot drives through"
        assert (told in err) == (not tracks)
        radius = json.loads(out)["robot"]["radius"]
        assert radius == pytest.approx((0.2 + 0.01) * np.cos(np.pi / 16), abs=0.01)


def test_costs_around_obstacles_hide_no_unknown_cells(command, tmp_path):
    grid = grid_from_text("#######\n#.....#\n#.....#\n#??...#\n#######", resolution=0.25)
    write_map(tmp_path / "map.yaml", grid)
    parameters = tmp_path / "robot.yaml"
    parameters.write_text(
        "global_costmap: {global_costmap: {ros__parameters: {robot_radius: 0.2, "
        "track_unknown_space: true, plugins: [static_layer, inflation_layer], "
        'static_layer: {plugin: "nav2_costmap_2d::StaticLayer"}, '
        'inflation_layer: {plugin: "nav2_costmap_2d::InflationLayer", inflate_unknown: true, '
        "inflation_radius: 0.6}}}}\n"
    )
    layers = tmp_path / "out.npz"
    code, out, _ = command(
        "reach", tmp_path / "map.yaml", "--from", place(grid, 2, 2), "--params-file", parameters,
        "--layers", layers,
    )  # fmt: skip
    assert code == 0
    assert json.loads(out)["free_m2"] == 13 * 0.25**2
    with np.load(layers) as file:
        assert file["occupancy"][1].tolist() == [100, -1, -1, 0, 0, 0, 100]
