"""``mapdeal report`` and ``run --report``: what is written, what is said, and how they end."""

import json

import pytest

import mapdeal
from drawn import grid_from_text

ROOMS = """
    ??############
    ??#....#.....#
    ..#....#.....#
    ..#..........#
    ..############
"""


@pytest.fixture
def rooms(tmp_path):
    mapdeal.write_map(tmp_path / "rooms.yaml", grid_from_text(ROOMS))
    return tmp_path / "rooms.yaml"


@pytest.fixture
def run(rooms, tmp_path, command):
    assert command("run", rooms, "-o", tmp_path / "out", "--set", "inflate.radius=0.25")[0] == 0
    return tmp_path / "out" / "rooms"


def test_a_page_of_a_run_is_written_and_told_of(command, run, tmp_path):
    page = tmp_path / "new" / "page.html"
    code, out, err = command("report", run, "-o", page)
    assert (code, err) == (0, "")
    assert out.startswith(f"{page}: 1 map, ")
    assert page.read_bytes().startswith(b"<!doctype html>")


def test_the_same_inputs_give_the_same_bytes(command, run, tmp_path):
    pages = [tmp_path / "one.html", tmp_path / "two.html"]
    for page, threads in zip(pages, (1, 3), strict=True):
        assert command("report", run, "-o", page, "--threads", threads)[0] == 0
    assert pages[0].read_bytes() == pages[1].read_bytes()


def test_python_writes_the_bytes_of_the_command(command, run, tmp_path):
    assert command("report", run, "-o", tmp_path / "one.html", "--title", "Rooms")[0] == 0
    made = mapdeal.write_report(tmp_path / "two.html", run, title="Rooms")
    assert (tmp_path / "one.html").read_bytes() == made.path.read_bytes()
    assert (made.maps, made.size) == (1, made.path.stat().st_size)


def test_a_run_writes_its_page_with_the_map_as_read(command, rooms, tmp_path):
    out = tmp_path / "out"
    code, told, _ = command("run", rooms, "-o", out, "--report")
    assert code == 0
    assert told.splitlines()[-1].startswith(f"{out / 'report.html'}: 1 map, ")
    assert command("report", out / "rooms", rooms, "-o", tmp_path / "same.html")[0] == 0
    assert (out / "report.html").read_bytes() == (tmp_path / "same.html").read_bytes()
    first = (out / "report.html").read_bytes()
    assert command("run", rooms, "-o", out, "--report")[0] == 0  # unchanged, and written again
    assert (out / "report.html").read_bytes() == first


def test_a_batch_has_its_page_even_if_maps_fail(command, rooms, tmp_path):
    folder = rooms.parent / "maps"
    mapdeal.write_map(folder / "a" / "one.yaml", grid_from_text(ROOMS))
    (folder / "bad.yaml").write_text("image: none.pgm\nresolution: x\n")
    code, told, _ = command("run", folder, "-o", tmp_path / "out", "--report")
    assert code == 5
    assert f"{tmp_path / 'out' / 'report.html'}: 2 maps, " in told
    page = (tmp_path / "out" / "report.html").read_text()
    assert "a/one" in page
    assert "failed" in page


def test_a_run_does_not_replace_what_is_no_page_of_ours(command, rooms, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "report.html").write_text("<!doctype html><title>my own</title>")
    code, _, err = command("run", rooms, "-o", out, "--report")
    assert code == 4
    assert "exists, and is not a page written by mapdeal" in err
    assert [one.name for one in out.iterdir()] == ["report.html"]  # before anything was made


def test_a_dry_run_says_where_the_page_goes(command, rooms, tmp_path):
    code, out, _ = command("run", rooms, "-o", tmp_path / "out", "--report", "--dry-run")
    assert code == 0
    assert f"and {tmp_path / 'out' / 'report.html'}" in out
    assert not (tmp_path / "out").exists()


def test_bad_input_ends_with_one_line_and_its_code(command, run, rooms, tmp_path):
    (tmp_path / "empty").mkdir()
    (tmp_path / "page.html").write_text("mine")
    (tmp_path / "reach.json").write_text(json.dumps({"reachable_m2": 1, "passages": []}))
    (tmp_path / "cloud.pcd").write_text("VERSION .7\nFIELDS x y z\n")
    ok = tmp_path / "ok.html"
    for arguments, code, text in (
        ((tmp_path / "empty", "-o", ok), 4, "contains no run"),
        ((tmp_path / "none", "-o", ok), 4, "No such file or directory"),
        ((run, "-o", tmp_path / "page.html"), 4, "exists"),
        ((run, "-o", tmp_path / "page.pdf"), 2, "must end in .html"),
        ((run, "-o", ok, "--max-size", "10"), 2, "must be at least"),
        ((run, "-o", ok, "--max-size", "lots"), 2, "must be a size"),
        ((tmp_path / "cloud.pcd", "-o", ok), 3, "a point cloud"),
        ((rooms.with_suffix(".pgm"), "-o", ok), 3, "an image"),
        (("-o", ok), 2, "missing argument"),
    ):
        got, _, err = command("report", *arguments)
        assert got == code, (arguments, err)
        assert text in err
        assert len([line for line in err.splitlines() if line.startswith("error:")]) == 1
        assert not ok.exists()
    assert (tmp_path / "page.html").read_text() == "mine"


def test_a_page_is_never_written_over_an_input(command, run, tmp_path):
    code, _, err = command("report", run, "-o", run / "manifest.json", "--force")
    assert code == 2
    assert "must end in .html" in err


def test_a_document_needs_something_to_belong_to(command, run, rooms, tmp_path):
    command("reach", rooms, "--robot-radius", 0.1, "-o", tmp_path / "reach.json")
    code, _, err = command("report", tmp_path / "reach.json", "-o", tmp_path / "page.html")
    assert code == 2
    assert "reach.json" in err
    code, _, err = command("report", run, tmp_path / "reach.json", "-o", tmp_path / "page.html")
    assert code == 0
