"""Decoded messages, against their sources and the rules of REP 117 and PointField."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, strategies as st

from bags import making
from bags.making import START, Maker, cloud, costmap, custom, occupancy, ros2_store, scan, tf
from clouds import SampledRoom
from mapdeal import Costmap, MalformedInputError, OccupancyGrid, build_map_from_clouds, cloud_map
from mapdeal.bags import messages
from mapdeal.bags.messages import OCCUPANCY_GRID, grid_of, laser_scan_of, points_of, points_of_livox
from strategies import examples

STORE = ros2_store()
CELLS = np.array([[-1, 0, 100], [37, 0, -1]], np.int8)


def created(make):
    return make(STORE)


def test_readings_beyond_the_limits_of_the_scanner_are_none():
    ranges = [0.05, 0.1, 5.0, 20.0, 25.0, np.inf, -np.inf, np.nan]
    found = laser_scan_of(created(scan(7_000_000_123, ranges, step=0.25, between=0.001)))
    assert found.ranges.tolist()[1:3] == [np.float32(0.1), 5.0]
    assert np.isnan(found.ranges[[0, 6, 7]]).all()
    assert np.isposinf(found.ranges[[3, 4, 5]]).all()
    assert (found.frame, found.time) == ("laser", 7_000_000_123)
    np.testing.assert_allclose(found.angles, -1.5 + 0.25 * np.arange(8), atol=1e-7)
    assert found.beam_times()[3] == 7_003_000_123


def test_a_scanner_without_limits_keeps_all_ranges_but_needs_valid_angles():
    found = laser_scan_of(created(scan(1, [0.01, 500.0], limits=(np.nan, 0.0))))
    assert found.ranges.tolist() == [np.float32(0.01), 500.0]
    with pytest.raises(MalformedInputError, match="must be angles in radians"):
        laser_scan_of(created(scan(1, [1.0], start=np.nan)))
    with pytest.raises(MalformedInputError, match="angle_increment must not be 0, got '2 ranges'"):
        laser_scan_of(created(scan(1, [1.0, 1.0], step=0.0)))


def test_points_of_a_scan_are_what_it_hits():
    message = created(scan(1, [2.0, np.inf, 3.0], start=0.0, step=np.pi / 2))
    np.testing.assert_allclose(messages.points_of_scan(message), [[2, 0], [-3, 0]], atol=1e-6)


def test_frames_lose_their_leading_slash():
    edges = ("/map", "/odom", (1, 2, 3), (0, 0, 0, 1)), ("odom", "b", (0, 0, 0), (1, 0, 0, 0))
    first, second = messages.transforms_of(created(tf(5, *edges)))
    assert first == ("map", "odom", 5, (1.0, 2.0, 3.0), (0.0, 0.0, 0.0, 1.0))
    assert second.quaternion == (1.0, 0.0, 0.0, 0.0)
    found = messages.odometry_of(created(making.odometry(9, 1.5, -2.0, 0.6)))
    assert found[:4] == ("odom", "base_link", 9, (1.5, -2.0, 0.0))
    np.testing.assert_allclose(found.quaternion, (0, 0, np.sin(0.3), np.cos(0.3)))


def test_a_map_keeps_its_cells_and_its_pose():
    message = created(occupancy(1, CELLS, 0.05, (1.5, -2.25, 0.7)))
    found = grid_of(message, OCCUPANCY_GRID, is_costs=False)
    assert isinstance(found, OccupancyGrid)
    np.testing.assert_array_equal(found.occupancy, CELLS)
    assert found.resolution == 0.05  # and not the float32 beside it
    assert found.origin[:2] == (1.5, -2.25)
    assert found.origin[2] == pytest.approx(0.7, abs=1e-15)


def test_costs_keep_their_scale():
    message = created(occupancy(1, CELLS, 0.1, (0.0, 0.0, 0.0)))
    published = grid_of(message, OCCUPANCY_GRID, is_costs=True)
    assert isinstance(published, Costmap)
    assert (published.scale, published.cost.tolist()) == ("occupancy", CELLS.tolist())
    message = created(costmap(1, [[0, 253, 255]], 0.25, (1, 2, 0.5)))
    raw = grid_of(message, messages.NAV2_COSTMAP, is_costs=True)
    assert (raw.scale, raw.cost.tolist(), raw.resolution) == ("costmap2d", [[0, 253, 255]], 0.25)
    assert messages.from_msg(message).cost.tolist() == raw.cost.tolist()


def test_an_origin_without_rotation_is_not_turned():
    message = created(occupancy(1, CELLS, 0.1, (0.0, 0.0, 0.0)))
    message.info.origin.orientation.w = 0.0
    assert grid_of(message, OCCUPANCY_GRID, is_costs=False).origin == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(("change", "rule"), [
    (lambda m: setattr(m.info, "width", 4), "must have 4 x 2 values, has 6"),
    (lambda m: m.data.__setitem__(3, 101), "must be -1 to 100, got 101"),
    (lambda m: m.data.__setitem__(3, -2), "must be -1 to 100, got -2"),
    (lambda m: setattr(m.info.origin.orientation, "x", 0.5), "leans by more than 10 degrees"),
    (lambda m: setattr(m.info.origin.orientation, "x", np.nan), "must be finite"),
])  # fmt: skip
def test_invalid_grids_are_refused(change, rule):
    message = created(occupancy(1, CELLS, 0.1, (0.0, 0.0, 0.0)))
    message.data = message.data.copy()
    change(message)
    with pytest.raises(MalformedInputError, match=rule):
        grid_of(message, OCCUPANCY_GRID, is_costs=False)


NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}


@given(data=st.data(), is_big=st.booleans(), width=st.integers(1, 5), height=st.integers(1, 4))
def test_points_of_any_layout(data, is_big, width, height):
    order = ">" if is_big else "<"
    fields, offset = [], data.draw(st.integers(0, 3))
    for name in data.draw(st.permutations(["x", "y", "z", "rgb"])):
        number = data.draw(st.sampled_from(sorted(NUMBERS)))
        fields.append((name, offset, number))
        offset += np.dtype(NUMBERS[number]).itemsize + data.draw(st.integers(0, 5))
    step = offset + data.draw(st.integers(0, 7))
    row = width * step + data.draw(st.integers(0, 9))
    names, offsets, numbers = zip(*fields, strict=True)
    formats = [order + NUMBERS[number] for number in numbers]
    layout = np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": step})
    rows, expected = [], []
    for _ in range(height):
        line = np.zeros(width, layout)
        for name, _, number in fields:
            line[name] = data.draw(st.lists(st.integers(0, 100), min_size=width, max_size=width))
            if NUMBERS[number][0] == "f":
                line[name] /= 8
        rows.append(line.tobytes() + b"\xa5" * (row - width * step))
        expected += [[float(point[name]) for name in "xyz"] for point in line]
    recipe = cloud(1, b"".join(rows), fields, width=width, height=height, step=step, row=row,
                   is_big=is_big)  # fmt: skip
    assert points_of(created(recipe)).tolist() == expected


def test_points_that_are_not_finite_stay_so_and_flat_ones_have_two_numbers():
    data = np.array([[1, np.nan], [np.inf, 2]], "<f4")
    flat = cloud(1, data.tobytes(), [("x", 0, 7), ("y", 4, 7)], width=2, step=8)
    np.testing.assert_array_equal(points_of(created(flat)), data)
    empty = cloud(1, b"", [("x", 0, 7), ("y", 4, 7), ("z", 8, 7)], width=0, step=12)
    assert points_of(created(empty)).shape == (0, 3)


@pytest.mark.parametrize(("change", "rule"), [
    ({"fields": [("x", 0, 7)]}, "must name x and y, got 'x'"),
    ({"fields": [("x", 0, 9), ("y", 4, 7)]}, "datatype from 1 to 8, got 9"),
    ({"fields": [("x", 0, 7), ("y", 6, 7)]}, "within a point of 8 bytes, got 6"),
    ({"width": 3}, "must have 1 rows of 24 bytes, has 16"),
    ({"width": 1 << 31, "height": 1 << 31}, "too many points"),
])  # fmt: skip
def test_a_cloud_whose_numbers_do_not_fit_is_refused(change, rule):
    changed = {"fields": [("x", 0, 7), ("y", 4, 7)], "width": 2, "height": 1} | change
    written = created(cloud(1, bytes(16), changed.pop("fields"), width=2, step=8))
    message = SimpleNamespace(**{**vars(written), **changed, "row_step": changed["width"] * 8})
    with pytest.raises(MalformedInputError, match=rule):
        points_of(message)


DRIVERS = ("livox_ros_driver", "livox_ros_driver2")

POINTS = st.floats(width=32, allow_nan=False, allow_infinity=False)


@pytest.mark.parametrize("driver", DRIVERS)
@pytest.mark.parametrize("form", ["ros1", "sqlite3", "mcap"])
@examples(10)
@given(points=st.lists(st.tuples(POINTS, POINTS, POINTS), max_size=20), frame=st.text("ab/"))
def test_points_are_those_that_were_written(form, driver, points, frame):
    name, is_ros1 = f"{driver}/msg/CustomMsg", form == "ros1"
    store = making.ros1_store() if is_ros1 else ros2_store()
    message = custom(START, points, driver, frame)(store)
    data = bytes((store.serialize_ros1 if is_ros1 else store.serialize_cdr)(message, name))
    found = points_of_livox(data, "ros1" if is_ros1 else "cdr")
    assert np.array_equal(found, np.reshape(points, (-1, 3)))
    for cut in (3, 14, len(data) - 2 - 20 * bool(points)):
        with pytest.raises(MalformedInputError):
            points_of_livox(data[:cut], "ros1" if is_ros1 else "cdr")


@pytest.mark.parametrize(("form", "driver"), [("ros1", DRIVERS[0]), ("sqlite3", DRIVERS[1])])
def test_a_bag_of_custom_messages_makes_a_map(tmp_path, command, form, driver):
    room, maker, sensor = SampledRoom(5, density=70, floor_density=70), Maker(), (2.0, 1.5, 0.4)
    points = room.points().astype("f4").astype(float)
    for k, part in enumerate(np.array_split(points, 3)):
        time = START + k * 10**8
        maker.add("/tf", "tf2_msgs/msg/TFMessage", time,
                  tf(time, ("map", "base_link", sensor, (0, 0, 0, 1))))  # fmt: skip
        sensor_points = np.concatenate([part - sensor, np.zeros((20, 3))])
        maker.add("/livox/lidar", f"{driver}/msg/CustomMsg", time,
                  custom(time, sensor_points, driver, "base_link"))  # fmt: skip
    bag = maker.write(tmp_path, form)
    built, expected = build_map_from_clouds(bag), cloud_map(points)
    assert built.at_sensor == 60
    assert built.grid.shape == expected.grid.shape
    assert (built.grid.occupancy == expected.grid.occupancy).mean() > 0.98
    assert any("mapdeal build --cloud" in line and "/livox/lidar" in line
               for line in json.loads(command("info", bag, "--json")[1])["use"])  # fmt: skip
