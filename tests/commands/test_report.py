import html
import json
import re
from pathlib import Path

import numpy as np
import pytest

import mapdeal
from drawn import grid_from_text

ROOMS = """
    ??############
    ??#....#.....#
    ..#....#.....#
    ..#..........#
    ..############
"""
RUN = "run rooms.yaml -o out --report"


@pytest.fixture(autouse=True)
def rooms(here):
    mapdeal.write_map("rooms.yaml", grid_from_text(ROOMS))


@pytest.fixture
def run(sh):
    assert sh("run rooms.yaml -o out --no-images --set inflate.radius=0.25")[0] == 0
    sh("reach rooms.yaml --robot-radius 0.1 -o reach.json")


def test_python_writes_the_bytes_of_the_command(sh, run):
    out = sh.ok("report out/rooms reach.json -o new/one.html --threads 3")
    assert out.startswith("new/one.html: 1 map, ")  # to which the document belongs
    report = mapdeal.write_report("two.html", ["out/rooms", "reach.json"])
    page = Path("new/one.html").read_bytes()
    assert page.startswith(b"<!doctype html>")
    assert page == report.path.read_bytes()
    assert (report.maps, report.size) == (1, report.path.stat().st_size)


def test_a_run_writes_its_page_with_the_map_as_read(sh):
    assert "and out/report.html and out/report.json" in sh(f"{RUN} --dry-run")[1]
    assert not Path("out").exists()
    assert "out/report.html: 1 map, " in sh(RUN)[1]
    names = ("report.html", "report.json")
    first = [Path("out", name).read_bytes() for name in names]
    assert b"Map as read" in first[0]
    assert sh(RUN)[0] == 0  # unchanged, and written again
    assert [Path("out", name).read_bytes() for name in names] == first


def test_a_run_with_a_page_is_checked_by_lint_and_reach(sh):
    points = mapdeal.read_map("rooms.yaml").frame.xy_from_rowcol([(2, 4), (2, 10)])
    start, lab = (f"{x:g},{y:g}" for x, y in points.tolist())
    ends = f"--from {start} --to lab={lab} here={start} --no-images"
    states = {}
    for radius in (0.1, 0.3):
        code = sh(f"run rooms.yaml -o r{radius} --robot-radius {radius} --report {ends}")[0]
        assert code == (radius == 0.3)
        (entry,) = json.loads(Path(f"r{radius}/report.json").read_text())["entries"]
        claims = entry["claims"]
        states[radius] = {claim["about"]: (claim["state"], claim["text"]) for claim in claims}
        page = Path(f"r{radius}/report.html").read_text()
        assert "goal lab" in page
        assert "robot of radius" in page or "round robot" in page
    assert list(states[0.1]) == ["map", "costmap", "goals"]
    assert states[0.1]["goals"][0] == "good"
    state, text = states[0.3]["goals"]
    assert (state, "Not reached: lab (a passage at" in text) == ("error", True)
    found = mapdeal.lint("rooms.yaml", footprint=mapdeal.Footprint.circle(0.3))
    state = "error" if found.errors else "warning" if found.warnings else "good"
    assert states[0.3]["map"][0] == state
    # goals stay unchecked if there is no robot; this is no error
    sh("run rooms.yaml -o none --report --no-images")
    (entry,) = json.loads(Path("none/report.json").read_text())["entries"]
    assert entry["claims"][-1]["state"] == "unknown"


def test_a_start_in_a_wall_is_a_problem_of_the_page_and_the_run_is_written(sh):
    err = sh.err("run rooms.yaml -o out --robot-radius 0.3 --report --from 999,0", 1)
    error = err.splitlines()[-1]
    assert error.startswith("error: out/report.html: rooms: Where the robot can go was not found")
    assert Path("out/rooms/manifest.json").exists()
    assert json.loads(Path("out/report.json").read_text())["state"] == "error"


def test_an_invalid_configuration_of_lint_leaves_the_rest_of_the_page(sh, rooms):
    Path("mapdeal.toml").write_text("[lint]\nselect = 5\n")
    code, _, err = sh(RUN)
    assert code == 0
    assert "mapdeal.toml: lint.select: must be a list of names" in err
    assert "so findings of lint are not shown" in err
    (entry,) = json.loads(Path("out/report.json").read_text())["entries"]
    assert {claim["about"]: claim["state"] for claim in entry["claims"]}["map"] == "unknown"


def test_the_verdict_as_json(sh, run):
    Path("lint.json").write_text(sh.ok("lint rooms.yaml --format json"))
    document = json.loads(sh.ok("report out/rooms rooms.yaml lint.json -o page.html --json"))
    keys = ("format", "maps", "path")
    assert [document[key] for key in keys] == ["mapdeal-report/1", 1, "page.html"]
    assert document["bytes"] == Path("page.html").stat().st_size
    (entry,) = document["entries"]
    assert [claim["about"] for claim in entry["claims"]] == ["map", "costmap"]
    assert set(entry["claims"][0]) == {"about", "state", "text"}
    assert document["state"] == "warning"  # the costs are nobody's


def test_results_about_another_map_robot_or_costmap_are_warned_of(sh):
    mapdeal.write_map("other.yaml", grid_from_text(ROOMS.replace("....#", "...##")))
    layer = "static_layer: {plugin: 'nav2_costmap_2d::StaticLayer'}"
    of_node = f"{{ros__parameters: {{robot_radius: 0.1, plugins: [static_layer], {layer}}}}}"
    Path("nav2.yaml").write_text(f"global_costmap: {{global_costmap: {of_node}}}\n")
    Path("nav3.yaml").write_text(Path("nav2.yaml").read_text() + "# changed\n")
    sh("run rooms.yaml -o out --no-images --robot-radius 0.26")
    sh("run rooms.yaml -o own --no-images --params-file nav2.yaml")
    for name, words in (
        ("same", "rooms.yaml --robot-radius 0.26"), ("robot", "rooms.yaml --robot-radius 0.1"),
        ("map", "other.yaml --robot-radius 0.26"), ("own", "rooms.yaml --params-file nav2.yaml"),
        ("costmap", "rooms.yaml --params-file nav3.yaml"),
    ):  # fmt: skip
        assert sh(f"reach {words} -o {name}.json")[0] == 0
    for paths, warning in (
        ("out/rooms same.json", None), ("own/rooms own.json", None), ("rooms.yaml own.json", None),
        ("out/rooms robot.json", "robot.json: another robot than in out/rooms: a robot of radius"),
        ("rooms.yaml same.json robot.json", "robot.json: another robot than in same.json"),
        ("out/rooms map.json", "map.json: another map than here: other.yaml"),
        ("own/rooms costmap.json", "costmap.json: another costmap than in own/rooms"),
    ):  # fmt: skip
        code, _, err = sh(f"report {paths} -o page.html --force")
        assert (code, "another" in err) == (0, warning is not None), err
        page = Path("page.html").read_text()
        assert warning is None or (warning in err and warning.partition(": ")[2][:12] in page)


def test_a_batch_has_its_page_even_if_maps_fail(sh):
    mapdeal.write_map("maps/a/one.yaml", grid_from_text(ROOMS))
    Path("maps/bad.yaml").write_text("image: none.pgm\nresolution: x\n")
    code, output, _ = sh("run maps -o out --report --no-images -j 1")
    assert (code, "out/report.html: 2 maps, " in output) == (5, True)
    page = Path("out/report.html").read_text()
    assert "a/<wbr>one" in page
    assert "failed" in page
    verdict = json.loads(Path("out/report.json").read_text())
    assert {entry["name"]: entry["state"] for entry in verdict["entries"]}["bad"] == "error"
    assert sh("run maps -o out --report --no-images")[0] == 5
    assert Path("out/report.html").read_text() == page  # though one is unchanged now


def test_a_run_does_not_replace_what_is_no_page_of_ours(sh):
    for name, kind in (("report.html", "page"), ("report.json", "verdict")):
        mine = Path(f"out{kind}", name)
        mine.parent.mkdir()
        mine.write_text("<!doctype html><title>my own</title>")
        err = sh.err(f"run rooms.yaml -o out{kind} --report", 4)
        assert f"exists, and is not a {kind} written by mapdeal" in err
        assert [*mine.parent.iterdir()] == [mine]  # nothing was made


FROM, LAB = "0.55,1.05", "2.45,1.05"  # on both sides of a door of 0.3 m
BOX = "[[0.1, 0.1], [-0.1, 0.1], [-0.1, -0.1], [0.1, -0.1]]"


# The reported run, and the command that the verdict proposes, with its exit code.
@pytest.mark.parametrize(("line", "proposed", "code"), [
    ("run hall.yaml -o out",
     "run hall.yaml -o nav2 --recipe nav2 --robot-radius 0.22 --report", 0),
    ("run hall.yaml -o out --robot-radius 0.05", "reach hall.yaml --robot-radius 0.05", 0),
    ("run hall.yaml -o out --params-file robot.yaml --dialect ros1 --max-cells 999",
     "reach hall.yaml --max-cells 999 --dialect ros1 --params-file robot.yaml", 0),
    (f"run hall.yaml -o out --from {FROM} --to lab={LAB}",
     f"reach hall.yaml --from {FROM} --to lab={LAB} --robot-radius 0.22", 1),
    (f"run hall.yaml -o out --from {FROM} --to lab={LAB} --robot-radius 0.05",
     f"route hall.yaml --from {FROM} --to {LAB} --robot-radius 0.05", 0),
    (f"run hall.yaml -o out --from {FROM} --to lab={LAB} --params-file robot.yaml",
     f"route hall.yaml --from {FROM} --to {LAB} --params-file robot.yaml", 0),
    (f"run hall.yaml -o out --from {FROM} --to 'the lab={LAB}' {FROM} --robot-radius 0.3",
     f"reach hall.yaml --from {FROM} --to 'the lab={LAB}' {FROM} --robot-radius 0.3", 1),
    (f"run hall.yaml -o out --from {FROM},0.5 --to {LAB} --footprint '{BOX}'",
     f"route hall.yaml --from {FROM} --to {LAB} --footprint '{BOX}'", 0),
    ("run hall.yaml -o out --robot-radius 0.05 --from 999,0",
     "reach hall.yaml --robot-radius 0.05", 0),
    ("run 'odd name/it is.yaml' -o out --robot-radius 0.05",
     "reach 'odd name/it is.yaml' --robot-radius 0.05", 0),
    ("run bare.pgm --resolution 0.25 --origin 1,2,0.5 -o out --robot-radius 0.05",
     "lint bare.pgm --resolution 0.25 --origin 1,2,0.5", 0),
    ("run hall.yaml -o out --mask hall.yaml",
     "run hall.yaml -o nav2 --recipe nav2 --robot-radius 0.22 --mask hall.yaml --report", 0),
    ("run hall.yaml -o out --params-file robots.yaml --namespace b --costmap local",
     "reach hall.yaml --params-file robots.yaml --costmap local --namespace /b", 0),
    ("run hall.yaml broken.yaml -o out -j 1", "lint broken.yaml", 1),
    ("run hall.yaml 'none*.yaml' -o out -j 1", "info out", 0),
    ("report hall.yaml", "lint hall.yaml", 0),
    ("report hall.yaml lint.json", "reach hall.yaml --robot-radius 0.22", 0),
    ("report hall.yaml reach.json",
     f"route hall.yaml --from {FROM} --to {LAB} --robot-radius 0.05", 0),
    ("report made/hall", "info made/hall", 0),
    ("report made/hall/cost.npz", "info made/hall/cost.npz", 0),
])  # fmt: skip
def test_the_command_that_a_verdict_proposes_can_be_typed(sh, line, proposed, code):
    cells = np.zeros((21, 30), dtype=np.int8)
    cells[[0, -1], :] = cells[:, [0, -1]] = 100
    cells[:9, 15] = cells[12:, 15] = 100
    grid = mapdeal.OccupancyGrid(cells, 0.1)
    mapdeal.write_map("hall.yaml", grid)
    mapdeal.write_map("odd name/it is.yaml", grid)
    Path("bare.pgm").write_bytes(Path("hall.pgm").read_bytes())
    Path("broken.yaml").write_text("image: none.pgm\nresolution: 0.1\n")
    robot = "global_costmap: {global_costmap: {ros__parameters: {robot_radius: 0.1}}}"
    Path("robot.yaml").write_text(robot)
    own = robot.replace("global", "local")
    Path("robots.yaml").write_text(f"a: {{{own}}}\nb: {{{own}}}\n")
    if "made" in line:
        sh("run hall.yaml -o made --no-images")
    if "reach.json" in line:
        sh(f"reach hall.yaml --from {FROM} --to {LAB} --robot-radius 0.05 -o reach.json")
    if "lint.json" in line:
        Path("lint.json").write_text(sh("lint hall.yaml --json")[1])
    is_run = line.startswith("run")
    page = "out/report.html" if is_run else "page.html"
    _, out, err = sh(f"{line} --report --no-images" if is_run else f"{line} -o {page}")
    assert f"Next: mapdeal {proposed}" in out.splitlines(), out + err
    shown = html.unescape(re.sub("<[^>]*>", "", Path(page).read_text()))
    assert f"Next: mapdeal {proposed}" in shown
    if is_run:
        entries = json.loads(Path("out/report.json").read_text())["entries"]
        assert f"mapdeal {proposed}" in [entry["next"] for entry in entries]
    assert sh(proposed)[0] == code
