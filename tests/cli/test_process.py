"""The command line as a process: its start, its end, and its last lines."""

import errno
import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from bad_maps import tree
from drawn import grid_from_text
from engines import needs_compiled
from mapdeal import write_map
from mapdeal.cli.process import _report_unless_a_thread_lacks_memory
from mapdeal.kernels import engine
from mapdeal.version import __version__

pytestmark = pytest.mark.slow

EXAMPLES = Path(__file__).parents[2] / "examples"
METHODS = ("log-odds", "counting", "tsdf")
BUILT = "scipy" if engine.compiled_module() is None else "compiled"
SENT = [("1", "SIGINT"), ("120", "SIGINT"), ("5", "SIGTERM"), ("60", "SIGHUP")]


@pytest.fixture(autouse=True)
def maps(here):
    for name in ("a", "b"):
        write_map(f"{name}.yaml", grid_from_text("#....\n..?..\n.....", 0.25))


def process(*words, code=None, **environment):
    start = ["-c", code] if code else ["-m", "mapdeal"]
    return subprocess.run(
        [sys.executable, *start, *words],
        capture_output=True, text=True, timeout=120, env={**os.environ, **environment},
    )  # fmt: skip


def shell(line):
    return subprocess.run(
        ["bash", "-c", f"set -o pipefail; {line}"],
        capture_output=True, text=True,
        env={**os.environ, "mapdeal": f"{sys.executable} -m mapdeal", "PYTHONUNBUFFERED": "1"},
    )  # fmt: skip


def test_a_process_ends_with_all_of_its_output():
    completed = process("info", *["a.yaml"] * 40, "--json")
    assert (completed.returncode, completed.stderr) == (0, "")
    assert len(completed.stdout.splitlines()) == 40


def thoroughly(*arguments):
    return pytest.param(*arguments, marks=pytest.mark.thorough)


REDIRECTIONS = [">&- 2>&-", "2>&1 | true", thoroughly(">&-"), thoroughly("2> >(true)")]


@pytest.mark.parametrize("redirection", REDIRECTIONS)
def test_closed_streams_and_readers_that_go_away_do_not_change_what_is_done(redirection):
    completed = shell(f"$mapdeal run -v a.yaml b.yaml -o out --no-images -j 1 {redirection}")
    assert completed.returncode == 0, completed.stderr
    summary = json.loads(Path("out/summary.json").read_text())
    assert [entry["status"] for entry in summary["maps"]] == ["done", "done"]


@pytest.mark.parametrize("redirection", ["2>/dev/full", thoroughly("2>&-")])
def test_an_error_keeps_its_exit_code_without_stderr(redirection):
    completed = shell(f"$mapdeal inflate nope.yaml -o o.yaml {redirection}")
    assert (completed.returncode, completed.stdout) == (4, "")


@pytest.mark.parametrize("words", ["--version", "run a.yaml -o out --no-images"])
def test_a_full_disk_behind_stdout_is_one_line(words):
    completed = shell(f"$mapdeal {words} > /dev/full")
    line = "error: standard output: cannot be written: No space left on device\n"
    assert (completed.returncode, completed.stderr) == (4, line)


@pytest.mark.parametrize("words", ["--help", "info a.yaml"])
def test_a_reader_that_has_seen_enough_is_no_error(words):
    completed = shell(f"$mapdeal {words} | true")
    assert (completed.returncode, completed.stderr) == (0, "")


@pytest.mark.parametrize(("requested", "found"), [("", BUILT), ("scipy", "scipy")])
def test_the_version_says_which_kernels_are_in_use(requested, found):
    line = f"mapdeal {__version__} (kernels: {found})\n"
    assert process("--version", MAPDEAL_KERNELS=requested).stdout == line


def test_an_unknown_engine_is_an_error_on_one_line():
    for words in (["--version"], ["inflate", "a.yaml", "-o", "o.yaml"]):
        completed = process(*words, MAPDEAL_KERNELS="opencv")
        line = "error: MAPDEAL_KERNELS: must be compiled or scipy, got 'opencv'\n"
        assert (completed.returncode, completed.stderr) == (2, line)
    assert not Path("o.yaml").exists()


OFFICE = EXAMPLES / "maps" / "office.yaml"
AROUND = f"--map {OFFICE} --unknown free --pose 1,2,0.3"  # with beams, engines do the same
BUILD = f"build {EXAMPLES}/logs/office.log -o"
LARGER = [
    *(f"{BUILD} OUT/m.yaml --layers OUT/l.npz --method {name}" for name in METHODS),
    f"{BUILD} OUT --compare",
    f"local {AROUND} --cloud c.csv --frame map --offset 0.5,-2 -o OUT",
]
WRITERS = [f"run {OFFICE} -o OUT", *map(thoroughly, LARGER)]


@needs_compiled
@pytest.mark.parametrize("line", WRITERS)
def test_bytes_do_not_depend_on_engine_or_threads(here, sh, monkeypatch, line):
    Path("c.csv").write_text("0.62,0.04\n-0.41,0.33\n1.2,0.7\n")
    written = []
    for kernels, threads in (("scipy", "1"), ("compiled", "2"), ("compiled", "1")):
        monkeypatch.setenv(engine.VARIABLE, kernels)
        code, _, err = sh(f"{line.replace('OUT', kernels + threads)} --threads {threads}")
        assert code == 0, err
        written.append(tree(here / f"{kernels}{threads}"))
    assert written[0] == written[1] == written[2] != {}


SIGNALLED = """
import os, signal, sys
from mapdeal.cli.process import run_process
left = int(sys.argv.pop(1))
sent = getattr(signal, sys.argv.pop(1))

def interrupt(event, _):
    global left
    left -= event == "import"
    if event == "import" and left == 0:
        os.kill(os.getpid(), sent)

sys.addaudithook(interrupt)
run_process()
"""


@pytest.mark.parametrize(("which", "sent"), SENT)
def test_a_signal_during_the_start_is_one_line(which, sent):
    completed = process(which, sent, "inflate", "a.yaml", "-o", "o.yaml", code=SIGNALLED)
    ending = "interrupted" if sent == "SIGINT" else f"terminated by {sent}"
    code = 128 + signal.Signals[sent]
    assert (completed.returncode, completed.stderr) == (code, f"error: {ending}\n")
    assert not Path("o.yaml").exists()


@pytest.mark.parametrize(("problem", "code", "line"), [
    *((problem, 3, "error: not enough memory for a map of this size") for problem in (
        MemoryError(), SystemError("error return without exception set"),
        SystemError("initialization of _x raised unreported exception"),
        SystemError("<function f> returned NULL without setting an exception"),
    )),
    (SystemError("bad argument to internal function"), 70, "error: internal error"),
    (KeyboardInterrupt(), 130, "error: interrupted"),
    (KeyboardInterrupt("one map is done"), 130, "error: interrupted; one map is done"),
    (RuntimeError("a bug"), 70, "error: internal error"),
    (PermissionError(13, "Permission denied"), 70, "error: internal error"),
    *((OSError(number, "x"), 4, "error: a system resource is exhausted: x")
      for number in (errno.EAGAIN, errno.ENOMEM, errno.ENFILE, errno.EMFILE)),
])  # fmt: skip
def test_what_else_may_end_a_command_has_its_code(command, monkeypatch, problem, code, line):
    def fail(*_, **__):
        raise problem

    monkeypatch.setattr("mapdeal.commands.info._described", fail)
    ended, out, err = command("info", "a.yaml")
    assert (ended, out) == (code, "")
    assert [text for text in err.splitlines() if text.startswith("error: ")] == [line]
    assert ("Traceback" in err) == (code == 70)


def test_garbage_is_looked_for_once_a_command_works_but_not_among_imports():
    code = "import gc; gc.disable(); from mapdeal.cli.signals import begin_work; begin_work()"
    completed = process(code=f"{code}; print(gc.isenabled(), gc.get_freeze_count() > 0)")
    assert completed.stdout == "True True\n"


def test_errors_that_nobody_catches_are_reported_unless_a_thread_lacks_memory(monkeypatch):
    reported, kinds = [], [(MemoryError, "in thread"), (MemoryError, "in del"), (OSError, "thread")]
    monkeypatch.setattr(sys, "__unraisablehook__", reported.append)
    for kind, text in kinds:
        _report_unless_a_thread_lacks_memory(SimpleNamespace(exc_type=kind, err_msg=text))
    assert [(error.exc_type, error.err_msg) for error in reported] == kinds[1:]
