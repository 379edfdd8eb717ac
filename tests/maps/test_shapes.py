"""Files of shapes, good ones and bad ones."""

import json

import pytest

from mapdeal import Circle, FileAccessError, Line, MalformedInputError, Polygon, read_shapes
from mapdeal.errors import MapdealWarning

YAML = """\
# zones of a hall
shapes:
  - type: polygon
    points: [[0, 0], [4, 0], [4, 3e0]]
    value: 100
  - {type: line, points: [[0, 0], [1, 1], [2, -5e-1]], thickness: 0.2}
  - type: circle
    center: [1.5, -2]
    radius: 0.5
    value: -1
  - type: polygon
    points: [[0, 0], [9, 0], [9, 9], [0, 9]]
    holes: [[[1, 1], [2, 1], [2, 2]]]
"""

TRIANGLE = [[0, 0], [4, 0], [4, 3], [0, 0]]


def feature(geometry, **properties):
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def geometry(kind, coordinates):
    return {"type": kind, "coordinates": coordinates}


def test_yaml(tmp_path):
    path = tmp_path / "zones.yaml"
    path.write_text(YAML)
    square = ((0.0, 0.0), (9.0, 0.0), (9.0, 9.0), (0.0, 9.0))
    assert read_shapes(path) == [
        Polygon(((0.0, 0.0), (4.0, 0.0), (4.0, 3.0)), value=100),
        Line(((0.0, 0.0), (1.0, 1.0), (2.0, -0.5)), thickness=0.2),
        Circle((1.5, -2.0), 0.5, value=-1),
        Polygon(square, (((1.0, 1.0), (2.0, 1.0), (2.0, 2.0)),)),
    ]


def test_geojson(tmp_path):
    path = tmp_path / "zones.geojson"
    hole = [[1, 0.5], [2, 0.5], [2, 1], [1, 0.5]]
    points = geometry("MultiPoint", [[0, 0], [1, 1]])
    features = [
        feature(geometry("Polygon", [TRIANGLE, hole]), value=100, name="stairs"),
        feature(geometry("MultiPolygon", [[TRIANGLE], [hole]]), value=50.0),
        feature(geometry("LineString", [[0, 0, 7.5], [1, 1]]), thickness=0.3),
        feature(geometry("Point", [1.5, -2]), radius=0.5, value=0),
        feature({"type": "GeometryCollection", "geometries": [points]}, radius=1),
    ]
    document = {"type": "FeatureCollection", "crs": None, "features": features}
    path.write_text(json.dumps(document))
    triangle = ((0.0, 0.0), (4.0, 0.0), (4.0, 3.0))
    inner = ((1.0, 0.5), (2.0, 0.5), (2.0, 1.0))
    assert read_shapes(path) == [
        Polygon(triangle, (inner,), 100),
        Polygon(triangle, value=50),
        Polygon(inner, value=50),
        Line(((0.0, 0.0), (1.0, 1.0)), thickness=0.3),
        Circle((1.5, -2.0), 0.5, 0),
        Circle((0.0, 0.0), 1.0),
        Circle((1.0, 1.0), 1.0),
    ]


def test_a_bare_geometry_and_one_without_place(tmp_path):
    path = tmp_path / "zone.json"
    path.write_text(json.dumps(geometry("Polygon", [TRIANGLE])))
    assert len(read_shapes(path)) == 1
    features = [feature(None), feature(geometry("Polygon", [TRIANGLE]))]
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    with pytest.warns(MapdealWarning, match="feature 1"):
        assert len(read_shapes(path)) == 1


def check_refused(path, text, named):
    path.write_text(text)
    with pytest.raises(MalformedInputError, match=named) as caught:
        read_shapes(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(("text", "named"), [
    ("", "no mapping"),
    ("shapes: []", "no shape"),
    ("shapes: [{type: circle, center: [0, 0, 0], radius: 1}]", "two numbers"),
    ("shapes: []\nvalue: 3", "value.*unknown key"),
    ("shapes:\n- points: [[0, 0]]", r"shape 1 \(line 2\).*type"),
    ("shapes: [{type: star}]", "type must be one of"),
    ("shapes: [{type: circle, radius: 1}]", "needs center"),
    ("shapes: [{type: circle, center: [0, 0], radius: -1}]", "circle radius"),
    ("shapes: [{type: circle, center: [0, .nan], radius: 1}]", "must be a number"),
    ("shapes: [{type: circle, center: [0, 0], radius: 1, radius: 2}]", "appears twice"),
    ("shapes: [{type: circle, center: [0, 0], radius: 1, value: 1.5}]", "whole number"),
    ("shapes: [{type: line, points: [[0, 0], [1, 1]], thickness: -1}]", "thickness"),
    (
        "shapes:\n- {type: polygon, points: [[0,0],[2,2],[2,0],[0,2]]}",
        r"shape 1 \(line 2\): polygon vertex 1",
    ),
    ("shapes: [{type: polygon, points: [[0, 0], [1, 1], [1e999, 0]]}]", "polygon vertex 3"),
])  # fmt: skip
def test_yaml_that_is_no_list_of_shapes(tmp_path, text, named):
    check_refused(tmp_path / "zones.yaml", text, named)


@pytest.mark.parametrize(("text", "named"), [
    ("", "no valid JSON"),
    ("[1]", "must be an object"),
    ('{"type": "FeatureCollection"}', "features"),
    ('{"type": "FeatureCollection", "features": [3]}', "feature 1"),
    ('{"type": "Topology"}', "type must be one of"),
    ('{"type": "Polygon"}', "coordinates"),
    ('{"type": "Polygon", "coordinates": []}', "ring"),
    ('{"type": "Polygon", "coordinates": [[[0, 0], [1, true], [1, 0]]]}', "position 2"),
    ('{"type": "Polygon", "coordinates": [[[0, 0], [1, NaN], [1, 0]]]}', "NaN"),
    ('{"type": "Polygon", "coordinates": [[[0, 0], [1, 1e999], [1, 0]]]}', "vertex 2"),
    ('{"type": "Point", "coordinates": [0, 0]}', "radius"),
    (json.dumps(feature(geometry("Point", [0, 0]), radius="1")), "radius"),
    (json.dumps(feature(geometry("Point", [0, 0]), radius=1, value=1.5)), "value"),
    (json.dumps({**feature(geometry("Point", [0, 0])), "properties": 3}), "properties"),
    ('{"type": "Point", "type": "Point"}', "twice"),
    ("[" * 100_000, "nested too deep"),
])  # fmt: skip
def test_json_that_is_no_geojson(tmp_path, text, named):
    check_refused(tmp_path / "zones.json", text, named)


def test_bytes_that_are_no_text_and_a_file_that_is_not_there(tmp_path):
    path = tmp_path / "zones.json"
    path.write_bytes(b'{"type": "\xff"}')
    with pytest.raises(MalformedInputError, match="UTF-8"):
        read_shapes(path)
    with pytest.raises(FileAccessError):
        read_shapes(tmp_path / "none.yaml")


def test_either_spelling_of_a_key_is_taken_and_none_twice(tmp_path):
    path = tmp_path / "s.yaml"
    path.write_text("shapes: [{type: circle, centre: [1.5, -2], radius: 0.5}]\n")
    assert read_shapes(path) == [Circle((1.5, -2.0), 0.5)]
    path.write_text("shapes:\n- type: circle\n  center: [1, 2]\n  centre: [1, 2]\n  radius: 1\n")
    with pytest.raises(MalformedInputError, match=r"centre \(line 4\): is given twice"):
        read_shapes(path)
    path.write_text("shapes: [{type: circle, cetner: [1, 2], radius: 1}]\n")
    with pytest.raises(MalformedInputError, match="unknown key of a circle") as caught:
        read_shapes(path)
    assert caught.value.hint == "did you mean center?"
