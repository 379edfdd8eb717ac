"""Labelled components against flooding in plain Python."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapdeal.kernels import components
from mapdeal.kernels.components import labelled
from strategies import masks


def flooded(marked, steps):
    """The components of marked cells as sets, each found from a cell that is left."""
    left = {tuple(cell) for cell in np.argwhere(marked).tolist()}
    while left:
        group, edge = set(), [left.pop()]
        while edge:
            r, c = edge.pop()
            group.add((r, c))
            near = {(r + i, c + j) for i, j in steps} & left
            left -= near
            edge += near
        yield frozenset(group)


EDGES = [(0, 1), (1, 0), (0, -1), (-1, 0)]
CORNERS = [*EDGES, (1, 1), (1, -1), (-1, 1), (-1, -1)]


@given(masks(), masks(), st.booleans(), st.sampled_from([1, 13, 1 << 20]))
def test_components_are_those_of_a_flood(marked, others, corners, together):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(components, "_CELLS_TOGETHER", together)  # counted in bands of rows
        found = labelled(marked, corners=corners)
        chosen = np.arange(len(found.sizes)) % 2 == 1
        cells = found.cells_of(chosen)
    expected = set(flooded(marked, CORNERS if corners else EDGES))
    groups = {
        frozenset(map(tuple, np.argwhere(found.cells == label).tolist())): label
        for label in range(1, len(found.sizes))
    }
    assert set(groups) == expected
    assert found.sizes[0] == 0
    assert all(found.sizes[label] == len(group) for group, label in groups.items())
    assert np.array_equal(cells, found.cells % 2 == 1)
    touching = np.resize(others, marked.shape)
    touched = {label for g, label in groups.items() if any(touching[cell] for cell in g)}
    assert set(np.flatnonzero(found.touched_by(touching)).tolist()) == touched
