"""Every command with every name that a system can refuse, and numbers at the ends of floats."""

import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from bad_maps import check_failure, tree, write_map
from cli.conftest import single_commands
from cli.test_strict import LINES, bits_and_log, maps, usual_code  # noqa: F401 - fixtures
from mapdeal.cli.options import SHARED_OPTIONS
from odd_names import private

# X is the odd name. What a suffix decides is asked for with each suffix.
INPUTS = [
    *(f"{name} X.yaml -o o.npz" for name in
      ("esdf", "cost", "convert", "window --size 1,1", "rotate --yaw 1", "rescale --resolution 1",
       "edit reset --size 1,1 --corner 1,-2")),
    *(f"{name} X{end}" for end in (".yaml", ".npz", ".pgm", "") for name in ("info", "lint")),
    "diff m.yaml X.yaml", "query X.npz --at 1.6,-1.9", "route X.yaml --from 1,1 --to 1,1",
    "route m.yaml --pairs X", "reach X.yaml --from 1.6,-1.9", "reach X.npz",
    "reach m.yaml --from 1.6,-1.9 --points X.csv",
    "pack X.yaml -o o.pbm", "unpack X.pbm -o o.yaml", "diff X.npz m.yaml",
    "merge m.yaml X.yaml -o o.yaml",
    "score X.yaml", "score m.yaml --truth X.npz", "score m.yaml --truth m.yaml --transform X.json",
    "run -j1 X.yaml -o out", "run -j1 X.npz m.yaml -o out", "run -j1 X -o out", "run -j1 @X -o out",
    "run -j1 X* -o out", "run -j1 X/**/*.yaml -o out", "run -n X.yaml -o out",
    "run -j1 @list.txt -o out",
    "run -j1 m.yaml -o out --recipe X.yaml", "run -j1 m.yaml -o out --no-images --golden X",
    "cost m.yaml -o o.npz --mask X.yaml", "query m.yaml --points X",
    "query m.yaml --robot-radius 1 --poses X", "query X.npz --robot-radius 1 --at 1.6,-1.9,0",
    "edit polygon m.yaml -o o.npz --file X.yaml", "edit polygon m.yaml -o o.npz --file X.geojson",
    *(f"local --cloud X{end} --pose 1,1,0 -o out" for end in
      (".pcd", ".xyz", ".npz", "", "/*.pcd")),
    "local --cloud c.xyz --poses X -o out", "local --cloud X --poses poses.txt -o out",
    "local --cloud c.xyz --pose 1,1,0 --map X.yaml -o out",
    "local --cloud c.xyz --pose 1,1,0 --recipe X.yaml -o out",
    "local --map X.npz --pose 1,1,0 -o out",
    "local --cloud X.xyz --poses one.txt --keep 2 -o out",
    "run -j1 m.yaml --pose 1,1,0 --cloud X.xyz -o out",
    "run -j1 m.yaml --pose 1,1,0 --local-recipe X.yaml -o out",
    "build X.log -o o.yaml", "build X.npz -o o.yaml",
    "build --poses X --angles poses.txt --ranges poses.txt -o o.yaml",
    "build --poses poses.txt --angles X --ranges poses.txt -o o.yaml",
    "build --poses poses.txt --angles poses.txt --ranges X -o o.yaml",
    "info image.yaml", "lint image.yaml", "run -j1 image.yaml -o out",
]  # fmt: skip
OUTPUTS = [
    *(f"{name} m.yaml -o X.yaml" for name in ("inflate", "window --size 1,1")),
    "esdf m.yaml -o X.npy", "esdf m.yaml -o X.png", "esdf m.yaml -o o.npz --image X.png",
    "esdf m.yaml -o X.npz --force", "convert m.yaml -o X.pgm --force",
    "pack m.yaml -o X.pbm", "route m.yaml --from 1.6,-1.9 --to 1.6,-1.9 -o X.json",
    "route m.yaml --pairs one.txt -o X.jsonl", "reach m.yaml --from 1.6,-1.9 -o X.json",
    "reach m.yaml --from 1.6,-1.9 --layers X.npz",
    "reach m.yaml --from 1.6,-1.9 --image X.png -o o.json",
    "run -j1 m.yaml -o X", "run -j1 . -o X", "run -n m.yaml -o X", "run -j1 m.yaml -o X --force",
    "run -j1 m.yaml -o out --no-images --golden X --update-golden",
    "local --cloud c.xyz --pose 1,1,0 -o X", "local --cloud c.xyz --poses one.txt -o X",
    "lint m.yaml --fix -o X.yaml", "diff m.yaml m.yaml --image X.png",
    "score m.yaml --truth m.yaml --image X.png",
    "edit line m.yaml --point 1,1 2,2 -o X.npz", "build log.npz -o o.npz --layers X.npz",
    "build log.npz --compare -o X",
]  # fmt: skip
NAMES = {
    "long": lambda end: "n" * 300 + end, "deep": lambda end: "d/" * 2100 + end,
    "loop": lambda end: f"loop{end}", "below-a-loop": lambda end: f"loop/x{end}",
    "link-to-nothing": lambda end: f"dangling{end}", "private": lambda end: f"closed/x{end}",
    "link-into-private": lambda end: f"into{end}", "below-a-file": lambda end: f"m.yaml/x{end}",
    "full": lambda _: "/dev/full", "memory": lambda _: "/proc/self/mem",
    "zeros": lambda _: "/dev/zero", "empty": lambda _: "", "folder": lambda _: "closed",
    "newline": lambda end: f"a\nb{end}", "surrogate": lambda end: os.fsdecode(b"\xff") + end,
    "user": lambda end: f"~nobody-of-this-name/x{end}", "gone": lambda end: f"x{end}",
}  # fmt: skip
CLOSED = ("private", "link-into-private", "folder")
BATCHES = {".", "@list.txt", "--poses"}
ENDS = (".yaml", ".npz", ".pgm", ".pbm", ".pcd", ".ply", ".xyz", ".npy", ".log", ".png", ".json",
        ".geojson", "")  # fmt: skip


@pytest.fixture
def folder(here):
    write_map(here)
    Path("c.xyz").write_text("1 1\n2 1.5\n")
    Path("poses.txt").write_text("1,1,0\n2,1,0\n")
    Path("one.txt").write_text("1,1,0\n")
    np.savez("log.npz", poses=np.zeros((1, 3)), angles=np.zeros(1), ranges=np.ones((1, 1)))
    Path("closed").mkdir()
    for end in ENDS:
        Path(f"closed/x{end}").write_bytes(Path("m.yaml").read_bytes())
        Path(f"loop{end}").symlink_to(f"pool{end}")
        Path(f"pool{end}").symlink_to(f"loop{end}")
        Path(f"into{end}").symlink_to(f"closed/x{end}")
        Path(f"dangling{end}").symlink_to("nothing/at/all")
    return here


def words_of(line, name):
    """The words of a command, with the odd name made for the suffix that follows it."""
    words = []
    for word in line.split():
        place = word.find("X")
        words.append(word if place < 0 else word[:place] + NAMES[name](word[place + 1 :]))
    return words


def check(command, folder, monkeypatch, line, name, before, *, is_output):
    words = words_of(line, name)
    with monkeypatch.context() as patch:
        if name == "gone":
            gone = folder / "gone"
            gone.mkdir()
            patch.chdir(gone)
            gone.rmdir()
            words = [str(folder / word) if word in before else word for word in words]
        if name in CLOSED:
            private("closed", patch)
        code, _, err = command(*words)
    after = tree(folder)
    lines = err.splitlines()
    assert code in (0, 1, 2, 3, 4, 5), err
    assert "Traceback" not in err
    assert all(text.startswith(("error: ", "hint: ", "warning: ", "note: ")) for text in lines), err
    errors = [text for text in lines if text.startswith("error: ")]
    if code != 5 and not BATCHES & set(words):  # batches print an error for each map
        assert len(errors) == (code > 1) or (code == 1 and len(errors) == 1), err
        assert code in (0, 1) or "--golden" in words or after == before
    if not is_output:
        assert code != 0 or words[0] == "run" or name in ("zeros", "full", "surrogate")
    for path in after.keys() - before:
        shutil.rmtree(folder / path, ignore_errors=True)
        (folder / path).unlink(missing_ok=True)
    return {path: data for path, data in after.items() if path in before}


def share_of(lines, name, every):
    """Every so many lines; which ones differs from name to name, so that all are tried."""
    return lines[list(NAMES).index(name) % every :: every]


def test_lines_that_are_left_out_with_one_name_are_tried_with_others():
    for lines in (INPUTS, OUTPUTS):
        assert {line for name in NAMES for line in share_of(lines, name, 16)} == set(lines)


@pytest.mark.usefixtures("mapdeal_warnings", "one_core")
@pytest.mark.parametrize("every", [16, pytest.param(1, marks=pytest.mark.thorough)])
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("lines", [INPUTS, OUTPUTS], ids=["input", "output"])
def test_what_the_system_refuses_is_one_line(command, folder, monkeypatch, lines, name, every):
    Path("list.txt").write_text(f"m.yaml\n{NAMES[name]('.yaml')}\n", "utf-8", "replace")
    image = NAMES[name](".pgm").replace("\n", "\\n")
    text = Path("m.yaml").read_text().replace("m.pgm", f'"{image}"')
    Path("image.yaml").write_text(text, "utf-8", "replace")
    before = tree(folder)
    for line in share_of(lines, name, every):
        is_output = lines is OUTPUTS
        before = check(command, folder, monkeypatch, line, name, before, is_output=is_output)


VALUES = ["1e308", "-1e308", "5e-324", "nan", "inf", "-0", "1e400", "99999999999999999999"]
OF_ONE_METHOD = {"--ratio": "--method counting", "--truncation": "--method tsdf"}
WITH = {("build", "--size"): "--origin 0,0", ("build", "--origin"): "--size 2,2"}
ALTERNATIVES = {("window", "--at"): "--corner", ("edit reset", "--corner"): "--at"}
# Of options that all commands read alike, some commands are enough.
SHARED = {option.replace("_", "-") for option in SHARED_OPTIONS}
FOR_ALL_SHARED = ("run", "local", "potential")


def options_of(command):
    options = [p for p in command.params if p.param_type_name == "option" and not p.is_flag]
    return {max(option.opts, key=len): option for option in options}


OPTIONS = {name: options_of(command) for name, command in single_commands().items()}


def written(metavar, value):
    """Return an option's value of the form that its metavar says, with a number in all places."""
    if metavar == "[[X,Y],...]":
        return f"[[{value},{value}],[-1,1],[-1,-1]]"
    if metavar and "," in metavar and "..." not in metavar:
        return ",".join([value] * len(metavar.split("[,")[0].split(",")))
    return value


def without(line, option):
    """Return the words of a line without an option, wherever it stands, and its values."""
    words = line.split()
    while option in words:
        start = end = words.index(option)
        while end + 1 < len(words) and not words[end + 1].startswith("--"):
            end += 1
        del words[start : end + 1]
    return " ".join(words)


@pytest.mark.thorough
@pytest.mark.usefixtures("mapdeal_warnings", "maps", "bits_and_log")
@pytest.mark.parametrize("name", OPTIONS)
def test_a_number_gives_a_result_or_one_line(sh, name):
    options = OPTIONS[name]
    lines = [*LINES, "lint good.yaml", "completion bash"]  # LINES has none of these two
    line = next(line for line in lines if f"{line} ".startswith(f"{name} "))
    line += " --force" * ("--force" in options)
    assert sh(line)[0] == usual_code(line)
    for option, parameter in options.items():
        if parameter.name in ("output", "help") or parameter.type.name in ("path", "file"):
            continue
        if option.removeprefix("--") in SHARED and name not in FOR_ALL_SHARED:
            continue
        words = without(without(line, option), ALTERNATIVES.get((name, option)))
        more = f"{WITH.get((name, option), '')} {OF_ONE_METHOD.get(option, '')}"
        for value in VALUES:
            tried = f"{words} {more} {option}={written(parameter.metavar, value)}"
            code, out, err = sh(tried)
            assert code in (0, 1, 2, 3, 4), (tried, err)
            assert "Traceback" not in err, (tried, err)
            if code > 1:
                check_failure(code, out, err, code, [], "")
            else:
                starts = ("warning: ", "note: ", "error: ", "hint: ")
                assert all(text.startswith(starts) for text in err.splitlines()), tried
