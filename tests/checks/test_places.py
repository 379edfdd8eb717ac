"""Places of findings on turned maps, against walks and floods in plain Python."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from PIL import Image

import mapdeal
from checks.pairs import write_pair
from drawn import grid_from_text
from mapdeal import OccupancyGrid, write_map
from mapdeal.checks.facts import GridFacts, gather
from mapdeal.checks.map_checks import islands, mostly_unknown, specks
from oracles import groups
from strategies import occupancies

RESOLUTION, ORIGIN = 0.4, (3.0, -7.5, 0.7)


def cell_at(place):
    """Return row and column of a point of the map frame, in a map with `ORIGIN`."""
    x, y = place[0] - ORIGIN[0], place[1] - ORIGIN[1]
    along = math.cos(ORIGIN[2]) * x + math.sin(ORIGIN[2]) * y
    across = -math.sin(ORIGIN[2]) * x + math.cos(ORIGIN[2]) * y
    col, row = along / RESOLUTION - 0.5, across / RESOLUTION - 0.5
    assert abs(col - round(col)) < 1e-6, "the centre of a cell"
    assert abs(row - round(row)) < 1e-6, "the centre of a cell"
    return round(row), round(col)


def cells_of(check, cells):
    """Return the cells that the finding of a check names; empty without a finding."""
    found = list(check(GridFacts.of(OccupancyGrid(cells, RESOLUTION, ORIGIN))))
    assert len(found) <= 1
    return [cell_at(place) for finding in found for place in finding.places]


@given(occupancies(longest=16))
def test_islands_and_specks_are_where_a_flood_ends(cells):
    found = sorted(groups(cells == 0), key=len, reverse=True)
    for check, has_size in ((islands, _is_large), (specks, lambda group: not _is_large(group))):
        named = [
            next(index for index, group in enumerate(found) if cell in group)
            for cell in cells_of(check, cells)
        ]
        assert len(set(named)) == len(named), "an area is named once"
        assert all(has_size(found[index]) for index in named)
        # the largest area is omitted; of several equally large ones, only one is
        expected = [len(group) for group in found[1:] if has_size(group)]
        assert [len(found[index]) for index in named] == expected[:20]


def _is_large(group):
    return len(group) * RESOLUTION**2 >= 1


def test_what_is_known_lies_around_its_middle():
    cells = np.full((9, 12), -1, np.int8)
    cells[2, 3], cells[6, 5] = 0, 100
    assert cells_of(mostly_unknown, cells) == [(4, 4)]


TEXT = """
    ????????????????????????
    ?######################?
    ?#........#...#........?
    ?#........#####........?
    ?#........#..##........?
    ?#........#####........?
    ?######################?
    ????????????????????????
    ????????????????????????
    ????????????????????????
    ????????????????????????
    ????????????????????????
    ????????????????????????
    ????????????????????????
"""


def test_each_kind_of_file_gives_the_same_places(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    grid = grid_from_text(TEXT, RESOLUTION, ORIGIN)
    for name in ("a.yaml", "b.npz", "c.yaml"):
        write_map(name, grid)
    Image.open("c.pgm").save("c.png")
    Path("c.yaml").write_text(Path("c.yaml").read_text().replace(".pgm", ".png"))
    by_file = [
        [(finding.check, finding.places) for finding in mapdeal.lint(name) if finding.places]
        for name in ("a.yaml", "b.npz", "c.yaml")
    ]
    assert by_file[0] == by_file[1] == by_file[2]
    by_check = {name: [cell_at(place) for place in places] for name, places in by_file[0]
                if name != "map.mostly-unknown"}  # fmt: skip
    assert by_check == {"map.islands": [(8, 18)], "map.specks": [(11, 12), (9, 11)]}


def test_the_reports_for_machines_have_them(tmp_path, command, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_map("a.yaml", grid_from_text(TEXT, RESOLUTION, ORIGIN))
    places = {f.check: [{"x": x, "y": y} for x, y in f.places] for f in mapdeal.lint("a.yaml")}
    assert len(places["map.specks"]) == 2
    assert places["yaml.origin-yaw"] == []
    _, out, _ = command("lint", "a.yaml", "--format", "json")
    listed = json.loads(out)["maps"][0]["findings"]
    assert {finding["check"]: finding["places"] for finding in listed} == places
    _, out, _ = command("lint", "a.yaml", "--format", "sarif")
    results = json.loads(out)["runs"][0]["results"]
    properties = {r["ruleId"]: r.get("properties", {"places": []}) for r in results}
    assert properties == {name: {"places": points} for name, points in places.items()}


def test_many_specks_have_twenty_places(tmp_path):
    cells = np.full((40, 50), -1, np.int8)
    cells[1::2, 1::2] = 0
    cells[1, 1:4] = 0
    write_map(tmp_path / "a.yaml", OccupancyGrid(cells, RESOLUTION, ORIGIN))
    _, facts, _ = gather(tmp_path / "a.yaml")
    (found,) = specks(facts)
    assert found.message.startswith("498 specks ")  # 500 cells, of which two became one area
    # without the largest, which is the first; of equally large ones the southernmost
    assert [cell_at(place) for place in found.places] == [(1, col) for col in range(5, 45, 2)]


GREYS = np.array([[0, 254, 205, 150, 90], [90, 90, 150, 205, 254], [7, 254, 90, 0, 51]], np.uint8)


def first_of(grey):
    row, col = np.argwhere(grey == GREYS)[0].tolist()
    return len(GREYS) - 1 - row, col


TURNED = {"resolution": RESOLUTION, "origin": list(ORIGIN)}


@pytest.mark.parametrize("strip", [1, 1 << 20])
@pytest.mark.parametrize("kind", ["pgm", "png"])
def test_greys_are_where_they_are_seen_first(tmp_path, monkeypatch, kind, strip):
    monkeypatch.setattr("mapdeal.maps.picture.STRIP", strip)
    monkeypatch.setattr("mapdeal.checks.facts._PIXELS_PER_BAND", strip)
    image = GREYS if kind == "pgm" else np.stack([GREYS] * 3, axis=-1)
    free = {"free_thresh": "0.41176470588"}
    path = write_pair(tmp_path, image, name=f"m.{kind}", **TURNED, **free)
    found = {f.check: [cell_at(place) for place in f.places] for f in mapdeal.lint(str(path))}
    # 205 has the shade 0.196, free below 0.41; 150 is exactly on the threshold
    assert found["thresholds.unknown-becomes-free"] == [first_of(205)]
    if kind == "pgm":
        assert found["thresholds.on-grey"] == [first_of(150)]
        # 90 four times, 150 twice; 7 and 51 are occupied
        assert found["image.greys"] == [first_of(grey) for grey in (90, 150)]


def test_readers_differ_where_a_grey_differs(tmp_path):
    """In mode scale, readers round or truncate shades between the thresholds."""
    pixels = np.array([[0, 254, 102, 89], [89, 151, 254, 102]], np.uint8)
    path = write_pair(tmp_path, pixels, **TURNED, occupied_thresh=0.6, mode="scale")
    dialects = ("nav2", "humble", "ros1")
    readings = {name: mapdeal.read_map(path, dialect=name).occupancy for name in dialects}
    findings = [finding for finding in mapdeal.lint(str(path)) if finding.check == "readers.differ"]
    assert findings
    for finding in findings:
        reader = next(name for name in ("humble", "ros1") if f"nav2 and {name} " in finding.message)
        differs = readings["nav2"] != readings[reader]
        cells = [cell_at(place) for place in finding.places]
        assert cells
        assert all(differs[cell] for cell in cells)
        greys = [pixels[len(pixels) - 1 - row, col] for row, col in cells]
        assert sorted(greys) == sorted(set(pixels[::-1][differs].tolist()))
