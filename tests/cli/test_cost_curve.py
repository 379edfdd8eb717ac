"""``mapdeal cost --curve`` and ``--json``."""

import json

import pytest

import mapdeal
from drawn import grid_from_text
from mapdeal import read_map, write_map
from mapdeal.pipeline import run as single

ROOM = "........\n.#......\n......?.\n...##..."
ROBOT = ("--footprint", "[[0.3,0.2],[-0.3,0.2],[-0.3,-0.2],[0.3,-0.2]]", "--inflation-radius", 0.55)


@pytest.fixture
def room(tmp_path):
    write_map(tmp_path / "room.yaml", grid_from_text(ROOM, 0.1, (1.5, -2.0, 0.4)))
    return tmp_path / "room.yaml"


def test_the_picture_is_that_of_the_python_face(command, room, tmp_path):
    picture = tmp_path / "new" / "curve.png"
    code, out, err = command(
        "cost", room, "-o", tmp_path / "c.npz", *ROBOT, "--lookup", "nav2", "--curve", picture
    )
    assert (code, err) == (0, "")
    assert out.startswith(f"{tmp_path / 'c.npz'}: 8 x 4 cells")
    curve = mapdeal.cost_curve(
        read_map(room),
        footprint=mapdeal.Footprint.parse(ROBOT[1]),
        inflation_radius=0.55,
        lookup="nav2",
    )
    drawn = mapdeal.draw_picture(
        curve, title="room: cost, inscribed 0.2 m, inflation 0.55 m, factor 10"
    )
    assert picture.read_bytes() == drawn.png() != curve._repr_png_()


@pytest.mark.parametrize(
    "words",
    [
        ROBOT,
        ["--model", "rings", "--values", "90,20"],
        ["--model", "threshold", "--view", "per-map"],
    ],
)
@pytest.mark.usefixtures("mapdeal_warnings")
def test_json_is_one_document(command, room, tmp_path, words):
    output = tmp_path / "c.npz"
    code, out, err = command("cost", room, "-o", output, "--json", "-q", *words)
    assert (code, err) == (0, "")
    document = json.loads(out)
    grid = read_map(output)
    assert document["figures"] == grid.figures()
    assert document["parameters"]["model"] == (words[1] if "--model" in words else "exponential")
    parameters = {k: v for k, v in document["parameters"].items() if k != "lethal_threshold"}
    curve = mapdeal.cost_curve(read_map(room), **parameters)
    assert {k: document[k] for k in curve.document()} == curve.document()
    assert document["cost_scale"] == grid.scale
    assert document["circumscribed_cost"] == grid.circumscribed_cost
    assert not list(tmp_path.glob("*.png"))


def test_both_go_with_other_outputs_and_a_field(command, room, tmp_path):
    assert command("esdf", room, "-o", tmp_path / "esdf.npz")[0] == 0
    code, out, _ = command(
        "cost", tmp_path / "esdf.npz", "-o", tmp_path / "c.yaml", "--image", tmp_path / "c.png",
        "--curve", tmp_path / "curve.png", "--json",
    )  # fmt: skip
    assert code == 0
    assert json.loads(out)["reach_cells"] == 6
    assert {path.name for path in tmp_path.iterdir()} == {
        "room.pgm", "room.yaml", "esdf.npz", "c.yaml", "c.pgm", "c.png", "curve.png",
    }  # fmt: skip


def test_outputs_come_together_or_not_at_all(command, room, tmp_path, monkeypatch):
    output, curve = tmp_path / "c.npz", tmp_path / "curve.png"
    curve.write_bytes(b"kept")
    before = sorted(tmp_path.iterdir())
    code, _, err = command("cost", room, "-o", output, "--curve", curve)
    assert code == 4
    assert "curve.png: the output exists" in err
    assert sorted(tmp_path.iterdir()) == before
    assert curve.read_bytes() == b"kept"
    assert command("cost", room, "-o", output, "--curve", curve, "--force")[0] == 0
    assert curve.read_bytes().startswith(b"\x89PNG")

    def fail(*_, **__):
        raise mapdeal.ParameterError("in the end", source="test")

    monkeypatch.setattr(single, "emit_warning", fail)
    written = output.read_bytes(), curve.read_bytes()
    closed = ["--inscribed-radius", 9, "--inflation-radius", 9]
    code, _, err = command("cost", room, "-o", output, "--curve", curve, "--force", *closed)
    assert (code, "in the end" in err) == (2, True)
    assert (output.read_bytes(), curve.read_bytes()) == written


def test_what_cannot_be_is_refused(command, room, tmp_path):
    output = tmp_path / "c.npz"
    cases = [
        (["--curve", "c.jpg"], 2, "--curve: a picture must end in .png, got 'c.jpg'"),
        (["--curve", "-"], 2, "--curve: a picture must end in .png, got '-'"),
        (["--image", tmp_path / "a.png", "--curve", tmp_path / "a.png"], 2,
         "--curve: is an output already"),
    ]  # fmt: skip
    for words, code, text in cases:
        found = command("cost", room, "-o", output, *words)
        assert (found[0], found[1]) == (code, "")
        assert text in found[2]
    code, out, err = command("cost", room, "-o", "-", "--json")
    assert (code, out) == (2, "")
    assert "--json: cannot be given together with -o -" in err
    assert {path.name for path in tmp_path.iterdir()} == {"room.pgm", "room.yaml"}


def test_an_input_is_no_place_for_it(command, tmp_path):
    grid = grid_from_text(ROOM, 0.1)
    write_map(tmp_path / "a.png", grid)  # the pair's image
    before = (tmp_path / "a.png").read_bytes()
    code, _, err = command(
        "cost", tmp_path / "a.yaml", "-o", tmp_path / "c.npz", "--curve", tmp_path / "a.png",
        "--force",
    )  # fmt: skip
    assert code == 4
    assert "the output is the input" in err
    assert (tmp_path / "a.png").read_bytes() == before


def test_only_costs_have_it(command, room, tmp_path):
    for words in (["--curve", tmp_path / "a.png"], ["--json"]):
        code, _, err = command("inflate", room, "-o", tmp_path / "i.yaml", *words)
        assert code == 2
        assert "no such option" in err.lower()
