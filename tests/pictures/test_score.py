"""The picture of a score: which cell has which colour, and the bars of its histogram."""

import math

import numpy as np
import pytest

import mapdeal
from mapdeal import Frame, OccupancyGrid
from mapdeal.pictures.comparisons import ScoredWalls, bins_of


def test_the_scale_ends_at_half_a_metre_for_all_maps_of_ordinary_cells():
    none, empty = np.zeros((1, 1), np.uint8), np.empty(0)
    for cell, top in ((0.01, 0.5), (0.1, 0.5), (0.2, 1.0)):
        frame = Frame(1, 1, cell)
        assert ScoredWalls(frame, none, none, empty, empty).top == top


def test_a_histogram_has_a_bar_for_each_cell_of_distance_and_all_beyond():
    metres = np.array([0, 0.05 * math.sqrt(2), 0.05, 0.1, 0.5, 0.55, 3, math.inf])
    bins = bins_of(metres, 0.05, 0.5)
    assert [middle for middle, _ in bins] == [*(k / 20 for k in range(11)), math.inf]
    counts = [round(share * len(metres)) for _, share in bins]
    assert counts == [1, 2, 1, *[0] * 7, 1, 3]
    assert bins_of(np.array([]), 0.05, 0.5)[0] == (0.0, 0.0)


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
