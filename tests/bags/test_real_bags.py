"""Bags of public repositories and generated ones, against recorded contents."""

import hashlib
import json
from collections import Counter

import numpy as np
import pytest

from mapdeal import build_map_from_log, read_map_from_bag
from mapdeal.bags.bag import normalised_type
from mapdeal.bags.messages import TF_TYPES, Decoder, laser_scan_of, transforms_of
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
    for entry in recorded["bags"]:
        if "error" in entry:
            continue
        with open_bag(bags / entry["path"]) as bag:
            summary, found = bag.summary(), Counter()
            for connection in bag.connections:
                found[connection.topic] += summary[connection.id].count
            types = {connection.topic: connection.type for connection in bag.connections}
        topics = entry["topics"]
        assert found == {topic: topics[topic]["count"] for topic in topics}, entry["path"]
        for topic, expected in topics.items():
            assert types[topic] == normalised_type(expected["type"])
        if entry.get("messages"):
            first = min(messages.first for messages in summary.values() if messages.count)
            last = max(messages.last for messages in summary.values())
            assert (first, last + 1) == (entry["start_ns"], entry["end_ns"])


def test_readings_and_transforms_are_those_recorded(bags, recorded):
    topic_count = 0
    for entry in recorded["bags"]:
        if not {**entry.get("scans", {}), **entry.get("tf", {})}:
            continue
        with open_bag(bags / entry["path"]) as bag:
            decoder = Decoder(bag)
            for topic, expected in entry["scans"].items():
                connections = [c.id for c in bag.connections if c.topic == topic]
                messages = [decoder.message(place) for place in bag.index(connections)]
                assert len(messages) == expected["scans"]
                data = b"".join(np.asarray(m.ranges, "<f4").tobytes() for m in messages)
                assert hashlib.sha256(data).hexdigest() == expected["sha256_of_all_ranges_f32le"]
                scans = [laser_scan_of(message) for message in messages]
                assert scans[0].time == expected["first_stamp_ns"]
                assert scans[0].frame == expected["frame"]
                assert scans[0].start == expected["angle_min"]
                assert scans[0].step == expected["angle_increment"]
                if "in_limits" in expected:
                    hits = sum(int(np.isfinite(scan.ranges).sum()) for scan in scans)
                    assert hits == expected["in_limits"]
            for topic, expected in entry["tf"].items():
                of_tf = [c for c in bag.connections if c.type in TF_TYPES]
                connections, found = [c.id for c in of_tf if c.topic == topic], {}
                for place in bag.index(connections):
                    for edge in transforms_of(decoder.message(place)):
                        name = f"{edge.parent} -> {edge.child}"
                        found[name] = found.get(name, 0) + 1
                assert found == expected
                topic_count += 1
    assert topic_count > 10


@pytest.mark.parametrize("form", SCANS)
def test_made_maps_keep_every_cell_and_their_place(bags, recorded, form):
    path = bags / "made" / f"map-{form}"
    (entry,) = [b for b in recorded["bags"] if b["path"] == f"made/map-{form}"]
    for topic, grids in entry["grids"].items():
        for index, expected in enumerate(grids):
            found = read_map_from_bag(path, topic, index=index)
            assert hashlib.sha256(found.occupancy.tobytes()).hexdigest() == expected["sha256"]
            assert found.shape == (expected["height"], expected["width"])
            assert np.float32(found.resolution) == expected["resolution_float32"]
            assert list(found.origin[:2]) == expected["origin_xyz"][:2]
            turn = expected["origin_quat_xyzw"]
            assert found.origin[2] == pytest.approx(2 * np.arctan2(turn[2], turn[3]), abs=1e-12)


@pytest.mark.parametrize("form", SCANS)
def test_made_scans_make_the_map_of_their_log(bags, recorded, form):
    """Nearest instead of interpolated transforms, or no mount, would change 1,300 cells."""
    limits = {"method": "counting", "ratio": 0.0}
    found = build_map_from_log(bags / "made" / f"scans-{form}", **limits)
    expected = build_map_from_log(bags / "made" / "sim.log", **limits)
    assert found.grid.frame == expected.grid.frame
    np.testing.assert_array_equal(found.layers["hits"], expected.layers["hits"])
    np.testing.assert_array_equal(found.layers["misses"], expected.layers["misses"])
    hit = int(np.count_nonzero(found.layers["hits"]))
    assert hit == recorded["made_scans_reference"]["from_sim_log"]


def test_costs_of_a_compressed_file(bags):
    path = bags / "ros-navigation__navigation2" / "cm_moving_obstacle"
    found = read_map_from_bag(path)
    assert (found.scale, found.shape, found.resolution) == ("costmap2d", (100, 100), 0.05)
    assert read_map_from_bag(path, index=100).cost.max() > 0
