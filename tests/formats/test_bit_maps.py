import numpy as np
import pytest
from PIL import Image

from drawn import grid_from_text
from mapdeal import (
    BitMap,
    FileAccessError,
    MalformedInputError,
    OccupancyGrid,
    ParameterError,
    read_bit_map,
    read_map,
    write_bit_map,
)

DRAWING = "#........#\n.#..?....#\n#.#......."


@pytest.fixture
def pair(tmp_path):
    """A bit map on disk, b.pbm and b.yaml."""
    write_bit_map(tmp_path / "b.pbm", BitMap.from_occupancy(grid_from_text(DRAWING)))
    return tmp_path / "b.pbm"


def test_the_bytes_of_a_p4_file(pair):
    # North first, eight cells a byte, rows padded with zeros.
    assert pair.read_bytes() == b"P4\n10 3\n" + bytes([0x80, 0x40, 0x40, 0x40, 0xA0, 0x00])


def test_others_read_it_as_black_obstacles(pair):
    with Image.open(pair) as picture:
        pixels = np.asarray(picture.convert("L"))
    assert np.array_equal(pixels[::-1] == 0, grid_from_text(DRAWING).occupancy == 100)
    grid = read_map(pair.with_suffix(".yaml"))
    expected = np.maximum(grid_from_text(DRAWING).occupancy, 0)
    assert np.array_equal(grid.occupancy, expected)
    assert grid.origin == (1.5, -2.0, 0.4)


def test_the_way_to_disk_and_back(pair):
    bits = BitMap.from_occupancy(grid_from_text(DRAWING))
    found = read_bit_map(pair)
    assert np.array_equal(found.packed, bits.packed)
    assert (found.width, found.resolution, found.origin) == (10, 0.25, (1.5, -2.0, 0.4))


def test_a_negated_bit_map_is_turned_round(pair):
    _rewrite(pair, "negate: 0", "negate: 1")
    found = read_bit_map(pair)
    assert np.array_equal(found.to_mask(), grid_from_text(DRAWING).occupancy != 100)
    as_map = read_map(pair.with_suffix(".yaml"))
    assert np.array_equal(found.to_occupancy().occupancy, as_map.occupancy)


def test_the_plain_form_p1_is_read_too(pair):
    pair.write_text("P1\n# drawn by hand\n10 3\n1000000001\n0100000001\n1010000000\n")
    expected = BitMap.from_occupancy(grid_from_text(DRAWING))
    assert np.array_equal(read_bit_map(pair).packed, expected.packed)


def test_set_bits_behind_the_last_cell_mean_nothing(pair):
    data = bytearray(pair.read_bytes())
    data[-1] |= 0x3F
    pair.write_bytes(bytes(data))
    assert read_bit_map(pair).count() == 6


def test_the_obstacles_of_every_real_map_survive(real_maps, mapdeal_warnings, tmp_path):
    tried = 0
    for path in sorted(real_maps.rglob("*.yaml")):
        try:
            grid = read_map(path)
        except (FileAccessError, MalformedInputError):
            continue
        assert isinstance(grid, OccupancyGrid)
        target = tmp_path / "m.pbm"
        write_bit_map(target, BitMap.from_occupancy(grid), force=True)
        found = read_bit_map(target)
        assert np.array_equal(found.to_mask(), grid.occupied()), path
        assert found.frame == grid.frame
        tried += 1
    assert tried >= 37


@pytest.mark.parametrize(
    ("change", "error", "named"),
    [
        (lambda p: p.unlink(), FileAccessError, "b.pbm"),
        (lambda p: p.with_suffix(".yaml").unlink(), FileAccessError, "b.yaml"),
        (lambda p: p.write_bytes(p.read_bytes()[:-1]), MalformedInputError, "pixels"),
        (lambda p: p.write_bytes(b"P5\n1 1\n255\n\0"), MalformedInputError, "P5"),
        (lambda p: p.write_bytes(b"P4\n99999999 99999999\n"), MalformedInputError, "limit"),
        (lambda p: _rewrite(p, "b.pbm", "c.pbm"), MalformedInputError, "another image"),
        (lambda p: _rewrite(p, "trinary", "raw"), MalformedInputError, "trinary"),
        (
            lambda p: _rewrite(p, "negate: 0", "negate: 0\ncost_scale: costmap2d"),
            MalformedInputError,
            "no costs",
        ),
    ],
)
def test_files_that_are_no_bit_map_are_refused(pair, change, error, named):
    (pair.parent / "c.pbm").write_bytes(pair.read_bytes())
    change(pair)
    with pytest.raises(error, match=named):
        read_bit_map(pair)


def _rewrite(path, old, new):
    about = path.with_suffix(".yaml")
    about.write_text(about.read_text().replace(old, new))


def test_other_names_are_refused(tmp_path):
    with pytest.raises(ParameterError, match="pbm"):
        write_bit_map(tmp_path / "b.pgm", BitMap.from_mask([[1]], 0.5))
    with pytest.raises(ParameterError, match="pbm"):
        read_bit_map(tmp_path / "b.yaml")
