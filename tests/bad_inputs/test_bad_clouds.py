"""The rows S1 to S7 of clouds and poses, through the command."""

import numpy as np
import pytest

from mapdeal import read_map

GOOD = "1 0 0\n0 1 0\n"
LOCAL = ["local", "--cloud", "c.xyz", "-o", "out", "--no-images", "--size", "4,4"]
POSE = ["--pose", "0,0,0"]

REFUSED = [
    ("S1-empty", "", [*POSE, "--require-points"], 3, ["c.xyz", "holds no points"]),
    (
        "S3-all-nan",
        "nan 1 2\n1 inf 2\n",
        [*POSE, "--require-points"],
        3,
        ["c.xyz", "2 are not finite"],
    ),
    ("S3-none-in-the-window", "9 9 9\n", [*POSE, "--require-points"], 3, ["1 lie outside"]),
    ("S2-words", "1 2 3\n1 b 3\n", POSE, 3, ["c.xyz", "line 2"]),
    ("S7-nan", GOOD, ["--pose", "0,nan,0"], 2, ["--pose"]),
    ("S7-inf", GOOD, ["--pose", "inf,0,0"], 2, ["--pose"]),
    ("S7-two-numbers", GOOD, ["--pose", "1,2"], 2, ["--pose"]),
    ("S7-words", GOOD, ["--pose", "here"], 2, ["--pose"]),
    ("S7-no-pose", GOOD, [], 2, ["--pose"]),
    ("S7-two-sources", GOOD, [*POSE, "--poses", "p.txt"], 2, ["--pose"]),
    ("S7-poses-missing", GOOD, ["--poses", "p.txt"], 4, ["p.txt"]),
    ("cloud-missing", None, POSE, 4, ["c.xyz"]),
    ("heights-of-a-flat-cloud", "1 2\n", [*POSE, "--max-height", "1"], 2, ["c.xyz", "heights"]),
    ("no-window", GOOD, [*POSE, "--size", "0,1"], 2, ["size"]),
    ("huge-window", GOOD, [*POSE, "--size", "1e5,1e5"], 2, ["size"]),
    ("no-resolution", GOOD, [*POSE, "--resolution", "0"], 2, ["resolution"]),
    ("limits", GOOD, [*POSE, "--min-range", "2", "--max-range", "1"], 2, ["--min-range"]),
    ("nan-limit", GOOD, [*POSE, "--min-height", "nan"], 2, ["--min-height"]),
    ("offset", GOOD, [*POSE, "--offset", "1"], 2, ["--offset"]),
    ("frame", GOOD, [*POSE, "--frame", "odom"], 2, ["--frame"]),
    ("recipe", GOOD, [*POSE, "--recipe", "lokal"], 2, ["recipe"]),
    ("setting", GOOD, [*POSE, "--set", "inflate.radius=-1"], 2, ["inflate.radius"]),
    ("map-missing", GOOD, [*POSE, "--map", "none.yaml"], 4, ["none.yaml"]),
    ("map-broken", GOOD, [*POSE, "--map", "c.xyz"], 3, ["c.xyz"]),
    ("no-name", GOOD, [*POSE, "--cloud", ""], 2, ["empty"]),
    ("several-words", GOOD, [*POSE, "d.xyz"], 2, ["d.xyz"]),
    ("output-is-a-file", GOOD, [*POSE, "-o", "m.yaml"], 4, ["m.yaml"]),
]


@pytest.mark.parametrize(
    ("cloud", "words", "exit_code", "told"), [pytest.param(*c, id=n) for n, *c in REFUSED]
)
def test_a_cloud_or_pose_that_cannot_be_is_refused(folder, refused, cloud, words, exit_code, told):
    if cloud is not None:
        (folder / "c.xyz").write_text(cloud)
    refused([*LOCAL, *words], exit_code, *told)


POSES = [
    ("S10-fewer-poses", "0 0 0\n", "for each of 2"),
    ("S10-more-poses", "0 0 0\n" * 3, "for each of 2"),
    ("S7-nan", "0 0 0\n0 nan 0\n", "pose 2"),
    ("S7-zero-quaternion", "0 0 0 0 0 0 0 0\n" * 2, "pose 1"),
    ("columns", "0 0 0 0\n" * 2, "line 1"),
]


@pytest.mark.parametrize(("poses", "told"), [pytest.param(*c, id=n) for n, *c in POSES])
def test_poses_that_cannot_be_are_refused_before_any_work(folder, refused, poses, told):
    for name in ("c.xyz", "d.xyz"):
        (folder / name).write_text(GOOD)
    (folder / "p.txt").write_text(poses)
    refused([*LOCAL, "--cloud", "d.xyz", "--poses", "p.txt"], 3, "p.txt", told)


def test_a_sequence_does_not_write_over_what_it_reads(folder, refused):
    (folder / "out" / "0001").mkdir(parents=True)
    (folder / "out" / "summary.json").write_text("0 0 0\n0 0 0\n")
    (folder / "p.txt").write_text("0 0 0\n0 0 0\n")
    for name in ("c.xyz", "d.xyz", "out/0001/e.xyz"):
        (folder / name).write_text(GOOD)
    words = [*LOCAL, "--force", "--poses"]
    refused([*words, "out/summary.json", "--cloud", "d.xyz"], 4, "out/summary.json", "outputs")
    refused([*words, "p.txt", "--cloud", "out/0001/e.xyz"], 4, "out/0001/e.xyz", "outputs")


def test_a_pipe_is_no_cloud(folder, refused):
    import os

    os.mkfifo(folder / "f.xyz")
    refused(["local", "--cloud", "f.xyz", "-o", "out", *POSE], 4, "f.xyz", "regular")


def test_several_clouds_need_poses(folder, refused):
    for name in ("c.xyz", "d.xyz"):
        (folder / name).write_text(GOOD)
    refused([*LOCAL, "--cloud", "d.xyz", *POSE], 2, "--pose", hint="--poses")


def test_outputs_that_exist_are_refused_without_force(folder, refused, accepted):
    (folder / "c.xyz").write_text(GOOD)
    accepted(*LOCAL, *POSE)
    refused([*LOCAL, *POSE], 4, "exists", hint="--force")
    accepted(*LOCAL, *POSE, "--force")


def test_the_hint_tells_whether_anything_differs(folder, refused, accepted):
    (folder / "c.xyz").write_text(GOOD)
    accepted(*LOCAL, *POSE)
    refused([*LOCAL, *POSE], 4, "exists", hint="the same already")
    refused([*LOCAL, "--pose", "0,0,1"], 4, "exists", hint="had other inputs")


def test_an_output_that_is_the_map_is_refused_always(folder, refused, accepted):
    (folder / "c.xyz").write_text(GOOD)
    accepted(*LOCAL, *POSE)
    refused([*LOCAL, *POSE, "--map", "out/local.yaml", "--force"], 4, "out/local")


@pytest.mark.parametrize(
    ("cloud", "told"),
    [
        pytest.param("", "it holds no points", id="S1-empty"),
        pytest.param("# x y z\n", "it holds no points", id="S1-header-only"),
        pytest.param("nan 0 0\n0 0 inf\n", "of 2 points 2 are not finite", id="S3-all-nan"),
        pytest.param("7 0 0\n", "of 1 points 1 lie outside of the window", id="all-outside"),
    ],
)
def test_without_points_the_map_is_empty_and_that_is_warned_of(folder, accepted, cloud, told):
    (folder / "c.xyz").write_text(cloud)
    _, warned = accepted(*LOCAL, *POSE)
    no_point, uniform = warned
    assert no_point == f"warning: c.xyz: no point marks a cell: {told}"
    assert uniform.endswith("cost 0: there is no obstacle")
    assert not read_map(folder / "out" / "local.yaml").occupied().any()
    assert np.isposinf(read_map(folder / "out" / "esdf.npz").distance).all()


def test_points_that_are_not_finite_are_dropped_with_their_count_s3(folder, accepted):
    (folder / "c.xyz").write_text("nan 0 0\n1 1 1\n0 -inf 0\n")
    out, warned = accepted(*LOCAL, *POSE)
    assert not warned
    assert "1 of 3 points in the window (dropped: 2 not finite)" in out
    assert read_map(folder / "out" / "local.yaml").occupied().sum() == 1


def test_borders_and_negative_coordinates_follow_the_floor_rule_s4(folder, accepted):
    (folder / "c.xyz").write_text("-2 -2\n-0.01 -0.01\n2 0\n0.15 0.35\n")
    accepted(*LOCAL, *POSE, "--resolution", "0.05")
    found = np.argwhere(read_map(folder / "out" / "local.yaml").occupied())
    assert found.tolist() == [[0, 0], [39, 39], [47, 43]]


def test_a_yaw_in_degrees_is_normalised_and_warned_of_s7(folder, accepted):
    (folder / "c.xyz").write_text("1 0\n")
    _, warned = accepted(*LOCAL, "--pose", "0,0,450")
    assert len(warned) == 1
    assert "degrees" in warned[0]


def test_millions_of_points_take_bounded_memory_s5(folder, accepted):
    import tracemalloc

    rows = np.random.default_rng(1).uniform(-3, 3, (3_000_000, 3)).astype("f4")
    np.save(folder / "c.npy", rows)
    tracemalloc.start()
    accepted("local", "--cloud", "c.npy", "-o", "out", "--no-images", *POSE)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 64e6  # the points alone are 72 MB as float64
