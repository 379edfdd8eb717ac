import hashlib
import math
from pathlib import Path

import pytest
from PIL import Image

from drawn import grid_from_text
from mapdeal import write_map

ROOM = """
    ?????????????
    ?##########??
    ?#........#.?
    ?#.#...?..###
    ?#....??..#?#
    ?#........###
    ?##########??
"""


@pytest.fixture(autouse=True)
def room(here):
    write_map("room.yaml", grid_from_text(ROOM))
    with open("room.yaml", "a") as file:
        file.write("author: somebody\n")


def test_json_has_the_counts_the_limits_and_what_was_read(sh):
    document = sh.json("clean room.yaml -o c.npz --json --min-hole 2")
    files = ("room.yaml", "room.pgm")
    sums = {name: hashlib.sha256(Path(name).read_bytes()).hexdigest() for name in files}
    single_cell = {"components": 1, "cells": 1}
    assert document == {
        "map": {"file": "room.yaml", "sha256": sums}, "changed": 3,
        "limits": {"min_obstacle": 3, "min_hole": 2, "min_free": 100},
        "islands": single_cell, "free_holes": {"components": 0, "cells": 0},
        "wall_holes": single_cell, "specks": single_cell,
    }  # fmt: skip


def test_the_picture_shows_what_has_changed_and_keys_are_kept(sh):
    sh.ok("clean room.yaml -o c.yaml --image c.png --image-extent all")
    assert "author: somebody" in Path("c.yaml").read_text()
    with Image.open("c.png") as image:
        counts = {colour: count for count, colour in image.convert("RGB").getcolors(1 << 20)}
    # a wall added, a wall removed, an island, three filled cells; each colour also in the legend
    colours = [(0, 120, 220), (225, 30, 60), (250, 220, 130), (110, 200, 90)]
    added, removed, island, filled = (counts[colour] for colour in colours)
    assert added == removed == island
    side = math.isqrt((filled - island) // 2)
    assert side > 1
    assert filled == island + 2 * side**2
