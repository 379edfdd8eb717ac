"""Checks of a map's cells: when they speak, and the numbers that they give, counted by hand."""

import pytest

from drawn import grid_from_text
from mapdeal.checks import map_checks
from mapdeal.checks.facts import GridFacts

CUT_OFF = "area{} of free space, {} m2, cannot be reached from the largest, 1.5 m2"
SPECKS = "{} patches of free space are smaller than 1 m2, {} cells"
ACROSS_CORNERS = "..##\n..##\n##..\n##.."
BORDER = "{} of 10 cells on the border are free; is the map cut off?"
SMALL = "all that is known lies in {}: try mapdeal active"


# cells of 0.25 m2: areas of a square metre are 4 of them, and the largest is no island
@pytest.mark.parametrize(("name", "text", "expected"), [
    ("islands", "...#..#...\n...#..####", "1 " + CUT_OFF.format("", 1)),
    ("specks", "...#..#...\n...#..####", SPECKS.format(1, 3)),
    ("islands", "..#..#...\n..#..#...", "2 " + CUT_OFF.format("s", 2)),
    ("islands", "......\n......", None),
    ("specks", "......\n......", None),
    ("islands", "....#..", None),
    ("specks", "....", None),
    ("islands", ACROSS_CORNERS, None),
    ("specks", ".#\n#.", None),
    ("specks", ".#.\n###\n#..", SPECKS.format(2, 2)),
    ("inside_out", "##.?", "2 cells are occupied and 1 free; is negate right?"),
    ("inside_out", "##..", None),
    ("inside_out", "#+..", None),
    ("inside_out", "##??", None),
    ("open_border", "....\n....\n....", BORDER.format(10)),
    ("open_border", "#?##\n#..#\n+?.#", BORDER.format(1)),
    ("open_border", "####\n.###\n####", BORDER.format(1)),
    ("open_border", "####\n###.\n####", BORDER.format(1)),
    ("open_border", "####\n#..#\n####", None),
    ("mostly_unknown", "?????\n?.#??\n?????", SMALL.format("2 x 1 cells, 13 %")),
    ("mostly_unknown", "?????\n#????\n??.??\n?????\n?????", SMALL.format("3 x 2 cells, 24 %")),
    ("mostly_unknown", "?.??\n?..?", None),  # 4 of 8 cells are half of it
    ("mostly_unknown", "?.???\n?..??", SMALL.format("2 x 2 cells, 40 %")),
    ("mostly_unknown", "???", None),
])  # fmt: skip
def test_what_a_check_says(name, text, expected):
    found = getattr(map_checks, name)(GridFacts.of(grid_from_text(text, 0.5)))
    assert [getattr(one, "message", one) for one in found] == [expected] * (expected is not None)


@pytest.mark.parametrize(("text", "names"), [
    ("???", ["all_unknown"]),
    ("?.?", ["no_obstacle"]),
    ("?#?", ["no_free"]),
    ("?+?", ["no_obstacle", "no_free"]),
    ("#.?", []),
])  # fmt: skip
def test_maps_of_one_kind_of_cell(text, names):
    facts = GridFacts.of(grid_from_text(text, 0.5))
    kinds = ("no_obstacle", "no_free", "all_unknown")
    assert [name for name in kinds if list(getattr(map_checks, name)(facts))] == names
