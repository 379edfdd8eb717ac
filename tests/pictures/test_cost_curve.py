"""What stands where in the picture of a cost curve."""

import pytest

from mapdeal import cost_curve
from mapdeal.pictures.canvas import Pen, text_width
from mapdeal.pictures.cost_curve import ZoneKind, cost_curve_image, end_of, zones_of
from pictures.samples import CURVES, curve_of


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


@pytest.mark.parametrize("name", CURVES)
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
