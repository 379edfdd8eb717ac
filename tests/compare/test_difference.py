"""Differences between two maps, against a comparison in plain Python; their faults."""

import json
import math
from collections import deque

import numpy as np
import pytest
from hypothesis import example, given, strategies as st
from hypothesis.extra import numpy as arrays
from PIL import Image

from compare.buildings import WALLS, drawn
from compare.test_bend import bent
from drawn import grid_from_text
from mapdeal import Costmap, OccupancyGrid, diff, score, write_map
from mapdeal.compare import difference
from mapdeal.compare.difference import SIZES, STATES, SYMMETRIES, compare, compare_costmaps
from mapdeal.compare.score import NO_FAULT, faults_of, states_of, verdict
from mapdeal.grid.values import occupancy_from_cost
from mapdeal.pictures.styles import cost_change_codes, cost_change_style
from strategies import occupancies

RES = 0.5
RNG = np.random.default_rng(4)
COSTS = st.sampled_from([0, 0, 1, 9, 10, 50, 59, 128, 252, 253, 254, 255, 255])


def state(value):
    return 0 if value == 100 else 1 if value == 0 else 2 if value < 0 else 3


def change_of(first, second):
    if first == second:
        free, unknown = difference.BOTH_FREE, difference.BOTH_UNKNOWN
        return (difference.COMMON, free, unknown, free)[first]
    if second == 0:
        return difference.ADDED
    return difference.REMOVED if first == 0 else difference.CHANGED


@example(
    a=np.int8([[100, 0, -1, 100], [0, -1, 50, 0]]), shift=(-1, 1), tolerance=0, yaw=0.7,
    b=np.int8([[-1, 0, 0], [100, -1, 100], [0, -1, 50]]), bounds=(0.5, 30),
)  # fmt: skip
@example(
    a=np.int8([[100, 0, 0], [0, 0, 0]]), b=np.int8([[0, 0, 0], [0, 0, 100]]), shift=(0, 0),
    tolerance=2, yaw=0.7, bounds=(0.5, 30),
)  # fmt: skip
@given(
    a=occupancies(7), b=occupancies(7), shift=st.tuples(st.integers(-4, 4), st.integers(-4, 4)),
    tolerance=st.sampled_from([0, 1, 1.5, 2.9]), yaw=st.sampled_from([0.0, 0.7]),
    bounds=st.tuples(st.floats(0, 4), st.floats(0, 100)),
)  # fmt: skip
def test_cells_are_compared_where_both_maps_have_some(a, b, shift, tolerance, yaw, bounds):
    """Maps on one lattice; `shift` is the offset of `b` in rows and columns."""
    first = OccupancyGrid(a, RES, (1.0, -2.0, yaw))
    second = OccupancyGrid(b, RES, first.frame.window(*shift, *b.shape).origin)
    found = compare(first, second, tolerance=tolerance)
    cells = {
        (r, c): (a[r, c], b[r - shift[0], c - shift[1]])
        for r, c in np.ndindex(a.shape)
        if 0 <= r - shift[0] < b.shape[0] and 0 <= c - shift[1] < b.shape[1]
    }
    confusion = np.zeros((4, 4), int)
    for x, y in cells.values():
        confusion[state(x), state(y)] += 1
    table = [[found.confusion[row][col] for col in STATES] for row in STATES]
    np.testing.assert_array_equal(table, confusion)
    assert found.common_cells == len(cells)
    assert found.differing == sum(x != y for x, y in cells.values())
    changes = np.full(found.changes.shape, difference.OUTSIDE)
    for (r, c), (x, y) in cells.items():
        changes[r - min(shift[0], 0), c - min(shift[1], 0)] = change_of(state(x), state(y))
    np.testing.assert_array_equal(found.changes, changes)

    def like_near(cell, own, cells_of_other):
        expected = state(cells[cell][own])
        return any(
            state(pair[cells_of_other]) == expected
            and (place[0] - cell[0]) ** 2 + (place[1] - cell[1]) ** 2 <= tolerance**2
            for place, pair in cells.items()
        )

    beyond = sum(
        x != y and (tolerance == 0 or not (like_near(cell, 0, 1) and like_near(cell, 1, 0)))
        for cell, (x, y) in cells.items()
    )
    assert found.beyond_tolerance == beyond
    assert found.is_equal == (a.shape == b.shape and shift == (0, 0) and beyond == 0)
    walls = [[cell for cell, pair in cells.items() if pair[which] == 100] for which in (0, 1)]
    obstacles = [
        [(r + shift[0], c + shift[1]) for r, c in np.argwhere(b == 100).tolist()],
        np.argwhere(a == 100).tolist(),
    ]
    shifts = (found.first_to_second, found.second_to_first)
    farthest = [0.0]
    for shift_of, wall, cells_of_other in zip(shifts, walls, obstacles, strict=True):
        if not wall or not cells_of_other:
            assert shift_of is None
            farthest.append(math.inf if wall else 0.0)
            continue
        distances = [min(math.dist(p, q) for q in cells_of_other) * RES for p in wall]
        assert shift_of.largest == pytest.approx(max(distances), abs=1e-9)
        assert shift_of.mean == pytest.approx(np.mean(distances), abs=1e-9)
        assert shift_of.percentile_95 == pytest.approx(np.percentile(distances, 95), abs=1e-9)
        farthest.append(max(distances))
    # and the bounds that hold
    known = {cell for cell, value in np.ndenumerate(a) if value >= 0}
    assert found.not_compared == len(known - set(cells))
    share = 100 * beyond / len(cells) if cells else math.nan
    most = max(farthest) if cells else math.nan
    judged = zip(found.bounds_of(*bounds), bounds, (most, share), strict=True)
    for bound, allowed, expected in judged:
        assert bound.found == pytest.approx(expected, nan_ok=True)
        if not abs(allowed - expected) <= 1e-6:
            assert bound.holds == (expected <= allowed)


def test_a_map_of_another_resolution_is_looked_up_at_the_centres():
    coarse = OccupancyGrid([[100, 0, -1]], 0.4, (1.0, 2.0, 0.3))
    fine = OccupancyGrid(np.repeat(np.repeat(coarse.occupancy, 2, 0), 2, 1), 0.2, coarse.origin)
    for a, b, cells in ((fine, coarse, 12), (coarse, fine, 3)):
        found = compare(a, b)
        assert (found.common_cells, found.differing, found.beyond_tolerance) == (cells, 0, 0)
        assert set(found.geometry) == {"width", "height", "resolution"}
        assert not found.is_equal


@pytest.mark.parametrize("shape", [(12, 17), (14, 14)])
@pytest.mark.parametrize("name", [None, *SYMMETRIES])
def test_a_mirrored_or_turned_map_is_recognised(shape, name):
    first = OccupancyGrid(np.random.default_rng(3).choice([0, 100, -1], shape), 0.1)
    if name is None:
        assert compare(first, first).symmetry is None
        return
    undone = {"turned by 90 degrees": "turned by -90 degrees",
              "turned by -90 degrees": "turned by 90 degrees"}.get(name, name)  # fmt: skip
    assert compare(first, OccupancyGrid(SYMMETRIES[name](first.occupancy), 0.1)).symmetry == undone


@pytest.mark.parametrize(("cells", "symmetry"), [
    ([-1, 0, 0, 0], None),  # 2 cells agree, mirrored 3: one of two differences is gone
    ([-1, 0, 0, 100], "mirrored left to right"),
])  # fmt: skip
def test_a_map_counts_as_mirrored_if_more_than_half_of_the_differences_vanish(cells, symmetry):
    first = OccupancyGrid([[100, 0, 0, -1]], 0.5)
    assert compare(first, OccupancyGrid([cells], 0.5)).symmetry == symmetry


def test_six_cells_are_as_far_as_one_writes_it():
    first = grid_from_text("#.......", 0.05)
    second = grid_from_text("......#.", 0.05)
    assert diff(first, second, max_shift=0.3).passes
    assert not diff(first, second, max_shift=0.2999).passes


@pytest.fixture
def walls(tmp_path, monkeypatch):
    """Write a map, one with the wall two cells to the right, a smaller one and a distant one."""
    monkeypatch.chdir(tmp_path)
    drawn = {"a": "...#......", "b": ".....#....", "part": "...#...", "empty": ".........."}
    for name, text in drawn.items():
        write_map(f"{name}.yaml", grid_from_text(text, 0.25, (1.0, -2.0, 0.3)))
    write_map("far.yaml", grid_from_text(drawn["a"], 0.25, (50.0, 0.0, 0.3)))


@pytest.mark.parametrize(("words", "code"), [
    ("a b --max-differing 20 --max-shift 0.49", 1), ("a b --max-differing 19.9 --max-shift 0.5", 1),
    ("a b --max-differing 20 --max-shift 0.5", 0), ("a b --max-differing 0 --tolerance 2", 0),
    ("a part", 1), ("a part --max-shift 0 --max-differing 0", 0),
    ("a far --max-shift 1000 --max-differing 100", 1), ("a empty --max-shift 1000", 1),
    ("empty a --max-shift 1000", 1), ("empty empty --max-shift 0 --max-differing 0", 0),
])  # fmt: skip
def test_the_exit_code_is_that_of_the_bounds(command, walls, words, code):
    first, second, *options = words.split()
    assert command("diff", f"{first}.yaml", f"{second}.yaml", *options)[0] == code


def test_the_text_says_what_differs_and_names_the_missed_bound(command, walls):
    _, out, err = command("diff", "a.yaml", "b.yaml", "--max-shift", "0.1", "--max-differing", "50")
    lines = out.splitlines()
    assert err == ""
    assert lines[:5] == [
        "a.yaml, b.yaml: different, beyond the bounds",
        "  cells     10 in both, 2 differ; rows: A, columns: B",
        "                            occupied        free",
        "                occupied           0           1",
        "                    free           1           8",
    ]
    assert lines[-6:] == [
        "  added     0.0625 m2 at 2.27665,-1.47424",
        "  removed   0.0625 m2 at 1.79898,-1.622",
        "  walls     directed Hausdorff distance A to B: 0.5 m; 95 % within 0.5 m, mean 0.5 m",
        "  walls     directed Hausdorff distance B to A: 0.5 m; 95 % within 0.5 m, mean 0.5 m",
        "  bound     --max-shift 0.1 m: missed, found 0.5 m",
        "  bound     --max-differing 50 %: holds, found 20 %",
    ]
    _, out, _ = command("diff", "a.yaml", "far.yaml")
    assert "  geometry  origin [1.0, -2.0, 0.3] -> [50.0, 0.0, 0.3]" in out.splitlines()


def test_bounds_are_in_the_document_without_infinity(command, walls):
    words = ["--max-shift", "9", "--max-differing", "50", "--json"]
    code, out, _ = command("diff", "a.yaml", "empty.yaml", *words)
    document = json.loads(out)
    assert (code, document["passes"], document["equal"]) == (1, False, False)
    assert document["bounds"] == {
        "max_shift": {"allowed": 9.0, "found": None, "holds": False},
        "max_differing": {"allowed": 50.0, "found": 10.0, "holds": True},
    }


def test_the_picture_has_what_is_added_and_removed(command, walls):
    assert command("diff", "a.yaml", "b.yaml", "--image", "d.png")[0] == 1
    pixels = np.asarray(Image.open("d.png").convert("RGB"))
    for colour in ((0, 120, 220), (225, 30, 60)):
        assert np.all(pixels == colour, axis=2).sum() > 1000


@pytest.fixture(scope="module")
def true_map():
    return drawn(WALLS, 0.1)


def without_a_quarter(values):
    height, width = values.shape
    values[height // 2 :, width // 2 :] = -1


def with_ghosts(values):
    walls = np.zeros_like(values, dtype=bool)
    walls[:, 6:100] = values[:, :94] == 100
    values[walls & (values == 0)] = 100


def with_noise(values):
    values[(values == 0) & (RNG.random(values.shape) < 0.02)] = 100


def faded(values):
    walls = values == 100
    walls[:, 120:] = False
    values[walls] = -1


CASES = {
    "missing area": without_a_quarter, "ghost walls": with_ghosts, "noisy": with_noise,
    "faded walls": faded, NO_FAULT: np.asarray,
}  # fmt: skip


@pytest.mark.parametrize("kind", CASES)
def test_the_worst_fault_names_the_verdict(true_map, kind):
    values = np.array(true_map.occupancy)
    CASES[kind](values)
    found = faults_of(states_of(values), states_of(true_map.occupancy), true_map.frame)
    assert verdict(found) == kind


def test_amount_and_place_of_what_is_missing(true_map):
    values = np.array(true_map.occupancy)
    without_a_quarter(values)
    wrong = true_map.with_values(values)
    missing = (np.asarray(true_map.occupancy) == 0) & (values == -1)
    result = score(wrong, true_map)
    (fault,) = (fault for fault in result.faults if fault.kind == "missing area")
    assert fault.amount == pytest.approx(missing.sum() * 0.01)
    assert fault.place.startswith("in the north-east")
    assert result.document()["verdict"] == "missing area"
    assert any("verdict   missing area: " in line for line in result.lines())
    assert diff(true_map, wrong).faults == result.faults
    assert diff(true_map, true_map).faults == ()


def test_a_bent_map_is_bent_and_has_no_ghosts(true_map):
    wrong = bent(true_map, 0.4)
    found = faults_of(states_of(wrong.occupancy), states_of(true_map.occupancy), true_map.frame)
    assert verdict(found) == "bent"
    assert found[0].amount == pytest.approx(0.4, abs=0.12)
    assert "ghost walls" not in {fault.kind for fault in found}


@pytest.mark.parametrize("axis", range(3))
def test_origins_are_equal_up_to_the_digits_of_an_alignment(axis):
    first = OccupancyGrid([[0, 100, -1]], RES, (1.0, -2.0, 0.3))
    for cells, is_equal in ((5e-6, True), (2e-5, False)):
        moved = np.array(first.origin) + np.eye(3)[axis] * cells * RES
        assert compare(first, OccupancyGrid(first.occupancy, RES, moved)).is_equal == is_equal


def costs(longest=6):
    sizes = st.integers(1, longest)
    shapes = st.tuples(sizes, sizes)
    return shapes.flatmap(lambda shape: arrays.arrays(np.uint8, shape, elements=COSTS))


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
    first = Costmap(a, RES, (1.0, -2.0, yaw))
    result = compare_costmaps(first, Costmap(b, RES, first.frame.window(*shift, *b.shape).origin))
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
        assert (change.cells, change.area) == (len(cells), len(cells) * RES**2)
        groups = regions_of(cells)
        assert change.regions == len(groups)
        assert [len(region.cells) for region in change.largest] == [len(group) for group in groups]
        own = {tuple(cell) for region in change.largest for cell in region.cells.tolist()}
        assert own == {(r - min(shift[0], 0), c - min(shift[1], 0)) for r, c in cells}
        for region in change.largest:
            place = result.frame.bounded_rowcol_from_xy([(region.x, region.y)])[0][0]
            assert place.tolist() in region.cells.tolist()
        if change.kind in ("rose", "fell"):
            sizes = [abs(pairs[cell][0] - pairs[cell][1]) for cell in cells]
            assert change.by_size == {
                f"{low}-{high}": sum(low <= size <= high for size in sizes) for low, high in SIZES
            }
        else:
            assert change.by_size == {}


def test_every_pair_of_costs_has_the_colour_of_its_change():
    first, second = np.indices((256, 256), dtype=np.uint8)
    result = compare_costmaps(Costmap(first, RES), Costmap(second, RES))
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
    published, first = occupancy_from_cost()[costs], Costmap(costs, RES)
    second = Costmap(published, RES, scale="occupancy")
    for pair in ((first, second), (second, first), (second, second)):
        result = compare_costmaps(*pair)
        assert (result.is_equal, result.scale) == (True, "occupancy")
    open_ = published.copy()
    open_[published >= 99] = 98
    result = compare_costmaps(second, Costmap(open_, RES, scale="occupancy"))
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
