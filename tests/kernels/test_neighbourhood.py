import numpy as np
from hypothesis import given
from hypothesis import strategies as st

import oracles
from mapdeal.kernels.components import drop_small_groups
from strategies import masks


@given(masks(), st.integers(0, 6))
def test_small_groups_are_dropped_whole(marked, least):
    expected = np.zeros_like(marked)
    for group in oracles.groups(marked):
        for cell in group if len(group) >= least else ():
            expected[cell] = True
    assert np.array_equal(drop_small_groups(marked, least), expected)
