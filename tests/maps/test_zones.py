import json
import warnings

import numpy as np
import pytest
from hypothesis import given, strategies as st

from mapdeal import MalformedInputError, MapdealWarning, OccupancyGrid, ParameterError
from mapdeal.grid.filters import FilterInfo, info_for
from mapdeal.maps.zones import filter_mask, read_zones
from maps.geojson import collection, feature, geometry

GRID = OccupancyGrid(np.zeros((30, 40), np.int8), 0.25, (1.0, -2.0, 0.0))


def zone(x=3.0, y=-1.0, side=2.0, **properties):
    corners = [[x, y], [x + side, y], [x + side, y + side], [x, y + side], [x, y]]
    return feature(geometry("Polygon", [corners]), **properties)


@pytest.fixture
def zones(tmp_path):
    def read(*features, kind=None):
        path = tmp_path / "zones.geojson"
        path.write_text(json.dumps(collection(*features)))
        return read_zones(path, kind)

    return read


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
    for info, speed in ((percent, 0.5), (percent, 120.0), (metres, 0.5)):
        with pytest.raises(ParameterError, match="must be"):
            info.value_of(speed)
    chosen = info_for("speed", [1.2], unit="m/s", base=1.0, multiplier=0.1)
    assert chosen.value_of(1.2) == (2, True)


@pytest.mark.parametrize("info", [FilterInfo("keepout"), FilterInfo("speed", "m/s", 0.5, 0.25)])
def test_the_yaml_says_how_a_mask_is_read(info):
    assert FilterInfo.of(info.entries()) == info
    assert FilterInfo.of({"filter": "speed"}) is None
    assert FilterInfo.of({**info.entries(), "filter": "other"}) is None


def test_zones_know_their_kind_name_and_speed(zones):
    found = zones(zone(kind="keepout", name="stairs"), zone(speed=30), zone(kind="binary"))
    described = [(found_zone.name, found_zone.kind, found_zone.speed) for found_zone in found]
    assert described == [("stairs", "keepout", None), ("zone 2", "speed", 30.0),
                    ("zone 3", "binary", None)]  # fmt: skip
    (keepout_zone,) = zones(zone(), zone(speed=30), kind="keepout")
    assert (keepout_zone.name, keepout_zone.kind) == ("zone 1", "keepout")
    with pytest.raises(MalformedInputError, match="no binary zone") as error:
        zones(zone(kind="keepout"), zone(speed=5), kind="binary")
    assert error.value.hint == "its zones are of the kind keepout, speed"


BAD = [
    (zone(), "needs a property kind: keepout, speed, binary"),
    (zone(kind="keepot"), "got 'keepot'"),
    (zone(kind="speed"), "needs a property speed"),
    (zone(kind="speed", speed=True), "needs a property speed"),
    (zone(kind="speed", speed=0, name="dock"), r"feature 1 \(dock\).* 0 is no limit"),
    (zone(kind="speed", speed=-3), "must be above 0"),
]


@pytest.mark.parametrize(("bad_zone", "words"), BAD)
def test_bad_zones_are_refused_with_their_place(zones, bad_zone, words):
    with pytest.raises(MalformedInputError, match=words):
        zones(bad_zone)


def test_masks_have_zones_where_they_lie(zones):
    shapely = pytest.importorskip("shapely")
    drawn_zones = zones(zone(3.1, -1.1), zone(4.1, 0.1, 3.0, kind="keepout"), kind="keepout")
    mask, info = filter_mask(GRID, "keepout", drawn_zones)
    assert (mask.frame, info.type) == (GRID.frame, 0)
    area = shapely.union_all([shapely.Polygon(zone.shapes[0].points_xy) for zone in drawn_zones])
    rows, cols = np.indices(mask.shape)
    centres = shapely.points(1.0 + (cols + 0.5) * 0.25, -2.0 + (rows + 0.5) * 0.25)
    inside, near = shapely.contains(area, centres), shapely.distance(area, centres) < 0.36
    assert (mask.occupancy[inside] == 100).all()
    assert (mask.occupancy[~near] == -1).all()  # of 0 the filter would free unknown cells
    mask, _ = filter_mask(GRID, "keepout", zones(zone(kind="keepout", value=40)))
    assert sorted(set(mask.occupancy.ravel().tolist())) == [-1, 40]


def test_of_overlapping_limits_the_lower_one_counts(zones):
    for unit, speeds in (("percent", (20, 60)), ("m/s", (0.2, 1.6))):
        drawn_zones = zones(*(zone(3.0 + n, -1.0, speed=v) for n, v in enumerate(speeds)))
        for order in (drawn_zones, drawn_zones[::-1]):
            mask, info = filter_mask(GRID, "speed", order, unit=unit)
            limits = {x: info.limit_of(int(mask.occupancy[5, int((x - 1) * 4)]))
                      for x in (3.5, 4.5, 5.5, 7.5)}  # fmt: skip
            slow, fast = (pytest.approx(float(v)) for v in speeds)
            assert limits == {3.5: slow, 4.5: slow, 5.5: fast, 7.5: None}
            assert mask.occupancy.min() == 0


def test_what_is_rounded_or_no_limit_is_warned_of(zones):
    for speed, words in ((33.3, "becomes 33 %"), (100, "is no limit")):
        with pytest.warns(MapdealWarning, match=words):
            filter_mask(GRID, "speed", zones(zone(speed=speed)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        filter_mask(GRID, "speed", zones(zone(speed=33)))
