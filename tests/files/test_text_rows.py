import io
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, strategies as st

from mapdeal import MalformedInputError
from mapdeal.errors import shown
from mapdeal.files import text as text_rows
from mapdeal.files.text import LONGEST_LINE, read_rows

pytestmark = pytest.mark.slow


def _outcome(text, columns, **options):
    """Return the parts that are read, the final error, and the unread remainder of the file."""
    file = io.BytesIO(text)
    parts, error = [], None
    try:
        found = read_rows(file, columns, path=Path("t.txt"), first_line=7, **options)
        parts.extend(part.tolist() for part in found)
    except MalformedInputError as caught:
        error = str(caught)
    return parts, error, file.read() if error is None else None


def _line_by_line(text, columns, *, delimiter, most, width):
    """Return rows, error and unread remainder, computed line by line with `float` and `split`."""
    file, rows, number = io.BytesIO(text), [], 6
    needed = max(columns) + 1 if width is None else width
    more = " or more" if width is None else ""
    while most is None or len(rows) < most:
        line, number = file.readline(), number + 1
        if not line:
            break
        line = line.decode("latin-1").strip(" \t\r\n\x0b")
        if not line or line.startswith("#"):
            continue
        words = line.split(delimiter)
        place = f"t.txt: line {number}"
        if len(words) != needed and (width is not None or len(words) < needed):
            return [], f"{place}: must have {needed} numbers{more}, got {shown(line)}", None
        for column in columns if width is None else range(width):
            word = words[column].strip()
            try:
                if not word.isascii() or "_" in word:
                    raise ValueError
                float(word)
            except ValueError:
                return [], f"{place}: must be a number, got {shown(word)}", None
        rows.append([float(words[column]) for column in columns])
    return rows, None, file.read()


ODD_WORDS = ["nan", "-inf", "infinity", "1_0", "x", "\u0661", "", "\0", "1e999", "0x1", "é"]
WORDS = st.floats(-1e6, 1e6).map(repr) | st.integers(-99, 99).map(str) | st.sampled_from(ODD_WORDS)
LINES = st.one_of(
    st.lists(WORDS, min_size=1, max_size=4).map(" ".join),
    st.lists(st.integers(-99, 99).map(str), min_size=3, max_size=3).map(" ".join),
    st.sampled_from(["", "  ", "\t", "# 1 2 3", " #", "1 2 3 #", "1 2 3\x0b", "\r"]),
)


@example(["#", "1 2 3", "", "4 5 6", "# 7", "8 9 1"], "\n", True, None, 2, None, [2, 0], 1 << 20)
@example(["1 2 3", "4 5 6", "7 8 9", "1 1 1"], "\n", True, None, 3, None, [2, 0], 1 << 20)
@given(
    st.lists(LINES, max_size=12), st.sampled_from(["\n", "\r\n"]), st.booleans(),
    st.sampled_from([None, ",", ";"]), st.sampled_from([None, 0, 1, 3, 5, 99]),
    st.sampled_from([None, 3]), st.sampled_from([[0, 1, 2], [0, 1], [2, 0]]),
    st.sampled_from([1, 9, 30, 1 << 20]),
)  # fmt: skip
def test_lines_read_together_are_those_that_are_read_alone(
    lines, end, has_last_end, delimiter, most, width, columns, together
):
    text = end.join(lines) + (end if has_last_end else "")
    text = text.replace(" ", delimiter or " ").encode()
    options = {"delimiter": delimiter, "most": most, "width": width}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(text_rows, "_BYTES_TOGETHER", together)
        parts, error, unread = _outcome(text, columns, **options)
    rows = [] if error else [row for part in parts for row in part]
    expected = _line_by_line(text, columns, **options)
    assert repr((rows, error, unread)) == repr(expected)  # nan is not itself


DIGITS = st.text("0123456789", min_size=1, max_size=25)
HALVES = st.integers(1 << 52, (1 << 53) - 1).map(lambda mantissa: 2 * mantissa + 1)


@given(
    st.floats(allow_nan=False).map(repr)
    | st.tuples(st.floats(-1e300, 1e300), st.integers(0, 25), st.sampled_from("efg")).map(
        lambda form: f"{form[0]:.{form[1]}{form[2]}}"
    )
    | st.tuples(DIGITS, DIGITS, st.integers(-400, 400)).map(lambda part: "-{}.{}e{}".format(*part))
    | st.tuples(HALVES, st.integers(0, 19)).map(lambda half: f"{half[0]}e-{half[1]}")
    | st.tuples(HALVES, st.integers(-1, 1)).map(lambda half: f"{half[0] * 5**4 + half[1]}e-9")
)
@example("9007199254740993")
@example("2.4703282292062327208e-324")
@example("17976931348623159e292")
@example("+.5")
@example("5.")
def test_every_number_is_read_as_float_reads_it(word):
    for delimiter in (None, ","):
        parts, error, _ = _outcome(word.encode(), [0], delimiter=delimiter)
        assert error is None
        assert struct.pack("<d", parts[0][0][0]) == struct.pack("<d", float(word))


@pytest.mark.parametrize("text", [b"1 2 3\n4\r5 6\n", b"1 2 3\r4 5 6\r", b"1 2 3\n4 5 6\r7\n"])
def test_a_carriage_return_alone_ends_no_line(text):
    parts, error, _ = _outcome(text, [0, 1, 2])
    assert parts == []
    assert error.endswith("are not a table of numbers")


def test_long_texts_come_in_parts_and_a_malformed_row_in_a_later_one_is_named():
    rows = np.random.default_rng(0).normal(0, 100, (20_000, 3)).tolist()
    text = b"".join(b"%r %r %r\n" % tuple(row) for row in rows)
    parts, error, _ = _outcome(text, [0, 1, 2])
    assert error is None
    assert [row for part in parts for row in part] == rows
    assert len(parts) > 1
    parts, error, _ = _outcome(text + b"1 2 x\n" + text[:100], [0, 1, 2])
    assert 0 < sum(map(len, parts)) < 20_000
    assert error == "t.txt: line 20007: must be a number, got 'x'"


@pytest.mark.parametrize("start", [b"", b"#", b" "])
@pytest.mark.parametrize("length", [LONGEST_LINE, LONGEST_LINE + 1])
def test_a_line_may_be_so_long(start, length):
    text = b"1 2 3\n" + start + b"4 5 6".rjust(length - len(start) - 1) + b"\n7 8 9\n"
    parts, error, _ = _outcome(text, [0, 1, 2])
    if length > LONGEST_LINE:
        assert error == "t.txt: line 8: must not be longer than 1048576 bytes"
        return
    assert error is None
    assert sum(map(len, parts)) == (2 if start == b"#" else 3)
