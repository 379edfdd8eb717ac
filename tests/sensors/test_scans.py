import gzip
import math
import warnings

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from mapdeal import MalformedInputError, MapdealWarning
from mapdeal.sensors import scans as carmen
from mapdeal.sensors.scans import ScanTexts, open_log


def flaser(ranges, pose=(1.0, -2.0, 0.5), time=7.0):
    words = ["FLASER", len(ranges), *ranges, *pose, 9.0, 9.0, 9.0, time, "nohost", time]
    return " ".join(str(word) for word in words)


def robotlaser(
    ranges, pose=(1.0, -2.0, 0.5), *, start=-0.7, step=0.02, longest=50.0, time=7.0, field=None
):
    field = abs(step) * len(ranges) if field is None else field
    words = ["ROBOTLASER1", 0, start, field, step, longest, 0.01, 0, len(ranges), *ranges, 2, 5, 6,
             *pose, 8.0, 8.0, 8.0, 0.1, 0.2, 0.3, 0.4, 0.0, time, "nohost", time]  # fmt: skip
    return " ".join(str(word) for word in words)


def rawlaser(ranges, *, start=-0.7, step=0.02, longest=50.0, time=7.0):
    words = ["RAWLASER1", 0, start, step * len(ranges), step, longest, 0.01, 0, len(ranges)]
    words += [*ranges, 0, time, "nohost", time]
    return " ".join(str(word) for word in words)


def odom(x, y, yaw):
    return f"ODOM {x} {y} {yaw} 0.1 0.2 0.0 7.0 nohost 7.0"


HALF = [round(1 + 0.01 * k, 2) for k in range(180)]


@pytest.fixture
def read(tmp_path):
    """Return a function that reads a log from lines; its parts are poses, angles and ranges."""

    def read_lines(*lines, max_bad=0, name="a.log", packed=False):
        data, path = ("\n".join(lines) + "\n").encode(), tmp_path / name
        path.write_bytes(gzip.compress(data) if packed else data)
        log = open_log(path, max_bad=max_bad)
        parts = [[array.tolist() for array in part[:3]] for part in log.scans()]
        log.warn()
        return parts

    return read_lines


@pytest.mark.parametrize(("count", "step"), [(180, 1.0), (181, 1.0), (360, 0.5), (361, 0.5)])
@pytest.mark.parametrize("packed", [False, True])
def test_flaser_has_its_readings_from_the_right_to_the_left(read, count, step, packed):
    ranges = [0.01 * k for k in range(count)]
    ((poses, angles, found),) = read(
        "# a comment", "PARAM robot_width 0.3 nohost 0", odom(5, 5, 5), flaser(ranges),
        "NEFF 12.0 nohost 0", "", packed=packed,
    )  # fmt: skip
    assert poses == [[1.0, -2.0, 0.5]]
    assert found == [pytest.approx(ranges)]
    assert np.degrees(angles) == pytest.approx(-90 + step * np.arange(count))


def test_robotlaser_has_its_own_angles_and_rawlaser_the_last_odometry(read):
    ((poses, angles, ranges),) = read(robotlaser([1.0, 49.9, 50.0, 80.0]))
    assert poses == [[1.0, -2.0, 0.5]]
    assert angles == pytest.approx([-0.7, -0.68, -0.66, -0.64])
    assert ranges == [[1.0, 49.9, math.inf, math.inf]]
    ((_, angles, _),) = read(robotlaser([1.0, 2.0, 3.0], start=0.7, step=-0.5))
    assert angles == pytest.approx([0.7, 0.2, -0.3])
    ((_, _, ranges),) = read(robotlaser([1.0, 2.0], longest=0))
    assert ranges == [[1.0, 2.0]]
    ((poses, _, ranges),) = read(
        odom(1, 2, 3), rawlaser([1.0]), rawlaser([2.0], time=8), odom(4, 5, 0.1),
        rawlaser([3.0], time=9),
    )  # fmt: skip
    assert poses == [[1.0, 2.0, 3.0], [1.0, 2.0, 3.0], [4.0, 5.0, 0.1]]
    assert ranges == [[1.0], [2.0], [3.0]]


def test_scans_with_different_numbers_of_readings_are_separate_parts(read):
    lines = [robotlaser([1.0] * count, time=time) for count, time in ((3, 7), (4, 8), (4, 9))]
    parts = read(*lines)
    assert [len(part[0]) for part in parts] == [1, 2]
    assert [len(part[1]) for part in parts] == [3, 4]


@pytest.mark.parametrize(("lines", "warning", "expected"), [
    ([odom(0, 0, 0), rawlaser([1.0]), robotlaser([2.0]), rawlaser([1.0])],
     "2 lines of RAWLASER1 are not used beside those of ROB", [[2.0]]),
    ([robotlaser([2.0]), robotlaser([2.0]), robotlaser([2.0], time=8)],
     "1 of 3 scans repeat the one before, dropped", [[2.0], [2.0]]),
    ([rawlaser([1.0]), odom(1, 2, 3), rawlaser([2.0], time=8), rawlaser([3.0], time=9)],
     "1 scans have no ODOM line", [[2.0], [3.0]]),
], ids=["one kind counts", "repeated", "no pose"])  # fmt: skip
def test_dropped_scans_give_a_warning(read, lines, warning, expected):
    with pytest.warns(MapdealWarning, match=warning):
        ((_, _, ranges),) = read(*lines)
    assert ranges == expected


def test_a_log_without_poses_for_half_of_its_scans_or_of_bad_lines_is_refused(read):
    line = rawlaser([1.0])
    with pytest.raises(MalformedInputError, match="2 of 3"):
        read(line, line, odom(1, 2, 3), rawlaser([2.0], time=8))
    line = flaser(HALF).removesuffix(" 7.0")
    with pytest.raises(MalformedInputError, match=r"line 2: .*words.*\(and 2 more bad lines\)"):
        read("# log", *[line] * 3, max_bad=10)


def test_a_long_log_comes_in_parts_of_few_readings(read):
    parts = read(*[flaser(HALF, (k, 0, 0), time=k) for k in range(1200)])
    assert [len(part[0]) for part in parts] == [512, 512, 176]
    assert [pose[0] for part in parts for pose in part[0]] == list(range(1200))
    parts = read(*[robotlaser([2] * 90_000, step=1e-5, time=float(k)) for k in range(4)])
    assert sum(len(ranges) for _, _, ranges in parts) == 4
    assert max(len(ranges) * len(ranges[0]) for _, _, ranges in parts) <= 1 << 18


def test_leading_blanks_and_long_unknown_lines_are_ignored(read):
    noise = ["# " + "x" * 3_000_000, "OTHER " + "FLASER 180 " * 200_000]
    for before in ("  ", "\t", "\ufeff", " \t "):
        first, second = flaser(HALF, time=1), flaser(HALF, time=2).replace("FLASER ", "FLASER\t")
        ((poses, _, _),) = read(before + first, *noise, second)
        noise = []
        assert len(poses) == 2


@pytest.mark.parametrize("time", [0, 0.0, 7.5])
@pytest.mark.parametrize("line", [flaser, robotlaser])
def test_a_log_with_a_constant_time_gives_no_warning(read, line, time):
    lines = [line(HALF, (k, 0, 0), time=time) for k in range(3)]
    ((poses, _, _),) = read(*lines)  # a warning would be an error
    assert [pose[0] for pose in poses] == [0.0, 1.0, 2.0]
    with pytest.warns(MapdealWarning, match="2 of 4 scans are not later"):
        read(*lines, line(HALF, (3, 0, 0), time=8))  # a single later time is enough for the check


BAD_LINES = [
    ("truncated", flaser(HALF)[:400], "words"),
    ("odd-count", flaser(HALF[:100]), "180, 181, 360 or 361"),
    ("no-count", "FLASER x 1 2", "number of readings"),
    ("word", flaser([*HALF[:-1], "far"]), "number"),
    ("underscore", flaser([*HALF[:-1], "1_0"]), "number"),
    ("huge-step", robotlaser([1.0], step=1e306), "radians"),
    ("pose", flaser(HALF, (1, "nan", 0)), "pose"),
    ("far-pose", flaser(HALF, (1, 1e300, 0)), "pose"),
    ("remissions", robotlaser([1.0]).replace(" 2 5 6 ", " 9 5 6 "), "words"),
    ("increment-0", robotlaser([1.0], step=0), "resolution"),
    ("cut", "ROBOTLASER1 0 1 2 3 4 5 6 900 1 2", "900 readings"),
    ("field-of-view", robotlaser([1.0] * 90, field=3.14), "span"),
    ("huge-start", robotlaser([1.0], start=1e13), "radians"),
]


@pytest.mark.parametrize(("line", "rule"), [pytest.param(*c, id=name) for name, *c in BAD_LINES])
def test_bad_lines_are_skipped_up_to_max_bad_and_named(read, line, rule):
    good = robotlaser(HALF, (4, 5, 6)) if line.startswith("R") else flaser(HALF, (4, 5, 6))
    with pytest.raises(MalformedInputError) as caught:
        read("# log", good, line, max_bad=0)
    assert "line 3: " in str(caught.value)
    assert rule in str(caught.value)
    assert "--max-bad" in caught.value.hint
    with pytest.warns(MapdealWarning, match=r"1 malformed lines ignored: line 3: "):
        ((poses, _, _),) = read("# log", good, line, max_bad=1)
    assert poses == [[4.0, 5.0, 6.0]]


@pytest.mark.slow
@pytest.mark.parametrize(("data", "rule"), [
    (b"", "FLASER"),
    (gzip.compress(flaser(HALF).encode() * 50)[:200], "gzip"),
    (b"\x1f\x8bhello", "gzip"),
    (b"FLASER " + b"1 " * 40_000 + b"\n", "line 1"),
    (gzip.compress(b"#\n" * 8_000_000), "expand"),
], ids=["empty", "gz cut", "gz damaged", "long line", "gz bomb"])  # fmt: skip
def test_invalid_logs_are_refused(tmp_path, data, rule):
    (tmp_path / "a.log").write_bytes(data)
    with pytest.raises(MalformedInputError, match=rule):
        list(open_log(tmp_path / "a.log").scans())


@pytest.fixture
def texts(tmp_path):
    def read_texts(poses, angles, ranges, **options):
        paths = [tmp_path / name for name in ("pose.txt", "angles.txt", "ranges.txt")]
        for path, text in zip(paths, (poses, angles, ranges), strict=True):
            path.write_text(text)
        parts = list(ScanTexts(*paths, **options).scans())
        return [np.concatenate([p.poses for p in parts]).tolist(), parts[0].angles.tolist(),
                np.concatenate([p.ranges for p in parts]).tolist()]  # fmt: skip

    return read_texts


POSES, ANGLES, RANGES = "1,2,-4.7\n3,4,0.5\n", "0.5,0,-0.5\n", "1,nan,3\n4,inf,6\n"


def test_three_texts(texts):
    poses, angles, ranges = texts(POSES, ANGLES, RANGES)
    assert poses == [[1.0, 2.0, -4.7], [3.0, 4.0, 0.5]]
    assert angles == [0.5, 0.0, -0.5]
    np.testing.assert_array_equal(ranges, [[1, math.nan, 3], [4, math.inf, 6]])
    assert texts(POSES, "0.5\n0\n-0.5\n", RANGES.replace(",", " "))[1] == angles
    flipped = texts(POSES, ANGLES, RANGES, flip_y=True)
    assert flipped[:2] == [[[1.0, -2.0, -4.7], [3.0, -4.0, 0.5]], angles]


@pytest.mark.parametrize(("poses", "angles", "ranges", "rule"), [
    (POSES, ANGLES, "1,2,3\n", "after 1 scans"), (POSES, ANGLES, RANGES + "1,2,3\n", "more lines"),
    (POSES, ANGLES, "1,2,3\n1,2\n", "ranges.txt: line 2"),
    (POSES, "0,1\n2,3\n", RANGES, "angles.txt"), (POSES, "0,nan,1\n", RANGES, "angle 2"),
    (POSES, "", RANGES, "no angles"), (POSES, ANGLES, "1,2,3\n1,b,3\n", "ranges.txt: line 2"),
])  # fmt: skip
def test_texts_that_do_not_fit_together_are_refused(texts, poses, angles, ranges, rule):
    with pytest.raises(MalformedInputError, match=rule):
        texts(poses, angles, ranges)


SCANS = {
    "poses": np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]),
    "angles": np.array([-1, 0, 1, 2]),
    "ranges": np.arange(8, dtype="f4").reshape(2, 4),
}


def npz_of(folder, arrays):
    np.savez_compressed(folder / "s.npz", **arrays)
    return open_log(folder / "s.npz")


@pytest.mark.parametrize("order", ["C", "F"])
def test_an_npz_of_scans(tmp_path, order):
    source = npz_of(tmp_path, {**SCANS, "ranges": np.asarray(SCANS["ranges"], order=order)})
    assert source.count == 2
    for _ in range(2):  # a second reading is the same
        (part,) = source.scans()
        assert [array.tolist() for array in part[:3]] == [a.tolist() for a in SCANS.values()]


@pytest.mark.parametrize(("changes", "rule"), [
    ({"poses": None}, "poses: missing"), ({"angles": np.zeros((4, 1))}, "angles"),
    ({"ranges": np.array([["a"] * 4] * 2)}, "ranges"),
    ({"ranges": np.zeros((2, 3))}, r"ranges.*\(2, 4\)"),
    ({"poses": np.full((2, 3), np.nan)}, "poses"),
    ({"angles": np.array([0, 1, 2, np.inf])}, "angles"),
    ({"angles": np.zeros(0), "ranges": np.zeros((2, 0))}, "angles"),
    ({"poses": np.zeros((0, 3)), "ranges": np.zeros((0, 4))}, "poses"),
])  # fmt: skip
def test_an_invalid_npz_is_refused(tmp_path, changes, rule):
    arrays = {k: v for k, v in {**SCANS, **changes}.items() if v is not None}
    with pytest.raises(MalformedInputError, match=rule):
        list(npz_of(tmp_path, arrays).scans())


def test_real_logs(real_maps):
    folder = real_maps / "acschaefer__ple"
    for name, count in {"intel-corrected.log": 910, "aces-corrected.log": 440}.items():
        parts = list(open_log(folder / name).scans())
        assert sum(len(part.poses) for part in parts) == count
        packed = list(open_log(folder / f"{name}.gz").scans())
        for part, packed_part in zip(parts, packed, strict=True):
            assert all(np.array_equal(a, b) for a, b in zip(part, packed_part, strict=True))
    ranges = np.concatenate([p.ranges for p in open_log(folder / "intel-corrected.log").scans()])
    assert (ranges == 81.83).mean() == pytest.approx(0.025, abs=0.001)


ODD_WORDS = ["nan", "inf", "-inf", "1_0", "x", "1e999", "2e11", "infinity", "0x1", "181", "-0.0"]
ODD_WORDS = st.sampled_from([*ODD_WORDS, "", "\x0b"])
WRITERS = {
    "FLASER": lambda time: flaser(HALF, time=time),
    "ROBOTLASER1": lambda time: robotlaser([1.5, 90, 2], longest=81.9, time=time),
    "RAWLASER1": lambda time: rawlaser([1.5, 90, 2], time=time),
}


def results_of(path):
    parts, error = [], None
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            log = carmen.CarmenLog(path, max_bad=3)
            parts.extend([array.tolist() for array in part[:3]] for part in log.scans())
            log.warn()
        except MalformedInputError as malformed:
            error = str(malformed)
    return repr((parts, [str(warning.message) for warning in caught], error))


@pytest.mark.parametrize("kind", WRITERS)
def test_lines_of_one_scanner_are_parsed_together(kind):
    lines = [WRITERS[kind](time).encode() for time in ("2.5", "3", "1e1")]
    scans = carmen._scans_at_once(lines)
    assert scans is not None
    for scan, line in zip(scans, lines, strict=True):
        assert scan.repeats(carmen._scan_of(line.split()))


LINES = st.tuples(
    st.sampled_from(list(WRITERS)), st.sampled_from(["1", "2.5", "2.5", "3e0"]),
    st.dictionaries(st.integers(0, 40) | st.integers(170, 192), ODD_WORDS, max_size=1),
    st.sampled_from([" ", "\t", "  "]), st.sampled_from(["", " ", "\r", " more"]),
)  # fmt: skip


@given(st.lists(LINES, max_size=6), st.booleans())
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_lines_parsed_together_equal_lines_parsed_word_by_word(tmp_path, lines, has_odometry):
    text = "ODOM 1 2 0.5 0 0 0 1 host 1\n" if has_odometry else ""
    for kind, time, changed, blank, end in lines:
        words = WRITERS[kind](time).split()
        for index, word in changed.items():
            words[index % len(words)] = word
        text += blank.join(words) + end + "\n"
    path = tmp_path / "a.log"
    path.write_bytes(text.encode())
    at_once = results_of(path)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(carmen, "_scans_at_once", lambda _: None)
        assert results_of(path) == at_once
