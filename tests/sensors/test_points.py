"""Points as lines of text."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapdeal import FileAccessError, MalformedInputError
from mapdeal.files.source import chunks_of
from mapdeal.sensors.points import read_named_points, read_pairs, read_points, read_pose_lines

TEXT = (
    b'x, y\n1,2\n# why\n\n1,2,3\r\n[0.5, -1]\n{"y": 4, "x": 3, "name": "a"}\n-1e-3, .5\nnan,inf\n'
)
POINTS = [(1, 2), None, None, (0.5, -1), (3, 4), (-1e-3, 0.5), (math.nan, math.inf)]
LINES = [2, 4, 5, 6, 7, 8, 9]


CUTS = st.lists(st.integers(1, 40), max_size=60)


def _cut(text, sizes):
    ends = [*itertools.accumulate([0, *sizes]), len(text)]
    return [text[start:end] for start, end in itertools.pairwise(ends)]


def _all(chunks, read=read_points):
    points, lines, errors = [], [], {}
    for part in read(chunks, "p.csv"):
        errors |= {len(points) + index: text for index, text in part.errors.items()}
        points += part.numbers.tolist()
        lines += part.lines
    return points, lines, errors


@given(CUTS)
def test_the_text_may_be_cut_anywhere(sizes):
    points, lines, errors = _all(_cut(TEXT, sizes))
    expected = [(math.nan, math.nan) if point is None else point for point in POINTS]
    assert np.array_equal(points, expected, equal_nan=True)
    assert lines == LINES
    assert sorted(errors) == [1, 2, 6]
    assert errors[6] == "must be finite, got 'nan,inf'"
    assert errors[1] == "empty line"
    assert "1,2,3" in errors[2]


@given(st.lists(st.tuples(*[st.floats(-1e9, 1e9)] * 2), min_size=1, max_size=30), st.booleans())
def test_plain_csv_is_read_exactly(points, has_crlf):
    end = "\r\n" if has_crlf else "\n"
    text = end.join(f"{x!r},{y!r}" for x, y in points).encode()
    assert _all([text])[0] == [list(point) for point in points]


@pytest.mark.parametrize(
    "line",
    ["1", "1;2", "1 2", "1,2,", ",", "a,b", "1_0,2", "\u0661,2", "[1]", "[1, 2, 3]", '{"x": 1}',
     '{"x": true, "y": 1}', '{"x": "1", "y": 1}', "[[1, 2]]", "[null, 1]", "{", "[" * 5000,
     '"1","2"', "\x00,1", "0x10,1", "\udcff,3"],
)  # fmt: skip
def test_a_line_that_is_no_point_is_told_by_its_number(line):
    text = f"5,6\n{line}\n7,8\n".encode(errors="surrogateescape")
    points, lines, errors = _all([text])
    assert (points[0], points[2]) == ([5, 6], [7, 8])
    assert lines == [1, 2, 3]
    assert list(errors) == [1]
    assert len(errors[1]) < 120


def test_an_empty_line_between_plain_ones_has_its_place():
    points, lines, errors = _all([b"1,2\n\n3,4\n \n"])
    assert (points[0], points[2]) == ([1, 2], [3, 4])
    assert lines == [1, 2, 3, 4]
    assert errors == {1: "empty line", 3: "empty line"}


def test_numbers_beyond_all_bounds_are_infinite_and_told():
    points = _all([b"1e400,2\n", b'{"x": -1e400, "y": 1}\n', b"[1" + b"0" * 400 + b", 1]\n"])
    assert points[0][0] == [math.inf, 2]
    assert points[0][1] == [-math.inf, 1]
    assert list(points[2]) == [0, 1, 2]
    assert "finite" in points[2][0]
    assert '{"x": x, "y": y}' in points[2][2]


def test_a_mark_of_byte_order_and_a_header_are_passed_over():
    assert _all([b'\xef\xbb\xbf"x","y"\n1,2'])[:2] == ([[1, 2]], [2])
    assert _all([b"\xef\xbb\xbf1,2"])[:2] == ([[1, 2]], [1])


NAMED = (
    'x,y\n1,2\n# why\nkitchen=3,4\n our = lab = -1, .5\n{"name": "Büro", "x": 5, "y": 6}\n'
    '[7, 8]\n{"x": 9, "y": 0}\n'
)


@given(CUTS)
def test_points_may_have_names_wherever_the_text_is_cut(sizes):
    found = read_named_points(_cut(NAMED.encode(), sizes), "p")
    assert [(one.line, one.name, one.point) for one in found] == [
        (2, None, (1, 2)), (4, "kitchen", (3, 4)), (5, "our = lab", (-1, 0.5)),
        (6, "Büro", (5, 6)), (7, None, (7, 8)), (8, None, (9, 0)),
    ]  # fmt: skip


@pytest.mark.parametrize(("line", "told"), [
    ("", "empty line"),
    ("kitchen", "must be x,y or NAME=x,y, got 'kitchen'"),
    ("kitchen=1", "must be x,y or NAME=x,y"),
    ("=1,2", "must be x,y or NAME=x,y"),
    ("kitchen=1,2,lab=3,4", "must be x,y or NAME=x,y"),
    ("kitchen=1,inf", "must be finite"),
    ('{"name": 5, "x": 1, "y": 2}', 'with a "name" if it has one'),
    ('{"name": " ", "x": 1, "y": 2}', 'with a "name" if it has one'),
    ('{"name": "a", "x": 1}', 'with a "name" if it has one'),
    ("[1, 2, 3]", "or [x, y]"),
])  # fmt: skip
def test_a_line_that_is_no_named_point_is_told_by_its_number(line, told):
    first, bad, last = read_named_points([f"a=5,6\n{line}\n7,8\n".encode()], "p")
    assert (first.point, first.name, last.point) == ((5, 6), "a", (7, 8))
    assert (bad.line, bad.point, bad.name) == (2, None, None)
    assert told in bad.error


@pytest.mark.parametrize("text", [b"", b"\n", b"# nothing\n", b"x,y\n"])
def test_texts_without_points(text):
    points, _, errors = _all([text] if text else [])
    assert len(points) == len(errors) == (text == b"\n")


@pytest.mark.parametrize(
    ("read", "last"), [(read_points, b"4"), (read_pairs, b"4,5,6"), (read_pose_lines, b"4,5")]
)
def test_lines_come_as_soon_as_they_are_complete(read, last):
    first = b"1,2" + last[1:]
    read_first = []

    def chunks():
        yield first + b"\n3,"
        assert read_first
        yield last + b"\n"

    parts = read(chunks(), "p")
    read_first.append(next(parts))
    assert len(list(parts)) == 1


LINES_OF_ALL_KINDS = st.sampled_from(
    [
        "1,2", "-0.5,1e3", " 3 , 4 ", "5,6\r", "# why", "  # 1,2", "", " ", "x,y", "1,2,3", "nan,1",
        "1e999,2", "[1, 2]", "1_0,2", "1 2", "7,8\r9", "1,2,0.5", "1 2 0.5", "1;2;3", "\0,1", "1,",
    ]
)  # fmt: skip


@pytest.mark.parametrize("read", [read_points, read_pose_lines])
@given(st.lists(LINES_OF_ALL_KINDS, max_size=9), st.booleans(), st.integers(1, 40))
def test_lines_are_read_alike_together_and_alone(read, lines, has_end, size):
    text = ("\n".join(lines) + "\n" * has_end).encode()

    def outcome(chunks):
        parts = list(read(chunks, "p"))
        rows = [part.numbers.tolist() for part in parts]
        numbers = [line for part in parts for line in part.lines]
        errors = [error for part in parts for error in part.errors.values()]
        return repr(([row for part in rows for row in part], numbers, errors))

    alone = outcome(text.splitlines(keepends=True))
    assert outcome([text]) == alone
    assert outcome([text[start : start + size] for start in range(0, len(text), size)]) == alone


def test_a_line_without_end_is_refused_before_it_fills_the_memory():
    def endless():
        while True:
            yield b"1" * 10_000

    with pytest.raises(MalformedInputError, match=r"p\.csv: line 1"):
        list(read_points(endless(), "p.csv"))


@pytest.mark.parametrize("size", [1000, 10**7])
@pytest.mark.parametrize("padding", [65_533, 65_534])
def test_the_limit_of_a_line_does_not_depend_on_how_it_comes(size, padding):
    text = b"1,2\n3,4\n5," + b" " * padding + b"6\n7,8\n"
    chunks = [text[start : start + size] for start in range(0, len(text), size)]
    if padding == 65_533:
        assert _all(chunks)[0] == [[1, 2], [3, 4], [5, 6], [7, 8]]
        return
    got = []
    with pytest.raises(MalformedInputError, match="line 3"):
        for part in read_points(chunks, "p"):
            got += part.numbers.tolist()
    assert got == [[1, 2], [3, 4]]


PAIRS_TEXT = (
    b'from_x, from_y, "to_x", to_y\n1,2,3,4\r\n# why\n\n1,2,3\n[[0.5, -1], [2, 1e1]]\n'
    b'{"to": {"x": 1, "y": 2}, "from": [-3, 4], "name": "a"}\n nan,1,2,3\n'
)
PAIRS = [
    (2, (1.0, 2.0), (3.0, 4.0)), (4, None, None), (5, None, None), (6, (0.5, -1.0), (2.0, 10.0)),
    (7, (-3.0, 4.0), (1.0, 2.0)), (8, None, None),
]  # fmt: skip


def _pairs(chunks):
    return list(read_pairs(chunks, "p.csv"))


@given(CUTS)
def test_a_text_of_pairs_may_be_cut_anywhere(sizes):
    pairs = _pairs(_cut(PAIRS_TEXT, sizes))
    assert [(pair.line, pair.start, pair.goal) for pair in pairs] == PAIRS
    errors = {pair.line: pair.error for pair in pairs if pair.error is not None}
    assert errors == {
        4: "empty line",
        5: "must be four numbers x,y,x,y, got '1,2,3'",
        8: "must be finite, got 'nan,1,2,3'",
    }


@pytest.mark.parametrize(
    "line",
    ["1,2", "1,2,3,4,5", "a,b,c,d", "1_0,2,3,4", "\u0661,2,3,4", "[1, 2, 3, 4]", "[[1, 2]]", "{}",
     '{"from": [1, 2]}', '{"from": [1, 2], "to": "ab"}', '{"from": [1, true], "to": [1, 2]}',
     "[[1, 2], [3, null]]", "[" * 5000, "1;2;3;4", "\x00,1,2,3"],
)  # fmt: skip
def test_a_line_that_is_no_pair_is_told_by_its_number(line):
    pairs = _pairs([f"1,2,3,4\n{line}\n5,6,7,8".encode()])
    assert [(pair.line, pair.goal) for pair in pairs] == [(1, (3, 4)), (2, None), (3, (7, 8))]
    assert pairs[1].error.startswith("must be ")
    assert len(pairs[1].error) < 150


@pytest.mark.parametrize("line", ["x,y,x,y", "\ufeffa,b,c,d", '"x0","y0","x1","y1"'])
def test_the_first_line_may_be_four_words(line):
    assert [pair.line for pair in _pairs([f"{line}\n1,2,3,4\n".encode()])] == [2]
    assert [pair.error is None for pair in _pairs([b"nan,inf,1,1\n", b"1,1,a,b"])] == [False] * 2


def test_a_line_of_pairs_without_end_is_refused():
    with pytest.raises(MalformedInputError, match=r"p\.csv: line 2"):
        _pairs([b"1,2,3,4\n", b"1" * 70_000])


def test_files_that_cannot_be_read(tmp_path):
    for path in (tmp_path / "none", tmp_path):
        with pytest.raises(FileAccessError, match="cannot be read"):
            list(chunks_of(path))
    (tmp_path / "p").write_bytes(TEXT * 30_000)
    assert b"".join(chunks_of(tmp_path / "p")) == TEXT * 30_000


POSES = (
    b'x, y, theta\n1,2,3\n# why\n\n1 2 -3e-1\r\n7;8;9\n[0.5, -1, 2]\n{"yaw": 5, "y": 4, "x": 3}\n'
    b"1,2\nnan,1,2\n100 1 2 9 0 0 0.6 0.8\n"
)
POSE_ROWS = [
    (1, 2, 3), None, (1, 2, -0.3), (7, 8, 9), (0.5, -1, 2), (3, 4, 5), None, (math.nan, 1, 2),
    (1, 2, 2 * math.atan2(0.6, 0.8)),
]  # fmt: skip


@given(CUTS)
def test_poses_come_in_all_forms_and_may_be_cut_anywhere(sizes):
    rows, lines, errors = _all(_cut(POSES, sizes), read_pose_lines)
    assert lines == [2, 4, 5, 6, 7, 8, 9, 10, 11]
    for row, expected in zip(rows, POSE_ROWS, strict=True):
        assert row == pytest.approx(expected or [math.nan] * 3, abs=1e-15, nan_ok=True)
    assert errors == {
        1: "empty line",
        6: "must be three numbers x,y,yaw, or TUM's t x y z qx qy qz qw, got '1,2'",
        7: "must be finite, got 'nan,1,2'",
    }


@pytest.mark.parametrize("between", [",", " ", "\t", " , "])
def test_plain_poses_are_read_exactly_whatever_is_between(between):
    rows = [[0.1, -2e-7, 3.141592653589793], [1e9, 2.0, -0.0]]
    text = "\n".join(between.join(map(repr, row)) for row in rows).encode()
    assert _all([text], read_pose_lines)[0] == rows


@pytest.mark.parametrize(("line", "rule"), [
    ("1 2 3 4", "three numbers x,y,yaw"),
    ("1,2,", "three numbers"),
    ("1_0,2,3", "three numbers"),
    ("[1, 2]", 'must be {"x": x, "y": y, "yaw": yaw} or [x, y, yaw], got'),
    ('{"x": 1, "y": 2}', "yaw"),
    ("[1, 2, true]", "[x, y, yaw]"),
    ("5 1 2 0 0 0 0 0", "the quaternion must be of length 1, got '5 1 2 0 0 0 0 0'"),
    ("5 1 2 0 0.6 0 0 0.8", "leans by more than 10 degrees; w must come last"),
    ("5 1 2 0 1 0 0 0", "w must come last"),
    ("5 1 2 0 nan 0 0 1", "must be finite"),
    ("5 inf 2 0 0 0 0 1", "must be finite"),
])  # fmt: skip
def test_a_line_that_is_no_pose_is_told_by_its_number(line, rule):
    rows, lines, errors = _all([f"5,6,0\n{line}\n7,8,0\n".encode()], read_pose_lines)
    assert lines == [1, 2, 3]
    assert list(errors) == [1]
    assert rule in errors[1]
    assert not math.isfinite(sum(rows[1]))
    assert rows[::2] == [[5, 6, 0], [7, 8, 0]]


def test_quaternions_of_two_decimals_will_do():
    (row,), _, errors = _all([b"5 1 2 0 0 0 0.71 0.71\n"], read_pose_lines)
    assert (row, errors) == (pytest.approx([1, 2, math.pi / 2]), {})
