import numpy as np
import pytest

from mapdeal.grid.frame import Frame
from mapdeal.pictures import canvas
from mapdeal.pictures.comparisons import difference_image
from mapdeal.pictures.overlay import Raster, RingOverlay, Surface

FRAME = Frame(60, 90, 0.25, (1.5, -2.0, 0.4))


def xy_of(col, row):
    """The point of the map frame at a place in cells, by hand."""
    x, y = col * 0.25, row * 0.25
    return 1.5 + x * np.cos(0.4) - y * np.sin(0.4), -2.0 + x * np.sin(0.4) + y * np.cos(0.4)


@pytest.mark.parametrize("raster", [Raster(), Raster(enlarge=3), Raster(reduce=2)])
def test_rings_lie_around_their_places_and_leave_the_middle_open(raster):
    scale = raster.enlarge / raster.reduce
    places = [(30.0, 20.0), (70.5, 45.25)]
    pixels = np.zeros((int(60 * scale), int(90 * scale)), np.uint8)
    rings = RingOverlay(np.array([xy_of(*place) for place in places]), "lost", "2 lost")
    (swatch,) = rings.draw(Surface(pixels, FRAME, raster), 200)
    assert (swatch.index, swatch.label, len(rings.colours)) == (200, "lost", 1)
    row, col = np.nonzero(pixels == 200)
    away = np.min(
        [np.hypot(col + 0.5 - x * scale, row + 0.5 - y * scale) for x, y in places], axis=0
    )
    radius = max(6.0, max(pixels.shape) / 80)
    assert np.abs(away - radius).max() < 2.5
    for x, y in places:  # closed: all quarters of each ring are there
        near = np.hypot(col + 0.5 - x * scale, row + 0.5 - y * scale) < radius + 2
        turns = np.arctan2(row[near] + 0.5 - y * scale, col[near] + 0.5 - x * scale)
        assert np.histogram(turns, bins=16, range=(-np.pi, np.pi))[0].min() > 0
        assert pixels[int(y * scale), int(x * scale)] == 0


def test_no_rings_have_no_legend():
    pixels = np.zeros((6, 9), np.uint8)
    surface = Surface(pixels, FRAME, Raster())
    assert RingOverlay(np.empty((0, 2)), "lost", "none").draw(surface, 200) == []
    assert not pixels.any()


def test_two_maps_of_the_same_data_are_named_and_drawn_larger(monkeypatch):
    seen = {}
    sheet = canvas.sheet

    def record(pixels, palette, **rest):
        seen.update(rest, shape=pixels.shape)
        return sheet(pixels, palette, **rest)

    monkeypatch.setattr(canvas, "sheet", record)
    kinds = np.arange(7, dtype=np.uint8)[np.newaxis].repeat(700, axis=0)
    difference_image(kinds, Frame(700, 7, 0.25), title="t", only_in=("counting", "tsdf"))
    labels = [swatch.label for swatch in seen["swatches"]]
    assert labels[:4] == [
        "wall only by tsdf",
        "wall only by counting",
        "wall",
        "free by one of them, unknown by the other",
    ]
    assert seen["shape"] == (1400, 14)
    difference_image(kinds, Frame(700, 7, 0.25), title="t")
    assert seen["shape"] == (700, 7)
