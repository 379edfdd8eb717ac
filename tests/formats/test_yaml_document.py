"""The lines that are written without PyYAML, beside those that it writes."""

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from mapdeal.formats.yaml_text import yaml_document

WORDS = [
    "yes", "true", "null", "off", "nan", "inf", "raw", "trinary", "no", "y", "a.pgm", "1e3.pgm",
    "e1.pgm", "my map.png", "-a.pgm", "a_b-c.png", "~", "karte\u00e4.pgm", "a: b", "x#y", "0.5",
]  # fmt: skip
NUMBERS = st.one_of(st.floats(), st.integers(), st.booleans(), st.none())
VALUES = st.one_of(
    NUMBERS, st.text(), st.sampled_from(WORDS), st.lists(NUMBERS, max_size=10),
    st.lists(st.sampled_from(WORDS), max_size=3),
    st.from_regex(r"[A-Za-z_][A-Za-z0-9_-]{0,120}\.[a-z]{3,4}", fullmatch=True),
)  # fmt: skip
KEYS = st.one_of(st.sampled_from([*WORDS, "image", "occupied_thresh"]), st.text(), st.integers())


def by_library(document):
    return yaml.safe_dump(
        document, sort_keys=False, default_flow_style=None, allow_unicode=True, width=1000
    ).encode()


@given(st.dictionaries(KEYS, VALUES, max_size=8))
def test_a_document_is_the_library_s(document):
    try:
        expected = by_library(document)
    except UnicodeEncodeError:
        with pytest.raises(UnicodeEncodeError):
            yaml_document(document)
    else:
        assert yaml_document(document) == expected


@given(st.text("abcdefghijklmnopqrstuvwxyz", min_size=1, max_size=6), st.floats())
def test_so_is_a_plain_line(word, number):
    document = {f"{word}_key": word, word: number, "list": [number, 1, -number]}
    assert yaml_document(document) == by_library(document)


def test_the_lines_beside_an_image_need_no_library(monkeypatch):
    document = {
        "image": "map-2.pgm", "mode": "trinary", "resolution": 0.05, "origin": [-1.5, 1e22, 0.0],
        "negate": 0, "occupied_thresh": 0.65, "free_thresh": 1e-05,
    }  # fmt: skip
    expected = by_library(document)
    monkeypatch.setattr(yaml, "safe_dump", None)
    assert yaml_document(document) == expected
