"""Each check of a filter's mask on a faulty mask, and all checks on a good one."""

import numpy as np
import pytest

import mapdeal
from drawn import grid_from_text
from mapdeal import Goal, OccupancyGrid, write_map
from mapdeal.checks.findings import CHECKS
from mapdeal.maps.dialects import MapMetadata
from mapdeal.maps.map_server import yaml_of

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

CASES = [
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
@pytest.mark.parametrize(("name", "options", "message"), CASES)
def test_a_check_finds_its_fault(lint_mask, name, options, message):
    options = dict(options)
    if "mode" in (options.get("extra") or {}):
        options["mode"] = "scale"
    finding = lint_mask(**options)[name]
    assert message in finding.message
    assert finding.severity == CHECKS[name].severity
    assert finding.message.isprintable()


@pytest.mark.slow
def test_a_good_mask_has_no_finding(lint_mask):
    assert lint_mask(mask_of((5, 2)), goals=[Goal(6.25, 4.75, "dock")]) == {}
    good = mask_of((3, 3), value=60, outside=0)
    assert lint_mask(good, mode="scale", extra=SCALE) == {}


@pytest.mark.slow
def test_places_too_narrow_without_the_mask_are_not_reported(lint_mask):
    wide = mapdeal.Footprint.circle(0.6)
    assert lint_mask(mask_of(DOOR), footprint=wide, start=(2.0, 3.5)) == {}


@pytest.mark.slow
def test_the_kind_comes_from_the_option_the_yaml_or_the_mode(lint_mask):
    door = {"values": mask_of(DOOR, outside=0), "start": (2.0, 3.0)}
    assert "mask.closes" in lint_mask(**door)
    assert "mask.closes" in lint_mask(**door, mode="scale", mask_kind="keepout")
    values = door["values"]
    assert "mask.no-limit" in lint_mask(values, mode="scale")
    assert lint_mask(values, mask_kind="binary") == {}
    binary = {"filter": "binary"}
    assert lint_mask(values, extra={"extra": binary}) == {}


def test_every_check_has_a_case():
    assert {name for name, *_ in CASES} == {name for name in CHECKS if name.startswith("mask.")}
