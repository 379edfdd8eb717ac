"""Costmaps of whole parameter files and bags, as Nav2's and ROS 1's own layers computed them."""

import hashlib
import json
import warnings

import numpy as np
import pytest

import mapdeal
from drawn import grid_from_text
from mapdeal import MalformedInputError, apply_recipe, read_robot_parameters
from mapdeal.bags.reader import open_bag
from mapdeal.pipeline.recipe import step_for
from mapdeal.pipeline.replay import BagReplay

KNOWN_QUEUE_DIFFERENCE = {
    ("visible/062 a robot without namespace and robot1 [no namespace]", "humble")
}
"""An unknown cell that the queue of older releases takes to be beyond the inscribed radius."""


def costs_of(case, variant, data, folder, *, at_pose):
    """Return the costs that mapdeal computes for a recorded case, or the error that it raises."""
    paths = []
    for number, text in enumerate(case["params"]):
        paths.append(folder / f"{number}.yaml")
        paths[-1].write_text(text)
    namespace = case.get("namespace")
    grid = mapdeal.read_map(data / case["map"])
    mask = case.get("mask")
    if isinstance(mask, str):
        mask = mapdeal.read_map(data / mask)
    elif mask is not None:
        rows = "\n".join(reversed(mask["occupancy_rows_south_first"]))
        mask = grid_from_text(rows, resolution=0.05, origin=(-5.2, -3.6, 0.0))
    try:
        robot = read_robot_parameters(
            paths, costmap=case["costmap"], dialect=variant,
            namespace="/" if namespace == "" else namespace,
        )  # fmt: skip
    except MalformedInputError as error:
        return error
    if not at_pose:
        return apply_recipe(grid, robot, mask=mask)["cost"]
    pose = {"pose": case["robot_pose_in_global_frame"], "map_to_odom": case.get("map_to_odom")}
    return step_for("cost", robot, pose).apply(grid, None, mask=mask)


@pytest.mark.slow
@pytest.mark.parametrize("group", ["F1", "F2", "F3", "F4", "F5"])
def test_costs_equal_those_of_the_real_layers(real_maps, tmp_path, group):
    """Nav2's byte for byte; of older inflation, whose queue is not exact, lethal and unknown cells.

    Costmaps that do not roll are compared twice: with the robot outside of the map, and in it.
    """
    cases = json.loads((real_maps / "expected" / "layers.json").read_text())["cases"]
    cases = [case for case in cases if case["group"] == group]
    assert len(cases) >= 14
    for case in cases:
        for variant, recorded in case["results"].items():
            if variant == "nav2_before_6516":
                continue
            about = case["id"], variant
            answers = {}
            if case.get("rolling") or variant != "humble":  # where newer parameters were not read
                answers[True] = recorded
            if not case.get("rolling"):
                answers[False] = recorded | recorded.get("robot_outside_the_map", {})
            for at_pose, expected in answers.items():
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore", mapdeal.MapdealWarning)
                    found = costs_of(case, variant, real_maps, tmp_path, at_pose=at_pose)
                if recorded["status"] == "refused":
                    assert "combination_method" in str(found), about
                    continue
                assert_costs(found, expected, about)


def assert_costs(found, expected, about):
    assert found.shape == (expected["height"], expected["width"]), about
    assert list(found.origin[:2]) == expected["origin"], about
    cost = np.ascontiguousarray(found.cost)
    if about[1] == "nav2":
        assert hashlib.sha256(cost.tobytes()).hexdigest() == expected["sha256"], about
    elif about not in KNOWN_QUEUE_DIFFERENCE:
        counts = {name: int((cost == int(name)).sum()) for name in ("254", "255")}
        assert counts == {name: expected["counts"][name] for name in counts}, about


BAGS = ("ghost", "person", "far_and_low", "points", "points_only", "made-scans")


def differing(case, file, data, folder):
    params = folder / "params.yaml"
    params.write_text(case["params"])
    robot = mapdeal.read_robot_parameters([params], costmap=case["costmap"])
    recorded = {costmap["after_message"]: costmap for costmap in case["at"]}
    found = []
    with open_bag(data / file) as bag:
        replay = BagReplay(bag, robot, mapdeal.read_map(data / case["map"]))
        for number, step in enumerate(replay.steps()):
            if number not in recorded:
                continue
            expected, costs = recorded[number], replay.costmap.costs
            assert divmod(step.time, 10**9) == tuple(expected["stamp"])
            assert step.topic == expected["topic"]
            assert list(replay.costmap.frame.origin[:2]) == expected["origin"]
            digest = hashlib.sha256(np.ascontiguousarray(costs).tobytes()).hexdigest()
            found += [number] * (digest != expected["sha256"])
    return found


@pytest.mark.slow
@pytest.mark.usefixtures("mapdeal_warnings")
@pytest.mark.parametrize("every", [7, pytest.param(1, marks=pytest.mark.thorough)])
def test_costmaps_equal_those_of_the_real_layers(real_maps, tmp_path, every):
    document = json.loads((real_maps / "expected" / "observations.json").read_text())
    files = {bag["name"]: bag["file"] for bag in document["bags"]}
    cases = (document["cases"] * 2)[:204:every]  # 30 of each bag: every 7th meets all 30 kinds
    assert {case["bag"] for case in cases} == set(BAGS)
    for case in cases:
        assert not differing(case, files[case["bag"]], real_maps, tmp_path), case["id"]
