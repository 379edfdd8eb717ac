"""A stage and a cost model that only the list of stages knows: what docs/architecture.md promises.

The stage is the one that is printed there.
"""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import pytest

import mapdeal
from drawn import grid_from_text
from mapdeal import Costmap, read_map, write_map
from mapdeal.cli.apps import stage_app
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
    cost = np.full(source.shape, int(beyond), np.uint8)
    return Costmap(cost, source.resolution, source.origin)


@pytest.fixture
def room(tmp_path, monkeypatch):
    """A map, with the two in the list of stages."""
    block = re.search(
        r"^```python\n(\"\"\"Stage .*?)^```", PAGE.read_text(), re.MULTILINE | re.DOTALL
    )
    names = {"__name__": "mapdeal.stages.drop_lone"}
    exec(compile(block[1], PAGE.name, "exec"), names)  # noqa: S102
    listed = (stage_of(names["drop_lone"]), *catalogue.STAGES, stage_of(flat_cost))
    monkeypatch.setattr(catalogue, "STAGES", listed)
    monkeypatch.setattr(catalogue, "STAGE_NAMES", ("drop-lone", *catalogue.STAGE_NAMES))
    write_map(tmp_path / "room.yaml", grid_from_text(ROOM, 0.25))
    return tmp_path / "room.yaml"


def test_it_has_a_command(command, room, tmp_path):
    code, out, _ = command("drop-lone", "--help")
    assert code == 0
    assert "Free obstacle cells that touch no other." in out
    text = " ".join(out.split())
    assert "--lethal-threshold N Occupancy of an obstacle, 1..100. [default: 100]" in text
    assert "first sentence" not in out
    others = command("--help")[1].split("Changing a map:")[1]
    assert "drop-lone" in others
    assert "..." not in others
    code, out, err = command("drop-lone", room, "-o", tmp_path / "out.yaml", "--image",
                             tmp_path / "out.png")  # fmt: skip
    assert (code, err) == (0, "")
    assert (tmp_path / "out.png").exists()
    cleaned, before = read_map(tmp_path / "out.yaml").occupancy, read_map(room).occupancy
    changed = np.argwhere(cleaned != before)
    assert changed.tolist() == [[3, 2]]
    assert (before[3, 2], cleaned[3, 2]) == (100, 0)


@pytest.mark.usefixtures("mapdeal_warnings")
def test_its_models_options_join_the_command(command, room, tmp_path):
    text = " ".join(command("cost", "--help")[1].split())
    models = "|".join(str(model) for model in catalogue.models_of("cost"))
    assert f"--model {models} " in text
    assert models.endswith("|flat")
    assert "With --model flat: --beyond M Nothing lies so far away, metres. [default: 1.5]" in text
    output = tmp_path / "c.npz"
    assert command("cost", room, "-o", output, "--model", "flat", "--beyond", 7)[0] == 0
    assert (read_map(output).cost == 7).all()
    code, _, err = command("cost", room, "-o", output, "--force", "--beyond", 7)
    assert code == 2
    assert "is a parameter of model flat, not of exponential" in err


@pytest.mark.usefixtures("mapdeal_warnings")
def test_a_model_without_a_curve_has_none(command, room, tmp_path):
    words = ("cost", room, "-o", tmp_path / "c.npz", "--model", "flat")
    code, _, err = command(*words, "--curve", tmp_path / "c.png")
    assert code == 2
    assert "cost flat: no cost depends on the distance from an obstacle" in err
    assert {path.name for path in tmp_path.iterdir()} == {"room.pgm", "room.yaml"}
    code, out, _ = command(*words, "--json", "-q")
    assert code == 0
    document = json.loads(out)
    assert document["curve"] is None
    assert document["parameters"] == {"model": "flat", "beyond": 1.5}


def test_it_runs_in_recipes_whole_and_in_blocks(command, room, tmp_path, monkeypatch):
    recipe = tmp_path / "own.yaml"
    recipe.write_text("stages:\n  - drop-lone:\n  - esdf:\n  - cost: {model: flat}\n")
    words = ("run", room, "--recipe", recipe, "--set", "drop-lone.lethal_threshold=50")
    contents = []
    for name in ("whole", "blocks"):
        if name == "blocks":
            monkeypatch.setattr(memory, "bytes_in_memory", lambda *_, **__: 1 << 60)
            monkeypatch.setattr(memory, "_cut", lambda *_, **__: (2, memory.CacheBudget()))
        code, _, err = command(*words, "-o", tmp_path / name, "-v")
        assert (code, "processed in blocks" in err) == (0, name == "blocks")
        folder = tmp_path / name / "room"
        contents.append({path.name: path.read_bytes() for path in folder.iterdir()})
    assert contents[0] == contents[1]
    assert {"without_lone.pgm", "without_lone.yaml", "without_lone.png"} <= contents[0].keys()
    manifest = json.loads(contents[0]["manifest.json"])
    assert manifest["stages"][0] == {"drop-lone": {"lethal_threshold": 50}}
    assert manifest["stages"][2] == {"cost": {"model": "flat", "beyond": 1.5}}
    assert command(*words, "-o", tmp_path / "whole", "-n")[1].startswith("what")


def test_a_stage_that_is_not_listed_is_not_known(command, room, tmp_path, monkeypatch):
    monkeypatch.undo()
    code, _, err = command("drop-lone", room, "-o", tmp_path / "out.yaml")
    assert code == 2
    assert "no such command" in err.lower()


def test_names_that_collide_are_refused(command, room, monkeypatch):
    other = replace(stage_of(flat_cost), model="flatter")
    other.__dict__["own_parameters"] = {
        name: replace(one, default=9.0) for name, one in stage_of(flat_cost).parameters.items()
    }
    monkeypatch.setattr(catalogue, "STAGES", (*catalogue.STAGES, other))
    with pytest.raises(ValueError, match=r"flat, flatter of cost .* one name: beyond"):
        stage_app("cost")
