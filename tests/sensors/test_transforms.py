"""Transforms in files of align and in files written by hand, and files without a transform."""

import json
import math

import pytest

from mapdeal.errors import MalformedInputError
from mapdeal.grid.frame import Transform
from mapdeal.sensors.points import read_transform, transform_document


def written(folder, value):
    path = folder / "transform.json"
    path.write_text(value if isinstance(value, str) else json.dumps(value))
    return path


def test_a_transform_written_by_hand(tmp_path):
    found = read_transform(written(tmp_path, {"x": 1.5, "y": -2, "yaw": 0.25}))
    assert found.transform.pose == (1.5, -2.0, 0.25)
    assert (found.first, found.second) == ({}, {})


def test_a_document_of_align_says_between_which_maps(tmp_path):
    document = {
        "transform": transform_document(Transform(1.25, 2.5, math.pi / 3)),
        "first": {"file": "a.yaml", "sha256": {"a.pgm": "0" * 64}},
        "second": {"file": "b.yaml", "sha256": {"b.pgm": "f" * 64}},
    }
    found = read_transform(written(tmp_path, document))
    assert found.transform == Transform(1.25, 2.5, math.pi / 3)
    assert (found.first, found.second) == ({"a.pgm": "0" * 64}, {"b.pgm": "f" * 64})


@pytest.mark.parametrize(("value", "rule"), [
    ({"x": 1, "y": 2}, "must have a key yaw"),
    ({"x": 1, "y": "2", "yaw": 0}, "must be a number"),
    ('{"x": 1, "y": 1e400, "yaw": 0}', "must be a number from"),
    ('{"x": NaN, "y": 0, "yaw": 0}', "NaN is not a JSON number"),
    ({"transform": {"x": 1, "y": 2, "yaw": 0}, "first": {"sha256": {"a": "1"}}}, "sha256"),
])  # fmt: skip
def test_files_without_a_transform_are_refused(tmp_path, value, rule):
    with pytest.raises(MalformedInputError, match=rule):
        read_transform(written(tmp_path, value))
