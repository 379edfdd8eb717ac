"""What ``--help`` shows: groups, and examples that run."""

import re
import shlex
import shutil
from pathlib import Path

import pytest

from mapdeal.cli.examples import EXAMPLES
from mapdeal.cli.help_pages import GROUPS
from mapdeal.cli.main import command_names

EXAMPLE_FILES = Path(__file__).parents[2] / "examples"


def lines_of(name):
    return [shlex.split(line) for line in EXAMPLES[name].replace("\\\n", " ").splitlines()]


def test_every_command_stands_in_one_group_and_has_examples(command):
    grouped = [name for names in GROUPS.values() for name in names]
    assert sorted(grouped) == sorted(command_names())
    kinds = {f"edit {kind}" for kind in ("polygon", "line", "circle", "reset")}
    assert set(EXAMPLES) == {*grouped, *kinds}
    code, out, _ = command("--help")
    assert code == 0
    assert re.findall(r"^(\S.*):$", out, re.MULTILINE) == ["Options", *GROUPS]
    assert re.findall(r"^  ([a-z]+)  ", out, re.MULTILINE) == grouped


@pytest.mark.parametrize("name", EXAMPLES)
def test_examples_run_and_are_printed_as_they_are(name, command, tmp_path, monkeypatch):
    shutil.copytree(EXAMPLE_FILES, tmp_path / "examples")
    monkeypatch.chdir(tmp_path)
    assert all(len(line) <= 80 for line in EXAMPLES[name].splitlines())
    for program, *words in lines_of(name):
        assert program == "mapdeal"
        assert " ".join(words).startswith(name) or len(lines_of(name)) > 1
        code, _, err = command(*(words[: words.index(">")] if ">" in words else words))
        assert code == (words[0] == "diff"), err  # which finds what the line before it drew
    code, out, _ = command(*name.split(), "--help")
    printed = out[out.index("\nExamples:\n") :].splitlines()[2:]
    assert [line.removeprefix("  ") for line in printed] == EXAMPLES[name].splitlines()


def test_options_that_count_with_a_value_of_another_stand_below_it(command):
    _, out, _ = command("cost", "--help")
    titles = re.findall(r"^(\S.*):$", out, re.MULTILINE)
    models = [f"With --model {name}" for name in ("exponential", "threshold", "rings", "layers")]
    assert titles == ["Arguments", "Options", *models, "Robot", "Common options", "Examples"]
    below = out[out.index("With --model rings:") :].splitlines()[1]
    assert below.split()[:3] == ["--values", "N,N,...", "Costs"]
    _, out, _ = command("build", "--help")
    assert "\nWith a bag:\n  --topic TOPIC " in out
