"""What ``--help`` shows: groups, and examples that run."""

import re
import shlex
import shutil
from importlib.util import find_spec
from pathlib import Path

import pytest

from cli.conftest import every_command
from mapdeal.cli.main import GROUPS, command_names
from mapdeal.stages.catalogue import STAGE_NAMES

COMMANDS = dict(every_command())


def test_every_command_stands_in_one_group(sh):
    assert {command.rich_help_panel for command in COMMANDS.values()} == set(GROUPS)
    out = sh.ok("--help")
    assert re.findall(r"^(\S.*):$", out, re.MULTILINE) == ["Options", *GROUPS]
    listed = re.findall(r"^  ([a-z][a-z-]+)  ", out, re.MULTILINE)
    assert sorted(listed) == sorted(command_names())
    assert listed[0] == "run"
    assert sh("-h")[1] == out
    assert "Usage: mapdeal esdf" in sh.ok("esdf -h")


@pytest.mark.parametrize("line", ["--help", "edit --help"])
def test_no_line_of_the_command_list_is_cut_off(sh, line):
    assert "..." not in sh.ok(line).split("Show this message and exit.")[1]


def test_a_stage_may_only_have_the_name_of_the_command_that_shows_it():
    modules = {name for name in command_names() if find_spec(f"mapdeal.commands.{name}")}
    assert modules & set(STAGE_NAMES) == {"reach"}


@pytest.mark.usefixtures("one_core")
@pytest.mark.parametrize("name", COMMANDS)
def test_examples_run_and_are_printed_as_they_are(name, command, here):
    shutil.copytree(Path(__file__).parents[2] / "examples", "examples")
    example = COMMANDS[name].epilog.splitlines()
    assert all(len(line) <= 80 for line in example)
    lines = [shlex.split(line) for line in "\n".join(example).replace("\\\n", " ").splitlines()]
    assert any(words[: 1 + len(name.split())] == ["mapdeal", *name.split()] for words in lines)
    for _, *words in lines:
        code, _, err = command(*(words[: words.index(">")] if ">" in words else words))
        assert code == (words[0] == "diff"), err  # which finds what the line before it drew
    code, out, _ = command(*name.split(), "--help")
    printed = out[out.index("\nExamples:\n") :].splitlines()[2:]
    assert [line.removeprefix("  ") for line in printed] == example


def test_options_that_count_with_a_value_of_another_stand_below_it(sh):
    out = sh.ok("cost --help")
    titles = re.findall(r"^(\S.*):$", out, re.MULTILINE)
    models = [f"With --model {name}" for name in ("exponential", "threshold", "rings", "layers")]
    assert titles == ["Arguments", "Options", *models, "Robot", "Common options", "Examples"]
    below = out[out.index("With --model rings:") :].splitlines()[1]
    assert below.split()[:3] == ["--values", "N,N,...", "Costs"]
    assert "\nWith a bag:\n  --topic TOPIC " in sh.ok("build --help")
