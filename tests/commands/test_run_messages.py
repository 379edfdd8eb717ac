"""The command run: its messages about maps and stages, and products around a robot."""

import json
from pathlib import Path

import numpy as np
import pytest

from bad_maps import tree
from drawn import grid_from_text
from mapdeal import OccupancyGrid, read_map, write_map

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


def test_a_field_on_the_whole_canvas_is_queried_and_converted(sh, here):
    write_map("m.yaml", grid_from_text(CROPPED, 0.5, (1.0, 2.0, 0.0)))
    sh("run m.yaml -o full --sim --canvas full --no-images")
    field = "full/m/esdf.npz"
    out = sh.ok(f"query {field} --at 2.25,2.75 1.25,2.25")
    inner, outer = (json.loads(line) for line in out.splitlines())
    assert (inner["distance"], inner["state"]) == (0.5, "free")
    nothing = dict.fromkeys(("distance", "gradient", "cell_distance"))
    place = {"x": 1.25, "y": 2.25, "inside": True, "row": 0, "col": 0, "state": "unknown"}
    assert outer == place | nothing
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


POSE = "--pose 0.5,0.3,1.2"


@pytest.fixture
def place(here):
    values = np.random.default_rng(3).choice([-1, 0, 100], (30, 40), p=[0.3, 0.69, 0.01])
    write_map("m.yaml", OccupancyGrid(values, 0.1, (-2.03, -1.06, 0.3)))
    np.savetxt("c.csv", [[0.62, 0.04, 1], [-0.41, 0.33, 1], [0.8, 0.6, 1]], delimiter=",")
    return here


def around(words="", *, out="o", pose=POSE, cloud="c.csv"):
    """The line that runs the map, and makes the one around a robot without pictures."""
    with_cloud = f"--cloud {cloud}" if cloud else ""
    return f"run m.yaml -o {out} {pose} {with_cloud} --no-images {words}"


def files(folder):
    return {name: data for name, data in tree(folder).items() if isinstance(data, bytes)}


def test_one_call_makes_what_two_commands_make(sh, place):
    shape = "--robot-radius 0.25"
    line = f"run m.yaml -o o {POSE} --cloud c.csv {shape}"
    code, out, _ = sh(f"{line} --recipe design-real --local-recipe design-local --frame robot")
    assert code == 0
    assert "m.yaml -> o/m\n" in out
    assert "m.yaml -> o/m/local: 3 of 3 points in the window" in out
    sh(f"run m.yaml -o a --recipe design-real {shape}")
    sh(f"local --map m.yaml --cloud c.csv {POSE} --recipe design-local {shape} -o b")
    local = files(place / "o/m/local")
    assert local == files(place / "b")
    own = {name: data for name, data in files(place / "o/m").items() if "local/" not in name}
    assert own == files(place / "a/m")
    assert set(json.loads(local["manifest.json"])["inputs"]) == {"c.csv", "m.yaml", "m.pgm"}


@pytest.mark.parametrize("end", ["yaml", "npz"])
def test_without_a_cloud_it_is_the_window_in_the_map_s_cells(sh, place, end):
    write_map(f"m.{end}", read_map("m.yaml"), force=True)
    line = f"run m.{end} -o o {POSE} --no-images"
    sh(line)
    sh(f"local --map m.{end} {POSE} --no-images -o b")
    assert tree(place / "o/m/local") == tree(place / "b")
    assert read_map("b/local.yaml").resolution == 0.1
    # whose cells a dry run knows by the header, or by the file
    assert sh(f"{line} -n")[1].splitlines()[1].startswith("unchanged")


def test_what_the_local_map_is_warned_of_is_not_said_of_the_whole_map(sh, place):
    for _ in range(2):  # done, and unchanged
        err = sh(around(pose="--pose 90,90,0", cloud=None))[2]
        assert "warning: o/m/local: cost: every cell is unknown\n" in err
        assert "m.yaml: cost: every cell is unknown" not in err


def test_existing_outputs_are_not_written_again(sh, place):
    def times():
        return {p: p.stat().st_mtime_ns for p in (place / "o").rglob("*")}

    assert sh(around())[0] == 0
    before = times()
    out = sh.ok(around())
    assert out == "m.yaml -> o/m: unchanged\nm.yaml -> o/m/local: unchanged\n"
    assert times() == before
    # another pose: only the local map differs, and is not replaced unasked
    elsewhere = around(pose="--pose 0.6,0.3,1.2")
    error, hint = sh.err(elsewhere, 4).splitlines()[:2]
    assert error == "error: o/m/local/local.pgm: the output exists"
    assert hint.startswith("hint: --force replaces it")
    assert times() == before
    for path in Path("o/m/local").iterdir():
        path.unlink()
    out = sh(elsewhere)[1]
    assert out.startswith("m.yaml -> o/m: unchanged\nm.yaml -> o/m/local: 3 of 3 points")


def test_if_the_run_or_the_local_map_fails_nothing_of_either_is_left(sh, place):
    Path("p/m").mkdir(parents=True)
    Path("p/m/cost.npz").write_bytes(b"somebody's")
    assert sh(around(out="p"))[0] == 4
    assert files(place / "p") == {"m/cost.npz": b"somebody's"}
    Path("bad.csv").write_text("0.5,0.5\na,b\n")
    assert "bad.csv: line 2" in sh.err(around(cloud="bad.csv"), 3)
    assert not Path("o").exists()
    assert sh(around())[0] == 0
    before = tree(place / "o")
    assert sh(around("--force --recipe nav2", cloud="bad.csv"))[0] == 3
    assert tree(place / "o") == before


def test_dry_run_tells_of_both(sh, place):
    code, out, err = sh(around("-n -v"))
    assert (code, "new   20     40 x 30" in out) == (0, True)
    assert "m.yaml: read c.csv" in err
    assert "m.yaml: write o/m/local/local.pgm" in err
    assert not Path("o").exists()
    sh(around())
    assert sh(around("-n"))[1].splitlines()[1].startswith("unchanged  -")
    err = sh.err(around("-n", pose="--pose 0,0,0"), 4)
    assert err.splitlines()[0] == "error: o/m/local/local.pgm: the output exists"


def test_golden_runs_have_the_local_map_too(sh, place):
    assert sh(around("--golden g --update-golden"))[0] == 0
    assert Path("g/m/local/manifest.json").exists()
    assert sh(around("--golden g"))[0] == 0
    np.savetxt("c.csv", [[0.5, 0.4]], delimiter=",")
    code, out, _ = sh(around("--golden g --force"))
    assert code == 1
    assert "m/local: local: local.pgm differ" in out
    assert "\nm: " not in out


def test_a_folder_of_one_map_and_its_summary(sh, place):
    write_map("maps/one.yaml", read_map("m.yaml"))
    assert sh(f"run maps -o o {POSE} --no-images")[0] == 0
    (entry,) = json.loads(Path("o/summary.json").read_text())["maps"]
    assert entry["status"] == "done"
    assert entry["local"]["local"]["pose"] == [0.5, 0.3, 1.2]
    assert Path("o/one/local/manifest.json").exists()


def test_later_runs_and_lint_look_at_the_local_map_too(sh, place):
    sh(around())
    message = "o/m/local: holds the local map of an earlier run, which is left as it is"
    assert sh.err("run m.yaml -o o --no-images --force") == f"warning: {message}\n"
    assert sh("lint o/m")[0] == 0
    Path("o/m/local/cost.npz").write_bytes(b"other")
    code, out, _ = sh("lint o/m")
    assert (code, "o/m/local" in out, "run.other-file" in out) == (1, True, True)
