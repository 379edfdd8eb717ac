"""Maps in one, against maps merged cell by cell in plain Python."""

import math
import warnings

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st
from scipy import ndimage

import oracles
from mapdeal import MapdealWarning, OccupancyGrid, Transform, merge
from mapdeal.compare.merge import snapped
from strategies import examples, occupancies

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("mapdeal_warnings")]

YAWS = st.one_of(st.sampled_from([0.0, math.pi / 2, -math.pi, math.pi / 4]), st.floats(-4, 4))
EDGE = 1e-4
"""In cells: the tests skip points closer to the edge of a cell."""


def place_in(grid, point):
    """Column and row of a point of the map frame, with fractions."""
    return Transform(*grid.origin).inverse().points([point])[0] / grid.resolution


def square(grid, row, col):
    corners = np.array([(col, row), (col + 1, row), (col + 1, row + 1), (col, row + 1)])
    return Transform(*grid.origin).points(corners * grid.resolution)


def overlapping(grid, polygon):
    """Return the largest value above 0 under a square of the map frame; None if uncertain."""
    largest, least = 0, min(grid.resolution, math.dist(*polygon[:2])) ** 2
    for row, col in np.argwhere(grid.occupancy > 0).tolist():
        area = oracles.shared_area(polygon.tolist(), square(grid, row, col).tolist()) / least
        if 1e-14 < area < 1e-5:
            return None
        if area >= 1e-5:
            largest = max(largest, int(grid.occupancy[row, col]))
    return largest


NEAR_0 = st.floats(-0.3, 0.3).map(lambda value: round(value, 12))  # shapely fails at 5e-324


@st.composite
def placed_maps(draw, longest=5):
    """Two or three maps with their transforms, near to each other."""
    count = draw(st.integers(2, 3))
    maps, transforms = [], []
    for number in range(count):
        resolution = draw(st.sampled_from([0.05, 0.07, 0.1, 0.3]))
        origin = (draw(NEAR_0), draw(NEAR_0), draw(YAWS))
        maps.append(OccupancyGrid(draw(occupancies(longest)), resolution, origin))
        if number:
            transforms.append(Transform(draw(NEAR_0), draw(NEAR_0), draw(YAWS)))
            frame = transforms[-1].inverse().frame(maps[number].frame)
            assume(math.dist(snapped(frame, maps[0].frame).origin, frame.origin) < EDGE / 100)
    return maps, transforms


@examples(20)
@given(placed_maps(), st.sampled_from(["occupied", "newest"]))
def test_cells_are_what_plain_python_makes_of_them(case, rule):
    maps, transforms = case
    grid = merge(maps, transforms=transforms, rule=rule, same_wall=0).grid
    for row, col in np.ndindex(grid.shape):
        expected = -1
        for number, source in enumerate(maps):
            target = square(grid, row, col)
            if number:
                target = transforms[number - 1].points(target)
            value = oracles.value_at(source, target.mean(axis=0), EDGE)
            above = overlapping(source, target) if number else 0
            if value is None or above is None:
                break
            value = max(value, above or -1)
            expected = max(expected, value) if rule == "occupied" or value == -1 else value
        else:
            assert grid.occupancy[row, col] == expected


@given(placed_maps(), st.sampled_from(["occupied", "newest", "evidence"]))
def test_the_first_maps_cells_stay_and_the_lattice_is_no_larger_than_needed(case, rule):
    maps, transforms = case
    first, merged = maps[0], merge(maps, transforms=transforms, rule=rule, same_wall=0).grid
    assert merged.resolution == first.resolution
    assert merged.origin[2] == first.origin[2]
    corner = place_in(first, merged.origin[:2])
    col, row = np.round(corner).astype(int)
    assert max(col, row) <= 0
    np.testing.assert_allclose(corner, (col, row), atol=1e-6)
    own = merged.occupancy[-row:, -col:][: first.shape[0], : first.shape[1]]
    assert own.shape == first.shape
    if rule == "occupied":
        assert (own >= first.occupancy).all()
    places = [(0.0, 0.0), first.shape[::-1]]
    for source, transform in zip(maps[1:], transforms, strict=True):
        for cell in np.argwhere(source.occupancy >= 0).tolist():
            corners = transform.inverse().points(square(source, *cell))
            places += [place_in(first, corner) for corner in corners]
    places = np.array(places)
    off = np.abs(places - np.round(places))
    if ((off > 2 * EDGE) | (off < EDGE / 100)).all():
        size = np.ceil(places.max(axis=0) - EDGE) - np.floor(places.min(axis=0) + EDGE)
        assert merged.shape == tuple(size[::-1])


def known_places(grid, lattice):
    known = np.argwhere(grid.occupancy >= 0)
    at = lattice.unbounded_rowcol_from_xy(grid.frame.xy_from_rowcol(known))
    return dict(zip(map(tuple, at.tolist()), grid.occupancy[tuple(known.T)].tolist(), strict=True))


@examples(12)
@given(st.lists(occupancies(6), min_size=2, max_size=4), st.data())
def test_counts_rules_and_conflicts_on_one_lattice_by_hand(arrays, data):
    lattice = OccupancyGrid([[0]], 0.07, (1.3, -0.2, 0.7)).frame
    step = st.integers(-3, 3)
    places = [(data.draw(step), data.draw(step)) for _ in arrays]
    maps = [
        OccupancyGrid(a, 0.07, lattice.window(*place, *a.shape).origin)
        for a, place in zip(arrays, places, strict=True)
    ]
    by_cell = {}  # by cell of the lattice what each map says
    for number, (a, (row, col)) in enumerate(zip(arrays, places, strict=True)):
        for r, c in np.ndindex(a.shape):
            by_cell.setdefault((r + row, c + col), [-1] * len(arrays))[number] = int(a[r, c])

    def newest(values):
        return [-1, *(value for value in values if value >= 0)][-1]

    def votes(values):
        sum_ = sum(value == 100 for value in values) - sum(value == 0 for value in values)
        return max(values) if sum_ == 0 else 100 * (sum_ > 0)

    for rule, decide in (("occupied", max), ("newest", newest), ("evidence", votes)):
        merged = merge(maps, rule=rule, same_wall=0)
        decided = {cell: decide(values) for cell, values in by_cell.items()}
        expected = {cell: value for cell, value in decided.items() if value >= 0}
        assert known_places(merged.grid, lattice) == expected

    kinds = {}
    for cell, values in by_cell.items():
        if 100 in values and 0 in values:
            kinds[cell] = {100: 1, 0: 2}.get(values[0], 3)
    conflicts = OccupancyGrid(merged.conflicts, 0.07, merged.grid.origin)
    assert {cell: kind for cell, kind in known_places(conflicts, lattice).items() if kind} == kinds
    for number, counts in enumerate(merged.maps):
        own = {cell: (v[number], v[:number] + v[number + 1 :]) for cell, v in by_cell.items()}
        common = [cell for cell, (_, elsewhere) in own.items() if max(elsewhere) >= 0]
        walls = [cell for cell in common if own[cell][0] == 100]
        walls_elsewhere = [cell for cell in common if 100 in own[cell][1]]
        before = [(v[number], max([-1, *v[:number]])) for v in by_cell.values()]
        expected = {
            "known": sum(mine >= 0 for mine, _ in own.values()),
            "common": sum(own[cell][0] >= 0 for cell in common),
            "occupied_here": sum(own[cell][0] == 100 and 0 in own[cell][1] for cell in common),
            "free_here": sum(own[cell][0] == 0 and 100 in own[cell][1] for cell in common),
            "walls": len(walls),
            "met": sum(any(math.dist(c, wall) <= 2 for wall in walls_elsewhere) for c in walls),
            "added": sum((m >= 0 > b) or (m == 100 > b) for m, b in before),
        }
        assert {name: getattr(counts, name) for name in expected} == expected


def test_finer_obstacles_are_seen_in_conflicts_and_votes():
    first = OccupancyGrid(np.zeros((2, 3), np.int8), 0.5, (1.0, 2.0, 0.0))
    fine = np.zeros((10, 15), np.int8)
    fine[0, 0] = 100  # far from any centre of the first map's cells
    second = OccupancyGrid(fine, 0.1, first.origin)
    merged = merge([first, second])
    assert merged.conflicts.tolist() == [[2, 0, 0], [0, 0, 0]]
    assert merged.grid.occupancy[0, 0] == 100
    assert merge([first, second], rule="evidence").grid.occupancy[0, 0] == 100


def test_walls_that_two_maps_see_a_cell_apart_are_no_thicker_in_conflicts():
    """On a lattice half a cell off, each cell of the wall touches two; it counts at one."""
    first = OccupancyGrid(np.zeros((3, 7), np.int8), 0.5, (1.0, 2.0, 0.0))
    wall = np.zeros((3, 7), np.int8)
    wall[:, 3] = 100
    merged = merge([first, OccupancyGrid(wall, 0.5, (1.2, 2.0, 0.0))], same_wall=0)
    assert np.count_nonzero(merged.grid.occupancy == 100) == 6
    assert merged.conflict_count == 3
    assert merge([first, first], same_wall=1e308).conflict_count == 0


def room():
    values = np.zeros((40, 60), np.int8)
    values[[0, -1]] = values[:, [0, 20, -1]] = 100
    return values


def texts_of(maps, **options):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", MapdealWarning)
        merge(maps, **options)
    return [str(warning.message) for warning in caught]


def test_what_is_odd_is_warned_of():
    first = OccupancyGrid(room(), 0.07, (1.3, -0.2, 0.7))

    def shifted(by):
        return first.with_values(first.occupancy, first.frame.window(by, by, *first.shape).origin)

    assert texts_of([first, first]) == [
        "map 2: adds nothing: the maps before it know all of its cells and obstacles"
    ]
    assert texts_of([first, shifted(70)]) == ["map 2: knows no cell that another map knows"]
    assert texts_of([first, shifted(1)]) == []
    (text,) = texts_of([first, shifted(5)], same_wall=0)
    # 35 x 55 cells in common. Of either map two edges and the wall between them lie there, which
    # meet in two cells, and meet the other map's in four.
    conflicts, shared = 2 * (55 + 35 + 35 - 2 - 4), 35 * 55
    assert text.startswith(f"map 2: contradicts the other maps on {100 * conflicts / shared:.1f} %")
    assert texts_of([first, shifted(1)], rule="evidence") == [
        "no map has evidence layers; each of their cells counts as one vote"
    ]


def seen_by(grid, cells):
    """Cells within so many cells of an obstacle."""
    walls = np.asarray(grid) == 100
    return walls.any() & (ndimage.distance_transform_edt(~walls) <= cells)


@given(st.data(), st.sampled_from(["occupied", "newest"]), st.sampled_from([1.0, 1.5, 2.3]))
def test_walls_of_two_maps_are_one_within_a_distance(data, rule, reach):
    """The cells dropped are near the other map's walls, and far from walls that only one has."""
    shape = data.draw(st.tuples(st.integers(3, 9), st.integers(3, 9)))
    values = st.lists(st.sampled_from([-1, 0, 0, 0, 100]), min_size=81, max_size=81)
    first, second = (
        np.array(data.draw(values), np.int8)[: shape[0] * shape[1]].reshape(shape) for _ in range(2)
    )
    maps = [OccupancyGrid(cells, 1.0) for cells in (first, second)]
    merged = merge(maps, rule=rule, same_wall=reach)
    stronger, dropped = (first, second) if rule == "occupied" else (second, first)
    own = dropped == 100
    alone = np.where(own & ~seen_by(stronger, 2 * reach), 100, 0)
    goes = own & seen_by(stronger, reach) & ~seen_by(alone, 2 * reach + 1) & (stronger != 100)
    weaker = np.where(goes, -1, dropped)
    newest = np.where(stronger == -1, weaker, stronger)
    expected = np.maximum(stronger, weaker) if rule == "occupied" else newest
    np.testing.assert_array_equal(merged.grid.occupancy, expected)
    for occupancy, counts in zip((first, second), merged.maps, strict=True):
        walls = occupancy == 100
        for found, cells in (
            (counts.within_cell, math.sqrt(2)), (counts.within_same_wall, reach)
        ):  # fmt: skip
            share = seen_by(expected, cells)[walls].mean() if walls.any() else None
            assert found == (share if share is None else pytest.approx(share))


def test_a_map_and_itself_less_than_a_tenth_of_a_cell_off_are_that_map():
    first = OccupancyGrid(room(), 0.05, (1.3, -0.2, 0.7))
    for shift, yaw in ((0.0004, 0.0), (-0.003, 0.00002)):
        merged = merge([first, first], transforms=[Transform(shift, shift, yaw)])
        np.testing.assert_array_equal(merged.grid.occupancy, first.occupancy)
        assert merged.grid.origin == first.origin
        assert merged.conflict_count == 0
    off = merge([first, first], transforms=[Transform(0.01, 0.0, 0.0)], same_wall=0).grid
    assert off.shape != first.shape


def test_a_wall_is_as_thin_as_before_and_a_closed_door_stays_closed():
    """Two walls a cell and a half apart; in the second map the door between rooms is closed."""
    first, second = (OccupancyGrid(room(), 0.05, (x, 0.0, 0.0)) for x in (0.0, 0.075))
    values = np.array(first.occupancy)
    values[10:26, 20] = 0
    first = first.with_values(values)
    merged = merge([first, second])
    assert merged.maps[1].same_wall == pytest.approx(0.05 * 2)  # a cell, where cells are sampled
    assert (np.asarray(merged.grid.occupancy)[10:26, 20:23] == 100).any(axis=1).all()
    assert merged.thickness < 1.3 * merged.maps[0].thickness
    assert merge([first, second], same_wall=0).thickness > 2 * merged.maps[0].thickness
    assert all(counts.within_same_wall == 1 for counts in merged.maps)
