"""``mapdeal report`` and ``run --report``: what is written, what is said, and how they end."""

from pathlib import Path

import pytest

import mapdeal
from bad_maps import tree
from drawn import grid_from_text

ROOMS = """
    ??############
    ??#....#.....#
    ..#....#.....#
    ..#..........#
    ..############
"""
RUN = "run rooms.yaml -o out --report"


@pytest.fixture(autouse=True)
def rooms(here):
    mapdeal.write_map("rooms.yaml", grid_from_text(ROOMS))


@pytest.fixture
def run(sh):
    assert sh("run rooms.yaml -o out --set inflate.radius=0.25")[0] == 0
    sh("reach rooms.yaml --robot-radius 0.1 -o reach.json")


def test_python_writes_the_bytes_of_the_command(sh, run):
    out = sh.ok("report out/rooms reach.json -o new/one.html --title Rooms --threads 3")
    assert out.startswith("new/one.html: 1 map, ")  # to which the document belongs
    made = mapdeal.write_report("two.html", ["out/rooms", "reach.json"], title="Rooms")
    page = Path("new/one.html").read_bytes()
    assert page.startswith(b"<!doctype html>")
    assert page == made.path.read_bytes()
    assert (made.maps, made.size) == (1, made.path.stat().st_size)


def test_a_run_writes_its_page_with_the_map_as_read(sh):
    assert sh(RUN)[1].splitlines()[-1].startswith("out/report.html: 1 map, ")
    sh("report out/rooms rooms.yaml -o same.html")
    first = Path("out/report.html").read_bytes()
    assert first == Path("same.html").read_bytes()
    assert sh(RUN)[0] == 0  # unchanged, and written again
    assert Path("out/report.html").read_bytes() == first


def test_a_batch_has_its_page_even_if_maps_fail(sh):
    mapdeal.write_map("maps/a/one.yaml", grid_from_text(ROOMS))
    Path("maps/bad.yaml").write_text("image: none.pgm\nresolution: x\n")
    code, told, _ = sh("run maps -o out --report -j 1")
    assert (code, "out/report.html: 2 maps, " in told) == (5, True)
    page = Path("out/report.html").read_text()
    assert "a/one" in page
    assert "failed" in page


def test_a_run_does_not_replace_what_is_no_page_of_ours(sh):
    Path("out").mkdir()
    Path("out/report.html").write_text("<!doctype html><title>my own</title>")
    assert "exists, and is not a page written by mapdeal" in sh.err(RUN, 4)
    assert [one.name for one in Path("out").iterdir()] == ["report.html"]  # nothing was made


def test_a_dry_run_says_where_the_page_goes(sh):
    assert "and out/report.html" in sh(f"{RUN} --dry-run")[1]
    assert not Path("out").exists()


@pytest.mark.parametrize(
    ("words", "code", "text"),
    [
        ("empty -o ok.html", 4, "contains no run"),
        ("none -o ok.html", 4, "No such file or directory"),
        ("out/rooms -o page.html", 4, "exists"),
        ("out/rooms -o out/rooms/manifest.json --force", 2, "must end in .html"),
        ("out/rooms -o ok.html --max-size 10", 2, "must be at least"),
        ("out/rooms -o ok.html --max-size lots", 2, "must be a size"),
        ("cloud.pcd -o ok.html", 3, "a point cloud"),
        ("rooms.pgm -o ok.html", 3, "an image"),
        ("reach.json -o ok.html", 2, "reach.json"),
        ("-o ok.html", 2, "missing argument"),
    ],
)
def test_bad_input_ends_with_one_line_and_its_code(sh, here, run, words, code, text):
    Path("empty").mkdir()
    Path("page.html").write_text("mine")
    Path("cloud.pcd").write_text("VERSION .7\nFIELDS x y z\n")
    before = tree(here)
    err = sh.err(f"report {words}", code)
    assert text in err
    assert len([line for line in err.splitlines() if line.startswith("error:")]) == 1
    assert tree(here) == before
