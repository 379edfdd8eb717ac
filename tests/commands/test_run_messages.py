"""The command `run`: its messages about maps and stages."""

import json
from pathlib import Path

import pytest

from drawn import grid_from_text
from mapdeal import write_map

CROPPED = "?????\n?#..?\n?..??\n?????"
ROOM = "#......\n.......\n......."


def test_a_map_that_is_named_twice_is_run_once_and_said(sh, here):
    write_map("m.yaml", grid_from_text("#..\n..."))
    message = "1 map was named more than once, and is run once: m.yaml"
    assert sh.err("run m.yaml m.yaml -o o --no-images") == f"note: {message}\n"
    assert Path("o/m/manifest.json").exists()


def test_json_of_a_run_agrees_with_its_files(sh, here):
    for name in "ab":
        write_map(f"{name}.yaml", grid_from_text(ROOM))
    plan = sh.json("run a.yaml -o alone --dry-run --json")
    alone = sh.json("run a.yaml -o alone --json")
    wrote = sorted(str(path) for path in Path("alone").rglob("*") if path.is_file())
    assert sorted(plan["maps"][0]["writes"]) == wrote
    assert plan["maps"][0]["reads"] == ["a.yaml", "a.pgm"]
    document = sh.json("run a.yaml b.yaml -o o --no-images --json")
    assert document == json.loads(Path("o/summary.json").read_text())
    assert document["maps"][0] == alone["maps"][0]
    assert sh.json("run a.yaml -o alone --json")["maps"][0]["status"] == "unchanged"
    page = sh.json("run a.yaml -o o --no-images --report --json")["report"]
    assert page == json.loads(Path("o/report.json").read_text())
    sh("run a.yaml -o alone --golden kept --update-golden")
    line = "run a.yaml -o alone --force --golden kept --set cost.inflation_radius=0.2"
    code, out, err = sh(f"{line} --json")
    differing = json.loads(out)["differing"]
    assert (code, len(differing), differing[0][:7]) == (1, 1, "a: cost")
    assert sh(f"{line} -q") == (code, f"{differing[0]}\n", err)


def test_the_radius_of_a_footprint_is_named_everywhere(sh, here):
    """0.5 m, by hand: the corner lies 0.3 and 0.4 m from the centre."""
    write_map("m.yaml", grid_from_text(ROOM))
    shape = "--footprint [[0.3,0.4],[0.3,-0.4],[-0.3,-0.4],[-0.3,0.4]] -v"
    for line in ("run m.yaml -o o --dry-run", "run m.yaml -o o", "inflate m.yaml -o i.npz"):
        assert "inflate: radius=0.5, footprint=[[0.3, 0.4]," in sh(f"{line} {shape}")[2]
    stages = json.loads(Path("o/m/manifest.json").read_text())["stages"]
    assert stages[0]["inflate"]["radius"] == 0.5
    for name, count in (("inflated.yaml", 1), ("esdf.npz", 2), ("cost.yaml", 3)):
        assert sh.json(f"info o/m/{name} --json")["made_by"] == stages[:count]
        assert "  made by     inflate: radius 0.5, " in sh(f"info o/m/{name}")[1]
    for name in ("o/m", "o/m/manifest.json"):
        report = sh.json(f"info {name} --json")
        assert (report["kind"], report["stages"]) == ("run", stages)
        assert "  inflate     radius 0.5, footprint [[0.3, 0.4]," in sh(f"info {name}")[1]


def test_info_says_how_a_file_was_made_of_the_run_s_own_files_alone(sh, here):
    write_map("m.yaml", grid_from_text(ROOM))
    sh("run m.yaml -o o --no-images")
    write_map("o/m/esdf.npz", grid_from_text("#."), force=True)  # of somebody else
    write_map("o/m/own.npz", grid_from_text("#."))
    Path("o/m/inflated.pgm").write_bytes(Path("m.pgm").read_bytes())
    names = ["cost.npz", "esdf.npz", "own.npz", "inflated.yaml"]
    described = [name for name in names if "made_by" in sh.json(f"info o/m/{name} --json")]
    assert described == ["cost.npz"]
    assert sh.ok("info .").startswith("m.yaml\n")


@pytest.mark.usefixtures("mapdeal_warnings")
@pytest.mark.parametrize("words", ["--recipe default", "--sim --set active.canvas=full"])
def test_a_canvas_where_nothing_is_cropped_is_warned_of(sh, here, words):
    write_map("a.yaml", grid_from_text(CROPPED, 0.3))
    err = sh.err(f"run a.yaml -o o {words} --canvas full --no-images")
    assert err.startswith("warning: --canvas full: has no effect, no stage of the recipe crops")
    assert json.loads(Path("o/a/manifest.json").read_text())["options"]["canvas"] == "crop"


@pytest.fixture
def cropped(sh, here):
    """A map, and what a run makes of its known part, as cropped and on the whole canvas."""
    write_map("m.yaml", grid_from_text(CROPPED, 0.5, (1.0, 2.0, 0.0)))
    for canvas in ("crop", "full"):
        sh(f"run m.yaml -o {canvas} --sim --canvas {canvas} --no-images")


def test_a_field_on_the_whole_canvas_is_queried_and_converted(sh, cropped):
    field = "full/m/esdf.npz"
    out = sh.ok(f"query {field} --at 2.25,2.75 1.25,2.25")
    inner, outer = (json.loads(line) for line in out.splitlines())
    assert (inner["distance"], inner["state"]) == (0.5, "free")
    assert outer == {
        "x": 1.25, "y": 2.25, "inside": True, "row": 0, "col": 0, "state": "unknown",
        "distance": None, "gradient": None, "cell_distance": None,
    }  # fmt: skip
    missing = "70.00 % of the cells without a value"
    assert missing in sh(f"convert {field} -o again.npz")[1]
    assert Path("again.npz").read_bytes() == Path(field).read_bytes()
    assert missing in sh(f"info {field}")[1]
    code, out, _ = sh(f"diff {field} m.yaml --json")
    assert (code, json.loads(out)["geometry"]) == (0, {})
    for line in (f"lint {field}", f"cost {field} -o c.npz",
                 f"route {field} --from 2.25,2.75 --to 2.75,3.25"):  # fmt: skip
        assert sh(line)[0] in (0, 1)
    assert Path("c.npz").read_bytes() == Path("full/m/cost.npz").read_bytes()
