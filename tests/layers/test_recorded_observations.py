"""Costmaps of obstacle and voxel layers that the real code has computed from bags."""

import hashlib
import json

import numpy as np
import pytest

import mapdeal
from mapdeal.bags.reader import open_bag
from mapdeal.pipeline.replay import BagReplay

BAGS = ("ghost", "person", "far_and_low", "points", "points_only", "made-scans")


def differing(case, file, data, folder):
    params = folder / "params.yaml"
    params.write_text(case["params"])
    robot = mapdeal.read_robot_parameters([params], costmap=case["costmap"])
    recorded = {costmap["after_message"]: costmap for costmap in case["at"]}
    found = []
    with open_bag(data / file) as bag:
        replay = BagReplay(bag, robot, mapdeal.read_map(data / case["map"]))
        for step in replay.steps():
            if step.number not in recorded:
                continue
            expected, costs = recorded[step.number], replay.costmap.costs
            assert divmod(step.time, 10**9) == tuple(expected["stamp"])
            assert step.topic == expected["topic"]
            assert list(replay.costmap.frame.origin[:2]) == expected["origin"]
            digest = hashlib.sha256(np.ascontiguousarray(costs).tobytes()).hexdigest()
            found += [step.number] * (digest != expected["sha256"])
    return found


@pytest.mark.slow
@pytest.mark.usefixtures("mapdeal_warnings")
@pytest.mark.parametrize("every", [7, pytest.param(1, marks=pytest.mark.thorough)])
def test_costmaps_equal_those_of_the_real_layers(real_maps, tmp_path, every):
    document = json.loads((real_maps / "expected" / "observations.json").read_text())
    files = {bag["name"]: bag["file"] for bag in document["bags"]}
    cases = document["cases"][::every]
    assert {case["bag"] for case in cases} == set(BAGS)
    wrong = {
        case["id"]: found
        for case in cases
        if (found := differing(case, files[case["bag"]], real_maps, tmp_path))
    }
    assert not wrong
