import gzip
import io
import math
import warnings

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mapdeal import FileAccessError, MalformedInputError, MapdealWarning
from mapdeal.sensors import scans as carmen
from mapdeal.sensors.scans import ScanTexts, open_log


def flaser(ranges, pose=(1.0, -2.0, 0.5), time=7.0):
    words = ["FLASER", len(ranges), *ranges, *pose, 9.0, 9.0, 9.0, time, "nohost", time + 0.1]
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
    """Read a log from lines; return all its poses, angles and ranges as they come."""

    def read_lines(*lines, max_bad=0, name="a.log", packed=False):
        data = ("\n".join(lines) + "\n").encode()
        path = tmp_path / name
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


def test_robotlaser_tells_its_own_angles_and_reach(read):
    ((poses, angles, ranges),) = read(robotlaser([1.0, 49.9, 50.0, 80.0]))
    assert poses == [[1.0, -2.0, 0.5]]
    assert angles == pytest.approx([-0.7, -0.68, -0.66, -0.64])
    assert ranges == [[1.0, 49.9, math.inf, math.inf]]


def test_rawlaser_takes_the_pose_of_the_last_odometry(read):
    ((poses, _, ranges),) = read(
        odom(1, 2, 3), rawlaser([1.0]), rawlaser([2.0], time=8), odom(4, 5, 0.1),
        rawlaser([3.0], time=9),
    )  # fmt: skip
    assert poses == [[1.0, 2.0, 3.0], [1.0, 2.0, 3.0], [4.0, 5.0, 0.1]]
    assert ranges == [[1.0], [2.0], [3.0]]


def test_scanners_that_change_come_in_parts(read):
    parts = read(
        robotlaser([1.0] * 3), robotlaser([2.0] * 4, time=8), robotlaser([3.0] * 4, time=9)
    )
    assert [len(part[0]) for part in parts] == [1, 2]
    assert [len(part[1]) for part in parts] == [3, 4]


def test_one_kind_of_line_counts(read):
    lines = [odom(0, 0, 0), rawlaser([1.0]), robotlaser([2.0]), rawlaser([1.0])]
    with pytest.warns(
        MapdealWarning, match="2 lines of RAWLASER1 are not used beside those of ROB"
    ):
        ((_, _, ranges),) = read(*lines)
    assert ranges == [[2.0]]


def test_a_long_log_comes_in_parts(read):
    parts = read(*[flaser(HALF, (k, 0, 0), time=k) for k in range(1200)])
    assert [len(part[0]) for part in parts] == [512, 512, 176]
    assert [pose[0] for part in parts for pose in part[0]] == list(range(1200))


def test_scans_of_many_readings_come_few_at_a_time(read):
    lines = [robotlaser([2] * 90_000, step=1e-5, time=float(k)) for k in range(7)]
    parts = read(*lines)
    assert sum(len(ranges) for _, _, ranges in parts) == 7
    assert max(len(ranges) * len(ranges[0]) for _, _, ranges in parts) <= 1 << 18


def test_a_scan_that_is_repeated_counts_once(read):
    lines = [flaser(HALF, time=1), flaser(HALF, time=1), flaser(HALF, time=2)]
    with pytest.warns(MapdealWarning, match="1 of 3 scans repeat the one before, dropped"):
        ((poses, _, _),) = read(*lines)
    assert len(poses) == 2


@pytest.mark.parametrize("before", ["  ", "\t", "\ufeff", " \t "])
def test_what_stands_before_a_tag_or_a_tab_behind_it_does_not_matter(read, before):
    lines = [before + flaser(HALF, time=1), flaser(HALF, time=2).replace("FLASER ", "FLASER\t")]
    ((poses, _, _),) = read(*lines)
    assert len(poses) == 2


def test_long_lines_that_are_no_scans_are_skipped(read):
    ((poses, _, _),) = read(
        "# " + "x" * 3_000_000, "OTHER " + "FLASER 180 " * 200_000, flaser(HALF)
    )
    assert len(poses) == 1


def test_a_log_whose_lines_are_all_bad_names_the_first(read):
    line = flaser(HALF).removesuffix(" 7.1")
    with pytest.raises(MalformedInputError, match=r"line 2: .*words.*\(and 2 more bad lines\)"):
        read("# log", *[line] * 3, max_bad=10)


@pytest.mark.parametrize("time", [0, 0.0, 7.5])
@pytest.mark.parametrize("line", [flaser, robotlaser])
def test_a_log_without_times_is_not_scolded_for_their_order(read, line, time):
    lines = [line(HALF, (k, 0, 0), time=time) for k in range(3)]
    ((poses, _, _),) = read(*lines)  # a warning is an error
    assert [pose[0] for pose in poses] == [0.0, 1.0, 2.0]
    with pytest.warns(MapdealWarning, match="2 of 4 scans are not later"):
        read(*lines, line(HALF, (3, 0, 0), time=8))  # it has a time: so the others do


def test_times_that_do_not_grow_are_warned_of_and_kept(read):
    with pytest.warns(MapdealWarning, match="1 of 3 scans are not later"):
        ((poses, _, _),) = read(*[flaser(HALF, (k, 0, 0), time=t) for k, t in enumerate((3, 2, 4))])
    assert [pose[0] for pose in poses] == [0.0, 1.0, 2.0]


BAD_LINES = [
    ("S13-truncated", flaser(HALF)[:400], "words"),
    ("S13-count", flaser(HALF).replace("FLASER 180", "FLASER 181"), "words"),
    ("S13-odd-count", flaser(HALF[:100]), "180, 181, 360 or 361"),
    ("S13-no-count", "FLASER x 1 2", "number of readings"),
    ("S13-nothing", "FLASER ", "number of readings"),
    ("S13-word", flaser([*HALF[:-1], "far"]), "number"),
    ("S13-underscore", flaser([*HALF[:-1], "1_0"]), "number"),
    ("S13-pose", flaser(HALF, (1, "nan", 0)), "pose"),
    ("S13-far-pose", flaser(HALF, (1, 1e300, 0)), "pose"),
]


@pytest.mark.parametrize(("line", "told"), [pytest.param(*c, id=name) for name, *c in BAD_LINES])
def test_a_bad_line_is_named_and_passed_over_up_to_a_number(read, line, told):
    lines = ["# log", flaser(HALF, (4, 5, 6)), line]
    with pytest.raises(MalformedInputError) as caught:
        read(*lines, max_bad=0)
    assert "line 3: " in str(caught.value)
    assert told in str(caught.value)
    assert "--max-bad" in caught.value.hint
    with pytest.warns(MapdealWarning, match=r"1 malformed lines ignored: line 3: "):
        ((poses, _, _),) = read(*lines, max_bad=1)
    assert poses == [[4.0, 5.0, 6.0]]


@pytest.mark.parametrize(
    ("line", "told"),
    [
        pytest.param(robotlaser([1.0, 2.0]).rsplit(" ", 1)[0], "words", id="S13-truncated"),
        pytest.param(robotlaser([1.0]).replace(" 2 5 6 ", " 9 5 6 "), "words", id="S13-remissions"),
        pytest.param(robotlaser([1.0], step=0), "resolution", id="S9-increment-0"),
        pytest.param(robotlaser([1.0], start="nan"), "start", id="S9-nan"),
        pytest.param("ROBOTLASER1 0 1 2 3 4 5 6 900 1 2", "900 readings", id="S13-cut"),
        pytest.param(robotlaser([1.0] * 90, field=3.14), "span", id="S9-field-of-view"),
        pytest.param(robotlaser([1.0], start=1e13), "radians", id="S7-huge-start"),
        pytest.param(robotlaser([1.0], step=1e306), "radians", id="S7-huge-step"),
    ],
)
def test_bad_lines_of_the_new_kind(read, line, told):
    with pytest.raises(MalformedInputError, match=told):
        read(robotlaser([1.0]), line)


def test_a_clockwise_scanner_is_read_s9(read):
    ((_, angles, _),) = read(robotlaser([1.0, 2.0, 3.0], start=0.7, step=-0.5))
    assert angles == pytest.approx([0.7, 0.2, -0.3])


def test_scans_without_a_pose_are_dropped_up_to_half_of_them_s10(read):
    lines = [rawlaser([1.0]), odom(1, 2, 3), rawlaser([2.0], time=8), rawlaser([3.0], time=9)]
    with pytest.warns(MapdealWarning, match="1 scans have no ODOM line"):
        ((_, _, ranges),) = read(*lines)
    assert ranges == [[2.0], [3.0]]
    with pytest.raises(MalformedInputError, match="2 of 3"):
        read(lines[0], lines[0], *lines[1:3])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("data", "told"),
    [
        pytest.param(b"", "FLASER", id="empty"),
        pytest.param(b"P5\n3 3\n255\n123456789", "is an image", id="an-image"),
        pytest.param(gzip.compress(flaser(HALF).encode() * 50)[:200], "gzip", id="S13-gz-cut"),
        pytest.param(b"\x1f\x8bhello", "gzip", id="S13-gz-damaged"),
        pytest.param(b"FLASER " + b"1 " * 40_000 + b"\n", "line 1", id="long-line"),
        pytest.param(gzip.compress(b"#\n" * 8_000_000), "expand", id="S16-gz-bomb"),
    ],
)
def test_what_is_no_log_is_refused(tmp_path, data, told):
    (tmp_path / "a.log").write_bytes(data)
    with pytest.raises(MalformedInputError, match=told):
        list(open_log(tmp_path / "a.log").scans())


@pytest.mark.parametrize("name", ["missing.log", "missing.npz", "."])
def test_what_is_not_there_cannot_be_read(tmp_path, name):
    with pytest.raises(FileAccessError):
        open_log(tmp_path / name)


@pytest.fixture
def texts(tmp_path):
    """Read scans from the texts of three files."""

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


def test_y_of_the_poses_can_be_flipped(texts):
    poses, angles, _ = texts(POSES, ANGLES, RANGES, flip_y=True)
    assert poses == [[1.0, -2.0, -4.7], [3.0, -4.0, 0.5]]
    assert angles == [0.5, 0.0, -0.5]


@pytest.mark.parametrize(
    ("poses", "angles", "ranges", "told"),
    [
        pytest.param(POSES, ANGLES, "1,2,3\n", "after 1 scans", id="fewer-scans"),
        pytest.param(POSES, ANGLES, RANGES + "1,2,3\n", "more lines", id="more-scans"),
        pytest.param(POSES, ANGLES, "1,2,3\n1,2\n", "ranges.txt: line 2", id="S9-fewer-readings"),
        pytest.param(POSES, ANGLES, "1,2\n1,2\n", "line 1.*3 numbers", id="S9-readings"),
        pytest.param(POSES, "0,1\n2,3\n", RANGES, "angles.txt", id="angles-in-a-block"),
        pytest.param(POSES, "0,nan,1\n", RANGES, "angle 2", id="angle-nan"),
        pytest.param(POSES, "", RANGES, "no angles", id="no-angles"),
        pytest.param("1,2,3\n1,2\n", ANGLES, RANGES, "pose.txt: line 2", id="pose-short"),
        pytest.param(POSES, ANGLES, "1,2,3\n1,b,3\n", "ranges.txt: line 2", id="words"),
        pytest.param(POSES, ANGLES, "", "after 0 scans", id="no-ranges"),
    ],
)
def test_texts_that_do_not_fit_are_refused(texts, poses, angles, ranges, told):
    with pytest.raises(MalformedInputError, match=told):
        texts(poses, angles, ranges)


SCANS = {
    "poses": np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]),
    "angles": np.array([-1, 0, 1, 2]),
    "ranges": np.arange(8, dtype="f4").reshape(2, 4),
}


def saved(**arrays):
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)
    return file.getvalue()


@pytest.mark.parametrize("order", ["C", "F"])
def test_an_npz_of_scans(tmp_path, order):
    arrays = {**SCANS, "ranges": np.asarray(SCANS["ranges"], order=order)}
    (tmp_path / "s.npz").write_bytes(saved(**arrays))
    source = open_log(tmp_path / "s.npz")
    assert source.count == 2
    for _ in range(2):  # it can be read again
        (part,) = source.scans()
        assert [array.tolist() for array in part[:3]] == [a.tolist() for a in SCANS.values()]


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        pytest.param({"poses": None}, "poses: missing", id="S16-no-poses"),
        pytest.param({"angles": None}, "angles: missing", id="S16-no-angles"),
        pytest.param({"ranges": None}, "ranges: missing", id="S16-no-ranges"),
        pytest.param({"poses": np.zeros((2, 2))}, "poses", id="S16-pose-shape"),
        pytest.param({"poses": np.zeros(3)}, "poses", id="S16-pose-axes"),
        pytest.param({"angles": np.zeros((4, 1))}, "angles", id="S16-angle-axes"),
        pytest.param({"ranges": np.zeros((2, 3))}, r"ranges.*\(2, 4\)", id="S9-counts"),
        pytest.param({"ranges": np.array([["a"] * 4] * 2)}, "ranges", id="S16-words"),
        pytest.param({"ranges": np.array([[None] * 4] * 2)}, "objects", id="S16-objects"),
        pytest.param({"poses": np.full((2, 3), np.nan)}, "poses", id="S10-nan"),
        pytest.param({"angles": np.array([0, 1, 2, np.inf])}, "angles", id="inf-angle"),
        pytest.param({"angles": np.zeros(0), "ranges": np.zeros((2, 0))}, "angles", id="no-angles"),
        pytest.param({"poses": np.zeros((0, 3)), "ranges": np.zeros((0, 4))}, "poses", id="none"),
    ],
)
def test_an_npz_that_is_wrong_is_refused(tmp_path, changes, told):
    arrays = {k: v for k, v in {**SCANS, **changes}.items() if v is not None}
    (tmp_path / "s.npz").write_bytes(saved(**arrays))
    with pytest.raises(MalformedInputError, match=told):
        list(open_log(tmp_path / "s.npz").scans())


def test_real_logs(real_maps):
    folder = real_maps / "acschaefer__ple"
    sizes = {"intel-corrected.log": 910, "aces-corrected.log": 440}
    for name, count in sizes.items():
        parts = list(open_log(folder / name).scans())
        assert sum(len(part.poses) for part in parts) == count
        packed = list(open_log(folder / f"{name}.gz").scans())
        for part, other in zip(parts, packed, strict=True):
            assert all(np.array_equal(a, b) for a, b in zip(part, other, strict=True))
    ranges = np.concatenate([p.ranges for p in open_log(folder / "intel-corrected.log").scans()])
    assert (ranges == 81.83).mean() == pytest.approx(0.025, abs=0.001)


@pytest.mark.parametrize(
    ("longest", "ranges"),
    [(b"0", [1.0, 2.0, 3.0]), (b"2", [1.0, math.inf, math.inf]), (b"9", [1.0, 2.0, 3.0])],
)
def test_a_laser_without_a_longest_range_has_returned_all(longest, ranges):
    words = [b"ROBOTLASER1", b"0", b"-0.1", b"0.2", b"0.1", longest, b"0.01", b"0", b"3"]
    tail = [b"0", *[b"1", b"2", b"0.5"] * 2, *[b"0"] * 5, b"7", b"host", b"7"]
    scan = carmen._scan_of([*words, b"1", b"2", b"3", *tail])
    assert scan.ranges.tolist() == ranges
    assert (scan.laser.start, scan.laser.step, scan.laser.readings) == (-0.1, 0.1, 3)


ODD_WORDS = st.sampled_from(
    [
        "nan",
        "inf",
        "-inf",
        "1_0",
        "x",
        "",
        "1e999",
        "2e11",
        "\x0b",
        "infinity",
        "0x1",
        "181",
        "-0.0",
    ]
)


def _flaser_words(time):
    poses = ["1.5", "-2", ".25", "1.5", "-2", ".25"]
    return ["FLASER", "180", *(f"{k / 7:.3f}" for k in range(180)), *poses, time, "host", time]


def _robot_words(time):
    head = ["ROBOTLASER1", "0", "-0.1", "0.2", "0.1", "81.9", "0.01", "0", "3", "1.5", "90", "2"]
    pose = ["1", "2", "0.5"]
    return [*head, "2", "5", "6", *pose, *pose, *(5 * ["0"]), time, "host", time]


def _raw_words(time):
    head = ["RAWLASER1", "0", "-0.1", "0.2", "0.1", "0", "0.01", "0", "3", "1.5", "90", "2", "0"]
    return [*head, time, "host", time]


def _told(path):
    """Return what a log holds, what it warns of, and how it ends."""
    parts, error = [], None
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            log = carmen.CarmenLog(path, max_bad=3)
            parts.extend([array.tolist() for array in part[:3]] for part in log.scans())
            log.warn()
        except MalformedInputError as told:
            error = str(told)
    return repr((parts, [str(one.message) for one in caught], error))


@pytest.mark.parametrize("words_of", [_flaser_words, _robot_words, _raw_words])
def test_lines_of_one_scanner_are_taken_at_once(words_of):
    lines = [" ".join(words_of(time)).encode() for time in ("2.5", "3", "1e1")]
    scans = carmen._scans_at_once(lines)
    assert scans is not None
    for scan, line in zip(scans, lines, strict=True):
        assert scan.repeats(carmen._scan_of(line.split()))


@given(
    st.lists(
        st.tuples(
            st.sampled_from([_flaser_words, _robot_words, _raw_words]),
            st.sampled_from(["1", "2.5", "2.5", "3e0"]),
            st.dictionaries(st.integers(0, 40) | st.integers(170, 192), ODD_WORDS, max_size=1),
            st.sampled_from([" ", "\t", "  "]),
            st.sampled_from(["", " ", "\r", " more"]),
        ),
        max_size=6,
    ),
    st.booleans(),
)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
def test_lines_of_a_log_are_read_at_once_as_word_by_word(tmp_path, lines, has_odometry):
    text = "ODOM 1 2 0.5 0 0 0 1 host 1\n" if has_odometry else ""
    for words_of, time, changed, blank, end in lines:
        words = words_of(time)
        for place, word in changed.items():
            words[place % len(words)] = word
        text += blank.join(words) + end + "\n"
    path = tmp_path / "a.log"
    path.write_bytes(text.encode())
    at_once = _told(path)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(carmen, "_scans_at_once", lambda _: None)
        assert _told(path) == at_once
