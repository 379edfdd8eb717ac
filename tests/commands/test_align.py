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


@pytest.fixture(autouse=True)
def maps(here):
    mapdeal.write_map("a.yaml", drawn(WALLS, 0.15, HERE, origin_yaw=0.2))
    mapdeal.write_map("b.yaml", drawn(WALLS, 0.2, THERE))
    mapdeal.write_map("hall.yaml", drawn(HALL, 0.2))
    mapdeal.write_map("turned.yaml", drawn(HALL, 0.2, THERE))


def test_a_transform_is_found_and_written(sh):
    document = json.loads(sh.ok("align a.yaml b.yaml -o t.json --image t.png --json"))
    assert json.loads(Path("t.json").read_text()) == document
    written = read_transform(Path("t.json"))
    off, turn = errors(written.transform, TRUE, mapdeal.read_map("a.yaml"))
    assert (off < 0.1, turn < 0.3) == (True, True)
    assert set(written.first) == {"a.yaml", "a.pgm"}
    assert set(written.second) == {"b.yaml", "b.pgm"}
    with Image.open("t.png") as image:
        colours = image.convert("RGB").getcolors(1 << 20)
    assert sum(count for count, colour in colours if colour == (0, 0, 0)) > 2000
    assert (document["same_place"], document["reason"]) == (True, None)
    assert document["score"] > 2 * document["runner_up"]
    assert document["transform"] == {key: document[key] for key in ("x", "y", "yaw", "yaw_deg")}
    assert math.degrees(document["yaw"]) == pytest.approx(document["yaw_deg"])
    found = mapdeal.align("a.yaml", mapdeal.read_map("b.yaml"))
    assert found.transform.pose == (document["x"], document["y"], document["yaw"])
    assert mapdeal.diff("a.yaml", "b.yaml", align=True).transform == found.transform


def test_an_uncertain_transform_is_warned_of_and_written_with_its_candidates(sh):
    line = "align hall.yaml turned.yaml"
    code, out, _ = sh(f"{line} -o t.json --image t.png")
    assert (code, "uncertain: another place fits nearly as well" in out) == (1, True)
    document = json.loads(Path("t.json").read_text())
    assert (document["same_place"], document["chosen_by"]) == (False, "score")
    with pytest.warns(mapdeal.MapdealWarning, match="uncertain"):
        read_transform(Path("t.json"))
    first, second, *_ = document["candidates"]
    assert (first["x"], first["score"] >= second["score"]) == (document["x"], True)
    assert f"candidate 2: x {second['x']:.3f} m, y {second['y']:.3f} m" in out
    code, out, _ = sh(f"{line} -o u.json --image u.png --candidate 2")
    taken = json.loads(Path("u.json").read_text())
    assert (code, taken["chosen_by"], taken["same_place"]) == (1, "user", False)
    assert all(taken[key] == second[key] for key in second.keys() & taken.keys())
    assert "candidate 2 (chosen)" in out
    with Image.open("t.png") as all_of_them, Image.open("u.png") as image:
        assert all_of_them.width > 1.5 * image.width
    assert read_transform(Path("u.json")).transform.x == second["x"]  # without a warning
    assert "--candidate: must be from 1 to" in sh.err(f"{line} --candidate 9", 2)
    assert "does not apply: the match is certain" in sh.err("align a.yaml b.yaml --candidate 1", 2)


def test_a_prior_and_turns_narrow_the_search(sh):
    assert sh("align hall.yaml turned.yaml --prior 5.3,1.8,2.1")[0] == 0
    line = "align a.yaml b.yaml --rotation"
    out = sh.ok(f"{line} {math.degrees(TRUE.yaw):.1f},10")
    assert out.startswith("a.yaml, b.yaml: the same place\n  transform  x ")
    assert sh(f"{line} 0,180")[0] == 1
