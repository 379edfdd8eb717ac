"""Goals as recipes, settings and manifests write them."""

import json

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from made_up_stages import list_visit
from mapdeal import ParameterError
from mapdeal.grid.reach import Goal
from mapdeal.pipeline.recipe import load_recipe
from mapdeal.stages.structured import accept_goals, described_goals

KITCHEN, HALL = Goal(7.1, 3.2, "kitchen"), Goal(1.5, -2.0, "hall")


@pytest.mark.parametrize(
    ("value", "goals"),
    [
        ({"kitchen": [7.1, 3.2], "hall": "1.5,-2"}, (KITCHEN, HALL)),
        ([{"kitchen": [7.1, 3.2]}, {"hall": (1.5, -2)}], (KITCHEN, HALL)),
        ([KITCHEN, (1.5, -2)], (KITCHEN, Goal(1.5, -2.0))),
        (HALL, (HALL,)),
        ([[7.1, 3.2], [1.5, -2]], (Goal(7.1, 3.2), Goal(1.5, -2.0))),
        (np.array([[7.1, 3.2], [1.5, -2]]), (Goal(7.1, 3.2), Goal(1.5, -2.0))),
        ([7.1, 3.2], (Goal(7.1, 3.2),)),
        ("7.1, 3.2", (Goal(7.1, 3.2),)),
        ("7.1,3.2 1.5, -2", (Goal(7.1, 3.2), Goal(1.5, -2.0))),
        (["7.1,3.2", "1.5,-2"], (Goal(7.1, 3.2), Goal(1.5, -2.0))),
        ({12: [7.1, 3.2]}, (Goal(7.1, 3.2, "12"),)),
        ([], ()),
        ({}, ()),
    ],
)
def test_goals_in_every_way_of_writing(value, goals):
    assert accept_goals("goals", value) == goals


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (7.1, r"^goals: must look like {kitchen: \[7.1, 3.2\], ...} or"),
        (None, "must look like"),
        ({"kitchen": [7.1]}, "goals kitchen: must be a list of 2 numbers"),
        ([7.1, 3.2, 0.0], "goals 1: must be a list of 2 numbers"),
        ([[7.1, 3.2], [1, "x"]], "goals 2: must be a finite number, got 'x'"),
        ([[7.1, float("inf")]], "goals 1: must be a finite number"),
        ([{"kitchen": [7.1, 3.2], "hall": [1, 2]}], "goals 1: must be a place, or one name"),
        ({"kitchen": {"x": 1, "y": 2}}, "goals kitchen: must be a list of numbers"),
        ({"": [7.1, 3.2]}, "name must be text"),
        ({"a\nb": [7.1, 3.2]}, "name must be text"),
        ({True: [7.1, 3.2]}, "name must be text"),
        ([{"hall": [1, 2]}, {"hall": [3, 4]}], "two goals have this name, got 'hall'"),
        ({1: [1, 2], "1": [3, 4]}, "two goals have this name"),
        ("kitchen", "goals 1: must be a finite number"),
        ("1,2,3", "goals 1: must be a list of 2 numbers"),
    ],
)
def test_what_is_no_goal_is_refused_by_its_number_or_name(value, said):
    with pytest.raises(ParameterError, match=said):
        accept_goals("goals", value)


numbers = st.floats(-1e6, 1e6)
names = st.text(st.characters(min_codepoint=32, max_codepoint=0x2FF), min_size=1, max_size=8)
some_goals = st.lists(
    st.builds(Goal, numbers, numbers, st.none() | names.filter(lambda n: n.strip())),
    max_size=4,
    unique_by=lambda goal: goal.name or (goal.x, goal.y),
)


@given(some_goals)
def test_what_is_described_is_read_again_as_the_same(goals):
    goals = [goal for goal in goals if goal.name is None or goal.name.isprintable()]
    described = described_goals(goals)
    assert accept_goals("goals", described) == tuple(goals)
    for text in (json.dumps(described), yaml.safe_dump(described, sort_keys=False)):
        assert accept_goals("goals", yaml.safe_load(text)) == tuple(goals)


def test_a_recipe_and_its_manifest_tell_of_goals(tmp_path, monkeypatch):
    list_visit(monkeypatch)
    path = tmp_path / "r.yaml"
    path.write_text("stages:\n  - visit:\n      goals: {kitchen: [7.1, 3.2], hall: [1.5, -2]}\n")
    described = load_recipe(str(path)).described()
    assert described[0]["visit"]["goals"] == {"kitchen": [7.1, 3.2], "hall": [1.5, -2.0]}
    path.write_text(json.dumps({"stages": described}))
    (step,) = load_recipe(str(path)).steps
    assert step.parameters["goals"] == (KITCHEN, HALL)


@pytest.mark.parametrize(
    ("text", "goals"),
    [
        ("{kitchen: [7.1, 3.2]}", (KITCHEN,)),
        ("[[7.1, 3.2]]", (Goal(7.1, 3.2),)),
        ("7.1,3.2", (Goal(7.1, 3.2),)),
        ("[]", ()),
    ],
)
def test_settings_are_read_as_yaml(tmp_path, monkeypatch, text, goals):
    list_visit(monkeypatch)
    path = tmp_path / "r.yaml"
    path.write_text("stages:\n  - visit: {goals: [[0, 0]]}\n")
    (step,) = load_recipe(str(path), changes=[f"visit.goals={text}"]).steps
    assert step.parameters["goals"] == goals
    (step,) = load_recipe(str(path), changes={"visit.goals": goals}).steps
    assert step.parameters["goals"] == goals


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{kitchen: [7.1, 3.2}", r"^--set: visit.goals: "),
        ("{kitchen: [7.1]}", r"^--set: visit.goals kitchen: must be a list of 2 numbers"),
        ("{a: [1, 2], a: [3, 4]}", "appears twice"),
    ],
)
def test_settings_that_are_no_goals_are_refused(tmp_path, monkeypatch, text, said):
    list_visit(monkeypatch)
    path = tmp_path / "r.yaml"
    path.write_text("stages:\n  - visit:\n")
    with pytest.raises(ParameterError, match=said):
        load_recipe(str(path), changes=[f"visit.goals={text}"])


def test_names_of_a_hundred_thousand_goals_are_looked_at_once():
    counted = []

    class Name(str):
        def __eq__(self, other):
            counted.append(other)
            return str.__eq__(self, other)

        __hash__ = str.__hash__

    goals = [Goal(0.0, 0.0, Name(f"n{number}")) for number in range(500)]
    assert len(accept_goals("goals", goals)) == 500
    assert len(counted) < 2000
