import json
import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from mapdeal import MalformedInputError, MapdealWarning, read_poses
from mapdeal.grid.frame import Transform
from mapdeal.sensors import points
from mapdeal.sensors.points import read_pairs, read_points, read_pose_lines, read_transform


def rows_of(read):
    def read_rows(chunks):
        for part in read(chunks, "p.csv"):
            yield from part.rows()

    return read_rows


def named(chunks):
    for line, point, name, error in points.read_named_points(chunks, "p.csv"):
        yield line, point and [name, *point], error


POINTS, PAIRS, POSES = map(rows_of, (read_points, read_pairs, read_pose_lines))
READERS = {"points": POINTS, "named": named, "pairs": PAIRS, "poses": POSES}
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
NAME, POSE = 'with a "name" if it has one', "three numbers x,y,yaw"
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
    assert good_rows(PAIRS, head.replace(b"\n", b",c,d\n") + b"1,2,3,4") == [(line, [1, 2, 3, 4])]
    assert len(errors_of(PAIRS, b"nan,inf,1,1\n", b"1,1,a,b")) == 2


def test_a_first_line_of_json_is_no_header():
    line = b'{"x": 1, "y": 2, "yaw": 3}'
    assert good_rows(POSES, line + b"\n" + line) == [(1, [1, 2, 3]), (2, [1, 2, 3])]
    assert good_rows(POSES, line) == [(1, [1, 2, 3])]


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


@pytest.fixture
def read(tmp_path):
    def read_text(text):
        path = tmp_path / "poses.txt"
        path.write_text(text)
        return read_poses(path)

    return read_text


@pytest.mark.parametrize("separator", [" ", ",", " ; ", "\t"])
def test_x_y_and_yaw(read, separator):
    rows = [["x", "y", "yaw"], ["1", "-2.5", "0.25"], ["1e1", "0", "-3"]]
    text = "# a comment\n\n" + "".join(separator.join(row) + "\n" for row in rows)
    assert read(text).tolist() == [[1.0, -2.5, 0.25], [10.0, 0.0, -3.0]]


@given(yaw=st.floats(-math.pi, math.pi), x=st.floats(-9, 9), y=st.floats(-9, 9))
def test_tum_s_quaternions_about_the_vertical(tmp_path_factory, yaw, x, y):
    path = tmp_path_factory.mktemp("poses") / "p.txt"
    quaternion = f"0 0 {math.sin(yaw / 2)!r} {math.cos(yaw / 2)!r}"
    path.write_text(f"1700000000123456789 {x!r} {y!r} 3 {quaternion}\n")
    (pose,) = read_poses(path)
    assert pose[:2].tolist() == [x, y]
    assert math.cos(pose[2] - yaw) > 1 - 1e-12


def test_the_heading_of_a_robot_that_leans(read):
    """The rotation is 0.3 about the vertical, then 0.1 about the robot's y axis."""
    (a, b), (c, d) = ((math.sin(v / 2), math.cos(v / 2)) for v in (0.3, 0.1))
    (pose,) = read(f"0 1 2 3 {-a * c} {b * c} {a * d} {b * d}\n")
    np.testing.assert_allclose(pose, [1.0, 2.0, 0.3], atol=1e-15)


def test_unusual_poses_give_one_warning_of_each_kind(read):
    with pytest.warns(MapdealWarning, match="2 of 3 poses, the first of them pose 2.*degrees"):
        poses = read("0 0 0\n0 0 90\n0 0 -180\n")
    assert np.cos(poses[:, 2] - [0, 90, -180]) == pytest.approx(1.0)
    assert np.abs(poses[:, 2]).max() <= math.pi
    with pytest.warns(MapdealWarning, match="time"):
        read("1 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n2 0 0 0 0 0 0 1\n")
    with pytest.warns(MapdealWarning, match="not of length 1"):
        (pose,) = read("0 1 2 3 0 0 2 2\n")
    assert pose.tolist() == [1.0, 2.0, pytest.approx(math.pi / 2)]
    with pytest.warns(MapdealWarning, match="leans"):
        read("0 1 2 3 0.2 0 0 0.9797958971132712\n")


@pytest.mark.parametrize("time", ["0", "-0.0", "12.5"])
def test_poses_with_a_constant_time_give_no_warning(read, time):
    poses = read("".join(f"{time} {x} 2 0 0 0 0 1\n" for x in (5, 3, 4)))  # a warning is an error
    assert poses[:, 0].tolist() == [5, 3, 4]
    far = read("-1.7e308 1 2 0 0 0 0 1\n1.7e308 3 4 0 0 0 0 1\n")
    assert far.tolist() == [[1.0, 2.0, 0.0], [3.0, 4.0, 0.0]]
    with pytest.warns(MapdealWarning, match="2 of 3 poses, the first of them pose 2.*a time"):
        read("3 5 2 0 0 0 0 1\n2 5 2 0 0 0 0 1\n1 5 2 0 0 0 0 1\n")


@pytest.mark.parametrize(("text", "place"), [
    ("1 2 3\n1 nan 3\n", "pose 2"),
    ("1 1e300 0\n", "pose 1"),
    ("0 1 2 3 0 0 0 1\nnan 1 2 3 0 0 0 1\n", "pose 2"),
    ("0 1 2 3 0 0 0 1\n0 1 2 3 0 0 0 0\n", "pose 2"),
    ("1 2\n", "line 1"),
    ("# a\n1 2 3\n1 2\n", "line 3"),
    ("1 2 3\n1 two 3\n", "line 2"),
    ("x y 1\n1 2 3\n", "line 1"),
    ("# none\n", "no poses"),
])  # fmt: skip
def test_invalid_poses_are_refused(read, text, place):
    with pytest.raises(MalformedInputError, match=place):
        read(text)


def written(folder, value):
    path = folder / "transform.json"
    path.write_text(value if isinstance(value, str) else json.dumps(value))
    return path


def test_a_transform_is_written_by_hand_or_by_align_which_says_between_which_maps(tmp_path):
    found = read_transform(written(tmp_path, {"x": 1.5, "y": -2, "yaw": 0.25}))
    assert found.transform.pose == (1.5, -2.0, 0.25)
    assert (found.first, found.second) == ({}, {})
    document = {
        "transform": points.transform_document(Transform(1.25, 2.5, math.pi / 3)),
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
