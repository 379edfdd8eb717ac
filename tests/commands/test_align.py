"""The command align: its output, its files, and its exit codes."""

import json
import math
from pathlib import Path

import pytest
from PIL import Image

import mapdeal
from compare.buildings import HALL, WALLS, between, drawn, errors
from mapdeal.grid.frame import Transform
from mapdeal.sensors.points import read_transform

HERE, THERE = Transform(-3.2, 11.7, 0.3), Transform(5.0, 2.0, 2.2)
TRUE = between(HERE, THERE)
PRIOR = (5.3, 1.8, 2.1)


@pytest.fixture(autouse=True)
def maps(here):
    mapdeal.write_map("a.yaml", drawn(WALLS, 0.15, HERE, origin_yaw=0.2))
    mapdeal.write_map("b.yaml", drawn(WALLS, 0.2, THERE))
    mapdeal.write_map("hall.yaml", drawn(HALL, 0.2))
    mapdeal.write_map("turned.yaml", drawn(HALL, 0.2, THERE))


def test_a_transform_is_found_written_and_printed(sh):
    out = sh.ok("align a.yaml b.yaml -o t.json --image t.png")
    assert out.startswith("a.yaml, b.yaml: the same place\n  transform  x ")
    written = read_transform(Path("t.json"))
    off, turn = errors(written.transform, TRUE, mapdeal.read_map("a.yaml"))
    assert off < 0.1
    assert turn < 0.3
    assert set(written.first) == {"a.yaml", "a.pgm"}
    assert set(written.second) == {"b.yaml", "b.pgm"}
    with Image.open("t.png") as image:
        colours = image.convert("RGB").getcolors(1 << 20)
    walls_of_both = sum(count for count, colour in colours if colour == (0, 0, 0))
    assert walls_of_both > 2000
    document = json.loads(Path("t.json").read_text())
    assert sh.json("align a.yaml b.yaml --json") == document
    assert (document["same_place"], document["reason"]) == (True, None)
    assert document["score"] > 2 * document["runner_up"]
    assert document["transform"] == {key: document[key] for key in ("x", "y", "yaw", "yaw_deg")}
    assert math.degrees(document["yaw"]) == pytest.approx(document["yaw_deg"])
    found = mapdeal.align("a.yaml", mapdeal.read_map("b.yaml"))
    assert found.transform.pose == (document["x"], document["y"], document["yaw"])


def test_an_uncertain_transform_is_warned_of_and_written_and_ends_with_1(sh):
    line = "align hall.yaml turned.yaml"
    code, out, _ = sh(f"{line} -o t.json")
    assert (code, "uncertain: another place fits nearly as well" in out) == (1, True)
    assert json.loads(Path("t.json").read_text())["same_place"] is False
    with pytest.warns(mapdeal.MapdealWarning, match="uncertain"):
        read_transform(Path("t.json"))
    assert sh(f"{line} --prior {','.join(map(str, PRIOR))}")[0] == 0
    assert mapdeal.align("hall.yaml", "turned.yaml", prior=PRIOR).same_place


def test_the_candidates_of_an_uncertain_pair_are_listed_drawn_and_taken(sh):
    code, out, _ = sh("align hall.yaml turned.yaml -o t.json --image t.png")
    document = json.loads(Path("t.json").read_text())
    first, second, *_ = document["candidates"]
    assert (code, document["chosen_by"], first["x"]) == (1, "score", document["x"])
    assert first["score"] >= second["score"]
    assert f"candidate 2: x {second['x']:.3f} m, y {second['y']:.3f} m" in out
    code, out, _ = sh("align hall.yaml turned.yaml -o u.json --image u.png --candidate 2")
    taken = json.loads(Path("u.json").read_text())
    assert (code, taken["chosen_by"], taken["same_place"]) == (1, "user", False)
    assert {key: taken[key] for key in second if key in taken} == {
        key: value for key, value in second.items() if key in taken
    }
    assert "candidate 2 (chosen)" in out
    with Image.open("t.png") as all_of_them, Image.open("u.png") as image:
        assert all_of_them.width > 1.5 * image.width
    assert read_transform(Path("u.json")).transform.x == second["x"]  # without a warning
    assert "--candidate: must be from 1 to" in sh.err(
        "align hall.yaml turned.yaml --candidate 9", 2
    )
    assert "does not apply: the match is certain" in sh.err("align a.yaml b.yaml --candidate 1", 2)


def test_turns_narrow_the_search(sh):
    line = "align a.yaml b.yaml --rotation"
    assert sh(f"{line} {math.degrees(TRUE.yaw):.1f},10")[0] == 0
    assert sh(f"{line} 0,180")[0] == 1
