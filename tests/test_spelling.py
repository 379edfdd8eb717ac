"""Words that are spelled in another way than they are known."""

import pytest

from mapdeal.errors import BRITISH_AND_AMERICAN, as_known, nearest, nearest_hint
from mapdeal.stages.catalogue import STAGES


@pytest.mark.parametrize(("british", "american"), BRITISH_AND_AMERICAN)
def test_either_spelling_stands_for_the_one_that_is_known(british, american):
    assert as_known(british, ["other", american]) == american
    assert as_known(american, ["other", british]) == british
    assert as_known(british, [american, british]) == british
    assert as_known(f"--to-{british}s", [f"--to-{american}s"]) == f"--to-{american}s"


@pytest.mark.parametrize(("word", "known", "expected"), [
    ("rnu", ["run", "route", "lint"], "run"),
    ("esfd", ["esdf", "edit"], "esdf"),
    ("NAV2", ["nav2", "ros1"], "nav2"),
    ("lethal_treshold", ["--lethal-threshold", "--image"], "--lethal-threshold"),
    ("centr", ["fast-planner", "center", "border"], "center"),
    ("zzzz", ["run", "route"], None),
    ("real", ["default", "nav2", "design-real", "arena"], None),
    ("nflate", ["esdf", "inflate"], "inflate"),
    ("exp", ["exponential", "threshold", "rings"], "exponential"),
    ("seed", ["design-real-map", "design-sim-world"], None),
    ("ex", ["exponential", "threshold"], None),
    ("", ["run"], None),
    ("run", [], None),
])  # fmt: skip
def test_the_nearest_known_word(word, known, expected):
    assert nearest(word, known) == expected
    assert nearest_hint(word, known) == (f"did you mean {expected}?" if expected else None)


def test_every_choice_of_every_stage_is_known_by_its_other_spelling():
    tried = set()
    for stage in STAGES:
        for parameter in stage.parameters.values():
            for choice in parameter.choices:
                for british, american in BRITISH_AND_AMERICAN:
                    for spelling, counterpart in ((british, american), (american, british)):
                        if spelling in choice:
                            tried.add(choice)
                            assert parameter.accept(choice.replace(spelling, counterpart)) == choice
    assert {"center", "disc"} <= tried  # else the test has gone blind
