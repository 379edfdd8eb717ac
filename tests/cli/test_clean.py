"""`mapdeal clean`: files in, a file out, counts as text and JSON, a picture."""

import hashlib
import json
import math

import pytest
from PIL import Image

from drawn import cells, grid_from_text
from mapdeal import clean, read_map, write_map

ROOM = """
    ?????????????
    ?##########??
    ?#........#.?
    ?#.#...?..###
    ?#....??..#?#
    ?#........###
    ?##########??
"""
CLEAN = """
    ?????????????
    ?##########??
    ?#........#??
    ?#........###
    ?#........###
    ?#........###
    ?##########??
"""


@pytest.fixture
def room(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_map("room.yaml", grid_from_text(ROOM))
    with open("room.yaml", "a") as file:
        file.write("author: somebody\n")
    return tmp_path / "room.yaml"


def test_it_writes_what_the_function_makes_and_tells_what_has_changed(command, room):
    code, out, err = command("clean", "room.yaml", "-o", "c.yaml", "--min-obstacle", "2")
    assert (code, err) == (0, "")
    assert out.splitlines() == [
        "c.yaml: 13 x 7 cells, occupied 37.36 %, free 35.16 %, unknown 27.47 %",
        "  pinholes          1 (3 cells) are now free, 1 (1 cell) occupied",
        "  islands           1 (1 cell) are now unknown",
        "  small components  1 (1 cell) are now free",
        "  changed           6 cells",
    ]
    written = read_map("c.yaml")
    assert written.occupancy.tolist() == cells(CLEAN).tolist()
    assert written.origin == read_map(room).origin
    assert "author: somebody" in (room.parent / "c.yaml").read_text()
    assert written.occupancy.tolist() == clean(read_map(room)).grid.occupancy.tolist()


def test_json_has_the_counts_the_limits_and_what_was_read(command, room):
    code, out, _ = command("clean", room, "-o", "c.npz", "--json", "--min-hole", "2")
    assert code == 0
    assert json.loads(out) == {
        "map": {
            "file": str(room),
            "sha256": {
                name: hashlib.sha256((room.parent / name).read_bytes()).hexdigest()
                for name in ("room.yaml", "room.pgm")
            },
        },
        "limits": {"min_obstacle": 3, "min_hole": 2, "min_free": 100},
        "islands": {"components": 1, "cells": 1},
        "free_holes": {"components": 0, "cells": 0},
        "wall_holes": {"components": 1, "cells": 1},
        "specks": {"components": 1, "cells": 1},
        "changed": 3,
    }
    assert command("clean", room, "-o", "-", "--json")[0] == 2


def test_the_picture_shows_what_has_changed(command, sh, room):
    code, _, err = sh(f"clean {room} -o c.yaml --image c.png --image-extent all")
    assert (code, err) == (0, "")
    with Image.open("c.png") as image:
        counts = {colour: count for count, colour in image.convert("RGB").getcolors(1 << 20)}
    # a wall added, a wall removed, an island, three filled cells; each colour also in the legend
    added, removed, island, filled = (
        counts[colour] for colour in [(0, 120, 220), (225, 30, 60), (250, 220, 130), (110, 200, 90)]
    )
    assert added == removed == island
    side = math.isqrt((filled - island) // 2)
    assert side > 1
    assert filled == island + 2 * side**2
    assert command("clean", room, "-o", "d.yaml", "--image", "d.yaml")[0] == 2


def test_a_map_that_is_clean_already_is_written_and_warned_of(command, room):
    command("clean", room, "-o", "c.yaml")
    code, out, err = command("clean", "c.yaml", "-o", "again.yaml")
    assert (code, err) == (0, "warning: clean: nothing has changed\n")
    assert "changed           0 cells" in out
    assert (room.parent / "again.pgm").read_bytes() == (room.parent / "c.pgm").read_bytes()


def test_maps_go_through_pipes(command, room):
    command("clean", room, "-o", "c.npz", "-q")
    assert command("clean", "c.npz", "-o", "c.npz")[0] == 4  # the input stays
    assert command("clean", room, "-o", "c.npz")[0] == 4
    assert command("clean", room, "-o", "c.npz", "--force")[0] == 0
