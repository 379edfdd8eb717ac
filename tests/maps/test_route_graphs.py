import json
import math

import pytest

import mapdeal
from drawn import grid_from_text
from mapdeal import Footprint
from mapdeal.commands.graph import graph
from mapdeal.errors import MalformedInputError
from mapdeal.maps.route_graphs import graph_text, read_graph_file, read_route_graph
from maps.geojson import collection, edge, feature, geometry, node

FLOATS = ("speed_limit", "abs_speed_limit", "penalty", "length", "min_clearance", "door_width")
ROOMS = "\n".join(["#" * 70, *["#" + "." * 33 + "#" + "." * 34 + "#"] * 12,
                   "#" + "." * 68 + "#", "#" + "." * 68 + "#",
                   *["#" + "." * 33 + "#" + "." * 34 + "#"] * 12, "#" * 70])  # fmt: skip


def loaded(text):
    """Return nodes and edges of a file as the loader of nav2_route reads them."""
    features = json.loads(text)["features"]
    nodes, edges = {}, {}
    for item in features:
        properties, geometry = item["properties"], item["geometry"]
        if geometry["type"] == "Point":
            number = properties["id"]
            assert type(number) is int
            assert 0 <= number < 2**32
            assert properties.get("frame", "map") == "map"
            x, y = geometry["coordinates"]
            assert math.isfinite(x + y)
            assert number not in nodes
            nodes[number] = (x, y), properties.get("metadata", {})
    for item in features:
        properties, geometry = item["properties"], item["geometry"]
        if geometry["type"] in ("LineString", "MultiLineString"):
            number, start, end = (properties[key] for key in ("id", "startid", "endid"))
            assert type(number) is int
            assert number not in nodes
            assert number not in edges
            assert start in nodes  # else the whole file is refused
            assert end in nodes
            assert type(properties["cost"]) is float
            assert properties["overridable"] is True
            metadata = properties.get("metadata", {})
            for key in FLOATS:
                assert type(metadata.get(key, 1.0)) is float  # whole numbers make scorers throw
            (line,) = geometry["coordinates"]
            assert [tuple(point) for point in line] == [nodes[start][0], nodes[end][0]]
            edges[number] = start, end, metadata
    assert nodes
    assert edges
    limits = sum("speed_limit" in metadata for _, _, metadata in edges.values())
    assert limits in (0, len(edges))  # else edges with one are 50 times shorter
    return nodes, edges


@pytest.mark.usefixtures("mapdeal_warnings")
def test_goals_of_a_graph_have_names_as_keys_too():
    grid, robot = grid_from_text(ROOMS), Footprint.circle(0.2)
    x, y = grid.frame.xy_from_rowcol([[2, 2]])[0].tolist()
    found = [graph(grid, footprint=robot, goals=goals).graph
             for goals in ({"lab": (x, y)}, [mapdeal.Goal(x, y, "lab")])]  # fmt: skip
    assert "lab" in "\n".join(graph_text(found[0]))
    assert [*graph_text(found[0])] == [*graph_text(found[1])]


@pytest.mark.usefixtures("mapdeal_warnings")
@pytest.mark.parametrize("options", [{}, {"slow_below": 1.0}, {"one_way": "right", "hall": 9.0}])
def test_the_server_s_rules_hold_for_files_and_they_are_read_back(tmp_path, options):
    grid = grid_from_text(ROOMS)
    route_graph = graph(grid, footprint=Footprint.circle(0.2), **options).graph
    text = "\n".join(graph_text(route_graph))
    nodes, edges = loaded(text)
    assert (len(nodes), len(edges)) == (len(route_graph.nodes), len(route_graph.edges))
    assert any(metadata.get("kind") == "narrow" for _, metadata in nodes.values())
    mapdeal.write_route_graph(tmp_path / "g.geojson", route_graph)
    with pytest.raises(mapdeal.FileAccessError, match="exists"):
        mapdeal.write_route_graph(tmp_path / "g.geojson", route_graph)
    assert (tmp_path / "g.geojson").read_text() == f"{text}\n"
    again = read_route_graph(tmp_path / "g.geojson")
    assert list(map(vars, again.nodes)) == list(map(vars, route_graph.nodes))
    assert list(map(vars, again.edges)) == list(map(vars, route_graph.edges))
    repeated = graph(grid, footprint=Footprint.circle(0.2), **options).graph
    assert text == "\n".join(graph_text(repeated))


GOOD = [node(0), node(1, 1.0), edge(2, 0, 1)]


def written(tmp_path, features):
    path = tmp_path / "g.geojson"
    path.write_text(json.dumps(collection(*features)))
    return path


def test_lines_are_not_read_and_other_geometries_are_passed_over(tmp_path):
    polygon = feature(geometry("Polygon", []))
    found = read_route_graph(written(tmp_path, [edge(2, 0, 1), polygon, *GOOD[:2]]))
    assert found.ends.tolist() == [[0, 1]]
    assert found.lengths.tolist() == [1.0]


@pytest.mark.parametrize(("features", "check"), [
    ([edge(2, 0, 1)], "missing-end"), ([node(0), edge(2, 0, 1)], "missing-end"),
    ([node(0), node(1), edge(2, 0, 7), edge(3, 0, 1)], "missing-end"),
    ([node(-1), node(1), edge(2, 1, 1)], "refused"),
    ([node("a"), node(1), edge(2, 1, 1)], "refused"),
    ([node(0), node(1), edge(1.5, 0, 1)], "refused"),
    ([node(0), node(1), edge(None, 0, 1)], "refused"),
    ([*GOOD, edge(2, 1, 0)], "double-id"), ([*GOOD, node(1, 3.0)], "double-id"),
    ([*GOOD, edge(1, 1, 0)], "shared-id"),
    ([*GOOD[:2], edge(2, 0, 1, metadata={"speed_limit": 50})], "whole-number"),
    ([*GOOD[:2], edge(2, 0, 1, metadata={"penalty": 1})], "whole-number"),
    ([*GOOD, edge(3, 1, 0, metadata={"speed_limit": 50.0})], "mixed-limits"),
])  # fmt: skip
def test_what_the_server_refuses_or_takes_otherwise_than_meant_is_found(tmp_path, features, check):
    path = written(tmp_path, features)
    found = [problem.check for problem in read_graph_file(path).problems]
    if check in ("missing-end", "refused"):
        assert check in found
        with pytest.raises(MalformedInputError, match=r"g\.geojson"):
            read_route_graph(path)
    else:
        assert found == [check]
        assert read_route_graph(path).edges


@pytest.mark.parametrize("text", [
    "[]", "{}", "no JSON", json.dumps(collection()),
    *(json.dumps(collection(item, GOOD[2])) for item in ({"type": "Feature"}, node(0, "x"))),
])  # fmt: skip
def test_other_files_are_refused_with_one_line(tmp_path, text):
    (tmp_path / "g.geojson").write_text(text)
    with pytest.raises(MalformedInputError) as error:
        read_route_graph(tmp_path / "g.geojson")
    assert "\n" not in str(error.value)


HAND_MADE = {"depot": (34, 78, ["double-id"] * 6), "turtlebot3": (20, 65, []),
             "warehouse": (96, 172, [])}  # fmt: skip


@pytest.mark.parametrize("name", HAND_MADE)
def test_graphs_that_come_with_nav2(real_maps, name):
    folder = real_maps / "ros-navigation__navigation2/nav2_bringup/graphs"
    found = read_graph_file(folder / f"{name}_graph.geojson")
    checks = [problem.check for problem in found.problems]
    assert (len(found.graph.nodes), len(found.graph.edges), checks) == HAND_MADE[name]


@pytest.mark.usefixtures("mapdeal_warnings")
@pytest.mark.parametrize("name", ["depot", "warehouse", "tb3_sandbox"])
def test_graphs_of_nav2_s_maps_pass_lint(real_maps, tmp_path, name):
    path = real_maps / f"ros-navigation__navigation2/nav2_bringup/maps/{name}.yaml"
    result = graph(path, footprint=Footprint.circle(0.22))
    text = "\n".join(graph_text(result.graph))
    loaded(text)
    (tmp_path / "g.geojson").write_text(text)
    report = mapdeal.lint(path, graph=tmp_path / "g.geojson", footprint=Footprint.circle(0.22),
                          select="graph")  # fmt: skip
    assert list(report) == []
