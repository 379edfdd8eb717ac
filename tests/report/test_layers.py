import json

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

import mapdeal
from drawn import grid_from_text
from mapdeal import Costmap, OccupancyGrid, esdf, potential
from mapdeal.grid.frame import Frame
from mapdeal.grid.reach import Bottleneck, Goal, GoalReach, Passage
from mapdeal.grid.values import UNKNOWN
from mapdeal.kernels.blocks import lazy_layer
from mapdeal.pictures.canvas import sheet
from mapdeal.pictures.layers import cost_image, field_image, occupancy_image
from mapdeal.pictures.styles import POTENTIAL_OBSTACLE
from mapdeal.pipeline.folder import _FILES
from mapdeal.report import verdict
from mapdeal.report.document import Claim, Entry, Item, Report, Verdict, outlines_of, page_layers
from mapdeal.report.page import body_of, legend_of, page_of
from mapdeal.report.tiles import extent_of
from mapdeal.report.verdict import most_urgent, on_costs, on_goals, settled

GRID = grid_from_text("?..##...\n..+##...\n........\n...##..?\n...##..?")
ORIGIN = (1.5, -2.0, 0.4)
FRAME = Frame(7, 9, 0.25, (1.5, -2.0, 0.4))
GRIDS = {
    mapdeal.OccupancyGrid: GRID,
    mapdeal.FieldView: mapdeal.field_view(mapdeal.esdf(GRID)),
    mapdeal.Costmap: mapdeal.exponential_cost(GRID, inflation_radius=0.6),
    mapdeal.DistanceField: mapdeal.esdf(GRID),
    mapdeal.PotentialField: mapdeal.potential(GRID),
    mapdeal.Reach: mapdeal.reach(GRID, radius=0.1),
}


@pytest.mark.parametrize("grid_type", _FILES, ids=lambda grid_type: grid_type.__name__)
def test_every_type_of_grid_that_is_written_becomes_layers(grid_type):
    grid = GRIDS[grid_type]
    assert type(grid) is grid_type
    layers = page_layers(grid, "name", "Title")
    assert layers[-1].name == "name"  # its own is on top
    for layer in layers:
        assert layer.frame == grid.frame
        assert layer.values.dtype == (np.uint8 if layer.style.by_value is not None else np.float32)
        assert (layer.style.scale is None) == layer.is_bytes
        assert layer.states in (None, *(page_layer.name for page_layer in layers))


def test_unknown_cells_give_way_in_a_pixel_and_a_scale_is_shown_where_it_is_needed():
    for grid_type in (mapdeal.OccupancyGrid, mapdeal.Costmap):
        rank = page_layers(GRIDS[grid_type], "name", "Title")[-1].rank
        assert rank[255] == 0
        assert (np.diff(rank[:255].astype(int)) == 1).all()
    black_and_white = mapdeal.inflate(GRID, radius=0.0, lethal_threshold=50)
    for grid, is_needed in ((GRID, True), (black_and_white, False)):
        (layer,) = page_layers(grid, "name", "Title")
        assert (layer.style.bar is not None) == is_needed


def test_the_legend_is_of_cells_and_not_of_what_pictures_draw_over_them():
    costmap = mapdeal.exponential_cost(GRID, inscribed_radius=0.3, circumscribed_radius=0.5)
    (costs,) = page_layers(costmap, "name", "Title")
    names = [swatch.label.split()[0] for swatch in costs.style.swatches]
    assert names == ["lethal", "inscribed", "free", "unknown"]  # no contour
    *_, potential = page_layers(mapdeal.potential(GRID, goal=(2.0, -1.0)), "name", "Title")
    names = [swatch.label.split(":")[0] for swatch in potential.style.swatches]
    assert names == ["obstacle", "unknown"]  # neither arrows nor the goal


def test_a_layer_and_the_header_of_a_page_tell_what_a_reader_must_know():
    field = esdf(GRID, convention="border", strength=1.5, lethal_threshold=65)
    its_map, distance = layers = page_layers(field, "f", "F")
    assert (its_map.pooled, distance.pooled) == ("largest", "smallest")
    assert (distance.convention, distance.states, its_map.name) == ("border", "f-map", "f-map")
    assert page_layers(potential(GRID), "p", "P")[1].style.line == POTENTIAL_OBSTACLE
    page = b"".join(page_of(Report("t", (Entry("e", tuple(layers)),), "1"), size=1 << 20)).decode()
    text = page.partition('id="report">')[2].partition("</script>")[0]
    its_map, distance = json.loads(text)["entries"][0]["layers"]
    assert (its_map["lethal"], distance["lethal"]) == (65, 65)
    assert (its_map["states"], distance["states"]) == (None, "f-map")


def test_legends_have_the_colours_of_the_style():
    (layer,) = page_layers(OccupancyGrid([[0, 37, 100]], 0.25), "m", "M")
    text = legend_of(layer.style, "k").text
    for swatch in layer.style.swatches:
        colour = "#" + bytes(layer.style.colours[swatch.index]).hex()
        head, _, _ = text.partition(f" {swatch.label}</li>")
        assert f'fill="{colour}"' in head.rpartition("<li>")[2]
    stops = [part.partition('"')[0] for part in text.split('stop-color="')[1:]]
    ends = [layer.style.colours[layer.style.bar.indices[place]] for place in (0, -1)]
    assert [stops[0], stops[-1]] == ["#" + bytes(end).hex() for end in ends]
    assert stops[0] != stops[-1]
    for x, anchor, label in ((0, "start", "0"), (144, "middle", "50"), (288, "end", "100")):
        assert f'<text x="{x}" y="27" text-anchor="{anchor}">{label}</text>' in text


def test_an_item_with_a_line_alone_can_be_gone_to():
    line = np.array([[0.0, 1.0], [2.0, 3.0]])
    items = (Item("shape", "only a line", lines=(line,)), Item("finding", "nowhere"))
    (layer,) = page_layers(OccupancyGrid([[0, 100]], 0.25), "m", "M")
    text = body_of(Report("t", (Entry("e", (layer,), items),), "1")).text
    assert 'data-item="0"' in text
    assert 'data-item="1"' not in text


def test_two_maps_that_are_compared_are_chosen():
    layers = [page_layers(OccupancyGrid([[0, 100]], 0.25), name, name)[0] for name in "abc"]
    text = body_of(Report("t", (Entry("e", tuple(layers), compared=("c", "a")),), "1")).text
    first_choice, right = text.split("<select")[1:3]
    assert 'value="2" selected' in first_choice
    assert 'value="0" selected' in right
    plain = body_of(Report("t", (Entry("e", tuple(layers)),), "1")).text
    assert 'value="1" selected' in plain.split("<select")[1]


def extent(cells, items=(), yaw=0.0):
    return extent_of(page_layers(OccupancyGrid(cells, 0.5, (2.0, -3.0, yaw)), "map", "Map"), items)


CELLS = arrays(np.int8, array_shapes(min_dims=2, max_dims=2, max_side=9),
               elements=st.sampled_from([-1] * 9 + [0, 50, 100]))  # fmt: skip


@given(CELLS, st.sampled_from([0.0, 0.3, -2.0]))
def test_the_extent_is_the_box_of_known_cells_and_a_margin(cells, yaw):
    rows, cols = np.nonzero(cells >= 0)
    if not rows.size:
        assert extent(cells, yaw=yaw) is None
        return
    box = [(c * 0.5, r * 0.5) for r in (rows.min(), rows.max() + 1)
           for c in (cols.min(), cols.max() + 1)]  # fmt: skip
    turned = [(2 + a * np.cos(yaw) - b * np.sin(yaw), -3 + a * np.sin(yaw) + b * np.cos(yaw))
              for a, b in box]  # fmt: skip
    low, high = np.min(turned, axis=0), np.max(turned, axis=0)
    margin = 0.04 * max(high - low)
    assert extent(cells, yaw=yaw) == pytest.approx((*(low - margin), *(high + margin)))


def test_items_lie_within_the_extent():
    cells = np.full((6, 8), -1, np.int8)
    cells[2, 3] = 0
    lines = (np.array([[-5.0, 0.0], [0.0, 30.0]]),)
    items = Item("goal", "far", place=(40.0, 1.0)), Item("route", "", lines=lines), Item("a", "b")
    west, bottom, east, top = extent(cells, items)
    assert west < -5 < 40 < east
    assert bottom < -2 < 30 < top


def test_a_field_alone_has_no_extent_and_rows_that_are_made_when_asked_for_the_same():
    field = page_layers(esdf(OccupancyGrid([[100, 0, 0]], 0.5)), "esdf", "Field")[-1]
    assert extent_of([field], []) is None
    cells = np.full((50, 8), -1, np.int8)
    cells[17:39, 2:5] = 0
    lazy = lazy_layer(cells.shape, np.int8, lambda rows: cells[rows], block_height=7)
    assert extent(lazy) == extent(cells)


def encloses(lines, x, y):
    """Return whether a ray to the right crosses the lines an odd number of times."""
    crossings = 0
    for line in lines:
        for (x0, y0), (x1, y1) in zip(line[:-1].tolist(), line[1:].tolist(), strict=True):
            if (y0 > y) != (y1 > y):
                crossings += x0 + (y - y0) / (y1 - y0) * (x1 - x0) > x
    return crossings % 2 == 1


@given(arrays(bool, FRAME.shape, elements=st.booleans()))
def test_outlines_enclose_their_cells_alone(marked):
    if not marked.any():
        return
    lines = outlines_of(np.argwhere(marked), FRAME)
    assert all((line[0] == line[-1]).all() for line in lines)
    area = sum((x[:-1] * y[1:] - x[1:] * y[:-1]).sum() / 2 for x, y in (line.T for line in lines))
    assert area == pytest.approx(np.count_nonzero(marked) * FRAME.resolution**2)
    every = [(row, col) for row in range(FRAME.height) for col in range(FRAME.width)]
    for cell, (x, y) in zip(every, FRAME.xy_from_rowcol(every).tolist(), strict=True):
        assert encloses(lines, x, y) == marked[cell], cell


def test_a_rectangle_has_four_corners():
    rows, cols = np.mgrid[1:4, 2:8]
    (line,) = outlines_of(np.stack([rows.ravel(), cols.ravel()], axis=1), FRAME)
    assert len(line) == 5


def pictured(draw, grid):
    """Return the colours in the middles of the cells of a picture, row 0 in the south."""
    recorded = {}

    def record(pixels, palette, **options):
        recorded.update(pixels=pixels, palette=palette)
        return sheet(pixels, palette, **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mapdeal.pictures.canvas.sheet", record)
        draw(grid, title="t")
    pixels = np.asarray(recorded["pixels"])
    step = pixels.shape[0] // grid.shape[0]
    assert step >= 3  # otherwise outlines cover cells
    middles = pixels[step // 2 :: step, step // 2 :: step][: grid.shape[0], : grid.shape[1]]
    return recorded["palette"][middles]


def shown(layers):
    layer = layers[-1]
    style, values = layer.style, np.asarray(layer.values[:])
    states = next(
        (
            np.asarray(other_layer.values[:])
            for other_layer in layers
            if other_layer.name == layer.states
        ),
        None,
    )
    colours = np.empty((*values.shape, 3), dtype=np.uint8)
    for cell, value in np.ndenumerate(values):
        if style.by_value is not None:
            index = int(style.by_value[value])
        elif np.isnan(value):
            index = style.nowhere
        else:
            scale = style.scale
            share = (float(value) - scale.low) / (scale.high - scale.low)
            index = scale.first
            if share == np.inf or share >= 1:
                index += scale.levels - 1
            elif share > 0:
                index += int(share * scale.levels)
            if style.faded_by is not None and states[cell] == 255:
                index += style.faded_by
        colours[cell] = style.colours[index]
    return colours


@pytest.mark.parametrize(
    ("convention", "shape"), [("fast-planner", (3, 5)), ("center", (9, 4)), ("border", (7, 12))]
)
def test_maps_and_fields_have_the_colours_of_their_pictures(convention, shape):
    random = np.random.default_rng(shape[0])
    occupancy = random.choice(np.array([0, 0, 0, 100, -1, 37], dtype=np.int8), shape)
    occupancy[0, 0] = occupancy[-1, -1] = 0  # the extent of a picture is that of known cells
    grid = OccupancyGrid(occupancy, 0.25, ORIGIN)
    assert np.array_equal(shown(page_layers(grid, "m", "M")), pictured(occupancy_image, grid))
    field = esdf(grid, convention=convention)
    off = np.abs(shown(page_layers(field, "f", "F")).astype(int) - pictured(field_image, field))
    open_cells = (occupancy < 100) & (field.distance > 0)  # others have outlines
    assert (occupancy[open_cells] == UNKNOWN).any()
    assert off[open_cells].max() <= 6  # a value between two steps has either colour
    assert (off[open_cells] > 0).mean() < 0.2


@settings(max_examples=8)
@given(st.lists(st.integers(0, 255), min_size=24, max_size=24), st.booleans())
def test_costs_have_the_colours_of_their_pictures(values, is_published):
    cost = np.array(values, dtype=np.uint8).reshape(4, 6)
    costs = Costmap(cost, 0.25, ORIGIN, circumscribed_cost=128)
    if is_published:
        costs = Costmap((cost % 102).astype(np.int8) - 1, 0.25, ORIGIN, "occupancy")
    assert np.array_equal(shown(page_layers(costs, "c", "C")), pictured(cost_image, costs))


ROBOT = mapdeal.Footprint.circle(0.3)
THERE = GoalReach(Goal(1, 2, "lab"), True, 1, 0.4, Bottleneck(0, 0, 0.8))
STOPPED = GoalReach(Goal(3, 4, "store"), False, 0, 0.25, Bottleneck(1.0, 2.0, 0.5))
CORNERED = GoalReach(Goal(3, 4, "store"), False, 0, 0.35, Bottleneck(1.0, 2.0, 0.7))
WALLED = GoalReach(Goal(5, 6), False, 0, 0.0)
IN_WALL = GoalReach(Goal(5, 6), False, 0, 0.0, reason="an obstacle")
SHUT = Passage(1, 2, 0.5, 7.0, False, ((0, 0), (1, 1)))


@pytest.mark.parametrize(("messages", "state", "text"), [
    ({}, "good", "The map is sound: no errors, no warnings"),
    ({"note": ["n"]}, "good", "The map is sound: no errors, no warnings (1 note)"),
    ({"warning": ["w", "v"]}, "warning", "The map has no errors, but 2 warnings: w"),
    ({"error": ["e"], "warning": ["w"]}, "error", "The map has 1 error and 1 warning: e"),
])  # fmt: skip
def test_findings(messages, state, text):
    claim = verdict.on_findings(messages)
    assert (claim.state, claim.text) == (state, text)


@pytest.mark.parametrize(("goals", "passages", "robot", "share", "state", "text"), [
    ([THERE], [], ROBOT, 1.0, "good",
     "The robot reaches its goal; the narrowest place on the way is 0.8 m wide"),
    ([THERE, STOPPED], [SHUT], ROBOT, 1.0, "error",
     ("The robot reaches 1 of 2 goals. Not reached: store (a passage at 1,2 is 0.5 m wide, "
     "the robot needs 0.6 m)")),
    ([CORNERED], [], ROBOT, 1.0, "error",
     "The robot reaches 0 of 1 goal. Not reached: store (it cannot turn on the way)"),
    ([WALLED, IN_WALL], [], ROBOT, 1.0, "error",
     ("The robot reaches 0 of 2 goals. Not reached: 5,6 (no way leads there); "
      "5,6 (its cell is an obstacle)")),
    ([], [SHUT], ROBOT, 0.26, "warning",
     "The robot gets to 26 % of the area that it fits in: 1 passage is closed to it"),
    ([], [], ROBOT, 0.97, "good",
     "The robot gets to 97 % of the area that it fits in; no goals were given"),
    ([], [], ROBOT, 0.5, "warning",
     "The robot gets to 50 % of the area that it fits in; no goals were given"),
    ([THERE], [], None, 1.0, "warning",
     ("A point, as no robot was given, reaches its goal; "
     "the narrowest place on the way is 0.8 m wide")),
])  # fmt: skip
def test_goals(goals, passages, robot, share, state, text):
    claim = on_goals(goals, passages, robot, share=share)
    assert (claim.state, claim.text) == (state, text)


def manifest_of(robot=None, **more):
    cost = {"inscribed_radius": 0.2, "inflation_radius": 0.55, "cost_scaling_factor": 10.0}
    return {"stages": [{"inflate": {"radius": 0.3}}, {"cost": cost}], "robot": robot, **more}


def robot_of(*entries):
    layers = [{"name": "inflation_layer"}]
    layers += [{"name": f"l{k}", **entry} for k, entry in enumerate(entries)]
    return {"files": [{"name": "nav2.yaml"}], "costmap": "global", "layers": layers}


SENSORS = {"needs": "observations", "enabled": True}
FILTER = {"needs": "mask", "enabled": True, "filter": True}


@pytest.mark.parametrize(("manifest", "state", "words"), [
    (manifest_of(), "warning", "walls inflated by 0.3 m, inscribed radius 0.2 m"),
    (manifest_of(robot_of(SENSORS)), "good", "robot's own: global costmap of nav2.yaml"),
    (manifest_of(robot_of({"ignored": "limits the speed"})), "good", "robot's own: global costmap"),
    (manifest_of(robot_of({"ignored": "not modelled"})), "warning", "lacks l0 (not modelled)"),
    (manifest_of(robot_of(SENSORS, FILTER)), "warning", "l1, whose mask was not given"),
    (manifest_of(robot_of(SENSORS, FILTER | {"enabled": False})), "good", "own"),
    (manifest_of(robot_of(SENSORS, FILTER), mask={"m.yaml": "0"}), "good", "own"),
    ({"stages": [{"cost": [1]}], "robot": 5}, None, ""),
    ({"stages": [{"cost": {"inflation_radius": "x"}}], "robot": 5}, "warning", "not made from"),
    ({"stages": [{"esdf": {}}]}, None, ""),
    ({"stages": [{"cost": {}}], "robot": {"files": 3, "layers": 4}}, "good", "own"),
])  # fmt: skip
def test_costs(manifest, state, words):
    claim = on_costs(manifest)
    assert (None if claim is None else claim.state) == state
    assert claim is None or words in claim.text


def test_three_claims_are_left_of_those_about_the_same_the_worst_and_one_of_a_failure():
    claims = [
        Claim("goals", "good", "g"), Claim("map", "good", "m"), Claim("map", "error", "e"),
        Claim("cells", "warning", "c"), Claim("costmap", "unknown", "u"),
        Claim("map", "warning", "w"),
    ]  # fmt: skip
    assert [claim.text for claim in settled(claims)] == ["e", "u", "g"]
    failure = Claim("run", "error", "Processing failed: the image does not exist", "finding")
    assert settled([Claim("map", "error", "the image does not exist"), failure]) == (failure,)


def test_the_claim_about_a_mirrored_map_names_what_undoes_it():
    found = mapdeal.diff(GRID, GRID.with_values(GRID.occupancy[::-1]))
    text = "The second map would be much more like the first if mirrored upside down"
    claim = Claim("geometry", "error", text, "What differs")
    assert verdict.on_difference(found, [], 0)[-1] == claim


def test_the_next_command_is_that_of_the_worst_verdict_that_has_one():
    states = (("good", "x"), ("warning", "y"), ("error", ""))
    verdicts = [Verdict("a", state, (), command) for state, command in states]
    assert (most_urgent(verdicts), most_urgent(verdicts[2:])) == ("y", "")
