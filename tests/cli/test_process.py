"""The command line as a process: how it starts, ends, and what it says at its end."""

import errno
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from engines import needs_compiled
from mapdeal.kernels import engine

pytestmark = pytest.mark.slow

EXAMPLE = Path(__file__).parents[2] / "examples" / "maps" / "office.yaml"


def process(*words, **environment):
    return subprocess.run(
        [sys.executable, "-m", "mapdeal", *map(str, words)],
        capture_output=True,
        text=True,
        env={**os.environ, **environment},
    )


def test_a_process_ends_with_the_exit_code_and_all_of_its_output(tmp_path):
    told = process("info", *[EXAMPLE] * 40, "--json")
    assert told.returncode == 0
    assert len(told.stdout.splitlines()) == 40
    missing = process("inflate", tmp_path / "missing.yaml", "-o", tmp_path / "a.yaml")
    assert missing.returncode == 4
    assert missing.stderr.startswith("error: ")
    assert len(missing.stderr.splitlines()) == 1


def shell(line, folder):
    """Run a line of the shell in which $mapdeal is the command and $MAP a map."""
    return subprocess.run(
        ["bash", "-c", line],
        capture_output=True,
        text=True,
        cwd=folder,
        env={**os.environ, "mapdeal": f"{sys.executable} -m mapdeal", "MAP": str(EXAMPLE)},
    )


@pytest.mark.parametrize(
    "words",
    [
        "run -v $MAP -o out",
        "run $MAP -o out >&-",
        "run -v $MAP -o out 2>&-",
        "run $MAP -o out >&- 2>&-",
    ],
)
def test_closed_streams_do_not_change_what_is_done(words, tmp_path):
    told = shell(f"$mapdeal {words}", tmp_path)
    assert told.returncode == 0, told.stderr
    assert (tmp_path / "out" / "office" / "manifest.json").exists()


@pytest.mark.parametrize("redirection", ["2> >(true)", "2>&1 | true", "> >(true) 2>&1"])
def test_readers_that_go_away_do_not_change_what_is_done(redirection, tmp_path):
    line = f"set -o pipefail; PYTHONUNBUFFERED=1 $mapdeal run -v $MAP $MAP2 -o out {redirection}"
    (tmp_path / "b.yaml").write_text(EXAMPLE.read_text().replace("office.pgm", "b.pgm"))
    (tmp_path / "b.pgm").write_bytes(EXAMPLE.with_suffix(".pgm").read_bytes())
    told = shell(f"MAP2=b.yaml; {line}", tmp_path)
    assert told.returncode == 0, told.stderr
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert [entry["status"] for entry in summary["maps"]] == ["done", "done"]


def test_an_error_keeps_its_exit_code_without_stderr(tmp_path):
    for redirection in ("2>&-", "2>/dev/full", "2> >(true)"):
        told = shell(f"$mapdeal inflate nope.yaml -o a.yaml {redirection}", tmp_path)
        assert (told.returncode, told.stdout) == (4, ""), redirection


@pytest.mark.parametrize("words", ["--help", "--version", "info $MAP", "run $MAP -o out"])
def test_a_full_disk_behind_stdout_is_told_in_one_line(words, tmp_path):
    told = shell(f"$mapdeal {words} > /dev/full", tmp_path)
    assert told.returncode == 4
    assert told.stderr == "error: standard output: cannot be written: No space left on device\n"


@pytest.mark.parametrize("words", ["--help", "--version", "info $MAP"])
def test_a_reader_that_has_seen_enough_is_no_error_f13(words, tmp_path):
    told = shell(f"set -o pipefail; PYTHONUNBUFFERED=1 $mapdeal {words} | true", tmp_path)
    assert (told.returncode, told.stderr) == (0, "")


def test_ctrl_c_is_said_and_leaves_nothing(tmp_path):
    started = subprocess.Popen(
        [sys.executable, "-c", INTERRUPTED_RUN, str(EXAMPLE), str(tmp_path / "out")],
        stderr=subprocess.PIPE,
        text=True,
    )
    _, stderr = started.communicate(timeout=120)
    assert started.returncode == 130, stderr
    assert stderr == "error: interrupted\n"
    assert not (tmp_path / "out").exists()


INTERRUPTED_RUN = """
import sys
from mapdeal.grid.frame import Framed
from mapdeal.cli.process import run_process

def interrupted(*_):
    raise KeyboardInterrupt

Framed.figures = interrupted
sys.argv = ["mapdeal", "run", sys.argv[1], "-o", sys.argv[2]]
run_process()
"""


def test_the_version_says_which_kernels_are_in_use():
    usual = "scipy" if engine.compiled_module() is None else "compiled"
    assert f"(kernels: {usual})" in process("--version", MAPDEAL_KERNELS="").stdout
    assert "(kernels: scipy)" in process("--version", MAPDEAL_KERNELS="scipy").stdout


def test_an_engine_that_there_is_not_is_an_error_on_one_line(tmp_path):
    for words in (["--version"], ["inflate", EXAMPLE, "-o", tmp_path / "out.yaml"]):
        told = process(*words, MAPDEAL_KERNELS="opencv")
        assert told.returncode == 2
        assert told.stderr == "error: MAPDEAL_KERNELS: must be compiled or scipy, got 'opencv'\n"
    assert not list(tmp_path.iterdir())


@needs_compiled
def test_both_engines_write_the_same_files(tmp_path):
    for name in ("compiled", "scipy"):
        told = process("run", EXAMPLE, "-o", tmp_path / name, MAPDEAL_KERNELS=name)
        assert told.returncode == 0, told.stderr
    files = [p for p in (tmp_path / "compiled").rglob("*") if p.is_file()]
    assert len(files) == 13
    for file in files:
        twin = tmp_path / "scipy" / file.relative_to(tmp_path / "compiled")
        assert file.read_bytes() == twin.read_bytes(), file.name


@pytest.mark.parametrize(
    ("which", "sent"),
    [*((which, "SIGINT") for which in (1, 5, 20, 60, 120)), (5, "SIGTERM"), (60, "SIGHUP")],
)
def test_a_signal_during_the_start_is_one_line(tmp_path, which, sent):
    code = f"""
import os, signal, sys
from mapdeal.cli.process import run_process
left = {which}

def interrupt(event, _):
    global left
    left -= event == "import"
    if event == "import" and left == 0:
        os.kill(os.getpid(), signal.{sent})

sys.addaudithook(interrupt)
sys.argv = ["mapdeal", "inflate", {str(EXAMPLE)!r}, "-o", {str(tmp_path / "o.yaml")!r}]
run_process()
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False
    )
    how = "interrupted" if sent == "SIGINT" else f"terminated by {sent}"
    assert (done.returncode, done.stderr) == (128 + signal.Signals[sent], f"error: {how}\n")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("problem", "code", "line"),
    [
        (MemoryError(), 3, "error: not enough memory for a map of this size"),
        (KeyboardInterrupt(), 130, "error: interrupted"),
        (KeyboardInterrupt("one map is done"), 130, "error: interrupted; one map is done"),
        (RuntimeError("a bug"), 70, "error: internal error"),
        (PermissionError(13, "Permission denied"), 70, "error: internal error"),
        *(
            (OSError(number, "x"), 4, "error: the system has no more to give: x")
            for number in (errno.EAGAIN, errno.ENOMEM, errno.ENFILE, errno.EMFILE)
        ),
    ],
)
def test_what_else_may_end_a_command_has_its_code(command, monkeypatch, problem, code, line):
    def fail(*_, **__):
        raise problem

    monkeypatch.setattr("mapdeal.commands.info._described", fail)
    ended, out, err = command("info", "m.yaml")
    assert (ended, out) == (code, "")
    assert [text for text in err.splitlines() if text.startswith("error: ")] == [line]
    assert ("Traceback" in err) == (code == 70)
