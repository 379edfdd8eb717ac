"""Parameters and recipes that cannot be (rows P)."""

import pytest

from bad_maps import DRAWING, cells_of, write_map
from drawn import cells

BAD_PARAMETERS = [
    ("P1-negative", ["inflate", "--radius", "-0.1"], "radius", ""),
    ("P1-nan", ["inflate", "--radius", "nan"], "radius", ""),
    ("P1-inf", ["inflate", "--radius", "inf"], "radius", ""),
    ("P1-overflow", ["inflate", "--radius", "1e400"], "radius", ""),
    ("P1-robot-radius-0", ["inflate", "--robot-radius", "0"], "radius", ""),
    ("P1-margin-nan", ["active", "--margin", "nan"], "margin", ""),
    ("P1-max-distance-0", ["esdf", "--max-distance", "0"], "max_distance", ""),
    ("P3-negative", ["cost", "--cost-scaling-factor", "-1"], "cost_scaling_factor", ""),
    ("P3-nan", ["cost", "--cost-scaling-factor", "nan"], "cost_scaling_factor", ""),
    ("P5-two-points", ["inflate", "--footprint", "[[1, 1], [-1, 1]]"], "footprint", ""),
    (
        "P5-crossing",
        ["inflate", "--footprint", "[[0.3, 0.2], [-0.3, -0.2], [0.3, -0.2], [-0.3, 0.2]]"],
        "vertex 1",
        "",
    ),
    ("P5-nan", ["cost", "--footprint", "[[1, 1], [-1, 1], [nan, 0]]"], "vertex 3", ""),
    ("P5-inf", ["cost", "--footprint", "[[1, 1], [inf, 1], [0, 0]]"], "vertex 2", ""),
    ("P5-huge", ["cost", "--footprint", "[[1, 1], [-1, 1], [0, -1e9]]"], "vertex 3", ""),
    ("P5-three-numbers", ["cost", "--footprint", "[[1, 1], [1, 2, 3], [0, 0]]"], "vertex 2", ""),
    ("P5-no-footprint", ["inflate", "--footprint", "round"], "footprint", ""),
    ("P12-unknown-parameter", ["run", "--set", "inflate.radus=1"], "radus", "radius"),
    ("P12-unknown-stage", ["run", "--set", "inflat.radius=1"], "inflat", "inflate"),
    ("P12-stage-of-another-recipe", ["run", "--set", "active.margin=1"], "active", "inflate"),
    ("P12-wrong-type", ["run", "--set", "inflate.radius=wide"], "inflate.radius", ""),
    ("P12-wrong-choice", ["run", "--set", "inflate.kernel=star"], "inflate.kernel", ""),
    ("P12-no-value", ["run", "--set", "inflate.radius"], "--set", ""),
    ("P12-unknown-recipe", ["run", "--recipe", "defualt"], "defualt", "default"),
    ("P12-long-recipe-name", ["run", "--recipe", "n" * 300], "recipe", ""),
    ("P12-unknown-option", ["inflate", "--radios", "1"], "--radios", ""),
]


@pytest.mark.parametrize(
    ("words", "place", "hint"), [pytest.param(*case, id=row) for row, *case in BAD_PARAMETERS]
)
def test_a_parameter_that_is_not_allowed_is_refused(refused, words, place, hint):
    name, *options = words
    output = "out" if name == "run" else "o.npz"
    refused([name, "m.yaml", "-o", output, *options], 2, place, hint=hint)


BAD_RECIPES = [
    ("P12-unknown-stage", "stages: [{inflat: {radius: 0.3}}]\n", "inflat", "inflate"),
    ("P12-unknown-parameter", "stages: [{inflate: {radus: 0.3}}]\n", "radus", "radius"),
    ("P12-cycle", "stages: &loop [*loop]\n", "r.yaml", ""),
    ("P12-cycle-in-a-parameter", "stages: [{inflate: &loop {radius: *loop}}]\n", "radius", ""),
    ("P12-same-output-twice", "stages: [inflate, esdf, inflate]\n", "inflate", ""),
    ("P12-wrong-type", "stages: [{inflate: {radius: [0.3]}}]\n", "inflate.radius", ""),
    ("P12-boolean-radius", "stages: [{inflate: {radius: yes}}]\n", "inflate.radius", ""),
    ("P12-model-of-a-list", "stages: [{cost: {model: [rings]}}]\n", "model", ""),
    ("P12-model-of-a-mapping", "stages: [{cost: {model: {a: b}}}]\n", "model", ""),
    ("P12-nothing-in-it", "", "r.yaml", ""),
    ("P12-no-stages", "stages: []\n", "r.yaml", ""),
    ("P12-broken-tag", 'stages: [{inflate: {radius: !!int ""}}]\n', "r.yaml", ""),
    ("P12-endless-radius", f"stages: [{{inflate: {{radius: 0x{'f' * 5000}}}}}]\n", "radius", ""),
    ("P12-duplicate-key", "stages: [esdf]\nstages: [inflate]\n", "1 and 2", ""),
]


@pytest.mark.parametrize(
    ("text", "place", "hint"), [pytest.param(*case, id=row) for row, *case in BAD_RECIPES]
)
def test_a_recipe_that_makes_no_sense_is_refused(folder, refused, text, place, hint):
    (folder / "r.yaml").write_text(text)
    refused(["run", "m.yaml", "-o", "out", "--recipe", "r.yaml"], 2, place, hint=hint)


def test_a_radius_beyond_the_map_makes_every_cell_lethal_p1(accepted):
    accepted("inflate", "m.yaml", "-o", "o.npz", "--radius", "1e6")
    assert cells_of("o.npz") == [[100] * 3] * 2


def test_a_margin_beyond_the_map_is_clipped_to_it_p1(accepted):
    accepted("active", "m.yaml", "-o", "o.npz", "--margin", "1e308")
    assert cells_of("o.npz") == cells(DRAWING).tolist()


def test_a_radius_below_half_a_cell_has_no_effect_p2(accepted):
    accepted("inflate", "m.yaml", "-o", "o.npz", "--radius", "0.02")
    assert cells_of("o.npz") == cells(DRAWING).tolist()


@pytest.mark.parametrize(
    ("factor", "row"),
    [
        pytest.param("0", [254, 252, 252, 0, 0], id="P3-zero-is-flat"),
        pytest.param("1e6", [254, 0, 0, 0, 0], id="P3-huge-underflows-to-0"),
        pytest.param("1e308", [254, 0, 0, 0, 0], id="P3-hugest-underflows-to-0"),
    ],
)
def test_an_extreme_scaling_factor_is_taken_as_it_is(folder, accepted, factor, row):
    write_map(folder, image=b"P5\n5 1\n255\n" + bytes([0, 254, 254, 254, 254]))
    accepted("cost", "m.yaml", "-o", "o.npz", "--inflation-radius", "0.1",
             "--cost-scaling-factor", factor)  # fmt: skip
    assert cells_of("o.npz", "cost") == [row]


def test_a_huge_threshold_factor_ends_at_99_p3(folder, accepted):
    write_map(folder, image=b"P5\n5 1\n255\n" + bytes([0, 254, 254, 254, 254]))
    accepted("cost", "m.yaml", "-o", "o.npz", "--model", "threshold", "--up-factor", "1e308",
             "--view-range", "0.25")  # fmt: skip
    # View 100, 80, 60, 40, 20: two cells above `up`, two not above `down`.
    assert cells_of("o.npz", "cost") == [[100, 99, 99, 0, 0]]


def test_an_inscribed_radius_above_the_inflation_radius_is_warned_of_p4(accepted):
    _, warned = accepted("cost", "m.yaml", "-o", "o.npz", "--inscribed-radius", "0.5",
                         "--inflation-radius", "0.3")  # fmt: skip
    assert any("inscribed" in line for line in warned)


def test_a_clockwise_footprint_is_accepted_p5(folder, accepted):
    write_map(folder, image=b"P5\n5 1\n255\n" + bytes([0, 254, 254, 254, 254]))
    shape = "[[-0.06, 0.08], [0.06, 0.08], [0.06, -0.08], [-0.06, -0.08]]"
    accepted("inflate", "m.yaml", "-o", "o.npz", "--footprint", shape)
    assert cells_of("o.npz") == [[100, 100, 100, 0, 0]]  # circumscribed: 0.1 m, two cells


def test_a_footprint_of_thousands_of_vertices_is_refused_p5(refused):
    shape = str([[k % 7 + 1.0, k % 5 + 1.0] for k in range(501)])
    refused(["inflate", "m.yaml", "-o", "o.yaml", "--footprint", shape], 2, "500 vertices")
