"""Random grids for property tests."""

import numpy as np
from hypothesis import strategies as st

RESOLUTIONS = st.sampled_from([0.05, 0.1, 0.025, 0.3, 2.0, 0.0504])


@st.composite
def masks(draw, longest=12):
    """Boolean grids of any density, 1 x 1 up to longest x longest."""
    height, width = draw(st.integers(1, longest)), draw(st.integers(1, longest))
    density = draw(st.sampled_from([0.0, 0.03, 0.2, 0.5, 0.9, 1.0]))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    return rng.random((height, width)) < density


@st.composite
def occupancies(draw, longest=12):
    """Occupancy arrays that mix free, occupied, unknown and values in between."""
    height, width = draw(st.integers(1, longest)), draw(st.integers(1, longest))
    weights = draw(
        st.sampled_from([(6, 2, 2, 1), (1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (9, 1, 0, 0)])
    )
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    share = np.array(weights) / sum(weights)
    return rng.choice([0, 100, -1, 50], size=(height, width), p=share).astype(np.int8)
