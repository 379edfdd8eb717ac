"""Replays of bags: the command, its folder, and why a cell is occupied; numbers of messages."""

import json

import numpy as np
import pytest

from bags.making import SECOND, START, Maker, scan, tf
from mapdeal import ParameterError
from mapdeal.pipeline.bag_maps import _number_in

BEAMS, STEP = 63, 0.05
AHEAD, UPRIGHT = BEAMS // 2, (0.0, 0.0, 0.0, 1.0)


def params(folder, *, layer="ObstacleLayer", source="", extra="", costmap=""):
    """A rolling costmap of 6 x 6 m around the robot, with one layer of a scanner."""
    path = folder / f"params{len(list(folder.glob('params*')))}.yaml"
    path.write_text(f"""
local_costmap: {{local_costmap: {{ros__parameters: {{
  robot_radius: 0.2, rolling_window: true, width: 6, height: 6, resolution: 0.1,
  global_frame: odom, plugins: [sensed{extra}], {costmap}
  static_layer: {{plugin: "nav2_costmap_2d::StaticLayer"}},
  sensed: {{plugin: "nav2_costmap_2d::{layer}", observation_sources: scan,
    scan: {{topic: scan, max_obstacle_height: 2.0, clearing: true{source}}}}}}}}}}}
""")
    return path


ROS1 = """
local_costmap:
  {robot_radius: 0.2, rolling_window: true, width: 6, height: 6, resolution: 0.1,
   global_frame: /odom, robot_base_frame: /base_link, inflation_radius: 0.0, raytrace_range: 1.0,
   observation_sources: scan, scan: {data_type: LaserScan, topic: scan, clearing: true}}
"""
"""The form without a list of plugins: sources and ranges beside the costmap's parameters."""


def bag(folder, readings, *, storage="mcap-plain", yaw=0.0):
    """A robot that stands at 1, 2 and looks along `yaw`; one scan per second, `readings` ahead."""
    maker, turn = Maker(), (0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2))
    still = [("odom", "base_link", (1, 2, 0), turn), ("base_link", "laser", (0, 0, 0.2), UPRIGHT)]
    maker.add("/tf_static", "tf2_msgs/msg/TFMessage", START, tf(START, *still))
    for second, ahead in enumerate(readings):
        ranges = np.full(BEAMS, 9.0)
        ranges[AHEAD - 2 : AHEAD + 3] = ahead
        time = START + second * SECOND
        beams = scan(time, ranges, start=-AHEAD * STEP, step=STEP, limits=(0.1, 12.0))
        maker.add("/scan", "sensor_msgs/msg/LaserScan", time, beams)
    return maker.write(folder, storage)


@pytest.fixture
def replay(command, tmp_path):
    def run(readings, *words, yaw=0.0, **settings):
        words = ["--no-images", "-o", tmp_path / "out", "--force", *words]
        source, file = bag(tmp_path, readings, yaw=yaw), params(tmp_path, **settings)
        return command("local", source, "--params-file", file, "--costmap", "local", *words)

    return run


def costs_in(folder):
    with np.load(folder / "cost.npz") as file:
        assert file["origin"].tolist() == pytest.approx([-2.0, -1.0, 0.0])
        return file["cost"]


def test_costs_are_those_after_the_last_message_up_to_a_time(replay, tmp_path):
    for words, is_marked in (((), False), (("--until", "1700000000.999999999"), True)):
        code, out, err = replay([1.55, 9.0], *words)
        assert (code, err) == (0, "")
        assert "60 x 60 cells" in out
        assert bool(costs_in(tmp_path / "out")[30, 45] == 254) == is_marked
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert manifest["stages"] == [{"replay": {"messages": 1}}]
    assert manifest["robot"]["node"] == "/local_costmap/local_costmap"


def test_a_sequence_has_a_folder_and_a_place_on_the_slider_for_each_time(replay, command, tmp_path):
    code, out, _ = replay([1.55, 1.55, 9.0, 9.0, 9.0], "--every", "2")
    assert code == 0
    assert "3 done" in out
    marked = [bool(costs_in(tmp_path / "out" / name)[30, 45]) for name in ("0000", "0001", "0002")]
    assert marked == [True, False, False]
    code, _, _ = command("report", tmp_path / "out", "-o", tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    assert code == 0
    assert '<input type="range" name="time" min="0" max="2"' in page
    assert all(f"Show only {seconds}.000 s" in page for seconds in (0, 2, 3))


def test_a_replay_warns_of_heights_that_drop_every_reading(replay):
    code, _, err = replay([1.5], source=", min_obstacle_height: 1.0")
    assert code == 0
    assert "sensed.scan: all 63 readings are outside of its heights, 1 to 2 m" in err


@pytest.mark.parametrize(("readings", "settings", "place", "reason"), [
    ([1.55, np.inf, np.inf], {}, "2.55,2.05", "4 infinite (inf_is_valid: false)"),
    ([1.55, np.inf], {"source": ", inf_is_valid: true"}, "2.55,2.05",
     "freed at 1700000001.000000000 s by a ray of /scan"),
    ([1.55, np.inf], {"source": ", inf_is_valid: true, raytrace_max_range: 1.0"}, "2.55,2.05",
     "2 beyond raytrace_max_range 1 m"),
    ([2.25, 9.0], {"source": ", raytrace_max_range: 1.5"}, "3.25,2.05",
     "beyond raytrace_max_range 1.5 m"),
    ([1.55, 1.0], {}, "2.55,2.05", "ended before it"),
    ([9.0, 1.55], {}, "2.55,2.05", "(range 1.550 m, height 0.200 m); no observation since"),
    ([1.55], {"source": ", min_obstacle_height: 0.3"}, "2.55,2.05",
     "none marked it: 2 below min_obstacle_height 0.3 of scan"),
    ([2.75], {}, "3.75,2.05", "beyond obstacle_max_range 2.5 m"),
    ([2.75], {"yaw": np.pi / 2}, "0.95,4.75", "beyond obstacle_max_range 2.5 m"),
    ([1.55], {"source": ", marking: false"}, "2.55,2.05", "marking: false of scan"),
    ([1.55, 9.0], {"layer": "VoxelLayer"}, "2.55,2.05", "freed at 1700000001"),
    ([1.0], {}, "-1.05,2.05", "no reading ended in it"),
    ([1.0], {}, "11,2", "lies outside of the costmap"),
])  # fmt: skip
def test_why_names_what_marked_a_cell_or_why_nothing_did(replay, readings, settings, place, reason):
    code, out, _ = replay(readings, f"--why={place}", "-q", **settings)
    assert code == 0
    *_, line = out.splitlines()
    assert line.startswith(f"{place}: ")
    assert reason in line


@pytest.mark.parametrize(("words", "settings", "code", "text"), [
    ((), {"extra": ", static_layer"}, 2, "--map: is required: the costmap lists a static"),
    ((), {"source": ", data_type: PointCloud2"}, 3, "no messages for the layers of /local_c"),
    (("--until", "5"), {}, 2, "is before the first message, at 1700000000.000000000 s"),
    (("--until", "1e9"), {}, 2, "must be a time in seconds"),
    (("--pose", "1,2,0"), {}, 2, "applies to clouds, not to the replay of a bag"),
    (("--robot-radius", "1"), {}, 2, "applies to clouds, not to the replay"),
    ((), {"costmap": "robot_base_frame: base,"}, 3, "no transforms lead from 'odom' to 'base'"),
])  # fmt: skip
def test_a_replay_refuses_by_name(replay, words, settings, code, text):
    found, _, err = replay([1.0], *words, **settings)
    assert found == code
    assert text in err


def test_a_replay_reads_bags_and_old_parameters_of_ros_1(command, tmp_path):
    (tmp_path / "costmap.yaml").write_text(ROS1)
    source = bag(tmp_path, [1.55, 9.0], storage="ros1")
    code, out, err = command(
        "local", source, "--params-file", tmp_path / "costmap.yaml", "--costmap", "local",
        "-o", tmp_path / "out", "--why", "2.55,2.05",
    )  # fmt: skip
    assert (code, err) == (0, "")
    assert "none cleared it: 2 beyond raytrace_range 1 m" in out


def test_a_replay_needs_the_parameters_of_a_robot(command, tmp_path):
    code, _, err = command("local", bag(tmp_path, [1.0]), "-o", tmp_path / "out")
    assert (code, "--params-file: is required to replay a bag" in err) == (2, True)
    code, _, err = command("local", "--cloud", "a.pcd", "--until", "3", "-o", tmp_path / "out")
    assert (code, "applies to the replay of a bag" in err) == (2, True)


def test_a_local_map_of_a_cloud_without_points_is_warned_of(command, tmp_path):
    (tmp_path / "a.csv").write_text("x,y,z\n")
    words = ["--pose", "0,0,0", "--no-images", "-o", tmp_path / "out"]
    code, _, err = command("local", "--cloud", tmp_path / "a.csv", *words)
    assert (code, "a.csv: no point marks a cell: it holds no points" in err) == (0, True)


def test_messages_are_numbered_from_either_end():
    assert [_number_in(range(3), number, "/map") for number in (-3, -1, 0, 2)] == [0, 2, 0, 2]
    for number in (-4, 3):
        with pytest.raises(ParameterError, match="/map has 3 messages: 0 to 2, or -1 to -3"):
            _number_in(range(3), number, "/map")
