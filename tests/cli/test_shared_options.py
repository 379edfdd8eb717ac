import json
from pathlib import Path
from typing import get_args

import pytest

from cli.conftest import single_commands
from mapdeal.cli.options import OF_IMAGES, SHARED_OPTIONS
from mapdeal.command import split_optional
from mapdeal.kernels import threads

COMMANDS = single_commands()


@pytest.mark.parametrize("name", COMMANDS)
def test_shared_options_are_the_same_in_all_commands_and_some_stand_last(name):
    names = [parameter.name for parameter in COMMANDS[name].params if parameter.name != "help"]
    assert names[-3:] == ["strict", "quiet", "verbose"]
    for parameter in COMMANDS[name].params:
        if parameter.name in set(SHARED_OPTIONS) - set(OF_IMAGES):  # which some have of their own
            shared = SHARED_OPTIONS[parameter.name]
            assert parameter.opts[0] == f"--{parameter.name.replace('_', '-')}"
            assert parameter.default == shared.default
            choices = "|".join(map(str, get_args(split_optional(shared.kind)[0])))
            assert parameter.metavar in (shared.metavar, choices)


def test_what_prints_json_and_what_writes_it_to_files():
    names = {name: {option.name for option in COMMANDS[name].params} for name in COMMANDS}
    without = [name for name in COMMANDS if "as_json" not in names[name]]
    assert without == ["completion"]  # a script for a shell


def test_json_of_commands_that_write_a_map_counts_its_cells(command, room):
    for line in (
        "inflate room.yaml --robot-radius 0.1 -o a.yaml", "esdf room.yaml -o b.npz",
        "active room.yaml -o c.yaml",
    ):  # fmt: skip
        figures = json.loads(command(*line.split(), "--json")[1])["figures"]
        assert (figures["width"], figures["height"]) == (8, 4)
    for line in ("convert room.yaml -o d.png", "pack room.yaml -o e.pbm", "unpack e.pbm -o f.yaml"):
        document = json.loads(command(*line.split(), "--json")[1])
        assert (document["width"], document["height"], document["occupied"]) == (8, 4, 3)


FLAGS = [
    f"{name} {flag}"
    for name, command in COMMANDS.items()
    for parameter in command.params
    for flag in parameter.opts
    if parameter.secondary_opts
]


@pytest.mark.parametrize("line", FLAGS)
def test_every_flag_with_two_names_takes_yes_and_no(sh, line):
    flag = line.split()[-1]
    assert sh.err(f"{line}=perhaps", 2) == f"error: {flag}: must be yes or no, got 'perhaps'\n"
    for words in (f"{line} no", f"{line}=Off", line, f"{line} TRUE", line.replace("--", "--no-")):
        code, _, err = sh(words)
        # lint needs a map, or parameter files
        assert (code, "missing" in err or "needs" in err) == (2, True), err


@pytest.mark.parametrize("count", [1, 3])
def test_so_many_threads_are_used(sh, room, monkeypatch, count):
    used = set()
    real = threads.in_bands

    def record(*arguments):
        used.add(threads.thread_count())
        return real(*arguments)

    monkeypatch.setattr(threads, "in_bands", record)
    sh.ok(f"esdf room.yaml -o a.npz --threads {count}")
    assert used == {count}


def test_words_behind_flags_and_two_dashes_are_no_values_of_options(sh, room):
    assert "no: " in sh.err("info --json no room.yaml", 5)
    line = "inflate -o a.npz -- room.yaml --inflate-unknown=no"
    assert "(--inflate-unknown=no)" in sh.err(line, 2)
    assert not Path("a.npz").exists()
