"""Positions of texts and marks in the picture of a cost curve."""

import math

import numpy as np
import pytest

import mapdeal
from mapdeal import Frame, OccupancyGrid, cost_curve
from mapdeal.pictures.comparisons import ScoredWalls, bins_of
from mapdeal.pictures.cost_curve import ZoneKind, end_of, zones_of
from pictures.samples import curve_of


@pytest.mark.parametrize(("name", "between", "last"), [
    ("polygon", [
        ("collision at any heading", 0.2, (253, 253)),
        # 252 e^(-5 (sqrt(17) / 20 - 0.2)) and 252 e^(-5 (sqrt(50) / 20 - 0.2))
        ("collision at some headings", 0.36, (244, 116)),
        # sqrt(52) and 11 cells
        ("no collision, with a cost", 0.55, (112, 43)),
    ], ZoneKind.FREE),
    ("cut off", [
        ("collision at any heading", 0.3, (253, 253)),
        ("collision at any heading, no cost", 0.6, (0, 0)),
        ("collision at some headings, no cost", 0.8, (0, 0)),
    ], ZoneKind.FREE),
    ("custom inscribed radius", [
        ("collision at any heading", 0.351, (253, 253)),
        # 252 e^(-5 (sqrt(50) / 20 - 0.351)) and 252 e^(-5 (0.55 - 0.351))
        ("no collision, with a cost", 0.55, (248, 93)),
    ], ZoneKind.FREE),
    ("point", [("with a cost", 0.05, (216, 216))], ZoneKind.NO_COST),
])  # fmt: skip
def test_zones_say_what_a_distance_means_for_the_robot(name, between, last):
    curve = curve_of(name)
    *zones, beyond = zones_of(curve, end_of(curve))[1:]
    assert [(zone.kind.value, round(zone.end, 4), zone.costs) for zone in zones] == between
    assert beyond.kind == last


@pytest.mark.parametrize("lookup", ["exact", "nav2"])
@pytest.mark.parametrize("cells", range(1, 14))
def test_a_cell_at_exactly_the_inscribed_radius_is_where_its_cost_says(lookup, cells):
    radii = {"inscribed_radius": cells * 5 / 100, "circumscribed_radius": 0.9}
    curve = cost_curve(0.05, **radii, inflation_radius=1.0, lookup=lookup)
    inside, beyond = zones_of(curve, end_of(curve))[1:3]
    assert (inside.kind, beyond.kind) == (ZoneKind.COLLISION, ZoneKind.HEADING)
    assert inside.costs in ((253, 253), None)
    assert beyond.costs[0] < 253


@pytest.mark.parametrize(("cell", "top"), [(0.01, 0.5), (0.1, 0.5), (0.2, 1.0)])
def test_the_scale_ends_at_half_a_metre_for_all_maps_of_ordinary_cells(cell, top):
    none, empty = np.zeros((1, 1), np.uint8), np.empty(0)
    assert ScoredWalls(Frame(1, 1, cell), none, none, empty, empty).top == top


def test_a_histogram_has_a_bar_for_each_cell_of_distance_and_all_beyond():
    metres = np.array([0, 0.05 * math.sqrt(2), 0.05, 0.1, 0.5, 0.55, 3, math.inf])
    bins = bins_of(metres, 0.05, 0.5)
    assert [middle for middle, _ in bins] == [*(k / 20 for k in range(11)), math.inf]
    counts = [round(share * len(metres)) for _, share in bins]
    assert counts == [1, 2, 1, *[0] * 7, 1, 3]
    assert bins_of(np.array([]), 0.05, 0.5)[0] == (0.0, 0.0)


def test_python_draws_what_the_command_writes(tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    for name, row in (("truth", 3), ("own", 5)):
        grid = OccupancyGrid(np.eye(12, 30, row, dtype=np.int8) * 100, 0.2, (1.0, 2.0, 0.0))
        mapdeal.write_map(f"{name}.yaml", grid)
    code, _, err = command("score", "own.yaml", "--truth", "truth.yaml", "--image", "o.png")
    assert (code, err) == (0, "")
    found = mapdeal.score("own.yaml", "truth.yaml")
    picture = mapdeal.draw_picture(found, image_extent="known")
    assert picture.png() == (tmp_path / "o.png").read_bytes()
    assert found._repr_png_().startswith(b"\x89PNG")
    with pytest.raises(mapdeal.ParameterError, match="nothing can be drawn over a score"):
        mapdeal.draw_picture(found, pose=(0, 0, 0))


def test_a_score_without_a_truth_has_no_picture():
    alone = mapdeal.score(OccupancyGrid([[100, 0, 0]], 0.2))
    assert alone._repr_png_() is None
    with pytest.raises(mapdeal.ParameterError, match="has no picture"):
        mapdeal.draw_picture(alone)
