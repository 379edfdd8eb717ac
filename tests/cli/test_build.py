"""The command build: logs in, maps out."""

import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from mapdeal import build_map, read_map

ANGLES = np.radians(np.arange(-90, 90))


@pytest.fixture
def run():
    """Five scans in a hall of 6 m x 4 m, from a robot that walks along it."""
    poses = np.array([[1 + 0.5 * k, 2.0 + 0.1 * k, 0.3 * k + 0.01] for k in range(5)])
    ranges = np.empty((5, 180))
    for k, (x, y, yaw) in enumerate(poses):
        c, s = np.cos(yaw + ANGLES), np.sin(yaw + ANGLES)
        ranges[k] = np.minimum(
            np.where(c > 0, (6.02 - x) / c, (0.03 - x) / c),
            np.where(s > 0, (4.01 - y) / s, (0.02 - y) / s),
        ).round(3)
    ranges[2, 40:60] = 81.83
    ranges[3, 7] = 0.0
    return poses, ANGLES, ranges


@pytest.fixture
def log(tmp_path, monkeypatch, run):
    monkeypatch.chdir(tmp_path)
    lines = ["# a run"]
    for k, (pose, row) in enumerate(zip(run[0].tolist(), run[2].tolist(), strict=True)):
        words = ["FLASER", 180, *row, *pose, 0, 0, 0, k, "host", k]
        lines.append(" ".join(str(word) for word in words))
    (tmp_path / "hall.log").write_text("\n".join(lines) + "\n")
    np.savez(tmp_path / "hall.npz", poses=run[0], angles=run[1], ranges=run[2])
    for name, table in (("p", run[0]), ("a", run[1][np.newaxis]), ("r", run[2])):
        np.savetxt(tmp_path / f"{name}.txt", table, delimiter=",", fmt="%.17g")
    return "hall.log"


@pytest.mark.parametrize("method", ["log-odds", "counting", "tsdf"])
def test_build_writes_what_the_library_makes(sh, log, run, method):
    code, out, err = sh(f"build {log} -o m.yaml --method {method} --layers l.npz --image m.png")
    assert (code, err) == (0, "")
    built = build_map(*run, method=method)
    found = read_map("m.yaml")
    assert np.array_equal(found.occupancy, built.grid.occupancy)
    assert (found.origin, found.resolution) == (built.grid.origin, 0.05)
    assert np.array_equal(read_map("l.npz").occupancy, built.grid.occupancy)
    with np.load("l.npz") as layers:
        for name, layer in built.layers.items():
            np.testing.assert_array_equal(layers[name], layer)
    assert "  5 scans, 900 beams: 879 hits, 20 without return, 1 bad" in out
    x, y, _ = built.grid.origin
    assert f" cells at {x:.10g}, {y:.10g}, " in out
    assert Path("m.png").stat().st_size > 1000


def test_every_kind_of_source_gives_the_same_map(command, log):
    assert command("build", log, "-o", "a.npz")[0] == 0
    assert command("build", "hall.npz", "-o", "b.npz")[0] == 0
    words = ["--poses", "p.txt", "--angles", "a.txt", "--ranges", "r.txt"]
    assert command("build", *words, "-o", "c.npz")[0] == 0
    maps = [read_map(f"{name}.npz") for name in "abc"]
    # angles of a log are degrees made radians
    assert np.count_nonzero(maps[0].occupancy != maps[1].occupancy) < 5
    assert np.array_equal(maps[1].occupancy, maps[2].occupancy)


def test_options_reach_the_method_and_the_grid(sh, log, run):
    code, _, _ = sh(f"build {log} -o m.npz --resolution 0.1 --size 5,3 --origin 0.25,-0.5"
                    " --range-min 0.5 --range-max 4 --clear-max 2 --log-free -0.5 --log-occ 0.9"
                    " --log-min 20 --log-max 90 --values")  # fmt: skip
    assert code == 0
    built = build_map(*run, resolution=0.1, size=(5, 3), origin=(0.25, -0.5), range_min=0.5,
                      range_max=4, clear_max=2, log_free=-0.5, log_occ=0.9, log_min=20, log_max=90,
                      values=True)  # fmt: skip
    found = read_map("m.npz")
    assert found.origin == (0.25, -0.5, 0.0)
    differing = np.count_nonzero(found.occupancy != built.grid.occupancy)
    assert differing <= 0.001 * found.occupancy.size
    assert len(np.unique(found.occupancy)) > 5


def test_other_numbers_of_the_methods(command, log, run):
    assert command("build", log, "-o", "c.npz", "--method", "counting", "--ratio", "0.1")[0] == 0
    assert command("build", log, "-o", "t.npz", "--method", "tsdf", "--truncation", "4")[0] == 0
    words = ["--method", "tsdf", "--truncation-behind", "3"]
    assert command("build", log, "-o", "b.npz", *words)[0] == 0
    words = ["--method", "tsdf", "--as-written"]
    assert command("build", log, "-o", "w.npz", *words)[0] == 0
    for name, options in (("c", {"method": "counting", "ratio": 0.1}),
                          ("w", {"method": "tsdf", "as_written": True}),
                          ("t", {"method": "tsdf", "truncation": 4}),
                          ("b", {"method": "tsdf", "truncation_behind": 3})):  # fmt: skip
        expected = build_map(*run, **options).grid
        found = read_map(f"{name}.npz")
        assert found.shape == expected.shape
        assert np.count_nonzero(found.occupancy != expected.occupancy) <= 5


def test_y_can_be_flipped(command, log, run):
    words = ["--poses", "p.txt", "--angles", "a.txt", "--ranges", "r.txt", "--flip-y"]
    assert command("build", *words, "-o", "c.npz")[0] == 0
    poses = run[0] * (1, -1, 1)
    expected = build_map(poses, *run[1:]).grid
    assert np.array_equal(read_map("c.npz").occupancy, expected.occupancy)


@pytest.mark.thorough
def test_bytes_do_not_depend_on_threads_or_engine(log):
    found = []
    for threads, engine in ((1, "scipy"), (2, ""), (1, "")):
        for method in ("log-odds", "counting", "tsdf"):
            subprocess.run(
                [sys.executable, "-m", "mapdeal", "build", log, "-o", "m.yaml", "--method", method,
                 "--layers", "l.npz", "--force", "--threads", str(threads)],
                env={**os.environ, "MAPDEAL_KERNELS": engine}, check=True, capture_output=True,
            )  # fmt: skip
            found.append([Path(name).read_bytes() for name in ("m.pgm", "m.yaml", "l.npz")])
    assert found[:3] == found[3:6] == found[6:]


def test_real_logs_give_maps(command, real_maps, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, least in (("intel-corrected.log.gz", 36.0), ("aces-corrected.log", 23.0)):
        for method in ("log-odds", "counting", "tsdf"):
            log = real_maps / "acschaefer__ple" / name
            code, out, _ = command("build", log, "-o", "m.yaml", "--method", method, "--force")
            assert code == 0
            free = float(out.split("free ")[1].split(" %")[0])
            assert free > least
    triple = real_maps / "derived" / "run1_triple"
    words = ["--poses", triple / "pose.txt", "--angles", triple / "scanAngles.txt", "--ranges",
             triple / "ranges.txt"]  # fmt: skip
    code, out, _ = command("build", *words, "-o", "m.yaml", "--force")
    assert code == 0
    assert "460 scans, 124660 beams: 123824 hits, 0 without return, 836 bad" in out


def test_the_angle_of_view_is_where_it_should_be(command, tmp_path, monkeypatch):
    """One reading to the right, one ahead: of 180, the first and the one in the middle."""
    monkeypatch.chdir(tmp_path)
    row = [0.0] * 180
    row[0], row[90] = 1.0, 2.0
    words = ["FLASER", 180, *row, 1.0, 1.0, math.pi / 2, 0, 0, 0, 1, "h", 1]
    (tmp_path / "a.log").write_text(" ".join(map(str, words)))
    assert command("build", "a.log", "-o", "m.npz", "--resolution", "0.5")[0] == 0
    grid = read_map("m.npz")
    places = grid.frame.xy_from_rowcol(np.argwhere(grid.occupied()))
    assert sorted(places.tolist()) == [[1.25, 3.25], [2.25, 1.25]]


def seen_through(path, hits, passes, places):
    """A log of poles, three cells long, that few of the beams hit which go by to a wall."""
    lines = []
    for place in places:
        for row in range(3):
            for reading in [2.0] * hits + [6.0] * passes:
                readings = [0.0] * 90 + [reading] + [0.0] * 89
                pose = (0.0125, place + 0.04 * row + 0.0125, 0.0)
                words = ["FLASER", 180, *readings, *pose, 0, 0, 0, len(lines), "h", len(lines)]
                lines.append(" ".join(map(str, words)))
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize(
    ("method", "advice"),
    [
        ("log-odds", "--log-occ above 2 keeps more, --values keeps their evidence"),
        ("counting", "--ratio 0.24 keeps all of them"),
        ("tsdf", "--method counting with a small --ratio keeps them"),
    ],
)
def test_groups_of_hits_that_the_map_lacks_are_told(command, tmp_path, method, advice):
    log = seen_through(tmp_path / "poles.log", 3, 9, (1.0, 3.0))
    words = ["--method", method, "--resolution", "0.04"]
    code, _, err = command("build", log, "-o", tmp_path / "m.npz", *words)
    assert code == 0
    assert err == (
        f"warning: {log}: 2 groups of cells hit 3 times and more left nothing occupied within 2 "
        f"cells; the largest has 3 cells, around 2.02, 1.06; {advice}; --compare shows what each "
        "method loses\n"
    )
    log = seen_through(tmp_path / "pole.log", 3, 9, (1.0,))
    _, _, err = command("build", log, "-o", tmp_path / "n.npz", *words)
    assert ": 1 group of cells hit 3 times and more left nothing" in err
    assert "; it has 3 cells, around 2.02, 1.06; " in err


def test_what_is_advised_keeps_them(command, tmp_path):
    log = seen_through(tmp_path / "poles.log", 3, 9, (1.0, 3.0))
    counting = ["--method", "counting", "--ratio", "0.24"]
    for k, words in enumerate((counting, ["--log-occ", "3.1"], ["--values"])):
        words += ["--resolution", "0.04"]
        assert command("build", log, "-o", tmp_path / f"{k}.npz", *words)[::2] == (0, "")
