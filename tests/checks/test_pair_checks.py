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
    """Return what there is to check of a pair: rows of greys, north first, and its YAML."""

    def make(greys=((0, 205, 254),), *, comment="", maxval=255, **changes):
        pixels = np.array(greys, dtype=np.uint8)
        note = f"# {comment}\n" if comment else ""
        head = f"P5\n{note}{pixels.shape[1]} {pixels.shape[0]}\n{maxval}\n".encode()
        (tmp_path / "m.pgm").write_bytes(head + pixels.tobytes())
        lines = [f"{key}: {value}" for key, value in {**YAML, **changes}.items()]
        (tmp_path / "m.yaml").write_text("\n".join(lines))
        facts, cells, findings = gather(tmp_path / "m.yaml")
        assert [one.check for one in findings if one.severity == "error"] == []
        return facts, cells

    return make


def said(function, facts):
    return [getattr(remark, "message", remark) for remark in function(facts)]


def test_a_threshold_is_compared_with_the_shade_that_negate_makes(pair):
    text = "0.2 is the shade of grey {} (1 pixels): readers disagree on it"
    facts, _ = pair([[0, 51, 204, 254]], free_thresh="0.2")
    assert said(map_checks.on_grey, facts) == [text.format(204)]
    facts, _ = pair([[0, 51, 204, 254]], free_thresh="0.2", negate="1")
    assert said(map_checks.on_grey, facts) == [text.format(51)]
    facts, _ = pair([[0, 51, 204, 254]], free_thresh="0.2", mode="raw")
    assert said(map_checks.on_grey, facts) == []
    facts, _ = pair([[0, 203, 205]], free_thresh="0.2")
    assert said(map_checks.on_grey, facts) == []


def test_cartographer_is_named_above_a_tenth_of_the_pixels(pair):
    row = [0] * 30
    facts, _ = pair([[128] * 3 + row[3:]])
    assert said(map_checks.cartographer, facts) == []
    facts, _ = pair([[128] * 4 + row[4:]])
    assert said(map_checks.cartographer, facts) == [
        "4 pixels have grey 128, Cartographer's unknown"
    ]


def test_greys_that_no_map_saver_writes_are_counted_the_most_first(pair):
    facts, _ = pair([[0, 205, 254, 255]])
    assert said(map_checks.greys, facts) == []
    row = [7, 6, 6, 5, 5, 5, 9, 9, 9, 9, 8, 8, 8, 8, 8, 11, 11, 11, 11, 11, 11, 255]
    text = "21 pixels have greys other than 0, 205, 254 (11: 6, 8: 5, 9: 4, 5: 3, 6: 2{})"
    facts, _ = pair([row])
    assert said(map_checks.greys, facts) == [text.format(", and 1 more greys")]
    facts, _ = pair([[*row[1:], 254]])
    assert said(map_checks.greys, facts) == [text.format("").replace("21", "20", 1)]
    facts, _ = pair([row], mode="scale")
    assert said(map_checks.greys, facts) == []


@pytest.mark.parametrize(
    ("comment", "resolution", "is_told"),
    [
        ("0.050", "0.0505", False),  # map_saver writes three decimals
        ("0.050", "0.0507", True),
        ("0.051", "0.0505", False),
        ("1000.000", "1000.001", False),
    ],
)
def test_a_resolution_in_the_image_may_be_rounded(pair, comment, resolution, is_told):
    facts, _ = pair(comment=f"CREATOR: map_saver {comment} m/pix", resolution=resolution)
    text = f"the image says {float(comment):g} m per pixel, the YAML {float(resolution):g}"
    assert said(map_checks.comment_resolution, facts) == [text] * is_told


def test_grey_205_that_is_free_is_counted_where_only_that_is_free(pair):
    facts, _ = pair([[0, 205, 205], [254, 254, 205]], free_thresh="0.25")
    (text,) = said(map_checks.unknown_becomes_free, facts)
    assert text == (
        "3 cells (50 %) of grey 205, which map_saver writes for unknown, are read as free by nav2,"
        " humble and ros1; lower free_thresh from 0.25 to 0.196"
    )
    facts, _ = pair([[0, 254, 210]], free_thresh="0.25")
    assert said(map_checks.unknown_becomes_free, facts) == []
    facts, _ = pair([[0, 205, 254]], mode="raw")
    assert said(map_checks.unknown_becomes_free, facts) == []


def test_a_few_pixels_of_grey_205_are_the_blur_of_edges(pair):
    """A thousandth of the cells is map_saver's."""
    row = [254] * 1000
    facts, _ = pair([[205, *row[1:]]], free_thresh="0.25")
    (text,) = said(map_checks.unknown_becomes_free, facts)
    assert text.startswith("1 cells (0.1 %) of grey 205")
    facts, _ = pair([[205, *row]], free_thresh="0.25")
    assert said(map_checks.unknown_becomes_free, facts) == []
    assert repaired(facts.path, facts)[1] == []  # and so is none of them changed


@pytest.mark.parametrize(
    ("free_thresh", "told"),
    [
        ("0.1960785", "lower free_thresh from 0.1960785 to 0.196"),  # not from 0.196
        ("0.3", "lower free_thresh from 0.3 to 0.196"),
    ],
)
def test_what_is_told_of_a_threshold_does_not_contradict_itself(pair, free_thresh, told):
    facts, _ = pair([[0, 205, 254]], free_thresh=free_thresh)
    (text,) = said(map_checks.unknown_becomes_free, facts)
    assert text.endswith(f" are read as free by nav2, humble and ros1; {told}")


def test_a_threshold_that_readers_round_differently_names_those_that_free_the_grey(pair):
    # the shade of grey 205; ROS 1 compares with <, and to humble 1 - 205 / 255 comes out below
    facts, _ = pair([[0, 205, 205, 254]], free_thresh=repr(50 / 255))
    (text,) = said(map_checks.unknown_becomes_free, facts)
    assert text == (
        "2 cells (50 %) of grey 205, which map_saver writes for unknown, are read as free by nav2"
        " and humble; lower free_thresh from 0.19607843137254902 to 0.196"
    )


@pytest.mark.parametrize(
    ("free_thresh", "who", "advice"),
    [
        ("0.196", "humble and ros1", "save"),
        ("0.25", "nav2, humble and ros1", "lower free_thresh from 0.25 to 0.196, and save"),
    ],
)
def test_opacity_that_is_averaged_in_is_no_matter_of_thresholds(png_pair, free_thresh, who, advice):
    """(3 * 205 + 255) / 4 is 217.5, whose shade is 0.147."""
    opaque = [[[205] * 3 + [255], [254] * 3 + [255]]]
    facts = png_pair(opaque, free_thresh=free_thresh)
    (text,) = said(map_checks.unknown_becomes_free, facts)
    assert text == (
        "1 cells (50 %) of grey 205, which map_saver writes for unknown, are read as free by"
        f" {who}; {advice} the image as a PGM, since humble and ros1 average the opacity into the"
        " grey"
    )


def test_16_bit_greys_beside_that_of_map_saver_are_not_taken_for_it(tmp_path):
    """205 * 257 is its brightness; 52_900 has a shade of 0.193, free with the usual threshold."""
    for value, is_told in ((205 * 257, True), (52_900, False)):
        Image.fromarray(np.array([[value, 65_535]], np.uint16)).save(tmp_path / "m.png")
        entries = {**YAML, "image": "m.png", "free_thresh": "0.25"}
        (tmp_path / "m.yaml").write_text("\n".join(f"{k}: {v}" for k, v in entries.items()))
        facts = gather(tmp_path / "m.yaml")[0]
        assert len(said(map_checks.unknown_becomes_free, facts)) == is_told


def test_commands_warn_in_the_words_of_the_check(pair):
    facts, _ = pair([[0, 205, 254]], free_thresh="0.25")
    with pytest.warns(MapdealWarning) as caught:
        read_map(facts.path)
    (text,) = said(map_checks.unknown_becomes_free, facts)
    assert [str(one.message) for one in caught] == [
        f"{facts.path}: {text}".replace(" by nav2, humble and ros1", "")
    ]


@pytest.mark.parametrize(
    ("resolution", "is_told"),
    [("0.001", False), ("0.00099", True), ("10", False), ("10.01", True), ("5000", True)],
)
def test_cells_from_a_millimetre_to_ten_metres_are_usual(pair, resolution, is_told):
    facts, _ = pair(resolution=resolution)
    text = f"{float(resolution):g} m per cell is unusual; is the unit right?"
    assert said(map_checks.resolution_unusual, facts) == [text] * is_told


@pytest.mark.parametrize(
    ("origin", "is_told"),
    [
        ("[-1.5, 2.0, 0]", False),
        ("[-1.499975, 2.0, 0]", False),  # half a thousandth of a cell
        ("[-1.4999, 2.0, 0]", True),  # two thousandths
        ("[-1.5, 2.001, 0]", True),
        ("[-1.5, 2.0, 0.7]", False),
    ],
)
def test_an_origin_is_on_the_lattice_within_a_thousandth_of_a_cell(pair, origin, is_told):
    facts, _ = pair(origin=origin)
    assert len(said(map_checks.origin_off_lattice, facts)) == is_told


@pytest.mark.parametrize(
    ("origin", "told"),
    [
        ("[40000, 0, 0]", []),  # 32-bit floats have steps of 2^-8 m there
        ("[0, -70000, 0]", ["32-bit floats have steps of 0.0078125 m there"]),  # 2^-7 m
    ],
)
def test_an_origin_is_far_where_floats_are_coarser_than_a_tenth_of_a_cell(pair, origin, told):
    facts, _ = pair(origin=origin)
    assert said(map_checks.origin_far, facts) == told


@pytest.mark.parametrize(
    ("name", "is_told"),
    [("m.pgm", False), ("a/m.pgm", False), ("/a/m.pgm", True), ("C:\\maps\\m.pgm", True)],
)
def test_paths_of_both_kinds_of_systems_are_absolute(pair, name, is_told):
    facts, _ = pair()
    facts = replace(facts, metadata=replace(facts.metadata, image=name))
    assert said(map_checks.absolute_path, facts) == [f"{name} is absolute; write m.pgm"] * is_told


def test_a_repair_raises_no_threshold(pair):
    # grey 215 has the shade 0.157, grey 205 has 0.196
    facts, _ = pair([[0, 205, 215, 254]], free_thresh="0.1")
    grid, done = repaired(facts.path, facts)
    assert (grid.occupancy.tolist(), done) == ([[100, -1, -1, 0]], [])
    facts, _ = pair([[0, 205, 215, 254]], free_thresh="0.25")
    grid, done = repaired(facts.path, facts)
    assert grid.occupancy.tolist() == [[100, -1, 0, 0]]
    assert done == ["1 cell is now unknown instead of free: map_saver's grey for unknown"]


def test_a_repair_that_turns_a_map_leaves_what_lies_outside_of_it_unknown(pair):
    facts, _ = pair([[254, 254], [254, 254]], resolution="0.5", origin="[0.1, 0, 0.785398163]")
    grid, done = repaired(facts.path, facts)
    # the square stands on its corner at (0.1, 0), 1.41 m high and wide
    assert grid.occupancy.tolist() == [
        [-1, -1, 0, -1],
        [-1, 0, 0, 0],
        [-1, -1, 0, -1],
    ]
    assert grid.origin == (-1.0, 0.0, 0.0)
    assert done == ["yaw 0.785398 rad is in the cells now"]


def test_a_yaw_that_no_cell_shows_is_taken_out_without_resampling(pair):
    facts, cells = pair([[0, 205, 254]], origin="[-1.5, 2.0, 1e-7]")
    assert not is_turned(cells.frame)
    grid, done = repaired(facts.path, facts)
    assert (grid.occupancy.tolist(), grid.origin, done) == ([[100, -1, 0]], (-1.5, 2.0, 0.0), [])


def test_a_map_is_mirrored_if_that_takes_away_more_than_half_of_what_differs():
    first = OccupancyGrid([[100, 0, 0, -1]], 0.5)
    # as it is 2 cells agree, mirrored 3: one of two differences is gone
    assert compare(first, OccupancyGrid([[-1, 0, 0, 0]], 0.5)).symmetry is None
    assert (
        compare(first, OccupancyGrid([[-1, 0, 0, 100]], 0.5)).symmetry == "mirrored left to right"
    )


@pytest.mark.parametrize(("tolerance", "beyond"), [(2.9, 2), (3.0, 0), (2.0, 2), (1.5, 2)])
def test_a_tolerance_reaches_as_far_as_it_says_and_no_further(tolerance, beyond):
    first = OccupancyGrid([[100, 0, 0, 0]], 0.5)
    second = OccupancyGrid([[0, 0, 0, 100]], 0.5)
    # the wall has moved by 3 cells; free cells have free ones beside them
    assert compare(first, second, tolerance=tolerance).beyond_tolerance == beyond


@pytest.fixture
def png_pair(tmp_path):
    """Return what there is to check of a PNG and its YAML."""

    def make(pixels, **changes):
        Image.fromarray(np.array(pixels, dtype=np.uint8)).save(tmp_path / "m.png")
        entries = {**YAML, "image": "m.png", **changes}
        lines = [f"{key}: {value}" for key, value in entries.items()]
        (tmp_path / "m.yaml").write_text("\n".join(lines))
        return gather(tmp_path / "m.yaml")[0]

    return make


def test_coloured_and_see_through_pixels_are_counted(png_pair):
    grey, tinted, blue = [9, 9, 9], [9, 9, 8], [0, 0, 255]
    facts = png_pair([[grey, tinted, grey, blue], [grey, grey, grey, blue]])
    assert said(map_checks.colour, facts) == [
        "3 pixels (37.5 %) are coloured; readers make grey of them differently"
    ]
    assert said(map_checks.alpha, facts) == []
    assert said(map_checks.colour, png_pair([[grey, grey], [grey, grey]])) == []
    facts = png_pair([[[9, 9, 9, 255], [9, 9, 9, 254], [9, 9, 9, 0]]])
    assert said(map_checks.alpha, facts) == [
        "2 pixels (66.7 %) are not opaque: unknown to Nav2, grey to ROS 1"
    ]
    assert said(map_checks.alpha, png_pair([[[9, 9, 9, 255]]])) == []
