"""Every choice of every parameter is named by a test: a new one fails here until one does."""

from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest

from mapdeal.cli.main import command_names
from mapdeal.command import commands_named
from mapdeal.stages.catalogue import STAGES

TESTS = "".join(
    path.read_text()
    for path in Path(__file__).parent.rglob("*.py")
    if path.name not in ("record_commands.py", "test_help_pages.py")
)


def choices():
    """Yield parameters and their choices but the default, which tests need not name."""
    for stage in STAGES:
        yield from ((one, stage.model or stage.name) for one in stage.parameters.values())
    for name in filter(lambda name: find_spec(f"mapdeal.commands.{name}"), command_names()):
        import_module(f"mapdeal.commands.{name}")
        for definition in commands_named(name).values():
            yield from ((one, name) for one in definition.parameters.values())


CHOICES = {f"{name} {one.key}": one for one, name in choices() if one.choices}


@pytest.mark.parametrize("name", CHOICES)
def test_every_choice_is_named_by_a_test(name):
    one = CHOICES[name]
    option = f"--{one.key.replace('_', '-')}"
    others = [word for word in one.choices if word != one.default]
    missed = [w for w in others if f'"{w}"' not in TESTS and f"{option} {w}" not in TESTS]
    assert not missed
