"""The command run with --pose: a map's own products and those around a robot, in one call."""

import json
import re

import numpy as np
import pytest

from mapdeal import OccupancyGrid, read_map, write_map
from mapdeal.kernels.engine import engine_name

LOCAL = ["--size", "3,2", "--resolution", "0.07", "--min-range", "0.2"]
IN_RUN = ["--local-set", "local.size=3,2", "--local-set", "local.resolution=0.07",
          "--local-set", "local.min_range=0.2"]  # fmt: skip


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A turned map and a cloud."""
    monkeypatch.chdir(tmp_path)
    values = np.random.default_rng(3).choice([-1, 0, 100], (30, 40), p=[0.3, 0.69, 0.01])
    write_map("m.yaml", OccupancyGrid(values, 0.1, (-2.03, -1.06, 0.3)))
    np.savetxt("c.csv", [[0.62, 0.04, 1], [-0.41, 0.33, 1], [0.1, 0, 1]], delimiter=",")
    return tmp_path


def contents(folder):
    return {
        str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()
    }


def around(command, *words, out="o", pose="0.5,0.3,1.2", cloud="c.csv"):
    with_cloud = ["--cloud", cloud] if cloud else []
    return command("run", "m.yaml", "-o", out, "--pose", pose, *with_cloud, *words)


def test_one_call_makes_what_two_commands_make(command, place):
    shape = ["--robot-radius", "0.25"]
    code, out, _ = around(command, *IN_RUN, *shape, "--recipe", "design-real", "--local-recipe",
                          "design-local", "--frame", "robot")  # fmt: skip
    assert code == 0
    assert "m.yaml -> o/m\n" in out
    assert "m.yaml -> o/m/local: 2 of 3 points in the window" in out
    command("run", "m.yaml", "-o", "a", "--recipe", "design-real", *shape)
    command("local", "--map", "m.yaml", "--cloud", "c.csv", "--pose", "0.5,0.3,1.2", *LOCAL,
            "--recipe", "design-local", *shape, "-o", "b")  # fmt: skip
    found = contents(place / "o" / "m")
    local = {name: data for name, data in found.items() if name.startswith("local/")}
    assert {name.removeprefix("local/"): data for name, data in local.items()} == contents(
        place / "b"
    )
    assert {name: found[name] for name in found.keys() - local.keys()} == contents(
        place / "a" / "m"
    )
    assert set(json.loads(found["local/manifest.json"])["inputs"]) == {"c.csv", "m.yaml", "m.pgm"}


def test_without_a_cloud_it_is_the_window_in_the_map_s_cells(command, place):
    assert around(command, "--local-set", "local.size=3,2", "--no-images", cloud=None)[0] == 0
    words = ["--pose", "0.5,0.3,1.2", "--size", "3,2", "--no-images", "-o", "b"]
    command("local", "--map", "m.yaml", *words)
    assert contents(place / "o" / "m" / "local") == contents(place / "b")
    assert read_map("b/local.yaml").resolution == 0.1


def test_what_the_local_map_is_warned_of_is_not_said_of_the_whole_map(command, place):
    for _ in range(2):  # done, and unchanged
        err = around(command, "--no-images", pose="90,90,0", cloud=None)[2]
        assert "warning: o/m/local: cost: every cell is unknown\n" in err
        assert "m.yaml: cost: every cell is unknown" not in err


def test_what_is_there_is_not_made_again(command, place):
    words = [*IN_RUN, "--no-images"]
    assert around(command, *words)[0] == 0
    before = {p: p.stat().st_mtime_ns for p in (place / "o").rglob("*")}
    code, out, err = around(command, *words)
    assert (code, err) == (0, "")
    assert out == "m.yaml -> o/m: unchanged\nm.yaml -> o/m/local: unchanged\n"
    assert {p: p.stat().st_mtime_ns for p in (place / "o").rglob("*")} == before
    # another pose: only the local map differs, and is not replaced unasked
    code, _, err = around(command, *words, pose="0.6,0.3,1.2")
    assert code == 4
    assert err.startswith(
        "error: o/m/local/local.pgm: the output exists\nhint: --force replaces it"
    )
    assert {p: p.stat().st_mtime_ns for p in (place / "o").rglob("*")} == before
    for path in (place / "o" / "m" / "local").iterdir():
        path.unlink()
    code, out, _ = around(command, *words, pose="0.6,0.3,1.2")
    assert code == 0
    assert out.startswith("m.yaml -> o/m: unchanged\nm.yaml -> o/m/local: 2 of 3 points")


def test_if_the_local_map_fails_nothing_of_the_run_is_left(command, place):
    (place / "bad.csv").write_text("0.5,0.5\na,b\n")
    code, _, err = around(command, cloud="bad.csv")
    assert code == 3
    assert "bad.csv: line 2" in err
    assert not (place / "o").exists()
    assert around(command, "--no-images")[0] == 0
    before = contents(place / "o")
    assert around(command, "--no-images", "--force", "--recipe", "nav2", cloud="bad.csv")[0] == 3
    assert contents(place / "o") == before
    # and the other way round: a map's own file that is in the way
    (place / "p" / "m").mkdir(parents=True)
    (place / "p" / "m" / "cost.npz").write_bytes(b"somebody's")
    assert around(command, out="p")[0] == 4
    assert contents(place / "p") == {"m/cost.npz": b"somebody's"}


def test_blocks_give_the_same_bytes(command, place):
    values = np.kron(read_map("m.yaml").occupancy, np.ones((40, 40), np.int8))
    write_map("m.yaml", OccupancyGrid(values, 0.02, (-2.03, -1.06, 0.3)), force=True)
    words = [*IN_RUN, "--no-images", "--threads", "1"]
    assert around(command, *words, out="whole")[0] == 0
    little = 56 if engine_name() == "compiled" else 106  # MiB, those included that are taken anyhow
    words += ["--max-memory", f"{little}M"]
    told = around(command, *words, "--dry-run", out="blocks")[1]
    in_decimal = little * 1.048576
    assert 0 <= float(re.search(r"([0-9.]+) MB in blocks", told)[1]) - in_decimal < 1
    code, _, err = around(command, *words, out="blocks")
    assert (code, err) == (0, "")
    assert contents(place / "whole") == contents(place / "blocks")


def test_dry_run_tells_of_both(command, place):
    code, out, err = around(command, "--no-images", "-n", "-v")
    assert code == 0
    assert "new   20     40 x 30" in out
    assert "m.yaml: read c.csv" in err
    assert "m.yaml: write o/m/local/local.pgm" in err
    assert not (place / "o").exists()
    around(command, "--no-images")
    assert around(command, "--no-images", "-n")[1].splitlines()[1].startswith("unchanged  -")
    code, _, err = around(command, "--no-images", "-n", pose="0,0,0")
    assert (code, err.splitlines()[0]) == (4, "error: o/m/local/local.pgm: the output exists")
    # a window of the map: the size of its cells comes from the file's header, or from the file
    for name in ("m.yaml", "m.npz"):
        write_map(name, read_map("m.yaml"), force=True)
        words = ["run", name, "-o", name[2:], "--pose", "0,0,0", "--no-images"]
        assert command(*words)[0] == 0
        assert command(*words, "-n")[1].splitlines()[1].startswith("unchanged")


def test_golden_runs_have_the_local_map_too(command, place):
    assert around(command, "--no-images", "--golden", "g", "--update-golden")[0] == 0
    assert (place / "g" / "m" / "local" / "manifest.json").exists()
    assert around(command, "--no-images", "--golden", "g")[0] == 0
    np.savetxt("c.csv", [[0.5, 0.4]], delimiter=",")
    code, out, _ = around(command, "--no-images", "--golden", "g", "--force")
    assert code == 1
    assert "m/local: local: local.pgm differ" in out
    assert "\nm: " not in out


def test_a_local_map_of_an_earlier_run_is_told_of(command, place):
    assert around(command, "--no-images")[0] == 0
    code, _, err = command("run", "m.yaml", "-o", "o", "--no-images", "--force")
    assert (code, err) == (
        0, "warning: o/m/local: holds the local map of an earlier run, which is left as it is\n"
    )  # fmt: skip


def test_a_folder_of_one_map_and_its_summary(command, place):
    (place / "maps").mkdir()
    write_map("maps/one.yaml", read_map("m.yaml"))
    words = ["run", "maps", "-o", "o", "--pose", "0.5,0.3,1.2", "--no-images"]
    assert command(*words)[0] == 0
    (entry,) = json.loads((place / "o" / "summary.json").read_text())["maps"]
    assert entry["status"] == "done"
    assert entry["local"]["local"]["pose"] == [0.5, 0.3, 1.2]
    assert (place / "o" / "one" / "local" / "manifest.json").exists()


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("--cloud c.csv", "--cloud: needs --pose"),
        ("--frame map", "--frame: needs --pose"),
        ("--local-recipe local", "--local-recipe: needs --pose"),
        ("--local-set inflate.radius=1", "--local-set: needs --pose"),
        ("--pose 0,0,0 --frame map", "--frame: needs --cloud"),
        ("--pose 0,0,0 --local-set local.min_range=1", "--local-set: needs --cloud"),
        ("--pose 0,0,0 --local-set local.sise=1,1", "no such option, got 'sise'"),
        ("--pose 0,0,0 --local-set local.size=1", "--local-set local.size: must be a list of 2"),
        ("--pose 0,0,0 --local-set local.size", "must look like stage.parameter=value"),
        (
            "--pose 0,0,0 --local-set local.resolution=x",
            "local.resolution: must be a finite number",
        ),
        ("--pose 0,0,0 --local-set local.unknown=all", "unknown: must be one of keep, free"),
        ("--pose 0,0,0 --local-set inflate.radios=1", "radios"),
        ("--pose 0,0,0 --local-set size=3,2", "error: --local-set: must look like stage.parameter"),
        ("--pose 0,0,0 --local-set activ.margin=1", "error: --local-set: no such stage"),
        ("--pose 0,0,0 --local-set active.margin=1", "error: --local-set: recipe local has no"),
        ("--pose 0,0,0 --set local.size=3,2", "hint: with --pose, --local-set takes what the"),
        ("--pose 0,0,0 --local-set inflate.radius", "--local-set: must look like stage.parameter"),
        ("--pose 0,0,0 --local-set infate.radius=1", "--local-set: no such stage, got 'infate'"),
        ("--pose 0,0,0 --local-set active.margin=1", "--local-set: recipe local has no stage"),
        ("--pose 0,0,0 --local-recipe=", "--local-recipe: must not be empty"),
        ("--local-recipe=", "--local-recipe: needs --pose"),
        ("--cloud=", "--cloud: needs --pose"),
        ("--pose 0,0", "--pose: must be a list of 3 numbers"),
        ("--pose 0,0,0 --local-recipe nowhere", "nowhere"),
        ("m2.yaml --pose 0,0,0", "--pose: takes one map, there are 2"),
        ("--pose 0,0,0 --scheduler tcp://h:1", "--pose: cannot be given together with --scheduler"),
    ],
)
def test_options_that_cannot_be_are_refused(command, place, words, told):
    write_map("m2.yaml", read_map("m.yaml"))
    code, out, err = command("run", "m.yaml", "-o", "o", *words.split())
    assert (code, out) == (2, "")
    assert told in err
    assert not (place / "o").exists()


def test_lint_of_the_run_looks_at_the_local_map_too(command, place):
    assert around(command, "--no-images")[0] == 0
    assert command("lint", "o/m")[0] == 0
    (place / "o" / "m" / "local" / "cost.npz").write_bytes(b"other")
    code, out, _ = command("lint", "o/m")
    assert code == 1
    assert "o/m/local" in out
    assert "run.other-file" in out


def test_a_cloud_in_the_folder_of_the_outputs_is_refused(command, place):
    (place / "o" / "m" / "local").mkdir(parents=True)
    (place / "c.csv").rename(place / "o" / "m" / "local" / "c.csv")
    code, _, err = around(command, cloud="o/m/local/c.csv")
    assert code == 4
    assert "lies in o/m/local, where the outputs go" in err
