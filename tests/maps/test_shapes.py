import json
import re

import pytest

from mapdeal import Circle, Line, MalformedInputError, Polygon, read_shapes
from mapdeal.errors import MapdealWarning
from maps.geojson import collection, feature, geometry

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
  - {type: circle, centre: [0, 0], radius: 1}
"""

TRIANGLE = [[0, 0], [4, 0], [4, 3], [0, 0]]
CIRCLE = "shapes: [{type: circle, center: [0, 0], radius: 1}]"


def read(folder, text):
    path = folder / ("zones.yaml" if isinstance(text, str) else "zones.geojson")
    path.write_text(text if isinstance(text, str) else json.dumps(text))
    return read_shapes(path)


def test_yaml(tmp_path):
    square = ((0.0, 0.0), (9.0, 0.0), (9.0, 9.0), (0.0, 9.0))
    assert read(tmp_path, YAML) == [
        Polygon(((0.0, 0.0), (4.0, 0.0), (4.0, 3.0)), value=100),
        Line(((0.0, 0.0), (1.0, 1.0), (2.0, -0.5)), thickness=0.2),
        Circle((1.5, -2.0), 0.5, value=-1),
        Polygon(square, (((1.0, 1.0), (2.0, 1.0), (2.0, 2.0)),)),
        Circle((0.0, 0.0), 1.0),
    ]


def test_geojson(tmp_path):
    hole = [[1, 0.5], [2, 0.5], [2, 1], [1, 0.5]]
    points = geometry("MultiPoint", [[0, 0], [1, 1]])
    features = [
        feature(geometry("Polygon", [TRIANGLE, hole]), value=100, name="stairs"),
        feature(geometry("MultiPolygon", [[TRIANGLE], [hole]]), value=50.0),
        feature(geometry("LineString", [[0, 0, 7.5], [1, 1]]), thickness=0.3),
        feature(geometry("Point", [1.5, -2]), radius=0.5, value=0),
        feature({"type": "GeometryCollection", "geometries": [points]}, radius=1),
    ]
    triangle = ((0.0, 0.0), (4.0, 0.0), (4.0, 3.0))
    inner = ((1.0, 0.5), (2.0, 0.5), (2.0, 1.0))
    assert read(tmp_path, collection(*features)) == [
        Polygon(triangle, (inner,), 100), Polygon(triangle, value=50), Polygon(inner, value=50),
        Line(((0.0, 0.0), (1.0, 1.0)), thickness=0.3), Circle((1.5, -2.0), 0.5, 0),
        Circle((0.0, 0.0), 1.0), Circle((1.0, 1.0), 1.0),
    ]  # fmt: skip


def test_a_bare_geometry_and_one_without_place(tmp_path):
    assert len(read(tmp_path, geometry("Polygon", [TRIANGLE]))) == 1
    with pytest.warns(MapdealWarning, match="feature 1"):
        found = read(tmp_path, collection(feature(None), feature(geometry("Polygon", [TRIANGLE]))))
    assert len(found) == 1


def ring(*points):
    return json.dumps(geometry("Polygon", [points]))


@pytest.mark.parametrize(("text", "message"), [
    ("", "no mapping"), ("shapes: []", "no shape"),
    (CIRCLE.replace("[0, 0]", "[0, 0, 0]"), "two numbers"),
    (CIRCLE.replace("[0, 0]", "[0, .nan]"), "must be a number"),
    (CIRCLE.replace("center: [0, 0], ", ""), "needs center"),
    (CIRCLE.replace("radius: 1", "radius: -1"), "circle radius"),
    (CIRCLE.replace("radius: 1", "radius: 1, radius: 2"), "appears twice"),
    (CIRCLE.replace("radius: 1", "radius: 1, value: 1.5"), "whole number"),
    (CIRCLE.replace("{", "{centre: [0, 0], "), r"center \(line 1\): is given twice"),
    (CIRCLE.replace("center", "cetner"), "unknown key of a circle.* did you mean center"),
    ("shapes: []\nvalue: 3", "value.*unknown key"),
    ("shapes:\n- points: [[0, 0]]", r"shape 1 \(line 2\).*type"),
    ("shapes: [{type: star}]", "type must be one of"),
    ("shapes: [{type: line, points: [[0, 0], [1, 1]], thickness: -1}]", "thickness"),
    ("shapes:\n- {type: polygon, points: [[0,0],[2,2],[2,0],[0,2]]}",
     r"shape 1 \(line 2\): polygon vertex 1"),
    ("shapes: [{type: polygon, points: [[0, 0], [1, 1], [1e999, 0]]}]", "polygon vertex 3"),
    ("[1]", "must be an object"), ('{"type": "FeatureCollection"}', "features"),
    ('{"type": "FeatureCollection", "features": [3]}', "feature 1"),
    ('{"type": "Topology"}', "type must be one of"), ('{"type": "Polygon"}', "coordinates"),
    ('{"type": "Polygon", "coordinates": []}', "ring"),
    (ring([0, 0], [1, True], [1, 0]), "position 2"),
    (ring([0, 0], [1, float("nan")], [1, 0]), "NaN"),
    (ring([0, 0], [1, 0], [1, 1]).replace("[1, 1]", "[1, 1e999]"), "vertex 3"),
    (json.dumps(geometry("Point", [0, 0])), "radius"),
    (json.dumps(feature(geometry("Point", [0, 0]), radius="1")), "radius"),
    (json.dumps(feature(geometry("Point", [0, 0]), radius=1, value=1.5)), "value"),
    (json.dumps({**feature(geometry("Point", [0, 0])), "properties": 3}), "properties"),
    ('{"type": "Point", "type": "Point"}', "twice"),
    ("[" * 100_000, "nested too deep"),
    ('{"type": "\udcff"}', "UTF-8"),
], ids=lambda text: text[:70])  # fmt: skip
def test_malformed_files_of_shapes_are_refused(tmp_path, text, message):
    path = tmp_path / ("zones.json" if text[:1] in ("[", "{") else "zones.yaml")
    path.write_bytes(text.encode(errors="surrogateescape"))
    with pytest.raises(MalformedInputError) as caught:
        read_shapes(path)
    assert re.search(message, f"{caught.value} {caught.value.hint}")
    assert str(path) in str(caught.value)
