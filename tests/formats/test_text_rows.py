"""Tables of numbers as text."""

import io
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from engines import needs_compiled
from mapdeal import MalformedInputError
from mapdeal.formats import text_rows
from mapdeal.formats.text_rows import LONGEST_LINE, read_rows
from mapdeal.kernels import engine

pytestmark = pytest.mark.slow

TEXT = b"# a b c\n1 2 3\n\n4 5 6\n# more\n7 8 9\n10 11 12\n"


@pytest.mark.parametrize(
    ("most", "rows", "rest"),
    [
        (None, [[3, 1], [6, 4], [9, 7], [12, 10]], b""),
        (2, [[3, 1], [6, 4]], b"# more\n7 8 9\n10 11 12\n"),
        (3, [[3, 1], [6, 4], [9, 7]], b"10 11 12\n"),
        (9, [[3, 1], [6, 4], [9, 7], [12, 10]], b""),
        (0, [], TEXT),
    ],
)
def test_so_many_rows_are_read_and_what_follows_is_not_touched(most, rows, rest):
    file = io.BytesIO(TEXT)
    found = read_rows(file, [2, 0], path=Path("t.txt"), first_line=1, most=most)
    assert [row for part in found for row in part.tolist()] == rows
    assert file.read() == rest


class _Unseekable(io.BytesIO):
    def seekable(self):
        return False


def _outcome(text, columns, *, by_lines=False, is_seekable=True, **options):
    """Return the parts that are read, the error in the end, and what is left of the file."""
    file = io.BytesIO(text) if is_seekable else _Unseekable(text)
    parts, error = [], None
    with pytest.MonkeyPatch.context() as patch:
        if by_lines:
            patch.setenv(engine.VARIABLE, "scipy")
        try:
            found = read_rows(file, columns, path=Path("t.txt"), first_line=7, **options)
            parts.extend(part.tolist() for part in found)
        except MalformedInputError as caught:
            error = str(caught)
    return parts, error, file.read() if error is None else None


WORDS = st.one_of(
    st.floats(-1e6, 1e6).map(repr),
    st.integers(-99, 99).map(str),
    st.sampled_from(
        ["nan", "-inf", "infinity", "1_0", "x", "\u0661", "", "\0", "1e999", "0x1", "é"]
    ),
)
LINES = st.one_of(
    st.lists(WORDS, min_size=1, max_size=4).map(" ".join),
    st.lists(st.integers(-99, 99).map(str), min_size=3, max_size=3).map(" ".join),
    st.sampled_from(
        ["", "  ", "\t", "# 1 2 3", " #", "1 2 3 #", "1\r2 3", "1 2 3\x0b", "1\x1c2 3", "\r"]
    ),
)


@needs_compiled
@given(
    st.lists(LINES, max_size=12),
    st.sampled_from(["\n", "\r\n"]),
    st.booleans(),
    st.sampled_from([None, ",", ";"]),
    st.sampled_from([None, 0, 1, 3, 5, 99]),
    st.sampled_from([None, 3]),
    st.sampled_from([[0, 1, 2], [0, 1], [2, 0]]),
    st.sampled_from([(1, 1), (2, 8), (3, 1 << 20), (1 << 16, 9), (1 << 16, 1 << 22)]),
    st.sampled_from([1, 7, 1 << 16]),
)
def test_blocks_are_read_as_lines_are(
    lines, end, has_last_end, delimiter, most, width, columns, together, first_block
):
    text = end.join(lines) + (end if has_last_end else "")
    text = text.replace(" ", delimiter or " ").encode()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(text_rows, "_LINES_TOGETHER", together[0])
        patch.setattr(text_rows, "_BYTES_TOGETHER", together[1])
        patch.setattr(text_rows, "_FIRST_BLOCK", first_block)
        options = {"delimiter": delimiter, "most": most, "width": width}
        at_once = _outcome(text, columns, **options)
        by_lines = _outcome(text, columns, by_lines=True, **options)
        assert repr(at_once) == repr(by_lines)  # nan is not itself
        assert repr(_outcome(text, columns, is_seekable=False, **options)) == repr(by_lines)


def _rows(count, *, seed=0):
    return np.random.default_rng(seed).normal(0, 100, (count, 3))


def _text(rows):
    return b"".join(b"%r %r %r\n" % tuple(row) for row in rows.tolist())


@needs_compiled
def test_long_texts_come_in_the_parts_that_lines_come_in():
    rows = _rows(70_000)
    text = _text(rows)
    parts, error, _ = _outcome(text, [0, 1, 2])
    assert error is None
    assert np.concatenate([np.array(part) for part in parts]).tolist() == rows.tolist()
    by_lines, *_ = _outcome(text, [0, 1, 2], by_lines=True)
    assert [len(part) for part in parts] == [len(part) for part in by_lines]
    assert len(parts) > 1


def test_a_malformed_row_in_a_later_block_is_named(each_engine):
    text = _text(_rows(70_000)) + b"1 2 x\n" + _text(_rows(5))
    parts, error, _ = _outcome(text, [0, 1, 2])
    assert sum(map(len, parts)) < 70_000
    assert parts
    assert error == "t.txt: line 70007: must be a number, got 'x'"


@pytest.mark.parametrize("start", [b"", b"#", b" "])
@pytest.mark.parametrize("length", [LONGEST_LINE, LONGEST_LINE + 1])
def test_a_line_may_be_so_long(each_engine, start, length):
    text = b"1 2 3\n" + start + b"4 5 6".rjust(length - len(start) - 1) + b"\n7 8 9\n"
    parts, error, _ = _outcome(text, [0, 1, 2])
    if length > LONGEST_LINE:
        assert error == "t.txt: line 8: must not be longer than 1048576 bytes"
        return
    assert error is None
    assert len(parts[0]) == (2 if start == b"#" else 3)


@pytest.fixture(params=["compiled", "scipy"])
def each_engine(request, monkeypatch):
    if request.param == "compiled" and engine.compiled_module() is None:
        pytest.skip("the compiled kernels were not built")
    monkeypatch.setenv(engine.VARIABLE, request.param)
    return request.param
