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

QUIETLY = "--set inflate.radius=0"  # which leaves the small map free cells
NAMES = ["Küche.yaml", "地图 ☃.yaml", os.fsdecode(b"\xff\xfe.yaml"), "a\x1bb\n.yaml"]
LINES = [
    "info", "info --json", "info --json nothing_☃", "lint", "lint --format json",
    "lint --format github", "run -v -o out", "run -n -v -o out", "inflate -v -o out.npz",
    "query --at 1.6,-1.9",
]  # fmt: skip


@pytest.fixture(autouse=True)
def folder(here):
    # a cell at each of two distances, so that their costs differ
    write_map(here, image=b"P5\n3 2\n255\n" + bytes([0, 254, 254, 254, 254, 254]))
    return here


@pytest.fixture
def streams(monkeypatch):
    def set_up(encoding):
        buffers = io.BytesIO(), io.BytesIO()
        for name, buffer in zip(("stdout", "stderr"), buffers, strict=True):
            stream = io.TextIOWrapper(buffer, encoding=encoding, write_through=True)
            monkeypatch.setattr(sys, name, stream)
        return lambda: tuple(buffer.getvalue().decode(encoding) for buffer in buffers)

    return set_up


@pytest.mark.parametrize("name", NAMES, ids=ascii)
@pytest.mark.parametrize("encoding", ["ascii", "cp1252", "utf-8"])
def test_names_that_a_stream_cannot_encode_are_written_as_escapes(streams, encoding, name):
    Path("m.yaml").rename(name)
    for line in LINES:
        written = streams(encoding)
        command, *more = line.split()
        code = main([command, *more, name] if command == "info" else [command, name, *more])
        _, err = written()
        expected = 5 if "nothing_☃" in more else 1 if command == "lint" and "☃" not in name else 0
        assert code in (0, expected), (command, err)
        assert "Traceback" not in err
        assert all(line.startswith(("error: ", "warning: ")) or "-v" in more
                   for line in err.splitlines())  # fmt: skip


def test_what_can_be_encoded_is_written_as_it_is(streams):
    Path("m.yaml").rename("Küche.yaml")
    for encoding, shown in (("latin-1", "Küche.yaml"), ("ascii", "K\\xfcche.yaml")):
        written = streams(encoding)
        assert main(["info", "Küche.yaml"]) == 0
        assert written()[0].splitlines()[0] == shown


@pytest.mark.parametrize("value", ["0", "1", "x", "-5", "9" * 30, ""])
def test_help_for_terminals_of_any_width(sh, monkeypatch, value):
    for line in ("--help", "rotate --help"):
        with monkeypatch.context() as here:  # whoever reports of tests asks for it, too
            here.setenv("COLUMNS", value)
            out = sh.ok(line)
        assert "Usage:mapdeal" in "".join(out.split())


def test_without_threads_runs_write_the_same_and_batches_count(folder, sh, scarce_threads):
    sh(f"run m.yaml -o threads --threads 3 {QUIETLY}")
    scarce_threads(0)
    assert sh.err(f"run m.yaml -o none --threads 3 {QUIETLY}") == ""
    assert tree(folder / "none") == tree(folder / "threads")
    assert "1 map: 1 done" in sh.ok(f"run . -o out -j 1 {QUIETLY}")


@pytest.mark.parametrize("environment", [
    {"HOME": "/nonexistent", "XDG_CACHE_HOME": "/dev/null", "TMPDIR": "/nonexistent",
     "PYTHONIOENCODING": "ascii:strict", "PYTHONWARNINGS": "error", "MAPDEAL_KERNELS": "scipy",
     "TERM": "xyz", "NO_COLOR": "1", "COLUMNS": "x", "TZ": "Mars/Olympus"},
    {"LC_ALL": "xx_YY.UTF-99", "LANG": "zz", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
], ids=lambda environment: next(iter(environment)))  # fmt: skip
def test_odd_variables_do_not_change_the_files(environment):
    Path("m.yaml").rename("Küche.yaml")
    words = ["run", "Küche.yaml", "-o", "out", *QUIETLY.split()]
    completed = subprocess.run(
        [sys.executable, "-m", "mapdeal", *words], capture_output=True, text=True,
        env={"PYTHONPATH": os.pathsep.join(map(str, sys.path)), **environment},
    )  # fmt: skip
    assert (completed.returncode, completed.stderr) == (0, "")
    assert Path("out/Küche/manifest.json").exists()


def test_a_library_that_cannot_be_loaded_is_one_line(sh, monkeypatch):
    Image.new("L", (3, 2)).save("p.png")
    Path("p.yaml").write_text(yaml_text(image="p.png"))
    monkeypatch.setitem(sys.modules, "PIL", None)
    monkeypatch.setitem(sys.modules, "PIL.Image", None)
    error, hint = sh.err("esdf p.yaml -o o.npz", 4).splitlines()
    assert error.startswith("error: a library cannot be loaded: import of PIL")
    assert hint.startswith("hint: ulimit -a")
    assert not Path("o.npz").exists()
