"""Commands that must fail cleanly, and those that must not."""

import json

import pytest

from bad_maps import check_failure, tree, write_map


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder to work in, with a good map m.yaml and m.pgm."""
    monkeypatch.chdir(tmp_path)
    write_map(tmp_path)
    return tmp_path


@pytest.fixture
def refused(command, folder):
    """Run a command that must fail cleanly: one error line, nothing written."""

    def check(words, exit_code, *named, hint=""):
        before = tree(folder)
        code, out, err = command(*words)
        check_failure(code, out, err, exit_code, named, hint)
        assert tree(folder) == before

    return check


@pytest.fixture
def accepted(command, folder):
    """Run a command that must succeed; return its stdout and its warning lines."""

    def check(*words):
        code, out, err = command(*words)
        assert code == 0, err
        assert all(line.startswith(("warning: ", "note: ")) for line in err.splitlines()), err
        assert not list(folder.rglob(".mapdeal-*"))
        return out, err.splitlines()

    return check


@pytest.fixture
def info(accepted):
    """Return a function that reads `info --json` of m.yaml, and its warnings."""

    def read_info(*options):
        out, warned = accepted("info", "m.yaml", "--json", *options)
        return json.loads(out), warned

    return read_info
