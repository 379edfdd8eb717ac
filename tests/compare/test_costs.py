"""What differs between two costmaps, against a comparison in plain Python."""

from collections import deque

import numpy as np
import pytest
from hypothesis import example, given, strategies as st
from hypothesis.extra import numpy as arrays

from mapdeal import Costmap
from mapdeal.compare.difference import SIZES, compare_costmaps
from mapdeal.grid.values import occupancy_from_cost
from mapdeal.pictures.styles import cost_change_codes, cost_change_style

RESOLUTION = 0.5
COSTS = st.sampled_from([0, 0, 1, 9, 10, 50, 59, 128, 252, 253, 254, 255, 255])


def costs(longest=6):
    sizes = st.integers(1, longest)
    return st.tuples(sizes, sizes).flatmap(
        lambda shape: arrays.arrays(np.uint8, shape, elements=COSTS)
    )


def kinds_of_change(a, b):
    closed = [cost in (253, 254) for cost in (a, b)]
    unknown = [cost == 255 for cost in (a, b)]
    found = set()
    found |= {"closed"} if closed[1] and not closed[0] else set()
    found |= {"opened"} if closed[0] and not closed[1] else set()
    found |= {"unknown"} if unknown[1] and not unknown[0] else set()
    found |= {"known"} if unknown[0] and not unknown[1] else set()
    if not any(unknown) and a != b:
        found.add("rose" if b > a else "fell")
    return found


def regions_of(cells):
    """Return groups of cells that touch, corners included, the largest first."""
    remaining, groups = set(cells), []
    while remaining:
        group, queue = set(), deque([remaining.pop()])
        while queue:
            row, col = queue.popleft()
            group.add((row, col))
            near = {(row + i, col + j) for i in (-1, 0, 1) for j in (-1, 0, 1)} & remaining
            remaining -= near
            queue.extend(near)
        groups.append(group)
    return sorted(groups, key=len, reverse=True)


@example(a=np.uint8([[0, 254, 255]]), b=np.uint8([[255, 0, 253]]), shift=(0, 0), yaw=0.7)
@given(
    a=costs(), b=costs(), shift=st.tuples(st.integers(-4, 4), st.integers(-4, 4)),
    yaw=st.sampled_from([0.0, 0.7]),
)  # fmt: skip
def test_costs_are_compared_where_both_costmaps_have_some(a, b, shift, yaw):
    """Costmaps on one lattice, `b` so many rows and columns away."""
    first = Costmap(a, RESOLUTION, (1.0, -2.0, yaw))
    second = Costmap(b, RESOLUTION, first.frame.window(*shift, *b.shape).origin)
    result = compare_costmaps(first, second)
    pairs = {
        (r, c): (int(a[r, c]), int(b[r - shift[0], c - shift[1]]))
        for r, c in np.ndindex(a.shape)
        if 0 <= r - shift[0] < b.shape[0] and 0 <= c - shift[1] < b.shape[1]
    }
    assert result.common_cells == len(pairs)
    assert result.differing == sum(x != y for x, y in pairs.values())
    known = sum(a[cell] != 255 for cell in np.ndindex(a.shape) if cell not in pairs)
    assert result.not_compared == known
    for change in result.changes.values():
        cells = {cell for cell, pair in pairs.items() if change.kind in kinds_of_change(*pair)}
        assert (change.cells, change.area) == (len(cells), len(cells) * RESOLUTION**2)
        groups = regions_of(cells)
        assert change.regions == len(groups)
        assert [len(region.cells) for region in change.largest] == [len(group) for group in groups]
        own = {tuple(cell) for region in change.largest for cell in region.cells.tolist()}
        assert own == {(r - min(shift[0], 0), c - min(shift[1], 0)) for r, c in cells}
        for region in change.largest:
            place = tuple(
                result.frame.bounded_rowcol_from_xy([(region.x, region.y)])[0][0].tolist()
            )
            assert place in set(map(tuple, region.cells.tolist()))
        if change.kind in ("rose", "fell"):
            sizes = [abs(pairs[cell][0] - pairs[cell][1]) for cell in cells]
            assert change.by_size == {
                f"{low}-{high}": sum(low <= size <= high for size in sizes) for low, high in SIZES
            }
        else:
            assert change.by_size == {}


def test_every_pair_of_costs_has_the_colour_of_its_change():
    first, second = (
        part.reshape(256, 256).astype(np.uint8) for part in np.divmod(np.arange(1 << 16), 256)
    )
    result = compare_costmaps(Costmap(first, RESOLUTION), Costmap(second, RESOLUTION))
    codes = cost_change_codes(first, second, result.is_common, result.masks)
    style = cost_change_style()
    assert set(style.labels) == set(range(len(style.colours)))
    states = {"closed": "now closed", "opened": "no longer closed", "unknown": "now unknown",
              "known": "no longer unknown"}  # fmt: skip
    for a, b in np.ndindex(256, 256):
        label, found = style.labels[int(codes[a, b])], kinds_of_change(a, b)
        expected = next((states[kind] for kind in states if kind in found), None)
        if expected is None and found:
            name, _, least, _, most = label.split()
            assert {name} == found
            assert int(least) <= abs(b - a) <= int(most)
        else:
            equal = "unknown in both" if a == 255 else "closed in both" if a > 252 else "equal"
            assert label == (expected or equal)
    # where cells share a pixel the larger change shows
    assert (np.diff(codes[0, :253].astype(int)[2:]) >= 0).all()
    assert codes[0, 0] < codes[0, 1] < codes[0, 252] < codes[0, 254]
    nowhere = np.zeros((256, 256), np.bool_)
    assert not cost_change_codes(first, second, nowhere, dict.fromkeys(states, nowhere)).any()


def test_costs_on_two_scales_are_compared_as_ros_publishes_them():
    costs = np.arange(256, dtype=np.uint8).reshape(16, 16)
    published = occupancy_from_cost()[costs]
    first = Costmap(costs, RESOLUTION)
    second = Costmap(published, RESOLUTION, scale="occupancy")
    for pair in ((first, second), (second, first), (second, second)):
        result = compare_costmaps(*pair)
        assert result.is_equal
        assert result.scale == "occupancy"
    open_ = published.copy()
    open_[published >= 99] = 98
    result = compare_costmaps(second, Costmap(open_, RESOLUTION, scale="occupancy"))
    assert result.changes["opened"].cells == 2  # inscribed and lethal
    assert result.changes["fell"].by_size["1-9"] == 2  # 98 is 249 on costmap_2d's scale


@pytest.mark.parametrize("kind", ["closed", "fell"])
def test_of_many_regions_the_largest_are_listed(kind):
    before = np.zeros((60, 60), np.uint8)
    before[1::3, 1::3] = 0 if kind == "closed" else 90
    after = before.copy()
    after[1::3, 1::3] = 254 if kind == "closed" else 3
    after[1:4, 1] = after[2, 1]
    after[1:3, 1] = 254 if kind == "closed" else 3
    before[1:3, 1] = 0 if kind == "closed" else 90
    change = compare_costmaps(Costmap(before, 0.1), Costmap(after, 0.1)).changes[kind]
    assert (change.regions, len(change.largest), len(change.largest[0].cells)) == (400, 20, 2)
