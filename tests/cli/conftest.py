"""Command lines as they are typed, in a folder of their own."""

import contextlib
import json
import os
import pty
import shlex
import subprocess
import sys

import pytest
import typer

from drawn import grid_from_text
from mapdeal import read_map, write_map
from mapdeal.cli.main import app, command_names


def every_command():
    """Yield names and commands: each group, and those below it."""
    group = typer.main.get_command(app)
    for name in command_names():
        command = group.get_command(None, name)
        yield name, command
        for word, own in getattr(command, "commands", {}).items():
            yield f"{name} {word}", own


def single_commands():
    return {name: each for name, each in every_command() if not hasattr(each, "commands")}


class Shell:
    """Runs lines of `mapdeal` in this process; exit codes and warnings must be as expected."""

    def __init__(self, command):
        self.command = command

    def __call__(self, line):
        """Return exit code, stdout and stderr."""
        return self.command(*shlex.split(line))

    def ok(self, line):
        """Return stdout of what ends well and says nothing on stderr."""
        code, out, err = self(line)
        assert (code, err) == (0, "")
        return out

    def err(self, line, code=0):
        """Return stderr of what ends with that code."""
        found, _, err = self(line)
        assert found == code, err
        return err

    def json(self, line):
        return json.loads(self(line)[1])


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def sh(command, here):
    return Shell(command)


def shown_on_terminal(line):
    """Run a line of `mapdeal` as a process; return what a terminal behind stderr shows."""
    master, slave = pty.openpty()
    words = [sys.executable, "-m", "mapdeal", *shlex.split(line)]
    subprocess.run(words, stderr=slave, stdout=subprocess.DEVNULL, check=False)
    os.close(slave)
    shown = b""
    with contextlib.suppress(OSError):
        while part := os.read(master, 65536):
            shown += part
    os.close(master)
    return shown


@pytest.fixture(name="shown_on_terminal")
def _shown_on_terminal():
    return shown_on_terminal


@pytest.fixture
def room(here):
    """A map that is turned, as a file too, with three obstacles and an unknown cell."""
    drawing = "........\n.#......\n......?.\n...##..."
    write_map("room.yaml", grid_from_text(drawing, 0.1, (1.5, -2.0, 0.4)))
    return read_map("room.yaml")
