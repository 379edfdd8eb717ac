"""The command that docs/architecture.md adds, in the shell and in Python."""

import json
import re
import sys
from importlib import import_module
from pathlib import Path

import pytest

import mapdeal
from mapdeal import commands

ROOT = Path(__file__).parents[2]
OFFICE = ROOT / "examples" / "maps" / "office.yaml"


@pytest.fixture
def stats(monkeypatch, tmp_path):
    text = (ROOT / "docs" / "architecture.md").read_text()
    code = next(c for c in re.findall(r"```python\n(.*?)```", text, re.DOTALL) if "stats" in c)
    (tmp_path / "stats.py").write_text(code)
    monkeypatch.setattr(commands, "__path__", [*commands.__path__, str(tmp_path)])
    yield import_module("mapdeal.commands.stats").stats
    del sys.modules["mapdeal.commands.stats"], commands.stats


def test_it_measures_a_map_in_the_shell_as_in_python(stats, sh):
    office = mapdeal.read_map(OFFICE)
    found = stats(office)
    assert found.free == pytest.approx((office.occupancy == 0).sum() * 0.05**2)
    assert 0.5 < found.corridor_width < 3
    told = sh.ok(f"stats {OFFICE}").splitlines()
    assert told == [line.replace("the map", str(OFFICE)) for line in found.lines()]
    document = json.loads(sh.ok(f"stats {OFFICE} --json"))
    assert document == {**found.document(), "name": str(OFFICE)}


def test_its_parameters_are_checked_and_its_help_is_complete(stats, sh):
    told = "error: --widest: must be a finite number, above 0, got -1.0\n"
    assert sh.err(f"stats {OFFICE} --widest -1", 2) == told
    out = sh.ok("stats --help")
    assert "What is wider is not a corridor, metres." in out
    assert "mapdeal stats examples/maps/office.yaml" in out
