"""The compiled flood through poses beside its twin, where it is at its limits."""

import numpy as np
import pytest

from engines import needs_compiled
from mapdeal.grid.footprint import Footprint, footprint_spans
from mapdeal.grid.frame import Frame
from mapdeal.kernels.paths import ConfigurationSpace
from mapdeal.kernels.polygons import Spans
from mapdeal.kernels.threads import use_threads

pytestmark = needs_compiled

A_CELL = Spans(np.array([0]), np.array([0]), np.array([1]))


def random_case(rng, shape):
    """Rooms with a few doors and rubbish in them, and rectangles turned a little."""
    blocked = rng.random(shape) < 0.01
    blocked[:: shape[0] // 3] = blocked[:, :: shape[1] // 5] = True
    for _ in range(60):
        row, col = rng.integers(0, shape[0]), rng.integers(0, shape[1])
        blocked[row : row + 9, col : col + 9] = False
    robot = Footprint.polygon([[0.3, 0.1], [0.3, -0.1], [-0.2, -0.1], [-0.2, 0.1]])
    frame = Frame(*shape, 0.05, (0.0, 0.0, 0.3))
    spans = footprint_spans(robot, frame, int(rng.integers(4, 30)))
    seeds = [
        (int(rng.integers(len(spans))), int(rng.integers(shape[0])), int(rng.integers(shape[1])))
        for _ in range(40)
    ]
    return blocked, spans, seeds


@pytest.mark.parametrize("seed", [0, 3, 4, 5])
def test_both_engines_give_the_same_bytes_with_any_threads(monkeypatch, seed):
    rng = np.random.default_rng(seed)
    shape = [(97, 300), (300, 97), (40, 960), (33, 1100), (200, 64), (65, 2048)][seed]
    blocked, spans, seeds = random_case(rng, shape)
    cells = [(row, col) for _, row, col in seeds]
    results = []
    for engine, threads in (("scipy", 1), ("compiled", 1), ("compiled", 3)):
        monkeypatch.setenv("MAPDEAL_KERNELS", engine)
        with use_threads(threads):
            space = ConfigurationSpace(blocked, spans)
            opened = [space.open_headings(*cell) for cell in cells]
            found = space.reach(seeds, cells)
        results.append((space.headings, np.array(opened), found.reachable, found.headings))
    assert 0 < results[0][2].sum() < results[0][2].size
    for other in results[1:]:
        for one, same in zip(results[0], other, strict=True):
            np.testing.assert_array_equal(one, same)
            assert one.dtype == same.dtype


@pytest.fixture
def rounds(monkeypatch):
    """Let few words of cells wait at a time, and return how often that were too few."""
    from mapdeal.kernels import compiled

    counted, flood = [], compiled.flood

    def counting(*words):
        counted.append(flood(*words))

    monkeypatch.setattr(compiled, "_FEWEST_WAITING", 4)
    monkeypatch.setattr(compiled, "_SHARE_WAITING", 1 << 30)
    monkeypatch.setattr(compiled, "flood", counting)
    monkeypatch.setenv("MAPDEAL_KERNELS", "compiled")
    return counted


def test_what_finds_no_room_to_wait_is_not_lost(rounds, monkeypatch):
    rng = np.random.default_rng(5)
    blocked, spans, seeds = random_case(rng, (60, 1500))
    compiled = ConfigurationSpace(blocked, spans).reach(seeds)
    assert rounds[0] > 0
    monkeypatch.setenv("MAPDEAL_KERNELS", "scipy")
    twin = ConfigurationSpace(blocked, spans).reach(seeds)
    np.testing.assert_array_equal(compiled.reachable, twin.reachable)


@pytest.mark.parametrize("along", [False, True])
def test_combs_are_reached_to_the_tips(rounds, along):
    blocked = np.zeros((150, 1500), dtype=bool)
    ways = blocked if along else blocked.T
    ways[1::2, 1:] = True
    found = ConfigurationSpace(blocked, [A_CELL] * 5).reach([(2, 0, 0)])
    np.testing.assert_array_equal(found.reachable, ~blocked)
    assert rounds[0] > 0
