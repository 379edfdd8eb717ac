"""How public types show themselves: one line of text, whatever they hold."""

import inspect
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from tempfile import NamedTemporaryFile

import numpy as np
import pytest

import mapdeal
from drawn import grid_from_text
from mapdeal.grid.canvas import on_canvas
from mapdeal.grid.values import decimal_text
from mapdeal.kernels.blocks import lazy_layer
from mapdeal.layers.inflation import InflationLayer
from mapdeal.layers.static import StaticLayer
from mapdeal.ros.robot import ListedLayer

GRID = grid_from_text("?..#.\n..+#.\n.....")
EXAMPLES = Path(__file__).parents[2] / "examples"
START = "start (2, -1.5), Footprint(circle, radius 0.2 m)"
RADII = "inscribed_radius 0.2 m, circumscribed_radius 0.2 m"
PLACE = "5 x 3 cells, 0.25 m, origin (1.5, -2, 0.4)"


def reach(map_, goal, passage):
    is_open = np.arange(15).reshape(3, 5) % 3 > 0
    return mapdeal.Reach(
        is_open & (np.arange(5) > 1), is_open, np.ones((3, 5)), np.zeros((3, 5)), map_.occupancy,
        0.25, map_.origin, start=(2.0, -1.5), robot=mapdeal.Footprint.circle(0.2),
        goals=(goal,), passages=(passage,),
    )  # fmt: skip


def shared_maps():
    """Two maps that share three cells, a column apart, and contradict each other on one."""
    first = mapdeal.OccupancyGrid([[100, 0, 0, 0]], 0.25, (1.5, -2.0, 0.0))
    return [first, mapdeal.OccupancyGrid([[0, 100, 0, -1]], 0.25, (1.75, -2.0, 0.0))]


def samples():
    map_, field, robot_shape = GRID, mapdeal.esdf(GRID), mapdeal.Footprint.circle(0.2)
    costmap = mapdeal.exponential_cost(map_, inscribed_radius=0.1, inflation_radius=0.3)
    built = mapdeal.build_map([[0, 0, 0.3]], [0.0, 0.5], [[1.0, 1.2]], resolution=0.25)
    options = mapdeal.LocalOptions(size=(2, 1), resolution=0.5)
    mapper = mapdeal.LocalMapper((0.5, 1, 0.3), options)
    mapper.add(np.zeros((4, 2)))
    start, goal = map_.frame.xy_from_rowcol([[0, 0], [0, 4]])
    finding = mapdeal.Finding("yaml.defaults", "warning", "a.yaml", "negate is missing", 3)
    checked = mapdeal.MapReport("a.yaml", (finding,))
    narrow = mapdeal.Bottleneck(1.5, -2.0, 0.8)
    reached = mapdeal.GoalReach(mapdeal.Goal(2.0, -1.5, "hall"), False, 0, 0.4, narrow)
    passage = mapdeal.Passage(1.5, -2.0, 0.8, 12.25, False, ((1.0, -2.0), (2.0, -2.0)))
    merged, costs = mapdeal.merge(shared_maps()), mapdeal.compare_costmaps(costmap, costmap)
    example = mapdeal.read_robot_parameters(EXAMPLES / "robots" / "nav2_params.yaml")
    hall = mapdeal.OccupancyGrid(np.zeros((60, 80), np.int8), 0.05, (1.5, -2.0, 0.0))
    robots = mapdeal.compare_robots(hall, example, example)
    above = np.array([[0.1 * x, 0.1 * y, 1.0 * (x == 20)] for x in range(21) for y in range(20)])
    inflation = InflationLayer("inflation", 0.2)
    layers = (ListedLayer("static", "costmap_2d::StaticLayer", StaticLayer("static")),
              ListedLayer("inflation", "costmap_2d::InflationLayer", inflation))  # fmt: skip
    return {
        type(value).__name__: value
        for value in [
            map_, field, costmap, mapdeal.field_view(field), mapdeal.potential(map_),
            mapdeal.BitMap.from_occupancy(map_), map_.frame, built, mapper.result(), options,
            mapdeal.Route("astar", False, start, goal), field.query([start, goal]),
            map_.query([start, goal]),
            mapdeal.cloud_map(above, resolution=0.2), mapdeal.CloudOptions(), mapdeal.CloudMapper(),
            mapdeal.ViewScale(), robot_shape, mapdeal.BeamLimits(),
            mapdeal.Polygon([(0, 0), (2, 0), (2, 1)], value=100),
            mapdeal.Line([(0, 0), (2, 0.5)], thickness=0.2), mapdeal.Circle((0.5, 1), 2.0),
            mapdeal.Scans([[0, 0, 0]], [0.0, 0.5], [[1.0, 1.2]]), mapper,
            mapdeal.MapBuilder(map_.frame), mapdeal.RollingMapper([[0, 0, 0]], options, keep=1),
            mapdeal.load_recipe("nav2"), mapdeal.draw_picture(map_), finding, checked,
            costs, costs.changes["closed"], robots,
            mapdeal.diff(map_, map_.with_values(np.zeros_like(map_.occupancy))),
            mapdeal.cost_curve(0.25, inscribed_radius=0.1), mapdeal.align(map_, map_),
            mapdeal.score(map_.as_amcl_sees_it(), minimum={"corners": 0}),
            mapdeal.ScoreBound("coverage", "min", 0.9, None),
            mapdeal.WallShift(1.0, 0.5, 0.25), mapdeal.Bound("max-shift", "m", 0.5, 0.25),
            mapdeal.LintReport((checked,), "1"), mapdeal.StaticLayer(), inflation,
            mapdeal.DenoiseLayer(), mapdeal.KeepoutFilter(), mapdeal.ObstacleLayer(),
            mapdeal.VoxelLayer(), mapdeal.RangeSensorLayer(),
            mapdeal.CostmapArea(60, 80, 0.05, (-2.0, 1.0), global_frame="odom"),
            mapdeal.RunReport(Path("out/a"), "done", {"esdf": field.figures()}, Path("a.yaml")),
            mapdeal.WrittenReport(Path("out/a.html"), 2, 61234),
            mapdeal.Transform(1.0, -2.0, 0.4), merged, merged.maps[1],
            mapdeal.RobotParameters("ros1", "local", "/a/local_costmap", robot_shape, 0.0, 0.2,
                                    True, False, layers, (), 0.2, 0.2),
            narrow, reached, reached.goal, passage, reach(map_, reached, passage),
            mapdeal.clean(grid_from_text("...#.")),
            mapdeal.route(costmap, start=start, goal=goal), *route_graphs(), *plans_and_scans(map_),
        ]
    }  # fmt: skip


def route_graphs():
    nodes = mapdeal.RouteNode(1, 0.5, 1.0), mapdeal.RouteNode(2, 2.0, 1.0)
    edges = (mapdeal.RouteEdge(3, 1, 2),)
    room = mapdeal.OccupancyGrid(np.zeros((8, 30), np.int8), 0.25)
    found = mapdeal.graph(room, footprint=mapdeal.Footprint.circle(0.3))
    return nodes[0], edges[0], mapdeal.RouteGraph(nodes, edges), found


def plans_and_scans(map_):
    map_path = EXAMPLES / "maps" / "office.yaml"
    shared = {"robot": EXAMPLES / "robots" / "nav2_narrow_door.yaml", "no_changes": True}
    report = mapdeal.plan(map_path, start=(3, 0), goals=[(1.5, 0.2)], **shared)
    with NamedTemporaryFile("w+") as file:
        file.write("3,0,0,1.5,0.2,0\n")
        file.flush()
        paired = mapdeal.plan(map_path, pairs=Path(file.name), **shared)
        paired = replace(paired, pairs=list(paired.pairs))
    table = mapdeal.plan([map_path, map_path], start=(3, 0), goals=[(1.5, 0.2)], **shared)
    (place,) = map_.frame.xy_from_rowcol(np.argwhere(map_.occupancy == 0)[:1])
    scans = mapdeal.scan(map_, poses=[[*place, 0.0]])
    return report, report.goals[0], report.goals[0].goal, paired, table, scans


SAMPLES = samples()


def test_every_public_type_has_a_sample():
    types = filter(inspect.isclass, (getattr(mapdeal, name) for name in dir(mapdeal)))
    assert {kind.__name__ for kind in types if not issubclass(kind, Exception)} == set(SAMPLES)


@pytest.mark.parametrize("name", SAMPLES)
def test_a_value_of_a_public_type_is_shown_in_one_line(name):
    text = repr(SAMPLES[name])
    assert name in text
    assert len(text) <= 250
    assert not re.search(r"\n|array\(", text)


@pytest.mark.parametrize(("name", "expected"), [
    ("OccupancyGrid", f"{PLACE}, 1 in 1..99, 2 occupied, 11 free, 1 unknown"),
    ("BitMap", f"{PLACE}, 2 ones"),
    # 10 of 15 cells are open, 6 of them right of the first two columns; a cell has 1/16 m2
    ("Reach", f"{PLACE}, {START}, reaches 0.375 of 0.625 m2, 0 of 1 goal, 1 passage"),
    ("Passage", "0.8 m at (1.5, -2), closed, 12.25 m2 behind it"),
    # The farthest cell is a row and three columns away: sqrt(10) cells.
    ("DistanceField", f"{PLACE}, convention fast-planner, 0 .. 0.790569 m, 2 obstacle cells"),
    # all cells within two cells: two on the left, one on the right, and three below
    ("Costmap",
     f"{PLACE}, scale costmap2d, 2 lethal, 0 inscribed, 9 intermediate, 3 free, 1 unknown"),
    ("FieldView", f"{PLACE}, view metric, 0 at 2 m, 12 in 1..99, 2 occupied, 0 free, 1 unknown"),
    ("Merged", "2 maps, 4 x 1 cells, 1 conflict"),
    ("MapCounts", "3 known, 3 in common, 1 added, 1 conflict, 1 of 1 walls met"),
    ("RobotParameters", f"/a/local_costmap, {RADII}, static, inflation"),
    ("LintReport", "1 map: 0 errors, 1 warning, 0 notes"),
])  # fmt: skip
def test_the_line_describes_the_grid(name, expected):
    assert repr(SAMPLES[name]) == f"{name}({expected})"


def test_a_route_graph_knows_the_places_of_nodes_and_the_lengths_of_edges():
    graph = SAMPLES["RouteGraph"]
    assert (graph.points_xy.tolist(), graph.lengths.tolist()) == ([[0.5, 1], [2, 1]], [1.5])


CLIPPED = mapdeal.esdf(GRID, max_distance=0.3, strength=2.0)
WIDE = on_canvas(mapdeal.esdf(GRID), GRID.frame.window(-2, -1, 9, 8))
FREE = mapdeal.esdf(grid_from_text("..."))
FULL = mapdeal.esdf(grid_from_text("###"))
ROW = mapdeal.esdf(mapdeal.OccupancyGrid([[100, 0, 0, 0]], resolution=0.5))


@pytest.mark.parametrize(("value", "expected"), [
    (FREE, r"DistanceField\(3 x 1 .* convention fast-planner, no obstacle\)"),
    (FULL, r"DistanceField\(.*convention fast-planner, nothing but obstacles\)"),
    (CLIPPED, r".*, strength 2, max_distance 0\.3 m, .*"),
    (WIDE, r"DistanceField\(8 x 9 cells, .*0 \.\. 0\.790569 m, 2 obstacle cells\)"),
    (ROW.query([1, 0.25]), r"FieldSamples\(1 point, 1 inside, .* 0\.75 m, gradient \(1, 0\)\)"),
    (ROW.query([[9, 9]]), r"FieldSamples\(1 point, 0 inside\)"),
    (ROW.query([[1.0, 0.25], [1.25, 0.25], [9, 9]]),
     r"FieldSamples\(3 points, 2 inside, distance 0\.75 \.\. 1 m\)"),
], ids=["free", "full", "clipped", "part", "sample", "outside", "samples"])  # fmt: skip
def test_fields_and_their_samples_say_what_is_special_about_them(value, expected):
    assert re.fullmatch(expected, repr(value))


def test_layers_that_are_made_block_by_block_are_left_alone():
    def make(rows):
        raise AssertionError("a repr asked for rows")

    for height, width in ((30_000, 20_000), (3, 2)):
        layer = lazy_layer((height, width), np.int8, make, block_height=100)
        lazy = mapdeal.OccupancyGrid(layer, 0.05)
        assert repr(lazy) == f"OccupancyGrid({width} x {height} cells, 0.05 m, origin (0, 0, 0))"
        assert lazy._repr_png_() is None


def test_importing_the_package_loads_nothing_of_it_and_pictures_no_scipy():
    code = (
        "import sys, mapdeal; print([m for m in sys.modules if m.startswith('mapdeal.')]);"
        "g = mapdeal.OccupancyGrid([[0, 100, -1]], 0.5); repr(g);"
        "assert g._repr_png_()[:4] == b'\\x89PNG';"
        "print([m for m in sys.modules if m in ('scipy', 'typer', 'multiprocessing')])"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.split() == ["['mapdeal.version']", "[]"]


@pytest.mark.parametrize(("number", "text"), [
    (275_812.4, "275,800"), (9999.6, "10,000"), (1234.5, "1,234"), (29.354, "29.35"),
    (0.00001234, "0.00001234"), (100.0, "100"), (0.0, "0"), (float("inf"), "inf"),
])  # fmt: skip
def test_areas_in_texts_have_four_digits_and_no_exponent(number, text):
    assert decimal_text(number) == text
    assert float(text.replace(",", "")) == pytest.approx(number, rel=5e-4)
