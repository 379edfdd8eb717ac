"""Distances by blocks of rows: exact across borders, whatever the blocks."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapdeal.kernels.distance import halos_of, row_minima, runs_of, signed_distance
from strategies import masks

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("each_engine")]


@st.composite
def cut_masks(draw, longest=12):
    """A mask and the rows between which it is cut."""
    marked = draw(masks(longest))
    inner = draw(st.sets(st.integers(1, max(1, len(marked) - 1))))
    cuts = sorted({0, len(marked), *(row for row in inner if row < len(marked))})
    return marked, [slice(*pair) for pair in itertools.pairwise(cuts)]


def by_blocks(marked, blocks, **measure):
    halo = halos_of([runs_of(marked[block]) for block in blocks])
    parts = [
        signed_distance(marked[block], **measure, halo=one)
        for block, one in zip(blocks, halo, strict=True)
    ]
    return np.vstack(parts)


@given(cut=cut_masks(longest=40), clip=st.sampled_from([np.inf, 0.7]))
def test_blocks_equal_the_whole_bit_for_bit(cut, clip):
    marked, blocks = cut
    measure = {
        "scale": 0.05, "outside_shift": 0.0, "inside_shift": 0.05, "clip": clip, "gain": 1.5
    }  # fmt: skip
    whole = signed_distance(marked, **measure)
    assert by_blocks(marked, blocks, **measure).tobytes() == whole.tobytes()


@pytest.mark.parametrize(
    "shape", [(120_000, 3), pytest.param((3, 120_000), marks=pytest.mark.thorough)]
)
def test_squares_beyond_32_bits_are_exact(shape):
    marked = np.zeros(shape, dtype=bool)
    marked[0, 0] = True
    step = -(-shape[0] // 3)
    blocks = [slice(first, min(first + step, shape[0])) for first in range(0, shape[0], step)]
    measure = {"scale": 1.0, "outside_shift": 0.0, "inside_shift": 0.0}
    rows, cols = np.indices(shape)
    expected = np.hypot(rows, cols)
    expected[0, 0] = -1
    for distance in (by_blocks(marked, blocks, **measure), signed_distance(marked, **measure)):
        assert np.array_equal(distance, expected.astype(np.float32))


@pytest.mark.parametrize("rows", [0, 1 << 16])
def test_blocks_whose_runs_cannot_be_counted_are_refused(rows):
    with pytest.raises(ValueError, match="between 1 and 65535"):
        runs_of(np.zeros((rows, 1), dtype=bool))


@given(masks(), st.integers(0, 2**32 - 1))
def test_row_minima_equal_a_look_at_every_column(exists, seed):
    values = np.random.default_rng(seed).integers(0, 200, exists.shape)
    found = row_minima(values, exists)
    height, width = exists.shape
    for row, x in np.ndindex(height, width):
        candidates = [(x - i) ** 2 + int(values[row, i]) for i in range(width) if exists[row, i]]
        assert found[row, x] == min(candidates, default=np.iinfo(np.int64).max)
