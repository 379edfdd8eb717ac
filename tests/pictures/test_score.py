"""The picture of a score: which cell has which colour, and the bars of its histogram."""

import math

import numpy as np
import pytest

import mapdeal
from mapdeal import Frame, OccupancyGrid
from mapdeal.pictures import canvas, colours
from mapdeal.pictures import comparisons as drawing
from mapdeal.pictures.canvas import WHITE, sheet
from mapdeal.pictures.comparisons import ScoredWalls, bins_of, score_image

FRAME = Frame(2, 7, 0.25, (1.0, -2.0, 0.0))


def walls(estimate, truth, distances, missed, frame=FRAME):
    return ScoredWalls(
        frame, np.array(estimate, np.uint8), np.array(truth, np.uint8),
        np.array(distances), np.array(missed),
    )  # fmt: skip


@pytest.fixture
def asked(monkeypatch):
    """What the picture asked of the sheet, after a call."""
    seen = {}

    def record(pixels, palette, **rest):
        seen.update(rest, pixels=pixels, palette=palette)
        return sheet(pixels, palette, **rest)

    monkeypatch.setattr(canvas, "sheet", record)
    return seen


def test_each_cell_has_the_colour_that_the_legend_says(asked):
    estimate = [[0, 1, 0, 1, 1, 1, 2], [2, 2, 2, 0, 0, 0, 0]]
    truth = [[0, 0, 1, 1, 2, 2, 2], [1, 1, 1, 0, 0, 0, 0]]
    score_image(walls(estimate, truth, [0.0, 0.625, 1.25, math.inf], [0.1, 0.25, 0.0]), title="t")
    step = asked["pixels"].shape[0] // 2
    cells = asked["palette"][asked["pixels"][step // 2 :: step, step // 2 :: step]]
    first, last = drawing._ANCHORS[0], drawing._ANCHORS[-1]
    assert [tuple(colour) for colour in cells[0].tolist()] == [
        colours.RVIZ_UNKNOWN, (176, 188, 186), (208, 222, 240), (255, 255, 255), (150, 150, 150),
        colours.ADDED, first,
    ]  # fmt: skip
    assert np.abs(cells[1, 0].astype(int) - drawing._ANCHORS[2]).max() <= 8  # half of 1.25 m
    assert tuple(cells[1, 1]) == tuple(cells[1, 2]) == last
    assert [swatch.label for swatch in asked["swatches"]] == list(drawing._LABELS.values())
    assert asked["bar"].ticks[0] == (0.0, "0")
    assert asked["bar"].ticks[-1] == (1.0, "1.25 and more")


def test_the_scale_ends_at_half_a_metre_for_all_maps_of_ordinary_cells():
    for cell, top in ((0.01, 0.5), (0.1, 0.5), (0.2, 1.0)):
        frame = Frame(1, 1, cell)
        assert walls([[2]], [[2]], [0.0], [0.0], frame).top == top


def test_a_histogram_has_a_bar_for_each_cell_of_distance_and_all_beyond():
    metres = np.array([0, 0.05 * math.sqrt(2), 0.05, 0.1, 0.5, 0.55, 3, math.inf])
    bins = bins_of(metres, 0.05, 0.5)
    assert [middle for middle, _ in bins] == [*(k / 20 for k in range(11)), math.inf]
    counts = [round(share * len(metres)) for _, share in bins]
    assert counts == [1, 2, 1, *[0] * 7, 1, 3]
    assert bins_of(np.array([]), 0.05, 0.5)[0] == (0.0, 0.0)


def test_bars_are_as_high_as_their_shares(asked):
    frame = Frame(1, 10, 0.1)
    estimate = [[2] * 10]
    image = score_image(
        walls(estimate, estimate, [0.0] * 6 + [0.2] * 3 + [7.0], [0.0] * 10, frame), title="t"
    )
    heights = {}
    below = image.indices[sheet_height(asked) :]
    for index in range(6, 106):
        rows = np.flatnonzero((below == index).any(axis=1))
        if len(rows):
            heights[index] = len(rows)
    assert list(heights) == [6, 6 + round(0.2 / 0.5 * 99), 105]
    lowest, middle, farthest = heights.values()
    assert middle / lowest == pytest.approx(0.5, abs=0.01)
    assert farthest / lowest == pytest.approx(1 / 6, abs=0.01)


def sheet_height(asked):
    rest = {name: value for name, value in asked.items() if name not in ("pixels", "palette")}
    return sheet(asked["pixels"], asked["palette"], **rest).indices.shape[0]


@pytest.mark.parametrize(
    ("estimate", "truth", "distances", "missed"),
    [([[1]], [[2]], [], [math.inf]), ([[2]], [[1]], [math.inf], []), ([[0]], [[0]], [], [])],
)
def test_maps_without_walls_are_drawn(estimate, truth, distances, missed):
    image = score_image(walls(estimate, truth, distances, missed, Frame(1, 1, 0.3)), title="t")
    assert (image.indices != WHITE).any()


def test_the_farthest_wall_shows_where_cells_share_a_pixel(asked):
    estimate = np.ones((1, 400), np.uint8)
    estimate[0, 6:8] = 2
    score_image(
        walls(estimate, np.ones_like(estimate), [0.0, 9.0], [], Frame(1, 400, 0.1)),
        title="t", image_max=200,
    )  # fmt: skip
    assert asked["pixels"].shape == (1, 200)
    assert asked["pixels"][0, 3] == 105


def test_python_draws_what_the_command_writes(tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    truth = np.zeros((12, 30), np.int8)
    truth[3], own = 100, np.zeros((12, 30), np.int8)
    own[5, 4:] = 100
    for name, values in (("truth", truth), ("own", own)):
        mapdeal.write_map(f"{name}.yaml", OccupancyGrid(values, 0.2, (1.0, 2.0, 0.0)))
    code, _, err = command("score", "own.yaml", "--truth", "truth.yaml", "--image", "o.png")
    assert (code, err) == (0, "")
    found = mapdeal.score("own.yaml", "truth.yaml")
    picture = mapdeal.draw_picture(found, image_extent="known")
    assert picture.png() == (tmp_path / "o.png").read_bytes()
    assert found._repr_png_().startswith(b"\x89PNG")
    alone = mapdeal.score("own.yaml")
    assert alone._repr_png_() is None
    with pytest.raises(mapdeal.ParameterError, match="has no picture"):
        mapdeal.draw_picture(alone)
    with pytest.raises(mapdeal.ParameterError, match="nothing can be drawn over a score"):
        mapdeal.draw_picture(found, pose=(0, 0, 0))
    code, _, err = command("score", "own.yaml", "--truth", "truth.yaml", "--image", "o.png")
    assert (code, "exists" in err) == (4, True)
