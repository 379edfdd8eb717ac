"""Checks of a map_server pair on both sides of each of their limits."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from mapdeal import MapdealWarning, OccupancyGrid, read_map
from mapdeal.checks import map_checks
from mapdeal.checks.facts import gather
from mapdeal.commands.lint import repaired
from mapdeal.compare.difference import compare
from mapdeal.grid.canvas import is_turned

YAML = {
    "image": "m.pgm", "mode": "trinary", "resolution": "0.05", "origin": "[-1.5, 2.0, 0.0]",
    "negate": "0", "occupied_thresh": "0.65", "free_thresh": "0.196",
}  # fmt: skip


@pytest.fixture
def pair(tmp_path):
    """Return what there is to check of a pair: rows of pixels, north first, and its YAML."""

    def make(pixels=((0, 205, 254),), *, image="m.pgm", comment="", **changes):
        pixels = np.array(pixels, dtype=np.uint16 if np.max(pixels) > 255 else np.uint8)
        if image == "m.pgm":
            note = f"# {comment}\n" if comment else ""
            head = f"P5\n{note}{pixels.shape[1]} {pixels.shape[0]}\n255\n".encode()
            (tmp_path / image).write_bytes(head + pixels.tobytes())
        else:
            Image.fromarray(pixels).save(tmp_path / image)
        lines = [f"{key}: {value}" for key, value in {**YAML, "image": image, **changes}.items()]
        (tmp_path / "m.yaml").write_text("\n".join(lines))
        facts, cells, findings = gather(tmp_path / "m.yaml")
        assert [one.check for one in findings if one.severity == "error"] == []
        return facts, cells

    return make


def said(name, facts):
    found = getattr(map_checks, name)(facts)
    return [getattr(remark, "message", remark) for remark in found]


ON_GREY = "0.2 is the shade of grey {} (1 pixels): readers disagree on it"
MANY = [7, *[6] * 2, *[5] * 3, *[9] * 4, *[8] * 5, *[11] * 6, 255]
GREYS = "{} pixels have greys other than 0, 205, 254 (11: 6, 8: 5, 9: 4, 5: 3, 6: 2{})"
FREED = "{} of grey 205, which map_saver writes for unknown, are read as free by {}"
ALL_READERS, LOWER = "nav2, humble and ros1", "; lower free_thresh from {} to 0.196"
SOME = "told"


@pytest.mark.parametrize(("name", "greys", "changes", "expected"), [
    # a threshold is compared with the shade that negate makes
    ("on_grey", [0, 51, 204, 254], {"free_thresh": 0.2}, ON_GREY.format(204)),
    ("on_grey", [0, 51, 204, 254], {"free_thresh": 0.2, "negate": 1}, ON_GREY.format(51)),
    ("on_grey", [0, 51, 204, 254], {"free_thresh": 0.2, "mode": "raw"}, None),
    ("on_grey", [0, 203, 205], {"free_thresh": 0.2}, None),
    # above a tenth of the pixels
    ("cartographer", [128] * 3 + [0] * 27, {}, None),
    ("cartographer", [128] * 4 + [0] * 26, {}, "4 pixels have grey 128, Cartographer's unknown"),
    ("greys", [0, 205, 254, 255], {}, None),
    ("greys", MANY, {}, GREYS.format(21, ", and 1 more greys")),
    ("greys", [*MANY[1:], 254], {}, GREYS.format(20, "")),
    ("greys", MANY, {"mode": "scale"}, None),
    ("unknown_becomes_free", [0, 205, 205, 254, 254, 205], {"free_thresh": 0.25},
     FREED.format("3 cells (50 %)", ALL_READERS) + LOWER.format(0.25)),
    ("unknown_becomes_free", [0, 254, 210], {"free_thresh": 0.25}, None),
    ("unknown_becomes_free", [0, 205, 254], {"mode": "raw"}, None),
    # a thousandth of the cells is map_saver's, less than that the blur of edges
    ("unknown_becomes_free", [205, *[254] * 999], {"free_thresh": 0.25},
     FREED.format("1 cells (0.1 %)", ALL_READERS) + LOWER.format(0.25)),
    ("unknown_becomes_free", [205, *[254] * 1000], {"free_thresh": 0.25}, None),
    # not from 0.196, which it is rounded to
    ("unknown_becomes_free", [205, 254], {"free_thresh": 0.1960785},
     FREED.format("1 cells (50 %)", ALL_READERS) + LOWER.format(0.1960785)),
    # the shade of grey 205; ROS 1 compares with <, and to humble 1 - 205 / 255 comes out below
    ("unknown_becomes_free", [205, 254], {"free_thresh": 50 / 255},
     FREED.format("1 cells (50 %)", "nav2 and humble") + LOWER.format(50 / 255)),
    # of what only reads as unknown in 16 bits: 205 * 257 is its brightness, 52 900 is beside it
    ("unknown_becomes_free", [205 * 257, 65_535], {"free_thresh": 0.25, "image": "m.png"}, SOME),
    ("unknown_becomes_free", [52_900, 65_535], {"free_thresh": 0.25, "image": "m.png"}, None),
    # map_saver writes three decimals
    ("comment_resolution", [0], {"comment": "0.050 m/pix", "resolution": 0.0505}, None),
    ("comment_resolution", [0], {"comment": "0.050 m/pix", "resolution": 0.0507},
     "the image says 0.05 m per pixel, the YAML 0.0507"),
    ("comment_resolution", [0], {"comment": "0.051 m/pix", "resolution": 0.0505}, None),
    ("comment_resolution", [0], {"comment": "1000.000 m/pix", "resolution": 1000.001}, None),
    ("resolution_unusual", [0], {"resolution": 0.001}, None),
    ("resolution_unusual", [0], {"resolution": 0.00099},
     "0.00099 m per cell is unusual; is the unit right?"),
    ("resolution_unusual", [0], {"resolution": 10}, None),
    ("resolution_unusual", [0], {"resolution": 10.01}, SOME),
    # within a thousandth of a cell: a half of it, two of them
    ("origin_off_lattice", [0], {"origin": "[-1.5, 2.0, 0]"}, None),
    ("origin_off_lattice", [0], {"origin": "[-1.499975, 2.0, 0]"}, None),
    ("origin_off_lattice", [0], {"origin": "[-1.4999, 2.0, 0]"}, SOME),
    ("origin_off_lattice", [0], {"origin": "[-1.5, 2.001, 0]"}, SOME),
    ("origin_off_lattice", [0], {"origin": "[-1.5, 2.0, 0.7]"}, None),
    # where 32-bit floats are coarser than a tenth of a cell: steps of 2^-8 and 2^-7 m
    ("origin_far", [0], {"origin": "[40000, 0, 0]"}, None),
    ("origin_far", [0], {"origin": "[0, -70000, 0]"},
     "32-bit floats have steps of 0.0078125 m there"),
])  # fmt: skip
def test_what_a_check_says(pair, name, greys, changes, expected):
    found = said(name, pair([greys], **changes)[0])
    assert len(found) == (expected is not None)
    assert expected in (None, SOME, *found)


@pytest.mark.parametrize(("name", "pixels", "expected"), [
    ("colour", [[[9, 9, 9], [9, 9, 8], [9, 9, 9], [0, 0, 255]], [[9, 9, 9]] * 3 + [[0, 0, 255]]],
     "3 pixels (37.5 %) are coloured; readers make grey of them differently"),
    ("colour", [[[9, 9, 9]] * 2] * 2, None),
    ("alpha", [[[9, 9, 9], [9, 9, 8]]], None),
    ("alpha", [[[9, 9, 9, 255], [9, 9, 9, 254], [9, 9, 9, 0]]],
     "2 pixels (66.7 %) are not opaque: unknown to Nav2, grey to ROS 1"),
    ("alpha", [[[9, 9, 9, 255]]], None),
])  # fmt: skip
def test_coloured_and_see_through_pixels_are_counted(pair, name, pixels, expected):
    found = said(name, pair(pixels, image="m.png")[0])
    assert found == [expected] * (expected is not None)


@pytest.mark.parametrize(("free_thresh", "who", "advice"), [
    ("0.196", "humble and ros1", "save"),
    ("0.25", "nav2, humble and ros1", "lower free_thresh from 0.25 to 0.196, and save"),
])  # fmt: skip
def test_opacity_that_is_averaged_in_is_no_matter_of_thresholds(pair, free_thresh, who, advice):
    """(3 * 205 + 255) / 4 is 217.5, whose shade is 0.147."""
    opaque = [[[205] * 3 + [255], [254] * 3 + [255]]]
    (text,) = said("unknown_becomes_free", pair(opaque, image="m.png", free_thresh=free_thresh)[0])
    average = " the image as a PGM, since humble and ros1 average the opacity into the grey"
    assert text == f"{FREED.format('1 cells (50 %)', who)}; {advice}{average}"


def test_commands_warn_in_the_words_of_the_check(pair):
    facts, _ = pair([[0, 205, 254]], free_thresh="0.25")
    with pytest.warns(MapdealWarning) as caught:
        read_map(facts.path)
    (text,) = said("unknown_becomes_free", facts)
    assert [str(one.message) for one in caught] == [
        f"{facts.path}: {text}".replace(" by nav2, humble and ros1", "")
    ]


@pytest.mark.parametrize(("name", "is_told"), [
    ("m.pgm", False), ("a/m.pgm", False), ("/a/m.pgm", True), ("C:\\maps\\m.pgm", True),
])  # fmt: skip
def test_paths_of_both_kinds_of_systems_are_absolute(pair, name, is_told):
    facts, _ = pair()
    facts = replace(facts, metadata=replace(facts.metadata, image=name))
    assert said("absolute_path", facts) == [f"{name} is absolute; write m.pgm"] * is_told


@pytest.mark.parametrize(("greys", "changes", "cells", "origin", "done"), [
    # a repair raises no threshold; grey 215 has the shade 0.157, grey 205 has 0.196
    ([[0, 205, 215, 254]], {"free_thresh": 0.1}, [[100, -1, -1, 0]], (-1.5, 2.0, 0.0), []),
    ([[0, 205, 215, 254]], {"free_thresh": 0.25}, [[100, -1, 0, 0]], (-1.5, 2.0, 0.0),
     ["1 cell is now unknown instead of free: map_saver's grey for unknown"]),
    # a square that stands on its corner at (0.1, 0), 1.41 m high and wide
    ([[254, 254]] * 2, {"resolution": 0.5, "origin": "[0.1, 0, 0.785398163]"},
     [[-1, -1, 0, -1], [-1, 0, 0, 0], [-1, -1, 0, -1]], (-1.0, 0.0, 0.0),
     ["yaw 0.785398 rad is in the cells now"]),
    # a yaw that no cell shows is taken out without resampling
    ([[0, 205, 254]], {"origin": "[-1.5, 2.0, 1e-7]"}, [[100, -1, 0]], (-1.5, 2.0, 0.0), []),
])  # fmt: skip
def test_repairs(pair, greys, changes, cells, origin, done):
    facts, read = pair(greys, **changes)
    assert is_turned(read.frame) == ("0.785" in facts.path.read_text())
    grid, told = repaired(facts.path, facts)
    assert (grid.occupancy.tolist(), grid.origin, told) == (cells, origin, done)


def test_a_few_pixels_of_map_savers_grey_are_not_repaired(pair):
    facts, _ = pair([[205, *[254] * 1000]], free_thresh="0.25")
    assert repaired(facts.path, facts)[1] == []


@pytest.mark.parametrize(("other", "symmetry"), [
    ([-1, 0, 0, 0], None),  # 2 cells agree, mirrored 3: one of two differences is gone
    ([-1, 0, 0, 100], "mirrored left to right"),
])  # fmt: skip
def test_a_map_is_mirrored_if_that_takes_away_more_than_half_of_what_differs(other, symmetry):
    first = OccupancyGrid([[100, 0, 0, -1]], 0.5)
    assert compare(first, OccupancyGrid([other], 0.5)).symmetry == symmetry


@pytest.mark.parametrize(("tolerance", "beyond"), [(2.9, 2), (3.0, 0)])
def test_a_tolerance_reaches_as_far_as_it_says_and_no_further(tolerance, beyond):
    first = OccupancyGrid([[100, 0, 0, 0]], 0.5)
    second = OccupancyGrid([[0, 0, 0, 100]], 0.5)
    # the wall has moved by 3 cells; free cells have free ones beside them
    assert compare(first, second, tolerance=tolerance).beyond_tolerance == beyond
