"""The commands that ask a field: query, potential, route."""

import json
import math
import subprocess
import sys

import numpy as np
import pytest

from drawn import grid_from_text
from mapdeal import (
    Costmap,
    Footprint,
    esdf,
    exponential_cost,
    read_map,
    shortest_route,
    threshold_cost,
    write_map,
)
from mapdeal.commands.route import _recipe_for

ROOM = "........\n.#......\n......?.\n...##..."
ROUTE_KEYS = ["reached", "start", "goal", "length_m", "min_clearance_m", "mean_clearance_m",
              "cost", "expanded", "optimal"]  # fmt: skip
KEYS = ["x", "y", "inside", "row", "col", "state", "distance", "gradient", "cell_distance"]


@pytest.fixture
def room(tmp_path):
    write_map(tmp_path / "room.yaml", grid_from_text(ROOM, 0.1, (1.5, -2.0, 0.4)))
    return tmp_path / "room.yaml"


@pytest.fixture
def hall(tmp_path):
    """A map with a wall and a door, room for a robot of 0.22 m."""
    occupancy = np.zeros((40, 60), np.int8)
    occupancy[:28, 30] = 100
    grid = grid_from_text("." * 60, 0.1, (0.0, 0.0, 0.0))
    write_map(tmp_path / "hall.yaml", type(grid)(occupancy, 0.1, (0.0, 0.0, 0.0)))
    return tmp_path / "hall.yaml"


def _asked(out):
    return [json.loads(line) for line in out.splitlines()]


@pytest.mark.parametrize("as_field", [False, True])
def test_query_answers_what_the_library_does(command, room, tmp_path, as_field):
    source = room
    if as_field:
        source = tmp_path / "e.npz"
        command("esdf", room, "-o", source)
    field = esdf(read_map(room))
    points = field.frame.xy_from_continuous_rowcol([[0.7, 2.2], [2.5, 1.5], [1.2, 6.9], [9, 9]])
    at = [word for x, y in points.tolist() for word in ("--at", f"{x!r},{y!r}")]
    code, out, err = command("query", source, *at)
    assert (code, err) == (0, "")
    samples = field.query(points)
    answers = _asked(out)
    assert [list(answer) for answer in answers] == [KEYS] * 4
    assert [answer["state"] for answer in answers] == ["free", "occupied", "unknown", None]
    assert [(a["row"], a["col"]) for a in answers[:3]] == [(0, 2), (2, 1), (1, 6)]
    for index, answer in enumerate(answers[:3]):
        assert answer["inside"] is True
        assert [answer["x"], answer["y"]] == points[index].tolist()
        assert answer["distance"] == pytest.approx(samples.distance[index], rel=1e-8)
        assert answer["gradient"] == pytest.approx(samples.gradient[index].tolist(), rel=1e-8)
        own = field.distance[answer["row"], answer["col"]]
        assert np.float32(answer["cell_distance"]) == own
    assert answers[3] == {**dict.fromkeys(KEYS), "x": points[3, 0], "y": points[3, 1],
                          "inside": False}  # fmt: skip


def test_query_says_null_for_what_is_infinite(command, tmp_path):
    write_map(tmp_path / "m.yaml", grid_from_text("...", 0.5, (0.0, 0.0, 0.0)))
    (answer,) = _asked(command("query", tmp_path / "m.yaml", "--at", "0.6,0.2")[1])
    assert (answer["inside"], answer["state"]) == (True, "free")
    assert answer["distance"] is answer["gradient"] is answer["cell_distance"] is None


def test_query_tells_a_point_that_is_not_finite(command, room):
    (answer,) = _asked(command("query", room, "--at", "nan,1")[1])
    assert (answer["inside"], answer["x"], answer["y"]) == (False, None, 1.0)
    assert answer["error"] == "must be finite, got nan,1"
    assert "line" not in answer


def test_query_states_go_by_the_field_s_own_threshold(command, tmp_path):
    write_map(tmp_path / "m.yaml", grid_from_text(".+#", 0.5, (0.0, 0.0, 0.0)))
    at = ["--at", "0.75,0.25"]
    (free,) = _asked(command("query", tmp_path / "m.yaml", *at)[1])
    (occupied,) = _asked(command("query", tmp_path / "m.yaml", *at, "--lethal-threshold", 50)[1])
    assert (free["state"], occupied["state"]) == ("free", "occupied")


def test_several_points_may_follow_one_option(command, room, tmp_path):
    one, two, three = "1.6,-1.9", "-1.7,-1.8", "2e0,-1.5"
    once = command("query", room, "--at", one, two, three, "--strict")
    assert once == command("query", "--at", one, "--at", two, "--at", three, "--strict", room)
    assert once[0] == 1
    assert once[1].count("\n") == 3
    words = ["edit", "polygon", room, "--value", 100]
    corners = ["1.5,-2", "1.9,-2", "1.9,-1.6"]
    assert command(*words, "-o", tmp_path / "a.npz", "--point", *corners)[0] == 0
    repeated = [word for corner in corners for word in ("--point", corner)]
    assert command(*words, "-o", tmp_path / "b.npz", *repeated)[0] == 0
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


@pytest.mark.parametrize("words", [["query", "{}", "--at", "1.6", "-1.9"],
                                   ["route", "{}", "--from", "1", "2", "--to", "3,4"]])  # fmt: skip
def test_points_with_a_space_are_told_how_to_write_them(command, room, words):
    code, _, err = command(*[word.format(room) for word in words])
    assert code == 2
    assert "X,Y, without a space" in err


@pytest.mark.parametrize("name", ["query", "route"])
def test_of_a_potential_field_only_the_map_is_asked_with_a_warning(command, room, tmp_path, name):
    command("potential", room, "-o", tmp_path / "p.npz")
    point = "1.7,-1.8"
    options = ["--at", point] if name == "query" else ["--from", point, "--to", point]
    code, _, err = command(name, tmp_path / "p.npz", *options)
    assert code in (0, 2)
    assert err.startswith(f"warning: {tmp_path / 'p.npz'}: is a potential field")


def test_query_takes_the_field_s_parameters_for_a_map_only(command, room, tmp_path):
    point = ["--at", "{},{}".format(*esdf(read_map(room)).frame.xy_from_rowcol([[1, 6]])[0])]
    (free,) = _asked(command("query", room, *point)[1])
    (occupied,) = _asked(command("query", room, *point, "--unknown", "occupied")[1])
    assert free["distance"] > 0
    assert occupied["distance"] == 0
    assert occupied["state"] == "unknown"
    command("esdf", room, "-o", tmp_path / "e.npz")
    code, _, err = command("query", tmp_path / "e.npz", *point, "--unknown", "occupied")
    assert code == 2
    assert "unknown" in err


def test_query_p7_has_a_status_for_every_line_and_is_strict_on_demand(command, room, tmp_path):
    frame = read_map(room).frame
    x, y = frame.xy_from_rowcol([[0, 0]])[0]
    edge = frame.xy_from_continuous_rowcol([[1.0, 8.0]])[0].tolist()
    lines = [f"{x},{y}", "nan,1", "1,2,3", "", f"{edge[0]!r},{edge[1]!r}", f'{{"x":{x},"y":{y}}}']
    (tmp_path / "p.csv").write_text("\n".join(lines) + "\n")
    code, out, err = command("query", room, "--points", tmp_path / "p.csv")
    answers = _asked(out)
    assert code == 0
    assert [answer["inside"] for answer in answers] == [True] + [False] * 4 + [True]
    assert answers[0] == answers[5]
    assert answers[1]["x"] is None
    assert [(a["line"], "error" in a) for a in answers if "line" in a] == [
        (2, True),
        (3, True),
        (4, True),
    ]
    assert err == f"warning: {tmp_path / 'p.csv'}: 3 of 6 hold no finite point\n"
    code, strict_out, err = command("query", room, "--points", tmp_path / "p.csv", "--strict")
    assert (code, strict_out) == (1, out)
    assert "4 of 6 points" in err
    assert command("query", room, "--at", f"{x},{y}", "--strict")[0] == 0


def test_query_reads_standard_input_and_answers_at_once(room):
    words = [sys.executable, "-m", "mapdeal", "query", room, "--points", "-"]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        for x in (1.55, 1.6):
            process.stdin.write(f"{x},-1.9\n".encode())
            process.stdin.flush()
            assert json.loads(process.stdout.readline())["x"] == x
        process.stdin.close()
        assert process.wait() == 0


def test_query_without_standard_input_f12(room):
    words = f'"{sys.executable}" -m mapdeal query "{room}" --points - <&-'
    done = subprocess.run(["bash", "-c", words], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "error: standard input: is closed\n"


def test_query_stops_quietly_when_its_reader_has_gone(room, tmp_path):
    (tmp_path / "p.csv").write_text("1.55,-1.9\n" * 100_000)
    words = f'"{sys.executable}" -m mapdeal query "{room}" --points "{tmp_path}/p.csv" | head -n 1'
    done = subprocess.run(["bash", "-c", f"set -o pipefail; {words}"], capture_output=True)
    assert (done.returncode, done.stderr) == (0, b"")


def test_potential_writes_the_layers_and_the_picture(command, room, tmp_path):
    x, y = read_map(room).frame.xy_from_rowcol([[3, 6]])[0]
    code, out, err = command("potential", room, "-o", tmp_path / "p.npz", "--goal", f"{x},{y}",
                             "--image", tmp_path / "p.png")  # fmt: skip
    assert (code, err) == (0, "")
    assert f"goal {x:.10g}, {y:.10g}, potential" in out
    with np.load(tmp_path / "p.npz") as entries:
        assert entries["attractive"][3, 6] == pytest.approx(0, abs=1e-9)
        assert entries["gradient"].shape == (2, 4, 8)
    assert (tmp_path / "p.png").read_bytes().startswith(b"\x89PNG")
    report = _asked(command("info", tmp_path / "p.npz", "--json")[1])[0]
    assert (report["kind"], report["obstacles"]) == ("potential field", 3)
    assert "attractive_gain 1" in command("info", tmp_path / "p.npz")[1]


def test_potential_is_a_stage_of_recipes_that_hands_its_map_on(command, room, tmp_path):
    (tmp_path / "r.yaml").write_text(
        "stages: [esdf, {potential: {goal: [1.6, -1.9]}}, {cost: {inflation_radius: 0.2}}]\n"
    )
    words = ["run", room, "-o", tmp_path / "out", "--recipe", tmp_path / "r.yaml"]
    code, _, err = command(*words)
    assert (code, err) == (0, "")
    folder = tmp_path / "out/room"
    assert {"potential.npz", "potential.png", "cost.npz"} <= {p.name for p in folder.iterdir()}
    assert not (folder / "potential.yaml").exists()
    field = esdf(read_map(room))
    expected = exponential_cost(field, inflation_radius=0.2).cost
    assert np.array_equal(read_map(folder / "cost.npz").cost, expected)
    manifest = json.loads((folder / "manifest.json").read_text())
    assert manifest["stages"][1]["potential"]["goal"] == [1.6, -1.9]
    again = [*words, "--set", "potential.goal=1.7,-1.8", "--force"]
    assert command(*again)[0] == 0
    assert read_map(folder / "potential.npz").goal == (1.7, -1.8)


@pytest.mark.parametrize("name", ["edit", "window", "convert", "shift"])
def test_a_potential_field_is_not_for_what_wants_values(command, room, tmp_path, name):
    command("potential", room, "-o", tmp_path / "p.npz")
    words = {
        "edit": ["edit", "circle", "--point", "1.6,-1.9", "--radius", "1", "--value", "1"],
        "window": ["window", "--at", "1.6,-1.9", "--size", "0.1,0.1"],
        "convert": ["convert", "--encoding", "amcl"],
        "shift": ["shift", "--origin", "1.6,-1.9"],
    }[name]
    code, _, err = command(*words, tmp_path / "p.npz", "-o", tmp_path / "o.npz")
    assert code == 2, err
    assert "field" in err
    assert not (tmp_path / "o.npz").exists()


def test_maps_are_made_of_a_potential_field_s_map(command, room, tmp_path):
    command("potential", room, "-o", tmp_path / "p.npz")
    assert command("esdf", tmp_path / "p.npz", "-o", tmp_path / "e.npz")[0] == 0
    assert np.array_equal(read_map(tmp_path / "e.npz").distance, esdf(read_map(room)).distance)
    code, _, err = command("convert", tmp_path / "p.npz", "-o", tmp_path / "p.yaml")
    assert code == 2
    assert "npz" in err


def test_route_prints_its_answer_or_writes_it(command, hall, tmp_path):
    words = ["route", hall, "--from", "1,1", "--to", "5,1"]
    code, out, err = command(*words)
    assert (code, err) == (0, "")
    answer = json.loads(out)
    assert list(answer) == ["method", *ROUTE_KEYS, "points"]
    assert (answer["optimal"], type(answer["expanded"])) == (True, int)
    assert answer["mean_clearance_m"] > answer["min_clearance_m"]
    assert answer["reached"] is True
    assert (answer["points"][0], answer["points"][-1]) == ([1.0, 1.0], [5.0, 1.0])
    steps = [math.dist(a, b) for a, b in zip(answer["points"], answer["points"][1:], strict=False)]
    assert answer["length_m"] == pytest.approx(sum(steps), abs=1e-6)
    assert answer["length_m"] > 2 * math.hypot(2, 1.8)
    assert answer["cost"] >= answer["length_m"]
    assert answer["min_clearance_m"] > 0.22
    code, said, err = command(*words, "-o", tmp_path / "r.json", "--image", tmp_path / "r.png")
    assert (code, err) == (0, "")
    assert (tmp_path / "r.json").read_text() == out
    assert said.startswith(f"{tmp_path / 'r.json'}: {answer['length_m']:.2f} m")
    assert (tmp_path / "r.png").read_bytes().startswith(b"\x89PNG")


def test_route_takes_costs_as_they_are(command, hall, tmp_path):
    cost = exponential_cost(read_map(hall), inscribed_radius=1.3, inflation_radius=1.4)
    write_map(tmp_path / "c.npz", cost)
    words = ["route", tmp_path / "c.npz", "--from", "1,1", "--to", "5,1"]
    code, out, err = command(*words, "--image", tmp_path / "c.png")
    assert code == 1
    answer = json.loads(out)
    assert answer == {
        "method": "astar", "reached": False, "start": [1.0, 1.0], "goal": [5.0, 1.0],
        "length_m": None, "min_clearance_m": None, "mean_clearance_m": None, "cost": None,
        "expanded": answer["expanded"], "optimal": True, "points": [],
    }  # fmt: skip
    assert 0 < answer["expanded"] < 30 * 40  # no more than this side of the wall
    assert err.startswith(f"error: {tmp_path / 'c.npz'}: no route leads to 5, 1\n")
    assert (tmp_path / "c.png").exists()
    write_map(tmp_path / "t.npz", threshold_cost(esdf(read_map(hall))))
    assert command("route", tmp_path / "t.npz", *words[2:])[0] == 0
    assert command(*words, "--robot-radius", 0.3)[0] == 2


def test_route_knows_the_robot_s_size(command, hall):
    words = ["route", hall, "--from", "1,1", "--to", "5,1"]
    # 12 cells between the wall's end and the edge; the recipe's own reach is 0.7
    for radius in (0.5, 0.599):
        code, out, err = command(*words, "--robot-radius", radius)
        assert (code, err) == (0, "")
        assert json.loads(out)["min_clearance_m"] > radius
        assert command("reach", *words[1:], "--robot-radius", radius)[0] == 0
    for radius in (0.6, 0.9):
        assert command(*words, "--robot-radius", radius)[0] == 1
        assert command("reach", *words[1:], "--robot-radius", radius)[0] == 1
    assert command(*words, "--robot-radius", 1.3)[0] == 2  # the start is 1.05 m from the edge


def test_route_by_descent_reaches_the_goal_or_tells_the_local_minimum(command, hall, tmp_path):
    words = ["route", hall, "--method", "descent", "--attractive-gain", "100"]
    code, out, err = command(*words, "--from", "2,3.5", "--to", "5,3.6")
    assert (code, err) == (0, "")
    answer = json.loads(out)
    assert (answer["reached"], answer["local_minimum"]) == (True, None)
    assert (answer["optimal"], answer["expanded"]) == (False, None)
    code, out, err = command(*words, "--from", "1,1", "--to", "5,1", "-o", tmp_path / "r.json",
                             "--image", tmp_path / "r.png")  # fmt: skip
    assert code == 1
    answer = json.loads((tmp_path / "r.json").read_text())
    x, y = answer["local_minimum"]
    assert answer["points"][-1] == [x, y]
    assert x < 3.0
    assert f"stopped at {round(x, 3):.10g}, {round(y, 3):.10g}" in err
    assert (tmp_path / "r.png").exists()


def test_route_warns_where_costs_look_like_a_map(command, hall, tmp_path):
    command("cost", hall, "-o", tmp_path / "c.yaml")
    code, _, err = command("route", tmp_path / "c.yaml", "--from", "1,1", "--to", "5,1", "-q")
    assert (code, err) == (0, "")
    code, _, err = command("route", tmp_path / "c.yaml", "--from", "1,1", "--to", "5,1")
    assert code == 0
    assert err.startswith("warning: ")
    assert "1..99" in err


def test_a_field_keeps_its_own_obstacles_on_a_route(command, hall, room, tmp_path):
    command("esdf", hall, "-o", tmp_path / "e.npz")
    words = ["--from", "1,1", "--to", "5,1"]
    assert command("route", tmp_path / "e.npz", *words)[1] == command("route", hall, *words)[1]
    command("esdf", hall, "-o", tmp_path / "short.npz", "--max-distance", "0.3")
    code, _, err = command("route", tmp_path / "short.npz", *words)
    assert code == 2
    assert "max_distance" in err


def test_query_ends_with_its_reader_though_points_go_on(room):
    words = f'yes 1.55,-1.9 | "{sys.executable}" -m mapdeal query "{room}" --points - | head -n 1'
    done = subprocess.run(["bash", "-c", words], capture_output=True, timeout=120)
    assert done.stdout.count(b"\n") == 1
    assert done.stderr == b""


def test_lost_answers_are_worse_than_a_finding(room):
    words = f'"{sys.executable}" -m mapdeal query "{room}" --at 99,99 --strict'
    assert subprocess.run(["bash", "-c", words], capture_output=True).returncode == 1
    done = subprocess.run(["bash", "-c", f"{words} > /dev/full"], capture_output=True, text=True)
    assert done.returncode == 4
    assert done.stderr.startswith("error: standard output: cannot be written")
    assert done.stderr.count("error:") == 1


def test_a_goal_in_brackets_can_be_set(command, room, tmp_path):
    (tmp_path / "r.yaml").write_text("stages: [potential]\n")
    words = ["run", room, "-o", tmp_path / "out", "--recipe", tmp_path / "r.yaml", "--no-images"]
    assert command(*words, "--set", "potential.goal=[1.6, -1.9]")[0] == 0
    assert read_map(tmp_path / "out/room/potential.npz").goal == (1.6, -1.9)
    assert command(*words, "--set", "potential.goal=none", "--force")[0] == 0
    assert read_map(tmp_path / "out/room/potential.npz").goal is None


def test_strict_counts_the_points_of_all_sources(command, room, tmp_path):
    x, y = read_map(room).frame.xy_from_rowcol([[0, 0]])[0]
    (tmp_path / "in.csv").write_text(f"{x},{y}\n")
    (tmp_path / "out.csv").write_text("99,99\n98,98\n")
    code, _, err = command(
        "query", room, "--at", "99,99", "--points", tmp_path / "in.csv", "--strict"
    )
    assert (code, "1 of 2 points are not inside of the map" in err) == (1, True)
    words = ["query", room, "--at", "99,99", "--points", tmp_path / "out.csv"]
    code, _, err = command(*words, "--strict")
    assert (code, "3 of 3 points" in err) == (1, True)
    code, _, err = command(*words, "-v")
    assert (code, err) == (0, "3 points, 3 of them outside of the map\n")


def test_query_tells_distances_of_a_hair_and_no_noise_of_rounding(command, tmp_path):
    write_map(tmp_path / "m.yaml", grid_from_text("#...", 1e-5, (0.0, 0.0, 0.0)))
    at = ["--at", "1.5e-5,0.5e-5", "--at", "1e-5,0.5e-5"]
    one, between = _asked(command("query", tmp_path / "m.yaml", *at)[1])
    assert (one["distance"], one["cell_distance"]) == (1e-5, 1e-5)
    assert between["distance"] == pytest.approx(0.5e-5, rel=1e-6)
    write_map(tmp_path / "t.yaml", grid_from_text("...\n.#.\n...", 0.1, (0.0, 0.0, 1.1)))
    x, y = read_map(tmp_path / "t.yaml").frame.xy_from_continuous_rowcol([[1.5, 1.5]])[0]
    (answer,) = _asked(command("query", tmp_path / "t.yaml", "--at", f"{x},{y}")[1])
    assert answer["distance"] == 0.0


def test_route_weighs_costs_as_nav2_does_unless_it_is_told_otherwise(command, tmp_path):
    cost = np.full((1, 5), 126, np.uint8)  # half of 252, the highest cost that is open
    write_map(tmp_path / "c.npz", Costmap(cost, 0.5))
    words = ["route", tmp_path / "c.npz", "--from", "0.25,0.25", "--to", "2.25,0.25"]
    route = json.loads(command(*words)[1])
    assert (route["length_m"], route["cost"]) == (2.0, 4.0)  # 2 m of 1 + 2 * 126 / 252
    route = json.loads(command(*words, "--cost-travel-multiplier", "6")[1])
    assert (route["length_m"], route["cost"]) == (2.0, 8.0)


@pytest.mark.parametrize(
    ("corners", "inflation_radius"),
    [
        ([[0.1, 0.1], [0.1, -0.1], [-0.1, -0.1], [-0.1, 0.1]], 0.7),  # the recipe's own
        (
            [[0.5, 0.5], [0.5, -0.5], [-0.5, -0.5], [-0.5, 0.5]],
            0.9745015005041096,
        ),  # 0.5 + 0.7 - 0.2255
        ([[1.5, 0.3], [1.5, -0.3], [-1.5, -0.3], [-1.5, 0.3]], math.hypot(1.5, 0.3)),
    ],
)
def test_costs_of_a_route_reach_beyond_every_robot(corners, inflation_radius):
    (cost,) = (
        step for step in _recipe_for(Footprint.polygon(corners)).steps if step.name == "cost"
    )
    assert cost.parameters["inflation_radius"] == pytest.approx(inflation_radius, rel=1e-12)
    assert cost.parameters["inscribed_radius"] == min(corners[0])


def test_a_descent_is_weighed_as_it_is_told(command, tmp_path):
    write_map(tmp_path / "c.npz", Costmap(np.full((1, 5), 126, np.uint8), 0.5))
    words = ["route", tmp_path / "c.npz", "--method", "descent", "--from", "0.25,0.25"]
    for more, cost in (([], 4.0), (["--cost-travel-multiplier", "6"], 8.0)):
        code, out, _ = command(*words, "--to", "2.25,0.25", *more)
        route = json.loads(out)
        assert (code, route["reached"]) == (0, True)
        assert (route["length_m"], route["cost"]) == pytest.approx((2.0, cost))


def test_the_field_in_the_heuristic_is_the_library_s(command, hall, tmp_path):
    costmap = exponential_cost(read_map(hall), inscribed_radius=0.22)
    write_map(tmp_path / "c.npz", costmap)
    words = ["route", tmp_path / "c.npz", "--from", "1,1", "--to", "5,1"]
    plain = json.loads(command(*words)[1])
    for more, weight in (([], 2.0), (["--heuristic-weight", "6"], 6.0)):
        code, out, err = command(*words, "--heuristic", "field", *more)
        assert (code, err) == (0, "")
        answer = json.loads(out)
        route = shortest_route(costmap, (1.0, 1.0), (5.0, 1.0), heuristic_weight=weight)
        assert (answer["optimal"], answer["expanded"]) == (False, route.expanded)
        assert answer["points"] == [pytest.approx(p, abs=1e-9) for p in route.points_xy.tolist()]
        assert answer["cost"] == pytest.approx(route.cost, abs=1e-8)
        assert answer["mean_clearance_m"] == pytest.approx(route.mean_clearance, abs=1e-8)
        assert answer["mean_clearance_m"] > plain["mean_clearance_m"]
    same = json.loads(command(*words, "--heuristic", "field", "--heuristic-weight", "0")[1])
    assert same == plain
    assert json.loads(command(*words, "--heuristic", "octile")[1]) == plain
    code, said, _ = command(*words, "--heuristic", "field", "-o", tmp_path / "r.json",
                            "--image", tmp_path / "r.png")  # fmt: skip
    assert (code, "m on average" in said) == (0, True)


PAIRS = "from_x,from_y,to_x,to_y\n1.05,1.05,5.05,1.05\n[[1, 3.5], [5, 3.5]]\n"


def _means_told(err):
    head, *rows = err.splitlines()
    assert head.startswith("means of ")
    return {row.split()[0]: row.split()[1:] for row in rows}


def test_pairs_get_a_line_for_each_method_and_their_means(command, hall, tmp_path):
    (tmp_path / "p.csv").write_text(PAIRS)
    code, out, err = command("route", hall, "--pairs", tmp_path / "p.csv")
    assert code == 0
    lines = _asked(out)
    assert [(line["pair"], line["method"]) for line in lines] == [
        (pair, method) for pair in (1, 2) for method in ("plain", "cost", "heuristic")
    ]
    assert all(list(line) == ["pair", "method", *ROUTE_KEYS] for line in lines)
    ways = {"plain": [], "cost": ["--field-weight", "1"], "heuristic": ["--heuristic", "field"]}
    for line in lines:
        start, goal = (",".join(map(str, line[end])) for end in ("start", "goal"))
        single = command("route", hall, "--from", start, "--to", goal, *ways[line["method"]])[1]
        same = set(ROUTE_KEYS) - ({"cost"} if line["method"] == "cost" else set())
        assert {key: line[key] for key in same} == {key: json.loads(single)[key] for key in same}
    by_plain = {line["method"]: line["cost"] for line in lines[:3]}
    assert by_plain["plain"] <= min(by_plain["cost"], by_plain["heuristic"])
    for method, told in _means_told(err).items():
        of_method = [line for line in lines if line["method"] == method]
        keys = ["mean_clearance_m", "min_clearance_m", "length_m", "cost", "expanded"]
        mean, least, length, cost, expanded = (sum(one[k] for one in of_method) / 2 for k in keys)
        assert told == [
            f"{mean:.3f}", "m", f"{least:.3f}", "m", f"{length:.2f}", "m", f"{cost:.2f}",
            f"{expanded:.0f}",
        ]  # fmt: skip
    code, said, _ = command("route", hall, "--pairs", tmp_path / "p.csv", "-o",
                            tmp_path / "new/r.jsonl", "-q")  # fmt: skip
    assert (code, said) == (0, "")
    assert (tmp_path / "new/r.jsonl").read_text() == out


def test_pairs_are_compared_by_the_methods_and_weights_that_are_asked_for(command, hall, tmp_path):
    (tmp_path / "p.csv").write_text(PAIRS)
    words = ["route", hall, "--pairs", tmp_path / "p.csv", "--through-unknown"]
    code, out, err = command(*words, "--compare", "heuristic,plain,plain", "--heuristic-weight", 6)
    assert (code, list(_means_told(err))) == (0, ["heuristic", "plain"])
    lines = _asked(out)
    assert [line["method"] for line in lines] == ["heuristic", "plain"] * 2
    ends = ["--from", "1.05,1.05", "--to", "5.05,1.05"]
    single = command("route", hall, *ends, "--heuristic", "field", "--heuristic-weight", 6)[1]
    assert lines[0]["length_m"] == json.loads(single)["length_m"]
    code, out, err = command(*words, "--compare", "cost", "--field-weight", 7, "-q")
    single = command("route", hall, *ends, "--field-weight", 7)[1]
    assert (code, err) == (0, "")
    assert _asked(out)[0]["length_m"] == json.loads(single)["length_m"]


def test_pairs_that_cannot_be_planned_are_told_and_the_others_go_on(command, hall, tmp_path):
    (tmp_path / "p.csv").write_text("1,1,5,1\n3.05,1,5,1\n1,1\n99,1,5,1\n1,1,5,3\n")
    code, out, err = command(
        "route", hall, "--pairs", tmp_path / "p.csv", "--compare", "plain", "-o",
        tmp_path / "r.jsonl",
    )  # fmt: skip
    assert (code, out) == (5, f"{tmp_path / 'r.jsonl'}: 5 pairs by plain\n")
    lines = _asked((tmp_path / "r.jsonl").read_text())
    assert [line["pair"] for line in lines] == [1, 2, 3, 4, 5]
    assert ["error" in line for line in lines] == [False, True, True, True, False]
    assert lines[1]["error"] == "start: lies in a closed cell (cost 254), got (3.05, 1.0)"
    assert lines[1]["hint"].startswith("the nearest open cell is 0.3 m away")
    assert lines[2] == {
        "pair": 3, "line": 3, "error": "must be four numbers x,y,x,y, got '1,1'"
    }  # fmt: skip
    assert (lines[3]["line"], lines[3]["start"]) == (4, [99.0, 1.0])
    assert "outside" in lines[3]["error"]
    told = err.splitlines()
    assert told[0].startswith("means of 2 pairs ")
    assert told[2:] == [f"error: {tmp_path / 'p.csv'}: 3 of 5 pairs have no routes"]


def test_pairs_without_a_way_are_a_finding_and_none_at_all_an_error(command, hall, tmp_path):
    cost = exponential_cost(read_map(hall), inscribed_radius=1.3, inflation_radius=1.4)
    write_map(tmp_path / "c.npz", cost)
    (tmp_path / "p.csv").write_text("1,1,5,1\n1,1,1.5,1\n")
    code, out, err = command("route", tmp_path / "c.npz", "--pairs", tmp_path / "p.csv")
    assert code == 1
    assert [line["reached"] for line in _asked(out)] == [False] * 3 + [True] * 3
    assert err.startswith("means of 1 pair  ")
    assert "no route leads from start to goal in 1 of 2 pairs" in err
    (tmp_path / "p.csv").write_text("1,1,5,1\n")
    code, _, err = command("route", tmp_path / "c.npz", "--pairs", tmp_path / "p.csv")
    assert (code, "means" in err) == (1, False)
    (tmp_path / "p.csv").write_text("x,y,x,y\n")
    code, out, err = command("route", hall, "--pairs", tmp_path / "p.csv", "-o",
                             tmp_path / "r.jsonl")  # fmt: skip
    assert (code, out) == (3, "")
    assert not (tmp_path / "r.jsonl").exists()
    assert err == f"error: {tmp_path / 'p.csv'}: holds no pairs of points\n"
    write_map(tmp_path / "free.npz", Costmap(np.zeros((9, 9), np.uint8), 0.1))
    (tmp_path / "p.csv").write_text("0.1,0.1,0.7,0.7\n")
    code, out, err = command("route", tmp_path / "free.npz", "--pairs", tmp_path / "p.csv")
    assert (code, _asked(out)[0]["mean_clearance_m"]) == (0, None)
    warning, _, means = err.partition("\n")
    assert warning.endswith("free.npz: 100 % of the open cells cost 0: there is no obstacle")
    assert _means_told(means)["plain"][:2] == ["-", "-"]


def test_pairs_of_standard_input_are_answered_at_once(hall):
    words = [sys.executable, "-m", "mapdeal", "route", hall, "--pairs", "-", "--compare", "plain"]
    with subprocess.Popen(
        words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        for text in ("1,1,5,1\n", "1,3,5,3\n"):
            process.stdin.write(text)
            process.stdin.flush()
            assert json.loads(process.stdout.readline())["reached"]
        _, err = process.communicate(timeout=60)
    assert (process.returncode, err.splitlines()[0][:16]) == (0, "means of 2 pairs")


@pytest.mark.parametrize(
    ("words", "text"),
    [
        ("--from 1,1", "--from, --to: both are required, unless pairs are given"),
        ("--pairs p.csv --from 1,1", "--from: applies to one route"),
        ("--pairs p.csv --heuristic field", "--heuristic: applies to one route"),
        ("--pairs p.csv --repulsive-gain 2", "--repulsive-gain: applies to one route"),
        ("--pairs p.csv --method descent", "--pairs: compares routes of method astar"),
        ("--pairs p.csv --image o.png", "--image: applies to one route"),
        ("--pairs p.csv --compare plain,fast", "must be some of plain, cost, heuristic"),
        ("--pairs p.csv --compare=", "--compare: must be some of"),
        ("--pairs p.csv -o o.json", "--output: must end in .jsonl"),
        ("--pairs p.csv --heuristic-weight -1", "heuristic_weight: must lie between"),
        ("--pairs p.csv --field-weight nan", "--field-weight: must be a finite number"),
        ("--pairs p.csv --compare plain --field-weight 1", "--field-weight: needs cost among"),
        ("--pairs p.csv --compare cost --heuristic-weight 1", "needs heuristic among"),
        ("--compare plain --from 1,1 --to 5,1", "--compare: applies to pairs alone"),
        ("--from 1,1 --to 5,1 --heuristic-weight 1", "--heuristic-weight: applies to heuristic"),
        ("--from 1,1 --to 5,1 --heuristic octile --heuristic-weight 1", "to heuristic field alone"),
        ("--from 1,1 --to 5,1 --heuristic field --heuristic-weight inf", "must be a finite number"),
        (
            "--from 1,1 --to 5,1 --method descent --heuristic field",
            "does not apply to method descent",
        ),
        (
            "--from 1,1 --to 5,1 --method descent --heuristic-weight 1",
            "does not apply to method desce",
        ),
    ],
)
def test_what_does_not_go_together_is_refused(command, hall, tmp_path, monkeypatch, words, text):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "p.csv").write_text(PAIRS)
    before = sorted(path.name for path in tmp_path.iterdir())
    code, out, err = command("route", hall, *words.split())
    assert (code, out) == (2, "")
    assert text in err
    assert sorted(path.name for path in tmp_path.iterdir()) == before


def test_the_file_of_pairs_is_no_output(command, hall, tmp_path):
    (tmp_path / "p.jsonl").write_text(PAIRS)
    words = ["route", hall, "--pairs", tmp_path / "p.jsonl", "-o", tmp_path / "p.jsonl", "--force"]
    code, out, _ = command(*words)
    assert (code, out) == (4, "")
    assert (tmp_path / "p.jsonl").read_text() == PAIRS
