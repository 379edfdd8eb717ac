"""``-``: maps that come from standard input and go to standard output, as an npz."""

import os
import pty
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from drawn import grid_from_text
from mapdeal import OccupancyGrid, write_map
from mapdeal.cli import terminal

pytestmark = pytest.mark.slow

PROGRAM = f"{sys.executable} -m mapdeal"
ROOT = Path(__file__).parents[2]
TEXT = """
    ......#..
    .??...#..
    .??......
    .........
    ...####..
"""


@pytest.fixture(autouse=True)
def temporary(here, monkeypatch):
    folder = here / "temporary"
    folder.mkdir()
    monkeypatch.setenv("TMPDIR", str(folder))
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    for name in ("m.yaml", "m.npz"):
        write_map(name, grid_from_text(TEXT))
    yield
    assert list(folder.iterdir()) == []  # nothing is left behind, however a command ends


@pytest.fixture
def stdin(monkeypatch):
    """Return a function that makes some bytes the standard input, in pieces."""

    def give(data):
        chunks = [data[k : k + 1000] for k in range(0, len(data), 1000)]
        monkeypatch.setattr(terminal, "input_chunks", lambda: iter(chunks))
        monkeypatch.setattr(terminal, "refuse_keyboard", lambda: None)

    return give


@pytest.fixture
def sent(monkeypatch):
    """The pieces that commands have written to standard output as an npz."""
    pieces = []
    monkeypatch.setattr(terminal, "_write_bytes", pieces.append)
    return pieces


def test_the_pipes_of_the_docs_give_the_bytes_of_files(sh):
    Path("examples").symlink_to(ROOT / "examples")
    page = (ROOT / "docs" / "cli.md").read_text()
    (block,) = re.findall(r"^```bash\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    for k, line in enumerate(block.splitlines()):
        parts = line.replace("mapdeal ", f"{PROGRAM} ").split(" | ")
        pipe = " | ".join(f"{part} 2>error{k}{part_k}" for part_k, part in enumerate(parts))
        subprocess.run(["bash", "-c", f"set -o pipefail; {pipe}"], check=True, capture_output=True)
    # the summaries are not among the data, nor the names of temporary files
    summary, more = Path("error00").read_text().split("\n", 1)
    assert summary.startswith("standard output: 544 x 544 cells, ")
    assert (more, Path("error02").read_text()) == ("", "")
    sh.ok("inflate examples/maps/office.yaml --radius 0.3 -o one.npz")
    sh.ok("esdf one.npz -o two.npz")
    sh.ok("cost two.npz --inscribed-radius 0 -o three.npz")
    assert Path("cost.npz").read_bytes() == Path("three.npz").read_bytes()


@pytest.mark.usefixtures("mapdeal_warnings")
@pytest.mark.parametrize("line", [
    "active {} --margin 1", "potential {} --goal 2,-1.2", "cost {}", "inflate {}", "esdf {}",
    "convert {}", "convert {} --encoding costmap2d",
    "window {} --corner 1.5,-1.5 --size 0.5,0.6", "shift {} --origin 1.9,-1.6",
    "rotate {} --yaw 0.5", "rescale {} --resolution 0.1",
    "edit polygon {} --point 1.6,-1.5 --point 2.5,-1.5 --point 2.2,-0.8 --value 100",
    "edit line {} --point 1.6,-1.5 --point 2.5,-1 --value 50",
    "edit circle {} --point 2,-1.2 --radius 0.3 --value 0",
    "edit reset {} --corner 1.6,-1.5 --size 0.5,0.5", "unpack {}",
    "cost m.yaml --mask {}",
])  # fmt: skip
def test_every_command_with_an_npz_writes_it_to_a_pipe(sh, stdin, sent, line):
    name = "b.pbm" if line.startswith("unpack") else "m.npz"
    sh("pack m.yaml -o b.pbm")
    assert sh(f"{line.format(name)} -o o.npz")[0] == 0
    expected = Path("o.npz").read_bytes()
    assert "standard output: " in sh.err(f"{line.format(name)} -o -")
    assert b"".join(sent) == expected
    if name == "m.npz":
        stdin(Path("m.npz").read_bytes())
        sent.clear()
        assert sh(f"{line.format('-')} -o - -q") == (0, "", "")
        assert b"".join(sent) == expected


@pytest.mark.usefixtures("mapdeal_warnings")
@pytest.mark.parametrize("line", [
    "info {}", "info --json {}", "query {} --at 2,-1.2", "lint {}", "lint --format json {}",
    "route {} --from 1.7,-1.7 --to 2,-0.9", "diff {} m.yaml", "diff m.yaml {}",
    "info m.yaml {}",
])  # fmt: skip
def test_messages_about_a_pipe_are_those_about_the_file(sh, here, stdin, line):
    of_file = sh(line.format("m.npz"))
    stdin(Path("m.npz").read_bytes())
    code, out, err = sh(line.format("-"))
    assert (code, out.replace("standard input", "m.npz"), err) == of_file
    assert "standard input" in out or line.startswith(("query", "route"))
    assert str(here) not in out


@pytest.mark.parametrize(("data", "error"), [
    (b"", "is empty"),
    (b"image: m.pgm\nresolution: 1\n", "is a map, not an npz"),
    (b"P5\n3 2\n255\n123456", "is an image (PNM), not an npz"),
    (b"hello", "is not an npz"), (b"PK", "is not an npz"), ("cut.npz", "is not an npz file"),
    ("other.npz", "format: missing key"),
], ids=["empty", "yaml", "pgm", "text", "begin", "cut", "other"])  # fmt: skip
def test_what_is_no_npz_is_one_line(sh, stdin, data, error):
    np.savez("other.npz", a=1, b=2)
    Path("cut.npz").write_bytes(Path("m.npz").read_bytes()[:-30])
    stdin(data if isinstance(data, bytes) else Path(data).read_bytes())
    code, out, err = sh("esdf - -o o.npz")
    assert (code, out) == (3, "")
    assert err.splitlines()[0] == f"error: standard input: {error}"
    assert not Path("o.npz").exists()


def test_what_has_no_end_is_refused(sh, stdin, monkeypatch):
    def endless(first):
        yield first
        while True:
            yield bytes(1 << 20)

    stdin(b"")
    for first, rule in ((b"", "is not an npz"), (b"PK\3\4", "needs")):
        monkeypatch.setattr(terminal, "input_chunks", lambda first=first: endless(first))
        err = sh.err("info - --max-memory 70M", 3)
        assert f"standard input: {rule}" in err
    assert "73.5 MB may be used" in err  # 70 x 1024 x 1024


def test_a_file_of_that_name_is_named_with_its_folder(sh):
    Path("m.yaml").rename("-")
    assert sh("info ./-")[0] == 0
    Path("-").write_text("2,-1.2\n")
    assert sh("query m.npz --points ./-")[0] == 0


def test_sarif_names_standard_input_and_a_failure_sends_nothing(sh, stdin, sent):
    stdin(Path("m.npz").read_bytes())
    places = re.findall(r'"uri": "([^"]*)"', sh("lint - --format sarif")[1])
    assert "standard%20input" in places
    assert not [place for place in places if "mapdeal-" in place]
    assert sh("inflate none.yaml -o -")[0] == 4
    stdin(Path("m.npz").read_bytes())
    assert sh("cost - -o - --inflation-radius -1")[0] == 2
    assert sent == []


def program(words, **streams):
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **streams}
    return subprocess.Popen([*PROGRAM.split(), *words.split()], **streams)


def test_a_reader_that_has_gone_ends_the_command_in_peace():
    grid = np.random.default_rng(1).integers(0, 2, (900, 900)) * 100  # more than a pipe holds
    write_map("large.npz", OccupancyGrid(grid.astype(np.int8), 0.5, (1, 2, 0.1)))
    with program("convert large.npz -o -") as process:
        assert process.stdout.read(4) == b"PK\3\4"
        process.stdout.close()
        assert process.wait() == 0
        assert process.stderr.read().startswith(b"standard output: 900 x 900 cells")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs Linux")
def test_a_full_disk_is_one_line():
    with open("/dev/full", "wb") as full, program("convert m.yaml -o -", stdout=full) as process:
        assert b"error: standard output: cannot be written" in process.stderr.read()
    assert process.returncode == 4


def test_terminals_are_refused():
    main, terminal = pty.openpty()
    try:
        for words, end, stream in (("convert m.yaml", "-o -", "stdout"), ("info", "-", "stdin")):
            with program(f"{words} {end}", **{stream: terminal}) as process:
                line = process.stderr.read().decode().splitlines()[0]
            assert line == f"error: {end}: is a terminal, and an npz is not text"
            assert process.returncode == 2
    finally:
        os.close(main)
        os.close(terminal)
