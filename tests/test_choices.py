"""Every choice of every parameter is named by a test: a new one fails here until one does."""

from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

from mapdeal.cli.main import command_names
from mapdeal.command import commands_named
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
