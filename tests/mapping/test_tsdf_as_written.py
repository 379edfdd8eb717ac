"""Method tsdf as design document 004 lists it, against a walk through that listing."""

import math
from collections import deque

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from engines import needs_compiled
from mapdeal import MapBuilder, ParameterError, build_map
from mapdeal.kernels.threads import use_threads
from mapdeal.mapping.evidence import Scans
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


def test_a_wall_across_a_row_is_found_in_the_first_row_alone():
    """The search comes to all other cells from the row before."""
    poses = [[0.5, 0.5, 0.0], [0.5, 1.5, 0.0], [0.5, 1.5, math.pi / 2]]
    built = build_map(poses, [0.0], [[3.2], [3.2], [2.2]], method="tsdf", as_written=True,
                      resolution=1.0, size=(12, 12), origin=(0, 0))  # fmt: skip
    assert np.argwhere(built.grid.occupancy == 100).tolist() == [[0, 3], [3, 0]]
    assert built.layers["tsdf"][1, 2:5] == pytest.approx([0.6, 0.1, -0.4])


@pytest.mark.parametrize("yaw", [0.0, math.pi / 2])
def test_the_search_comes_back_to_its_first_cell(yaw):
    """Of two equal cells that which it comes from is a wall; these two are compared both ways."""
    size = (1, 12) if yaw else (12, 1)
    built = build_map([[0.5, 0.5, yaw]], [0.0], [[0.5]], method="tsdf", as_written=True,
                      resolution=1.0, size=size, origin=(0, 0))  # fmt: skip
    assert built.layers["tsdf"].reshape(-1)[:4].tolist() == [0.25, -0.25, -0.75, -1.0]
    assert built.grid.occupancy.reshape(-1).tolist() == [100, 100] + [-1] * 10


def test_beams_end_at_their_hit_where_the_far_point_lies_outside():
    scans = ([[0.5, 0.5, 0.0]], [0.0], [[3.2]])
    size = {"resolution": 1.0, "origin": (0, 0), "method": "tsdf"}
    short = build_map(*scans, **size, size=(9, 1), as_written=True)
    assert short.layers["weight"].tolist() == [[1] * 3 + [0] * 6]
    assert build_map(*scans, **size, size=(10, 1), as_written=True).layers["weight"].sum() == 9
    # a hit outside says nothing
    beyond = build_map(*scans, **size, size=(3, 1), as_written=True)
    assert not beyond.layers["weight"].any()


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
    with pytest.raises(ParameterError, match="as_written: does not apply to method counting"):
        build_map(*scans, method="counting", as_written=True)
    plain = build_map(*scans, method="tsdf", as_written=False)
    assert np.array_equal(plain.grid.occupancy, build_map(*scans, method="tsdf").grid.occupancy)
