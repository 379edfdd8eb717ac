"""The command local: windows of a map, cells that nothing has seen, and rolling sequences."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from bad_maps import tree
from drawn import grid_from_text
from mapdeal import (
    Frame,
    LocalOptions,
    MapBuilder,
    OccupancyGrid,
    RollingMapper,
    Scans,
    read_map,
    write_map,
)
from mapdeal.mapping.evidence import BeamLimits
from mapdeal.sensors.scans import open_log

ROLLING = "local --cloud scans --poses poses.txt --size 3,2 --resolution 0.1 --no-images -o o"


@pytest.fixture(autouse=True)
def place(here):
    """A map whose corner is not a multiple of its cells, and a cloud."""
    values = np.random.default_rng(3).choice([-1, 0, 100], (30, 40), p=[0.3, 0.69, 0.01])
    write_map("known.yaml", OccupancyGrid(values, 0.1, (-2.03, -1.06, 0.0)))
    np.savetxt("c.csv", [[0.62, 0.04], [-0.41, 0.33]], delimiter=",")


def local_manifest(folder):
    return json.loads(Path(folder, "manifest.json").read_text())


def test_without_a_cloud_it_is_the_map_s_window(sh):
    out = sh.ok("local --map known.yaml --pose 0.52,0.31,1.2 -o o --size 3,2 --no-images")
    assert out.startswith("known.yaml -> o: ")
    known, made = read_map("known.yaml"), read_map("o/local.yaml")
    assert (made.resolution, made.shape) == (0.1, (20, 30))  # the map's, not 0.05
    (first,) = known.frame.unbounded_rowcol_from_xy(made.frame.xy_from_rowcol([[0, 0]]))
    assert first.tolist() == [3, 10]
    assert np.array_equal(made.occupancy, known.occupancy[3:23, 10:40])
    manifest = local_manifest("o")
    assert set(manifest["inputs"]) == {"known.yaml", "known.pgm"}
    figures = manifest["figures"]["local"]
    assert (figures["from_map"], "points" in figures) == (figures["occupied"], False)


def test_unknown_keep_without_anything_to_know_from_is_told(sh):
    line = "local --cloud c.csv --pose 0,0,0 --size 3,2 --resolution 0.1 --no-images -o"
    told = "--unknown keep has no effect without --map or --keep: cells without points are free"
    assert sh.err(f"{line} a --unknown keep") == f"warning: {told}\n"
    sh.ok(f"{line} b")
    assert set(np.unique(read_map("a/local.yaml").occupancy)) == {0, 100}


POSES = [(0.05 * k, 0.03 * k, 0.1 * k) for k in range(7)]


@pytest.fixture
def sequence(here):
    """Seven clouds around a robot that moves on."""
    Path("scans").mkdir()
    rng = np.random.default_rng(1)
    for k in range(7):
        np.savetxt(f"scans/{k}.csv", rng.uniform(-1.6, 1.6, (9, 2)), delimiter=",")
    np.savetxt("poses.txt", POSES, fmt="%.17g")


def check(keep, without=(), in_the_way=(), *, global_map=None, **options):
    """Hold the local maps to those of the library; return those."""
    options = LocalOptions(size=(3, 2), resolution=0.1, **options)
    mapper = RollingMapper(POSES, options, keep=keep, global_map=global_map)
    made = {}
    for k in range(7):
        if k in without:
            mapper.skip()
            continue
        mapper.add(np.loadtxt(f"scans/{k}.csv", delimiter=",", ndmin=2))
        made[k] = mapper.result()
        if k not in in_the_way:
            found = read_map(f"o/{k:04}/local.yaml")
            assert np.array_equal(found.occupancy, made[k].grid.occupancy)
            assert found.origin == made[k].grid.origin
    return made


SMALL = grid_from_text("#..?\n....\n.#..", 0.1, (-0.5, 0.5, 0.0))
ON_A_MAP = "--map small.npz --unknown free --max-range 1.2 --raytrace-range 1"
OF_MAP = {"global_map": SMALL, "unknown": "free", "max_range": 1.2, "raytrace_range": 1.0}


@pytest.mark.parametrize(
    ("words", "number", "options"), [("3", 3, {}), ("all", None, {}), (f"3 {ON_A_MAP}", 3, OF_MAP)]
)
def test_a_rolling_sequence(sh, words, number, options, sequence):
    write_map("small.npz", SMALL)
    assert sh(f"{ROLLING} --keep {words}")[1].startswith("o: 7 done")
    for k, made in check(number, **options).items():
        manifest = local_manifest(f"o/{k:04}")
        figures = manifest["figures"]["local"]
        assert figures["clouds"] == min(k + 1, number or 7)
        assert figures["from_earlier"] == made.from_earlier
        assert manifest["stages"][0]["local"]["keep"] == (number or "all")
        assert next(iter(manifest["inputs"])) == f"{k}.csv"


@pytest.mark.parametrize("keep", ["2", "all"])
def test_a_rolling_sequence_goes_on_where_it_stopped(sh, here, keep, sequence):
    def contents():
        return {name: data for name, data in tree(here / "o").items() if name != "summary.json"}

    assert sh(f"{ROLLING} --keep {keep}")[0] == 0
    whole = contents()
    for k in (3, 5, 6):
        shutil.rmtree(f"o/{k:04}")
    code, out, _ = sh(f"{ROLLING} --keep {keep}")
    assert (code, out[:27]) == (0, "o: 3 done, 4 unchanged, 0 f")
    assert contents() == whole


def test_a_cloud_that_changes_changes_the_maps_after_it(sh, sequence):
    line = f"{ROLLING} --keep 3"
    assert sh(line)[0] == 0
    np.savetxt("scans/2.csv", [[0.5, 0.1]], delimiter=",")
    err = sh.err(line, 5)
    told = [text.split("/")[1] for text in err.splitlines() if text.startswith("error: o/")]
    assert told == ["0002", "0003", "0004"]
    np.savetxt("poses.txt", [*POSES[:-2], (0.4, 0, 0), POSES[-1]])
    sh(f"{line} --force")
    code, out, _ = sh(line)
    assert (code, out[:11]) == (0, "o: 0 done, ")


def test_a_bad_cloud_is_left_out_of_the_maps_after_it(sh, sequence):
    Path("scans/3.csv").write_text("0.5,0.5\na,b\n")
    code, out, err = sh(f"{ROLLING} --keep 3")
    assert (code, "6 done, 0 unchanged, 1 failed" in out) == (5, True)
    assert "error: scans/3.csv: line 2" in err
    told = "1 of the clouds before it could not be read: the map is without them"
    warned = [line.split(":")[1].strip() for line in err.splitlines() if told in line]
    assert warned == ["scans/4.csv", "scans/5.csv"]
    check(3, without=[3])
    assert not Path("o/0003").exists()
    code, out, _ = sh(f"{ROLLING} --keep 3")
    assert (code, out[:24]) == (5, "o: 0 done, 6 unchanged, ")


def test_outputs_in_the_way_do_not_take_a_cloud_from_the_maps_after_it(sh, sequence):
    Path("o/0003").mkdir(parents=True)
    Path("o/0003/cost.npz").write_bytes(b"somebody's")
    assert sh(f"{ROLLING} --keep 3")[0] == 5
    check(3, in_the_way=[3])


def test_windows_too_far_apart_to_remember_all_between_are_refused(sh, sequence):
    np.savetxt("poses.txt", [(1e5 * k, 1e5 * k, 0) for k in range(7)])
    err = sh.err(f"{ROLLING} --keep all", 3)
    assert err.startswith("error: scans/0.csv: 6000030 x 6000020 cells to remember need ")
    assert err.endswith("; a smaller --keep takes less\n")
    assert not Path("o").exists()
    assert sh(f"{ROLLING} --keep 1")[0] == 0


def test_a_real_log_rolls_as_it_is_built(sh, real_maps):
    """Scans of the Intel Research Lab, against log-odds in which the last beam wins.

    Of the cells that both know, those differ which one scan both hits and passes: there build
    takes the last beam, and a local map the hit.
    """
    log = open_log(real_maps / "acschaefer__ple" / "intel-corrected.log")
    poses, angles, ranges, _ = next(iter(log.scans()))
    Path("scans").mkdir()
    frame, limits = Frame(1200, 1200, 0.05, (-30.0, -30.0, 0.0)), BeamLimits(0, 29, 29)
    builder = MapBuilder(frame, "log-odds", limits, log_free=-100.0, log_occ=100.0)
    for k, (pose, row) in enumerate(zip(poses[:20], ranges[:20], strict=True)):
        points = np.stack([row * np.cos(angles), row * np.sin(angles)], axis=1)
        np.save(f"scans/{k:02}.npy", points)
        order = np.argsort(-row, kind="stable")  # far ones first: hits are not passed afterwards
        builder.add(Scans([pose], np.asarray(angles)[order], row[np.newaxis, order]))
    np.savetxt("poses.txt", poses[:20], fmt="%.17g")
    line = "local --cloud scans --poses poses.txt --keep all --max-range 29 --size 16,14"
    assert sh(f"{line} --no-images -o o")[0] == 0
    local, built = read_map("o/0019/local.yaml"), builder.result().grid
    (first,) = built.frame.unbounded_rowcol_from_xy(local.frame.xy_from_rowcol([[0, 0]]))
    row, col = first.tolist()
    shared = built.occupancy[row : row + local.shape[0], col : col + local.shape[1]]
    assert np.array_equal(local.unknown(), shared == -1)
    differing = np.count_nonzero(local.occupancy != shared)
    assert differing <= 0.001 * np.count_nonzero(shared != -1)
