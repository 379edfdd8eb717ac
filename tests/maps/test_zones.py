import json

import numpy as np
import pytest

from mapdeal import MalformedInputError, MapdealWarning, OccupancyGrid
from mapdeal.maps.shapes import filter_mask, read_zones
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
    filter_mask(GRID, "speed", zones(zone(speed=33)))  # without a warning
