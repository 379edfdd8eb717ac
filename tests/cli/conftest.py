"""Command lines as they are typed, in a folder of their own."""

import json
import shlex

import pytest


class Shell:
    """Runs lines of `mapdeal` in this process; what it is not told to expect is an error."""

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
