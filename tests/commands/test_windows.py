import json
import math

import numpy as np
import pytest

import mapdeal
from drawn import grid_from_text

OPEN, WALL = "." * 20, "." * 7 + "#" + "." * 12


@pytest.fixture
def world(here):
    grid = grid_from_text("\n".join([OPEN, *[WALL] * 4, OPEN, OPEN]), 0.5, (1.5, -2.0, 0.0))
    mapdeal.write_map(here / "world.yaml", grid)
    mapdeal.write_map(here / "window.npz", _costs_of(grid.occupancy[:, :10]))
    mapdeal.write_map(here / "costs.npz", _costs_of(grid.occupancy))
    return grid


def _costs_of(occupancy, origin=(1.5, -2.0, 0.0)):
    return mapdeal.Costmap(np.where(occupancy == 100, 254, 0).astype(np.uint8), 0.5, origin)


@pytest.mark.parametrize("method", ["astar", "geodesic"])
@pytest.mark.parametrize("known", ["", " --map costs.npz"])
def test_a_route_to_a_goal_beyond_ends_at_the_best_border_cell(sh, here, world, method, known):
    line = "route window.npz --from 2.25,-0.25 --to 11,1.2 --json"
    code, out, err = sh(f"{line} --method {method}{known}")
    answer = json.loads(out)
    assert (code, answer["reached"], answer["beyond_window"]) == (0, False, True)
    assert "the goal 11, 1.2 is beyond the map: the route ends at its border, at " in err
    (x, y), wide = answer["points"][-1], _costs_of(world.occupancy)
    window, totals = _costs_of(world.occupancy[:, :10]), {}

    def length(costs, start, goal):
        return mapdeal.route(costs, start=start, goal=goal, method=method).length

    for row, col in np.ndindex(window.shape):
        if row not in (0, window.shape[0] - 1) and col not in (0, window.shape[1] - 1):
            continue
        centre = tuple(window.frame.xy_from_rowcol([[row, col]])[0].round(9).tolist())
        straight, before = math.dist(centre, (11, 1.2)), math.dist(centre, (2.25, -0.25))
        limit = min(totals.values(), default=math.inf) + 0.5
        if window.cost[row, col] < 253 and before + straight <= limit:
            totals[centre] = length(window, (2.25, -0.25), centre) + (
                length(wide, centre, (11, 1.2)) if known else straight
            )
    assert totals[x, y] <= min(totals.values()) + 0.5  # lengths of first order
    assert sh(f"{line} --strict")[0] == 1


def test_a_goal_that_a_window_cuts_off_is_reached_around_with_a_map(sh, here, world):
    narrow = world.occupancy[2:6, :14]  # its southern and northern ways around the wall are missing
    mapdeal.write_map(here / "cut.npz", _costs_of(narrow, (1.5, -1.0, 0.0)))
    line = "route cut.npz --from 2.25,0.25 --to 7.25,0.25 --json"
    assert sh(line)[0] == 1
    code, out, err = sh(f"{line} --map costs.npz")
    assert (code, json.loads(out)["beyond_window"]) == (0, True)
    assert "is not reachable within the map" in err


def test_a_window_steps_along_poses(sh, here, world):
    (here / "poses.txt").write_text("2.25 -0.25 0\n4.25 -1.25 0\n7.25 -0.5 0\n")
    line = "local --map world.yaml --poses poses.txt --size 5,5 --route-to 9.25,0.25 "
    code, out, _ = sh(f"{line} --set inflate.radius=0 -o steps")
    assert code == 0
    assert "3 routes, 1 to the goal, driven " in out
    document = json.loads((here / "steps/routes.json").read_text())
    assert [step["reached"] for step in document["steps"]] == [False, False, True]
    assert document["driven"] == [[2.25, -0.25], [4.25, -1.25], [7.25, -0.5]]
    assert document["driven_m"] == pytest.approx(np.sqrt(5) + np.hypot(3, 0.75))
    for number, step in enumerate(document["steps"]):
        own = json.loads((here / f"steps/{number:04}/route.json").read_text())
        assert {"folder": f"{number:04}", **own} == step
        assert (here / f"steps/{number:04}/route.png").exists()
    assert (here / "steps/routes.png").exists()


def test_a_goal_beyond_the_last_window_is_a_warning_that_strict_refuses(sh, here, world):
    line = "local --map world.yaml --pose 2.25,-0.25,0 --size 5,5 --route-to 9.25,0.25"
    code, _, err = sh(f"{line} -o a")
    assert (code, err.count("the goal 9.25, 0.25 is beyond the map: the route ends at")) == (0, 1)
    assert sh(f"{line} -o b --strict")[0] == 1
