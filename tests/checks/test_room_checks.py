"""Rooms that a robot is too large to reach."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

import mapdeal
from drawn import grid_from_text
from mapdeal import Footprint, OccupancyGrid, write_map
from mapdeal.checks import facts, map_checks
from mapdeal.checks.facts import RoomFacts
from mapdeal.checks.lint import lint_file
from mapdeal.files.source import use_memory
from oracles import flooded, squared_distance

SIDE, DOOR = 12, 3
WALL = "#" * (2 * SIDE + 3)
ROWS = ["#" + "." * SIDE + "#" + "." * SIDE + "#"] * 4
OPEN = ["#" + "." * (2 * SIDE + 1) + "#"] * DOOR
TWO_ROOMS = grid_from_text("\n".join([WALL, *ROWS, *OPEN, *ROWS, ROWS[0], WALL]), 0.25)
"""Two rooms of 3 x 3 m, and a door three cells wide, whose middle is 2 cells, 0.5 m, from the next
obstacle. The centre of a robot of radius 0.5 m fits in 8 x 8 cells of a room, 4 m2, and in four
cells in front of the door, which are at least sqrt(5) cells from its posts: 4.25 m2."""
RULES = {"ignore": "yaml"}
CLOSED, PASSING = Footprint.circle(0.5), Footprint.circle(0.499)


@pytest.fixture
def room(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_map("m.yaml", TWO_ROOMS)
    return Path("m.yaml")


def messages(radius, grid=TWO_ROOMS):
    return [remark.message for remark in map_checks.disconnected(RoomFacts.of(grid, radius))]


def mask_of(is_open, seed):
    """Return the open cells that a flood from the first cell of a mask reaches."""
    mask = np.zeros(is_open.shape, dtype=bool)
    first, *_ = np.argwhere(seed).tolist()
    mask[tuple(np.transpose(list(flooded(is_open, tuple(first)))))] = True
    return mask


def checks_of(report):
    return [found.check for found in report]


def test_a_finding_names_the_door_that_stops_the_robot_and_its_width():
    (text,) = messages(0.5)
    found = re.fullmatch(
        r"(.*) m2 are cut off from the largest area by a passage of 1 m at (.*), (.*); "
        r"the robot's inscribed circle needs more than 1 m",
        text,
    )
    assert float(found[1]) == 4.25
    # the door is in the column of the wall, in rows 6 to 8 from the south
    (expected,) = TWO_ROOMS.frame.xy_from_rowcol([[7, SIDE + 1]])
    assert (float(found[2]), float(found[3])) == pytest.approx(tuple(expected), abs=0.006)
    # and on a map turned by 90 degrees about its origin
    turned = OccupancyGrid(TWO_ROOMS.occupancy, 0.25, (1.0, -2.0, math.pi / 2))
    (remark,) = map_checks.disconnected(RoomFacts.of(turned, 0.5))
    (place,) = remark.places
    assert place == pytest.approx((1.0 - 7.5 * 0.25, -2.0 + (SIDE + 1.5) * 0.25), abs=0.13)
    position = re.search(r"at (\S+), (\S+);", remark.message)
    assert (float(position[1]), float(position[2])) == pytest.approx(place, abs=0.0051)
    assert " at 3.88, 1.04; the robot's inscribed circle needs more than 1.1 m" in messages(0.55)[0]


@pytest.mark.parametrize(("radius", "is_found"), [
    (0.499, False), (0.5, True), (0.74, True),
    (0.75, False),  # leaves 6 x 6 cells of each room, 2.25 m2
])  # fmt: skip
def test_a_door_counts_that_cuts_off_a_room(radius, is_found):
    assert bool(messages(radius)) == is_found


def test_unknown_cells_are_no_way():
    unknown = TWO_ROOMS.occupancy.copy()
    unknown[6:9, SIDE + 1] = -1
    assert messages(0.5, TWO_ROOMS.with_values(unknown)) == []


@given(
    st.integers(0, 2**32 - 1), st.integers(8, 26), st.integers(8, 26),
    st.sampled_from([0.3, 0.5, 0.6, 1.0, 1.2]),
)  # fmt: skip
def test_found_where_a_flood_of_the_robot_s_size_finds_two_rooms(seed, height, width, radius):
    """Oracle: floods of the cells open to the robot; two areas of 4 m2 in one free area."""
    dice = np.random.default_rng(seed)
    cells = np.where(dice.random((height, width)) < 0.02, 100, 0).astype(np.int8)
    for value in dice.choice([100, 100, -1], dice.integers(1, 4)):
        if dice.random() < 0.5:
            cells[dice.integers(height), dice.random(width) > 0.15] = value
        else:
            cells[dice.random(height) > 0.15, dice.integers(width)] = value
    grid = OccupancyGrid(cells, 0.5, (1.5, -2.0, 0.4))
    squared = squared_distance(np.pad(cells == 100, 1, constant_values=True))[1:-1, 1:-1]
    is_free = cells == 0
    is_open = is_free & (np.sqrt(squared.astype(float)) * 0.5 > radius)
    areas, remaining = [], is_open.copy()
    while remaining.any():
        area = mask_of(is_open, remaining)
        remaining &= ~area
        areas.append(area)
    texts, parts, remaining = messages(radius, grid), [], is_free.copy()
    while remaining.any():
        part = mask_of(is_free, remaining)
        remaining &= ~part
        parts.append([area.sum() * 0.25 for area in areas if (area & part).any()])
    if any(sum(area >= 4 for area in sizes) > 1 for sizes in parts):
        assert texts
    if all(sum(sizes) - max(sizes, default=0) < 4 for sizes in parts):
        assert not texts
    for text in texts[:10]:  # an eleventh text counts the others
        found = re.match(r"(.*) m2 are cut off from .* by a passage of (.*) m at", text)
        assert float(found[1]) >= 4
        assert float(found[2]) <= 2 * radius + 1e-9


def test_rooms_of_a_part_of_the_map_that_no_way_leads_to_are_found():
    # the largest room is shut in; beside it two rooms differ by a door that is too narrow
    cells = np.full((12, 42), 100, np.int8)
    cells[1:11, 1:16] = cells[1:11, 17:29] = cells[1:11, 30:41] = 0
    cells[5, 29] = 0
    (text,) = messages(0.6, OccupancyGrid(cells, 0.5, (1.5, -2.0, 0.4)))
    assert "by a passage of 1 m" in text


def test_a_comment_suppresses_passages_and_costs_have_none(room):
    room.write_text(room.read_text() + "# mapdeal: ignore map.disconnected\n")
    stopped = mapdeal.lint(room, **RULES, footprint=CLOSED)
    assert (checks_of(stopped), stopped.maps[0].suppressed) == ([], 1)
    write_map("c.npz", mapdeal.exponential_cost(TWO_ROOMS))
    assert "map.disconnected" not in checks_of(lint_file(Path("c.npz"), radius=0.5))


@pytest.mark.parametrize("name", ["m.npz", "f.npz", "b.pbm"])
def test_every_kind_of_map(room, name):
    if name == "b.pbm":
        mapdeal.write_bit_map(name, mapdeal.BitMap.from_occupancy(TWO_ROOMS))
    else:
        write_map(name, TWO_ROOMS if name == "m.npz" else mapdeal.esdf(TWO_ROOMS))
    assert messages(0.5)[0] in [finding.message for finding in lint_file(Path(name), radius=0.5)]


def test_a_map_that_takes_too_much_memory_is_left_out_with_one_note(room, monkeypatch):
    monkeypatch.setattr(facts, "_ROOM_BYTES", dict.fromkeys(("compiled", "scipy"), 10**9))
    with use_memory(100_000_000):
        found, *_ = (f for f in lint_file(room, radius=0.5) if f.check[:4] != "yaml")
    assert (found.check, found.severity) == ("lint.left-out", "note")
    cells = f"{TWO_ROOMS.shape[1]} x {TWO_ROOMS.shape[0]} cells need"
    assert found.message.startswith(f"map.disconnected: {cells} ")
    room.write_text(room.read_text() + "# mapdeal: ignore map.disconnected\n")
    report = mapdeal.lint(room, **RULES, footprint=CLOSED, max_memory=100_000_000)
    assert checks_of(report) == ["lint.left-out"]  # and no unused comment


PARAMETERS = """
global_costmap:
  global_costmap:
    ros__parameters:
      footprint: "[[0.9, 0.5], [0.9, -0.5], [-0.9, -0.5], [-0.9, 0.5]]"
      footprint_padding: 0.0
      plugins: [static_layer]
      static_layer: {plugin: "nav2_costmap_2d::StaticLayer"}
"""
POLYGON = "[[0.9,0.5],[0.9,-0.5],[-0.9,-0.5],[-0.9,0.5]]"


@pytest.mark.parametrize(("words", "is_found"), [
    ([], False),
    (["--robot-radius", 0.5], True),
    (["--robot-radius", 0.499], False),
    (["--robot-radius", 0.499, "--footprint-padding", 0.01], True),
    (["--robot-radius", 0.5, "--robot-16-gon"], False),  # whose inscribed radius is 0.49
    (["--footprint", POLYGON], True),
    (["--params-file", "p.yaml"], True),
    (["--params-file", "p.yaml", "--robot-radius", 0.3], False),
    (["--params-file", "p.yaml", "--costmap", "local"], False),
])  # fmt: skip
def test_the_robot_is_that_of_the_options_or_of_its_files(command, room, words, is_found):
    Path("p.yaml").write_text(PARAMETERS)
    _, out, _ = command("lint", room, *words, "--select", "map")
    assert ("map.disconnected: 4.25 m2 are cut off from" in out) is is_found


def test_ten_passages_are_findings_and_the_others_are_counted():
    side, count = 13, 13
    occupancy = np.full((side + 2, 1 + count * (side + 1)), 100, dtype=np.int8)
    for index in range(count):
        west = 1 + index * (side + 1)
        occupancy[1:-1, west : west + side] = 0
        if index:
            occupancy[5:8, west - 1] = 0
    texts = messages(0.5, OccupancyGrid(occupancy, 0.25))
    assert len(texts) == 11
    assert texts[-1].startswith("2 more passages cut off ")
    areas = [float(text.split()[0]) for text in texts[:-1]]
    assert areas == sorted(areas, reverse=True)
    assert areas[0] > 5 * areas[-1]
    assert float(texts[-1].split()[5]) <= areas[-1]


@pytest.mark.usefixtures("mapdeal_warnings")
def test_of_a_robot_that_does_not_cover_its_centre_no_radius_is_known(room):
    # all edges are at least 0.6 m from the centre, but the centre fits where the robot does not
    ahead = Footprint.polygon([[0.6, 1.0], [0.6, -1.0], [1.4, -1.0], [1.4, 1.0]])
    assert ahead.inscribed_radius == pytest.approx(0.6)
    assert checks_of(mapdeal.lint(room, **RULES, footprint=ahead)) == []
