"""The command that asks for the cost of a robot at poses."""

import json
import subprocess
import sys

import numpy as np
import pytest

from drawn import grid_from_text
from mapdeal import (
    Costmap,
    Footprint,
    OccupancyGrid,
    esdf,
    exponential_cost,
    footprint_costs,
    ring_cost,
    threshold_cost,
    write_map,
)

ROOM = "........\n.#......\n......?.\n...##..."
KEYS = ["x", "y", "yaw", "inside", "cost", "state"]
ROBOT = "[[0.12,0.06],[0.12,-0.06],[-0.12,-0.06],[-0.12,0.06]]"
SHAPE = Footprint.parse(ROBOT)
POINT_OPTIONS = ["--at", "1.6,-1.9"]


@pytest.fixture
def grid():
    return grid_from_text(ROOM, 0.1, (1.5, -2.0, 0.4))


@pytest.fixture
def room(tmp_path, grid):
    write_map(tmp_path / "room.yaml", grid)
    return tmp_path / "room.yaml"


@pytest.fixture
def costs(tmp_path, grid):
    made = exponential_cost(grid, inscribed_radius=0.06, inflation_radius=0.4)
    write_map(tmp_path / "cost.npz", made)
    return tmp_path / "cost.npz", made


def poses_at(grid, *places):
    """Poses at rows and columns of a grid, along its own axes."""
    points = grid.frame.xy_from_continuous_rowcol([place[:2] for place in places])
    yaws = [place[2] + grid.origin[2] for place in places]
    return np.column_stack([points, yaws]).tolist()


def words_of(poses):
    return [word for pose in poses for word in ("--at", ",".join(map(repr, pose)))]


def answered(out):
    return [json.loads(line) for line in out.splitlines()]


def test_answers_are_those_of_the_library(command, costs):
    path, costmap = costs
    poses = poses_at(costmap, (1.5, 5.5, 0), (0.9, 4.5, 0), (1.5, 6.5, 0), (3.6, 4, 1.5), (9, 9, 0))
    code, out, err = command("query", path, "--footprint", ROBOT, *words_of(poses))
    assert (code, err) == (0, "")
    answers = answered(out)
    assert [list(answer) for answer in answers] == [KEYS] * 5
    assert [[answer[key] for key in KEYS[:3]] for answer in answers] == poses
    found = [answer["cost"] for answer in answers]
    assert found == footprint_costs(costmap, SHAPE, poses).tolist()
    states = [answer["state"] for answer in answers]
    assert states == ["unknown", "collision", "free", "outside", "outside"]
    assert [answer["inside"] for answer in answers] == [True, True, True, False, False]


def test_all_states_and_rules_of_a_map(command, room, grid):
    robot = "[[0.14,0.1],[0.14,-0.1],[-0.14,-0.1],[-0.14,0.1]]"
    poses = poses_at(grid, (1.5, 4.5, 0), (1.5, 3.5, 0), (2.5, 5.5, 0), (2.5, 1.5, 0))

    def asked(*words):
        code, out, err = command("query", room, "--footprint", robot, *words_of(poses), *words)
        assert (code, err) == (0, "")
        return [(answer["cost"], answer["state"]) for answer in answered(out)]

    free, hit, unknown = (0, "free"), (254, "collision"), (255, "unknown")
    outline = asked()
    assert outline == [hit, hit, unknown, free]  # stands over the obstacle
    assert asked("--rule", "outline") == outline
    assert asked("--rule", "full") == [hit, hit, unknown, hit]
    assert asked("--unknown", "free") == [hit, hit, free, free]
    assert asked("--unknown", "occupied") == [hit, hit, hit, free]


def test_the_threshold_of_a_map_is_that_of_other_commands(command, tmp_path):
    write_map(tmp_path / "m.npz", OccupancyGrid([[0, 50, 99, 100]], 0.5, (0.0, 0.0, 0.0)))
    poses = [[0.25 + 0.5 * col, 0.25, 0.0] for col in range(4)]
    words = ["query", tmp_path / "m.npz", "--robot-radius", "0.01", *words_of(poses)]

    def found(*more):
        return [answer["cost"] for answer in answered(command(*words, *more)[1])]

    assert found() == [0, 0, 0, 254]
    assert found("--lethal-threshold", 50) == [0, 254, 254, 254]


def test_a_round_robot_is_padded_as_costmap_2d_pads_its_16_corners(command, costs):
    path, costmap = costs
    poses = poses_at(costmap, *np.random.default_rng(0).uniform((1, 1, -3), (3, 7, 3), (80, 3)))
    words = ["query", path, "--robot-radius", "0.05", "--footprint-padding", "0.04"]
    found = [a["cost"] for a in answered(command(*words, *words_of(poses))[1])]
    padded = Footprint.sixteen_gon(0.05).padded(0.04)
    expected = footprint_costs(costmap, padded, poses).tolist()
    assert found == expected
    assert expected != footprint_costs(costmap, Footprint.sixteen_gon(0.09), poses).tolist()


def test_a_file_of_poses_is_answered_line_by_line(command, costs, tmp_path):
    path, costmap = costs
    (x, y, yaw), = poses_at(costmap, (2.5, 4.5, 0))  # fmt: skip
    lines = ["x y theta", f"{x!r} {y!r} {yaw!r}", "1,2", "", f"[{x!r}, {y!r}, {yaw!r}]", "nan 1 2"]
    (tmp_path / "p.txt").write_text("\n".join(lines) + "\n")
    words = ["query", path, "--footprint", ROBOT, "--poses", tmp_path / "p.txt"]
    code, out, err = command(*words)
    answers = answered(out)
    assert code == 0
    assert answers[0] == answers[3]
    assert answers[0]["inside"] is True
    nothing = {"inside": False, "cost": None, "state": None}
    rule = "must be three numbers x,y,yaw, or TUM's t x y z qx qy qz qw, got '1,2'"
    assert answers[1] == {"x": None, "y": None, "yaw": None, **nothing, "line": 3, "error": rule}
    assert answers[2]["error"] == "empty line"
    assert (answers[4]["x"], answers[4]["yaw"], answers[4]["line"]) == (None, 2.0, 6)
    assert err == f"warning: {tmp_path / 'p.txt'}: 3 of 5 hold no finite pose\n"
    code, strict_out, err = command(*words, "--strict")
    assert (code, strict_out) == (1, out)
    assert "3 of 5 poses are not inside of the map" in err


def test_poses_of_options_come_before_those_of_a_file(command, costs, tmp_path):
    path, costmap = costs
    first, second, third = poses_at(costmap, (2.5, 4.5, 0), (2.5, 4.2, 1), (2.2, 4.2, 1))
    (tmp_path / "p.csv").write_text(",".join(map(repr, third)) + "\n")
    words = ["query", path, "--footprint", ROBOT, "--poses", tmp_path / "p.csv", "--at"]
    code, out, _ = command(*words, *(",".join(map(repr, pose)) for pose in (first, second)))
    assert code == 0
    assert [a["yaw"] for a in answered(out)] == [pose[2] for pose in (first, second, third)]


def test_standard_input_is_answered_at_once(costs):
    path, _ = costs
    words = [sys.executable, "-m", "mapdeal", "query", path, "--footprint", ROBOT, "--poses", "-"]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        for yaw in (0.5, 1.5):
            process.stdin.write(f"1.6 -1.9 {yaw}\n".encode())
            process.stdin.flush()
            assert json.loads(process.stdout.readline())["yaw"] == yaw
        process.stdin.close()
        assert process.wait() == 0


def test_degrees_are_warned_of(command, costs):
    path, _ = costs
    code, _, err = command("query", path, "--footprint", ROBOT, "--at", "1.6,-1.9,90", "1.6,-1.9,1")
    assert code == 0
    assert err == "warning: 1 of 2 poses have a yaw of more than a turn; is it in degrees?\n"


@pytest.mark.parametrize("pose", ["nan,1,1", "1,inf,1", "1e308,-1e308,1", "1,1,1e308", "1,1,-inf"])
def test_any_number_is_answered(command, costs, pose):
    code, out, _ = command("query", costs[0], "--footprint", ROBOT, "--at", pose)
    (answer,) = answered(out)
    assert (code, answer["inside"]) == (0, False)
    assert answer["state"] == (None if "n" in pose else "outside")


@pytest.mark.parametrize(
    ("words", "rule"),
    [
        ("--at 1,2", "--at: must be three numbers X,Y,YAW, got '1,2'"),
        ("", "--at, --poses: one of the two is required"),
        ("--points p.csv", "--points: has no yaws; poses of a footprint are given by --poses"),
        ("--at 1,2,3 --convention border", "--convention: applies to distances"),
        ("--at 1,2,3 --robot-radius 1", "cannot be given together with --robot-radius"),
        ("--at 1,2,3 --unknown maybe", "unknown: must be one of free, occupied, got 'maybe'"),
        ("--at 1,2,3 --lethal-threshold 0", "--lethal-threshold: must be a whole number"),
        ("--at 1,2,3 --rule inside", "--rule: must be one of outline, full"),
    ],
)
def test_what_makes_no_sense_is_one_line(command, room, words, rule):
    code, out, err = command("query", room, "--footprint", ROBOT, *words.split())
    assert (code, out) == (2, "")
    assert rule in err.splitlines()[0]
    assert err.startswith("error: ")


@pytest.mark.parametrize(
    ("words", "rule"),
    [
        ("--footprint [[0,0],[1,1]] --at 1,2,3", "needs at least three vertices, got 2"),
        ("--footprint [[-1,0],[1,1],[1,0],[0,1]] --at 1,2,3", "the edge crosses"),
        ("--footprint 5 --at 1,2,3", "must look like [[x1, y1], [x2, y2], ...]"),
        ("--robot-radius 0 --at 1,2,3", "robot radius must be"),
        ("--at 1,2,3", "--at: must be two numbers X,Y, got '1,2,3'"),
        ("--poses p.csv", "--poses: needs --footprint, --robot-radius or --params-file"),
        ("--at 1,2 --rule full", "--rule: needs --footprint, --robot-radius or --params-file"),
        ("--at 1,2 --footprint-padding 1", "--footprint-padding: needs --footprint"),
    ],
)
def test_what_a_robot_needs_is_one_line(command, room, words, rule):
    code, out, err = command("query", room, *words.split())
    assert (code, out) == (2, "")
    assert rule in err.splitlines()[0]
    if words == "--at 1,2,3":
        assert "--footprint or --robot-radius" in err.splitlines()[1]


def test_costs_that_are_made_take_no_parameters_of_a_map(command, costs):
    for option, value in (("--unknown", "free"), ("--lethal-threshold", "50")):
        words = ["--footprint", ROBOT, "--at", "1.6,-1.9,0", option, value]
        code, _, err = command("query", costs[0], *words)
        assert (code, err) == (
            2,
            f"error: {option}: applies to maps: these costs are already computed\n",
        )


def test_fields_and_costs_of_another_scale_are_refused(command, grid, tmp_path):
    ask = ["--footprint", ROBOT, "--at", "1.6,-1.9,0"]
    made = {
        "e.npz": (esdf(grid), "is a distance field", "mapdeal cost"),
        "r.npz": (ring_cost(grid), "costs on the occupancy scale", "--model exponential"),
        "t.npz": (threshold_cost(esdf(grid)), "costs on the occupancy scale", ".npz"),
    }
    for name, (product, rule, hint) in made.items():
        write_map(tmp_path / name, product)
        code, out, err = command("query", tmp_path / name, *ask)
        assert (code, out) == (2, "")
        first, second = err.splitlines()[-2:]
        assert f"{name}: " in first
        assert rule in first
        assert hint in second


def test_published_costs_in_a_pair_are_warned_of(command, costs, tmp_path):
    path, costmap = costs
    write_map(tmp_path / "c.yaml", costmap)
    ask = ["--footprint", ROBOT, *words_of(poses_at(costmap, (2.5, 4.5, 0)))]
    assert answered(command("query", path, *ask)[1])[0]["cost"] not in (0, 254)
    code, out, err = command("query", tmp_path / "c.yaml", *ask)
    assert (code, answered(out)[0]["cost"]) == (0, 0)
    assert "cells of 1..99 are not obstacles; costs are read from an npz" in err


def test_without_a_robot_costs_are_asked_for_distances_as_before(command, costs):
    code, out, err = command("query", costs[0], *POINT_OPTIONS)
    assert code == 0
    assert "gradient" in answered(out)[0]
    assert "read as the occupancy that ROS would publish" in err


def test_many_poses_are_those_of_the_library(command, tmp_path):
    rng = np.random.default_rng(2)
    cells = rng.choice(np.array([0, 99, 254, 255], np.uint8), (60, 90), p=[0.9, 0.05, 0.03, 0.02])
    costmap = Costmap(cells, 0.1, (1.5, -2.0, 0.4))
    write_map(tmp_path / "c.npz", costmap)
    poses = rng.uniform((-1, -1, -3), (9, 9, 3), (20_000, 3))
    np.savetxt(tmp_path / "p.csv", poses, fmt="%.17g", delimiter=",")
    words = ["query", tmp_path / "c.npz", "--footprint", ROBOT, "--poses", tmp_path / "p.csv"]
    found = [answer["cost"] for answer in answered(command(*words)[1])]
    assert found == footprint_costs(costmap, SHAPE, poses).tolist()
    assert len(set(found)) == 4
