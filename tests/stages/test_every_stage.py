"""What holds for every stage, and what stages refuse."""

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest

import mapdeal
from drawn import cells, grid_from_text
from mapdeal import MalformedInputError, OccupancyGrid, ParameterError, esdf, field_view
from mapdeal.command import parameters_of
from mapdeal.pipeline.recipe import load_recipe
from mapdeal.pipeline.step import grid_of, make_step
from mapdeal.stages import catalogue
from mapdeal.stages.structured import accept_goals

STAGES = {" ".join(filter(None, (stage.name, stage.model))): stage for stage in catalogue.STAGES}
NEEDED = {
    "window": {"size": (1.0, 0.5), "corner": (0.0, 0.0)}, "shift": {"origin": (0.25, 0.0)},
    "rotate": {"yaw": np.pi / 2}, "rescale": {"resolution": 0.125},
}  # fmt: skip
"""Parameters of stages that cannot do without."""
MAPS = [".", "#", "..#.?.+", ".\n#\n?\n.", "....\n....\n....", "####\n####", "???\n???",
        "...#\n...."]  # fmt: skip
pytestmark = pytest.mark.usefixtures("mapdeal_warnings")


def applied(stage, grid):
    model = {"model": stage.model} if stage.model else {}
    step = make_step(stage.name, {**model, **NEEDED.get(stage.name, {})})
    return grid_of(step.result_of(grid, None))


@pytest.mark.parametrize("stage", STAGES.values(), ids=STAGES)
@pytest.mark.parametrize("drawing", MAPS)
def test_input_is_untouched_output_frozen_and_the_same_again(stage, drawing):
    occupancy = cells(drawing)
    before = occupancy.copy()
    grid = OccupancyGrid(occupancy, 0.25, (1.5, -2.0, 0.4))
    nothing = {"active": (-1,), "reach": (-1, 100)}.get(stage.name, ())  # to work on
    if np.isin(occupancy, nothing).all():
        with pytest.raises(MalformedInputError):
            applied(stage, grid)
        return
    first, second = applied(stage, grid), applied(stage, grid)
    assert np.array_equal(occupancy, before)
    assert first.resolution == (0.125 if stage.name == "rescale" else 0.25)
    for name in first.layer_names:
        assert not getattr(first, name).flags.writeable
        assert np.array_equal(getattr(first, name), getattr(second, name))
    if stage.name != "active" and not stage.moves:
        assert (first.shape, first.origin) == (grid.shape, grid.origin)


@pytest.mark.parametrize("stage", STAGES.values(), ids=STAGES)
def test_a_bare_array_is_refused_with_what_to_pass_and_a_view_where_fields_are_meant(stage):
    with pytest.raises(ParameterError, match="OccupancyGrid"):
        applied(stage, np.zeros((2, 3), np.int8))
    if mapdeal.DistanceField in stage.takes and mapdeal.FieldView not in stage.takes:
        with pytest.raises(ParameterError, match="view of a distance field"):
            stage.function(mapdeal.field_view(mapdeal.esdf(OccupancyGrid([[100, 0, 0]], 0.25))))


@pytest.mark.parametrize("stage", [s for s in STAGES.values() if not s.edits], ids=lambda s: s.name)
def test_grids_that_a_stage_does_not_take_are_refused(stage):
    grid = OccupancyGrid([[100, 0, 0]], 0.25)
    field = mapdeal.esdf(grid)
    grids = [field, mapdeal.ring_cost(grid), mapdeal.potential(grid), mapdeal.reach(grid), 5]
    for refused in (source for source in grids if not isinstance(source, stage.takes)):
        with pytest.raises(ParameterError, match=f"takes a grid: .*got '{type(refused).__name__}'"):
            stage.function(refused)


def test_every_stage_of_the_folder_is_listed():
    declared = re.compile(r"^@(command\.)?(stage|cost_model)\(", re.MULTILINE)
    paths = Path(catalogue.__file__).parent.glob("*.py")
    in_folder = {path.stem for path in paths if declared.search(path.read_text())}
    assert in_folder == {stage.function.__module__.rpartition(".")[2] for stage in catalogue.STAGES}


@pytest.mark.parametrize("stage", [stage for stage in catalogue.STAGES if stage.edits],
                         ids=lambda stage: stage.name)  # fmt: skip
def test_what_a_stage_needs_is_named_and_described_as_it_is_read(stage):
    step = make_step(stage.name, NEEDED.get(stage.name, {}))
    ((name, values),) = step.described().items()
    assert make_step(name, json.loads(json.dumps(values))) == step
    if stage.name in NEEDED:
        with pytest.raises(ParameterError, match=rf"{name}\.[\w, ]+: .*required"):
            make_step(name, {})


def test_only_optional_parameters_accept_none():
    parameters = parameters_of(mapdeal.potential)
    for text, value in (("1.5,-2", (1.5, -2.0)), ("none", None), (None, None)):
        assert parameters["goal"].accept(text) == value
    with pytest.raises(ParameterError, match="repulsive_cap"):
        parameters["repulsive_cap"].accept("none")


ROW = grid_from_text("#...", 0.25)
PILLAR = grid_from_text(".#.\n.#.", 0.25, (0.0, 0.0, 0.0))
LONG = OccupancyGrid([[100] + [0] * 19], 0.1)
FIELD, VIEW = esdf(ROW), field_view(esdf(ROW), view_range=1.0)
ROBOT = mapdeal.Footprint.parse("[[0.3,0.2],[-0.3,0.2],[-0.3,-0.2],[0.3,-0.2]]")
KNOWN = grid_from_text("?????\n?#..?\n?..#?\n?????", 0.3, (1.5, -2.0, 0.7))
PART = mapdeal.window(FIELD, corner_xy=ROW.frame.window(0, 3, 1, 1).origin[:2], size_xy=(0.5, 0.5))


def layers(*some):
    return {"model": "layers", "layers": list(some)}


REFUSED = {
    "inflate": [("radius", {"radius": value}) for value in (-0.1, math.inf, "wide", True, None)],
    "esdf": [(name, {name: value}) for name, value in [
        ("unknown", "lethal"), ("max_distance", 0), ("strength", -1), ("lethal_threshold", 50.5),
    ]],
    "clean": [("clean: takes a map with free", {"grid": value}) for value in (FIELD, VIEW)],
    "exponential_cost": [
        ("float32_resolution: cannot be no with lookup nav2",
         {"lookup": "nav2", "float32_resolution": False}),
        ("max_distance", {"grid": esdf(LONG, max_distance=0.5), "inflation_radius": 0.55}),
        ("lethal_threshold", {"grid": esdf(ROW, lethal_threshold=50), "lethal_threshold": 100}),
    ],
    "ring_cost": [("values", {"values": value}) for value in ((), (101,), ("a",), 5, "90,x")],
    "threshold_cost": [
        ("down", {"down": 60, "up": 50}),
        (r"down_distance.*up_distance", {"down_distance": 0.4, "up_distance": 0.5}),
        (r"down_distance: the view is 90 there, above up \(54\)", {"down_distance": 0.2}),
        (r"up_distance: the view is 25 there, below down \(45\)", {"up_distance": 1.5}),
        ("down", {"down": 11, "up_distance": 1.8}),  # where the view is 10
        ("down_distance.*view_range", {"down": 0, "down_distance": 2.5}),
        ("up_distance.*view_range", {"down": 0, "up_distance": 2.5}),
        ("lethal_threshold", {"grid": VIEW, "view_range": 1.0, "lethal_threshold": 50}),
        ("the per-map view still falls",
         {"grid": esdf(OccupancyGrid([[100] * 9 + [0]], 0.25), max_distance=0.5),
          "view": "per-map"}),
    ],
    "potential": [
        ("made with 50", {"grid": esdf(ROW, lethal_threshold=50), "lethal_threshold": 60}),
        *[("goal", {"grid": PILLAR, "goal": value}) for value in ((0.3, 0.1), (0.26, 0.01))],
        *[("goal", {"goal": value}) for value in ((1.0,), (1.0, 2.0, 3.0), "1", (1e13, 0.0))],
    ],
    "reach": [("start: lies outside of the map", {"start": (99.0, 0.0)}),
              ("x,y or x,y,yaw", {"start": (1.0,)}), ("between 4 and 255", {"headings": 256})],
    "rescale": [*[("resolution", {"resolution": value}) for value in (math.nan, 0)],
                (r"resolution: .*1000000000 cells", {"grid": KNOWN, "resolution": 1e-5})],
    "shift_origin": [(None, {"origin_xy": (math.nan, 2.0)}),
                     ("-1 to 100", {"origin_xy": (1.5, -2.0), "default": 101})],
    "window": [
        ("corner", {"size_xy": (1.0, 1.0)}),
        *[("no cell of it has a distance",
           {"grid": value, "corner_xy": (30.0, 1.5), "size_xy": (0.5, 0.5)})
          for value in (FIELD, PART)],
        ("takes none",
         {"grid": FIELD, "corner_xy": (1.5, -2.0), "size_xy": (0.5, 0.5), "default": 0}),
        (None, {"corner_xy": (1.0, 2.0), "size_xy": (1e11, 1e11)}),
    ],
    "cost_curve": [
        ("^cost layers: no cost depends on the distance", {"grid": 0.05, **layers("inflation")}),
        ("^view: per-map is scaled by the extremes of a map",
         {"grid": 0.05, "model": "threshold", "view": "per-map"}),
        ("^cells: must be a grid", {"grid": "map.yaml"}),
        (r"cost\.values", {"grid": 0.05, "values": (1,)}),
        ("^footprint: cannot be given together with inscr",
         {"grid": 0.05, "footprint": ROBOT, "inscribed_radius": 0.2}),
        ("^footprint: costs of this model do not depend",
         {"grid": 0.05, "footprint": ROBOT, "model": "rings"}),
    ],
}  # fmt: skip


@pytest.mark.parametrize(
    ("function", "words", "options"),
    [(name, *row) for name, rows in REFUSED.items() for row in rows],
    ids=lambda value: str(value)[:40],
)
def test_options_that_cannot_be_are_refused(function, words, options):
    options = dict(options)
    grid = options.pop("grid", ROW)
    with pytest.raises(ParameterError, match=words):
        getattr(mapdeal, function)(grid, **options)


@pytest.mark.parametrize(("place", "size"), [
    *[({"corner_xy": (1.0, 2.0)}, size)
      for size in ((0.0, 1.0), (1.0, -1.0), (math.nan, 1.0), (1e300, 1.0), 3.0)],
    *[({"corner_xy": corner}, (1.0, 1.0)) for corner in ((math.inf, 2.0), (1.0,), ("a", 2.0))],
    *[(place, (1.0, 1.0)) for place in
      ({"center_xy": (1e300, 2.0)}, {}, {"corner_xy": (1.0, 2.0), "center_xy": (1.0, 2.0)})],
], ids=str)  # fmt: skip
@pytest.mark.parametrize("function", [mapdeal.window, mapdeal.reset_region])
def test_regions_that_cannot_be_are_refused(function, place, size):
    with pytest.raises(ParameterError):
        function(ROW, size_xy=size, **place)


def test_thresholds_in_metres_may_lie_farther_than_the_default_range():
    for name in ("down_distance", "up_distance"):
        mapdeal.threshold_cost(ROW, down=0, **{name: 2.5}, view="per-map")
        mapdeal.threshold_cost(ROW, down=0, **{name: 2.5}, view_range=2.5)


def test_a_turn_into_too_many_cells_is_refused(monkeypatch):
    monkeypatch.setattr("mapdeal.grid.frame.MOST_CELLS", 6)
    with pytest.raises(ParameterError, match=r"yaw: .*6 cells"):
        mapdeal.rotate(ROW, 0.7)


def test_a_potential_holds_finite_repulsion():
    for repulsive in (np.nan, -1.0, np.inf):
        with pytest.raises(ParameterError, match="repulsive"):
            mapdeal.PotentialField([[repulsive]], np.zeros((1, 1), np.int8), 0.5)
    with pytest.raises(ParameterError, match="attractive_gain"):
        mapdeal.PotentialField([[1.0]], np.zeros((1, 1), np.int8), 0.5, attractive_gain=-1e-9)


@pytest.mark.parametrize(("message", "parameters"), [
    (r"cost\.float32_resolution", {"lookup": "nav2", "float32_resolution": "no"}),
    ("cost.layers: must be a list of layers such as", {"model": "layers", "layers": "static"}),
    (r"cost.layers 1: must look like one of \[\{static", layers(3)),
    ("cost.layers 1: must look like one of", layers({"static": {}, "inflation": {}})),
    ("cost.layers 1: must look like", layers({"static": 3})),
    ("cost.layers 2: no such kind of layer, got 'inflate'", layers("static", "inflate")),
    ("cost.layers 1 static: no such parameter, got 'trinary'",
     layers({"static": {"trinary": True}})),
    ("cost.layers 1 inflation.inflation_radius: must be a finite number, at least 0, got -1",
     layers({"inflation": {"inflation_radius": -1}})),
    ("cost.layers 1 static.lethal_cost_threshold: must be a whole number, between 0 and 100",
     layers({"static": {"lethal_cost_threshold": 101}})),
    ("must be a whole number, a byte", layers({"static": {"unknown_cost_value": 256}})),
    ("cost.layers 1 static.name: must be a word", layers({"static": {"name": ""}})),
    ("must be one of exact, nav2", layers({"inflation": {"lookup": "older"}})),
])  # fmt: skip
def test_steps_of_costs_are_refused_with_their_place(message, parameters):
    with pytest.raises(ParameterError, match=message):
        make_step("cost", parameters)


@pytest.mark.parametrize(("name", "text", "message"), [
    ("cost.layers", "[{static: {use_maximum: yes, use_maximum: no}}]", "key appears twice"),
    ("cost.layers", "[{inflation: {inflation_radius: 010}}]", "must be a decimal number"),
    ("cost.layers", "[" * 30, "nested deeper"), ("cost.layers", "[{static: ", "not valid YAML"),
    ("reach.goals", "{kitchen: [7.1, 3.2}", None),
    ("reach.goals", "{kitchen: [7.1]}", "kitchen: must be (a list of )?2 numbers"),
    ("reach.goals", "{a: [1, 2], a: [3, 4]}", "appears twice"),
])  # fmt: skip
def test_settings_are_read_as_recipes_are(tmp_path, name, text, message):
    path = tmp_path / "r.yaml"
    path.write_text("stages:\n  - reach:\n  - cost: {model: layers}\n")
    with pytest.raises(ParameterError, match=message) as caught:
        load_recipe(str(path), changes=[f"{name}={text}"])
    assert str(caught.value).startswith(f"--set: {name}")


@pytest.mark.parametrize(("value", "message"), [
    (7.1, r"^goals: must look like {kitchen: \[7.1, 3.2\], ...} or"),
    (None, "must look like"),
    ({"kitchen": [7.1]}, "goals kitchen: must be (a list of )?2 numbers"),
    ([7.1, 3.2, 0.0], "goals 1: must be (a list of )?2 numbers"),
    ([[7.1, 3.2], [1, "x"]], "goals 2: must be a finite number, got 'x'"),
    ([[7.1, math.inf]], "goals 1: must be a finite number"),
    ([{"kitchen": [7.1, 3.2], "hall": [1, 2]}], "goals 1: must be a place, or one name"),
    ({"kitchen": {"x": 1, "y": 2}}, "goals kitchen: must be a list of numbers"),
    *[({name: [7.1, 3.2]}, "name must be text") for name in ("", "a\nb", True)],
    ([{"hall": [1, 2]}, {"hall": [3, 4]}], "two goals have this name, got 'hall'"),
    ({1: [1, 2], "1": [3, 4]}, "two goals have this name"),
    ("kitchen", "goals 1: must be a finite number"),
    ("1,2,3", "goals 1: must be (a list of )?2 numbers"),
])  # fmt: skip
def test_what_is_no_goal_is_refused_by_its_number_or_name(value, message):
    with pytest.raises(ParameterError, match=message):
        accept_goals("goals", value)
