import json
from pathlib import Path
from typing import get_args

import pytest
import typer

from drawn import grid_from_text
from mapdeal import write_map
from mapdeal.cli.main import app, command_names
from mapdeal.cli.options import OF_IMAGES, SHARED_OPTIONS
from mapdeal.command import split_optional
from mapdeal.kernels import threads


def _commands(group, path=()):
    for name in group.list_commands(None):
        command = group.get_command(None, name)
        if hasattr(command, "list_commands"):
            yield from _commands(command, (*path, name))
        else:
            yield (*path, name), command


ALL_COMMANDS = dict(_commands(typer.main.get_command(app)))


@pytest.fixture
def room(here):
    write_map("room.yaml", grid_from_text("...#\n..?.\n....", 0.1, (1.5, -2.0, 0.4)))


@pytest.mark.parametrize("path", ALL_COMMANDS, ids=" ".join)
def test_every_command_ends_with_strict_quiet_and_verbose(path):
    parameters = [parameter.name for parameter in ALL_COMMANDS[path].params]
    assert [name for name in parameters if name != "help"][-3:] == ["strict", "quiet", "verbose"]
    assert path[0] in command_names()


@pytest.mark.parametrize("path", ALL_COMMANDS, ids=" ".join)
def test_a_shared_option_is_the_same_in_all_commands(path):
    for parameter in ALL_COMMANDS[path].params:
        if parameter.name in set(SHARED_OPTIONS) - set(OF_IMAGES):  # which some have of their own
            shared = SHARED_OPTIONS[parameter.name]
            assert parameter.opts[0] == f"--{parameter.name.replace('_', '-')}"
            assert parameter.default == shared.default
            choices = "|".join(map(str, get_args(split_optional(shared.kind)[0])))
            assert parameter.metavar in (shared.metavar, choices)


def test_what_prints_json_and_what_writes_it_to_files():
    without = {
        " ".join(path) for path, command in ALL_COMMANDS.items() if not _has(command, "as_json")
    }
    assert without == {"completion"}  # a script for a shell


def test_json_of_commands_that_write_a_map_counts_its_cells(command, room):
    for line in (
        "inflate room.yaml --robot-radius 0.1 -o a.yaml", "esdf room.yaml -o b.npz",
        "active room.yaml -o c.yaml",
    ):  # fmt: skip
        figures = json.loads(command(*line.split(), "--json")[1])["figures"]
        assert (figures["width"], figures["height"]) == (4, 3)
    for line in ("convert room.yaml -o d.png", "pack room.yaml -o e.pbm", "unpack e.pbm -o f.yaml"):
        document = json.loads(command(*line.split(), "--json")[1])
        assert (document["width"], document["height"], document["occupied"]) == (4, 3, 1)


def _has(command, name):
    return any(parameter.name == name for parameter in command.params)


FLAGS = [
    (path, name)
    for path, command in ALL_COMMANDS.items()
    for parameter in command.params
    for name in parameter.opts
    if parameter.secondary_opts
]


@pytest.mark.parametrize(("path", "name"), FLAGS, ids=lambda part: str(part))
def test_every_flag_with_two_names_takes_yes_and_no(command, path, name):
    code, _, err = command(*path, f"{name}=perhaps")
    assert (code, err) == (2, f"error: {name}: must be yes or no, got 'perhaps'\n")
    for words in ([name, "no"], [f"{name}=Off"], [name], [name, "TRUE"], [f"--no-{name[2:]}"]):
        code, _, err = command(*path, *words)
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


def test_a_flag_with_one_name_takes_no_word(sh, room):
    assert "no: " in sh.err("info --json no room.yaml", 5)


def test_words_behind_two_dashes_are_no_options(sh, room):
    assert "(--inflate-unknown=no)" in sh.err(
        "inflate -o a.npz -- room.yaml --inflate-unknown=no", 2
    )
    assert not Path("a.npz").exists()
