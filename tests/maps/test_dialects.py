"""The three readers, against what the real ones make of real and of constructed pictures."""

import hashlib
import json

import numpy as np
import pytest
from PIL import Image

from bad_maps import yaml_text
from mapdeal import read_map
from mapdeal.maps import dialects
from mapdeal.maps.dialects import DIALECTS, MapMetadata, cells_of
from maps.pictures import SHAPE, picture_of_each_kind

pytestmark = pytest.mark.usefixtures("mapdeal_warnings")

NAMES = {"main": "nav2", "humble": "humble", "ros1": "ros1"}

# Maps whose YAML names an absolute path of another machine: the real readers fail, mapdeal
# takes the image beside the YAML. The first digits of the checksum for all three dialects.
ABSOLUTE_PATHS = {"corridor": "fc5de3a74402", "office/central": "6448ba1a76de"}


def _sum(grid):
    return hashlib.sha256(grid.occupancy.tobytes()).hexdigest()


def test_every_real_map_reads_as_the_real_readers_read_it(real_maps):
    recorded = json.loads((real_maps / "expected" / "mapio.json").read_text())["maps"]
    assert len(recorded) == 111
    for key, expected in recorded.items():
        path, name = key.split("|")
        grid = read_map(real_maps / path, dialect=NAMES[name])
        assert grid.shape == tuple(expected["shape"])
        assert grid.origin[:2] == pytest.approx(expected["origin"][:2])  # ROS 1's have no yaw
        assert _sum(grid) == expected["sha256"], key


@pytest.mark.parametrize("dialect", DIALECTS)
def test_maps_with_a_path_of_another_machine(real_maps, dialect):
    for name, digits in ABSOLUTE_PATHS.items():
        path = real_maps / "chifongip__cartographer_ros/maps" / name / "mymap.yaml"
        assert _sum(read_map(path, dialect=dialect)).startswith(digits), name


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    """Pictures that exercise colour, opacity, palettes and formats."""
    folder = tmp_path_factory.mktemp("pictures")
    i, j = np.indices((40, 50))
    red, green, blue = (7 * i + 3 * j) % 256, (11 * i * j + 5) % 256, (13 * j - 2 * i) % 256
    alpha = np.where((i + j) % 3 == 0, (6 * i + j) % 256, 255)
    grey = (5 * i + j) % 256
    rgb = np.dstack([red, green, blue]).astype(np.uint8)
    rgba = np.dstack([red, green, blue, alpha]).astype(np.uint8)
    Image.fromarray(rgb).save(folder / "rgb.png")
    Image.fromarray(rgb).save(folder / "rgb.bmp")
    Image.fromarray(rgba).save(folder / "rgba.png")
    Image.fromarray(np.dstack([grey, alpha]).astype(np.uint8), "LA").save(folder / "la.png")
    palette = Image.fromarray(grey.astype(np.uint8))
    k = np.arange(256)
    colours = np.stack([255 - k, 3 * k % 256, k * k % 256], axis=1).astype(np.uint8)
    palette.putpalette(colours.tobytes())
    palette.save(folder / "palette.png")
    ramp = np.arange(256, dtype=np.uint8)
    (folder / "ramp.pgm").write_bytes(b"P5\n16 16\n255\n" + ramp.tobytes())
    return folder


# picture, mode, occupied_thresh, free_thresh, negate; then the first digits of the checksums
# that the real readers' arrays have: nav2, humble, ros1 (its raw values above 100 unknown).
RECORDED = """
ramp.pgm     trinary 0.6  0.2   0 6dfdd8bfc31c 9d3998685a5f 5ce1fa0b4121
ramp.pgm     trinary 0.6  0.2   1 ebf01373684a b2d46a56886b b2d46a56886b
ramp.pgm     scale   0.65 0.196 0 1c3e0279c2f7 1c3e0279c2f7 fdd63bc51f2d
ramp.pgm     scale   1.0  0.0   1 1378f4ee080b 1378f4ee080b 9c89e0c37451
ramp.pgm     raw     0.65 0.196 0 aed2b6997932 aed2b6997932 aed2b6997932
ramp.pgm     raw     0.65 0.196 1 aed2b6997932 aed2b6997932 d6bc091a95bf
rgb.png      trinary 0.65 0.196 0 bc25e5d21055 dd072a75e526 dd072a75e526
rgb.png      scale   1.0  0.0   0 d786057d5583 4e32874ad2b0 a41477146aa0
rgb.png      scale   0.65 0.196 1 2d44e0290b72 b6d92ccb865a d6e686a2858c
rgb.png      raw     0.65 0.196 0 9a8885ee59dc 9218a3b4b28a 40305bbad6d6
rgba.png     trinary 0.65 0.196 0 e02c5fd18322 3aaf85572171 3aaf85572171
rgba.png     trinary 0.6  0.2   1 d3de9d259483 98e908a590d7 98e908a590d7
rgba.png     scale   1.0  0.0   0 9eca95671cef 557dd491768f 0c9c15fd1224
rgba.png     raw     0.65 0.196 1 9a8885ee59dc 9218a3b4b28a d607d2028e49
la.png       trinary 0.65 0.196 0 50349b8520cd f2160fc55ccb c5b2f4fd34ce
la.png       trinary 0.65 0.25  1 db230ae673de 9a5195640381 b19b6c649bd0
la.png       scale   0.65 0.196 0 7151ab94a7ec 4bd784bc4c87 54a57863da0b
la.png       raw     0.65 0.196 1 3ec62e582044 3ec62e582044 2fcbb3769134
palette.png  trinary 0.65 0.196 0 5b775ae0e516 ef57d58c03b2 e7b0c35c1504
palette.png  scale   1.0  0.0   0 0788e340be17 bba992c34cd6 60c44cef3ca6
palette.png  raw     0.65 0.196 0 125f0ef4386b 575097310965 3ec62e582044
rgb.bmp      scale   0.65 0.196 0 4ecd749d7d93 5a0891987542 0ef54ca8313d
"""


def _write_yaml(path, image, mode="trinary", occupied=0.65, free=0.196, negate=0):
    thresholds = {"occupied_thresh": occupied, "free_thresh": free}
    path.write_text(yaml_text(image=image, mode=mode, negate=negate, **thresholds))
    return path


@pytest.mark.parametrize("line", RECORDED.strip().splitlines())
def test_constructed_pictures_read_as_the_real_readers_read_them(pictures, line):
    name, mode, occupied, free, negate, *sums = line.split()
    path = _write_yaml(pictures / "map.yaml", name, mode, occupied, free, negate)
    for dialect, expected in zip(("nav2", "humble", "ros1"), sums, strict=True):
        assert _sum(read_map(path, dialect=dialect)).startswith(expected), dialect


# Single pixels through the real readers: trinary at 0.65 / 0.196, scale at 1.0 / 0.0, raw.
PIXELS = [
    ("RGB", (0, 5, 176), [(100, 100, 100), (91, 76, 75), (23, 60, 60)]),
    ("RGB", (200, 90, 0), [(-1, -1, -1), (56, 62, -1), (-1, 97, 96)]),
    ("RGB", (200, 90, 1), [(-1, -1, -1), (56, 62, 61), (-1, 97, 97)]),
    ("RGBA", (205, 205, 205, 255), [(-1, 0, 0), (20, 20, 20), (-1, -1, -1)]),
    ("RGBA", (254, 254, 254, 254), [(-1, 0, 0), (-1, -1, 1), (-1, -1, -1)]),
    ("RGBA", (120, 120, 120, 0), [(-1, -1, -1), (-1, -1, -1), (-1, -1, -1)]),
    ("LA", (205, 0), [(-1, 0, -1), (-1, 20, -1), (-1, -1, -1)]),
    ("LA", (120, 128), [(-1, -1, -1), (-1, 53, 52), (-1, -1, -1)]),
]


@pytest.mark.parametrize(("kind", "pixel", "expected"), PIXELS)
def test_single_pixels(tmp_path, kind, pixel, expected):
    Image.new(kind, (3, 2), pixel).save(tmp_path / "pixel.png")
    modes = ("trinary", 0.65, 0.196), ("scale", 1.0, 0.0), ("raw", 0.65, 0.196)
    for (mode, high, low), values in zip(modes, expected, strict=True):
        path = _write_yaml(tmp_path / "map.yaml", "pixel.png", mode, high, low)
        assert tuple(int(read_map(path, dialect=d).occupancy[0, 0]) for d in DIALECTS) == values


GREYS = np.array([[0, 205, 254], [254, 0, 205]], dtype=np.uint8)
FEW = {
    # A little above 205 of 255: only humble uses all 16 bits of a grey.
    "wide.png": (np.array([[205 * 257, 205 * 257 + 50, 65535]], np.uint16), {}, 0.1955,
                 {"nav2": [[-1, -1, 0]], "humble": [[-1, 0, 0]], "ros1": [[-1, -1, 0]]}),
    # 254 is the transparent one, and 100 has a darkness of 0.61, between the thresholds.
    # ROS 1 averages grey and opacity: (254 + 0) / 2, (0 + 255) / 2, (100 + 255) / 2.
    "key.png": (np.array([[254, 0, 100]], np.uint8), {"transparency": 254}, 0.196,
                {"nav2": [[-1, 100, -1]], "ros1": [[-1, -1, -1]]}),
    # ROS 1 does not see the transparent colour of a coloured picture.
    "colour-key.png": (np.full((1, 3, 3), [[[254], [0], [205]]], np.uint8),
                       {"transparency": (254, 254, 254)}, 0.196, {"ros1": [[0, 100, -1]]}),
    # ROS 1 gives every TIFF an opacity of 255, which it averages in: 205 becomes free.
    "map.tiff": (GREYS, {}, 0.196, {"nav2": [[0, 100, -1], [100, -1, 0]],
                                    "ros1": [[0, 100, 0], [100, 0, 0]]}),
}  # fmt: skip


@pytest.mark.parametrize("name", FEW)
def test_a_few_pixels_worked_out_by_hand(tmp_path, name):
    pixels, options, free, expected = FEW[name]
    Image.fromarray(pixels).save(tmp_path / name, **options)
    path = _write_yaml(tmp_path / "map.yaml", name, free=free)
    found = {dialect: read_map(path, dialect=dialect).occupancy.tolist() for dialect in expected}
    assert found == expected


KINDS = picture_of_each_kind(range(256))


@pytest.mark.parametrize("mode", ["trinary", "scale", "raw"])
@pytest.mark.parametrize("dialect", DIALECTS)
def test_greys_that_are_looked_up_are_what_the_reader_makes_of_each(dialect, mode, monkeypatch):
    thresholds = {"occupied_thresh": 0.6, "free_thresh": 0.3}
    metadata = MapMetadata("m.png", 0.25, (1.5, -2.0, 0.4), mode, **thresholds)
    for name, picture in KINDS.items():
        expected = DIALECTS[dialect](picture, metadata)[::-1]
        assert np.array_equal(cells_of(picture, metadata, dialect), expected), name
        into = np.full(SHAPE, 77, np.int8)
        with monkeypatch.context() as patch:
            patch.setattr(dialects, "_PIXELS_AT_ONCE", 3 * SHAPE[1])
            assert cells_of(picture, metadata, dialect, out=into) is into
        assert np.array_equal(into, expected), name


@pytest.mark.parametrize("dialect", ["nav2", "ros1"])
@pytest.mark.parametrize(
    ("entries", "cells", "remark"),
    [
        ({"mode": "RAW"}, [0, 49, 100], "mode (line 2): RAW is refused by ROS 1; read as raw"),
        ({"negate": "true"}, [0, 0, -1], "negate (line 5): true is refused by ROS 1; read as 1"),
    ],
)
def test_words_that_ros_1_refuses_are_read_with_a_warning(
    tmp_path, dialect, entries, cells, remark, recwarn
):
    (tmp_path / "m.pgm").write_bytes(b"P2 3 1 255 0 49 100\n")
    _write_yaml(tmp_path / "m.yaml", "m.pgm", **entries)
    assert read_map(tmp_path / "m.yaml", dialect=dialect).occupancy[0].tolist() == cells
    found = [str(warning.message).rpartition("m.yaml: ")[2] for warning in recwarn]
    assert found == ([remark] if dialect == "ros1" else [])
