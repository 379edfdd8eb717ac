"""Clouds of Livox lidars, as rosbags writes them."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bags.making import START, Maker, custom, ros1_store, ros2_store, tf
from clouds import SampledRoom
from mapdeal import MalformedInputError, build_map_from_clouds, cloud_map
from mapdeal.bags.messages import points_of_livox
from strategies import examples

DRIVERS = ("livox_ros_driver", "livox_ros_driver2")
NUMBERS = st.floats(width=32, allow_nan=False, allow_infinity=False)


@pytest.mark.parametrize("driver", DRIVERS)
@pytest.mark.parametrize("form", ["ros1", "sqlite3", "mcap"])
@examples(10)
@given(points=st.lists(st.tuples(NUMBERS, NUMBERS, NUMBERS), max_size=20), frame=st.text("ab/"))
def test_points_are_those_that_were_written(form, driver, points, frame):
    name = f"{driver}/msg/CustomMsg"
    is_ros1 = form == "ros1"
    store = ros1_store() if is_ros1 else ros2_store()
    message = custom(START, points, driver, frame)(store)
    data = bytes((store.serialize_ros1 if is_ros1 else store.serialize_cdr)(message, name))
    found = points_of_livox(data, "ros1" if is_ros1 else "cdr")
    assert np.array_equal(found, np.reshape(points, (-1, 3)))
    for cut in (3, 14, len(data) - 2 - 20 * bool(points)):
        with pytest.raises(MalformedInputError):
            points_of_livox(data[:cut], "ros1" if is_ros1 else "cdr")


@pytest.mark.parametrize(("form", "driver"), [("ros1", DRIVERS[0]), ("sqlite3", DRIVERS[1])])
def test_a_bag_of_custom_messages_makes_a_map(tmp_path, command, form, driver):
    room, maker, sensor = SampledRoom(5, density=150, floor_density=150), Maker(), (2.0, 1.5, 0.4)
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
    document = json.loads(command("info", bag, "--json")[1])
    assert any("mapdeal build --cloud" in line and "/livox/lidar" in line
               for line in document["use"])  # fmt: skip
