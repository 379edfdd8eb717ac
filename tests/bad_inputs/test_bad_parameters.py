"""Parameters and recipes that cannot be (rows P)."""

import pytest

from bad_maps import DRAWING, cells_of, write_map, yaml_text
from drawn import cells
from mapdeal import Costmap, read_map
from mapdeal import write_map as write_map_file

BAD_PARAMETERS = [
    ("P1-negative", ["inflate", "--radius", "-0.1"], "radius", ""),
    ("P1-nan", ["inflate", "--radius", "nan"], "radius", ""),
    ("P1-inf", ["inflate", "--radius", "inf"], "radius", ""),
    ("P1-overflow", ["inflate", "--radius", "1e400"], "radius", ""),
    ("P1-robot-radius-0", ["inflate", "--robot-radius", "0"], "radius", ""),
    ("P1-margin-nan", ["active", "--margin", "nan"], "margin", ""),
    ("P1-max-distance-0", ["esdf", "--max-distance", "0"], "--max-distance", ""),
    ("P3-negative", ["cost", "--cost-scaling-factor", "-1"], "--cost-scaling-factor", ""),
    ("P3-nan", ["cost", "--cost-scaling-factor", "nan"], "--cost-scaling-factor", ""),
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
    ("P12-cycle-in-a-parameter", "stages: [{inflate: &loop {radius: *loop}}]\n", "own anchor", ""),
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


TRIANGLE = ["--point", "1.5,-2.0", "--point", "1.6,-2.0", "--point", "1.5,-1.9"]
BAD_EDITS = [
    ("P5-two-points", ["polygon", *TRIANGLE[:4], "--value", "100"], "polygon", ""),
    ("P5-nan", ["polygon", *TRIANGLE, "--point", "nan,0", "--value", "1"], "vertex 4", ""),
    ("P5-inf", ["line", *TRIANGLE, "--point", "inf,0", "--value", "1"], "vertex 4", ""),
    ("P5-huge", ["polygon", *TRIANGLE[:4], "--point", "0,1e11", "--value", "1"], "vertex 3", ""),
    ("P5-too-huge", ["line", *TRIANGLE, "--point", "0,1e15", "--value", "1"], "vertex 4", ""),
    (
        "P5-crossing",
        ["polygon", "--point", "1.5,-2", "--point", "1.6,-1.9", "--point", "1.6,-2", "--point",
         "1.5,-1.9", "--value", "1"],
        "vertex 1", "",
    ),
    ("P5-one-number", ["polygon", "--point", "1", "--value", "1"], "--point", ""),
    ("P5-three-numbers", ["polygon", "--point", "1,2,3", "--value", "1"], "--point", ""),
    ("P5-odd-digits", ["line", "--point", "1_0,2", "--value", "1"], "--point", ""),
    ("P5-words", ["circle", "--point", "a,b", "--radius", "1", "--value", "1"], "--point", ""),
    ("no-point", ["polygon", "--value", "100"], "--point", ""),
    ("no-value", ["polygon", *TRIANGLE], "--value", ""),
    ("value-off-the-scale", ["polygon", *TRIANGLE, "--value", "101"], "value", ""),
    ("value-in-parts", ["polygon", *TRIANGLE, "--value", "1.5"], "--value", ""),
    ("P1-no-radius", ["circle", *TRIANGLE, "--value", "1"], "--radius", ""),
    ("P1-radius", ["circle", *TRIANGLE, "--radius", "-1", "--value", "1"], "radius", ""),
    ("P1-radius-nan", ["circle", *TRIANGLE, "--radius", "nan", "--value", "1"], "radius", ""),
    ("P1-radius-huge", ["circle", *TRIANGLE, "--radius", "1e11", "--value", "1"], "radius", ""),
    ("P1-thickness", ["line", *TRIANGLE, "--thickness", "-1", "--value", "1"], "thickness", ""),
    ("P1-thickness-of-a-file", ["line", "--file", "z.yaml", "--thickness", "1"], "--point", ""),
    ("P1-radius-of-a-file", ["circle", "--file", "z.yaml", "--radius", "1"], "--point", ""),
    ("overlay", ["polygon", *TRIANGLE, "--overlay", "add", "--value", "1"], "--overlay", ""),
    ("background-alone", ["line", *TRIANGLE, "--background", "1", "--value", "1"], "--blank", ""),
    (
        "background-off-the-scale",
        ["polygon", *TRIANGLE, "--blank", "--background", "101", "--value", "1"],
        "background", "",
    ),
    ("P9-zero", ["reset", "--at", "1.5,-2", "--size", "0,1"], "size", ""),
    ("P9-nan", ["reset", "--at", "1.5,-2", "--size", "nan,1"], "size", ""),
    ("P9-two-places", ["reset", "--at", "1,2", "--corner", "1,2", "--size", "1,1"], "--at", ""),
    ("P9-no-place", ["reset", "--size", "1,1"], "--at", ""),
]  # fmt: skip


@pytest.mark.parametrize(
    ("words", "place", "hint"), [pytest.param(*case, id=row) for row, *case in BAD_EDITS]
)
def test_an_edit_that_cannot_be_is_refused(refused, words, place, hint):
    kind, *options = words
    refused(["edit", kind, "m.yaml", "-o", "o.npz", *options], 2, place, hint=hint)


BAD_WINDOWS = [
    ("P9-zero", ["window", "--at", "1.5,-2", "--size", "1,0"], "size"),
    ("P9-negative", ["window", "--at", "1.5,-2", "--size", "-1,1"], "size"),
    ("P9-overflow", ["window", "--at", "1.5,-2", "--size", "1e7,1e7"], "size"),
    ("P9-far-overflow", ["window", "--corner", "1e300,0", "--size", "1,1"], "corner"),
    ("P9-no-size", ["window", "--at", "1.5,-2"], "--size"),
    ("P10-nan", ["shift", "--origin", "nan,0"], "origin"),
    ("P10-inf", ["shift", "--origin", "0,inf"], "origin"),
    ("P10-default-off-the-scale", ["shift", "--origin", "0,0", "--default", "255"], "default"),
    ("P10-words", ["shift", "--origin", "here"], "--origin"),
    ("no-angle", ["rotate"], "--straighten"),
    ("two-angles", ["rotate", "--yaw", "1", "--straighten"], "--yaw"),
    ("angle-nan", ["rotate", "--yaw", "nan"], "--yaw: "),
    ("angle-inf", ["rotate", "--yaw", "inf"], "--yaw: "),
    ("no-such-rule", ["rotate", "--yaw", "1", "--rule", "median"], "--rule"),
    ("no-resolution", ["rescale"], "--resolution"),
    ("resolution-zero", ["rescale", "--resolution", "0"], "resolution"),
    ("resolution-negative", ["rescale", "--resolution", "-0.1"], "resolution"),
    ("resolution-nan", ["rescale", "--resolution", "nan"], "resolution"),
    ("resolution-overflow", ["rescale", "--resolution", "1.1e-6"], "resolution"),
]


@pytest.mark.parametrize(
    ("words", "place"), [pytest.param(*case, id=row) for row, *case in BAD_WINDOWS]
)
def test_a_window_or_origin_that_cannot_be_is_refused(refused, words, place):
    name, *options = words
    refused([name, "m.yaml", "-o", "o.npz", *options], 2, place)


@pytest.mark.parametrize(
    "words",
    [
        pytest.param([*TRIANGLE[:4], "--point", "1.5,9"], id="P6-partly-outside"),
        pytest.param([f"--point={x},{y}" for x, y in [(8, 8), (9, 8), (9, 9)]], id="P6-outside"),
        pytest.param([f"--point=1.5{k},-2" for k in range(3)], id="P6-zero-area"),
    ],
)
def test_a_polygon_that_has_to_be_clipped_p6(folder, accepted, refused, words):
    write_map(folder, yaml_text(origin="[1.5, -2.0, 0]"))
    words = ["edit", "polygon", "m.yaml", *words, "--value", "100"]
    refused([*words, "-o", "s.npz", "--strict"], 1, "nothing was written")
    _, warned = accepted(*words, "-o", "o.npz")
    assert len(warned) == 1


def test_a_clockwise_polygon_is_the_same_p5(accepted):
    corners = [(1.51, -1.98), (1.64, -1.98), (1.64, -1.91), (1.51, -1.91)]
    for name, points in (("a", corners), ("b", corners[::-1])):
        words = [f"--point={x},{y}" for x, y in points]
        accepted("edit", "polygon", "m.yaml", "-o", f"{name}.npz", *words, "--value", "100")
    assert cells_of("a.npz") == cells_of("b.npz")


def test_a_window_larger_than_the_map_is_filled_with_unknown_p9(accepted):
    accepted("window", "m.yaml", "-o", "o.npz", "--corner", "1.5,-2.0", "--size", "0.2,0.15")
    expected = [[*row, -1] for row in cells(DRAWING).tolist()]
    assert cells_of("o.npz") == [*expected, [-1] * 4]


def test_an_origin_far_away_keeps_nothing_and_warns_p10(accepted):
    _, warned = accepted("shift", "m.yaml", "-o", "o.npz", "--origin", "1e9,-1e9")
    assert cells_of("o.npz") == [[-1] * 3] * 2
    assert len(warned) == 1


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["pack", "m.yaml", "-o", "o.pgm"], 2),
        (["pack", "m.yaml", "-o", "m.pbm", "--force"], 4),
        (["pack", "m.yaml", "-o", "o.pbm", "--lethal-threshold", "0"], 2),
        (["unpack", "m.yaml", "-o", "o.yaml"], 2),
        (["unpack", "none.pbm", "-o", "o.yaml"], 4),
        (["unpack", "m.pgm", "-o", "o.yaml"], 2),
        (["cost", "m.yaml", "-o", "o.npz", "--mask", "none.yaml"], 4),
        (["cost", "m.yaml", "-o", "m.npz", "--mask", "m.pgm"], 3),
        (["convert", "m.yaml", "-o", "o.npz", "--static-layer"], 2),
        (["convert", "m.yaml", "-o", "o.npz", "--lethal-threshold", "65"], 2),
        (["convert", "m.yaml", "-o", "o.npz", "--encoding", "costmap2d", "--static-layer",
          "--lethal-threshold", "101"], 2),
        (["convert", "m.yaml", "-o", "o.npz", "--encoding", "amcl2"], 2),
        (["convert", "m.yaml", "-o", "o.npz", "--encoding", "costmap2d", "--static-layer",
          "--inscribed-value", "many"], 2),
        (["edit"], 2),
        (["edit", "star", "m.yaml"], 2),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else str(value),
)  # fmt: skip
def test_other_words_that_make_no_sense(refused, words, code):
    refused(words, code)


@pytest.mark.parametrize("name", ["edit", "convert"])
def test_a_field_is_not_edited_nor_has_it_values(accepted, refused, name):
    accepted("esdf", "m.yaml", "-o", "e.npz")
    if name == "edit":
        refused(["edit", "circle", "e.npz", "-o", "o.npz", "--point", "1.5,-2", "--radius", "1",
                 "--value", "1"], 2, "e.npz", hint="esdf")  # fmt: skip
    else:
        refused(["convert", "e.npz", "-o", "o.npz", "--encoding", "amcl"], 2, "encoding")
        refused(["pack", "e.npz", "-o", "o.pbm", "--lethal-threshold", "50"], 2, "threshold")
        refused(["window", "e.npz", "-o", "o.npz", "--corner", "1.5,-2", "--size", "0.05,0.05",
                 "--default", "0"], 2, "default")  # fmt: skip


def test_what_is_wrong_with_a_shape_of_a_file_is_the_file_s_fault(folder, refused, accepted):
    def shapes(text):
        (folder / "z.yaml").write_text(f"shapes:\n- {{type: circle, {text}}}\n")
        return ["edit", "circle", "m.yaml", "-o", "o.npz", "--file", "z.yaml"]

    refused(shapes("center: [1.5, -2], radius: 1, value: 254"), 3, "z.yaml: shape 1 (line 2)")
    refused(shapes("center: [1.5, -2], radius: 1e11, value: 1"), 3, "z.yaml: shape 1 (line 2)")
    refused(shapes("center: [1.5, -2], radius: 1"), 2, "--value", hint="z.yaml: shape 1 (line 2)")
    outside = shapes("center: [99, -2], radius: 1, value: 1")
    refused([*outside, "--strict"], 1, "nothing was written")
    assert "z.yaml: shape 1 (line 2): circle" in accepted(*outside)[1][0]


def test_files_that_were_mixed_up_are_told_apart(folder, refused):
    (folder / "z.yaml").write_text("shapes:\n- {type: circle, center: [0, 0], radius: 1}\n")
    (folder / "r.yaml").write_text("stages: [esdf]\n")
    (folder / "l.yaml").write_text("- {type: circle, center: [0, 0], radius: 1}\n")
    refused(["cost", "m.yaml", "-o", "o.npz", "--mask", "z.yaml"], 3, "z.yaml", hint="edit")
    refused(["inflate", "r.yaml", "-o", "o.npz"], 3, "r.yaml", hint="--recipe")
    words = ["edit", "circle", "m.yaml", "-o", "o.npz", "--value", "1", "--file"]
    refused([*words, "l.yaml"], 3, "l.yaml", hint="shapes:")
    refused([*words, "m.yaml"], 3, "m.yaml: is a map, not a file of shapes", hint="info")


BAD_QUESTIONS = [
    ("P7-three-numbers", ["query", "m.yaml", "--at", "1,2,3"], 2, "--at"),
    ("P7-no-number", ["query", "m.yaml", "--at", "here"], 2, "--at"),
    ("P7-no-point", ["query", "m.yaml"], 2, "--points"),
    ("P7-no-such-file", ["query", "m.yaml", "--points", "none.csv"], 4, "none.csv"),
    ("P7-a-folder", ["query", "m.yaml", "--points", "."], 4, "."),
    ("P8-goal-in-an-obstacle", ["potential", "m.yaml", "-o", "o.npz", "--goal"], 2, "goal"),
    ("P8-goal-nan", ["potential", "m.yaml", "-o", "o.npz", "--goal", "nan,1"], 2, "goal"),
    ("P8-goal-of-one-number", ["potential", "m.yaml", "-o", "o.npz", "--goal", "1"], 2, "goal"),
    ("P8-cap-0", ["potential", "m.yaml", "-o", "o.npz", "--repulsive-cap", "0"], 2, "cap"),
    ("P8-gain", ["potential", "m.yaml", "-o", "o.npz", "--repulsive-gain", "-1"], 2, "gain"),
    ("P8-gain-that-overflows", ["potential", "m.yaml", "-o", "o.npz", "--attractive-gain",
                                "1e308"], 2, "--attractive-gain"),
    ("P8-potential-as-yaml", ["potential", "m.yaml", "-o", "o.yaml"], 2, "o.yaml"),
    ("P8-start-closed", ["route", "m.yaml", "--to", "9,9", "--from"], 2, "m.yaml: start"),
    ("P8-goal-outside", ["route", "c.npz", "--from", "1.51,-1.98", "--to", "9,9"], 2, "goal"),
    ("P8-start-nan", ["route", "c.npz", "--from", "nan,0", "--to", "9,9"], 2, "start"),
    ("P8-no-goal", ["route", "m.yaml", "--from", "1,1"], 2, "--to"),
    ("P8-method", ["route", "m.yaml", "--from", "1,1", "--to", "1,1", "--method", "x"], 2, ""),
    ("P8-weight", ["route", "c.npz", "--from", "1.51,-1.98", "--to", "1.51,-1.98",
                   "--field-weight", "-1"], 2, "field_weight"),
    ("P8-other-method", ["route", "c.npz", "--from", "1.51,-1.98", "--to", "1.51,-1.98",
                         "--attractive-gain", "2"], 2, "--attractive-gain"),
    ("P8-other-method-too", ["route", "c.npz", "--from", "1.51,-1.98", "--to", "1.51,-1.98",
                             "--method", "descent", "--field-weight", "2"], 2, "--field-weight"),
    ("P8-output", ["route", "c.npz", "--from", "1.51,-1.98", "--to", "1.51,-1.98", "-o", "o.txt"],
     2, "o.txt"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("words", "code", "place"), [pytest.param(*case, id=row) for row, *case in BAD_QUESTIONS]
)
def test_a_question_that_cannot_be_asked_is_refused(folder, accepted, refused, words, code, place):
    grid = read_map(folder / "m.yaml")
    wall = grid.frame.xy_from_rowcol([next(zip(*(grid.occupancy == 100).nonzero(), strict=True))])
    write_map_file(folder / "c.npz", Costmap([[0, 0, 254]], 0.05, grid.origin))
    if words[-1] in ("--goal", "--from"):
        words = [*words, "{},{}".format(*wall[0])]
    refused(words, code, place)
