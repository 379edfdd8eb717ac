"""Every choice of each parameter is named by a test; misspelt words get a suggestion."""

from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest

from mapdeal.cli.main import command_names
from mapdeal.command import commands_named
from mapdeal.errors import BRITISH_AND_AMERICAN, as_known, nearest, nearest_hint
from mapdeal.stages.catalogue import STAGES

TESTS = "".join(
    path.read_text()
    for path in Path(__file__).parent.rglob("*.py")
    if path.name not in ("record_commands.py", "test_help_pages.py")
)


def definitions():
    yield from STAGES
    for name in filter(lambda name: find_spec(f"mapdeal.commands.{name}"), command_names()):
        import_module(f"mapdeal.commands.{name}")
        yield from commands_named(name).values()


def test_every_choice_is_named_by_a_test():
    assert not [
        f"{parameter.key} {word}"
        for definition in definitions()
        for parameter in definition.parameters.values()
        for word in parameter.choices or ()
        if word != parameter.default  # which tests need not name
        and f'"{word}"' not in TESTS
        and f"--{parameter.key.replace('_', '-')} {word}" not in TESTS
    ]


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
