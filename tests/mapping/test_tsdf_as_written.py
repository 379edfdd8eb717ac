"""Method tsdf as design document 004 lists it, against a walk through that listing."""

import math
from collections import deque

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import oracles
from engines import needs_compiled
from mapdeal import MapBuilder, build_map
from mapdeal.kernels.threads import use_threads
from mapdeal.mapping.evidence import Scans, crossings_of, thin_blocks, thin_surface
from oracles import line

RES = 0.25
DIRECTIONS = ((0, 1), (1, 0), (0, -1), (-1, 0))  # of a cell (row, col): along x first


def listed(poses, angles, ranges, shape, origin, resolution=RES):
    """The walls, the mean distances and their counts, beam by beam and cell by cell."""
    means, counts = np.zeros(shape), np.zeros(shape, int)

    def cell_at(sensor, angle, reach):
        x, y = sensor[0] + reach * math.cos(angle), sensor[1] + reach * math.sin(angle)
        return (math.floor((y - origin[1]) / resolution + 1e-9),
                math.floor((x - origin[0]) / resolution + 1e-9))  # fmt: skip

    def holds(cell):
        return 0 <= cell[0] < shape[0] and 0 <= cell[1] < shape[1]

    for (x, y, yaw), row in zip(poses, ranges, strict=True):
        for angle, r in zip(angles, row, strict=True):
            if not 0 < r < 30 or not holds(hit := cell_at((x, y), yaw + angle, r)):
                continue
            cut = 2 * resolution
            sensor = cell_at((x, y), 0.0, 0.0)
            far = cell_at((x, y), yaw + angle, r + 3 * cut)
            for cell in line(sensor, far if holds(far) else hit)[:-1]:
                if holds(cell):
                    away = math.sqrt((cell[1] - sensor[1]) ** 2 + (cell[0] - sensor[0]) ** 2)
                    share = max(-1.0, min(1.0, (r - away * resolution) / cut))
                    means[cell] = (counts[cell] * means[cell] + share) / (counts[cell] + 1)
                    counts[cell] += 1
    return searched(means), means, counts


def searched(means):
    """The walls that a search through the neighbours finds; its first cell is not marked."""
    walls, seen = np.zeros((2, *means.shape), bool)
    queue = deque([(0, 0)])
    while queue:
        node = queue.popleft()
        for down, right in DIRECTIONS:
            cell = node[0] + down, node[1] + right
            if min(cell) < 0 or cell[0] >= means.shape[0] or cell[1] >= means.shape[1]:
                continue
            if not seen[cell]:
                if means[cell] * means[node] < 0:
                    walls[cell if abs(means[cell]) < abs(means[node]) else node] = True
                seen[cell] = True
                queue.append(cell)
    return walls


@st.composite
def runs(draw):
    """Scans in and around a small grid, many of them along its axes, so that values are equal."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    scans, beams = draw(st.integers(1, 5)), draw(st.integers(1, 9))
    whole = draw(st.booleans())
    if whole:
        poses = np.column_stack([rng.integers(-4, 16, (scans, 2)) * RES,
                                 rng.integers(0, 4, scans) * math.pi / 2])  # fmt: skip
        angles = rng.integers(0, 4, beams) * math.pi / 2
        ranges = rng.integers(1, 14, (scans, beams)) * RES / 2
    else:
        poses = np.column_stack([rng.uniform(-1, 4, (scans, 2)), rng.uniform(-7, 7, scans)])
        angles = rng.uniform(-3, 3, beams)
        ranges = rng.uniform(0.1, 5, (scans, beams))
    odd = rng.random(ranges.shape) < 0.1
    return poses, angles, np.where(odd, rng.choice([math.nan, math.inf, -1, 0, 40]), ranges)


SHAPES = st.sampled_from([(8, 11), (11, 8), (1, 9), (9, 1), (1, 1), (6, 6)])


@given(run=runs(), shape=SHAPES)
def test_maps_and_layers_are_those_of_the_listing(run, shape):
    origin = (-0.5, 0.75)
    size = (shape[1] * RES, shape[0] * RES)
    built = build_map(*run, method="tsdf", as_written=True, resolution=RES, size=size,
                      origin=origin)  # fmt: skip
    walls, means, counts = listed(*run, shape, origin)
    np.testing.assert_array_equal(built.layers["weight"], counts)
    expected = np.where(counts > 0, means, np.nan).astype(np.float32)
    np.testing.assert_array_equal(built.layers["tsdf"], expected)
    np.testing.assert_array_equal(built.grid.occupancy, np.where(walls, 100, -1))


@pytest.mark.parametrize("run", ["0", "1"])
def test_an_independent_implementation_agrees(real_maps, run):
    """It compares all neighbours, and its line is another one."""
    with np.load(real_maps / "expected" / "peers.npz") as peers:
        poses, angles, ranges, expected = (
            peers[f"mapping/{run}/{name}"] for name in ("poses", "angles", "ranges", "tsdf")
        )
    built = build_map(poses, angles, ranges, method="tsdf", as_written=True, size=(22, 22),
                      origin=(-1, -1))  # fmt: skip
    field = np.nan_to_num(built.layers["tsdf"])
    walls = np.zeros(field.shape, bool)
    for lower, upper in ((np.s_[:-1], np.s_[1:]), (np.s_[:, :-1], np.s_[:, 1:])):
        changes = field[lower] * field[upper] < 0
        is_upper = np.abs(field[upper]) < np.abs(field[lower])
        walls[upper] |= changes & is_upper
        walls[lower] |= changes & ~is_upper
    assert np.count_nonzero(walls != (expected == 100)) <= 45 < 0.05 * walls.sum()
    assert set(np.unique(expected)) == set(np.unique(built.grid.occupancy)) == {-1, 100}
    assert not ((built.grid.occupancy == 100) & ~walls).any()


@needs_compiled
def test_both_engines_threads_and_parts_give_the_same_bytes(monkeypatch):
    rng = np.random.default_rng(8)
    poses = np.column_stack([rng.uniform(0, 5, (9, 2)), rng.uniform(-3, 3, 9)])
    scans = poses, np.linspace(-2, 2, 90), rng.uniform(1, 6, (9, 90))
    found = []
    for engine, threads in (("compiled", 1), ("compiled", 3), ("scipy", 1)):
        monkeypatch.setenv("MAPDEAL_KERNELS", engine)
        with use_threads(threads):
            built = build_map(*scans, method="tsdf", as_written=True)
            builder = MapBuilder(built.grid.frame, "tsdf", as_written=True)
            for k in range(0, 9, 2):
                builder.add(Scans(poses[k : k + 2], scans[1], scans[2][k : k + 2]))
        for result in (built, builder.result()):
            layers = (layer.tobytes() for layer in result.layers.values())
            found.append([result.grid.occupancy.tobytes(), *layers])
    assert all(each == found[0] for each in found)


def test_only_the_tsdf_has_it():
    scans = ([[0.0, 0.0, 0.0]], [0.0], [[1.0]])
    plain = build_map(*scans, method="tsdf", as_written=False)
    assert np.array_equal(plain.grid.occupancy, build_map(*scans, method="tsdf").grid.occupancy)


@st.composite
def fields(draw):
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    shape = draw(st.tuples(st.integers(1, 9), st.integers(1, 9)))
    field = rng.uniform(-1, 1, shape).round(1)
    if draw(st.booleans()):  # smooth, as fields of scans are
        rows, cols = np.indices(shape)
        field = (rows * rng.uniform(-1, 1) + cols * rng.uniform(-1, 1) + rng.uniform(-4, 4)) / 4
    field[rng.random(shape) < draw(st.sampled_from([0.0, 0.3]))] = np.nan
    return field


def pairs(field):
    """Neighbours of different sign, as pairs of cells."""
    for (row, col), value in np.ndenumerate(field):
        for other in ((row + 1, col), (row, col + 1)):
            if other[0] < field.shape[0] and other[1] < field.shape[1] and value * field[other] < 0:
                yield (row, col), other


@given(field=fields())
def test_places_are_where_a_line_between_two_cells_is_zero(field):
    expected = [(row + 0.5, col + 0.5) for (row, col), v in np.ndenumerate(field) if v == 0]
    for a, b in pairs(field):
        share = field[a] / (field[a] - field[b])
        expected.append(tuple(p + 0.5 + share * (q - p) for p, q in zip(a, b, strict=True)))
    found = crossings_of(field).places()
    assert len(found) == len(expected)
    if expected:  # in whatever order: sums that round otherwise would sort otherwise
        apart = np.abs(found[:, np.newaxis] - np.array(expected)).max(axis=2) > 1e-12
        assert not apart.all(axis=0).any()
        assert not apart.all(axis=1).any()


@given(field=fields())
def test_a_surface_is_made_of_the_nearer_cells_and_has_no_gap(field):
    """All cells that are nearer to zero than a neighbour of the other sign, but for spare ones."""
    nearer = field == 0
    for a, b in pairs(field):
        nearer[min((a, b), key=lambda cell: (abs(field[cell]), field[cell]))] = True
    found = thin_surface(field, crossings_of(field))
    assert not (found & ~nearer).any()
    blocks = nearer[1:, 1:] & nearer[1:, :-1] & nearer[:-1, 1:] & nearer[:-1, :-1]
    in_block = np.zeros(field.shape, bool)
    for row, col in np.argwhere(blocks).tolist():
        in_block[row : row + 2, col : col + 2] = True
    for a, b in pairs(field):  # no gap, but where blocks were thinned
        assert found[a] or found[b] or in_block[a] or in_block[b]
    assert found.any() == nearer.any()
    assert found[field == 0].sum() >= (field == 0).sum() - in_block.sum()


@given(seed=st.integers(0, 2**32 - 1), density=st.sampled_from([0.3, 0.5, 0.7, 0.9]))
def test_thinned_blocks_are_as_connected_as_before(seed, density):
    rng = np.random.default_rng(seed)
    before = rng.random((8, 9)) < density
    after = before.copy()
    thin_blocks(after, rng.random(before.shape))
    assert not (after & ~before).any()
    walls = [len(list(oracles.groups(mask))) for mask in (before, after)]
    assert walls[0] == walls[1]
    # and what is open stays parted: no two rooms become one, the outside being one
    opened = [np.pad(~mask, 1, constant_values=True) for mask in (before, after)]
    rooms = [len(list(oracles.groups(mask, oracles.EDGES))) for mask in opened]
    assert rooms[0] == rooms[1]


def test_a_block_of_four_loses_the_cells_farthest_from_zero():
    block = np.ones((2, 2), bool)
    thin_blocks(block, np.array([[0.1, 0.4], [0.2, 0.3]]))
    assert block.tolist() == [[True, False], [True, True]]


def test_a_spare_cell_is_left_out_on_any_side_of_its_partners():
    row = np.array([[0.1, -0.2, 0.3]])
    for field in (row, row[:, ::-1], row.T, row.T[::-1]):
        found = thin_surface(field, crossings_of(field))
        assert np.array_equal(found, field == -0.2)
