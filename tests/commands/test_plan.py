import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

import mapdeal
from mapdeal import OccupancyGrid, PlanGoal, plan, write_map
from mapdeal.commands.plan import planner_of
from mapdeal.commands.plan_changes import PlannerOnMap, _Query
from mapdeal.planners.planner import no_plan

PARAMETERS = """
global_costmap: {{global_costmap: {{ros__parameters: {{
  {shape}, footprint_padding: 0.02, track_unknown_space: true,
  plugins: [static_layer, inflation_layer],
  static_layer: {{plugin: "nav2_costmap_2d::StaticLayer"}},
  inflation_layer: {{plugin: "nav2_costmap_2d::InflationLayer", inflation_radius: {inflation},
    cost_scaling_factor: 3.0}}}}}}}}
planner_server: {{ros__parameters: {{
  planner_plugins: ["GridBased", "Other"], Other: {{plugin: "my_planner::Planner"}},
  GridBased: {{plugin: "nav2_navfn_planner::NavfnPlanner", {planner}}}}}}}
"""
pytestmark = pytest.mark.usefixtures("mapdeal_warnings")
DEFAULTS = {
    "shape": "robot_radius: 0.45", "inflation": 0.8, "planner": "tolerance: 0.1, allow_unknown: no"
}  # fmt: skip
BAD_START = "the start lies nearer to an obstacle than the inscribed radius"
START, GOAL = (2.0, 2.0, 0.0), (5.0, 2.0, 0.5)


def two_rooms(door=7, thickness=1, unknown=False):
    """Two rooms of 3 m beside each other, and a door of so many cells of 0.1 m between them."""
    cells = np.full((42, 64), 100, np.int8)
    cells[1:-1, 1:-1] = 0
    cells[:, 32 : 32 + thickness] = 100
    first = 20 - door // 2
    cells[first : first + door, 32 : 32 + thickness] = -1 if unknown else 0
    return OccupancyGrid(cells, 0.1, (0.3, 0.1, 0.0))


def robot_file(folder, **values):
    path = folder / "robot.yaml"
    path.write_text(PARAMETERS.format(**DEFAULTS | values))
    return path


def is_found(grid, robot):
    return plan(grid, robot=robot, start=START, goals=[GOAL], no_changes=True).passes


@pytest.mark.parametrize(("setting", "form", "step"), [
    ("inflation_layer.inflation_radius", ("inflation", "{:g}"), 0.01),
    ("robot_radius", ("shape", "robot_radius: {:g}"), 0.01),
    ("GridBased.tolerance", ("planner", "tolerance: {:g}, allow_unknown: no"), -0.01),
])  # fmt: skip
def test_one_step_less_than_a_proposed_value_is_not_enough(tmp_path, setting, form, step):
    grid = two_rooms()
    (goal,) = plan(grid, robot=robot_file(tmp_path), start=START, goals=[GOAL]).goals
    assert goal.plan.reason == "NoValidPathCouldBeFound"
    assert goal.stopped_at == pytest.approx((3.25, 2.15), abs=0.01)
    (change,) = [change for change in goal.changes if change.get("parameter") == setting]
    key, text = form
    for value, expected in ((change["to"], True), (round(change["to"] + step, 2), False)):
        assert is_found(grid, robot_file(tmp_path, **{key: text.format(value)})) is expected


@pytest.mark.parametrize(
    ("start", "goal", "stopped_at", "detail"),
    [((2.0, 2.0), (3.55, 3.95), (3.05, 3.65), "the goal lies in an obstacle"),
     ((0.62, 0.42), GOAL, (0.65, 0.45), BAD_START),
     ((0.62, 0.42), (3.55, 3.95), (0.65, 0.45), f"{BAD_START} and the goal lies in an obstacle")],
)  # fmt: skip
def test_a_closed_start_or_goal_is_the_reason(tmp_path, start, goal, stopped_at, detail):
    report = plan(two_rooms(), robot=robot_file(tmp_path), start=start, goals=[goal])
    assert report.goals[0].plan.detail == detail
    assert report.goals[0].stopped_at == pytest.approx(stopped_at, abs=0.15)


def test_the_door_must_be_wider_by_the_proposed_width(tmp_path):
    grid, robot = two_rooms(), robot_file(tmp_path)
    (goal,) = plan(grid, robot=robot, start=START, goals=[GOAL]).goals
    (passage,) = [change for change in goal.changes if change.get("map") == "passage"]
    assert (passage["x"], passage["y"]) == pytest.approx((3.5, 2.1), abs=0.11)
    assert passage["from"] == pytest.approx(0.8)
    side = float(np.float32(0.1))  # as in the map's message
    y, x = (np.indices(grid.shape) + 0.5) * side + np.reshape(grid.origin[1::-1], (2, 1, 1))
    far = np.hypot(x - passage["x"], y - passage["y"])
    for width, expected in ((passage["width"], True), (passage["width"] - 0.01, False)):
        cells = np.where((far <= width / 2) & (grid.occupancy > 0), 0, grid.occupancy)
        assert is_found(OccupancyGrid(cells, 0.1, grid.origin), robot) is expected


def test_the_smallest_obstacle_in_the_way_is_named(tmp_path):
    grid, robot = two_rooms(door=14), robot_file(tmp_path)
    cells = grid.occupancy.copy()
    cells[19:21, 32:34] = cells[30, 50] = 100
    grid = OccupancyGrid(cells, 0.1, grid.origin)
    (goal,) = plan(grid, robot=robot, start=START, goals=[GOAL]).goals
    (obstacle,) = [change for change in goal.changes if change.get("map") == "obstacle"]
    assert obstacle["area"] == pytest.approx(0.04)
    assert (obstacle["x"], obstacle["y"]) == pytest.approx((3.6, 2.1), abs=0.11)


@pytest.mark.parametrize(("door", "values", "name", "value"), [
    (20, {}, "GridBased.allow_unknown", True),
    (7, {"shape": "robot_radius: 0.39"}, "footprint_padding", 0.01),
    (12, {"planner": "max_cycles_factor: 1"}, "GridBased.max_cycles_factor", 2),
])  # fmt: skip
def test_other_parameters_that_make_a_path_are_found(tmp_path, door, values, name, value):
    grid, robot = two_rooms(door, unknown=door == 20), robot_file(tmp_path, **values)
    (goal,) = plan(grid, robot=robot, start=START, goals=[(5.9, 2.0)]).goals
    changes = {change.get("parameter"): change.get("to") for change in goal.changes}
    assert changes[name] == value
    assert (goal.plan.detail is not None) == name.endswith("factor")


def test_a_footprint_is_scaled_until_it_passes(tmp_path):
    corners = "[[0.6, 0.4], [0.6, -0.4], [-0.6, -0.4], [-0.6, 0.4]]"
    robot = robot_file(tmp_path, shape=f'footprint: "{corners}"')
    (goal,) = plan(two_rooms(), robot=robot, start=START, goals=[GOAL]).goals
    (change,) = [change for change in goal.changes if change.get("parameter") == "footprint"]
    assert change["from"] == corners
    shape = 'footprint: "{}"'
    assert is_found(two_rooms(), robot_file(tmp_path, shape=shape.format(change["to"])))
    larger = [round(v * (change["scale"] + 0.01), 4) for v in (0.6, 0.4)]
    text = "[[{0}, {1}], [{0}, -{1}], [-{0}, -{1}], [-{0}, {1}]]".format(*larger)
    assert not is_found(two_rooms(), robot_file(tmp_path, shape=shape.format(text)))


CORNERS = "[[0.6, 0.4], [0.6, -0.4], [-0.6, 0]]"
TRIED = {
    "inflation_layer.inflation_radius": (0.8, 0.79, 0.0, 80),
    "robot_radius": (0.45, 0.44, 0.01, 44),
    "footprint_padding": (0.02, 0.01, 0.0, 2), "GridBased.tolerance": (0.1, 0.11, 10.0, 990),
    "GridBased.allow_unknown": (False, True, True, 1),
    "GridBased.use_astar": (True, False, False, 1),
    "footprint": (CORNERS, "[[0.594, 0.396], [0.594, -0.396], [-0.594, 0]]",
                  "[[0.03, 0.02], [0.03, -0.02], [-0.03, 0]]", 95),
    "inflation_layer.cost_scaling_factor": (3.0, 2.9, 0.5, 25),
    "GridBased.max_cycles_factor": (60, 61, 64, 4),
}  # fmt: skip
MARGINS = {
    "robot_radius": (0.45, 0.46, 3.45, 300), "GridBased.tolerance": (0.1, 0.09, 0.0, 10),
    "footprint": (CORNERS, "[[0.606, 0.404], [0.606, -0.404], [-0.606, 0]]",
                  "[[2.4, 1.6], [2.4, -1.6], [-2.4, 0]]", 300),
}  # fmt: skip


@pytest.mark.parametrize("shape", ["robot_radius: 0.45", f'footprint: "{CORNERS}"'])
def test_values_are_tried_in_steps_up_to_their_limits(tmp_path, shape):
    planner = "tolerance: 0.1, allow_unknown: no, max_cycles_factor: 60, use_astar: yes"
    robot = mapdeal.read_robot_parameters(robot_file(tmp_path, planner=planner, shape=shape))
    query = _Query(PlannerOnMap(None, robot, *planner_of(robot, None)), START, GOAL)
    missed = no_plan("NoValidPathCouldBeFound")
    reached = dataclasses.replace(missed, is_reached=True)
    for expected, adjustments, count in (
        (TRIED, query.adjustments(missed), 6), (TRIED, query.adjustments(reached), 9),
        (MARGINS, query.margins(), 2),
    ):  # fmt: skip
        found = [(a.name, (a.value, a.candidates[0], a.candidates[-1], len(a.candidates)))
                 for a in adjustments]  # fmt: skip
        assert len(found) == count
        assert dict(found) == {name: expected[name] for name, _ in found}


def test_a_plan_has_its_clearance_and_the_margin_of_the_radius(tmp_path):
    grid = two_rooms(door=13)
    (goal,) = plan(grid, robot=robot_file(tmp_path), start=START, goals=[GOAL]).goals
    assert goal.plan.found
    assert 0.55 < goal.clearance < 0.75
    assert goal.narrowest[0] == pytest.approx(3.55, abs=0.2)
    margin = goal.margins[0]["to"]
    assert is_found(grid, robot_file(tmp_path, shape=f"robot_radius: {margin}"))
    assert not is_found(grid, robot_file(tmp_path, shape=f"robot_radius: {margin + 0.01:.2f}"))


def test_a_start_on_the_border_that_rounding_moves_outside_is_no_error(tmp_path):
    cells = np.zeros((20, 40), np.int8)
    cells[10, 35] = 100
    start = (1.0, 0.1 + 20 * float(np.float32(0.1)) - 1e-10)
    robot = robot_file(tmp_path, planner="tolerance: 0.0")
    grid, goals = OccupancyGrid(cells, 0.1, (0.3, 0.1, 0.0)), [(2.0, 1.0), (3.85, 1.15)]
    free, occupied = plan(grid, robot=robot, start=start, goals=goals).goals
    assert (free.plan.detail, free.changes) == ("the start lies in the last half cell", [])
    assert (occupied.plan.reason, occupied.stopped_at) == ("GoalOccupied", None)


@pytest.fixture
def files(here):
    write_map("map.yaml", two_rooms(door=13))
    write_map("narrow.yaml", two_rooms())
    robot_file(here)
    return ("--params-file", "robot.yaml", "--from", "2,2")


def test_the_document_holds_what_a_later_call_is_compared_with(command, files):
    words = ("plan", "map.yaml", *files, "--to=hall=1.5,2", "room=5,2,0.5", "-o", "plan.json")
    assert command(*words)[0] == 0
    document = json.loads(Path("plan.json").read_text())
    assert document["format"] == "mapdeal-plan/1"
    assert [goal["name"] for goal in document["goals"]] == ["hall", "room"]
    assert document["goals"][1]["points"][-1] == [5.0, 2.0, 0.5]
    expected = (*files, "--to", "hall=1.5,2", "room=5,2,0.5", "--expect", "plan.json", "-q")
    assert command("plan", "map.yaml", *expected)[0] == 0
    code, output, error = command("plan", "narrow.yaml", *expected, "--no-changes")
    assert (code, len(json.loads(output)["differences"])) == (1, 2)
    assert "found False, expected True" in error
    command("plan", "narrow.yaml", *files, "--to", "5,2", "-o", "none.json")
    same = ("plan", "narrow.yaml", *files, "--to", "5,2", "--expect", "none.json", "-q")
    assert command(*same)[0] == 0


def test_pages_of_runs_and_plans_hold_what_the_planner_answers(command, files):
    ends = (*files, "--to", "near=1.5,2", "far=5,2")
    assert command("run", "narrow.yaml", "-o", "out", "--report", *ends)[0] == 1
    page = Path("out/report.html").read_text()
    assert "Plans of nav2_navfn_planner::NavfnPlanner" in page
    line = json.loads(Path("out/report.json").read_text())["entries"][0]["next"]
    assert line.startswith("mapdeal plan narrow.yaml --from 2,2 --to near=1.5,2 far=5,2")
    assert page.count(line) == 2
    assert command(*line.split()[1:], "-o", "plan.json")[0] == 1
    assert command("report", "narrow.yaml", "plan.json", "-o", "page.html")[0] == 1
    for path in ("out/report.html", "page.html"):
        page = Path(path).read_text()
        assert "goal near: path of 0.5" in page
        assert "goal far: no path, NoValidPathCouldBeFound" in page
    assert "robot_radius 0.38 (now 0.45)" in page


@pytest.mark.parametrize("names", [("planner_server:", "planners:"), ('"GridBased", ', "")])
def test_a_page_has_no_plans_of_a_planner_that_is_not_modelled(command, files, names):
    Path("robot.yaml").write_text(Path("robot.yaml").read_text().replace(*names))
    assert command("run", "map.yaml", *files, "--to", "5,2", "--report", "-o", "out")[0] == 0
    assert "Plans of" not in Path("out/report.html").read_text()


def test_pairs_give_one_line_each_and_faulty_lines_an_error(command, files):
    Path("pairs.csv").write_text("2,2,0,5,2,0\n2,2,0,1.5,2,7\n2,2,0\n")
    words = ("plan", "narrow.yaml", *files[:2], "--pairs", "pairs.csv")
    code, output, _ = command(*words)
    missed, found, faulty = map(json.loads, output.splitlines())
    assert code == 5
    assert (missed["found"], missed["length_m"], missed["poses"]) == (False, None, 0)
    assert {change.get("parameter") for change in missed["changes"]} >= {"robot_radius"}
    assert found["poses"] > 5
    assert "six numbers" in faulty["error"]
    assert "changes" not in json.loads(command(*words, "--no-changes")[1].splitlines()[0])


def test_layers_and_the_picture_are_written(command, files):
    words = ("--to", "5,2", "--layers", "layers.npz", "--image", "plan.png", "-o", "plan.json")
    assert command("plan", "narrow.yaml", *files, *words)[0] == 1
    with np.load("layers.npz") as layers:
        assert layers["potential"].dtype == np.float32
        assert 0 < (layers["potential"] < 1e10).sum() < layers["cost"].size / 2
    assert Path("plan.png").read_bytes().startswith(b"\x89PNG")


def test_other_parameters_are_planned_with_as_well(command, files, tmp_path):
    Path("wide.yaml").write_text(PARAMETERS.format(**DEFAULTS | {"shape": "robot_radius: 0.9"}))
    slim = "global_costmap: {global_costmap: {ros__parameters: {robot_radius: 0.1}}}"
    Path("overlay.yaml").write_text(slim)
    words = ("--to", "5,2", "--against", "wide.yaml", "--against", "wide.yaml,overlay.yaml")
    code, output, error = command("plan", "map.yaml", *files, *words, "--no-changes")
    found = [plan["goals"][0]["found"] for plan in json.loads(output)["plans"]]
    assert found == [True, False, True]
    assert code == 1
    assert "no path found to 1 goal" in error


@pytest.mark.parametrize(("names", "code"), [("", 1), (" missing.yaml", 5)])
def test_many_maps_make_a_table(command, files, monkeypatch, names, code):
    monkeypatch.setattr("mapdeal.cli.terminal.has_reader", lambda: True)
    words = ("plan", "map.yaml", "narrow.yaml", *names.split(), *files, "--to", "5,2")
    found, output, _ = command(*words)
    rows = [line.split("  ") for line in output.splitlines()]
    assert found == code
    assert [row[0] for row in rows[1:3]] == ["map.yaml", "narrow.yaml"]
    assert rows[2][-1] == "robot_radius 0.38 (now 0.45)"
    assert len(rows) == 3 + (code == 5)


def test_a_table_is_compared_with_an_earlier_one(command, files):
    words = (*files, "--no-changes", "--to", "5,2")
    command("plan", "map.yaml", "narrow.yaml", *words, "-o", "table.json")
    expected = (*words, "--expect", "table.json")
    assert command("plan", "map.yaml", "narrow.yaml", *expected)[0] == 0
    code, output, error = command("plan", "narrow.yaml", "map.yaml", *expected)
    assert (code, len(json.loads(output)["differences"])) == (1, 4)
    assert "narrow.yaml, robot.yaml: goal 5,2: found False, expected True" in error
    _, output, _ = command("plan", "map.yaml", "narrow.yaml", *expected, "--against", "robot.yaml")
    assert json.loads(output)["differences"] == ["4 plans, expected 2"]


def test_a_planner_that_is_not_modelled_gets_only_what_is_certain(command, files):
    def goals(name):
        words = ("--to", "5,2", "--planner", "Other")
        code, output, _ = command("plan", name, *files, *words)
        assert code == 1
        return json.loads(output)["goals"][0]

    assert goals("map.yaml")["found"] is None
    assert goals("narrow.yaml")["found"] is False
    for name in ("map.yaml", "narrow.yaml"):
        assert "my_planner::Planner is not modelled" in goals(name)["detail"]


@pytest.mark.parametrize(
    ("words", "code", "text"),
    [(["--to", "5,2", "--planner", "Grid"], 2, "the file lists GridBased, Other"),
     ([], 2, "both are required"), (["--to", "5,2", "--layers", "x.png"], 2, "must end in .npz"),
     (["--to", "5,2", "3,3", "--layers", "x.npz"], 2, "needs one goal"),
     (["--to", "5,2", "--pairs", "p.csv"], 2, "applies to one start"),
     (["narrow.yaml", "--to", "5,2", "--image", "x.png"], 2, "applies to one map"),
     (["--to", "nan,2"], 2, "must be finite"),
     (["--to", "5,1e400"], 2, "must be finite")],
)  # fmt: skip
def test_options_that_do_not_go_together_are_refused(command, files, words, code, text):
    found, _, error = command("plan", "map.yaml", *files, *words)
    assert (found, text in error) == (code, True)


def test_parameters_of_a_wrong_type_are_refused_with_their_line(command, files, tmp_path):
    robot_file(tmp_path, planner="tolerance: 1")
    code, _, error = command("plan", "map.yaml", *files, "--to", "5,2")
    assert code == 3
    assert "GridBased.tolerance (line 10): must be a double" in error
    assert "hint: write 1.0" in error


def test_info_lists_the_planners_with_their_values(command, files):
    _, output, _ = command("info", "robot.yaml", "--json")
    planners = {entry["name"]: entry for entry in json.loads(output)["planners"]}
    assert planners["GridBased"]["parameters"]["tolerance"] == 0.1
    assert planners["Other"] == {"name": "Other", "plugin": "my_planner::Planner", "parameters": {}}
    assert "use_astar no" in command("info", "robot.yaml")[1]


def test_goals_in_python_may_be_tuples_or_have_names(tmp_path):
    goals = [(5.0, 2.0), PlanGoal(1.0, 1.0, 0.0, "corner")]
    report = plan(two_rooms(door=13), robot=robot_file(tmp_path), start=(2, 2), goals=goals)
    assert [goal.goal.name for goal in report.goals] == [None, "corner"]
    assert isinstance(report, mapdeal.PlanReport)
