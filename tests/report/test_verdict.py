"""What pages conclude: from findings, a run's parameters, and where a robot gets to."""

import pytest

import mapdeal
from mapdeal.grid.reach import Bottleneck, Goal, GoalReach, Passage
from mapdeal.report import verdict
from mapdeal.report.document import Claim, Verdict
from mapdeal.report.verdict import most_urgent, on_costs, on_failure, on_goals, settled

ROBOT = mapdeal.Footprint.circle(0.3)
DOOR = Bottleneck(1.0, 2.0, 0.5)
THERE = GoalReach(Goal(1, 2, "lab"), True, 1, 0.4, Bottleneck(0, 0, 0.8))
STOPPED = GoalReach(Goal(3, 4, "store"), False, 0, 0.25, DOOR)
CORNERED = GoalReach(Goal(3, 4, "store"), False, 0, 0.35, Bottleneck(1.0, 2.0, 0.7))
WALLED = GoalReach(Goal(5, 6), False, 0, 0.0)
IN_WALL = GoalReach(Goal(5, 6), False, 0, 0.0, reason="an obstacle")
SHUT = Passage(1, 2, 0.5, 7.0, False, ((0, 0), (1, 1)))


@pytest.mark.parametrize(("messages", "state", "text"), [
    ({}, "good", "The map is sound: no errors, no warnings"),
    ({"note": ["n"]}, "good", "The map is sound: no errors, no warnings (1 note)"),
    ({"warning": ["w", "v"]}, "warning", "The map has no errors, but 2 warnings: w"),
    ({"error": ["e"], "warning": ["w"]}, "error", "The map has 1 error and 1 warning: e"),
])  # fmt: skip
def test_findings(messages, state, text):
    claim = verdict.on_findings(messages)
    assert (claim.state, claim.text) == (state, text)


@pytest.mark.parametrize(("goals", "passages", "robot", "share", "state", "text"), [
    ([THERE], [], ROBOT, 1.0, "good",
     "The robot reaches its goal; the narrowest place on the way is 0.8 m wide"),
    ([THERE, STOPPED], [SHUT], ROBOT, 1.0, "error",
     ("The robot reaches 1 of 2 goals. Not reached: store (a passage at 1,2 is 0.5 m wide, "
     "the robot needs 0.6 m)")),
    ([CORNERED], [], ROBOT, 1.0, "error",
     "The robot reaches 0 of 1 goal. Not reached: store (it cannot turn on the way)"),
    ([WALLED, IN_WALL], [], ROBOT, 1.0, "error",
     ("The robot reaches 0 of 2 goals. Not reached: 5,6 (no way leads there); "
      "5,6 (its cell is an obstacle)")),
    ([], [SHUT], ROBOT, 0.26, "warning",
     "The robot gets to 26 % of the area that it fits in: 1 passage is closed to it"),
    ([], [], ROBOT, 0.97, "good",
     "The robot gets to 97 % of the area that it fits in; no goals were given"),
    ([], [], ROBOT, 0.5, "warning",
     "The robot gets to 50 % of the area that it fits in; no goals were given"),
    ([THERE], [], None, 1.0, "warning",
     ("A point, as no robot was given, reaches its goal; "
     "the narrowest place on the way is 0.8 m wide")),
])  # fmt: skip
def test_goals(goals, passages, robot, share, state, text):
    claim = on_goals(goals, passages, robot, share=share)
    assert (claim.state, claim.text) == (state, text)


def manifest_of(robot=None, **more):
    cost = {"inscribed_radius": 0.2, "inflation_radius": 0.55, "cost_scaling_factor": 10.0}
    return {"stages": [{"inflate": {"radius": 0.3}}, {"cost": cost}], "robot": robot, **more}


def robot_of(*entries):
    layers = [{"name": "inflation_layer"}]
    layers += [{"name": f"l{k}", **entry} for k, entry in enumerate(entries)]
    return {"files": [{"name": "nav2.yaml"}], "costmap": "global", "layers": layers}


SENSORS = {"needs": "observations", "enabled": True}
FILTER = {"needs": "mask", "enabled": True, "filter": True}


@pytest.mark.parametrize(("manifest", "state", "words"), [
    (manifest_of(), "warning", "walls inflated by 0.3 m, inscribed radius 0.2 m"),
    (manifest_of(robot_of(SENSORS)), "good", "robot's own: global costmap of nav2.yaml"),
    (manifest_of(robot_of({"ignored": "limits the speed"})), "good", "robot's own: global costmap"),
    (manifest_of(robot_of({"ignored": "not modelled"})), "warning", "lacks l0 (not modelled)"),
    (manifest_of(robot_of(SENSORS, FILTER)), "warning", "l1, whose mask was not given"),
    (manifest_of(robot_of(SENSORS, FILTER | {"enabled": False})), "good", "own"),
    (manifest_of(robot_of(SENSORS, FILTER), mask={"m.yaml": "0"}), "good", "own"),
    ({"stages": [{"cost": [1]}], "robot": 5}, None, ""),
    ({"stages": [{"cost": {"inflation_radius": "x"}}], "robot": 5}, "warning", "not made from"),
    ({"stages": [{"esdf": {}}]}, None, ""),
    ({"stages": [{"cost": {}}], "robot": {"files": 3, "layers": 4}}, "good", "own"),
])  # fmt: skip
def test_costs(manifest, state, words):
    claim = on_costs(manifest)
    assert (None if claim is None else claim.state) == state
    assert claim is None or words in claim.text


def test_three_claims_are_left_of_those_about_the_same_the_worst():
    claims = [
        Claim("goals", "good", "g"), Claim("map", "good", "m"), Claim("map", "error", "e"),
        Claim("cells", "warning", "c"), Claim("costmap", "unknown", "u"),
        Claim("map", "warning", "w"),
    ]  # fmt: skip
    assert [claim.text for claim in settled(claims)] == ["e", "u", "g"]


def test_a_failed_run_has_one_claim():
    failure = on_failure("the image does not exist")
    assert settled([Claim("map", "error", "the image does not exist"), failure]) == (failure,)


def test_the_next_command_is_that_of_the_worst_verdict_that_has_one():
    states = (("good", "x"), ("warning", "y"), ("error", ""))
    verdicts = [Verdict("a", state, (), command) for state, command in states]
    assert (most_urgent(verdicts), most_urgent(verdicts[2:])) == ("y", "")
