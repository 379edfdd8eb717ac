"""Commands under limits of their address space: the full result or one line, never a hang."""

import re
import resource
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux", reason="elsewhere such limits do not hold"),
]

MAPS = Path(__file__).parents[2] / "examples" / "maps"
A, B = MAPS / "office.yaml", MAPS / "office_cartographer.yaml"
COMMANDS = [
    "--help", f"run {A} -o o", f"run {A} {B} -o o --jobs 2", f"inflate {A} -o o.yaml",
    f"potential {A} --goal 1,1 -o o.npz", f"align {A} {B}", f"diff {A} {B}", f"score {A}",
    f"clean {A} --min-obstacle 3 -o o.yaml", f"convert {A} -o o.mcap",
]  # fmt: skip
FEW = {f"score {A}": (110_000, 250_000), COMMANDS[3]: (80_000,)}
"""Limits, kB, at which the system lacks room for one of the libraries, or for its buffer."""


def run(words, folder, limit=None):
    def restrict():
        if limit is not None:
            resource.setrlimit(resource.RLIMIT_AS, (limit << 10, limit << 10))

    folder.mkdir()
    completed = subprocess.run(
        [sys.executable, "-m", "mapdeal", *words.split()], cwd=folder, preexec_fn=restrict,
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    written = sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())
    return completed, written


def run_as_main(function):
    code = f"import mapdeal.cli.main, mapdeal.cli.process\n{function}\nmapdeal.cli.main.main = main"
    code += "\nmapdeal.cli.process.run_process()"
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)


def check(words, folder, limits):
    usual, files = run(words, folder / "usual")
    assert usual.returncode in (0, 1)
    for limit in limits:
        completed, written = run(words, folder / str(limit), limit)
        if completed.returncode in (3, 4):
            stderr_lines = completed.stderr.splitlines()
            lines = [line for line in stderr_lines if not line.startswith("warning: ")]
            assert lines[0].startswith("error: ")
            assert all(line.startswith("hint: ") for line in lines[1:]), completed.stderr
            assert not written
        elif "--jobs" not in words or completed.returncode != 5:  # some maps failed
            found = completed.returncode, written, completed.stderr
            assert found == (usual.returncode, files, usual.stderr), limit
        assert "Traceback" not in completed.stderr


@pytest.mark.parametrize("words", FEW, ids=lambda words: words.split()[0])
def test_a_library_without_room_ends_with_one_line(tmp_path, words):
    check(words, tmp_path, FEW[words])


NULL_WITHOUT_ERROR = "SystemError('error return without exception set')"


@pytest.mark.parametrize("raised", ["MemoryError()", NULL_WITHOUT_ERROR])
def test_a_command_that_runs_out_of_memory_ends_with_one_line(raised):
    completed = run_as_main(f"def main():\n    raise {raised}")
    message = "error: not enough memory for a map of this size\n"
    assert (completed.returncode, completed.stderr) == (3, message)


@pytest.mark.parametrize("raised", ["MemoryError", "KeyError"])
def test_threads_that_lack_memory_alone_end_without_a_message(raised):
    completed = run_as_main(f"""
import _thread, time
def main():
    def fail():
        raise {raised}
    _thread.start_new_thread(fail, ())
    time.sleep(0.2)
    return 0""")
    assert completed.returncode == 0
    assert (raised in completed.stderr) == (raised != "MemoryError")


@pytest.mark.thorough
@pytest.mark.parametrize("words", COMMANDS)
def test_no_limit_of_memory_makes_a_command_hang_or_lie(tmp_path, words):
    check(words, tmp_path, range(60_000, 350_000, 10_000))


def test_matrices_are_not_left_to_openblas():
    """For matrices of floats it maps 32 MB in each thread, and tries for ever if it gets none.

    These modules multiply vectors or integers.
    """
    functions = r"\bnp\.(?:dot|matmul|tensordot|inner|linalg\.(?!norm\b)\w+)\("
    product = re.compile(rf"[\w)\]] @ [\w(\[]|{functions}")
    sources = (MAPS.parents[1] / "src").rglob("*.py")
    found = {path.stem for path in sources if product.search(path.read_text("utf-8"))}
    assert found == {"routes", "rotations", "components", "bit_map", "tours"}
