"""``-``: maps that come from standard input and go to standard output, as an npz."""

import os
import pty
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from drawn import grid_from_text
from mapdeal import read_map, write_map
from mapdeal.cli import terminal

pytestmark = pytest.mark.slow

PROGRAM = f"{sys.executable} -m mapdeal"
CONVERT = f"{PROGRAM} convert m.yaml -o -".split()
TEXT = """
    ......#..
    .??...#..
    .??......
    .........
    ...####..
"""


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setenv("TMPDIR", str(temporary))
    monkeypatch.setattr("tempfile.tempdir", str(temporary))
    write_map("m.yaml", grid_from_text(TEXT))
    write_map("m.npz", grid_from_text(TEXT))
    yield tmp_path
    assert list(temporary.iterdir()) == []  # nothing is left behind, however a command ends


def pipe(text, data=b""):
    """Have a shell run commands, each reading what the one before it writes."""
    if shutil.which("bash") is None:
        pytest.skip("needs bash")
    parts = [f"{PROGRAM} {part} 2>error{k}" for k, part in enumerate(text.split(" | "))]
    script = f"{' | '.join(parts)}; echo ${{PIPESTATUS[*]}} >codes"
    out = subprocess.run(
        ["bash", "-c", script], input=data, stdout=subprocess.PIPE, check=True
    ).stdout  # fmt: skip
    errors = [Path(f"error{k}").read_text() for k in range(len(parts))]
    return [int(code) for code in Path("codes").read_text().split()], out, errors


def stdin(monkeypatch, data):
    """Have a command that is run in this process get some bytes, some at a time."""
    chunks = [data[k : k + 1000] for k in range(0, len(data), 1000)]
    monkeypatch.setattr(terminal, "input_chunks", lambda: iter(chunks))
    monkeypatch.setattr(terminal, "refuse_keyboard", lambda: None)


def test_a_chain_of_pipes_gives_the_bytes_of_the_chain_of_files(command, here):
    steps = ["inflate {} --radius 0.9", "esdf {}", "cost {} --inflation-radius 2"]
    names = ["m.yaml", "one.npz", "two.npz", "three.npz"]
    for k, step in enumerate(steps):
        assert command(*step.format(names[k]).split(), "-o", names[k + 1])[0] == 0
    chain = " | ".join(
        f"{step.format('-' if k else 'm.yaml')} -o -" for k, step in enumerate(steps)
    )
    codes, out, errors = pipe(chain)
    assert codes == [0, 0, 0]
    assert out == (here / "three.npz").read_bytes()
    for error in errors:  # the summaries are not among the data, nor the names of temporary files
        assert error.startswith("standard output: 9 x 5 cells, ")
        assert len(error.splitlines()) == 1


@pytest.mark.parametrize(
    "words",
    [
        "active {} --margin 1", "potential {} --goal 2,-1.2", "cost {}",
        "convert {}", "convert {} --encoding costmap2d",
        "window {} --corner 1.5,-1.5 --size 0.5,0.6", "shift {} --origin 1.9,-1.6",
        "rotate {} --yaw 0.5", "rescale {} --resolution 0.1",
        "edit polygon {} --point 1.6,-1.5 --point 2.5,-1.5 --point 2.2,-0.8 --value 100",
        "edit line {} --point 1.6,-1.5 --point 2.5,-1 --value 50",
        "edit circle {} --point 2,-1.2 --radius 0.3 --value 0",
        "edit reset {} --corner 1.6,-1.5 --size 0.5,0.5", "unpack {}",
    ],
)  # fmt: skip
def test_every_command_with_an_npz_writes_it_to_a_pipe(
    command, here, monkeypatch, words, mapdeal_warnings
):
    sent = []
    monkeypatch.setattr(terminal, "_write_bytes", sent.append)
    name = "m.npz"
    if words.startswith("unpack"):
        assert command("pack", "m.yaml", "-o", "b.pbm", "-q")[0] == 0
        name = "b.pbm"
    assert command(*words.format(name).split(), "-o", "o.npz")[0] == 0
    expected = (here / "o.npz").read_bytes()
    code, out, err = command(*words.format(name).split(), "-o", "-")
    assert (code, out, b"".join(sent)) == (0, "", expected)
    assert "standard output: " in err
    if name == "m.npz":
        stdin(monkeypatch, (here / "m.npz").read_bytes())
        sent.clear()
        assert command(*words.format("-").split(), "-o", "-", "-q") == (0, "", "")
        assert b"".join(sent) == expected


@pytest.mark.parametrize(
    "words",
    [
        "info {}", "info --json {}", "query {} --at 2,-1.2", "lint {}", "lint --format json {}",
        "route {} --from 1.7,-1.7 --to 2,-0.9", "diff {} m.yaml", "diff m.yaml {}",
        "info m.yaml {}",
    ],
)  # fmt: skip
def test_what_is_told_of_a_pipe_is_what_is_told_of_the_file(
    command, here, monkeypatch, words, mapdeal_warnings
):
    of_file = command(*words.format("m.npz").split())
    stdin(monkeypatch, (here / "m.npz").read_bytes())
    code, out, err = command(*words.format("-").split())
    assert (code, out.replace("standard input", "m.npz"), err) == of_file
    assert "standard input" in out or words.startswith(("query", "route"))
    assert str(here) not in out


def test_masks_and_canvases_come_by_a_pipe_too(command, here, monkeypatch):
    data = (here / "m.npz").read_bytes()
    for words in ("cost m.yaml --mask {}", "window m.yaml --like {}"):
        assert command(*words.format("m.npz").split(), "-o", "file.npz")[0] == 0
        stdin(monkeypatch, data)
        assert command(*words.format("-").split(), "-o", "pipe.npz")[0] == 0
        assert (here / "file.npz").read_bytes() == (here / "pipe.npz").read_bytes()
        (here / "file.npz").unlink()
        (here / "pipe.npz").unlink()


WRONG = {
    "empty": (b"", "error: standard input: is empty"),
    "yaml": (b"image: m.pgm\nresolution: 1\n", "error: standard input: is a map, not an npz"),
    "pgm": (b"P5\n3 2\n255\n123456", "error: standard input: is an image (PNM), not an npz"),
    "text": (b"hello", "error: standard input: is not an npz"),
    "begin": (b"PK", "error: standard input: is not an npz"),
    "cut": (None, "error: standard input: is not an npz file"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_no_npz_is_one_line(command, here, monkeypatch, name):
    data, error = WRONG[name]
    stdin(monkeypatch, (here / "m.npz").read_bytes()[:-30] if data is None else data)
    code, out, err = command("esdf", "-", "-o", "o.npz")
    assert (code, out) == (3, "")
    assert err.splitlines()[0] == error
    assert not (here / "o.npz").exists()


def test_another_npz_is_one_line(command, here, monkeypatch):
    np.savez("other.npz", a=1, b=2)
    stdin(monkeypatch, (here / "other.npz").read_bytes())
    code, _, err = command("info", "-")
    assert (code, err.splitlines()[0]) == (3, "error: standard input: format: missing key")


def test_what_has_no_end_is_refused(command, here, monkeypatch):
    def endless(first):
        yield first
        while True:
            yield bytes(1 << 20)

    monkeypatch.setattr(terminal, "refuse_keyboard", lambda: None)
    monkeypatch.setattr(terminal, "input_chunks", lambda: endless(b""))
    code, _, err = command("info", "-")
    assert (code, err.splitlines()[0]) == (3, "error: standard input: is not an npz")
    monkeypatch.setattr(terminal, "input_chunks", lambda: endless(b"PK\3\4"))
    code, _, err = command("info", "-", "--max-memory", "70M")
    assert code == 3
    assert "standard input: needs" in err
    assert "73.5 MB may be used" in err  # 70 x 1024 x 1024


def test_standard_input_is_one_file(command, here, monkeypatch):
    stdin(monkeypatch, (here / "m.npz").read_bytes())
    for words in ("diff - -", "info - -", "query - --points -", "route - --pairs -",
                  "cost - --mask - -o o.npz"):  # fmt: skip
        code, _, err = command(*words.split())
        assert (code, err.splitlines()[0]) == (
            2, "error: -: can be used for one input only: standard input is one file"
        )  # fmt: skip
    code, _, err = command("run", "-", "-o", "out")
    assert (code, err.splitlines()[0]) == (
        2, "error: -: standard input has no name for a folder of outputs"
    )  # fmt: skip


def test_a_file_of_that_name_is_named_with_its_folder(command, here):
    assert command("pack", "m.yaml", "-o", "-")[0] == 2  # two files
    write_map("m2.yaml", grid_from_text(TEXT))
    (here / "m2.yaml").rename(here / "-")
    assert command("info", "./-")[0] == 0
    (here / "p.csv").write_text("2,-1.2\n")
    (here / "p.csv").rename(here / "-")
    assert command("query", "m.npz", "--points", "./-")[0] == 0


def test_a_reader_that_has_gone_ends_the_command_in_peace(here):
    grid = np.random.default_rng(1).integers(0, 2, (900, 900)) * 100  # more than a pipe holds
    from mapdeal import OccupancyGrid

    write_map("large.npz", OccupancyGrid(grid.astype(np.int8), 0.5, (1, 2, 0.1)))
    process = subprocess.Popen(
        f"{PROGRAM} convert large.npz -o -".split(), stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert process.stdout.read(4) == b"PK\3\4"
    process.stdout.close()
    assert process.wait() == 0
    assert process.stderr.read().decode().startswith("standard output: 900 x 900 cells")
    process.stderr.close()


def test_a_failure_sends_nothing(here):
    codes, out, errors = pipe("inflate none.yaml -o - | esdf - -o -")
    assert codes == [4, 3]
    assert out == b""
    assert errors[1].startswith("error: standard input: is empty")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs Linux")  # noqa: PTH110
def test_a_full_disk_is_told(here):
    with open("/dev/full", "wb") as full:
        done = subprocess.run(
            f"{PROGRAM} convert m.yaml -o -".split(),
            stdout=full,
            stderr=subprocess.PIPE,
            check=False,
        )
    assert done.returncode == 4
    assert b"error: standard output: cannot be written" in done.stderr


def test_terminals_are_refused(here):
    main, other = pty.openpty()
    try:
        done = subprocess.run(
            f"{PROGRAM} convert m.yaml -o -".split(),
            stdout=other,
            stderr=subprocess.PIPE,
            check=False,
        )
        assert (done.returncode, done.stderr.decode().splitlines()[0]) == (
            2, "error: -o -: is a terminal, and an npz is not text"
        )  # fmt: skip
        done = subprocess.run(
            f"{PROGRAM} info -".split(), stdin=other, capture_output=True, check=False
        )
        assert (done.returncode, done.stderr.decode().splitlines()[0]) == (
            2, "error: -: is a terminal, and an npz is not text"
        )  # fmt: skip
    finally:
        os.close(main)
        os.close(other)


def test_the_pipes_of_the_docs_run(here):
    root = Path(__file__).parents[2]
    (here / "examples").symlink_to(root / "examples")
    page = (root / "docs" / "cli.md").read_text()
    (block,) = re.findall(r"^```bash\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    for line in block.splitlines():
        codes, _, _ = pipe(" | ".join(part.removeprefix("mapdeal ") for part in line.split(" | ")))
        assert set(codes) == {0}
    assert read_map(here / "cost.npz").shape == (544, 544)


def test_what_lint_writes_for_machines_names_standard_input(command, here, monkeypatch):
    stdin(monkeypatch, (here / "m.npz").read_bytes())
    out = command("lint", "-", "--format", "sarif")[1]
    places = re.findall(r'"uri": "([^"]*)"', out)
    assert "standard%20input" in places
    assert not [place for place in places if "mapdeal-" in place]


def test_standard_input_is_not_changed_in_place(command, here, monkeypatch):
    stdin(monkeypatch, (here / "m.npz").read_bytes())
    code, out, err = command("lint", "-", "--fix", "--in-place")
    assert (code, out) == (2, "")
    assert err.startswith("error: -: is standard input, which cannot be repaired in place")
