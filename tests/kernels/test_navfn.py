"""NavFn's search and trace: both engines, and what holds of every potential."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from engines import needs_compiled
from kernels.conftest import by_each_engine
from mapdeal.kernels.navfn import UNREACHED, cost_table, potentials, traced_path


@st.composite
def searches(draw):
    """A costmap of blobs, a start, a target, and whether unknown cells are open."""
    shape = draw(st.integers(3, 40)), draw(st.integers(3, 40))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    smooth = ndimage.gaussian_filter(rng.random(shape), draw(st.sampled_from([0.5, 1.5, 3])))
    ranks = smooth.ravel().argsort().argsort().reshape(shape) / smooth.size
    costs = np.clip((ranks - 0.3) * 360, 0, 255).astype(np.uint8)
    start, target = (tuple(rng.integers(0, shape[::-1]).tolist()) for _ in range(2))
    return costs, start, target, draw(st.booleans())


def searched(search, is_astar):
    costs, start, target, allow_unknown = search
    found = potentials(costs, start, target, allow_unknown=allow_unknown, is_astar=is_astar)
    return found, *traced_path(found, start, target, turns=4 * max(costs.shape))


@needs_compiled
@given(searches(), st.booleans())
def test_both_engines_give_the_same_bytes(search, is_astar):
    def as_bytes():
        found, path, outcome = searched(search, is_astar)
        return found.tobytes(), path.tobytes(), outcome

    compiled, twin = by_each_engine(as_bytes)
    assert compiled == twin


@given(searches(), st.booleans())
def test_cells_are_reached_only_where_open_cells_lead_to_them(each_engine, search, is_astar):
    costs, start, _, allow_unknown = search
    found, path, outcome = searched(search, is_astar)
    is_open = cost_table(allow_unknown)[costs] < 254
    is_open[[0, -1]] = is_open[:, [0, -1]] = False
    is_open[start[::-1]] = True
    labels = ndimage.label(is_open)[0]
    is_reached = found < UNREACHED
    assert not (is_reached & (labels != labels[start[::-1]])).any()
    if outcome == "found":
        assert (path[-1] == start).all()
        assert np.hypot(*np.diff(path, axis=0).T).max(initial=0) < 3


def test_a_path_in_the_open_is_straight(each_engine):
    costs = np.zeros((9, 31), np.uint8)
    found = potentials(costs, (3, 4), (20, 4), allow_unknown=True, is_astar=False)
    assert found[4, 20] == 17 * 50
    path, outcome = traced_path(found, (3, 4), (20, 4), turns=124)
    assert outcome == "found"
    assert path[[0, -1]].tolist() == [[20, 4], [3, 4]]
    assert np.ptp(path[:, 1]) == 0
