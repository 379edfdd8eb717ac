import re

import numpy as np
import pytest

import mapdeal
from mapdeal.report.page import curve_figure
from report.test_markup import read


def drawn(curve):
    return read(curve_figure(curve))


LABEL = r'<text x="([\d.]+)" y="[\d.]+" text-anchor="middle">([\d.]+)<'
CURVE = mapdeal.cost_curve(0.05, inscribed_radius=0.2, inflation_radius=0.6)


def test_dots_stand_at_each_whole_cell_with_its_cost():
    markup = curve_figure(CURVE).text
    label = {
        float(m[2]): float(m[1])
        for m in re.finditer(
            r'<text x="([\d.]+)" y="[\d.]+" text-anchor="middle">([\d.]+)<', markup
        )
    }
    rows = {
        float(m[2]): float(m[1]) - 4
        for m in re.finditer(r'<text x="[\d.]+" y="([\d.]+)" text-anchor="end">(\d+)<', markup)
    }
    (m0, x0), (m1, x1) = min(label.items()), max(label.items())
    dots = [
        (float(m[1]), float(m[2]))
        for m in re.finditer(r'<circle cx="([\d.]+)" cy="([\d.]+)"', markup)
    ]
    metres = [m0 + (x - x0) / (x1 - x0) * (m1 - m0) for x, _ in dots]
    costs = [(rows[0.0] - y) / (rows[0.0] - rows[254.0]) * 254 for _, y in dots]
    whole = CURVE.cells == np.floor(CURVE.cells)
    assert metres == pytest.approx((CURVE.cells[whole] * 0.05).tolist(), abs=1e-3)
    assert costs == pytest.approx(CURVE.cost[whole].tolist(), abs=0.05)


def test_zones_and_marks_are_told_in_words():
    tags, text = drawn(CURVE)
    assert "inscribed radius: 0.2 m" in text
    assert "inflation radius: 0.6 m" in text
    assert "collision at any heading" in text
    figure = next(attrs for tag, attrs in tags if tag == "svg" and attrs.get("role") == "img")
    assert "collision at any heading" in figure["aria-label"]


def test_colours_are_attributes_and_never_styles():
    tags, _ = drawn(CURVE)
    assert not [attrs for _, attrs in tags if "style" in attrs]
    assert {attrs["fill"] for tag, attrs in tags if tag == "rect"} >= {"#101014", "#00bec8"}


def test_costs_on_the_scale_of_occupancy_end_at_100():
    _, text = drawn(mapdeal.cost_curve(0.05, model="threshold"))
    assert "254" not in text
    assert "100" in text
