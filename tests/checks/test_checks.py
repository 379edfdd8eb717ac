"""Each check of lint on both sides of its limits, with its numbers computed by hand."""

import io
import re
import zlib

import numpy as np
import pytest
from PIL import Image

import mapdeal
from checks.pairs import ROOM, painted, pgm, png, write_pair
from checks.test_explanations import MAPS
from drawn import grid_from_text
from mapdeal import Goal, OccupancyGrid, esdf, field_view, read_map, write_map
from mapdeal.checks.facts import gather
from mapdeal.checks.findings import CHECKS
from mapdeal.checks.lint import lint_file
from mapdeal.commands.lint import repaired
from mapdeal.maps.dialects import MapMetadata
from mapdeal.maps.map_server import yaml_of
from maps.pictures import chunk


def messages(check, path):
    findings = lint_file(path)
    ranks = [("error", "warning", "note").index(finding.severity) for finding in findings]
    assert ranks == sorted(ranks)
    findings = [finding for finding in findings if finding.check == check]
    assert all(finding.severity == CHECKS[check].severity for finding in findings)
    assert all(finding.message.isprintable() for finding in findings)
    return [finding.message for finding in findings]


ANY = "something"


def compare(found, expected):
    """Compare messages with one exact text, or `ANY`, or None for an empty list."""
    assert len(found) == (expected is not None)
    assert expected in (None, ANY, *found)


EXIF = Image.Exif()
EXIF[0x0112] = 3
LOSSY = io.BytesIO()
Image.fromarray(ROOM).save(LOSSY, "JPEG", quality=100)
TINTED = np.stack([ROOM, ROOM, ROOM], axis=-1)
TINTED[5, 5] = (250, 120, 0)


BARE = """resolution: 0.05
origin: [0, 0, 0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""
CASES = [
    ("yaml.defaults", {"negate": None}),
    ("image.lossy", {"image": LOSSY.getvalue(), "name": "m.jpg"}),
    ("image.orientation", {"image": png(Image.fromarray(ROOM), exif=EXIF), "name": "m.png"}),
    ("image.transparent-colour",
     {"image": png(TINTED, transparency=(254, 254, 254)), "name": "m.png"}),
    ("image.dos-header", {"image": pgm(ROOM, newline=b"\r\n")}),
    ("image.trailing-bytes", {"image": pgm(ROOM) + b"xyz"}),
    ("image.raw-values", {"image": painted(5, 5, 130) % 255, "mode": "raw"}),
    ("image.maxval", {"image": pgm(ROOM // 2, maxval=127)}),
    ("map.faded-walls", {"image": pgm(np.where(ROOM == 0, 110, ROOM).astype("u1"))}),
    ("image.palette", {"image": png(Image.fromarray(ROOM).convert("P")), "name": "m.png"}),
    *[("image.absolute-path", {"text": f"image: {name}\n{BARE}"})
      for name in ("/a/m.pgm", "'C:\\maps\\m.pgm'")],
]  # fmt: skip


@pytest.mark.parametrize(("check", "pair"), CASES, ids=lambda value: str(value)[:40])
def test_a_check_finds_what_it_is_about(tmp_path, check, pair):
    assert messages(check, write_pair(tmp_path, **pair)) != []


ON_GREY = "0.2 is the shade of grey {} (1 pixels): readers disagree on it; move it by 0.01"
MANY = [107, *[106] * 2, *[105] * 3, *[109] * 4, *[108] * 5, *[111] * 6, 255]
GREYS = "{} pixels are neither free nor occupied and become unknown "
GREYS += "(111: 6, 108: 5, 109: 4, 105: 3, 106: 2{}); check the thresholds"
FREED = "{} of grey 205, which map_saver writes for unknown, are read as free by {}"
ALL_READERS, LOWER = "nav2, humble and ros1", "; lower free_thresh from {} to 0.196"
AVERAGED = " the image as a PGM, since humble and ros1 average the opacity into the grey"
OPAQUE = [[205] * 3 + [255], [254] * 3 + [255]]  # (3 * 205 + 255) / 4 has the shade 0.147
BECOMES_FREE, COMMENT = "thresholds.unknown-becomes-free", "image.comment-resolution"
UNUSUAL, OFF_LATTICE = "yaml.resolution-unusual", "yaml.origin-off-lattice"


@pytest.mark.parametrize(("check", "row", "changes", "expected"), [
    # a threshold is compared with the shade that negate makes
    ("thresholds.on-grey", [0, 51, 204, 254], {"free_thresh": 0.2}, ON_GREY.format(204)),
    ("thresholds.on-grey", [0, 51, 204, 254], {"free_thresh": 0.2, "negate": 1},
     ON_GREY.format(51)),
    ("thresholds.on-grey", [0, 51, 204, 254], {"free_thresh": 0.2, "mode": "raw"}, None),
    ("thresholds.on-grey", [0, 203, 205], {"free_thresh": 0.2}, None),
    # above a tenth of the pixels
    ("image.cartographer", [128] * 3 + [0] * 27, {}, None),
    ("image.cartographer", [128] * 4 + [0] * 26, {},
     "4 pixels have grey 128, Cartographer's unknown"),
    ("image.greys", [0, 205, 254, 255, 89, 206], {}, None),  # shades 0.651 and 0.192
    ("image.greys", [*[128] * 2, 0, 205, 90, 254], {},
     "1 pixels are neither free nor occupied and become unknown (90: 1); check the thresholds"),
    ("image.greys", [128, *[0] * 9], {}, ANY),  # too few for Cartographer's unknown
    ("thresholds.on-grey", [0, 254], {"mode": "scale", "occupied_thresh": 1.0}, None),
    ("thresholds.on-grey", [0, 254], {"occupied_thresh": 1.0}, ANY),
    ("image.greys", MANY, {}, GREYS.format(21, ", and 1 more greys")),
    ("image.greys", [*MANY[1:], 254], {}, GREYS.format(20, "")),
    ("image.greys", MANY, {"mode": "scale"}, None),
    (BECOMES_FREE, [0, 205, 205, 254, 254, 205], {"free_thresh": 0.25},
     FREED.format("3 cells (50 %)", ALL_READERS) + LOWER.format(0.25)),
    (BECOMES_FREE, [0, 205, 205, 254, 254, 205], {"mode": "scale", "free_thresh": 0.196},
     FREED.format("3 cells (50 %)", "nav2 and humble")
     + "; write mode: trinary, since scale grades the grey as nearly free"),
    # a thousandth of the cells is map_saver's, less than that the blur of edges
    (BECOMES_FREE, [205, *[254] * 999], {"free_thresh": 0.25},
     FREED.format("1 cells (0.1 %)", ALL_READERS) + LOWER.format(0.25)),
    (BECOMES_FREE, [205, *[254] * 1000], {"free_thresh": 0.25}, None),
    # not from 0.196, which it is rounded to
    (BECOMES_FREE, [205, 254], {"free_thresh": 0.1960785},
     FREED.format("1 cells (50 %)", ALL_READERS) + LOWER.format(0.1960785)),
    # the shade of grey 205; ROS 1 compares with <, and to humble 1 - 205 / 255 comes out below
    (BECOMES_FREE, [205, 254], {"free_thresh": 50 / 255},
     FREED.format("1 cells (50 %)", "nav2 and humble") + LOWER.format(50 / 255)),
    # opacity that is averaged in is no matter of thresholds
    (BECOMES_FREE, OPAQUE, {"name": "m.png"},
     f"{FREED.format('1 cells (50 %)', 'humble and ros1')}; save{AVERAGED}"),
    (BECOMES_FREE, OPAQUE, {"name": "m.png", "free_thresh": 0.25},
     f"{FREED.format('1 cells (50 %)', ALL_READERS)}{LOWER.format(0.25)}, and save{AVERAGED}"),
    # map_saver writes three decimals
    (COMMENT, pgm(ROOM, comment="0.050 m/pix"), {"resolution": 0.0505}, None),
    (COMMENT, pgm(ROOM, comment="0.050 m/pix"), {"resolution": 0.0507},
     "the image says 0.05 m per pixel, the YAML 0.0507; measure a wall"),
    (COMMENT, pgm(ROOM, comment="0.051 m/pix"), {"resolution": 0.0505}, None),
    (COMMENT, pgm(ROOM, comment="1000.000 m/pix"), {"resolution": 1000.001}, None),
    # however it is written
    *[(COMMENT, pgm(ROOM, comment=comment), {}, ANY)
      for comment in ("saver 0.100 m/pix", "saver .1 m/pix", "saver 1. m/pix")],
    *[(COMMENT, pgm(ROOM, comment=comment), {}, None)
      for comment in ("1" * 60_000, "." * 60_000, "0.050" + " " * 60_000 + "m/pix",
                      "version 1.2.3 m/pix", ". m/pix")],
    (UNUSUAL, [0], {"resolution": 0.001}, None),
    (UNUSUAL, [0], {"resolution": 0.00099}, "0.00099 m per cell is unusual; is the unit right?"),
    (UNUSUAL, [0], {"resolution": 2}, None),
    (UNUSUAL, [0], {"resolution": 2.01}, ANY),
    # within a thousandth of a cell: a half of it, two of them
    (OFF_LATTICE, [0], {"origin": "[-1.5, 2.0, 0]"}, None),
    (OFF_LATTICE, [0], {"origin": "[-1.499975, 2.0, 0]"}, None),
    (OFF_LATTICE, [0], {"origin": "[-1.4999, 2.0, 0]"}, ANY),
    (OFF_LATTICE, [0], {"origin": "[-1.5, 2.001, 0]"}, ANY),
    (OFF_LATTICE, [0], {"origin": "[-1.5, 2.0, 0.7]"}, None),
    # where 32-bit floats are coarser than a tenth of a cell: steps of 2^-8 and 2^-7 m
    ("yaml.origin-far", [0], {"origin": "[40000, 0, 70000]"}, None),
    ("yaml.origin-far", [0], {"origin": "[0, -70000, 0]"},
     "32-bit floats have steps of 0.0078125 m there; move the origin near 0"),
    ("image.colour", [*[[9, 9, 9], [9, 9, 8]] * 2, [9, 9, 9], [0, 0, 255]], {"name": "m.png"},
     "3 pixels (50 %) are coloured; readers make grey of them differently: save the image in grey"),
    ("image.colour", [[9, 9, 9]] * 2, {"name": "m.png"}, None),
    ("image.alpha", [[9, 9, 9], [9, 9, 8]], {"name": "m.png"}, None),
    ("image.alpha", [[9, 9, 9, 255], [9, 9, 9, 254], [9, 9, 9, 0]], {"name": "m.png"},
     "2 pixels (66.7 %) are not opaque: unknown to Nav2, grey to ROS 1; make them opaque"),
    ("image.alpha", [[9, 9, 9, 255]], {"name": "m.png"}, None),
    ("image.absolute-path", [0], {}, None),
    ("image.maxval", pgm(ROOM // 254, maxval=1), {}, None),
], ids=lambda value: str(value)[:30])  # fmt: skip
def test_messages_of_checks_of_pairs(tmp_path, check, row, changes, expected):
    if not isinstance(row, bytes):
        row = np.array([row], dtype=np.uint8)
    compare(messages(check, write_pair(tmp_path, row, **changes)), expected)


CUT_OFF = "area{} of free space, {} m2, cannot be reached from the largest, 1.5 m2: goals there "
CUT_OFF += "fail; is a doorway closed?"
SPECKS = "{} of free space below 1 m2, {} cells: goals there fail; mapdeal clean --min-free 4 "
SPECKS += "removes them"
BORDER = "{} of 10 cells on the border are free: paths can lead off the map; is it cut off?"
SMALL = "all that is known lies in {}: the rest takes memory and time; try mapdeal active"


# cells of 0.25 m2: areas of a square metre are 4 of them, and the largest is no island
@pytest.mark.parametrize(("check", "text", "expected"), [
    ("islands", "...#..#...\n...#..####", "1 " + CUT_OFF.format("", 1)),
    ("specks", "...#..#...\n...#..####", SPECKS.format("1 speck", 3)),
    ("islands", "..#..#...\n..#..#...", "2 " + CUT_OFF.format("s", 2)),
    ("islands", "......\n......", None),
    ("specks", "......\n......", None),
    ("islands", "....#..", None),
    ("specks", "....", None),
    ("islands", "..##\n..##\n##..\n##..", None),
    ("specks", ".#\n#.", None),
    ("specks", ".#.\n###\n#..", SPECKS.format("2 specks", 2)),
    ("open-border", "....\n....\n....", BORDER.format(10)),
    ("open-border", "#?##\n#..#\n+?.#", BORDER.format(1)),
    ("open-border", "####\n.###\n####", BORDER.format(1)),
    ("open-border", "####\n###.\n####", BORDER.format(1)),
    ("open-border", "####\n#..#\n####", None),
    ("mostly-unknown", "?????\n?.#??\n?????", SMALL.format("2 x 1 cells, 13 %")),
    ("mostly-unknown", "?????\n#????\n??.??\n?????\n?????", SMALL.format("3 x 2 cells, 24 %")),
    ("mostly-unknown", "?.??\n?..?", None),  # 4 of 8 cells are half of it
    ("mostly-unknown", "?.???\n?..??", SMALL.format("2 x 2 cells, 40 %")),
    ("mostly-unknown", "???", None),
    ("all-unknown", "???",
     "every cell is unknown; are the thresholds, mode and negate right?"),
    *[(check, "???", None) for check in ("no-obstacle", "no-free")],
    ("no-obstacle", "?.?", ANY), ("no-free", "?.?", None),
    ("no-obstacle", "?#?", None), ("no-free", "?#?", ANY), ("all-unknown", "?#?", None),
    ("no-obstacle", "?+?", ANY), ("no-free", "?+?", ANY),
    ("no-obstacle", "#.?", None), ("no-free", "#.?", None),
])  # fmt: skip
def test_messages_of_checks_of_cells(tmp_path, check, text, expected):
    write_map(tmp_path / "m.npz", grid_from_text(text, 0.5))
    compare(messages(f"map.{check}", tmp_path / "m.npz"), expected)


def rooms_with_walls():
    """Return 30 x 48 cells with a wall around them, a wall across, and a pillar."""
    cells = np.pad(np.zeros((28, 46), np.int8), 1, constant_values=100)
    cells[:12, 20] = 100
    cells[20:22, 10:12] = 100
    return cells


def ring_track(width):
    """Return 30 x 48 cells with a closed ring of free ones."""
    cells = np.full((30, 48), 100, np.int8)
    cells[4:26, 4:44] = 0
    cells[4 + width : 26 - width, 4 + width : 44 - width] = 100
    return cells


def scattered_squares(side, count):
    cells = np.full((40, 70), 100, np.int8)
    for k in range(count):
        row, col = divmod(k, 6)
        cells[2 + 10 * row :, 2 + 10 * col :][:side, :side] = 0
    return cells


@pytest.mark.parametrize(("cells", "pieces"), [
    (rooms_with_walls(), None),
    (100 - rooms_with_walls(), "2 pieces of 1"),
    (100 - np.pad(rooms_with_walls(), 6), "2 pieces of 1"),
    (100 - rooms_with_walls()[:25, :36], None),  # too few cells for the check
    *[(ring_track(width), None) for width in (1, 2, 6)],
    (scattered_squares(6, 9), None),  # rooms behind doors
    (scattered_squares(6, 10), "10 pieces of 3"),
])  # fmt: skip
def test_free_cells_that_look_like_walls_are_inside_out(tmp_path, cells, pieces):
    write_map(tmp_path / "m.npz", OccupancyGrid(cells, 0.25, (1.0, -2.0, 0.0)))
    expected = pieces and f"{np.count_nonzero(cells)} cells are occupied, and the "
    expected = pieces and f"{expected}{np.count_nonzero(cells == 0)} free ones form {pieces} "
    compare(messages("map.inside-out", tmp_path / "m.npz"),
            pieces and f"{expected}cells' width, as walls do; is negate right?")  # fmt: skip


@pytest.mark.parametrize("name", ["v.yaml", "v.npz"])
@pytest.mark.parametrize(("view", "end"), [("metric", "2"), ("per-map", "0.75")])
def test_a_view_of_a_field_is_named_and_not_taken_for_a_map(tmp_path, name, view, end):
    grid = OccupancyGrid([[100, 0, 0, -1], [100, 0, 0, 0]], 0.25, (1.0, 2.0, 0.3))
    write_map(tmp_path / name, field_view(esdf(grid), view=view))
    (found,) = [f for f in lint_file(tmp_path / name, radius=0.1) if "yaw" not in f.check]
    assert (found.check, found.severity) == ("map.view", "warning")
    message = f"is the 0..100 view of a distance field ({view}, 0 at {end} m), not a map"
    assert found.message == message


def test_every_check_is_tried_here_or_elsewhere():
    tests = test_messages_of_checks_of_pairs, test_messages_of_checks_of_cells
    tables = [CASES, MASK_CASES, *(test.pytestmark[0].args[1] for test in tests)]
    tried = {row[0] for table in tables for row in table} | set(MAPS)
    tried |= {f"map.{name}" for name in tried}
    of_tests = ("params.", "graph.", "run.", "lint.", "readers.differ", "map.disconnected",
                "image.depth", "image.gamma", "image.yaml-not-read", "map.view", "map.ambiguous",
                "map.inside-out")  # fmt: skip
    tried |= {name for name in CHECKS if name.startswith(of_tests)}
    assert set(CHECKS) <= tried
    assert all(re.fullmatch(r"[a-z]+\.[a-z-]+", name) for name in CHECKS)


def test_readers_with_the_same_counts_share_a_finding(tmp_path):
    path = write_pair(tmp_path, painted(5, 5, 102), occupied_thresh="0.6")
    (message,) = messages("readers.differ", path)
    assert message == (
        "1 cells (0.556 %) differ between nav2 and humble, ros1 (nav2: occupied 43, free 87, "
        "unknown 50; humble, ros1: occupied 42, free 87, unknown 51); mapdeal convert writes a map "
        "that all read alike"
    )
    write_map(tmp_path / "anew.yaml", read_map(path))
    assert messages("readers.differ", tmp_path / "anew.yaml") == []


def test_readers_with_other_counts_have_findings_of_their_own(tmp_path):
    image = png(Image.fromarray(painted(5, 5, 102)).quantize(8))  # ROS 1 reads its indices
    path = write_pair(tmp_path, image, name="m.png", occupied_thresh="0.6")
    found = [message.partition(" (nav2")[0] for message in messages("readers.differ", path)]
    assert [text.rpartition("nav2 and ")[2] for text in found] == ["humble", "ros1"]


@pytest.mark.parametrize(("name", "body", "message"), [
    (b"gAMA", (100_000).to_bytes(4, "big"), "a gamma of 1: viewers"),
    (b"iCCP", b"profile\0\0" + zlib.compress(bytes(128)), "a colour profile: viewers"),
])  # fmt: skip
def test_a_gamma_is_a_finding_and_changes_no_cell(tmp_path, name, body, message):
    image = png(ROOM)  # its header ends at byte 33
    path = write_pair(tmp_path, image[:33] + chunk(name, body) + image[33:], name="m.png")
    (found,) = lint_file(path)
    assert (found.check, found.message.startswith(message)) == ("image.gamma", True)
    occupancy = read_map(path).occupancy
    assert np.array_equal(occupancy[::-1] == 100, ROOM == 0)
    assert np.array_equal(occupancy[::-1] == 0, ROOM == 254)


@pytest.mark.parametrize(("greys", "free", "cells", "repairs"), [
    # a repair raises no threshold; grey 215 has the shade 0.157, grey 205 has 0.196
    ([[0, 205, 215, 254]], 0.1, [[100, -1, -1, 0]], []),
    ([[0, 205, 215, 254]], 0.25, [[100, -1, 0, 0]],
     ["1 cell is now unknown instead of free: map_saver's grey for unknown"]),
    # a few pixels of that grey are the blur of edges
    ([[205, *[254] * 1000]], 0.25, [[0] * 1001], []),
], ids=map(str, range(3)))  # fmt: skip
def test_repairs_of_thresholds(tmp_path, greys, free, cells, repairs):
    path = write_pair(tmp_path, np.array(greys, np.uint8), free_thresh=free)
    facts, *_ = gather(path)
    grid, reported = repaired(path, facts)
    assert (grid.occupancy.tolist(), reported) == (cells, repairs)


ROOMS = """\
#############
#.....#.....#
#.....#.....#
#...........#
#.....#.....#
#.....#.....#
######?######"""
MAP = grid_from_text(ROOMS, resolution=0.5, origin=(1.0, 2.0, 0.0))
DOOR, DOCK = (3, 6), (5, 10)  # row from the south, column


def mask_of(*cells, value=100, outside=-1):
    values = np.full(MAP.shape, outside, np.int8)
    for cell in cells:
        values[cell] = value
    return values


@pytest.fixture
def lint_mask(tmp_path):
    """Return a function that lints a mask: findings by check."""

    def lint_values(values=None, pixels=None, *, mode=None, frame=MAP.frame, extra=None, **options):
        write_map(tmp_path / "map.yaml", MAP, force=True)
        values = mask_of((5, 2)) if values is None else values
        grid = OccupancyGrid(values, frame.resolution, frame.origin)
        path = tmp_path / "mask.yaml"
        write_map(path, grid, mode=mode, force=True)
        if extra is not None:
            path.write_bytes(yaml_of(MapMetadata("mask.pgm", 0.5, frame.origin, **extra)))
        if pixels is not None:
            height, width = pixels.shape
            head = b"P5\n%d %d\n255\n" % (width, height)
            (tmp_path / "mask.pgm").write_bytes(head + pixels.astype(np.uint8).tobytes())
        report = mapdeal.lint(tmp_path / "map.yaml", filter_mask=path, select="mask", **options)
        assert all(finding.file == str(path) for finding in report)
        return {finding.check: finding for finding in report}

    return lint_values


def moved(x=1.0, y=2.0, yaw=0.0):
    return mapdeal.Frame(*MAP.shape, 0.5, (x, y, yaw))


SPEED = {"filter": "speed", "speed_unit": "percent", "filter_base": 100.0,
         "filter_multiplier": -1.0}  # fmt: skip
SCALE = {"mode": "scale", "occupied_thresh": 1.0, "free_thresh": 0.0, "extra": SPEED}
ALL_GREY = np.full(MAP.shape, 150)
ALL_GREY[2] = 160

MASK_CASES = [
    ("mask.geometry", {"frame": moved(x=1.25)}, "origin 1.25, 2, 0; the map has 1, 2, 0"),
    ("mask.geometry", {"frame": moved(yaw=0.1)}, "yaw 0.1, which Nav2 takes for 0"),
    ("mask.geometry", {"values": mask_of((5, 2))[:, :-1]}, "12 x 7 cells; the map has 13 x 7"),
    ("mask.geometry", {"frame": mapdeal.Frame(*MAP.shape, 0.25, (1.0, 2.0, 0.0))}, "0.25 m; the"),
    ("mask.part", {"values": mask_of((5, 2))[:, :-1]}, "of the known cells of"),
    ("mask.elsewhere", {"frame": moved(x=100.0)}, "covers no known cell"),
    ("mask.nothing", {"pixels": ALL_GREY, "extra": {"occupied_thresh": 0.65}},
     "2 greys, but mode trinary with occupied_thresh 0.65"),
    ("mask.nothing", {"values": mask_of(outside=0)}, "no zone: all pixels are alike"),
    ("mask.all-or-nothing", {"mask_kind": "speed", "values": mask_of((3, 3), outside=0)},
     "every zone gets no limit"),
    ("mask.no-limit", {"values": mask_of((3, 3), outside=0), "mode": "scale", "extra": SCALE},
     "1 cell of value 100: 0 % is no limit"),
    ("mask.unknown", {"mask_kind": "speed"}, "90 cells are unknown"),
    ("mask.frees-unknown", {"values": mask_of((5, 2), outside=0)}, "1 cell of 0"),
    ("mask.goal", {"values": mask_of(DOCK), "goals": [Goal(6.25, 4.75, "dock")]},
     "dock lies in a keepout zone"),
    ("mask.goal", {"values": mask_of(DOOR), "start": (2.0, 3.0), "goals": [Goal(6.25, 4.75)]},
     "6.25,4.75 is cut off"),
    ("mask.start", {"values": mask_of(DOOR), "start": (4.25, 3.75)}, "lies in a keepout zone"),
    ("mask.closes", {"values": mask_of(DOOR), "start": (2.0, 3.0)},
     "4.25,3.75 cuts off 6.25 m2 around 5.75,3.75; reachable are 12.75 m2 without the mask, 6.25"),
]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("name", "options", "message"), MASK_CASES)
def test_a_check_of_masks_finds_its_fault(lint_mask, name, options, message):
    finding = lint_mask(**options)[name]
    assert message in finding.message
    assert finding.severity == CHECKS[name].severity
    assert finding.message.isprintable()


@pytest.mark.slow
def test_a_good_mask_has_no_finding(lint_mask):
    assert lint_mask(mask_of((5, 2)), goals=[Goal(6.25, 4.75, "dock")]) == {}
    assert lint_mask(mask_of((3, 3), value=1, outside=0), mode="scale", extra=SCALE) == {}


@pytest.mark.slow
def test_places_too_narrow_without_the_mask_are_not_reported(lint_mask):
    assert lint_mask(mask_of(DOOR), footprint=mapdeal.Footprint.circle(0.6), start=(2.0, 3.5)) == {}


@pytest.mark.slow
def test_the_kind_comes_from_the_option_the_yaml_or_the_mode(lint_mask):
    door = {"values": mask_of(DOOR, outside=0), "start": (2.0, 3.0)}
    assert "mask.closes" in lint_mask(**door)
    assert "mask.closes" in lint_mask(**door, mode="scale", mask_kind="keepout")
    values = door["values"]
    assert "mask.no-limit" in lint_mask(values, mode="scale")
    assert lint_mask(values, mask_kind="binary") == {}
    assert lint_mask(values, extra={"extra": {"filter": "binary"}}) == {}
