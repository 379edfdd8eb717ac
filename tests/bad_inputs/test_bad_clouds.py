"""The rows S1 to S7 of clouds and poses, through the command."""

import numpy as np
import pytest

from mapdeal import read_map
from traced_memory import memory_below

GOOD = "1 0 0\n0 1 0\n"
LOCAL = ["local", "--cloud", "c.xyz", "-o", "out", "--no-images", "--size", "4,4"]
POSE = ["--pose", "0,0,0"]


def test_outputs_that_exist_need_force_and_the_hint_tells_whether_anything_differs(
    folder, refused, accepted
):
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
