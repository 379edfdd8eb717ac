import re

import numpy as np
import pytest

import mapdeal
from drawn import grid_from_text
from mapdeal import BitMap, MalformedInputError, read_bit_map, read_map, write_bit_map

DRAWING = "#........#\n.#..?....#\n#.#......."
IS_OCCUPIED = grid_from_text(DRAWING).occupancy == 100


@pytest.fixture
def pair(tmp_path):
    write_bit_map(tmp_path / "b.pbm", BitMap.from_occupancy(grid_from_text(DRAWING)))
    return tmp_path / "b.pbm"


def test_a_p4_file_is_north_first_eight_cells_a_byte_in_padded_rows_and_may_be_negated(pair):
    head = b"P4\n10 3\n"
    assert pair.read_bytes() == head + bytes([0x80, 0x40, 0x40, 0x40, 0xA0, 0x00])
    plain = b"P1\n# drawn by hand\n10 3\n1000000001\n0100000001\n1010000000\n"
    set_behind = head + bytes([0x80, 0x7F, 0x40, 0x7F, 0xA0, 0x3F])
    for data in (plain, set_behind):
        pair.write_bytes(data)
        assert np.array_equal(read_bit_map(pair).to_mask(), IS_OCCUPIED)
        assert read_bit_map(pair).count() == 6
    _rewrite(pair, "negate: 0", "negate: 1")
    found = read_bit_map(pair)
    assert np.array_equal(found.to_mask(), ~IS_OCCUPIED)
    assert np.array_equal(found.to_occupancy().occupancy, read_map(pair).occupancy)


def test_the_obstacles_of_every_real_map_survive(real_sources, tmp_path):
    for path, source in real_sources:
        write_bit_map(tmp_path / "m.pbm", BitMap.from_occupancy(source.grid), force=True)
        found = read_bit_map(tmp_path / "m.pbm")
        assert np.array_equal(found.to_mask(), source.grid.occupied()), path
        assert found.frame == source.grid.frame


def _rewrite(path, old, new):
    about = path.with_suffix(".yaml")
    about.write_text(about.read_text().replace(old, new))


@pytest.mark.parametrize("words", [
    "info --json", "lint", "diff b.yaml", "route --from=1.9,-1.5 --to=2.4,-1.3", "inflate -o o.npz",
    "edit circle --point=1.7,-1.7 --radius=0.3 --value=50 -o o.npz", "pack -o o.pbm",
    "cost b.yaml -o o.npz --mask",
])  # fmt: skip
def test_commands_take_bits_as_they_take_their_yaml(pair, command, monkeypatch, words):
    monkeypatch.chdir(pair.parent)
    found = []
    for source in ("b.pbm", "b.yaml"):
        code, out, err = command(*words.split(), source)
        assert code in (0, 2), err
        written = [path.read_bytes() for path in pair.parent.glob("o.*")]
        output = re.sub(r"b\.(pbm|yaml)", "?", out + err)  # lint has lines of the YAML
        found.append((code, output, written))
        for path in pair.parent.glob("o.*"):
            path.unlink()
    assert found[0] == found[1]
    assert bool(found[0][2]) == (" -o " in words)


BROKEN = [
    (lambda p: p.with_suffix(".yaml").unlink(), 4, "has no b.yaml beside it"),
    (lambda p: p.unlink(), 4, "b.pbm"),
    (lambda p: _rewrite(p, "b.pbm", "c.pbm"), 3, "image: names another image than b.pbm"),
    (lambda p: p.write_bytes(p.read_bytes()[:-1]), 3, "pixels end early"),
    (lambda p: _rewrite(p, "0.25", "x"), 3, "resolution"),
    (lambda p: p.write_bytes(b"P4\n99999999 99999999\n"), 3, "limit"),
]


@pytest.mark.parametrize(("change", "code", "message"), BROKEN, ids=[row[2] for row in BROKEN])
def test_an_unreadable_bit_map_is_one_line(pair, command, tmp_path, change, code, message):
    (pair.parent / "c.pbm").write_bytes(pair.read_bytes())
    change(pair)
    with pytest.raises(mapdeal.FileAccessError if code == 4 else MalformedInputError):
        read_bit_map(pair)
    output = tmp_path / "o.pbm"
    circle = ["edit", "circle", "--point=1.7,-1.7", "--radius=0", "--value=100", "-o", output]
    for words in (["run", "-o", tmp_path / "o"], circle, ["info"]):
        found, _, err = command(*words, pair)
        assert (found, message in err.splitlines()[0]) == (code, True), err
        assert not list(tmp_path.glob("o*"))
    found, out, _ = command("lint", pair)
    assert (found, message in out) == (1, True)


@pytest.mark.parametrize(("change", "message"), [
    (lambda p: p.write_bytes(b"P5\n1 1\n255\n\0"), "P5"),
    (lambda p: _rewrite(p, "trinary", "raw"), "trinary"),
    (lambda p: _rewrite(p, "mode:", "cost_scale: costmap2d\nmode:"), "cannot hold costs"),
])  # fmt: skip
def test_malformed_pictures_of_bits_are_refused(pair, change, message):
    change(pair)
    with pytest.raises(MalformedInputError, match=message):
        read_bit_map(pair)


CHANGES = {
    "line": "line --point=1.6,-1.9 --point=3.2,-1.0",
    "polygon": "polygon --point=1.6,-1.9 --point=3.2,-1.4 --point=2.0,-1.2",
    "point": "circle --point=2.2,-1.4 --radius=0",
    "reset": "reset --corner=1.6,-1.9 --size=1.5,0.5",
    "all": "reset --corner=1.5,-2.0 --size=99,99",
    "blank": "circle --point=2.2,-1.4 --radius=0.4 --blank",
    "filled": "circle --point=2.2,-1.4 --radius=0.4 --blank --background=100",
    "max": "line --point=1.6,-1.9 --point=3.2,-1.0 --overlay=max",
    "min": "line --point=1.6,-1.9 --point=3.2,-1.0 --overlay=min",
}


@pytest.mark.parametrize("value", [0, 100])
@pytest.mark.parametrize("words", CHANGES.values(), ids=CHANGES)
def test_an_edit_of_bits_is_the_edit_of_the_map_packed(pair, command, tmp_path, words, value):
    """The map is edited in whole bytes, and its obstacles taken with numpy."""
    values = [f"--value={value}"]
    command("edit", *words.split(), pair, "-o", tmp_path / "whole.npz", *values)
    expected = read_map(tmp_path / "whole.npz").occupancy == 100
    edited = tmp_path / "new" / "e.pbm"
    code, out, _ = command("edit", *words.split(), pair, "-o", edited, *values)
    assert code == 0
    found = read_bit_map(edited)
    assert np.array_equal(found.to_mask(), expected)
    assert found.frame == read_bit_map(pair).frame
    share = 100 * expected.sum() / expected.size
    assert f"e.pbm: 10 x 3 cells, occupied {share:.2f} %" in out


def test_edits_of_bits_keep_to_what_bits_hold(pair, command, tmp_path):
    circle = ["edit", "circle", "--point=2.2,-1.4", "--radius=0.3"]
    full, grid = [*circle, "--value=100"], pair.with_name("g.yaml")
    command("convert", pair, "-o", grid)
    for words, source, code, message in (
        ([*circle, "--value=50"], pair, 2, "must be 0 or 100"),
        ([*full, "--blank", "--background=7"], pair, 2, "background: must be 0 or 100"),
        ([*full, "--strict", "--point=99,0"], pair, 1, "the shape is clipped"),
        (["edit", "reset", "--corner=1.6,-1.9", "--size=1,1"], pair, 2, "value: is needed"),
        (full, grid, 2, "e.pbm"),
    ):
        found, _, err = command(*words, source, "-o", tmp_path / "e.pbm")
        assert (found, message in err.splitlines()[0]) == (code, True), err
        assert not (tmp_path / "e.pbm").exists()
    assert "mapdeal pack" in err
    code, _, err = command(*full, pair, "-o", pair, "--force")
    assert (code, "the output is the input" in err) == (4, True)


def test_what_a_yaml_says_beside_survives_an_edit_of_bits(pair, command, tmp_path):
    _rewrite(pair, "negate: 0", "negate: 1\nfloor: 3")
    words = ["edit", "circle", pair, "--point=2.2,-1.4", "--radius=0", "--value=0"]
    assert command(*words, "-o", tmp_path / "e.pbm", "--image", tmp_path / "e.png")[0] == 0
    about = (tmp_path / "e.yaml").read_text().splitlines()
    assert {"negate: 0", "floor: 3", "image: e.pbm"} <= set(about)
    assert (read_map(pair).occupancy != read_map(tmp_path / "e.pbm").occupancy).sum() == 1
    assert (tmp_path / "e.png").exists()
