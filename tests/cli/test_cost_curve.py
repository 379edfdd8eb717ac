"""``mapdeal cost --curve`` and ``--json``."""

import json
from pathlib import Path

import pytest

import mapdeal
from bad_maps import tree
from drawn import grid_from_text
from mapdeal import read_map, write_map
from mapdeal.pipeline import run as single

ROOM = "........\n.#......\n......?.\n...##..."
SHAPE = "[[0.3,0.2],[-0.3,0.2],[-0.3,-0.2],[0.3,-0.2]]"
ROBOT = f"--footprint {SHAPE} --inflation-radius 0.55"


@pytest.fixture
def room(here):
    write_map("room.yaml", grid_from_text(ROOM, 0.1, (1.5, -2.0, 0.4)))
    return read_map("room.yaml")


def test_the_picture_is_that_of_the_python_face(sh, room):
    out = sh.ok(f"cost room.yaml -o c.npz {ROBOT} --lookup nav2 --curve new/curve.png")
    assert out.startswith("c.npz: 8 x 4 cells")
    footprint = mapdeal.Footprint.parse(SHAPE)
    curve = mapdeal.cost_curve(room, footprint=footprint, inflation_radius=0.55, lookup="nav2")
    title = "room: cost, inscribed 0.2 m, inflation 0.55 m, factor 10"
    drawn = mapdeal.draw_picture(curve, title=title)
    assert Path("new/curve.png").read_bytes() == drawn.png() != curve._repr_png_()


@pytest.mark.parametrize(
    ("words", "model"),
    [
        (ROBOT, "exponential"),
        ("--model rings --values 90,20", "rings"),
        ("--model threshold --view per-map", "threshold"),
    ],
)
@pytest.mark.usefixtures("mapdeal_warnings")
def test_json_is_one_document(sh, here, room, words, model):
    document = json.loads(sh.ok(f"cost room.yaml -o c.npz --json -q {words}"))
    grid = read_map("c.npz")
    assert document["figures"] == grid.figures()
    assert document["parameters"]["model"] == model
    parameters = {k: v for k, v in document["parameters"].items() if k != "lethal_threshold"}
    curve = mapdeal.cost_curve(room, **parameters)
    assert {k: document[k] for k in curve.document()} == curve.document()
    assert document["cost_scale"] == grid.scale
    assert document["circumscribed_cost"] == grid.circumscribed_cost
    assert not list(here.glob("*.png"))


def test_both_go_with_other_outputs_and_a_field(sh, room):
    sh("esdf room.yaml -o esdf.npz")
    document = sh.json("cost esdf.npz -o c.yaml --image c.png --curve curve.png --json")
    assert document["reach_cells"] == 6
    assert all(Path(name).exists() for name in ("c.yaml", "c.pgm", "c.png", "curve.png"))


def test_outputs_come_together_or_not_at_all(sh, here, room, monkeypatch):
    Path("curve.png").write_bytes(b"kept")
    before = tree(here)
    line = "cost room.yaml -o c.npz --curve curve.png"
    assert "curve.png: the output exists" in sh.err(line, 4)
    assert tree(here) == before
    assert sh(f"{line} --force")[0] == 0
    assert Path("curve.png").read_bytes().startswith(b"\x89PNG")

    def fail(*_, **__):
        raise mapdeal.ParameterError("in the end", source="test")

    monkeypatch.setattr(single, "emit_warning", fail)
    before = tree(here)
    assert "in the end" in sh.err(f"{line} --force --inscribed-radius 9 --inflation-radius 9", 2)
    assert tree(here) == before
