"""Parameters at their limits: taken as they are, clipped, or warned of."""

import pytest

from bad_maps import DRAWING, cells_of, write_map, yaml_text
from drawn import cells

FIVE = b"P5\n5 1\n255\n" + bytes([0, 254, 254, 254, 254])
CLOCKWISE = "[[-0.06, 0.08], [0.06, 0.08], [0.06, -0.08], [-0.06, -0.08]]"


@pytest.mark.parametrize(("words", "drawing"), [
    (["inflate", "--radius", "1e6"], "###\n###"),
    (["active", "--margin", "1e308"], DRAWING),
    (["inflate", "--radius", "0.02"], DRAWING),  # below half a cell
    (["window", "--corner", "1.5,-2.0", "--size", "0.2,0.15"], "????\n#.??\n..#?"),
], ids=lambda value: " ".join(value) if isinstance(value, list) else "")  # fmt: skip
def test_a_size_beyond_the_map_or_below_a_cell(accepted, words, drawing):
    accepted(words[0], "m.yaml", "-o", "o.npz", *words[1:])
    assert cells_of("o.npz") == cells(drawing).tolist()


@pytest.mark.parametrize(("words", "layer", "row"), [
    (["--cost-scaling-factor", "0"], "cost", [254, 252, 252, 0, 0]),
    (["--cost-scaling-factor", "1e6"], "cost", [254, 0, 0, 0, 0]),
    (["--cost-scaling-factor", "1e308"], "cost", [254, 0, 0, 0, 0]),
    # View 100, 80, 60, 40, 20: two cells above `up`, two not above `down`.
    (["--model", "threshold", "--up-factor", "1e308", "--view-range", "0.25"], "cost",
     [100, 99, 99, 0, 0]),
    # Circumscribed: 0.1 m, two cells.
    (["--footprint", CLOCKWISE], "occupancy", [100, 100, 100, 0, 0]),
])  # fmt: skip
def test_extreme_factors_and_a_clockwise_footprint_are_taken(folder, accepted, words, layer, row):
    write_map(folder, image=FIVE)
    name = "cost" if layer == "cost" else "inflate"
    radius = ["--inflation-radius", "0.1"] if "--cost-scaling-factor" in words else []
    accepted(name, "m.yaml", "-o", "o.npz", *radius, *words)
    assert cells_of("o.npz", layer) == [row]


def test_an_inscribed_radius_above_the_inflation_radius_is_warned_of(accepted):
    words = ["--inscribed-radius", "0.5", "--inflation-radius", "0.3"]
    _, warned = accepted("cost", "m.yaml", "-o", "o.npz", *words)
    assert any("inscribed" in line for line in warned)


@pytest.mark.parametrize("points", [
    pytest.param([(1.5, -2), (1.6, -2), (1.5, 9)], id="partly-outside"),
    pytest.param([(8, 8), (9, 8), (9, 9)], id="outside"),
    pytest.param([(1.5, -2), (1.51, -2), (1.52, -2)], id="zero-area"),
])  # fmt: skip
def test_a_polygon_that_has_to_be_clipped(folder, accepted, refused, points):
    write_map(folder, yaml_text(origin="[1.5, -2.0, 0]"))
    words = ["edit", "polygon", "m.yaml", *(f"--point={x},{y}" for x, y in points), "--value=100"]
    refused([*words, "-o", "s.npz", "--strict"], 1, "nothing was written")
    _, warned = accepted(*words, "-o", "o.npz")
    assert len(warned) == 1


def test_an_origin_far_away_keeps_nothing_and_warns(accepted):
    _, warned = accepted("shift", "m.yaml", "-o", "o.npz", "--origin", "1e9,-1e9")
    assert cells_of("o.npz") == [[-1] * 3] * 2
    assert len(warned) == 1


def test_a_clipped_shape_of_a_file_is_named(folder, accepted):
    shape = "shapes:\n- {type: circle, center: [99, -2], radius: 1, value: 1}\n"
    (folder / "z.yaml").write_text(shape)
    _, warned = accepted("edit", "circle", "m.yaml", "-o", "o.npz", "--file", "z.yaml")
    assert "z.yaml: shape 1 (line 2): circle" in warned[0]
