"""Numbers in text, beside Python's float()."""

import math
import struct

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from engines import needs_compiled
from mapdeal.kernels import engine
from mapdeal.kernels.numbers import Limits, numbers_in, rows_in, whole_numbers_in

pytestmark = needs_compiled


@pytest.fixture(scope="module", autouse=True)
def compiled_engine():
    """What is tested is the scanner, also where all other tests run on its twin."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(engine.VARIABLE, "compiled")
        yield


def _bits(number):
    return struct.pack("<d", number)


def _read(word):
    """Return what a line with one word is read as, None if it is refused."""
    rows = rows_in(word.encode(), 1, delimiter=",", is_exact=True)
    return None if rows is None or rows.values.shape != (1, 1) else float(rows.values[0, 0])


def _is_read_as_float_does(word):
    value = _read(word)
    assert value is not None
    assert _bits(value) == _bits(float(word))


DIGITS = st.text("0123456789", min_size=1, max_size=25)


@given(st.floats(allow_nan=False))
def test_every_double_is_read_from_its_repr(number):
    _is_read_as_float_does(repr(number))


@given(st.floats(allow_nan=False, allow_infinity=False), st.integers(0, 25), st.sampled_from("efg"))
def test_every_format_of_a_double_is_read_to_the_last_bit(number, digits, letter):
    _is_read_as_float_does(f"{number:.{digits}{letter}}"[:380])


@given(
    st.sampled_from(["", "+", "-"]),
    DIGITS,
    st.none() | st.text("0123456789", max_size=25),
    st.none() | st.integers(-400, 400),
    st.sampled_from(["e", "E", "e+", "e0"]),
)
@example("", "9007199254740993", None, None, "e")
@example("", "9007199254740992", "5", None, "e")
@example("", "9007199254740993", "", 19, "e")
@example("", "18446744073709551615", None, -19, "e")
@example("", "5", None, -324, "e")
@example("", "2", "4703282292062327208", -324, "e")
@example("-", "0", "0", 400, "e")
@example("", "1", "7976931348623159", 308, "e")
def test_any_digits_and_exponents_are_read_as_float_reads_them(sign, whole, part, power, mark):
    word = sign + whole
    if part is not None:
        word += "." + part
    if power is not None:
        mark = mark if power >= 0 else "e"
        word += f"{mark}{power}"
    _is_read_as_float_does(word)


@given(st.integers(1 << 52, (1 << 53) - 1), st.integers(0, 19))
def test_halfway_cases_go_to_the_even_double(mantissa, places):
    # halfway between two doubles, as the quotient of a whole number of up to 64 bits if it fits
    half = 2 * mantissa + 1
    for digits in (half, half * 5**4, half * 5**4 - 1, half * 5**4 + 1):
        _is_read_as_float_does(f"{digits}e-{places}")


@pytest.mark.parametrize("word", ["nan", "NaN", "inf", "-INF", "+inf", ".5", "5.", "-.5e1", "1e5"])
def test_plain_words_of_floats_are_taken(word):
    _is_read_as_float_does(word)


@pytest.mark.parametrize(
    "word",
    [
        "infinity", "-nan", "1_0", "\u0661", "\uff11", "0x10", "1e", "1e+", ".", "-", "+-1",
        "1d5", "e5", "--1", "1.2.3", "in", "na", "1\x00", "1\x0b", "\x0c1", "1\r1", "1 2", "1,2",
        "1" * 401,
    ],
)  # fmt: skip
def test_what_is_not_plain_is_refused(word):
    assert _read(word) is None


@given(st.text("0123456789+-.eEinfa_x \t\r#,", max_size=12))
def test_nothing_is_taken_that_float_refuses_or_reads_otherwise(word):
    value = _read(word)
    if value is not None:
        assert _bits(value) == _bits(float(word.strip()))


TABLE = st.lists(
    st.lists(st.floats(-1e9, 1e9) | st.integers(-99, 99), min_size=3, max_size=3), max_size=8
)


@given(TABLE, st.sampled_from([None, ",", ";"]), st.sampled_from(["\n", "\r\n"]), st.booleans())
def test_rows_are_those_of_the_text(table, delimiter, end, has_last_end):
    mark = {None: " \t ", ",": ", ", ";": ";"}[delimiter]
    lines = [mark.join(map(repr, row)) for row in table]
    text = end.join(["# head", "", *lines]) + (end if has_last_end else "")
    rows = rows_in(text.encode(), 3, delimiter=delimiter, is_exact=True)
    assert rows is not None
    assert rows.values.tolist() == table
    assert rows.lines == len(lines) + 2 - (not lines and not has_last_end)
    assert rows.length == len(text)


@given(TABLE, st.integers(0, 9), st.integers(1, 60))
def test_reading_stops_behind_the_line_that_reaches_a_limit(table, lines, length):
    text = b"".join(b"%r %r %r\n" % tuple(row) for row in table)
    rows = rows_in(text, 3, delimiter=None, is_exact=True, limits=Limits(lines, length))
    assert rows is not None
    ends = np.cumsum([len(line) for line in text.splitlines(keepends=True)])
    expected = min(lines, int(np.searchsorted(ends, length)) + 1, len(table))
    assert (rows.lines, len(rows.values)) == (expected, expected)
    assert rows.length == ([0, *ends.tolist()])[expected]


@pytest.mark.parametrize("rest", ["", " 4", "\t4 5", " word #!", ' "a"'])
def test_more_than_the_columns_may_follow_if_it_is_plain(rest):
    text = f"1 2 3{rest}\n".encode()
    loose = rows_in(text, 3, delimiter=None, is_exact=False)
    exact = rows_in(text, 3, delimiter=None, is_exact=True)
    assert loose is not None
    assert loose.values.tolist() == [[1, 2, 3]]
    assert (exact is None) == bool(rest)


@pytest.mark.parametrize(
    "line", [b"1 2 3\r4\n", b"1 2 3 \xff\n", b"1 2 3 \0\n", b"1 2 3x\n", b"1 2"]
)
def test_a_line_that_others_may_refuse_is_refused(line):
    assert rows_in(b"1 2 3\n" + line, 3, delimiter=None, is_exact=False) is None


def test_a_line_that_is_too_long_is_refused_whatever_it_is():
    limits = Limits(longest_line=8)
    for line in (b"1 2    \n", b"#      \n", b"       \n"):
        assert rows_in(line, 2, delimiter=None, is_exact=True, limits=limits) is not None
        assert rows_in(b" " + line, 2, delimiter=None, is_exact=True, limits=limits) is None


@given(st.lists(st.floats(allow_nan=False), min_size=1, max_size=9))
def test_numbers_within_a_text_end_where_the_last_does(numbers):
    body = " ".join(map(repr, numbers)).encode()
    found = numbers_in(b"scan " + body + b" end", 4, len(numbers))
    assert found is not None
    assert (found[0].tolist(), found[1]) == (numbers, 5 + len(body))
    assert numbers_in(body, 0, len(numbers) + 1) is None


@given(st.lists(st.integers(0, 999_999_999)), st.sampled_from([" ", "\n", "\t\v\f\r "]))
def test_whole_numbers_are_read(numbers, blank):
    found = whole_numbers_in(blank.join(map(str, numbers)).encode())
    assert found is not None
    assert found.tolist() == numbers


@pytest.mark.parametrize("word", [b"-1", b"+1", b"1.", b"1234567890", b"1_0", b"\xb2", b"1\0"])
def test_other_words_than_whole_numbers_are_refused(word):
    assert whole_numbers_in(b"1 " + word + b" 2") is None


def test_nothing_is_read_without_compiled_code(monkeypatch):
    monkeypatch.setenv(engine.VARIABLE, "scipy")
    assert numbers_in(b"1", 0, 1) is None
    assert rows_in(b"1\n", 1, delimiter=None, is_exact=True) is None
    assert whole_numbers_in(b"1") is None


def test_a_nan_is_a_nan():
    value = _read("nan")
    assert value is not None
    assert math.isnan(value)
