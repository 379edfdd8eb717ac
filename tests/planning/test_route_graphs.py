"""Route graphs, against floods, sweeps and searches of the tests' own."""

import math
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy import ndimage
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra

import mapdeal
from drawn import grid_from_text
from mapdeal import Costmap, Footprint, Goal, OccupancyGrid, footprint_costs, reach, route
from mapdeal.errors import MalformedInputError
from mapdeal.grid.route_graph import RouteEdge, RouteGraph, RouteNode
from mapdeal.maps.route_graphs import graph_text
from mapdeal.planning import route_graphs
from mapdeal.planning.graph_drafts import GraphOptions, band_around_unknown, lattices_in
from mapdeal.planning.route_graphs import AREA_PER_NODE, MOST_EDGES, route_graph_of
from mapdeal.planning.routes import Terrain, route_on_graph
from oracles import lengths_from
from strategies import examples


@st.composite
def rooms(draw):
    """Maps with walls, doors, specks and unknown corners, of some metres."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    height, width = draw(st.integers(20, 50)), draw(st.integers(20, 50))
    cells = np.zeros((height, width), dtype=np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = 100
    for _ in range(draw(st.integers(0, 5))):
        row, col, length = (int(rng.integers(1, size)) for size in (height, width, 40))
        if rng.random() < 0.5:
            cells[row, col : col + length] = 100
        else:
            cells[row : row + length, col] = 100
    cells[rng.random(cells.shape) < draw(st.sampled_from([0.0, 0.003, 0.02]))] = 100
    if draw(st.booleans()):
        cells[: height // 4, : width // 4] = -1
    return OccupancyGrid(cells, 0.1, (1.5, -2.0, draw(st.sampled_from([0.0, 0.4]))))


def parts_of(graph):
    count, ends = len(graph.nodes), graph.ends
    links = csr_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(count, count))
    return connected_components(links, connection="strong")[0]


def samples(graph, resolution):
    """Poses along each edge at half a cell or less, looking ahead, and the edge of each."""
    for start, end in graph.ends.tolist():
        a, b = graph.points_xy[[start, end]]
        count = math.ceil(math.dist(a, b) / (resolution / 2)) + 1
        yaw = math.atan2(*(b - a)[::-1])
        yield np.column_stack([np.linspace(a, b, count), np.full(count, yaw)])


def check_graph(grid, robot, graph, cover):
    """Check what holds for each graph, by nothing but the map, the robot and the rules."""
    occupancy = grid.occupancy
    blocked = np.pad(occupancy == 100, 1, constant_values=True)
    distance = ndimage.distance_transform_edt(~blocked)[1:-1, 1:-1]
    is_open = (occupancy != 100) & (occupancy != -1)
    is_open &= distance > robot.inscribed_radius / grid.resolution + 1e-9
    cells = grid.frame.unbounded_rowcol_from_xy(graph.points_xy)
    assert all(is_open[row, col] for row, col in cells.tolist())
    assert parts_of(graph) == 1
    ids = [feature.id for feature in (*graph.nodes, *graph.edges)]
    assert sorted(ids) == list(range(1, len(ids) + 1))
    assert np.bincount(graph.ends[:, 0], minlength=1).max() <= MOST_EDGES
    plain = Costmap(np.choose((occupancy == 100) + 2 * (occupancy == -1), [0, 254, 255])
                    .astype(np.uint8), grid.resolution, grid.origin)  # fmt: skip
    for edge, poses in zip(graph.edges, samples(graph, grid.resolution), strict=True):
        passed = grid.frame.unbounded_rowcol_from_xy(poses[:, :2])
        assert is_open[passed[:, 0], passed[:, 1]].all()
        if robot.vertices:
            assert (footprint_costs(plain, robot, poses) == 0).all()
        assert edge.metadata["length"] == pytest.approx(math.dist(*poses[[0, -1], :2]), abs=2e-3)
    if robot.vertices:
        return
    reached = lengths_from(is_open, [tuple(cells[0].tolist())])
    limit = cover / grid.resolution
    covered = lengths_from(is_open, list(map(tuple, cells.tolist())), limit)
    assert reached.keys() <= covered.keys()


BOX = Footprint.polygon([[0.3, 0.15], [0.3, -0.15], [-0.2, -0.15], [-0.2, 0.15]])
POINT = Footprint.circle(1e-3)
ROUND = st.sampled_from([0.15, 0.24, 0.4]).map(Footprint.circle)


@given(rooms(), ROUND | st.just(BOX), st.sampled_from([None, "right"]))
def test_graphs_keep_all_promises(grid, robot, one_way):
    try:
        found = reach(grid, footprint=robot)
    except MalformedInputError:
        return  # the robot stands nowhere
    result = route_graph_of(found, GraphOptions(spacing=1.5, hall=3.0, cover=2.0, one_way=one_way))
    check_graph(grid, robot, result.graph, 2.0)
    if robot is not BOX:
        assert result.parts == 1
        assert result.covered == pytest.approx(result.reachable)


def least_distances(grid, graph, value):
    """The distance of each way to the squares of cells of a value, by points on it, metres."""
    squares = np.argwhere(grid.occupancy == value)
    for start, end in sorted({tuple(sorted(ends)) for ends in graph.ends.tolist()}):
        ends = grid.frame.continuous_rowcol_from_xy(graph.points_xy[[start, end]])
        points = np.linspace(*ends, math.ceil(9 * math.dist(*ends)) + 2)[:, np.newaxis]
        gaps = np.maximum(np.maximum(squares - points, points - squares - 1), 0)
        yield float(np.hypot(gaps[..., 0], gaps[..., 1]).min(initial=math.inf)) * grid.resolution


@examples(20)
@given(rooms(), st.sampled_from([0.15, 0.24, 0.4]))
def test_ways_that_touch_obstacles_or_unknown_cells_are_counted_and_kept_away(grid, radius):
    robot = Footprint.circle(radius)
    for keep in (None, radius):
        mask = None if keep is None else band_around_unknown(grid, keep)
        try:
            reached = reach(grid, footprint=robot, mask=mask)
        except MalformedInputError:
            return  # the robot stands nowhere
        found = route_graph_of(reached, GraphOptions(spacing=1.5, hall=3.0, cover=2.0))
        touching, near = (np.array([*least_distances(grid, found.graph, k)]) for k in (100, -1))
        assert (touching < radius - 1e-5).sum() <= found.tight
        assert (near < radius - 1e-5).sum() <= found.near_unknown <= (near < radius + 1e-3).sum()
        assert keep is None or not found.near_unknown


def cluttered(size, share, seed):
    cells = np.zeros((size, size), dtype=np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = 100
    cells[np.random.default_rng(seed).random(cells.shape) < share] = 100
    return OccupancyGrid(cells, 0.1, (1.5, -2.0, 0.4))


@pytest.mark.parametrize("one_way", [None, "right"])
def test_nothing_leads_where_a_robot_gets_only_sideways(one_way):
    grid = cluttered(30, 0.03, 4)
    found = reach(grid, footprint=BOX)
    result = route_graph_of(found, GraphOptions(spacing=1.5, hall=3.0, cover=2.0, one_way=one_way))
    assert result.covered < result.reachable
    check_graph(grid, BOX, result.graph, 2.0)


def test_lengths_may_be_longer_than_any_way():
    grid, robot = cluttered(30, 0.03, 4), Footprint.circle(0.15)
    for longest in (1e6, 1e308):
        options = GraphOptions(longest, longest, longest)
        result = route_graph_of(reach(grid, footprint=robot), options)
        check_graph(grid, robot, result.graph, math.inf)


def test_goals_at_the_edges_of_cells_lie_in_the_cells_that_the_frame_says():
    grid = grid_from_text("....#\n.#...\n.....", origin=(-0.5, -0.5, -math.pi / 2))
    for corner in np.ndindex(3, 5):
        ((x, y),) = grid.frame.xy_from_continuous_rowcol([corner]).tolist()
        found = reach(grid, footprint=POINT, goals=[Goal(x, y, "goal")])
        if found.goals[0].reachable:
            result = route_graph_of(found, GraphOptions(1.0, 4.0, 1.0))
            (goal,) = (node for node in result.graph.nodes if node.metadata["kind"] == "goal")
            (cell,) = grid.frame.unbounded_rowcol_from_xy([[goal.x, goal.y]]).tolist()
            assert grid.occupancy[tuple(cell)] == 0


def test_no_node_is_left_on_the_corner_of_an_obstacle():
    grid = grid_from_text("""\
..#.......
..........
..........
.......#..
..........
..........
..........
..........
....#..#..
##..#.....""", 1.0, (0.0, 0.0, 0.0))  # fmt: skip
    check_graph(grid, POINT, route_graph_of(reach(grid), GraphOptions(4.04, 8.0, 8.0)).graph, 8.0)


def test_lanes_go_with_the_parts_that_are_dropped():
    grid = grid_from_text("""\
................
.......#........
...#...........#
..............#.
.....#..........
................
................
............#...
...............#
................
................""", 1.0, (0.0, 0.0, 0.0))  # fmt: skip
    robot = Footprint.polygon([[0.5, 0.25], [0.5, -0.25], [-0.5, -0.25], [-0.5, 0.25]])
    found = reach(grid, footprint=robot)
    result = route_graph_of(found, GraphOptions(8.0, 4.0, 8.0, one_way="right"))
    check_graph(grid, robot, result.graph, 8.0)


def test_crowded_places_have_few_nodes():
    grid, robot = cluttered(80, 0.01, 1), Footprint.circle(0.15)
    result = route_graph_of(reach(grid, footprint=robot), GraphOptions())
    assert result.reachable / len(result.graph.nodes) >= AREA_PER_NODE
    check_graph(grid, robot, result.graph, 3.0)


def test_what_the_footprint_hits_is_gone_before_nodes_are_taken_out():
    grid = cluttered(120, 0.015, 2)
    result = route_graph_of(reach(grid, footprint=BOX), GraphOptions())
    assert result.covered > 0.99 * result.reachable  # 55 % the other way round
    check_graph(grid, BOX, result.graph, 3.0)


TWO_ROOMS = """
    ##############################
    #.............##.............#
    #.............##.............#
    #.............##.............#
    #............................#
    #............................#
    #.............##.............#
    #.............##.............#
    #.............##.............#
    ##############################
"""


def graph_of(text, radius=0.2, resolution=0.25, goals=(), **options):
    found = reach(grid_from_text(text, resolution), radius=radius, goals=goals)
    return route_graph_of(found, GraphOptions(**options)).graph


@pytest.mark.parametrize(("resolution", "kind"), [(0.4, "door"), (0.25, "narrow")])
def test_a_door_has_a_node_in_its_middle_with_its_width_and_a_goal_has_its_own(resolution, kind):
    frame = grid_from_text(TWO_ROOMS, resolution).frame
    x, y = frame.xy_from_rowcol([(2, 3)])[0].tolist()
    graph = graph_of(TWO_ROOMS, resolution=resolution, hall=9.0, goals=(Goal(x, y, "dock"),))
    (node,) = [node for node in graph.nodes if node.metadata["kind"] == "goal"]
    assert node.metadata["name"] == "dock"
    assert math.dist((node.x, node.y), (x, y)) < 1e-3
    assert any(node.id == edge.start for edge in graph.edges)
    (door,) = [node for node in graph.nodes if node.metadata["kind"] == kind]
    assert door.metadata["width"] == 2 * resolution
    assert math.dist(frame.xy_from_continuous_rowcol([[5, 15]])[0], (door.x, door.y)) < 0.3
    edges = [edge for edge in graph.edges if door.id in (edge.start, edge.end)]
    assert {edge.metadata.get("door_width") for edge in edges} == {2 * resolution}


def test_a_bottleneck_that_is_little_narrower_than_its_corridor_is_no_door():
    side, walls = "." * 14, "#" * 32
    rows = [f"#{side}##{side}#", *[f"#{side}..{side}#"] * 4, f"#{side}##{side}#"]
    graph = graph_of("\n".join([walls, *rows, walls]), resolution=0.3, hall=9.0)
    assert {node.metadata["kind"] for node in graph.nodes} & {"door", "narrow"} == {"narrow"}


def drawn_in(height, width, *boxes):
    """Return a room with walls, and boxes of it that are occupied: rows and columns."""
    cells = np.pad(np.zeros((height, width), dtype=np.int8), 1, constant_values=100)
    for top, bottom, left, right in boxes:
        cells[top:bottom, left:right] = 100
    return OccupancyGrid(cells, 0.1, (1.5, -2.0, 0.4))


@pytest.mark.parametrize(("boxes", "kinds"), [
    ([(0, 30, 40, 42), (50, 90, 40, 42)], {"door"}),  # 2 m wide, of one wall
    ([(0, 30, 40, 42), (40, 52, 40, 42), (60, 90, 40, 42)], {"door"}),  # 1.2 m apart
    ([(36, 46, 10, 22)], {"narrow"}),  # a cupboard 0.9 m from a wall
    ([(10, 25, 40, 55), (33, 48, 40, 55)], {"narrow"}),  # two tables
    ([(0, 90, 0, 28), (0, 90, 44, 82), (40, 44, 28, 35)], {"narrow"}),  # a shelf in a corridor
    ([(0, 27, 0, 82), (63, 92, 0, 82), (0, 38, 40, 42), (52, 92, 40, 42)], {"narrow"}),  # wide
])  # fmt: skip
def test_doors_are_gaps_of_walls_between_wider_spaces(boxes, kinds):
    grid = drawn_in(90, 80, *boxes)
    graph = route_graph_of(reach(grid, radius=0.2), GraphOptions(hall=20.0)).graph
    assert {node.metadata["kind"] for node in graph.nodes} & {"door", "narrow"} == kinds


def test_doors_of_a_real_floor_are_those_that_a_person_counts(real_maps):
    grid = mapdeal.read_map(real_maps / "align/PRBonn__tmcl/Faro/FMap.yaml")
    cols = [28, 100, 107, 116, 146, 174, 181, 270, 346, 422, 490]
    rows = [116, 142, 202, 116, 164, 210, 118, 120, 168, 170, 116]
    by_eye = grid.frame.xy_from_rowcol(np.column_stack([rows, cols]))
    nodes = route_graph_of(reach(grid, radius=0.2), GraphOptions()).graph.nodes
    doors = np.array([(node.x, node.y) for node in nodes if node.metadata["kind"] == "door"])
    apart = np.hypot(*(doors[:, np.newaxis] - by_eye).T).min(axis=0)
    assert len(doors) == 11
    assert apart.max() < 0.5


def test_a_crowded_graph_keeps_its_doors():
    cols = [*range(5, 28, 5), *range(54, 80, 5)]
    legs = [(k, k + 2, m, m + 2) for k in range(5, 40, 5) for m in cols]
    grid = drawn_in(40, 80, (0, 15, 40, 42), (25, 42, 40, 42), *legs)
    graph = route_graph_of(reach(grid, radius=0.12), GraphOptions(hall=20.0)).graph
    assert [node.metadata["kind"] for node in graph.nodes].count("door") == 1


def test_a_corridor_has_its_nodes_in_the_middle_at_the_spacing():
    text = "\n".join(["#" * 80, *["#" + "." * 78 + "#"] * 5, "#" * 80])
    graph = graph_of(text)
    places = grid_from_text(text).frame.continuous_rowcol_from_xy(graph.points_xy)
    assert set(places[:, 0].round(2)) == {3.5}
    assert (np.diff(np.sort(places[:, 1])) * 0.25).max() <= 2.5
    assert len(graph.edges) == 2 * (len(graph.nodes) - 1)


def test_a_hall_has_a_lattice_and_no_single_line():
    text = "\n".join(["." * 60] * 40)
    graph = graph_of(text)
    assert {node.metadata["kind"] for node in graph.nodes} == {"hall"}
    rows = grid_from_text(text).frame.continuous_rowcol_from_xy(graph.points_xy)
    assert len(set(rows[:, 0].round(2))) == 5
    assert 15.0 * 10.0 / len(graph.nodes) > AREA_PER_NODE
    assert np.bincount(graph.ends[:, 0]).max() == 8


@pytest.mark.parametrize(("width", "expected"), [(3, [1.5]), (6, [1.5, 4.5]), (9, [1, 4, 7])])
def test_narrow_parts_of_a_hall_are_divided_evenly_and_wide_ones_have_its_lattice(width, expected):
    def is_usable(points):
        row, col = points.T
        in_hall = (row > 0) & (row < 20) & (col > 0) & (col < 20)
        return in_hall | (row > 0) & (row < width) & (col >= 20) & (col < 40)

    cells = np.argwhere(np.ones((40, 40))) + 0.5
    cells = cells[is_usable(cells)]
    places, _ = lattices_in(cells, np.zeros(len(cells), int), 0.0, 3.0, 0.5, is_usable)
    assert sorted({row for row, col in places if col < 18}) == [1, 4, 7, 10, 13, 16, 19]
    assert sorted({row for row, col in places if col > 22}) == expected


def test_a_corridor_joins_places_of_a_hall_on_both_sides_of_its_mouth():
    corridor, side = "#" + "." * 100 + "#", "#" * 60 + "." * 41 + "#"
    text = "\n".join(["#" * 102, *[side] * 12, *[corridor] * 6, *[side] * 22, "#" * 102])
    graph = graph_of(text)
    places = grid_from_text(text).frame.continuous_rowcol_from_xy(graph.points_xy).round(1).tolist()
    kinds = [node.metadata["kind"] for node in graph.nodes]
    assert sorted(kind for kind in kinds if kind != "hall") == ["end", *["way"] * 7]
    joined = [(places[a], places[b]) for a, b in graph.ends.tolist()
              if (kinds[a], kinds[b]) == ("way", "hall")]  # fmt: skip
    assert sorted(joined) == [([25.5, 60.5], [21.0, 64.0]), ([25.5, 60.5], [29.0, 64.0])]


def test_lanes_are_on_the_right_and_lead_both_ways():
    text = "\n".join(["#" * 120, *["#" + "." * 118 + "#"] * 11, "#" * 120])
    graph = graph_of(text, hall=9.0, one_way="right")
    both = set(map(tuple, graph.ends.tolist()))
    alone = [ends for ends in both if ends[::-1] not in both]
    assert len(graph.nodes) == 2 * len(graph_of(text, hall=9.0).nodes) - 2  # but its two ends
    rows = grid_from_text(text).frame.continuous_rowcol_from_xy(graph.points_xy)
    assert set(rows[:, 0].round(2)) == {3.5, 6.5, 9.5}  # half way to the cells of both walls
    for start, end in alone:
        (row, col), (other_row, other_col) = rows[[start, end]]
        if abs(other_row - row) < 1e-2:  # within a lane; eastwards it lies in the south
            assert (other_col > col) == (row < 6.5)
    assert parts_of(graph) == 1


def test_speed_limits_stand_on_all_edges_and_fall_with_the_room():
    graph = graph_of(TWO_ROOMS, hall=9.0, slow_below=0.6)
    limits = [edge.metadata["speed_limit"] for edge in graph.edges]
    assert all(type(limit) is float for limit in limits)
    assert min(limits) < max(limits) == 100.0
    for edge in graph.edges:
        share = edge.metadata["min_clearance"] / 0.6
        assert edge.metadata["speed_limit"] == pytest.approx(min(100, 100 * share), abs=0.2)


@given(st.integers(0, 2**32 - 1), st.integers(2, 12))
def test_routes_on_graphs_are_the_cheapest_ones(seed, count):
    rng = np.random.default_rng(seed)
    points = rng.random((count, 2)) * 8 + 1
    ends = {(int(a), int(b)) for a, b in rng.integers(0, count, (3 * count, 2)) if a != b}
    edges = []
    for number, (a, b) in enumerate(sorted(ends), start=count):
        kind = rng.integers(0, 3)
        metadata = {"speed_limit": 50.0} if kind == 1 else {}
        edges.append(RouteEdge(number, a, b, float(rng.random()), kind != 2, metadata))
    nodes = (RouteNode(k, *map(float, points[k])) for k in range(count))
    graph = RouteGraph(tuple(nodes), tuple(edges))
    weights = np.full((count, count), np.inf)
    for edge in edges:
        length = math.dist(points[edge.start], points[edge.end])
        limit = edge.metadata.get("speed_limit", 1.0)
        weights[edge.start, edge.end] = length / limit if edge.overridable else edge.cost
    expected = dijkstra(np.where(np.isfinite(weights), weights, 0.0), indices=0)[-1]
    terrain = Terrain.of(Costmap(np.zeros((100, 100), np.uint8), 0.1))
    found = route_on_graph(terrain, graph, tuple(points[0]), tuple(points[-1]))
    if not np.isfinite(expected):
        return  # it may begin at another node
    passed = [int(np.flatnonzero((points == point).all(axis=1))[0]) for point in found.points_xy]
    assert (passed[0], passed[-1]) == (0, count - 1)
    assert sum(weights[a, b] for a, b in pairwise(passed)) == pytest.approx(expected)


def test_a_route_on_the_graph_is_little_longer_than_without():
    grid = grid_from_text(TWO_ROOMS)
    graph = graph_of(TWO_ROOMS, hall=9.0)
    terrain = Terrain.of(Costmap.from_occupancy(grid))
    start, goal = grid.frame.xy_from_rowcol([(2, 2), (7, 27)]).tolist()
    found = route_on_graph(terrain, graph, start, goal)
    alone = route(Costmap.from_occupancy(grid), start=start, goal=goal)
    assert found.reached
    assert alone.length <= found.length + 0.5 < 1.4 * alone.length


@pytest.mark.parametrize("method", ["astar", "graph"])
def test_without_obstacles_every_method_goes_straight(tmp_path, method):
    frame = grid_from_text("\n".join(["." * 24] * 14)).frame
    start, goal, *nodes = frame.xy_from_rowcol([(4, 2), (4, 20), (4, 4), (4, 18)]).tolist()
    points = tuple(RouteNode(k, *node) for k, node in enumerate(nodes))
    graph = RouteGraph(points, (RouteEdge(2, 0, 1),))
    (tmp_path / "graph.geojson").write_text("\n".join(graph_text(graph)))
    options = {"graph": tmp_path / "graph.geojson"} if method == "graph" else {}
    free = Costmap(np.zeros((14, 24), np.uint8), 0.25, (1.5, -2.0, 0.4))
    found = mapdeal.route(free, start=tuple(start), goal=tuple(goal), method=method, **options)
    assert (found.method, found.reached) == (method, True)
    assert found.length == pytest.approx(18 * 0.25)


@pytest.mark.parametrize(("before", "doors"), [(math.inf, [1]), (0.0, [])])
def test_a_path_of_two_cells_has_a_door_between_halls_alone(before, doors):
    draft, path = SimpleNamespace(cell=0.1), route_graphs._Path((), 0, 0, before, math.inf)
    assert list(route_graphs._CompleteDraft._doors(draft, np.array([2.0, 1.0]), path)) == doors
