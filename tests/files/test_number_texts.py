import json
import math

import numpy as np
import pytest
from hypothesis import example, given, strategies as st

from mapdeal import MalformedInputError
from mapdeal.files.json_values import JsonValue, document_kind, read_json
from mapdeal.files.text import Form, row_texts

LINE = [Form(("", "\n"), (0,))]
INTEGERS = st.integers(-9, 9) | st.integers(-(10**15) + 1, 10**15 - 1)
FLOATS = st.floats() | st.floats(-1e4, 1e4) | st.decimals(-999, 999, places=6).map(float)


def _texts(numbers, kind):
    values = np.array(numbers, dtype=np.float64).reshape(-1, 1)
    return row_texts(values, [kind], LINE, np.zeros(len(values), dtype=np.uint8)).splitlines()


def _single(number):
    """Return the text of a number that is good for no more than a float32."""
    if not math.isfinite(number):
        return "null"
    if abs(number) < 1e-12:
        return "0.0"
    with np.errstate(over="ignore"):
        single = np.float32(number)
    return str(single) if float(single) == number else f"{number:.9g}"


@given(st.lists(FLOATS))
@example([562949953421312.25, 562949953421312.75, 0.001, 1e15, 999999999999999.9, 2.0**52, -0.0])
@example([9.5367431640625e-07, 4503599627370497.5, 5e-324, 1.7976931348623157e308, 1e-5, 1e16])
def test_exact_numbers_are_written_as_python_does(numbers):
    expected = [repr(number) if math.isfinite(number) else "null" for number in numbers]
    assert _texts(numbers, "exact") == expected


@given(st.lists(st.floats(width=32) | st.floats(0, 1e6, width=32)))
def test_a_float32_is_written_as_numpy_does(numbers):
    assert _texts(numbers, "single") == [_single(number) for number in numbers]


@given(st.lists(FLOATS), st.lists(st.tuples(st.integers(0, 1 << 40), st.integers(0, 60))))
@example([99999999.95, 999999999.5, 0.000123456785, 1e-5, 1.5e-12], [(3, 30), (1, 9)])
def test_between_them_nine_digits_are_written(numbers, binary):
    numbers = [*numbers, *((2 * integer + 1) / 2**places for integer, places in binary)]
    assert _texts(numbers, "single") == [_single(number) for number in numbers]


@given(st.lists(st.tuples(st.floats(-99, 99), INTEGERS, st.integers(0, 2)), max_size=40))
def test_rows_have_the_form_that_is_chosen(rows):
    forms = [
        Form(('{"k": 0, "x": ', "}\n"), (0,)),
        Form(('{"k": 1, "n": ', ', "x": ', "}\n"), (1, 0)),
        Form(('{"k": 2, "%s": "{}", "n": ', "}\n"), (1,)),
    ]
    values = np.array([[x, n] for x, n, _ in rows], dtype=np.float64).reshape(-1, 2)
    chosen = np.array([k for *_, k in rows], dtype=np.uint8)
    text = row_texts(values, ["exact", "integer"], forms, chosen)
    expected = [({"k": 0, "x": x}, {"k": 1, "n": n, "x": x}, {"k": 2, "%s": "{}", "n": n})[k]
                for x, n, k in rows]  # fmt: skip
    assert text.splitlines() == [json.dumps(row) for row in expected]


def test_keys_of_json_are_read_or_named_as_missing(tmp_path):
    assert JsonValue(tmp_path, {"a": 2})["a"].number() == 2.0
    with pytest.raises(MalformedInputError, match="a: must have a key b"):
        JsonValue(tmp_path, {"a": {}})["a"]["b"]


def test_the_kind_of_a_document_follows_from_its_keys():
    documents = {
        "manifest": {"outputs": {}, "stages": []}, "summary": {"maps": [{"status": "done"}]},
        "lint": {"maps": [{}], "errors": 0, "suppressed": 0}, "shapes": {"type": "Polygon"},
        "route": {"reached": True, "points": []}, "reach": {"reachable_m2": 1, "passages": []},
        "diff": {"confusion": {}, "walls": {}}, "plan": {"format": "mapdeal-plan/1"},
    }  # fmt: skip
    for kind, document in documents.items():
        assert document_kind(document) == kind
        for key in document:
            assert document_kind({name: document[name] for name in document if name != key}) is None


def test_a_json_file_of_more_than_4_mib_is_not_read(tmp_path):
    for size, value in ((1 << 22, 7), ((1 << 22) + 1, None)):
        (tmp_path / "m.json").write_text("7".rjust(size))
        assert read_json(tmp_path / "m.json") == value
