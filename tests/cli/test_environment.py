"""The command line in odd surroundings: streams, terminals, variables, few threads."""

import io
import os
import subprocess
import sys
from pathlib import Path

import pytest
from PIL import Image

from bad_maps import tree, write_map, yaml_text
from mapdeal.cli.main import main

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
QUIETLY = ["--set", "inflate.radius=0"]  # which leaves the small map free cells
NAMES = ["Küche.yaml", "地图 ☃.yaml", os.fsdecode(b"\xff\xfe.yaml"), "a\x1bb\n.yaml"]
WORDS = [
    ["info"], ["info", "--json"], ["lint"], ["lint", "--format", "json"],
    ["lint", "--format", "github"], ["run", "-v", "-o", "out"], ["run", "-n", "-v", "-o", "out"],
    ["inflate", "-v", "-o", "out.npz"], ["query", "--at", "1.6,-1.9"], ["info", "nothing ☃"],
]  # fmt: skip


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    # a cell at each of two distances, so that their costs differ
    write_map(tmp_path, image=b"P5\n3 2\n255\n" + bytes([0, 254, 254, 254, 254, 254]))
    return tmp_path


@pytest.fixture
def streams(monkeypatch):
    """Set stdout and stderr of an encoding; return what gives all that was written."""

    def set_up(encoding):
        buffers = io.BytesIO(), io.BytesIO()
        for name, buffer in zip(("stdout", "stderr"), buffers, strict=True):
            stream = io.TextIOWrapper(buffer, encoding=encoding, write_through=True)
            monkeypatch.setattr(sys, name, stream)
        return lambda: tuple(buffer.getvalue().decode(encoding) for buffer in buffers)

    return set_up


@pytest.mark.parametrize("name", NAMES, ids=ascii)
@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "cp1252", "utf-8"])
def test_names_that_a_stream_cannot_encode_are_written_as_escapes_f14(
    folder, streams, encoding, name
):
    (folder / "m.yaml").rename(folder / name)
    for command, *more in WORDS:
        written = streams(encoding)
        code = main([command, *more, name] if command == "info" else [command, name, *more])
        _, err = written()
        expected = 4 if "nothing ☃" in more else 1 if command == "lint" and "☃" not in name else 0
        assert code in (0, expected), (command, err)
        assert "Traceback" not in err
        assert all(line.startswith(("error: ", "warning: ")) or "-v" in more
                   for line in err.splitlines())  # fmt: skip


def test_what_can_be_encoded_is_written_as_it_is(folder, streams):
    (folder / "m.yaml").rename(folder / "Küche.yaml")
    for encoding, shown in (("latin-1", "Küche.yaml"), ("ascii", "K\\xfcche.yaml")):
        written = streams(encoding)
        assert main(["info", "Küche.yaml"]) == 0
        assert written()[0].splitlines()[0] == shown


@pytest.mark.parametrize("value", ["0", "1", "x", "-5", "9" * 30, ""])
def test_help_for_terminals_of_any_width(command, monkeypatch, value):
    for words in (["--help"], ["run", "--help"]):
        with monkeypatch.context() as here:  # whoever reports of tests asks for it, too
            here.setenv("COLUMNS", value)
            code, out, err = command(*words)
        assert (code, err) == (0, "")
        assert "Usage:mapdeal" in "".join(out.split())


def test_a_run_without_threads_writes_the_same(folder, command, scarce_threads):
    assert command("run", "m.yaml", "-o", "threads", "--threads", "3", *QUIETLY)[0] == 0
    scarce_threads(0)
    code, _, err = command("run", "m.yaml", "-o", "none", "--threads", "3", *QUIETLY)
    assert (code, err) == (0, "")
    assert tree(folder / "none") == tree(folder / "threads")


def test_a_batch_tells_how_far_it_is_without_a_thread_for_that(folder, command, scarce_threads):
    scarce_threads(0)
    code, out, err = command("run", ".", "-o", "out", "-j", "1", *QUIETLY)
    assert (code, err) == (0, "")
    assert "1 map: 1 done" in out


def process(*words, folder, **environment):
    told = subprocess.run(
        [sys.executable, "-m", "mapdeal", *words], capture_output=True, text=True, cwd=folder,
        env={"PYTHONPATH": os.pathsep.join(map(str, sys.path)), **environment},
    )  # fmt: skip
    return told.returncode, told.stderr


@pytest.mark.parametrize(
    "environment",
    [
        {"HOME": "/nonexistent", "XDG_CACHE_HOME": "/dev/null", "TMPDIR": "/nonexistent"},
        {"LC_ALL": "xx_YY.UTF-99", "LANG": "zz", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
        {"TERM": "xyz", "NO_COLOR": "1", "COLUMNS": "x", "TZ": "Mars/Olympus"},
        {"PYTHONWARNINGS": "error", "MAPDEAL_KERNELS": "scipy"},
        {"PYTHONIOENCODING": "ascii:strict"},
    ],
    ids=lambda environment: next(iter(environment)),
)
def test_odd_variables_do_not_change_what_is_done_f14_f15(folder, environment):
    (folder / "m.yaml").rename(folder / "Küche.yaml")
    words = ["run", "Küche.yaml", "-o", "out", *QUIETLY]
    assert process(*words, folder=folder, **environment) == (0, "")
    assert (folder / "out" / "Küche" / "manifest.json").exists()


def test_a_library_that_cannot_be_loaded_is_one_line(folder, command, monkeypatch):
    Image.new("L", (3, 2)).save(folder / "p.png")
    (folder / "p.yaml").write_text(yaml_text(image="p.png"))
    monkeypatch.setitem(sys.modules, "PIL", None)
    monkeypatch.setitem(sys.modules, "PIL.Image", None)
    code, out, err = command("esdf", "p.yaml", "-o", "o.npz")
    assert (code, out) == (4, "")
    error, hint = err.splitlines()
    assert error.startswith("error: a library cannot be loaded: import of PIL")
    assert hint.startswith("hint: ulimit -a")
    assert not (folder / "o.npz").exists()
