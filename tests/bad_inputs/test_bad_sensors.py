"""The rows S1 to S16 of clouds, poses and laser scans, through the command."""

import numpy as np
import pytest

from mapdeal import read_map
from traced_memory import memory_below

GOOD = "1 0 0\n0 1 0\n"
LOCAL = ["local", "--cloud", "c.xyz", "-o", "out", "--no-images", "--size", "4,4"]
POSE = ["--pose", "0,0,0"]


def test_outputs_that_exist_need_force_and_hints_name_changes(folder, refused, accepted):
    (folder / "c.xyz").write_text(GOOD)
    accepted(*LOCAL, *POSE)
    refused([*LOCAL, *POSE], 4, "exists", hint="the same already")
    refused([*LOCAL, "--pose", "0,0,1"], 4, "exists", hint="had other inputs")
    accepted(*LOCAL, *POSE, "--force")
    refused([*LOCAL, *POSE, "--map", "out/local.yaml", "--force"], 4, "out/local")


@pytest.mark.parametrize(("cloud", "reason"), [
    pytest.param("", "it holds no points", id="S1-empty"),
    pytest.param("# x y z\n", "it holds no points", id="S1-header-only"),
    pytest.param("nan 0 0\n0 0 inf\n", "of 2 points 2 are not finite", id="S3-all-nan"),
    pytest.param("7 0 0\n", "of 1 points 1 lie outside of the window", id="all-outside"),
])  # fmt: skip
def test_without_points_the_map_is_empty_and_that_is_warned_of(folder, accepted, cloud, reason):
    (folder / "c.xyz").write_text(cloud)
    _, warned = accepted(*LOCAL, *POSE)
    no_point, uniform = warned
    assert no_point == f"warning: c.xyz: no point marks a cell: {reason}"
    assert uniform.endswith("cost 0: there is no obstacle")
    assert not read_map(folder / "out" / "local.yaml").occupied().any()
    assert np.isposinf(read_map(folder / "out" / "esdf.npz").distance).all()


def test_millions_of_points_take_bounded_memory(folder, accepted):
    rows = np.random.default_rng(1).uniform(-3, 3, (1_500_000, 3)).astype("f4")
    np.save(folder / "c.npy", rows)
    with memory_below(32e6):  # the points alone are 36 MB as float64
        accepted("local", "--cloud", "c.npy", "-o", "out", "--no-images", *POSE)


def test_skipped_lines_are_reported_also_if_there_is_no_map(folder, command):
    line = f"FLASER 180 {'50 ' * 180}1 2 0.5 0 0 0 7 host 7\n"
    (folder / "a.log").write_text(line + line[:300])
    code, _, err = command("build", "a.log", "-o", "out.yaml")
    assert code == 3
    assert "1 malformed lines ignored: line 2" in err
    assert "no beam hits anything: of 180 readings 180 are without return" in err


def test_angles_in_degrees_are_warned_of(folder, accepted):
    np.savez("a.npz", poses=np.zeros((2, 3)), angles=[-90.0, 0, 90, 180], ranges=np.ones((2, 4)))
    for more in ([], ["--size", "5,5", "--origin", "-2,-2"]):
        _, warned = accepted("build", "a.npz", "-o", "m.npz", "--force", *more)
        assert len(warned) == 1
        assert "degrees" in warned[0]
