"""The command that docs/architecture.md adds, in the shell and in Python."""

import json
import re
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
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


def test_it_measures_a_map_in_the_shell_as_in_python(stats, command):
    code, out, err = command("stats", OFFICE)
    assert (code, err) == (0, "")
    values = np.asarray(mapdeal.read_map(OFFICE).occupancy)
    found = stats(mapdeal.read_map(OFFICE))
    assert found.free == pytest.approx((values == 0).sum() * 0.05**2)
    assert out.splitlines() == [line.replace("the map", str(OFFICE)) for line in found.lines()]
    assert 0.5 < found.corridor_width < 3
    code, out, _ = command("stats", OFFICE, "--json")
    assert json.loads(out) == {**found.document(), "name": str(OFFICE)}


def test_its_parameters_are_checked_and_its_help_is_complete(stats, command):
    code, out, err = command("stats", OFFICE, "--widest", "-1")
    assert (code, out) == (2, "")
    assert err == "error: --widest: must be a finite number, above 0, got -1.0\n"
    code, out, _ = command("stats", "--help")
    assert "What is wider is not a corridor, metres." in out
    assert "mapdeal stats examples/maps/office.yaml" in out
