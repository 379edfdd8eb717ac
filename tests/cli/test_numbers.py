"""Numbers at the ends of what floats can hold, for every option of every command."""

import numpy as np
import pytest
import typer

from bad_maps import check_failure
from mapdeal import OccupancyGrid, write_map
from mapdeal.cli.main import app, command_names
from mapdeal.cli.options import SHARED_OPTIONS

VALUES = ["1e308", "-1e308", "5e-324", "nan", "inf", "-0", "1e400", "99999999999999999999"]
IN_OUT = ["m.yaml", "-o", "o.npz", "--force"]
DRAWN = ["--point", "1.2,2.1", "--value", "100"]

# A command that works; what is tried is added, in the place of the same option if it is there.
# A command that is not named here takes a map, and writes an npz if it writes anything.
LINES = {
    "run": ["m.yaml", "-o", "out", "--force", "--no-images"],
    "local": ["--cloud", "c.csv", "--pose", "0,0,0", "-o", "out", "--force", "--size", "2,2",
              "--no-images"],
    "build": ["--poses", "c.csv", "--angles", "a.txt", "--ranges", "r.txt", "-o", "o.yaml",
              "--force"],
    "query": ["m.yaml", "--at", "1.2,2.1"],
    "reach": ["m.yaml", "--from", "1.3,2.4", "--to", "2.3,3.4", "-o", "o.json", "--force"],
    "route": ["m.yaml", "--from", "1.3,2.4", "--to", "2.3,3.4"],
    "edit circle": [*IN_OUT, *DRAWN, "--radius", "0.1"],
    "edit line": [*IN_OUT, *DRAWN, "--point", "1.3,2.3"],
    "edit polygon": [*IN_OUT, *DRAWN, "--point", "1.3,2.3", "--point", "1.2,2.3"],
    "edit reset": [*IN_OUT, "--at", "1.2,2.1", "--size", "0.1,0.1"],
    "window": [*IN_OUT, "--at", "1.2,2.1", "--size", "0.3,0.2"],
    "shift": [*IN_OUT, "--origin", "1.1,2.1"],
    "rotate": [*IN_OUT, "--yaw", "0.3"],
    "rescale": [*IN_OUT, "--resolution", "0.2"],
    "pack": ["m.yaml", "-o", "o.pbm", "--force"],
    "unpack": ["b.pbm", "-o", "o.yaml", "--force"],
    "diff": ["m.yaml", "m.yaml"],
    "merge": ["m.yaml", "m.yaml", "-o", "o.yaml", "--force"],
    "align": ["m.yaml", "m.yaml"],
    "score": ["m.yaml", "--truth", "m.yaml"],
    "report": ["m.yaml", "-o", "o.html", "--force"],
    "completion": ["bash"],
}  # fmt: skip
ALTERNATIVES = {("window", "--corner"): "--at", ("edit reset", "--corner"): "--at"}
WITH = {("build", "--size"): ["--origin", "0,0"], ("build", "--origin"): ["--size", "2,2"]}
NEEDED = {"--ratio": ["--method", "counting"], "--truncation": ["--method", "tsdf"]}
# Of options that all commands read alike, some commands are enough.
SHARED = {option.replace("_", "-") for option in SHARED_OPTIONS}
FOR_ALL_SHARED = ("run", "local", "potential")

pytestmark = pytest.mark.usefixtures("mapdeal_warnings")


def commands():
    """Return the options with values of each command, by its name."""
    found = {}
    group = typer.main.get_command(app)
    for name in command_names():
        command = group.get_command(None, name)
        for below, one in getattr(command, "commands", {"": command}).items():
            options = {max(p.opts, key=len): p for p in one.params
                       if p.param_type_name == "option" and not p.is_flag}  # fmt: skip
            found[f"{name} {below}".strip()] = options
    return found


def needs_output(options):
    return "--output" in options and options["--output"].required


WORKING = {
    name: LINES.get(name, IN_OUT if needs_output(options) else ["m.yaml"])
    for name, options in commands().items()
}


@pytest.fixture
def folder(tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    occupancy = np.zeros((6, 7), np.int8)
    occupancy[5, 5:] = 100
    write_map("m.yaml", OccupancyGrid(occupancy, 0.5, (1.0, 2.0, 0.1)))
    (tmp_path / "c.csv").write_text("0.1,0.2,0.1\n0.3,0.1,0.2\n")
    (tmp_path / "a.txt").write_text("-0.5 0 0.5\n")
    (tmp_path / "r.txt").write_text("1 0.5 0.7\n1 0.5 inf\n")
    assert command("pack", "m.yaml", "-o", "b.pbm", "-q")[0] == 0
    return tmp_path


def written(metavar, value):
    """Return an option's value of the form that its metavar says, with a number in all places."""
    if metavar == "[[X,Y],...]":
        return f"[[{value},{value}],[-1,1],[-1,-1]]"
    if metavar and "," in metavar and "..." not in metavar:
        return ",".join([value] * len(metavar.split("[,")[0].split(",")))
    return value


def without(words, option):
    """Return words without an option, wherever it stands, and its value."""
    kept = list(words)
    while option in kept:
        del kept[kept.index(option) : kept.index(option) + 2]
    return kept


NOT_SURE = {"align"}
"""Commands that end with 1 on maps of so few cells."""


@pytest.mark.thorough
@pytest.mark.parametrize("name", WORKING)
def test_a_number_gives_a_result_or_one_line(command, folder, name):
    assert command(*name.split(), *WORKING[name])[0] == (1 if name in NOT_SURE else 0)
    for option, parameter in commands()[name].items():
        if parameter.name in ("output", "help") or parameter.type.name in ("path", "file"):
            continue
        if option.removeprefix("--") in SHARED and name not in FOR_ALL_SHARED:
            continue
        words = without(without(WORKING[name], option), ALTERNATIVES.get((name, option)))
        more = [*WITH.get((name, option), []), *NEEDED.get(option, [])]
        for value in VALUES:
            tried = f"{option}={written(parameter.metavar, value)}"
            code, out, err = command(*name.split(), *words, *more, tried)
            assert code in (0, 1, 2, 3, 4), (tried, err)
            assert "Traceback" not in err, (tried, err)
            if code > 1:
                check_failure(code, out, err, code, [], "")
            else:
                lines = err.splitlines()
                assert all(
                    line.startswith(("warning: ", "note: ", "error: ", "hint: ")) for line in lines
                ), tried
