"""A robot's shape in pictures, true to scale, and cells that a keepout mask has closed."""

import numpy as np
import pytest
from PIL import Image

import mapdeal
from mapdeal.grid.frame import Frame
from mapdeal.kernels.blocks import lazy_layer
from mapdeal.pictures.overlay import KeepoutOverlay, Raster, RobotOverlay, Surface
from mapdeal.pipeline.folder import robot_overlays
from mapdeal.pipeline.step import make_step

LONG = mapdeal.Footprint.polygon([(0.6, 0.2), (0.6, -0.2), (-0.3, -0.2), (-0.3, 0.2)])
FRAME = Frame(80, 120, 0.05, (1.0, -2.0, 0.3))


def drawn(overlay, pixels, raster):
    (*swatches,) = overlay.draw(Surface(pixels, FRAME, raster), 7)
    return [(one.index, one.label) for one in swatches], np.argwhere(pixels == 7)


@pytest.mark.parametrize("corner", [(0, 0), (0, 1), (1, 0), (1, 1)])
def test_it_stands_in_the_corner_where_least_is_to_be_seen(corner):
    noise = np.random.default_rng(1).integers(0, 5, (320, 480)).astype(np.uint8)
    at = [slice(half * length // 2, (half + 1) * length // 2)
          for half, length in zip(corner, (320, 480), strict=True)]  # fmt: skip
    noise[tuple(at)] = 3
    _, cells = drawn(RobotOverlay(LONG), noise, Raster(enlarge=4))
    assert all((cells[:, axis] >= at[axis].start).all() for axis in (0, 1))
    assert all((cells[:, axis] < at[axis].stop).all() for axis in (0, 1))


@pytest.mark.parametrize("robot", [mapdeal.Footprint.circle(0.01), mapdeal.Footprint.circle(2.0)])
def test_what_is_too_small_or_too_large_is_left_out(robot):
    pixels = np.zeros((80, 120), np.uint8)
    assert drawn(RobotOverlay(robot), pixels, Raster())[0] == []
    assert not pixels.any()


@pytest.mark.parametrize(
    ("stage", "given", "robot", "told"),
    [
        ("inflate", {"radius": 0.3}, None, ("robot, to scale", 0.3)),
        ("inflate", {"radius": 0.0}, None, None),
        ("inflate", {"footprint": LONG}, None, ("robot, to scale", LONG)),
        ("cost", {"inscribed_radius": 0.2}, None, ("robot, to scale", 0.2)),
        ("cost", {}, None, None),
        ("cost", {"inscribed_radius": 0.2, "circumscribed_radius": 0.6}, None,
         ("the robot's inscribed circle", 0.2)),
        ("cost", {"inscribed_radius": 0.2, "circumscribed_radius": 0.6}, LONG,
         ("robot, to scale", LONG)),
        ("esdf", {}, LONG, None),
        ("reach", {"radius": 0.3}, None, None),
    ],
)  # fmt: skip
def test_pictures_of_what_is_about_a_robot_show_it(stage, given, robot, told):
    found = robot_overlays(make_step(stage, given), robot)
    if told is None:
        assert found == []
        return
    (one,) = found
    shape = told[1] if told[1] is LONG else mapdeal.Footprint.circle(told[1])
    assert (one.label, one.robot) == (told[0], shape)


@pytest.mark.parametrize("scale", ["costmap2d", "occupancy"])
@pytest.mark.parametrize("is_lazy", [True, False])
def test_cells_that_a_mask_alone_has_closed(scale, is_lazy):
    lethal = 254 if scale == "costmap2d" else 100
    kind = np.uint8 if scale == "costmap2d" else np.int8
    before, after = (
        np.array([[0, 30, lethal], [50, 0, 0]], kind),
        np.array([[0, lethal, lethal], [60, 0, lethal]], kind),
    )
    maps = []
    for cells in (before, after):
        layer = cells
        if is_lazy:
            layer = lazy_layer(cells.shape, kind, lambda rows, c=cells: c[rows], block_height=1)
        maps.append(mapdeal.Costmap(layer, 0.25, (1.0, 2.0, 0.4), scale=scale))
    overlay = KeepoutOverlay.of(*maps)
    pixels = np.zeros((4, 6), np.uint8)
    surface = Surface(pixels, maps[0].frame, Raster(enlarge=2))
    swatches = overlay.draw(surface, 9)
    assert [(one.index, one.label) for one in swatches] == [(9, "keepout")]
    assert (pixels[::2, ::2] == 9).tolist() == [[False, True, False], [False, False, True]]
    small = Surface(np.zeros((2, 3), np.uint8), maps[0].frame, Raster())
    assert overlay.draw(small, 9)
    assert KeepoutOverlay.of(maps[1], maps[1]).draw(surface, 9) == []


def test_the_picture_of_masked_costs_has_them(command, tmp_path):
    cells = np.zeros((60, 80), np.int8)
    cells[:, 0] = 100
    grid = mapdeal.OccupancyGrid(cells, 0.1, (1.0, 2.0, 0.0))
    mapdeal.write_map(tmp_path / "m.yaml", grid)
    mapdeal.write_map(tmp_path / "mask.yaml", grid.with_values(np.roll(cells, 40, axis=1)))
    mask, out, picture = (tmp_path / name for name in ("mask.yaml", "c.npz", "c.png"))
    words = "cost", tmp_path / "m.yaml", "-o", out, "--mask", mask, "--image", picture
    assert command(*words)[0] == 0
    with Image.open(picture) as image:
        colours = {tuple(one) for one in np.asarray(image.convert("RGB")).reshape(-1, 3).tolist()}
    assert (40, 100, 245) in colours
