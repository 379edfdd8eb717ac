"""Bags of public repositories, and made ones whose contents are recorded beside them."""

import hashlib
import json

import numpy as np
import pytest

from mapdeal import build_map_from_bag, build_map_from_log, read_map_from_bag
from mapdeal.bags.bag import normalised_type
from mapdeal.bags.messages import LASER_SCAN, TF_TYPES, Decoder, laser_scan_of, transforms_of
from mapdeal.bags.reader import open_bag

SCANS = ["mcap", "mcap-zstd-message", "sqlite3", "ros1.bag", "ros1-bz2.bag", "ros1-lz4.bag"]


@pytest.fixture(scope="module")
def bags(real_maps):
    return real_maps / "bags"


@pytest.fixture(scope="module")
def recorded(real_maps):
    return json.loads((real_maps / "expected" / "bags.json").read_text())


def test_topics_counts_and_times_are_those_recorded(bags, recorded):
    assert len(recorded["bags"]) > 20
    for one in recorded["bags"]:
        if "error" in one:
            continue
        with open_bag(bags / one["path"]) as bag:
            told = bag.summary()
            found = {}
            for connection in bag.connections:
                found[connection.topic] = found.get(connection.topic, 0) + told[connection.id].count
            types = {connection.topic: connection.type for connection in bag.connections}
        assert found == {topic: its["count"] for topic, its in one["topics"].items()}, one["path"]
        for topic, its in one["topics"].items():
            assert types[topic] == normalised_type(its["type"])
        if one.get("messages"):
            assert min(its.first for its in told.values() if its.count) == one["start_ns"]
            assert max(its.last for its in told.values()) + 1 == one["end_ns"]


def test_readings_and_transforms_are_those_recorded(bags, recorded):
    seen = 0
    for one in recorded["bags"]:
        wanted = {**one.get("scans", {}), **one.get("tf", {})}
        if not wanted:
            continue
        with open_bag(bags / one["path"]) as bag:
            decoder = Decoder(bag)
            for topic, its in one["scans"].items():
                ours = [c.id for c in bag.connections if c.topic == topic]
                messages = [decoder.message(place) for place in bag.index(ours)]
                assert len(messages) == its["scans"]
                data = b"".join(np.asarray(m.ranges, "<f4").tobytes() for m in messages)
                assert hashlib.sha256(data).hexdigest() == its["sha256_of_all_ranges_f32le"]
                scans = [laser_scan_of(message) for message in messages]
                assert scans[0].time == its["first_stamp_ns"]
                assert (scans[0].frame, scans[0].start) == (its["frame"], its["angle_min"])
                assert scans[0].step == its["angle_increment"]
                if "in_limits" in its:
                    hits = sum(int(np.isfinite(scan.ranges).sum()) for scan in scans)
                    assert hits == its["in_limits"]
            for topic, its in one["tf"].items():
                ours = [c.id for c in bag.connections if c.topic == topic and c.type in TF_TYPES]
                found = {}
                for place in bag.index(ours):
                    for edge in transforms_of(decoder.message(place)):
                        name = f"{edge.parent} -> {edge.child}"
                        found[name] = found.get(name, 0) + 1
                assert found == its
                seen += 1
    assert seen > 10


@pytest.mark.parametrize("form", SCANS)
def test_made_maps_keep_every_cell_and_their_place(bags, recorded, form):
    path = bags / "made" / f"map-{form}"
    (one,) = [b for b in recorded["bags"] if b["path"] == f"made/map-{form}"]
    for topic, grids in one["grids"].items():
        for index, its in enumerate(grids):
            found = read_map_from_bag(path, topic, index=index)
            assert hashlib.sha256(found.occupancy.tobytes()).hexdigest() == its["sha256"]
            assert found.shape == (its["height"], its["width"])
            assert np.float32(found.resolution) == its["resolution_float32"]
            assert list(found.origin[:2]) == its["origin_xyz"][:2]
            turn = its["origin_quat_xyzw"]
            assert found.origin[2] == pytest.approx(2 * np.arctan2(turn[2], turn[3]), abs=1e-12)


@pytest.mark.parametrize("form", SCANS)
def test_made_scans_make_the_map_of_their_log(bags, recorded, form):
    """With the nearest transforms, or without the mount, more than 1,300 cells would differ."""
    limits = {"method": "counting", "ratio": 0.0}
    found = build_map_from_bag(bags / "made" / f"scans-{form}", **limits)
    wanted = build_map_from_log(bags / "made" / "sim.log", **limits)
    assert found.grid.frame == wanted.grid.frame
    np.testing.assert_array_equal(found.layers["hits"], wanted.layers["hits"])
    np.testing.assert_array_equal(found.layers["misses"], wanted.layers["misses"])
    hit = int(np.count_nonzero(found.layers["hits"]))
    assert hit == recorded["made_scans_reference"]["from_sim_log"]


def test_costs_of_a_compressed_file(bags):
    path = bags / "ros-navigation__navigation2" / "cm_moving_obstacle"
    found = read_map_from_bag(path)
    assert (found.scale, found.shape, found.resolution) == ("costmap2d", (100, 100), 0.05)
    assert read_map_from_bag(path, index=100).cost.max() > 0


def test_laser_scans_are_named_as_ros_2_names_them():
    assert normalised_type("sensor_msgs/LaserScan") == LASER_SCAN
