"""What stands where in the picture of a cost curve."""

import math

import numpy as np
import pytest

from mapdeal import cost_curve
from mapdeal.pictures import colours
from mapdeal.pictures.canvas import Pen, text_width
from mapdeal.pictures.cost_curve import ZoneKind, cost_curve_image, end_of, marks_of, zones_of
from mapdeal.pictures.styles import CostPalette

WIDTH = 960

POLYGON = {
    "inscribed_radius": 0.2,
    "circumscribed_radius": 0.36,
    "inflation_radius": 0.55,
    "cost_scaling_factor": 5.0,
}
SETS = {
    "nav2": (0.05, {
        "inscribed_radius": 0.22549849949589046, "circumscribed_radius": 0.2299,
        "inflation_radius": 0.7, "cost_scaling_factor": 3.0, "lookup": "nav2",
    }),
    "polygon": (0.05, POLYGON),
    "odd cells": (0.07, POLYGON),
    "cut off": (0.05, {**POLYGON, "inflation_radius": 0.3, "inscribed_radius": 0.6,
                       "circumscribed_radius": 0.8}),
    "custom inscribed radius": (0.05, {**POLYGON, "inscribed_radius": 0.351,
                                       "circumscribed_radius": 0.3}),
    "none": (0.05, {**POLYGON, "inflation_radius": 0.0}),
    "point": (0.05, {"inflation_radius": 0.02, "cost_scaling_factor": 3.0}),
    "flat": (0.05, {**POLYGON, "cost_scaling_factor": 0.0}),
    "huge": (0.05, {**POLYGON, "inflation_radius": 30.0}),
    "huge and slow": (0.05, {**POLYGON, "inflation_radius": 30.0, "cost_scaling_factor": 0.05}),
    "large cells": (1.0, POLYGON),
    "rings": (0.07, {"model": "rings", "values": (90, 20, 50)}),
    "thresholds": (0.05, {"model": "threshold", "down": 20, "up": 60, "down_factor": 0.5}),
}  # fmt: skip


def curve_of(name):
    resolution, parameters = SETS[name]
    return cost_curve(resolution, **parameters)


class Seen:
    """The plot of a picture, found by the obstacle's bar at its left."""

    def __init__(self, curve):
        self.curve = curve
        self.image = cost_curve_image(curve, title="t")
        self.palette = CostPalette.of(curve.scale)
        lethal = self.image.indices == self.palette.lethal
        self.left = int(np.flatnonzero(lethal.sum(axis=0) > 300)[0])
        rows = np.flatnonzero(lethal[:, self.left])
        runs = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
        bar = max(runs, key=len)
        self.bottom = int(bar[-1]) + 1
        self.per_cost = 5 if curve.scale == "occupancy" else 2
        self.top = self.bottom - self.per_cost * (100 if curve.scale == "occupancy" else 254)
        assert self.top <= bar[0] <= self.top + 8  # a dot may lie on it
        self.cells = runs[-1]  # the row of cells below
        half = curve.resolution / 2
        self.metres = (np.arange(WIDTH) + 0.5) / WIDTH * (end_of(curve) + half) - half

    def column(self, place):
        return self.image.indices[self.top : self.bottom, self.left + place]


@pytest.mark.slow
@pytest.mark.parametrize("name", SETS)
def test_bars_have_the_height_and_the_colour_of_the_cost_at_the_nearest_distance(name):
    seen = Seen(curve_of(name))
    curve, per_cost = seen.curve, seen.per_cost
    distances = curve.distance.tolist()
    half = curve.resolution / 2
    end = curve.reach + half if curve.metric == "chebyshev" else max(curve.reach, half)
    covered = 0
    for place in range(0, WIDTH, 7):
        metres = max(seen.metres[place], 0.0)
        near = np.abs(curve.distance - metres)
        if len(distances) > 1 and np.partition(near, 1)[1] - near.min() < 1e-9:
            continue  # in the middle between two
        cost = int(curve.cost[near.argmin()]) if metres <= end else 0
        column = seen.column(place)
        colour = seen.palette.by_value[cost]
        if cost >= 5:  # others lie behind the line
            assert column[-1] == colour
            covered += 1
        # dots, lines and marks lie over bars, and bars over nothing
        above = column[: max(len(column) - per_cost * cost - 9, 0)]
        assert not (above < seen.palette.unknown).any()
        assert (column == colour).sum() >= 0.45 * per_cost * cost - 8
    assert covered > 10


@pytest.mark.parametrize("name", ["polygon", "odd cells", "rings", "thresholds", "none"])
def test_the_row_of_cells_is_that_of_a_costmap(name):
    seen = Seen(curve_of(name))
    curve = seen.curve
    whole = {
        int(c): int(v) for c, v in zip(curve.cells, curve.cost, strict=True) if c == math.floor(c)
    }
    row = seen.image.indices[seen.cells[len(seen.cells) // 2], seen.left : seen.left + WIDTH]
    half = curve.resolution / 2
    for cell in range(int(end_of(curve) / curve.resolution - 0.5) + 1):
        place = int(WIDTH * (cell * curve.resolution + half) / (end_of(curve) + half))
        assert row[place] == seen.palette.by_value[whole.get(cell, 0)]


def told(name):
    curve = curve_of(name)
    return [
        (zone.kind.value, round(zone.end, 4), zone.costs)
        for zone in zones_of(curve, end_of(curve))[1:-1]
    ], zones_of(curve, end_of(curve))[-1].kind


@pytest.mark.parametrize(
    ("name", "between", "last"),
    [
        ("polygon", [
            ("collision at any heading", 0.2, (253, 253)),
            # 252 e^(-5 (sqrt(17) / 20 - 0.2)) and 252 e^(-5 (sqrt(50) / 20 - 0.2))
            ("collision at some headings", 0.36, (244, 116)),
            # sqrt(52) and 11 cells
            ("no collision, with a cost", 0.55, (112, 43)),
        ], ZoneKind.FREE),
        ("nav2", [
            ("collision at any heading", 0.2255, (253, 253)),
            ("collision at some headings", 0.2299, None),
            ("no collision, with a cost", 0.7, (234, 60)),
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
        ("none", [
            ("collision at any heading, no cost", 0.2, (0, 0)),
            ("collision at some headings, no cost", 0.36, (0, 0)),
        ], ZoneKind.FREE),
        ("point", [("with a cost", 0.05, (216, 216))], ZoneKind.NO_COST),
        ("large cells", [("no collision, with a cost", 1.0, (4, 4))], ZoneKind.FREE),
        ("rings", [("with a cost", 0.21, (90, 20))], ZoneKind.NO_COST),
    ],
)  # fmt: skip
def test_zones_say_what_a_distance_means_for_the_robot(name, between, last):
    assert told(name) == (between, last)


@pytest.mark.parametrize("lookup", ["exact", "nav2"])
def test_a_cell_at_exactly_the_inscribed_radius_is_where_its_cost_says(lookup):
    for cells in range(1, 14):
        radius = cells * 5 / 100
        curve = cost_curve(
            0.05, inscribed_radius=radius, circumscribed_radius=0.9, inflation_radius=1.0,
            lookup=lookup,
        )  # fmt: skip
        inside, beyond = zones_of(curve, end_of(curve))[1:3]
        assert (inside.kind, beyond.kind) == (ZoneKind.COLLISION, ZoneKind.HEADING)
        assert inside.costs in ((253, 253), None)
        assert beyond.costs[0] < 253


def test_marks_of_one_place_are_one():
    assert [(mark.distance, mark.label) for mark in marks_of(curve_of("polygon"))] == [
        (0.2, "inscribed radius: 0.2 m"),
        (0.36, "circumscribed radius: 0.36 m"),
        (pytest.approx(0.55), "inflation radius: 0.55 m, 11 cells, cost 43, then 0"),
    ]
    assert [mark.label for mark in marks_of(curve_of("odd cells"))][2:] == [
        "inflation radius: 0.55 m",
        "reach: 0.56 m, 8 cells, cost 41, then 0",
    ]
    round_robot = cost_curve(1.0, inscribed_radius=0.3, circumscribed_radius=0.3)
    assert [mark.label for mark in marks_of(round_robot)] == [
        "inscribed and circumscribed radius: 0.3 m",
        "inflation radius: 0.55 m",
        "reach: 1 m, 1 cell",
    ]
    assert [mark.label for mark in marks_of(cost_curve(0.05, inflation_radius=0))] == [
        "inflation radius: 0 m, no cost spreads"
    ]


def test_a_reach_far_beyond_all_costs_is_out_of_the_picture():
    curve = curve_of("huge")
    assert curve.reach == pytest.approx(30.0)
    assert curve.end < end_of(curve) < 2
    assert end_of(curve_of("huge and slow")) > 30


def test_distances_at_which_a_robot_collides_unseen_are_tinted():
    tint = (255, 228, 232)
    for name, share in (("cut off", 0.4), ("none", 0.6), ("polygon", 0.0)):
        seen = Seen(curve_of(name))
        rgb = seen.image.palette[seen.image.indices[seen.bottom - 3, seen.left :]]
        count = np.all(rgb == tint, axis=1).sum()
        assert count > share * WIDTH if share else count == 0


def test_numbers_beyond_all_bounds_are_drawn():
    far = cost_curve(
        0.05, inscribed_radius=1e300, inflation_radius=1e300, cost_scaling_factor=1e300
    )
    layers = ["static", {"inflation": {"name": "x" * 400, "inflation_radius": 0.3}}, "inflation"]
    for curve in (far, cost_curve(1e-6), cost_curve(0.05, model="layers", layers=layers)):
        height, width = cost_curve_image(curve, title="t").indices.shape
        assert 700 < height < 1000
        assert 1200 < width < 1500


def test_the_circumscribed_cost_has_the_colour_of_the_contour_in_costmaps():
    for name, is_drawn in (("polygon", True), ("none", False), ("point", False)):
        image = cost_curve_image(curve_of(name), title="t")
        rgb = image.palette[image.indices]
        assert np.all(rgb == colours.CONTOUR, axis=2).any() == is_drawn


@pytest.mark.parametrize("name", SETS)
def test_all_texts_lie_on_the_sheet(name, monkeypatch):
    texts = []
    monkeypatch.setattr(Pen, "label", lambda _, x, y, text: texts.append((x, y, text)))
    image = cost_curve_image(curve_of(name), title="t")
    height, width = image.indices.shape
    for x, y, text in texts:
        assert 0 <= x <= width - text_width(text, 16), text
        assert 0 <= y <= height, text
    labels = [text for _, _, text in texts]
    assert "cost" in labels
    assert labels.count("0") >= 2  # of the costs, and of the cells
