"""Points, named points, pairs and poses as lines of text."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapdeal import MalformedInputError
from mapdeal.sensors.points import read_named_points, read_pairs, read_points, read_pose_lines


def rows_of(read):
    def read_rows(chunks):
        for part in read(chunks, "p.csv"):
            rows = zip(part.lines, part.numbers.tolist(), strict=True)
            for index, (line, row) in enumerate(rows):
                yield line, row, part.errors.get(index)

    return read_rows


def named(chunks):
    for parsed in read_named_points(chunks, "p.csv"):
        yield parsed.line, parsed.point and [parsed.name, *parsed.point], parsed.error


def pairs(chunks):
    for parsed in read_pairs(chunks, "p.csv"):
        yield parsed.line, parsed.start and [*parsed.start, *parsed.goal], parsed.error


POINTS, POSES = rows_of(read_points), rows_of(read_pose_lines)
READERS = {"points": POINTS, "named": named, "pairs": pairs, "poses": POSES}
every_kind = pytest.mark.parametrize("kind", READERS)


def errors_of(read, *chunks):
    return {line: error for line, _, error in read(chunks) if error is not None}


def good_rows(read, *chunks):
    return [(line, row) for line, row, error in read(chunks) if error is None]


# A text, its valid rows by line number, and the errors of the other lines.
TEXTS = {
    "points": (
        ('x, y\n1,2\n# why\n\n1,2,3\r\n[0.5, -1]\n{"y": 4, "x": 3, "name": "a"}\n-1e-3, .5\n'
        "nan,inf\n"),
        {2: [1, 2], 6: [0.5, -1], 7: [3, 4], 8: [-1e-3, 0.5]},
        {4: "empty line", 5: "must be two numbers x,y, got '1,2,3'",
         9: "must be finite, got 'nan,inf'"},
    ),
    "named": (
        ('name,x,y\n1,2\n# why\nkitchen,3,4\n our = lab = -1, .5\n'
         '{"name": "Büro", "x": 5, "y": 6}\n'
        '[7, 8]\n{"x": 9, "y": 0}\n\n'),
        {2: [None, 1, 2], 4: ["kitchen", 3, 4], 5: ["our = lab", -1, 0.5], 6: ["Büro", 5, 6],
         7: [None, 7, 8], 8: [None, 9, 0]},
        {9: "empty line"},
    ),
    "pairs": (
        ('from_x, from_y, "to_x", to_y\n1,2,3,4\r\n# why\n\n1,2,3\n[[0.5, -1], [2, 1e1]]\n'
        '{"to": {"x": 1, "y": 2}, "from": [-3, 4], "name": "a"}\n nan,1,2,3\n'
        '{"start": {"x": 5, "y": 6}, "goal": [7, 8]}\n'),
        {2: [1, 2, 3, 4], 6: [0.5, -1, 2, 10], 7: [-3, 4, 1, 2], 9: [5, 6, 7, 8]},
        {4: "empty line", 5: "must be four numbers x,y,x,y, got '1,2,3'",
         8: "must be finite, got 'nan,1,2,3'"},
    ),
    "poses": (
        ('x, y, theta\n1,2,3\n# why\n\n1 2 -3e-1\r\n7;8;9\n[0.5, -1, 2]\n'
        '{"yaw": 5, "y": 4, "x": 3}\n1,2\nnan,1,2\n100 1 2 9 0 0 0.6 0.8\n5 1 2 0 0 0 0.71 0.71\n'),
        {2: [1, 2, 3], 5: [1, 2, -0.3], 6: [7, 8, 9], 7: [0.5, -1, 2], 8: [3, 4, 5],
         11: [1, 2, 2 * math.atan2(0.6, 0.8)], 12: [1, 2, math.pi / 2]},
        {4: "empty line",
         9: "must be three numbers x,y,yaw, or TUM's t x y z qx qy qz qw, got '1,2'",
         10: "must be finite, got 'nan,1,2'"},
    ),
}  # fmt: skip


@every_kind
@pytest.mark.parametrize("size", [1, 2, 7, 30, 1000])
def test_a_text_is_read_wherever_it_is_cut(kind, size):
    text, rows, errors = TEXTS[kind]
    data = text.encode()
    chunks = [data[start : start + size] for start in range(0, len(data), size)]
    found = dict(good_rows(READERS[kind], *chunks))
    assert list(found) == list(rows)
    for line, row in rows.items():
        names = len(row) - sum(isinstance(value, (int, float)) for value in row)
        assert found[line][:names] == row[:names]
        assert found[line][names:] == pytest.approx(row[names:], abs=1e-15)
    assert errors_of(READERS[kind], *chunks) == errors


LINES_OF_ALL_KINDS = st.sampled_from(
    [
        "1,2", "-0.5,1e3", " 3 , 4 ", "5,6\r", "# why", "  # 1,2", "", " ", "x,y", "1,2,3", "nan,1",
        "1e999,2", "[1, 2]", "1_0,2", "1 2", "7,8\r9", "1,2,0.5", "1 2 0.5", "1;2;3", "\0,1", "1,",
        "1,2,3,4", "[[1, 2], [3, 4]]", "a,b,c,d", "a=1,2", '{"x": 1, "y": 2}',
    ]
)  # fmt: skip


@every_kind
@given(st.lists(LINES_OF_ALL_KINDS, max_size=9), st.booleans(), st.integers(1, 40))
def test_lines_are_read_alike_together_and_alone(kind, lines, has_end, size):
    text, read = ("\n".join(lines) + "\n" * has_end).encode(), READERS[kind]
    by_line = repr(list(read(text.splitlines(keepends=True))))
    assert repr(list(read([text]))) == by_line
    chunks = [text[start : start + size] for start in range(0, len(text), size)]
    assert repr(list(read(chunks))) == by_line


@given(st.lists(st.tuples(*[st.floats(-1e9, 1e9)] * 3), min_size=1, max_size=30), st.booleans())
def test_plain_numbers_are_read_exactly(rows, has_crlf):
    end = "\r\n" if has_crlf else "\n"
    text = end.join(f"{x!r},{y!r}" for x, y, _ in rows).encode()
    assert [row for _, row in good_rows(POINTS, text)] == [[x, y] for x, y, _ in rows]
    for delimiter in (",", " ", "\t", " , "):
        text = end.join(delimiter.join(map(repr, row)) for row in rows).encode()
        assert [row for _, row in good_rows(POSES, text)] == [list(row) for row in rows]


GOOD_LINES = {"points": "5,6", "named": "a=5,6", "pairs": "5,6,7,8", "poses": "5,6,0"}
NAME = 'with a "name" if it has one'
POSE = "three numbers x,y,yaw"
BAD_LINES = [
    *[("points", line, "") for line in (
        "1;2", "1,2,", "1_0,2", "\u0661,2", '{"x": true, "y": 1}', "[null, 1]", "[" * 5000,
        '"1","2"', "0x10,1", "\udcff,3")],
    ("points", "1e400,2", "must be finite"),
    ("points", "[1" + "0" * 400 + ", 1]", '{"x": x, "y": y}'),
    ("named", "kitchen", "must be x,y, NAME,x,y or NAME=x,y, got 'kitchen'"),
    ("named", "=1,2", "must be x,y, NAME,x,y or NAME=x,y"),
    ("named", "1,2,3", "must be x,y, NAME,x,y or NAME=x,y, got '1,2,3'"),
    ("named", '{"name": " ", "x": 1, "y": 2}', NAME),
    ("named", '{"name": "a", "x": 1}', NAME),
    ("named", "[1, 2, 3]", "or [x, y]"),
    *[("pairs", line, "must be ") for line in (
        "1,2,3,4,5", "[1, 2, 3, 4]", '{"from": [1, 2]}', '{"from": [1, true], "to": [1, 2]}',
        "[[1, 2], [3, null]]", "[" * 5000)],
    ("poses", "1 2 3 4", POSE),
    ("poses", "[1, 2]", 'must be {"x": x, "y": y, "yaw": yaw} or [x, y, yaw], got'),
    ("poses", "[1, 2, true]", "[x, y, yaw]"),
    ("poses", "5 1 2 0 0 0 0 0", "the quaternion must be of length 1, got '5 1 2 0 0 0 0 0'"),
    ("poses", "5 1 2 0 0.6 0 0 0.8", "leans by more than 10 degrees; w must come last"),
    ("poses", "5 1 2 0 nan 0 0 1", "must be finite"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "line", "error"), BAD_LINES, ids=lambda value: ascii(value)[:30].replace("\\", "")
)
def test_a_bad_line_is_an_error_with_its_number(kind, line, error):
    good = GOOD_LINES[kind]
    text = f"{good}\n{line}\n{good}\n".encode(errors="surrogateescape")
    assert [number for number, _ in good_rows(READERS[kind], text)] == [1, 3]
    errors = errors_of(READERS[kind], text)
    assert list(errors) == [2]
    _, (_, row, _), _ = READERS[kind]([text])
    assert row is None or not math.isfinite(sum(row))
    assert error in errors[2]
    assert len(errors[2]) < 150


@pytest.mark.parametrize("head", [b"", b"\xef\xbb\xbf", b'\xef\xbb\xbf"a","b"\n', b"a,b\n"])
def test_a_mark_of_byte_order_and_a_header_are_passed_over(head):
    line = 1 + head.count(b"\n")
    assert good_rows(POINTS, head + b"1,2") == [(line, [1, 2])]
    assert good_rows(pairs, head.replace(b"\n", b",c,d\n") + b"1,2,3,4") == [(line, [1, 2, 3, 4])]
    assert len(errors_of(pairs, b"nan,inf,1,1\n", b"1,1,a,b")) == 2


@pytest.mark.parametrize("text", [b"", b"\n", b"# nothing\n", b"x,y\n"])
def test_texts_without_points(text):
    found = [error for *_, error in POINTS([text] if text else [])]
    assert found == ["empty line"] * (text == b"\n")


@pytest.mark.parametrize(
    ("read", "last"), [(read_points, b"4"), (read_pairs, b"4,5,6"), (read_pose_lines, b"4,5")]
)
def test_lines_come_as_soon_as_they_are_complete(read, last):
    read_first = []

    def chunks():
        yield b"1,2" + last[1:] + b"\n3,"
        assert read_first
        yield last + b"\n"

    parts = read(chunks(), "p")
    read_first.append(next(parts))
    assert len(list(parts)) == 1


@pytest.mark.parametrize("kind", ["points", "pairs"])
def test_a_line_without_end_is_refused_before_it_fills_the_memory(kind):
    def endless():
        yield GOOD_LINES[kind].encode() + b"\n"
        while True:
            yield b"1" * 10_000

    with pytest.raises(MalformedInputError, match=r"p\.csv: line 2"):
        list(READERS[kind](endless()))
