import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import mapdeal
from drawn import grid_from_text
from mapdeal import Footprint, OccupancyGrid, exponential_cost, footprint_costs, read_map, write_map
from mapdeal.commands.route import _recipe_for

ROUTE_KEYS = ["reached", "start", "goal", "length_m", "min_clearance_m", "mean_clearance_m",
              "cost", "expanded", "optimal"]  # fmt: skip
KEYS = ["x", "y", "inside", "row", "col", "state", "distance", "gradient", "cell_distance"]
ENDS = "--from 1,1 --to 5,1"


@pytest.fixture
def hall(here):
    """A map with a wall and a door, room for a robot of 0.22 m."""
    occupancy = np.zeros((40, 60), np.int8)
    occupancy[:28, 30] = 100
    write_map("hall.yaml", mapdeal.OccupancyGrid(occupancy, 0.1, (0.0, 0.0, 0.0)))
    return read_map("hall.yaml")


@pytest.fixture
def answers_to(sh):
    """Return a function that gives the answers of a line, whatever its exit code."""
    return lambda line: [json.loads(answer) for answer in sh(line)[1].splitlines()]


@pytest.mark.parametrize("source", ["room.yaml", "e.npz"])
def test_query_answers_what_the_library_does(sh, answers_to, room, source):
    sh("esdf room.yaml -o e.npz")
    field = mapdeal.esdf(room)
    points = field.frame.xy_from_continuous_rowcol([[0.7, 2.2], [2.5, 1.5], [1.2, 6.9], [9, 9]])
    line = f"query {source} " + " ".join(f"--at {x!r},{y!r}" for x, y in points.tolist())
    sh.ok(line)
    samples, (*answers, outside) = field.query(points), answers_to(line)
    assert [answer["state"] for answer in answers] == ["free", "occupied", "unknown"]
    assert [(a["row"], a["col"]) for a in answers] == [(0, 2), (2, 1), (1, 6)]
    for index, answer in enumerate(answers):
        assert list(answer) == KEYS
        assert [answer["inside"], answer["x"], answer["y"]] == [True, *points[index].tolist()]
        assert answer["distance"] == pytest.approx(samples.distance[index], rel=1e-8)
        assert answer["gradient"] == pytest.approx(samples.gradient[index].tolist(), rel=1e-8)
        assert np.float32(answer["cell_distance"]) == field.distance[answer["row"], answer["col"]]
    nothing = {**dict.fromkeys(KEYS), "inside": False}
    assert outside == {**nothing, "x": points[3, 0], "y": points[3, 1]}


def test_query_has_null_tiny_distances_and_no_noise_of_rounding(answers_to):
    write_map("m.yaml", grid_from_text("...", 0.5, (0.0, 0.0, 0.0)))
    free, nowhere = answers_to("query m.yaml --at 0.6,0.2 --at nan,1")
    assert (free["inside"], free["state"]) == (True, "free")
    assert free["distance"] is free["gradient"] is free["cell_distance"] is None
    assert (nowhere["inside"], nowhere["x"], nowhere["y"]) == (False, None, 1.0)
    assert nowhere["error"] == "must be finite, got nan,1"
    assert "line" not in nowhere
    write_map("s.yaml", grid_from_text("#...", 1e-5, (0.0, 0.0, 0.0)))
    (answer,) = answers_to("query s.yaml --at 1.5e-5,0.5e-5")
    assert (answer["distance"], answer["cell_distance"]) == (1e-5, 1e-5)
    write_map("t.yaml", grid_from_text("...\n.#.\n...", 0.1, (0.0, 0.0, 1.1)))
    x, y = read_map("t.yaml").frame.xy_from_continuous_rowcol([[1.5, 1.5]])[0]
    assert answers_to(f"query t.yaml --at {x},{y}")[0]["distance"] == 0.0


@pytest.mark.parametrize(("option", "states", "distances"), [
    ("", ["unknown", "free"], [1.0, 0.5]),
    ("--lethal-threshold 50", ["unknown", "occupied"], [0.5, 0.0]),
    ("--unknown occupied", ["unknown", "free"], [0.0, 0.5]),
])  # fmt: skip
def test_states_are_those_of_the_field(sh, answers_to, option, states, distances):
    write_map("m.yaml", grid_from_text("?+#", 0.5, (0.0, 0.0, 0.0)))
    sh(f"esdf m.yaml -o e.npz {option}")
    for source in ("e.npz",) if option else ("e.npz", "m.yaml"):
        answers = answers_to(f"query {source} --at 0.25,0.25 --at 0.75,0.25")
        assert [answer["state"] for answer in answers] == states
        assert [answer["cell_distance"] for answer in answers] == distances


def test_several_points_may_follow_one_option(sh, room):
    once = sh("query room.yaml --at 1.6,-1.9 -1.7,-1.8 2e0,-1.5 --strict")
    assert once == sh("query --at 1.6,-1.9 --at -1.7,-1.8 --at 2e0,-1.5 --strict room.yaml")
    assert (once[0], once[1].count("\n")) == (1, 3)
    assert "hint" not in sh.err("query room.yaml --at 1,a", 2)


@pytest.mark.parametrize("words", ["query p.npz --at", "route p.npz --to 1.7,-1.8 --from"])
def test_of_a_potential_field_the_map_is_read_with_a_warning(sh, room, words):
    sh("potential room.yaml -o p.npz")
    code, _, err = sh(f"{words} 1.7,-1.8")
    assert code in (0, 2)
    assert err.startswith("warning: p.npz: is a potential field")
    assert sh("esdf p.npz -o e.npz")[0] == 0
    assert np.array_equal(read_map("e.npz").distance, mapdeal.esdf(room).distance)
    assert "npz" in sh.err("convert p.npz -o p.yaml", 2)


def test_query_of_points_has_a_status_for_every_line_and_is_strict_on_demand(sh, answers_to, room):
    x, y = room.frame.xy_from_rowcol([[0, 0]])[0]
    edge = room.frame.xy_from_continuous_rowcol([[1.0, 8.0]])[0].tolist()
    lines = [f"{x},{y}", "nan,1", "1,2,3", "", f"{edge[0]!r},{edge[1]!r}", f'{{"x":{x},"y":{y}}}']
    Path("p.csv").write_text("\n".join(lines) + "\n")
    line = "query room.yaml --points p.csv"
    answers = answers_to(line)
    assert sh.err(line) == "warning: p.csv: 3 of 6 hold no finite point\n"
    assert [answer["inside"] for answer in answers] == [True] + [False] * 4 + [True]
    assert answers[0] == answers[5]
    statuses = [(a["line"], "error" in a) for a in answers if "line" in a]
    assert statuses == [(2, True), (3, True), (4, True)]
    assert "4 of 6 points" in sh.err(f"{line} --strict", 1)
    assert answers_to(f"{line} --strict") == answers
    sh.ok(f"query room.yaml --at {x},{y} --strict")
    Path("in.csv").write_text(f"{x},{y}\n")  # the points of all sources count
    line = "query room.yaml --at 99,99 98,98 --points in.csv"
    assert "2 of 3 points are not inside of the map" in sh.err(f"{line} --strict", 1)
    assert sh.err(f"{line} -v") == "3 points, 2 of them outside of the map\n"


def bash(line):
    line = line.replace("mapdeal", f'"{sys.executable}" -m mapdeal')
    return subprocess.run(["bash", "-c", line], capture_output=True, text=True, timeout=120)


@pytest.mark.parametrize(("words", "lines", "key", "message"), [
    ("query room.yaml --points -", ["1.55,-1.9", "1.6,-1.9"], "inside", ""),
    ("query room.yaml --robot-radius 0.05 --poses -", ["1.6 -1.9 0.5"] * 2, "yaw", ""),
    ("route hall.yaml --compare plain --pairs -", ["1,1,5,1", "1,3,5,3"], "reached",
     "means of 2 pairs"),
])  # fmt: skip
@pytest.mark.usefixtures("room", "hall")
def test_standard_input_is_answered_at_once(words, lines, key, message):
    with subprocess.Popen(
        [sys.executable, "-m", "mapdeal", *words.split()],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    ) as process:  # fmt: skip
        for text in lines:
            process.stdin.write(f"{text}\n")
            process.stdin.flush()
            assert key in json.loads(process.stdout.readline())
        _, err = process.communicate(timeout=60)
    assert (process.returncode, err[:16]) == (0, message)


def test_query_without_standard_input(sh, room, monkeypatch):
    monkeypatch.setattr(sys, "stdin", None)  # as Python has it where it is closed
    assert sh("query room.yaml --points -") == (2, "", "error: standard input: is closed\n")


def test_query_ends_quietly_with_its_reader_though_points_go_on(room):
    line = "yes 1.55,-1.9 | { mapdeal query room.yaml --points -; echo $? > code; } | head -n 1"
    completed = bash(line)
    assert (completed.stdout.count("\n"), completed.stderr) == (1, "")
    assert Path("code").read_text() == "0\n"


def test_lost_answers_are_worse_than_a_finding(sh, room):
    line = "query room.yaml --at 99,99 --strict"
    assert sh(line)[0] == 1
    completed = bash(f"mapdeal {line} > /dev/full")
    assert (completed.returncode, completed.stderr.count("error:")) == (4, 1)
    assert completed.stderr.startswith("error: standard output: cannot be written")


def test_potential_is_a_stage_of_recipes_that_hands_its_map_on(sh, room):
    stages = "[esdf, {potential: {goal: [1.6, -1.9]}}, {cost: {inflation_radius: 0.2}}]"
    Path("r.yaml").write_text(f"stages: {stages}\n")
    sh.ok("run room.yaml -o out --recipe r.yaml")
    folder = Path("out/room")
    assert {"potential.npz", "potential.png"} == {file.name for file in folder.glob("potential*")}
    expected = exponential_cost(mapdeal.esdf(room), inflation_radius=0.2).cost
    assert np.array_equal(read_map(folder / "cost.npz").cost, expected)
    assert read_map(folder / "potential.npz").goal == (1.6, -1.9)
    for text, goal in (("1.7,-1.8", (1.7, -1.8)), ("[1.5, -1.9]", (1.5, -1.9)), ("none", None)):
        sh(f"run room.yaml -o out --recipe r.yaml --force --set 'potential.goal={text}'")
        assert read_map(folder / "potential.npz").goal == goal


def test_route_prints_its_answer_or_writes_it(sh, hall):
    line = f"route hall.yaml {ENDS}"
    out = sh.ok(line)
    answer = json.loads(out)
    assert list(answer) == ["method", *ROUTE_KEYS, "points"]
    assert (answer["reached"], answer["optimal"], type(answer["expanded"])) == (True, True, int)
    assert answer["mean_clearance_m"] > answer["min_clearance_m"] > 0.22
    assert (answer["points"][0], answer["points"][-1]) == ([1.0, 1.0], [5.0, 1.0])
    assert answer["cost"] >= answer["length_m"] > 2 * math.hypot(2, 1.8)
    output = sh.ok(f"{line} -o r.json --image r.png")
    assert output.startswith(f"r.json: {answer['length_m']:.2f} m")
    assert output.endswith("; no robot is given: recipe nav2, radius 0.22 m\n")
    assert "no robot" not in sh.ok(f"{line} -o r2.json --robot-radius 0.3")
    assert Path("r.json").read_text() == out
    assert Path("r.png").read_bytes().startswith(b"\x89PNG")


def test_route_takes_costs_as_they_are(sh, hall):
    write_map("c.npz", exponential_cost(hall, inscribed_radius=1.3, inflation_radius=1.4))
    line = f"route c.npz {ENDS}"
    assert sh.err(f"{line} --image c.png", 1).startswith("error: c.npz: no route leads to 5, 1\n")
    answer = sh.json(line)
    assert 0 < answer.pop("expanded") < 30 * 40  # no more than this side of the wall
    nothing = dict.fromkeys(("length_m", "min_clearance_m", "mean_clearance_m", "cost"))
    ends = {"start": {"x": 1.0, "y": 1.0}, "goal": {"x": 5.0, "y": 1.0}, "points": []}
    assert answer == ends | nothing | {"method": "astar", "reached": False, "optimal": True}
    assert Path("c.png").exists()
    write_map("t.npz", mapdeal.threshold_cost(mapdeal.esdf(hall)))
    assert sh(f"route t.npz {ENDS}")[0] == 0
    assert sh(f"{line} --robot-radius 0.3")[0] == 2


@pytest.mark.parametrize(("radius", "code"), [
    *((0.5, 0), (0.599, 0), (0.6, 1), (0.9, 1)),  # 12 cells from the wall's end to the edge
    (1.3, 2),  # the start is 1.05 m from the edge
])  # fmt: skip
def test_route_and_reach_know_the_robot_s_size(sh, hall, radius, code):
    found, out, _ = sh(f"route hall.yaml {ENDS} --robot-radius {radius}")
    assert found == code
    if code < 2:
        assert code == sh(f"reach hall.yaml {ENDS} --robot-radius {radius}")[0]
    assert code or json.loads(out)["min_clearance_m"] > radius


def test_route_by_descent_reaches_the_goal_or_tells_the_local_minimum(sh, hall):
    line = "route hall.yaml --method descent --attractive-gain 100"
    answer = json.loads(sh.ok(f"{line} --from 2,3.5 --to 5,3.6"))
    keys = ("reached", "local_minimum", "optimal", "expanded")
    assert [answer[key] for key in keys] == [True, None, False, None]
    err = sh.err(f"{line} {ENDS} -o r.json --image r.png", 1)
    answer = json.loads(Path("r.json").read_text())
    x, y = answer["local_minimum"].values()
    assert (answer["points"][-1], x < 3.0) == ([x, y], True)
    assert f"stopped at {round(x, 3):.10g}, {round(y, 3):.10g}, in a local minimum" in err
    assert "--method geodesic finds its way" in err
    assert Path("r.png").exists()


def test_pairs_go_by_methods_other_than_astar(sh, hall):
    Path("pairs.csv").write_text("2,3.5,5,3.6\n2,3.5,5.5,3.5\n")
    line = "route hall.yaml --pairs pairs.csv --method"
    for method, options in (("descent", "--attractive-gain 100"), ("geodesic", "")):
        _, out, _ = sh(f"{line} {method} {options}")
        answers = map(json.loads, out.splitlines())
        for answer, ends in zip(answers, ("5,3.6", "5.5,3.5"), strict=True):
            own = sh(f"route hall.yaml --from 2,3.5 --to {ends} --method {method} {options}")[1]
            keys = ("method", "reached", "start", "goal", "length_m", "cost")
            assert answer["reached"]
            assert [answer[key] for key in keys] == [json.loads(own)[key] for key in keys]
    assert "attractive" in sh.err(f"{line} geodesic --attractive-gain 3", 2)
    assert "compare" in sh.err(f"{line} geodesic --compare plain", 2)


def test_potential_leaves_the_cost_to_go_out_where_memory_is_short(sh, room, monkeypatch):
    x, y = room.frame.xy_from_rowcol([[3, 6]])[0]
    sh.ok(f"potential room.yaml --goal {x},{y} -o all.npz")
    monkeypatch.setattr("mapdeal.pipeline.step.room", lambda: 1000)
    err = sh.err(f"potential room.yaml --goal {x},{y} -o few.npz")
    assert "cost_to_go and its gradient are left out: with them it would take " in err
    with np.load("all.npz") as every, np.load("few.npz") as few:
        assert set(every) - set(few) == {"cost_to_go", "cost_to_go_gradient"}
        assert all(every[key].tobytes() == few[key].tobytes() for key in few)
    assert read_map("all.npz").cost_to_go.tobytes() == np.load("all.npz")["cost_to_go"].tobytes()
    assert read_map("few.npz").cost_to_go is None


def test_routes_keep_the_obstacles_of_fields_and_warn_of_costs_like_maps(sh, hall):
    sh("esdf hall.yaml -o e.npz")
    assert sh(f"route e.npz {ENDS}")[1] == sh(f"route hall.yaml {ENDS}")[1]
    sh("esdf hall.yaml -o short.npz --max-distance 0.3")
    assert "max_distance" in sh.err(f"route short.npz {ENDS}", 2)
    sh("cost hall.yaml -o c.yaml")
    assert sh.err(f"route c.yaml {ENDS} -q") == ""
    err = sh.err(f"route c.yaml {ENDS}")
    assert (err.startswith("warning: "), "1..99" in err) == (True, True)


@pytest.mark.parametrize("method", ["astar", "descent"])
@pytest.mark.parametrize(("more", "cost"), [("", 4.0), ("--cost-travel-multiplier 6", 8.0)])
def test_route_weighs_costs_as_nav2_does_unless_options_say_otherwise(sh, method, more, cost):
    # half of 252, the highest cost that is open: 2 m of 1 + 2 * 126 / 252
    write_map("c.npz", mapdeal.Costmap(np.full((1, 5), 126, np.uint8), 0.5))
    route = sh.json(f"route c.npz --from 0.25,0.25 --to 2.25,0.25 --method {method} {more}")
    assert (route["reached"], route["length_m"], route["cost"]) == (True, 2.0, pytest.approx(cost))


@pytest.mark.parametrize(("x", "y", "inflation_radius"), [
    (0.1, 0.1, 0.7), (0.5, 0.5, 0.5 + 0.7 - 0.225498499), (1.5, 0.3, math.hypot(1.5, 0.3)),
])  # fmt: skip
def test_costs_of_a_route_reach_beyond_every_robot(x, y, inflation_radius):
    robot = mapdeal.Footprint.polygon([[x, y], [x, -y], [-x, -y], [-x, y]])
    (cost,) = (step for step in _recipe_for(robot).steps if step.name == "cost")
    assert cost.parameters["inflation_radius"] == pytest.approx(inflation_radius, rel=1e-8)
    assert cost.parameters["inscribed_radius"] == min(x, y)


def test_the_field_in_the_heuristic_has_the_weight_of_its_option(sh, hall):
    line = f"route hall.yaml {ENDS}"
    words = ("octile", "field", "field --heuristic-weight 6", "field --heuristic-weight 0")
    plain, field, more, none = (sh.json(f"{line} --heuristic {heuristic}") for heuristic in words)
    assert none == plain == sh.json(line)
    assert (field["optimal"], plain["optimal"]) == (False, True)
    assert more["mean_clearance_m"] > field["mean_clearance_m"] > plain["mean_clearance_m"]
    assert "m on average" in sh.ok(f"{line} --heuristic field -o r.json")


def printed_means(err):
    head, *rows = err.splitlines()
    assert head.startswith("means of ")
    return {row.split()[0]: row.split()[1:] for row in rows}


@pytest.fixture
def pairs(hall):
    Path("p.csv").write_text("from_x,from_y,to_x,to_y\n1.05,1.05,5.05,1.05\n[[1, 3.5], [5, 3.5]]\n")


def test_pairs_get_a_line_for_each_method_and_their_means(sh, answers_to, pairs):
    line = "route hall.yaml --pairs p.csv"
    lines, means = answers_to(line), printed_means(sh.err(line))
    options = {"plain": "", "cost": "--field-weight 1", "heuristic": "--heuristic field"}
    requested = [(pair, method) for pair in (1, 2) for method in options]
    assert [(answer["pair"], answer["method"]) for answer in lines] == requested
    assert all(list(answer) == ["pair", "method", *ROUTE_KEYS] for answer in lines)
    for answer in lines:
        start, goal = (",".join(map(str, answer[end].values())) for end in ("start", "goal"))
        single = sh.json(f"route hall.yaml --from {start} --to {goal} {options[answer['method']]}")
        same = set(ROUTE_KEYS) - ({"cost"} if answer["method"] == "cost" else set())
        assert {key: answer[key] for key in same} == {key: single[key] for key in same}
    by_plain = {answer["method"]: answer["cost"] for answer in lines[:3]}
    assert by_plain["plain"] <= min(by_plain["cost"], by_plain["heuristic"])
    keys = ["mean_clearance_m", "min_clearance_m", "length_m", "cost", "expanded"]
    for method in options:
        of_method = [answer for answer in lines if answer["method"] == method]
        mean = [sum(answer[key] for answer in of_method) / 2 for key in keys]
        assert means[method] == "{:.3f} m {:.3f} m {:.2f} m {:.2f} {:.0f}".format(*mean).split()
    assert sh(f"{line} -o new/r.jsonl -q")[:2] == (0, "")
    assert Path("new/r.jsonl").read_text() == sh(line)[1]


def test_pairs_are_compared_by_chosen_methods_and_weights(sh, answers_to, pairs):
    line = "route hall.yaml --pairs p.csv --through-unknown --compare"
    single = "route hall.yaml --from 1.05,1.05 --to 5.05,1.05"
    both = f"{line} heuristic,plain,plain --heuristic-weight 6"
    assert list(printed_means(sh.err(both))) == ["heuristic", "plain"]
    assert [answer["method"] for answer in answers_to(both)] == ["heuristic", "plain"] * 2
    alone = sh.json(f"{single} --heuristic field --heuristic-weight 6")
    assert answers_to(both)[0]["length_m"] == alone["length_m"]
    alone = sh.json(f"{single} --field-weight 7")
    assert answers_to(f"{line} cost --field-weight 7 -q")[0]["length_m"] == alone["length_m"]


def test_pairs_that_cannot_be_planned_are_reported_and_the_others_go_on(sh, hall):
    Path("p.csv").write_text("1,1,5,1\n3.05,1,5,1\n1,1\n99,1,5,1\n1,1,5,3\n")
    code, out, err = sh("route hall.yaml --pairs p.csv --compare plain -o r.jsonl")
    assert (code, out) == (5, "r.jsonl: 5 pairs by plain\n")
    lines = [json.loads(line) for line in Path("r.jsonl").read_text().splitlines()]
    assert [(answer["pair"], "error" in answer) for answer in lines] == [
        (1, False), (2, True), (3, True), (4, True), (5, False),
    ]  # fmt: skip
    assert lines[1]["error"].startswith("start: lies in a closed cell")
    assert lines[1]["hint"].startswith("the nearest open cell is 0.3 m away")
    assert lines[2] == {"pair": 3, "line": 3, "error": "must be four numbers x,y,x,y, got '1,1'"}
    assert (lines[3]["line"], lines[3]["start"]) == (4, {"x": 99.0, "y": 1.0})
    assert "outside" in lines[3]["error"]
    assert err.startswith("means of 2 pairs ")
    assert err.endswith("\nerror: p.csv: 3 of 5 pairs have no routes\n")


def test_pairs_without_a_way_are_a_finding_and_no_pairs_an_error(sh, answers_to, hall):
    write_map("c.npz", exponential_cost(hall, inscribed_radius=1.3, inflation_radius=1.4))
    Path("p.csv").write_text("1,1,5,1\n1,1,1.5,1\n")
    line = "route c.npz --pairs p.csv"
    err = sh.err(line, 1)
    assert [answer["reached"] for answer in answers_to(line)] == [False] * 3 + [True] * 3
    assert err.startswith("means of 1 pair  ")
    assert "no route leads from start to goal in 1 of 2 pairs" in err
    Path("p.csv").write_text("1,1,5,1\n")
    assert "means" not in sh.err(line, 1)
    Path("p.csv").write_text("x,y,x,y\n")
    assert sh(f"{line} -o r.jsonl") == (3, "", "error: p.csv: holds no pairs of points\n")
    Path("p.csv").write_text("x,y\n")
    assert sh("query hall.yaml --points p.csv") == (3, "", "error: p.csv: holds no points\n")
    assert not Path("r.jsonl").exists()


def test_pairs_without_obstacles_have_no_clearance(sh, answers_to):
    write_map("free.npz", mapdeal.Costmap(np.zeros((9, 9), np.uint8), 0.1))
    Path("p.csv").write_text("0.1,0.1,0.7,0.7\n")
    line = "route free.npz --pairs p.csv"
    warning, _, means = sh.err(line).partition("\n")
    assert answers_to(line)[0]["mean_clearance_m"] is None
    assert warning.endswith("free.npz: 100 % of the open cells cost 0: there is no obstacle")
    assert printed_means(means)["plain"][:2] == ["-", "-"]


ROBOT = "[[0.12,0.06],[0.12,-0.06],[-0.12,-0.06],[-0.12,0.06]]"
SHAPE = Footprint.parse(ROBOT)
QUERY = f"query cost.npz --footprint {ROBOT}"


@pytest.fixture
def costmap(room):
    costs = mapdeal.exponential_cost(room, inscribed_radius=0.06, inflation_radius=0.4)
    write_map("cost.npz", costs)
    return costs


def poses_at(grid, *places):
    """Poses at rows and columns of a grid, along its own axes."""
    points = grid.frame.xy_from_continuous_rowcol([place[:2] for place in places])
    return np.column_stack([points, [place[2] + grid.origin[2] for place in places]]).tolist()


def at(poses):
    return " ".join("--at " + ",".join(map(repr, pose)) for pose in poses)


def test_costs_at_poses_are_those_of_the_library(answers_to, costmap):
    poses = poses_at(costmap, (1.5, 5.5, 0), (0.9, 4.5, 0), (1.5, 6.5, 0), (3.6, 4, 1.5), (9, 9, 0))
    keys = ["x", "y", "yaw", "inside", "cost", "state"]
    answers = answers_to(f"{QUERY} {at(poses)}")
    assert [list(answer) for answer in answers] == [keys] * 5
    assert [[answer[key] for key in keys[:3]] for answer in answers] == poses
    assert [answer["cost"] for answer in answers] == footprint_costs(costmap, SHAPE, poses).tolist()
    states = [answer["state"] for answer in answers]
    assert states == ["unknown", "collision", "free", "outside", "outside"]
    assert [answer["inside"] for answer in answers] == [True, True, True, False, False]


FREE, HIT, UNKNOWN = (0, "free"), (254, "collision"), (255, "unknown")


@pytest.mark.parametrize(("words", "expected"), [
    ("", [HIT, HIT, UNKNOWN, FREE]),  # stands over the obstacle
    ("--rule outline", [HIT, HIT, UNKNOWN, FREE]),
    ("--rule full", [HIT, HIT, UNKNOWN, HIT]),
])  # fmt: skip
def test_all_states_and_rules_of_a_map(answers_to, room, words, expected):
    robot = "[[0.14,0.1],[0.14,-0.1],[-0.14,-0.1],[-0.14,0.1]]"
    poses = at(poses_at(room, (1.5, 4.5, 0), (1.5, 3.5, 0), (2.5, 5.5, 0), (2.5, 1.5, 0)))
    answers = answers_to(f"query room.yaml --footprint {robot} {poses} {words}")
    assert [(answer["cost"], answer["state"]) for answer in answers] == expected


def test_the_threshold_of_a_map_is_that_of_other_commands(answers_to, here):
    write_map("m.npz", OccupancyGrid([[0, 50, 99, 100]], 0.5, (0.0, 0.0, 0.0)))
    poses = at([[0.25 + 0.5 * col, 0.25, 0.0] for col in range(4)])
    answers = answers_to(f"query m.npz --robot-radius 0.01 {poses}")
    assert [answer["cost"] for answer in answers] == [0, 0, 0, 254]


def test_a_round_robot_is_padded_as_costmap_2d_pads_its_16_corners(answers_to, costmap):
    poses = poses_at(costmap, *np.random.default_rng(0).uniform((1, 1, -3), (3, 7, 3), (80, 3)))
    answers = answers_to(f"query cost.npz --robot-radius 0.05 --footprint-padding 0.04 {at(poses)}")
    expected = footprint_costs(costmap, Footprint.sixteen_gon(0.05).padded(0.04), poses).tolist()
    assert [answer["cost"] for answer in answers] == expected
    assert expected != footprint_costs(costmap, Footprint.sixteen_gon(0.09), poses).tolist()


def test_a_file_of_poses_is_answered_line_by_line(sh, answers_to, costmap):
    (x, y, yaw), = poses_at(costmap, (2.5, 4.5, 0))  # fmt: skip
    lines = ["x y theta", f"{x!r} {y!r} {yaw!r}", "1,2", "", f"[{x!r}, {y!r}, {yaw!r}]", "nan 1 2"]
    Path("p.txt").write_text("\n".join(lines) + "\n")
    line = f"{QUERY} --poses p.txt"
    answers = answers_to(line)
    assert answers[0] == answers[3]
    assert answers[0]["inside"] is True
    nothing = {"inside": False, "cost": None, "state": None}
    rule = "must be three numbers x,y,yaw, or TUM's t x y z qx qy qz qw, got '1,2'"
    assert answers[1] == {"x": None, "y": None, "yaw": None, **nothing, "line": 3, "error": rule}
    assert answers[2]["error"] == "empty line"
    assert (answers[4]["x"], answers[4]["yaw"], answers[4]["line"]) == (None, 2.0, 6)
    assert sh.err(line) == "warning: p.txt: 3 of 5 hold no finite pose\n"
    assert "3 of 5 poses are not inside of the map" in sh.err(f"{line} --strict", 1)
    first_poses = poses_at(costmap, (2.5, 4.5, 0), (2.5, 4.2, 1))  # these come first
    yaws = [answer["yaw"] for answer in answers_to(f"{line} {at(first_poses)}")]
    assert yaws == [first_poses[0][2], first_poses[1][2], *(answer["yaw"] for answer in answers)]


@pytest.mark.parametrize("pose", ["nan,1,1", "1,inf,1", "1e308,-1e308,1", "1,1,1e308", "1,1,-inf"])
def test_any_number_is_answered(answers_to, costmap, pose):
    (answer,) = answers_to(f"{QUERY} --at {pose}")
    assert answer["inside"] is False
    assert answer["state"] == (None if "n" in pose else "outside")


def test_degrees_published_costs_and_distances_to_costs_are_warned_of(sh, answers_to, costmap):
    message = "1 of 2 poses have a yaw of more than a turn; is it in degrees?"
    assert sh.err(f"{QUERY} --at 1.6,-1.9,90 1.6,-1.9,1") == f"warning: {message}\n"
    write_map("c.yaml", costmap)
    line = f"{QUERY} {at(poses_at(costmap, (2.5, 4.5, 0)))}"
    assert answers_to(line)[0]["cost"] not in (0, 254)
    line = line.replace("cost.npz", "c.yaml")
    assert answers_to(line)[0]["cost"] == 0
    assert "cells of 1..99 are not obstacles; costs are read from an npz" in sh.err(line)
    code, out, err = sh("query cost.npz --at 1.6,-1.9")
    assert (code, "gradient" in json.loads(out)) == (0, True)
    assert "read as the occupancy that ROS would publish" in err


def test_many_poses_are_those_of_the_library(answers_to, here):
    rng = np.random.default_rng(2)
    cells = rng.choice(np.array([0, 99, 254, 255], np.uint8), (60, 90), p=[0.9, 0.05, 0.03, 0.02])
    costmap = mapdeal.Costmap(cells, 0.1, (1.5, -2.0, 0.4))
    write_map("cost.npz", costmap)
    poses = rng.uniform((-1, -1, -3), (9, 9, 3), (9_000, 3))
    np.savetxt("p.csv", poses, fmt="%.17g", delimiter=",")
    found = [answer["cost"] for answer in answers_to(f"{QUERY} --poses p.csv")]
    assert found == footprint_costs(costmap, SHAPE, poses).tolist()
    assert len(set(found)) == 4
