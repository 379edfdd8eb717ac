"""A map whose image is the matter."""

import pytest

from bad_maps import cells_of, check_failure, tree

YAML = """\
image: m.pgm
mode: {mode}
resolution: 0.05
origin: [1.5, -2.0, 0.4]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def write_map(folder):
    """Write m.yaml, and its image m.pgm of the given contents."""

    def write(image=None, mode="trinary"):
        (folder / "m.yaml").write_text(YAML.format(mode=mode))
        if image is not None:
            (folder / "m.pgm").write_bytes(image)

    return write


@pytest.fixture
def refused(command, folder):
    """Run commands that must fail cleanly: one error line, nothing written."""

    def check(exit_code, *named, hint="", options=()):
        for words in (["info", "m.yaml"], ["run", "m.yaml", "-o", "out"]):
            before = tree(folder)
            code, out, err = command(*words, *options)
            check_failure(code, out, err, exit_code, named, hint)
            assert tree(folder) == before

    return check


@pytest.fixture
def accepted(command, folder):
    """Run a command that must succeed; return its warning lines."""

    def check(*words):
        code, _, err = command(*words)
        assert code == 0, err
        assert all(line.startswith("warning: ") for line in err.splitlines()), err
        assert not list(folder.rglob(".mapdeal-*"))
        return err.splitlines()

    return check


@pytest.fixture
def read_cells(accepted):
    """The cells of m.yaml after a conversion, and the warnings it made."""

    def read(*options):
        warned = accepted("convert", "m.yaml", "-o", "o.npz", "--force", *options)
        return cells_of("o.npz", "occupancy"), warned

    return read
