"""Points, pairs of points and poses in lines of text, CSV or JSON, which may be streamed."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from mapdeal.errors import MalformedInputError, MapdealError, emit_warning, shown
from mapdeal.files import json_values, source as sources, text as texts
from mapdeal.grid.frame import FARTHEST, Point, Transform
from mapdeal.kernels.arrays import Floats, Integers, Mask
from mapdeal.maps.kinds import NUMBERS, POSES, recognised


class TransformFile(NamedTuple):
    transform: Transform
    first: Mapping[str, str]
    second: Mapping[str, str]


def transform_document(transform: Transform) -> dict[str, Any]:
    degrees = round(math.degrees(transform.yaw), 9)
    return {"x": transform.x, "y": transform.y, "yaw": transform.yaw, "yaw_deg": degrees}


def read_transform(path: Path) -> TransformFile:
    # The file was written by ``mapdeal align``, or by hand: an object with x, y (metres) and yaw
    # (radians).
    document = json_values.read_document(path)
    nested = document.get("transform")
    entries = document if nested is None else nested
    same_place, chosen_by = (document.get(key) for key in ("same_place", "chosen_by"))
    is_chosen = chosen_by is not None and chosen_by.value == "user"
    if same_place is not None and not same_place.flag() and not is_chosen:
        emit_warning(f"{path}: align was uncertain about this transform; it is used as it is")
    transform = Transform(*(entries[key].number() for key in ("x", "y", "yaw")))
    return TransformFile(transform, *(_checksums(document.get(key)) for key in ("first", "second")))


def _checksums(document: json_values.JsonValue | None) -> dict[str, str]:
    sums = None if document is None or document.is_null else document.get("sha256")
    return {} if sums is None else {key: value.sha256() for key, value in sums.fields().items()}


TUM = ("t", "x", "y", "z", "qx", "qy", "qz", "qw")  # columns in files of the TUM benchmark tools
_PLANAR, _TUM = 3, len(TUM)
_LENGTH_TOLERANCE = 1e-3  # tolerance of the length of a quaternion: files contain rounded numbers
_MOST_LENGTH_ERROR = 1e-2  # quaternions beyond are refused; two decimals suffice
_MOST_TILT = math.radians(10)  # largest tilt of a robot at which its heading is still meaningful
_LATEST = 9e9  # seconds; larger times are in other units
_COPIES = 5  # peak memory, relative to the size of the numbers
_TILTED = "a robot that leans by more than 10 degrees; does w come last?"


def read_poses(path: Path | str) -> Floats:
    """Read the poses in a text file.

    Parameters
    ----------
    path : path or str
        Text file with one pose per line: ``x y yaw`` in metres and radians, or, in the format of
        the TUM benchmark tools, ``t x y z qx qy qz qw``. Numbers are separated by white space,
        commas or semicolons; lines that begin with # and a line of column names are skipped.

    Returns
    -------
    numpy.ndarray of float64, shape (N, 3)
        x, y (metres) and yaw (radians), for a quaternion that of its x axis in the plane.

    Raises
    ------
    FileAccessError
        If the file cannot be read.
    MalformedInputError
        If a line has the wrong number of values, a value is not finite, or a quaternion is zero.

    Warns
    -----
    MapdealWarning
        If a quaternion is not of length 1, a pose leans, a yaw exceeds a turn, or times repeat.
    """
    path = Path(path)
    with recognised(path, "a file of poses", POSES, NUMBERS):
        return _planar_poses(_rows_in(path), path)


def has_times(path: Path) -> bool:
    with suppress(MapdealError, OSError), path.open("rb") as file:
        _, _, line = texts.first_line(file)
        return len(line.split(texts.delimiter_of(line))) == _TUM
    return False


class Trajectory(NamedTuple):
    times: Integers
    translations: Floats
    quaternions: Floats


def read_trajectory(path: Path | str) -> Trajectory:
    path = Path(path)
    with recognised(path, "a file of poses", POSES, NUMBERS):
        rows = _rows_in(path)
        if rows.shape[1] != _TUM:
            rule = "has poses without times; scans of a bag need t x y z qx qy qz qw"
            raise MalformedInputError(rule, source=path)
        _planar_poses(rows, path)  # for its errors and warnings
    times = rows[:, 0]
    if not (np.abs(times) < _LATEST).all():
        rule = f"must be seconds, below {_LATEST:g}"
        raise MalformedInputError(rule, source=path, place="t", got=times[np.argmax(np.abs(times))])
    seconds = np.floor(times)
    fractions = np.rint((times - seconds) * 1e9)
    nanoseconds = seconds.astype(np.int64) * 10**9 + fractions.astype(np.int64)
    return Trajectory(nanoseconds, rows[:, 1:4], rows[:, 4:])


def planar_pose(numbers: Sequence[float]) -> tuple[float, float, float]:
    """Return x, y and yaw of a pose in the format of TUM's tools."""
    _, x, y, _, *quaternion = numbers
    length = math.hypot(*quaternion)
    if not math.isfinite(length):
        return x, y, math.nan
    if abs(length - 1) > _MOST_LENGTH_ERROR:
        raise MalformedInputError("the quaternion must be of length 1")
    qx, qy, qz, qw = (part / length for part in quaternion)
    if 1 - 2 * (qx * qx + qy * qy) < math.cos(_MOST_TILT):
        raise MalformedInputError("the robot leans by more than 10 degrees; w must come last")
    return x, y, math.atan2(2 * (qw * qz + qx * qy), 1 - 2 * (qy * qy + qz * qz))


def _rows_in(path: Path) -> Floats:
    is_pipe = not sources.is_regular(path)  # which may be endless
    most = sources.LONGEST_STREAM if is_pipe else sources.LARGEST_FILE
    file = io.BytesIO(sources.joined(sources.chunks_of(path), limit=most, source=path))
    number, start, line = texts.first_line(file)
    delimiter = texts.delimiter_of(line)
    width = len(line.split(delimiter))
    if line and width not in (_PLANAR, _TUM):
        rule = "must be x y yaw, or t x y z qx qy qz qw"
        raise MalformedInputError(rule, source=path, place=f"line {number}", got=line)
    if line and not any(map(texts.is_number, line.split(delimiter))):
        number += 1  # the names of the columns
    else:
        file.seek(start)
    table = read_table(file, path, number, delimiter, width, total=file.getbuffer().nbytes)
    if table is None:
        raise MalformedInputError("holds no poses", source=path)
    return table


def read_table(
    file: BinaryIO, path: Path, line: int, delimiter: str | None, width: int, *, total: int = 0
) -> Floats | None:
    parts = []
    for part in texts.read_rows(
        file, range(width), path=path, first_line=line, delimiter=delimiter, width=width
    ):
        total += _COPIES * part.nbytes
        sources.claim(path, total + sources.PIECES)
        parts.append(part)
    return np.concatenate(parts) if parts else None


def _planar_poses(rows: Floats, path: Path) -> Floats:
    width = rows.shape[1]
    values = rows if width == _PLANAR else rows[:, 1:]  # times may be in nanoseconds
    is_good = (np.abs(values) <= FARTHEST).all(axis=1) & np.isfinite(rows[:, 0])  # refuses nan too
    if not is_good.all():
        first = int(np.argmin(is_good))
        rule, got = f"must be finite numbers within {FARTHEST:g}", rows[first].tolist()
        raise MalformedInputError(rule, source=path, place=f"pose {first + 1}", got=got)
    if width == _PLANAR:
        is_odd = np.abs(rows[:, 2]) > 2 * math.pi
        _warn_of(is_odd, "a yaw of more than a turn; is it in degrees?", path)
        turns = np.where(is_odd, np.round(rows[:, 2] / (2 * math.pi)), 0.0)
        return np.column_stack([rows[:, :2], rows[:, 2] - turns * 2 * math.pi])
    lengths = np.linalg.norm(rows[:, 4:], axis=1)
    if not lengths.all():
        place = f"pose {int(np.argmin(lengths)) + 1}"
        raise MalformedInputError("the quaternion is zero", source=path, place=place)
    _warn_of(np.abs(lengths - 1) > _LENGTH_TOLERANCE, "a quaternion that is not of length 1", path)
    x, y, z, w = (rows[:, 4:] / lengths[:, np.newaxis]).T
    upright = 1 - 2 * (x * x + y * y)  # the cosine of the angle between both z axes
    _warn_of(upright < math.cos(_MOST_TILT), _TILTED, path)
    times = rows[:, 0]
    if (times != times[0]).any():  # a constant time, usually 0, means that times are missing
        is_late = np.concatenate([[False], times[1:] <= times[:-1]])
        _warn_of(is_late, "a time that is not after the last", path)
    headings = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return np.column_stack([rows[:, 1:3], headings])


def _warn_of(mask: Mask, fault: str, path: Path) -> None:
    if count := int(np.count_nonzero(mask)):
        which = f"{count} of {len(mask)} poses, the first of them pose {int(np.argmax(mask)) + 1}"
        emit_warning(f"{path}: {which}, have {fault}")


_LONGEST_LINE = 1 << 16
_LINE_FEED = ord("\n")


class NumberLines(NamedTuple):
    """Numbers in lines: shape (N, 2) for points, (N, 3) for poses, (N, 4) or (N, 6) for pairs."""

    numbers: Floats
    lines: Sequence[int]
    errors: dict[int, str]

    def rows(self) -> Iterator[tuple[int, list[float], str | None]]:
        for index, row in enumerate(self.numbers.tolist()):
            yield self.lines[index], row, self.errors.get(index)


class _LineFormat(NamedTuple):
    """Format of a line: its columns, and descriptions of its plain and its JSON form."""

    names: tuple[str, ...]
    plain: str
    json: str
    allows_tum: bool = False

    def delimiter(self, text: str) -> str | None:
        return texts.delimiter_of(text) if self.allows_tum else ","

    def is_header(self, text: str) -> bool:
        words = [word.strip(' "') for word in text.lower().split(self.delimiter(text))]
        if self.allows_tum:  # any names count, such as theta for yaw
            is_wide = len(words) in (len(self.names), len(TUM))
            return is_wide and not _is_json(text) and not any(map(texts.is_number, words))
        if self is _PAIR:
            are_names = all(word.isidentifier() for word in words)
            return are_names and len(words) == 4 and not {"nan", "inf", "infinity"} & set(words)
        return words == [*self.names] or (self is _NAMED_POINT and words == ["name", *self.names])


_POINT = _LineFormat(("x", "y"), "two numbers x,y", '{"x": x, "y": y} or [x, y]')
_POSE = _LineFormat(
    ("x", "y", "yaw"), f"three numbers x,y,yaw, or TUM's {' '.join(TUM)}",
    '{"x": x, "y": y, "yaw": yaw} or [x, y, yaw]', allows_tum=True,
)  # fmt: skip
_PAIR = _LineFormat(
    ("x", "y", "x", "y"), "four numbers x,y,x,y",
    '{"start": {"x": x, "y": y}, "goal": {"x": x, "y": y}} or [[x, y], [x, y]]',
)  # fmt: skip
_POSE_PAIR = _LineFormat(
    ("x", "y", "yaw", "goal_x", "goal_y", "goal_yaw"), "six numbers x,y,yaw,x,y,yaw",
    "[x, y, yaw, x, y, yaw]",
)  # fmt: skip
_NAMED_POINT = _LineFormat(
    ("x", "y"), "x,y, NAME,x,y or NAME=x,y",
    '{"x": x, "y": y}, with a "name" if it has one, or [x, y]',
)  # fmt: skip


def _read_numbers(
    form: _LineFormat, chunks: Iterable[bytes], source: Path | str
) -> Iterator[NumberLines]:
    """Yield the numbers in a text, for each chunk those of the lines that it completes."""
    for text, first in _complete_lines(chunks, source):
        yield _parse_lines(text, first, form)


read_points = partial(_read_numbers, _POINT)
read_pose_lines = partial(_read_numbers, _POSE)
read_pairs = partial(_read_numbers, _PAIR)
read_pose_pairs = partial(_read_numbers, _POSE_PAIR)


def read_named_points(
    chunks: Iterable[bytes], source: Path | str
) -> Iterator[tuple[int, Point | None, str | None, str | None]]:
    """Yield the number of each line, its point, the name of that if it has one, and its error."""
    for block, first in _complete_lines(chunks, source):
        for number, text in _numbered(block, first, _NAMED_POINT):
            parsed, error = _parse_line(text, _named_point_of, _NAMED_POINT)
            point, name = parsed if error is None else (None, None)
            yield number, point, name, error


def _numbered(text: bytes, first: int, form: _LineFormat) -> Iterator[tuple[int, str]]:
    """Yield number and text of the lines, except comments and a header in the first line."""
    for number, raw in enumerate(text.split(b"\n"), first):
        line = _text_of(raw)
        if not (line.startswith("#") or (number == 1 and form.is_header(line))):
            yield number, line


def _complete_lines(chunks: Iterable[bytes], source: Path | str) -> Iterator[tuple[bytes, int]]:
    """Yield the lines that each chunk completes, as one text, and the number of the first."""
    incomplete, line = b"", 1
    for chunk in chunks:
        complete, end, incomplete = (incomplete + chunk).rpartition(b"\n")
        if end:
            yield _without_bom(complete, line), line
            line += _line_count(complete)
        if len(incomplete) > _LONGEST_LINE:
            rule = f"a line must not be longer than {_LONGEST_LINE} bytes"
            raise MalformedInputError(rule, source=source, place=f"line {line}")
    if incomplete:
        yield _without_bom(incomplete, line), line


def _line_count(text: bytes) -> int:
    # bytes.count is slow for frequent bytes
    return 1 + int(np.count_nonzero(np.frombuffer(text, dtype=np.uint8) == _LINE_FEED))


def _without_bom(text: bytes, first: int) -> bytes:
    return text.removeprefix(b"\xef\xbb\xbf") if first == 1 else text


def _text_of(line: bytes) -> str:
    return line.decode("utf-8", errors="replace").strip()


def _is_json(text: str) -> bool:
    return text[:1] in ("{", "[")


def _parse_lines(text: bytes, first: int, form: _LineFormat) -> NumberLines:
    if first == 1:
        head, end, body = text.partition(b"\n")
        if end and form.is_header(_text_of(head)):
            text, first = body, 2
    if (at_once := _parse_at_once(text, first, form)) is not None:
        return NumberLines(*at_once, {})
    rows: list[Sequence[float]] = []
    numbers_of_lines: list[int] = []
    errors: dict[int, str] = {}
    for number, line in _numbered(text, first, form):
        parsed, error = _parse_line(line, lambda text: (_row_of(text, form),), form)
        if error is not None:
            errors[len(rows)] = error
        rows.append(parsed[0] if parsed else [math.nan] * len(form.names))
        numbers_of_lines.append(number)
    numbers = np.array(rows, dtype=np.float64).reshape(-1, len(form.names))
    return NumberLines(numbers, numbers_of_lines, errors)


def _parse_at_once(text: bytes, first: int, form: _LineFormat) -> tuple[Floats, range] | None:
    """Return numbers and line numbers if all lines are plain numbers, else None."""
    # numpy accepts more kinds of blanks, and warns of a text without numbers
    if text.translate(None, b"0123456789+-.eE, \t\r\n") or not text.strip():
        return None
    delimiter = form.delimiter("," if b"," in text else " ")
    try:
        numbers = np.loadtxt(io.BytesIO(text), delimiter=delimiter, comments=None, ndmin=2)
    except ValueError:
        return None
    lines = range(first, first + _line_count(text))
    # numpy skips empty lines, and reads 1e999 as infinity
    is_plain = numbers.shape == (len(lines), len(form.names))
    return (numbers, lines) if is_plain and np.isfinite(numbers).all() else None


def _parse_line(
    text: str, parse: Callable[[str], tuple[Any, ...]], form: _LineFormat
) -> tuple[tuple[Any, ...], str | None]:
    try:
        parsed = parse(text)
    except MalformedInputError as error:
        return (), f"{error.rule}, got {shown(text)}"
    except (ValueError, TypeError, LookupError, OverflowError, RecursionError):
        rule = form.json if _is_json(text) else form.plain
        return (), f"must be {rule}, got {shown(text)}" if text else "empty line"
    places = (place for place in parsed if isinstance(place, tuple))
    is_finite = all(math.isfinite(number) for place in places for number in place)
    return parsed, None if is_finite else f"must be finite, got {shown(text)}"


def _row_of(text: str, form: _LineFormat) -> tuple[float, ...]:
    if _is_json(text):
        return _row_of_json(json.loads(text), form)
    numbers = _numbers_of(text, form.delimiter(text))
    if form.allows_tum and len(numbers) == len(TUM):
        return planar_pose(numbers)
    if len(numbers) != len(form.names):
        raise ValueError
    return tuple(numbers)


def _row_of_json(value: Any, form: _LineFormat) -> tuple[float, ...]:
    if form is _PAIR:
        if isinstance(value, dict):
            keys = (("from", "start"), ("to", "goal"))
            value = [value.get(old, value.get(key)) for old, key in keys]
        start, goal = value
        return *_row_of_json(start, _POINT), *_row_of_json(goal, _POINT)
    row = [value[name] for name in form.names] if isinstance(value, dict) else list(value)
    if len(row) != len(form.names) or any(type(number) not in (int, float) for number in row):
        raise ValueError  # bools are ints, too
    return tuple(map(float, row))


def _numbers_of(text: str, delimiter: str | None = ",") -> list[float]:
    if not text.isascii() or "_" in text:  # Python's float accepts these, too
        raise ValueError
    return [float(part) for part in text.split(delimiter)]


def _named_point_of(text: str) -> tuple[Point, str | None]:
    if _is_json(text):
        value = json.loads(text)
        name = value.get("name") if isinstance(value, dict) else None
        if name is not None and not (isinstance(name, str) and name.strip()):
            raise ValueError
        x, y = _row_of_json(value, _POINT)
        return (x, y), name
    if "=" not in text and text.count(",") == 2 and not texts.is_number(text.split(",")[0].strip()):
        text = text.replace(",", "=", 1)
    name, equals, place = text.rpartition("=")
    if equals and (not name.strip() or "," in name):
        raise ValueError
    x, y = _numbers_of(place)
    return (x, y), name.strip() or None
