"""The command run with --pose: a map's own products and those around a robot, in one call."""

import json
from pathlib import Path

import numpy as np
import pytest

from bad_maps import tree
from mapdeal import OccupancyGrid, read_map, write_map

SMALL = "--local-set local.size=3,2"
IN_RUN = f"{SMALL} --local-set local.resolution=0.07 --local-set local.min_range=0.2"
POSE = "--pose 0.5,0.3,1.2"


@pytest.fixture
def place(here):
    values = np.random.default_rng(3).choice([-1, 0, 100], (30, 40), p=[0.3, 0.69, 0.01])
    write_map("m.yaml", OccupancyGrid(values, 0.1, (-2.03, -1.06, 0.3)))
    np.savetxt("c.csv", [[0.62, 0.04, 1], [-0.41, 0.33, 1], [0.1, 0, 1]], delimiter=",")
    return here


def around(words="", *, out="o", pose=POSE, cloud="c.csv"):
    """The line that runs the map, and makes the one around a robot without pictures."""
    with_cloud = f"--cloud {cloud}" if cloud else ""
    return f"run m.yaml -o {out} {pose} {with_cloud} --no-images {words}"


def files(folder):
    return {name: data for name, data in tree(folder).items() if isinstance(data, bytes)}


def test_one_call_makes_what_two_commands_make(sh, place):
    shape = "--robot-radius 0.25"
    line = f"run m.yaml -o o {POSE} --cloud c.csv {IN_RUN} {shape}"
    code, out, _ = sh(f"{line} --recipe design-real --local-recipe design-local --frame robot")
    assert code == 0
    assert "m.yaml -> o/m\n" in out
    assert "m.yaml -> o/m/local: 2 of 3 points in the window" in out
    sh(f"run m.yaml -o a --recipe design-real {shape}")
    sh(f"local --map m.yaml --cloud c.csv {POSE} --size 3,2 --resolution 0.07 --min-range 0.2"
       f" --recipe design-local {shape} -o b")  # fmt: skip
    local = files(place / "o/m/local")
    assert local == files(place / "b")
    own = {name: data for name, data in files(place / "o/m").items() if "local/" not in name}
    assert own == files(place / "a/m")
    assert set(json.loads(local["manifest.json"])["inputs"]) == {"c.csv", "m.yaml", "m.pgm"}


@pytest.mark.parametrize("end", ["yaml", "npz"])
def test_without_a_cloud_it_is_the_window_in_the_map_s_cells(sh, place, end):
    write_map(f"m.{end}", read_map("m.yaml"), force=True)
    line = f"run m.{end} -o o {POSE} {SMALL} --no-images"
    sh(line)
    sh(f"local --map m.{end} {POSE} --size 3,2 --no-images -o b")
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

    assert sh(around(IN_RUN))[0] == 0
    before = times()
    out = sh.ok(around(IN_RUN))
    assert out == "m.yaml -> o/m: unchanged\nm.yaml -> o/m/local: unchanged\n"
    assert times() == before
    # another pose: only the local map differs, and is not replaced unasked
    elsewhere = around(IN_RUN, pose="--pose 0.6,0.3,1.2")
    error, hint = sh.err(elsewhere, 4).splitlines()[:2]
    assert error == "error: o/m/local/local.pgm: the output exists"
    assert hint.startswith("hint: --force replaces it")
    assert times() == before
    for path in Path("o/m/local").iterdir():
        path.unlink()
    out = sh(elsewhere)[1]
    assert out.startswith("m.yaml -> o/m: unchanged\nm.yaml -> o/m/local: 2 of 3 points")


def test_if_the_local_map_fails_nothing_of_the_run_is_left(sh, place):
    Path("bad.csv").write_text("0.5,0.5\na,b\n")
    assert "bad.csv: line 2" in sh.err(around(cloud="bad.csv"), 3)
    assert not Path("o").exists()
    assert sh(around())[0] == 0
    before = tree(place / "o")
    assert sh(around("--force --recipe nav2", cloud="bad.csv"))[0] == 3
    assert tree(place / "o") == before


def test_if_the_run_fails_nothing_of_the_local_map_is_left(sh, place):
    Path("o/m").mkdir(parents=True)
    Path("o/m/cost.npz").write_bytes(b"somebody's")
    assert sh(around())[0] == 4
    assert files(place / "o") == {"m/cost.npz": b"somebody's"}


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
