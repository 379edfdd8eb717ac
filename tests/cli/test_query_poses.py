"""The command that asks for the cost of a robot at poses."""

import json
from pathlib import Path

import numpy as np
import pytest

import mapdeal
from drawn import grid_from_text
from mapdeal import Footprint, OccupancyGrid, footprint_costs, write_map

ROBOT = "[[0.12,0.06],[0.12,-0.06],[-0.12,-0.06],[-0.12,0.06]]"
SHAPE = Footprint.parse(ROBOT)
QUERY = f"query cost.npz --footprint {ROBOT}"


@pytest.fixture
def grid(here):
    grid = grid_from_text("........\n.#......\n......?.\n...##...", 0.1, (1.5, -2.0, 0.4))
    write_map("room.yaml", grid)
    return grid


@pytest.fixture
def costmap(grid):
    made = mapdeal.exponential_cost(grid, inscribed_radius=0.06, inflation_radius=0.4)
    write_map("cost.npz", made)
    return made


@pytest.fixture
def asked(sh):
    """What gives the answers of a line that ends well."""

    def ask(line):
        code, out, err = sh(line)
        assert code == 0, err
        return [json.loads(answer) for answer in out.splitlines()]

    return ask


def poses_at(grid, *places):
    """Poses at rows and columns of a grid, along its own axes."""
    points = grid.frame.xy_from_continuous_rowcol([place[:2] for place in places])
    yaws = [place[2] + grid.origin[2] for place in places]
    return np.column_stack([points, yaws]).tolist()


def at(poses):
    return " ".join("--at " + ",".join(map(repr, pose)) for pose in poses)


def test_answers_are_those_of_the_library(asked, costmap):
    poses = poses_at(costmap, (1.5, 5.5, 0), (0.9, 4.5, 0), (1.5, 6.5, 0), (3.6, 4, 1.5), (9, 9, 0))
    keys = ["x", "y", "yaw", "inside", "cost", "state"]
    answers = asked(f"{QUERY} {at(poses)}")
    assert [list(answer) for answer in answers] == [keys] * 5
    assert [[answer[key] for key in keys[:3]] for answer in answers] == poses
    found = [answer["cost"] for answer in answers]
    assert found == footprint_costs(costmap, SHAPE, poses).tolist()
    states = [answer["state"] for answer in answers]
    assert states == ["unknown", "collision", "free", "outside", "outside"]
    assert [answer["inside"] for answer in answers] == [True, True, True, False, False]


FREE, HIT, UNKNOWN = (0, "free"), (254, "collision"), (255, "unknown")


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("", [HIT, HIT, UNKNOWN, FREE]),  # stands over the obstacle
        ("--rule outline", [HIT, HIT, UNKNOWN, FREE]),
        ("--rule full", [HIT, HIT, UNKNOWN, HIT]),
        ("--unknown free", [HIT, HIT, FREE, FREE]),
        ("--unknown occupied", [HIT, HIT, HIT, FREE]),
    ],
)
def test_all_states_and_rules_of_a_map(asked, grid, words, expected):
    robot = "[[0.14,0.1],[0.14,-0.1],[-0.14,-0.1],[-0.14,0.1]]"
    poses = at(poses_at(grid, (1.5, 4.5, 0), (1.5, 3.5, 0), (2.5, 5.5, 0), (2.5, 1.5, 0)))
    answers = asked(f"query room.yaml --footprint {robot} {poses} {words}")
    assert [(answer["cost"], answer["state"]) for answer in answers] == expected


@pytest.mark.parametrize(
    ("words", "costs"), [("", [0, 0, 0, 254]), ("--lethal-threshold 50", [0, 254, 254, 254])]
)
def test_the_threshold_of_a_map_is_that_of_other_commands(asked, here, words, costs):
    write_map("m.npz", OccupancyGrid([[0, 50, 99, 100]], 0.5, (0.0, 0.0, 0.0)))
    poses = at([[0.25 + 0.5 * col, 0.25, 0.0] for col in range(4)])
    answers = asked(f"query m.npz --robot-radius 0.01 {poses} {words}")
    assert [answer["cost"] for answer in answers] == costs


def test_a_round_robot_is_padded_as_costmap_2d_pads_its_16_corners(asked, costmap):
    poses = poses_at(costmap, *np.random.default_rng(0).uniform((1, 1, -3), (3, 7, 3), (80, 3)))
    answers = asked(f"query cost.npz --robot-radius 0.05 --footprint-padding 0.04 {at(poses)}")
    expected = footprint_costs(costmap, Footprint.sixteen_gon(0.05).padded(0.04), poses).tolist()
    assert [answer["cost"] for answer in answers] == expected
    assert expected != footprint_costs(costmap, Footprint.sixteen_gon(0.09), poses).tolist()


def test_a_file_of_poses_is_answered_line_by_line(sh, asked, costmap):
    (x, y, yaw), = poses_at(costmap, (2.5, 4.5, 0))  # fmt: skip
    lines = ["x y theta", f"{x!r} {y!r} {yaw!r}", "1,2", "", f"[{x!r}, {y!r}, {yaw!r}]", "nan 1 2"]
    Path("p.txt").write_text("\n".join(lines) + "\n")
    line = f"{QUERY} --poses p.txt"
    answers = asked(line)
    assert answers[0] == answers[3]
    assert answers[0]["inside"] is True
    nothing = {"inside": False, "cost": None, "state": None}
    rule = "must be three numbers x,y,yaw, or TUM's t x y z qx qy qz qw, got '1,2'"
    assert answers[1] == {"x": None, "y": None, "yaw": None, **nothing, "line": 3, "error": rule}
    assert answers[2]["error"] == "empty line"
    assert (answers[4]["x"], answers[4]["yaw"], answers[4]["line"]) == (None, 2.0, 6)
    assert sh.err(line) == "warning: p.txt: 3 of 5 hold no finite pose\n"
    assert "3 of 5 poses are not inside of the map" in sh.err(f"{line} --strict", 1)
    given = poses_at(costmap, (2.5, 4.5, 0), (2.5, 4.2, 1))  # these come first
    yaws = [answer["yaw"] for answer in asked(f"{line} {at(given)}")]
    assert yaws == [given[0][2], given[1][2], *(answer["yaw"] for answer in answers)]


def test_degrees_are_warned_of(sh, costmap):
    told = "1 of 2 poses have a yaw of more than a turn; is it in degrees?"
    assert sh.err(f"{QUERY} --at 1.6,-1.9,90 1.6,-1.9,1") == f"warning: {told}\n"


@pytest.mark.parametrize("pose", ["nan,1,1", "1,inf,1", "1e308,-1e308,1", "1,1,1e308", "1,1,-inf"])
def test_any_number_is_answered(asked, costmap, pose):
    (answer,) = asked(f"{QUERY} --at {pose}")
    assert answer["inside"] is False
    assert answer["state"] == (None if "n" in pose else "outside")


def test_published_costs_in_a_pair_are_warned_of(sh, asked, costmap):
    write_map("c.yaml", costmap)
    line = f"{QUERY} {at(poses_at(costmap, (2.5, 4.5, 0)))}"
    assert asked(line)[0]["cost"] not in (0, 254)
    line = line.replace("cost.npz", "c.yaml")
    assert asked(line)[0]["cost"] == 0
    assert "cells of 1..99 are not obstacles; costs are read from an npz" in sh.err(line)


def test_without_a_robot_costs_are_asked_for_distances(sh, costmap):
    code, out, err = sh("query cost.npz --at 1.6,-1.9")
    assert (code, "gradient" in json.loads(out)) == (0, True)
    assert "read as the occupancy that ROS would publish" in err


def test_many_poses_are_those_of_the_library(asked, here):
    rng = np.random.default_rng(2)
    cells = rng.choice(np.array([0, 99, 254, 255], np.uint8), (60, 90), p=[0.9, 0.05, 0.03, 0.02])
    costmap = mapdeal.Costmap(cells, 0.1, (1.5, -2.0, 0.4))
    write_map("cost.npz", costmap)
    poses = rng.uniform((-1, -1, -3), (9, 9, 3), (9_000, 3))
    np.savetxt("p.csv", poses, fmt="%.17g", delimiter=",")
    found = [answer["cost"] for answer in asked(f"{QUERY} --poses p.csv")]
    assert found == footprint_costs(costmap, SHAPE, poses).tolist()
    assert len(set(found)) == 4
