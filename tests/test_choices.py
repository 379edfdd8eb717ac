"""Every choice of every parameter has an oracle: a new one fails here until a test has it."""

from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest

from mapdeal.cli.main import command_names
from mapdeal.command import commands_named
from mapdeal.stages.catalogue import STAGES

# Test modules that compare each choice of a parameter with an oracle, or a recorded result.
ORACLES = {
    "active canvas": "test_active",
    "rotate rule": "test_resample",
    "rescale rule": "test_resample",
    "inflate kernel": "test_inflate",
    "esdf unknown": "test_esdf",
    "esdf convention": "test_esdf",
    "esdf view": "test_esdf",
    "exponential lookup": "test_exponential_cost",
    "threshold view": "test_other_costs",
    "build method": "test_build",
    "convert read_as": "test_bags",
    "convert encoding": "test_editing",
    "convert mode": "test_dialects",
    "edit polygon overlay": "test_draw",
    "edit line overlay": "test_draw",
    "edit circle overlay": "test_draw",
    "info costmap": "test_robot",
    "info dialect": "test_dialects",
    "lint costmap": "test_lint_parameters",
    "lint format": "test_reports",
    "local frame": "test_local_map",
    "local unknown": "test_rolling_map",
    "merge rule": "test_merge",
    "query rule": "test_query_poses",
    "query unknown": "test_esdf",
    "query convention": "test_esdf",
    "report dialect": "test_dialects",
    "route method": "test_route",
    "route heuristic": "test_asking",
    "run canvas": "test_run",
    "run frame": "test_local_map",
}


def others_of(parameter):
    """Return the choices but the default, which tests need not name."""
    return [word for word in parameter.choices if word != parameter.default]


def choices():
    for stage in STAGES:
        for one in stage.parameters.values():
            yield f"{stage.model or stage.name} {one.key}", others_of(one)
    for name in filter(lambda name: find_spec(f"mapdeal.commands.{name}"), command_names()):
        import_module(f"mapdeal.commands.{name}")
        for word, definition in commands_named(name).items():
            for one in definition.parameters.values():
                yield f"{name} {word} {one.key}".replace("  ", " "), others_of(one)


CHOICES = {name: words for name, words in choices() if words}


def test_oracles_are_of_parameters_that_there_are():
    assert ORACLES.keys() <= CHOICES.keys()


@pytest.mark.parametrize("name", CHOICES)
def test_every_choice_has_an_oracle(name):
    modules = list(Path(__file__).parent.rglob(f"{ORACLES.get(name)}.py"))
    assert modules, f"name the module that compares the choices of {name} with an oracle"
    text = "".join(module.read_text() for module in modules)
    option = f"--{name.split()[-1].replace('_', '-')}"
    said = ('"{}"', f"{option} {{}}")
    missing = [word for word in CHOICES[name] if not any(one.format(word) in text for one in said)]
    assert not missing, f"{name}: no oracle for {', '.join(missing)}"
