"""What a map warns of reaches whoever asked, once; `run --strict` makes findings of it."""

import json
import warnings

import numpy as np
import pytest
import typer

import mapdeal
from mapdeal.cli.main import app, command_names, main

GREYS = np.full((40, 60), 254, dtype=np.uint8)
GREYS[5, :] = 0
GREYS[10:20, 30:60] = 205
HEAD = "resolution: 0.1\norigin: [1.5, -2.0, 0.4]\nnegate: 0\noccupied_thresh: 0.65\n"

FREED = (
    "m.yaml: 300 cells (12.5 %) of grey 205, which map_saver writes for unknown, are read as free;"
    " lower free_thresh from 0.25 to 0.196"
)

# Command lines of commands that read a map; others of them take it alone, or write an npz.
LINES = {
    "run": ["run", "m.yaml", "-o", "o", "--no-images"],
    "local": ["local", "--map", "m.yaml", "--pose", "3,0,0.2", "-o", "o"],
    "inflate": ["inflate", "m.yaml", "-o", "o.yaml"],
    "query": ["query", "m.yaml", "--at", "3,0"],
    "reach": ["reach", "m.yaml", "--from", "3,0", "--to", "3.3,0", "-o", "o.json"],
    "route": ["route", "m.yaml", "--from", "3,0", "--to", "3.3,0"],
    "edit": ["edit", "circle", "m.yaml", "-o", "o.yaml", "--point", "3,0", "--radius", "0.2",
             "--value", "100"],
    "window": ["window", "m.yaml", "--corner", "3,0", "--size", "1,1", "-o", "o.yaml"],
    "shift": ["shift", "m.yaml", "--origin", "2,-1.5", "-o", "o.yaml"],
    "rotate": ["rotate", "m.yaml", "--yaw", "0.3", "-o", "o.yaml"],
    "rescale": ["rescale", "m.yaml", "--resolution", "0.2", "-o", "o.yaml"],
    "convert": ["convert", "m.yaml", "-o", "o.png"],
    "pack": ["pack", "m.yaml", "-o", "o.pbm"],
    "diff": ["diff", "m.yaml", "m.yaml"],
    "merge": ["merge", "m.yaml", "m.yaml", "-o", "o.yaml"],
    "clean": ["clean", "m.yaml", "-o", "o.yaml"],
    "align": ["align", "m.yaml", "m.yaml"],
    "score": ["score", "m.yaml", "--truth", "m.yaml"],
    "report": ["report", "m.yaml", "-o", "o.html"],
}  # fmt: skip

TWO = {"align", "diff", "merge", "score"}
"""Those that read two maps there."""

NOT_SURE = {"align"}
"""Those that end with 1 on maps of so few cells."""

# lint has findings, and these read no maps.
OTHERS = {"lint", "build", "unpack", "completion"}


def line_of(name):
    one = typer.main.get_command(app).get_command(None, name)
    writes = any("--output" in each.opts and each.required for each in one.params)
    return [name, "m.yaml", *(["-o", "o.npz"] if writes else [])]


LINES = {name: LINES.get(name) or line_of(name) for name in command_names() if name not in OTHERS}


def write_pair(name, greys, free_thresh):
    with open(f"{name}.pgm", "wb") as file:
        file.write(b"P5\n%d %d\n255\n" % greys.shape[::-1] + greys.tobytes())
    with open(f"{name}.yaml", "w") as file:
        file.write(f"image: {name}.pgm\n{HEAD}free_thresh: {free_thresh}\n")


@pytest.fixture
def maps(tmp_path, monkeypatch):
    """A map of which 12.5 % are freed, one of which nothing is known, and a good one."""
    monkeypatch.chdir(tmp_path)
    write_pair("m", GREYS, 0.25)
    write_pair("u", np.full((3, 5), 205, dtype=np.uint8), 0.196)
    write_pair("good", GREYS, 0.196)
    return tmp_path


@pytest.mark.parametrize("name", LINES)
def test_every_command_that_reads_a_map_tells_of_freed_cells(name, command, maps):
    code, _, err = command(*LINES[name])
    assert code == (1 if name in NOT_SURE else 0)
    assert err.count(FREED) == (2 if name in TWO else 1)


def tree(folder):
    return {path: path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}


def written(words):
    """Return a command line whose outputs go to a new folder."""
    words = [f"new/deep/{word}" if word.split(".")[0] == "o" else word for word in words]
    if words[0] == "route":
        words += ["-o", "new/deep/route.json"]
    drawn = {"align", "clean", "diff", "merge", "reach", "rotate", "route", "score"}
    return [*words, *(["--image", "new/deep/o.png"] if words[0] in drawn else [])]


EDITS = {
    "polygon": ["--point", "3,0", "--point", "4,0", "--point", "4,1", "--value", "100"],
    "line": ["--point", "3,0", "--point", "4,0", "--value", "100"],
    "reset": ["--at", "3,0", "--size", "0.5,0.5"],
}
STRICT = {
    **{name: written(words) for name, words in LINES.items() if name not in {"info", "query"}},
    **{f"edit {name}": ["edit", name, "m.yaml", "-o", "new/deep/o.yaml", *words]
       for name, words in EDITS.items()},
    "info": LINES["info"],
    "query": LINES["query"],
    "unpack": ["unpack", "bits.pbm", "-o", "new/deep/o.yaml"],
    "build": ["build", "log.clf", "-o", "new/deep/o.yaml"],
    "run many": ["run", "m.yaml", "good.yaml", "-o", "new", "--set", "cost.inscribed_radius=0.1"],
    "run report": ["run", "m.yaml", "-o", "new", "--no-images", "--report"],
    "to stdout": ["inflate", "m.yaml", "-o", "-"],
}  # fmt: skip
"""Command lines that warn, of every command that can."""

STRICT_ALONE = {"lint", "completion"}
"""Of lint the findings that are warnings count; nothing is warned of in a script."""


def test_every_command_that_warns_is_run_strictly():
    assert {name.split()[0] for name in STRICT} - {"to"} == set(command_names()) - STRICT_ALONE


@pytest.mark.parametrize("name", STRICT)
def test_a_strict_command_that_warns_ends_with_1_and_writes_nothing(name, capfdbinary, maps):
    save_warned_bits_and_log()
    before = tree(maps)
    code, out, lines = run(capfdbinary, *STRICT[name], "--strict", "-q")
    assert (code, tree(maps)) == (1, before)
    warned = [line for line in lines if line.startswith("warning: ")]
    count = "1 warning" if len(warned) == 1 else f"{len(warned)} warnings"
    assert warned
    assert lines[-1].split(";")[0].endswith(f"{count}, and --strict allows none")
    if name == "to stdout":
        assert out == b""
        return
    # without the option the same words write, and warn of the same
    code, _, lenient = run(capfdbinary, *STRICT[name])
    assert code == (1 if name in NOT_SURE else 0)
    assert [line for line in lenient if line.startswith("warning: ")][: len(warned)] == warned
    assert "new/" not in " ".join(STRICT[name]) or (maps / "new").is_dir()


@pytest.mark.parametrize("name", STRICT)
def test_strictness_alone_is_no_reason(name, capfdbinary, maps):
    save_warned_bits_and_log()
    words = [word.replace("m.yaml", "good.yaml") for word in STRICT[name]]
    code, _, lines = run(capfdbinary, *words, "--strict")
    has_warned = any(line.startswith("warning: ") for line in lines)
    assert code == (1 if has_warned or name in NOT_SURE else 0)


def test_a_sequence_is_strict_cloud_by_cloud(command, maps):
    (maps / "0.csv").write_text("x,y\n0.45,0.4\n")
    (maps / "1.csv").write_text("x,y\n")  # no point marks a cell
    (maps / "poses.txt").write_text("0 0 0\n1 0 0\n")
    words = ["local", "--cloud", "0.csv", "--cloud", "1.csv", "--poses", "poses.txt", "--no-images"]
    words += ["--size", "1,1"]
    assert command(*words, "-o", "new")[0] == 0
    for keep in ([], ["--keep", "2"]):
        code, _, err = command(*words, *keep, "-o", "strict", "--strict", "--force")
        assert code == 5
        assert "error: 1.csv: 2 warnings, and --strict allows none; nothing was written" in err
        assert sorted(path.name for path in (maps / "strict").iterdir()) == ["0000", "summary.json"]
    (maps / "new" / "0007").mkdir()
    before = tree(maps)
    code, _, err = command(*words, "-o", "new", "--strict", "--force")
    assert (code, tree(maps)) == (1, before)
    assert "warning: 1 folders are not of this sequence" in err


@pytest.mark.parametrize(
    ("words", "warning"),
    [
        (["reach", "good.yaml", "--robot-radius", "0.05", "-o", "new/o.json"], "no start is given"),
        (["diff", "good.yaml", "part.yaml", "--max-differing", "100", "--image", "new/o.png"],
         "part.yaml: does not cover"),
        (["run", "good.yaml", "-o", "old", "--force"], "holds the local map of an earlier run"),
    ],
)  # fmt: skip
def test_what_is_known_last_of_all_is_warned_of_before_anything_is_written(
    command, maps, words, warning
):
    assert (
        command("window", "good.yaml", "--corner", "3,0", "--size", "1,1", "-o", "part.yaml")[0]
        == 0
    )
    assert command("run", "good.yaml", "-o", "old", "--pose", "3,0,0.2", "--no-images")[0] == 0
    before = tree(maps)
    code, _, err = command(*words, "--strict")
    assert (code, tree(maps)) == (1, before)
    assert warning in err
    assert err.endswith("error: 1 warning, and --strict allows none; nothing was written\n") or (
        words[0] == "run"
    )
    assert command(*words)[0] == 0
    assert tree(maps) != before


def save_warned_bits_and_log():
    with open("bits.pbm", "wb") as file:
        file.write(b"P4\n8 2\n\xff\x0f")
    with open("bits.yaml", "w") as file:
        file.write("image: bits.pbm\nresolution: 0.1\norigin: [0, 0, 0]\n")
    scan = f"FLASER 180 {'2.0 ' * 180}0.5 0 0 0.5 0 0 {{0}} robot {{0}}\n"
    with open("log.clf", "w") as file:
        file.writelines(scan.format(time) for time in (2.0, 1.0, 3.0))


def run(capfdbinary, *words):
    with warnings.catch_warnings():  # a command sets how warnings are shown
        code = main(words)
    out, err = capfdbinary.readouterr()
    return code, out, err.decode().splitlines()


def test_manifests_and_summaries_keep_it(command, maps):
    code, _, err = command("run", "m.yaml", "good.yaml", "-o", "o", "--no-images")
    assert (code, err) == (0, f"warning: {FREED}\n")
    manifest = json.loads((maps / "o/m/manifest.json").read_text())
    assert manifest["warnings"] == [FREED]
    assert json.loads((maps / "o/good/manifest.json").read_text())["warnings"] == []
    m, good = json.loads((maps / "o/summary.json").read_text())["maps"]
    assert (m["warnings"], good.get("warnings")) == ([FREED], None)


def test_manifests_name_files_as_they_would_anywhere(command, maps):
    command("run", "m.yaml", "-o", "a", "--no-images")
    command("run", maps / "m.yaml", "-o", "b", "--no-images")
    assert (maps / "a/m/manifest.json").read_bytes() == (maps / "b/m/manifest.json").read_bytes()
    _, out, err = command("run", maps / "m.yaml", "-o", "b", "--no-images")
    assert out.endswith("unchanged\n")
    assert err == f"warning: {maps}/{FREED}\n"


@pytest.mark.parametrize(
    ("words", "warnings"),
    [
        (["m.yaml"], 1),
        (["u.yaml"], 2),  # and the costs say nothing
        (["good.yaml", "--set", "inflate.radius=0.05", "--set", "cost.inflation_radius=0.06"], 1),
        (["good.yaml", "--set", "cost.inscribed_radius=0.1"], 1),  # the radius counts twice
    ],
    ids=["freed", "unknown", "costs", "recipe"],
)
def test_a_strict_run_writes_nothing(command, maps, words, warnings):
    lenient = command("run", *words, "-o", "o", "--no-images")
    assert lenient[0] == 0
    assert lenient[2].count("warning: ") == warnings
    code, out, err = command("run", *words, "-o", "s", "--no-images", "--strict")
    assert (code, out) == (1, "")
    assert "and --strict allows none; nothing was written" in err
    assert not (maps / "s").exists()
    # what an earlier run has left is there still, and is no excuse
    before = {path: path.read_bytes() for path in (maps / "o").rglob("*.*")}
    assert command("run", *words, "-o", "o", "--no-images", "--strict")[0] == 1
    assert {path: path.read_bytes() for path in (maps / "o").rglob("*.*")} == before


@pytest.mark.usefixtures("mapdeal_warnings")
def test_a_radius_that_counts_twice_stays_in_manifests_and_ends_strict_runs_from_python(
    command, maps
):
    words = ["good.yaml", "-o", "o", "--no-images", "--set", "cost.inscribed_radius=0.1"]
    command("run", *words)
    (told,) = json.loads((maps / "o/good/manifest.json").read_text())["warnings"]
    assert told.endswith("so the robot's radius counts twice")
    assert command("run", *words)[2].count("counts twice") == 1  # of an unchanged run, too
    changes = {"cost.inscribed_radius": 0.1}
    with pytest.raises(mapdeal.FindingError, match="1 warning"):
        mapdeal.run(maps / "good.yaml", maps / "s", changes=changes, strict=True)
    assert not (maps / "s").exists()


def test_a_strict_batch_goes_on_with_other_maps(command, maps):
    code, _, err = command("run", "m.yaml", "good.yaml", "-o", "o", "--no-images", "--strict")
    assert code == 5
    assert "m.yaml: 1 warning, and --strict allows none" in err
    m, good = json.loads((maps / "o/summary.json").read_text())["maps"]
    assert (m["status"], m["exit_code"], m["warnings"]) == ("failed", 1, [FREED])
    assert good["status"] == "done"
    assert not (maps / "o/m").exists()


def test_a_strict_run_of_a_good_map_is_a_run(command, maps):
    assert command("run", "good.yaml", "-o", "a", "--no-images")[0] == 0
    assert command("run", "good.yaml", "-o", "b", "--no-images", "--strict")[0] == 0
    for name in ("manifest.json", "cost.npz"):
        one, other = (maps / f"{folder}/good/{name}" for folder in "ab")
        assert one.read_bytes() == other.read_bytes()


def test_blocks_and_workers_say_the_same(command, maps):
    small = ["--max-memory", "120M", "-j", "2"]
    code, _, err = command("run", "m.yaml", "good.yaml", "-o", "o", "--no-images", *small)
    assert (code, err) == (0, f"warning: {FREED}\n")
