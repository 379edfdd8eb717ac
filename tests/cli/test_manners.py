"""How commands answer: on terminals, in pipes, to words that other programs use."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest

import mapdeal
from conftest import documents_in
from mapdeal import OccupancyGrid

EXAMPLES = Path(__file__).parents[2] / "examples"
OFFICE = EXAMPLES / "maps" / "office.yaml"
ROOM = np.zeros((8, 12), dtype=np.int8)
ROOM[[0, -1], :] = ROOM[:, [0, -1]] = 100


@pytest.fixture
def room(here):
    mapdeal.write_map("room.yaml", OccupancyGrid(ROOM, 0.5, (1.0, 2.0, 0.0)))


ANSWERS = {
    "reach room.yaml --from 2,4 --to dock=5,4 wall=1.2,4 --robot-radius 0.4": [
        "room.yaml, reach of a robot of radius 0.4 m: from 2, 4 the robot reaches",
        "  goal dock 5,4: reached; the room at the start is 2 m wide",
        "  goal wall 1.2,4: not reached",
    ],
    "query room.yaml --at 2.25,4.25 9,9": [
        "2.25,4.25: 1 m, free, gradient 1.000,0.000, cell row 4, col 2",
        "9,9: outside of the map",
    ],
    "query room.yaml --at 2,4,0 --robot-radius 0.3": ["2,4,0: cost 0, free"],
    "route room.yaml --from 3.25,4 --to 4.75,4": ["1.62 m, cost "],
}


@pytest.mark.parametrize("line", ANSWERS)
def test_answers_are_lines_on_a_terminal_and_json_elsewhere(sh, room, monkeypatch, line):
    monkeypatch.setattr("mapdeal.cli.terminal.has_reader", lambda: True)
    lines = sh(line)[1].splitlines()
    for printed, begins in zip(lines, ANSWERS[line], strict=False):
        assert printed.startswith(begins)
    assert len(lines) >= len(ANSWERS[line])
    document = sh(f"{line} --json")[1]
    monkeypatch.setattr("mapdeal.cli.terminal.has_reader", lambda: False)
    piped = sh(line)[1]
    assert document == piped
    assert documents_in(piped)


@pytest.mark.parametrize(("line", "begins"), [
    ("reach room.yaml --robot-radius 0.3", "{"),
    ("route room.yaml --from 3,4 --to 4,4", "{"),
    ("lint room.yaml --fix", "PK"),
    ("report room.yaml", "<!doctype html>"),
    (f"align {OFFICE} {OFFICE}", "{"),
    (f"build {EXAMPLES}/logs/office.log", "PK"),
])  # fmt: skip
def test_every_command_that_writes_one_file_writes_to_stdout_too(capfdbinary, room, line, begins):
    from mapdeal.cli.main import main

    main([*line.split(), "-o", "-"])
    assert capfdbinary.readouterr().out.startswith(begins.encode())


def test_words_that_lead_to_a_command(sh, here):
    assert sh("help run")[1] == sh("run --help")[1]
    assert sh("help")[1] == sh("--help")[1]
    out = sh("")[1]
    assert len(re.findall(r"\n  \w", out)) == 8
    assert "mapdeal --help lists all commands" in out
    for words in ("show view", "crop window", "compare diff", "costmap cost"):
        word, command = words.split()
        assert sh.err(word, 2).endswith(f"hint: did you mean {command}?\n")


def test_view_writes_a_page_and_opens_it(sh, room, monkeypatch, tmp_path):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    opened = []
    monkeypatch.setattr("webbrowser.open", lambda uri: opened.append(uri) or True)
    page = Path(sh.ok("view room.yaml").strip())
    assert opened == [page.as_uri()]
    assert page.read_bytes().startswith(b"<!doctype html>")
    assert sh.ok(f"view {page} --no-browser").strip() == str(page)
    assert len(opened) == 1
    before = sorted(tmp_path.iterdir())
    assert "cannot be read" in sh.err("view none.yaml", 4)
    assert sorted(tmp_path.iterdir()) == before
    monkeypatch.setattr("webbrowser.open", lambda _: False)
    assert "no browser was found" in sh(f"view {page}")[2]


@pytest.mark.parametrize("no_color", ["", "1"])
def test_colours_are_for_terminals_alone(sh, here, monkeypatch, no_color):
    monkeypatch.setenv("NO_COLOR", no_color)
    monkeypatch.setenv("TERM", "xterm")
    assert "\x1b" not in sh("rnu")[2]
    monkeypatch.setattr("mapdeal.cli.terminal.sys", sys)
    monkeypatch.setattr(type(sys.stderr), "isatty", lambda _: True)
    has_colours = no_color == ""
    assert ("\x1b[31;1merror:\x1b[0m" in sh("rnu")[2]) == has_colours
    monkeypatch.setattr(type(sys.stdout), "isatty", lambda _: True)
    Path("p.yaml").write_text("image: none.pgm\n")
    assert ("p.yaml: \x1b[31;1merror:\x1b[0m " in sh("lint p.yaml")[1]) == has_colours
    assert ("\x1b[1mOptions\x1b[0m:" in sh("lint --help")[1]) == has_colours


def test_info_describes_readable_files_and_reports_others(sh, room):
    (Path("maps/inner")).mkdir(parents=True)
    mapdeal.write_map("maps/inner/a.yaml", OccupancyGrid(ROOM, 0.5))
    Path("bad.txt").write_text("nothing")
    code, out, err = sh("info maps bad.txt room.yaml")
    assert code == 5
    titles = [line for line in out.splitlines() if line and line[0] != " "]
    assert titles == ["maps/inner/a.yaml", "room.yaml"]
    assert "error: bad.txt: is not a kind of file" in err
    assert err.endswith("error: 1 file cannot be described\n")
    documents = documents_in(sh("info maps bad.txt room.yaml --json")[1])
    kinds = [document["kind"] for document in documents]
    assert kinds == ["occupancy grid", "error", "occupancy grid"]
    assert "is not a kind" in documents[1]["error"]


BARE = (
    "info {}", "cost {} -o c.npz", "run {} -o out", "reach {}", "clean {} -o k.yaml",
    "diff {} room.yaml", "report {} -o r.html", "lint {} --fix -o k.yaml",
)  # fmt: skip


@pytest.mark.parametrize("line", BARE)
def test_an_image_without_its_yaml_is_read_with_a_resolution(sh, room, line):
    Path("bare.pgm").write_bytes(Path("room.pgm").read_bytes())
    named = line.format("bare.pgm")
    assert "--resolution R" in sh.err(named, 3)
    code, _, err = sh(f"{named} --resolution 0.5 --origin 1,2,0")
    assert (code, "error" in err) == (0, False)


def test_the_geometry_of_a_bare_image_is_that_of_the_options(sh, room):
    Path("bare.pgm").write_bytes(Path("room.pgm").read_bytes())
    sh.ok("convert bare.pgm -o c.npz --resolution 0.25 --origin 3,4,0.5")
    grid = mapdeal.read_map("c.npz")
    assert (grid.resolution, grid.origin) == (0.25, (3.0, 4.0, 0.5))
    assert np.array_equal(grid.occupancy, ROOM)
    sh("run bare.pgm -o out --resolution 0.25")
    assert "unchanged" in sh("run bare.pgm -o out --resolution 0.25")[1]
    assert "the output exists" in sh.err("run bare.pgm -o out --resolution 0.5", 4)
    sh.ok("lint bare.pgm --fix -o fixed.yaml --resolution 0.25 --origin 3,4,0")
    assert np.array_equal(mapdeal.read_map("fixed.yaml").occupancy, ROOM)
    assert mapdeal.read_map("fixed.yaml").origin == (3.0, 4.0, 0.0)
    assert "yaml.resolution-noise" in sh("lint bare.pgm --resolution 0.05000000074505806")[1]
    assert "image.yaml-not-read" in sh.ok("lint room.pgm --resolution 0.25")


def test_a_run_without_a_robot_names_the_radius_it_uses(sh, room):
    assert "no robot is given: walls are inflated by 0.3 m" in sh("run room.yaml -o out")[1]
    run = "run room.yaml -o out --no-images --force"
    corners = "[[0.2,0.1],[0.2,-0.1],[-0.2,-0.1],[-0.2,0.1]]"
    for option, value, shown in (("robot-radius", "0.2", "0.2"), ("footprint", corners, "F")):
        output = sh(f"{run} --{option} {value}")[1]
        assert "recipe default: walls are inflated by 0.2" in output
        assert f"--recipe nav2 --{option} {shown}, makes the costmap of Nav2" in output
        assert "recipe default" not in sh(f"{run} --recipe nav2 --{option} {value}")[1]
    for own in ("--recipe nav2", "--robot-radius 0.2", "--set inflate.radius=0.2"):
        assert "no robot" not in sh(f"{run} {own}")[1]
    assert "the costs are those of a point" in sh("cost room.yaml -o c.npz")[2]
    for own in ("--recipe nav2", "--robot-radius 0.2", "--inscribed-radius 0", "--model rings"):
        assert "no robot" not in sh(f"cost room.yaml -o c.npz --force {own}")[2]


def test_cost_takes_the_costs_of_a_recipe(sh, room):
    sh("run room.yaml -o out --recipe nav2")
    sh("cost room.yaml -o c.npz --recipe nav2")
    costs = [mapdeal.read_map(path).cost for path in ("out/room/cost.npz", "c.npz")]
    assert np.array_equal(*costs)
    more = "--robot-radius 0.4 --cost-scaling-factor 9"
    values = sh.json(f"cost room.yaml -o c.npz --force --recipe nav2 {more} --json")["parameters"]
    names = "inscribed_radius", "inflation_radius", "cost_scaling_factor"
    assert [values[name] for name in names] == [0.4, 0.7, 9.0]


def test_maps_that_do_not_lie_in_one_frame_are_noticed_and_aligned(sh, here):
    moved = EXAMPLES / "maps" / "office_cartographer.yaml"
    for line, advice in (
        (f"diff {OFFICE} {moved}", "--align"),
        (f"score {moved} --truth {OFFICE}", "--align"),
        (f"merge {moved} {OFFICE} -o m.yaml", "--by align"),
    ):
        err = sh(line)[2]
        assert "do not lie in one frame" in err
        assert "100 % once it is moved by x" in err
        assert advice in err
    found = sh.json(f"diff {OFFICE} {moved} --align --json")
    assert found["transform"]["x"] == pytest.approx(-0.584, abs=0.01)
    assert found["walls"]["first_to_second"]["percentile_95"] < 0.01
    sh(f"align {OFFICE} {moved} -o t.json")
    assert sh.json(f"diff {OFFICE} {moved} --by t.json --json")["changes"] == found["changes"]
    back = sh.json(f"diff {moved} {OFFICE} --by t.json --json")["transform"]
    assert back["x"] == pytest.approx(-found["transform"]["x"], abs=1e-4)
    assert "one frame" not in sh(f"diff {OFFICE} {OFFICE}")[2]
    assert "cannot be given together" in sh.err(f"diff {OFFICE} {moved} --by t.json --align", 2)
