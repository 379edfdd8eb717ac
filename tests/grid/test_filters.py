import pytest
from hypothesis import given, strategies as st

from mapdeal import ParameterError
from mapdeal.grid.filters import FilterInfo, info_for


def nav2_limit(info, value):
    """The limit that SpeedFilter::process publishes, None for NO_SPEED_LIMIT."""
    if value <= 0:
        return None
    limit = value * info.multiplier + info.base
    if limit < 0 or (info.type == 1 and limit > 100):
        return None
    return limit or None


@given(
    st.lists(st.integers(1, 99), min_size=1, max_size=5), st.sampled_from([0.01, 0.05, 0.25]),
    st.sampled_from(["percent", "m/s"]),
)  # fmt: skip
def test_the_filter_gets_the_requested_speeds(numbers, step, unit):
    speeds = [float(n) if unit == "percent" else n * step for n in numbers]
    info = info_for("speed", speeds, unit=unit)
    for speed in speeds:
        value, is_exact = info.value_of(speed)
        limit = nav2_limit(info, value)
        assert limit == info.limit_of(value)
        assert limit <= speed + 1e-9
        if unit == "percent" or max(speeds) <= 1:
            assert is_exact
        assert abs(limit - speed) < 1e-6 or not is_exact


def test_a_speed_that_a_mask_cannot_hold_is_rounded_down_or_refused():
    percent, metres = info_for("speed", [33.3]), info_for("speed", [0.5, 700.0], unit="m/s")
    assert (percent.base, percent.multiplier) == (100.0, -1.0)
    assert percent.value_of(33.3) == (67, False)
    assert metres.multiplier == 7.0
    assert info_for("speed", [1.25, 0.2], unit="m/s").multiplier == 0.05  # by 0.02, 1.25 is not
    for info, speed in ((percent, 0.5), (percent, 120.0), (metres, 0.5)):
        with pytest.raises(ParameterError, match="must be"):
            info.value_of(speed)
    assert info_for("speed", [1.2], unit="m/s", base=1.0, multiplier=0.1).value_of(1.2) == (2, True)


@pytest.mark.parametrize("info", [FilterInfo("keepout"), FilterInfo("speed", "m/s", 0.5, 0.25)])
def test_the_yaml_says_how_a_mask_is_read(info):
    assert FilterInfo.of(info.entries()) == info
    assert FilterInfo.of({"filter": "speed"}) is None
    assert FilterInfo.of({**info.entries(), "filter": "other"}) is None
