import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

import oracles
from engines import needs_compiled
from mapdeal.kernels import engine
from mapdeal.kernels.lookup import interpolate

VALUES = arrays.arrays(
    np.float32,
    arrays.array_shapes(min_dims=2, max_dims=2, max_side=6),
    elements=st.floats(-100, 100, width=32),
)
ANY_VALUES = arrays.arrays(np.float32, (3, 4), elements=st.floats(width=32, allow_nan=False))
SHARES = arrays.arrays(np.float64, (7, 2), elements=st.floats(0, 1))


@given(VALUES, SHARES)
def test_values_and_slopes_are_those_of_the_formula(each_engine, values, shares):
    places = shares * values.shape
    between, slopes = interpolate(values, places)
    for place, value, slope in zip(places.tolist(), between, slopes, strict=True):
        expected = oracles.bilinear(values, *place)
        assert (value, *slope) == pytest.approx(expected, abs=1e-10)


@pytest.mark.parametrize("place", [(np.nan, 1), (1, np.inf), (-1e300, 1), (-1.1, 0.5), (9, 1)])
def test_far_outside_there_is_nothing(each_engine, place):
    between, slopes = interpolate(np.ones((2, 3), np.float32), np.array([place, (1.0, 1.0)]))
    assert np.isnan(between[0])
    assert np.isnan(slopes[0]).all()
    assert between[1] == 1


def test_near_an_infinite_value_the_nearest_cell_tells_and_there_is_no_slope(each_engine):
    values = np.array([[np.inf, 2.0, 3.0]], dtype=np.float32)
    between, slopes = interpolate(values, np.array([[0.5, 0.9], [0.5, 1.1], [0.5, 2.0]]))
    assert between.tolist() == [np.inf, 2.0, 2.5]
    assert np.isnan(slopes[:2]).all()
    assert slopes[2].tolist() == [0.0, 1.0]
    between, _ = interpolate(values.T.copy(), np.array([[0.9, 0.5], [1.1, 0.5]]))
    assert between.tolist() == [np.inf, 2.0]


@needs_compiled
@given(ANY_VALUES, arrays.arrays(np.float64, (9, 2), elements=st.floats(-2, 6) | st.just(np.nan)))
def test_both_engines_give_the_same_bytes(values, places):
    results = []
    for name in ("compiled", "scipy"):
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv(engine.VARIABLE, name)
            results.append([part.tobytes() for part in interpolate(values, places)])
    assert results[0] == results[1]


def test_halfway_from_an_infinite_value_the_later_cell_is_the_nearest(each_engine):
    values = np.array([[np.inf, 2.0]], dtype=np.float32)
    for layer, place in ((values, (0.5, 1.0)), (values.T.copy(), (1.0, 0.5))):
        between, _ = interpolate(layer, np.array([place]))
        assert between.tolist() == [2.0]


def test_the_outermost_cells_go_on_for_one_cell_that_ends_there(each_engine):
    values = np.array([[1, 2, 4], [1, 3, 9]], dtype=np.float32)
    places = [(-1.0, 0.5), (3.0, 0.5), (0.5, -1.0), (0.5, 4.0), (3.0, 4.0)]
    assert interpolate(values, np.array(places))[0].tolist() == [1.0, 1.0, 1.0, 4.0, 9.0]
    beyond = [(-1.001, 0.5), (3.001, 0.5), (0.5, -1.001), (0.5, 4.001)]
    assert np.isnan(interpolate(values, np.array(beyond))[0]).all()
