"""Numbers at the ends of what floats can hold, for every option of every command."""

import pytest
import typer

from bad_maps import check_failure
from cli.test_strict import LINES, bits_and_log, maps, usual_code  # noqa: F401 - fixtures
from mapdeal.cli.main import app, command_names
from mapdeal.cli.options import SHARED_OPTIONS

VALUES = ["1e308", "-1e308", "5e-324", "nan", "inf", "-0", "1e400", "99999999999999999999"]
OF_ONE_METHOD = {"--ratio": "--method counting", "--truncation": "--method tsdf"}
WITH = {("build", "--size"): "--origin 0,0", ("build", "--origin"): "--size 2,2"}
ALTERNATIVES = {("window", "--at"): "--corner", ("edit reset", "--corner"): "--at"}
# Of options that all commands read alike, some commands are enough.
SHARED = {option.replace("_", "-") for option in SHARED_OPTIONS}
FOR_ALL_SHARED = ("run", "local", "potential")


def commands():
    group = typer.main.get_command(app)
    for name in command_names():
        command = group.get_command(None, name)
        for below, subcommand in getattr(command, "commands", {"": command}).items():
            options = [
                p for p in subcommand.params if p.param_type_name == "option" and not p.is_flag
            ]
            yield f"{name} {below}".strip(), {max(p.opts, key=len): p for p in options}


OPTIONS = dict(commands())


def working_line(name):
    """A line of test_strict that works; of these commands there is none."""
    lines = [*LINES, "lint good.yaml", "completion bash"]
    return next(line for line in lines if f"{line} ".startswith(f"{name} "))


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
    line = working_line(name) + " --force" * ("--force" in options)
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
