"""Regions in metres, on frames whose numbers are all different."""

import pytest

from mapdeal import ParameterError
from mapdeal.grid import frame
from mapdeal.grid.frame import Frame, Region, region_around, region_of

FRAME = Frame(5, 8, 0.5, (1.0, -2.0, 0.0))


@pytest.mark.parametrize(
    ("size", "place", "expected"),
    [
        ((1.0, 1.5), {"corner_xy": (2.0, -1.5)}, Region(1, 2, 3, 2)),
        ((1.01, 1.5), {"corner_xy": (2.2, -1.1)}, Region(1, 2, 3, 3)),
        ((1.0, 1.5), {"corner_xy": (0.9, -2.1)}, Region(-1, -1, 3, 2)),
        ((1.0, 2.0), {"center_xy": (2.5, 0.0)}, Region(2, 2, 4, 2)),
        ((1e-10, 1e-10), {"corner_xy": (2.2, -1.1)}, Region(1, 2, 1, 1)),
    ],
)
def test_a_region_begins_with_the_cell_of_its_corner_and_covers_its_size(size, place, expected):
    assert region_of(FRAME, size, **place) == expected


@pytest.mark.parametrize(
    ("size", "place"),
    [
        ((0.0, 1.0), {"corner_xy": (1.0, 1.0)}),
        ((1.0, 0.0), {"corner_xy": (1.0, 1.0)}),
        ((1.0, 1.0), {}),
        ((1.0, 1.0), {"corner_xy": (1.0, 1.0), "center_xy": (1.0, 1.0)}),
    ],
)
def test_regions_that_cannot_be(size, place):
    with pytest.raises(ParameterError):
        region_of(FRAME, size, **place)


def test_the_cells_around_another_grid():
    assert region_around(FRAME, Frame(2, 3, 0.5, (2.0, -2.5, 0.0))) == Region(-1, 2, 2, 3)
    # borders that differ by rounding are the same, others take one more cell
    nearly = Frame(2, 3, 0.5, (2.0 - 1e-8, -2.5 + 1e-8, 0.0))
    assert region_around(FRAME, nearly) == Region(-1, 2, 2, 3)
    assert region_around(FRAME, Frame(2, 3, 0.5, (2.1, -2.4, 0.0))) == Region(-1, 2, 3, 4)
    quarter = Frame(2, 3, 0.5, (2.0, -1.0, 1.5707963267948966))  # its rows go to the left
    assert region_around(FRAME, quarter) == Region(2, 0, 3, 2)


def test_a_region_and_the_grid_share_what_lies_in_both():
    rows, cols = Region(-1, 6, 3, 4).shared_with(FRAME.shape)
    assert (rows, cols) == (slice(0, 2), slice(6, 8))
    assert Region(-1, 6, 3, 4).place_of(rows, cols) == (slice(1, 3), slice(0, 2))
    for outside in (
        Region(-3, 0, 3, 2),
        Region(5, 0, 2, 2),
        Region(0, 8, 2, 2),
        Region(0, -2, 2, 2),
    ):
        rows, cols = outside.shared_with(FRAME.shape)
        assert rows.start == rows.stop or cols.start == cols.stop


def test_a_window_has_at_most_so_many_cells(monkeypatch):
    monkeypatch.setattr(frame, "MOST_CELLS", 12)
    assert Region(1, 2, 3, 4).frame_in(FRAME) == Frame(3, 4, 0.5, (2.0, -1.5, 0.0))
    with pytest.raises(ParameterError, match="more than 12 cells"):
        Region(0, 0, 13, 1).frame_in(FRAME)
