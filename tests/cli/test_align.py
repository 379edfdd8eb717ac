"""The command align: what it prints, writes and refuses, and its exit codes."""

import json
import math

import numpy as np
import pytest
from PIL import Image

import mapdeal
from compare.buildings import HALL, WALLS, between, drawn, errors
from mapdeal.grid.frame import Transform
from mapdeal.sensors.points import read_transform

HERE, THERE = Transform(-3.2, 11.7, 0.3), Transform(5.0, 2.0, 2.2)
TRUE = between(HERE, THERE)


@pytest.fixture
def maps(tmp_path, monkeypatch):
    """a and b are of one building; hall and turned may be turned by half a turn or not."""
    monkeypatch.chdir(tmp_path)
    mapdeal.write_map("a.yaml", drawn(WALLS, 0.15, HERE, origin_yaw=0.2))
    mapdeal.write_map("b.yaml", drawn(WALLS, 0.2, THERE))
    mapdeal.write_map("hall.yaml", drawn(HALL, 0.2))
    mapdeal.write_map("turned.yaml", drawn(HALL, 0.2, THERE))
    return tmp_path


def test_a_transform_is_found_written_and_printed(maps, command):
    code, out, err = command("align", "a.yaml", "b.yaml", "-o", "t.json", "--image", "t.png")
    assert (code, err) == (0, "")
    assert out.startswith("a.yaml, b.yaml: the same place\n  transform  x ")
    told = read_transform(maps / "t.json")
    off, turn = errors(told.transform, TRUE, mapdeal.read_map("a.yaml"))
    assert off < 0.1
    assert turn < 0.3
    assert set(told.first) == {"a.yaml", "a.pgm"}
    assert set(told.second) == {"b.yaml", "b.pgm"}
    with Image.open("t.png") as image:
        colours = image.convert("RGB").getcolors(1 << 20)
    walls_of_both = sum(count for count, colour in colours if colour == (0, 0, 0))
    assert walls_of_both > 2000


def test_json_says_what_the_file_says(maps, command):
    _, out, _ = command("align", "a.yaml", "b.yaml", "-o", "t.json", "--json")
    document = json.loads(out)
    assert document == json.loads((maps / "t.json").read_text())
    assert document["same_place"] is True
    assert document["reason"] is None
    assert document["score"] > 2 * document["runner_up"]
    assert document["transform"] == {key: document[key] for key in ("x", "y", "yaw", "yaw_deg")}
    assert math.degrees(document["transform"]["yaw"]) == pytest.approx(
        document["transform"]["yaw_deg"]
    )


def test_what_is_not_sure_is_said_and_written_and_ends_with_1(maps, command):
    code, out, _ = command("align", "hall.yaml", "turned.yaml", "-o", "t.json")
    assert code == 1
    assert "not sure: another place fits nearly as well" in out
    assert json.loads((maps / "t.json").read_text())["same_place"] is False
    with pytest.warns(mapdeal.MapdealWarning, match="uncertain"):
        read_transform(maps / "t.json")


def test_a_prior_and_turns_narrow_the_search(maps, command):
    assert command("align", "hall.yaml", "turned.yaml", "--prior", "5.3,1.8,2.1")[0] == 0
    degrees = math.degrees(TRUE.yaw)
    assert command("align", "a.yaml", "b.yaml", "--rotation", f"{degrees:.1f},10")[0] == 0
    assert command("align", "a.yaml", "b.yaml", "--rotation", "0,180")[0] == 1


def test_from_python_as_from_the_command_line(maps, command):
    found = mapdeal.align("a.yaml", mapdeal.read_map("b.yaml"))
    document = json.loads(command("align", "a.yaml", "b.yaml", "--json")[1])
    assert found.transform.pose == tuple(document["transform"][key] for key in ("x", "y", "yaw"))
    near = mapdeal.align("hall.yaml", "turned.yaml", prior=(5.3, 1.8, 2.1))
    assert near.same_place
    for prior in ([1, 2], "north", 3.0):
        with pytest.raises(mapdeal.ParameterError, match="prior"):
            mapdeal.align("a.yaml", "b.yaml", prior=prior)
    with pytest.raises(mapdeal.ParameterError, match="takes files or grids"):
        mapdeal.align(np.zeros((2, 3)), "b.yaml")
