"""A stage and a cost model that only the list of stages knows: what docs/architecture.md promises.

The stage is the one that is printed there.
"""

import json
import re
import sys
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Annotated

import numpy as np
import pytest
import typer

import mapdeal
import schemas
from drawn import grid_from_text
from mapdeal import Costmap, commands, read_map, write_map
from mapdeal.cli.apps import command_app
from mapdeal.command import AT_LEAST_0, METRES, stage_of
from mapdeal.pipeline import inputs as memory
from mapdeal.stages import catalogue
from mapdeal.stages.cost import cost_model

PAGE = Path(__file__).parents[2] / "docs" / "architecture.md"
ROOM = """
    ########
    #...?..#
    #.#....#
    #.....##
    #.+....#
    ########
"""


@cost_model(
    "flat",
    title=lambda parameters: f"cost, flat {parameters['beyond']:g} m",
    memory=2.0,
    advice=lambda parameters, _: f"change beyond ({parameters['beyond']:g} m)",
    when_closed="nothing helps",
)
def flat_cost(
    source: mapdeal.OccupancyGrid, *, beyond: Annotated[float, AT_LEAST_0, METRES] = 1.5
) -> Costmap:
    """Return the same cost everywhere.

    Parameters
    ----------
    source : OccupancyGrid
        The map.
    beyond : float
        Nothing lies so far away, metres. This sentence is not for the help.
    """
    return Costmap(np.full(source.shape, int(beyond), np.uint8), source.resolution, source.origin)


@pytest.fixture(autouse=True)
def _unshared_commands(monkeypatch):
    """Build the commands of each test anew, from the stages that it adds."""
    monkeypatch.setattr(typer.main, "get_command", typer.main.get_command.__wrapped__)


@pytest.fixture
def listed(here, monkeypatch):
    block = re.search(r"(?ms)^```python\n(\"\"\"Stage .*?)^```", PAGE.read_text())
    names = {"__name__": "mapdeal.stages.drop_lone"}
    exec(compile(block[1], PAGE.name, "exec"), names)  # noqa: S102
    stages = (stage_of(names["drop_lone"]), *catalogue.STAGES, stage_of(flat_cost))
    monkeypatch.setattr(catalogue, "STAGES", stages)
    monkeypatch.setattr(catalogue, "STAGE_NAMES", ("drop-lone", *catalogue.STAGE_NAMES))
    monkeypatch.delitem(schemas.DOCUMENTS, "cost")  # made of the stages that were listed before
    write_map("room.yaml", grid_from_text(ROOM, 0.25))


def test_it_has_a_command(sh, listed):
    text = " ".join(sh.ok("drop-lone --help").split())
    assert "Free obstacle cells that touch no other." in text
    assert "--lethal-threshold N Occupancy of an obstacle, 1..100. [default: 100]" in text
    assert "first sentence" not in text
    listed_commands = sh.ok("--help").split("Changing a map:")[1]
    assert ("drop-lone" in listed_commands, "..." in listed_commands) == (True, False)
    sh.ok("drop-lone room.yaml -o out.yaml --image out.png")
    assert Path("out.png").exists()
    cleaned, before = read_map("out.yaml").occupancy, read_map("room.yaml").occupancy
    assert np.argwhere(cleaned != before).tolist() == [[3, 2]]
    assert (before[3, 2], cleaned[3, 2]) == (100, 0)


@pytest.mark.usefixtures("mapdeal_warnings")
def test_its_models_options_join_the_command(sh, listed):
    text = " ".join(sh.ok("cost --help").split())
    models = "|".join(str(model) for model in catalogue.models_of("cost"))
    assert f"--model {models} " in text
    assert models.endswith("|flat")
    assert "With --model flat: --beyond M Nothing lies so far away, metres. [default: 1.5]" in text
    document = sh.json("cost room.yaml -o c.npz --model flat --beyond 7 --json -q")
    assert (read_map("c.npz").cost == 7).all()
    assert document["curve"] is None
    assert document["parameters"] == {"model": "flat", "beyond": 7}


@pytest.mark.parametrize(("words", "message"), [
    ("--beyond 7", "is a parameter of model flat, not of exponential"),
    ("--model flat --curve c.png", "cost flat: no cost depends on the distance from an obs"),
])  # fmt: skip
def test_parameters_of_other_models_are_refused(sh, here, listed, words, message):
    assert message in sh.err(f"cost room.yaml -o c.npz {words}", 2)
    assert {path.name for path in here.iterdir()} == {"room.pgm", "room.yaml"}


def test_it_runs_in_recipes_whole_and_in_blocks(sh, listed, monkeypatch):
    Path("own.yaml").write_text("stages:\n  - drop-lone:\n  - esdf:\n  - cost: {model: flat}\n")
    line = "run room.yaml --recipe own.yaml --set drop-lone.lethal_threshold=50 -v"
    blocks = memory.BlockPlan(2, memory.CacheBudget())
    contents = []
    for name in ("whole", "blocks"):
        if name == "blocks":
            monkeypatch.setattr(memory, "bytes_in_memory", lambda *_, **__: 1 << 60)
            monkeypatch.setattr(memory, "_block_plan", lambda *_, **__: blocks)
        assert ("processed in blocks" in sh.err(f"{line} -o {name}")) == (name == "blocks")
        contents.append({path.name: path.read_bytes() for path in Path(name, "room").iterdir()})
    assert contents[0] == contents[1]
    assert {"without_lone.pgm", "without_lone.yaml", "without_lone.png"} <= contents[0].keys()
    stages = json.loads(contents[0]["manifest.json"])["stages"]
    assert stages[0] == {"drop-lone": {"lethal_threshold": 50}}
    assert stages[2] == {"cost": {"model": "flat", "beyond": 1.5}}


def test_names_that_collide_are_refused(listed, monkeypatch):
    clone = replace(stage_of(flat_cost), model="flatter")
    parameters = stage_of(flat_cost).parameters
    changed = {name: replace(parameters[name], default=9.0) for name in parameters}
    clone.__dict__["own_parameters"] = changed
    monkeypatch.setattr(catalogue, "STAGES", (*catalogue.STAGES, clone))
    with pytest.raises(ValueError, match=r"flat, flatter of cost .* one name: beyond"):
        command_app("cost")


OFFICE = Path(__file__).parents[2] / "examples" / "maps" / "office.yaml"


@pytest.fixture
def stats(monkeypatch, tmp_path):
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    (tmp_path / "stats.py").write_text(next(block for block in blocks if "stats" in block))
    monkeypatch.setattr(commands, "__path__", [*commands.__path__, str(tmp_path)])
    yield import_module("mapdeal.commands.stats").stats
    del sys.modules["mapdeal.commands.stats"], commands.stats


def test_it_measures_a_map_in_the_shell_as_in_python(stats, sh):
    office = mapdeal.read_map(OFFICE)
    found = stats(office)
    assert found.free == pytest.approx((office.occupancy == 0).sum() * 0.05**2)
    assert 0.5 < found.corridor_width < 3
    lines = sh.ok(f"stats {OFFICE}").splitlines()
    assert lines == [line.replace("the map", str(OFFICE)) for line in found.lines()]
    assert json.loads(sh.ok(f"stats {OFFICE} --json")) == {**found.document(), "name": str(OFFICE)}


def test_its_parameters_are_checked_and_its_help_is_complete(stats, sh):
    message = "error: --widest: must be a finite number, above 0, got -1.0\n"
    assert sh.err(f"stats {OFFICE} --widest -1", 2) == message
    out = sh.ok("stats --help")
    assert "Wider spaces are not corridors, metres." in out
    assert "mapdeal stats examples/maps/office.yaml" in out
