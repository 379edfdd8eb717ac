"""Checks of a map's cells: when they speak, and the numbers that they give, counted by hand."""

import pytest

from drawn import grid_from_text
from mapdeal.checks import map_checks
from mapdeal.checks.facts import GridFacts


def said(name, text, resolution=0.5):
    """What a check says of a drawing."""
    found = getattr(map_checks, name)(GridFacts.of(grid_from_text(text, resolution)))
    return [one if isinstance(one, str) else one.message for one in found]


def test_islands_are_of_a_square_metre_or_more_the_largest_is_none():
    # cells of 0.25 m2: 6 of them are the largest part, 4 are exactly 1 m2, 3 are a speck
    text = """
        ...#..#...
        ...#..####
    """
    assert said("islands", text) == [
        "1 area of free space, 1 m2, cannot be reached from the largest, 1.5 m2"
    ]
    assert said("specks", text) == ["1 patches of free space are smaller than 1 m2, 3 cells"]
    assert said("islands", "..#..#...\n..#..#...") == [
        "2 areas of free space, 2 m2, cannot be reached from the largest, 1.5 m2"
    ]
    assert said("islands", "......\n......") == said("specks", "......\n......") == []
    assert said("islands", "....#..") == said("specks", "....") == []


def test_free_space_goes_on_across_corners():
    text = """
        ..##
        ..##
        ##..
        ##..
    """
    assert said("islands", text) == []
    assert said("specks", ".#\n#.") == []
    assert said("specks", ".#.\n###\n#..") == [
        "2 patches of free space are smaller than 1 m2, 2 cells"
    ]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("##.?", ["2 cells are occupied and 1 free; is negate right?"]),
        ("##..", []),
        ("#+..", []),
        ("##??", []),
    ],
)
def test_a_map_is_inside_out_if_more_is_occupied_than_free(text, expected):
    assert said("inside_out", text) == expected


def test_the_border_is_counted_once_a_cell():
    assert said("open_border", "....\n....\n....") == [
        "10 of 10 cells on the border are free; is the map cut off?"
    ]
    assert said("open_border", "#?##\n#..#\n+?.#") == [
        "1 of 10 cells on the border are free; is the map cut off?"
    ]
    for text in ("####\n.###\n####", "####\n###.\n####"):  # a side alone
        assert len(said("open_border", text)) == 1
    assert said("open_border", "####\n#..#\n####") == []


def test_what_is_known_is_small_below_half_of_the_map():
    assert said("mostly_unknown", "?????\n?.#??\n?????") == [
        "all that is known lies in 2 x 1 cells, 13 %: try mapdeal active"
    ]
    assert said("mostly_unknown", "?????\n#????\n??.??\n?????\n?????") == [
        "all that is known lies in 3 x 2 cells, 24 %: try mapdeal active"
    ]
    assert said("mostly_unknown", "?.??\n?..?") == []  # 4 of 8 cells are half of it
    assert said("mostly_unknown", "?.???\n?..??") == [
        "all that is known lies in 2 x 2 cells, 40 %: try mapdeal active"
    ]
    assert said("mostly_unknown", "???") == []


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("???", ["all_unknown"]),
        ("?.?", ["no_obstacle"]),
        ("?#?", ["no_free"]),
        ("?+?", ["no_obstacle", "no_free"]),
        ("#.?", []),
    ],
)
def test_maps_of_one_kind_of_cell(text, names):
    kinds = ("no_obstacle", "no_free", "all_unknown")
    assert [name for name in kinds if said(name, text)] == names
