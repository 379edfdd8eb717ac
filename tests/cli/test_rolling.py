"""The command local: windows of a map, cells that nothing has seen, and rolling sequences."""

import json
import shutil

import numpy as np
import pytest

from drawn import grid_from_text
from mapdeal import (
    LocalOptions,
    OccupancyGrid,
    RollingMapper,
    read_map,
    write_map,
)

SIZE = ["--size", "3,2", "--resolution", "0.1", "--no-images"]


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A map whose corner is not a multiple of its cells, and a cloud."""
    monkeypatch.chdir(tmp_path)
    values = np.random.default_rng(3).choice([-1, 0, 100], (30, 40), p=[0.3, 0.69, 0.01])
    write_map("known.yaml", OccupancyGrid(values, 0.1, (-2.03, -1.06, 0.0)))
    np.savetxt("c.csv", [[0.62, 0.04], [-0.41, 0.33]], delimiter=",")
    return tmp_path


def local_manifest(folder):
    return json.loads((folder / "manifest.json").read_text())


def test_without_a_cloud_it_is_the_map_s_window(command, place):
    code, out, err = command("local", "--map", "known.yaml", "--pose", "0.52,0.31,1.2", "-o", "o",
                             "--size", "3,2", "--no-images")  # fmt: skip
    assert (code, err) == (0, "")
    assert out.startswith("known.yaml -> o: ")
    known, made = read_map("known.yaml"), read_map("o/local.yaml")
    assert made.resolution == 0.1  # the map's, not 0.05
    assert made.shape == (20, 30)
    (first,) = known.frame.unbounded_rowcol_from_xy(made.frame.xy_from_rowcol([[0, 0]]))
    row, col = first.tolist()
    assert (row, col) == (3, 10)
    assert np.array_equal(made.occupancy, known.occupancy[row : row + 20, col : col + 30])
    manifest = local_manifest(place / "o")
    assert set(manifest["inputs"]) == {"known.yaml", "known.pgm"}
    figures = manifest["figures"]["local"]
    assert "points" not in figures
    assert figures["from_map"] == figures["occupied"]


@pytest.mark.usefixtures("mapdeal_warnings")
def test_a_window_at_the_map_s_edge_is_unknown_beyond_it(command, place):
    command("local", "--map", "known.yaml", "--pose", "-2,-1,0", "-o", "a", "--size", "2,2",
            "--no-images")  # fmt: skip
    command("local", "--map", "known.yaml", "--pose", "-2,-1,0", "-o", "b", "--size", "2,2",
            "--no-images", "--unknown", "free")  # fmt: skip
    kept, free = (read_map(f"{folder}/local.yaml").occupancy for folder in "ab")
    assert (kept[:9] == -1).all()
    assert (kept[:, :9] == -1).all()
    assert np.array_equal(free, np.where(kept == -1, 0, kept))
    costs = read_map("a/cost.npz")
    assert (costs.cost[:2, :2] == -1).all()


def test_the_square_kernel_and_rings_around_a_robot(command, place):
    """A wall of one cell at 0.2 m cells: 0.3 m are two cells each way, then rings of a cell."""
    values = np.zeros((1, 12), np.int8)
    values[0, 5] = 100
    write_map("wall.npz", OccupancyGrid(values, 0.2, (-1.0, 0.3, 0.0)))
    words = ["local", "--map", "wall.npz", "--pose", "0.2,0.4,0", "--size", "2.4,0.2", "-o", "o"]
    code, _, _ = command(*words, "--recipe", "design-local", "--no-images")
    assert code == 0
    assert read_map("o/inflated.yaml").occupancy.tolist() == [[0] * 3 + [100] * 5 + [0] * 4]
    assert read_map("o/cost.npz").cost[0].tolist() == [50, 70, 90, *[100] * 5, 90, 70, 50, 0]
    run = ["run", "wall.npz", "--recipe", "design-local", "-o", "r", "--no-images"]
    assert command(*run)[0] == 0
    assert np.array_equal(read_map("r/wall/cost.npz").cost, read_map("o/cost.npz").cost)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("", "--cloud: a cloud or --map is required"),
        ("--map known.yaml --min-height 0.1", "--min-height: applies to clouds: it needs --cloud"),
        ("--map known.yaml --frame map", "--frame: applies to clouds"),
        ("--map known.yaml --require-points", "--require-points: applies to clouds"),
        ("--cloud c.csv --keep 3", "--keep: applies to a sequence: it needs --poses"),
    ],
)
def test_options_that_do_not_go_together_are_refused(command, place, words, told):
    code, out, err = command("local", *words.split(), "--pose", "0,0,0", "-o", "o")
    assert (code, out) == (2, "")
    assert told in err
    assert len(err.splitlines()) == 1
    assert not (place / "o").exists()


@pytest.mark.parametrize("keep", ["0", "-1", "some", "1.5", "", "99999999999", "٣"])
def test_a_number_of_clouds_that_cannot_be_is_refused(command, place, keep):
    (place / "p.txt").write_text("0 0 0\n")
    code, _, err = command("local", "--cloud", "c.csv", "--poses", "p.txt", f"--keep={keep}", "-o",
                           "o")  # fmt: skip
    assert code == 2
    assert "--keep: must be a number of clouds, at least 1, or all" in err


def test_unknown_keep_without_anything_to_know_from_is_told(command, place):
    words = ["local", "--cloud", "c.csv", "--pose", "0,0,0", *SIZE, "-o"]
    code, _, err = command(*words, "a", "--unknown", "keep")
    assert code == 0
    assert err == (
        "warning: --unknown keep has no effect without --map or --keep: cells without points are "
        "free\n"
    )
    assert command(*words, "b")[2] == ""
    assert set(np.unique(read_map("a/local.yaml").occupancy)) == {0, 100}


POSES = [(0.05 * k, 0.03 * k, 0.1 * k) for k in range(7)]


@pytest.fixture
def sequence(place):
    """Seven clouds around a robot that moves on, the fourth broken."""
    folder = place / "scans"
    folder.mkdir()
    rng = np.random.default_rng(1)
    for k in range(7):
        np.savetxt(folder / f"{k}.csv", rng.uniform(-1.6, 1.6, (9, 2)), delimiter=",")
    (place / "poses.txt").write_text("\n".join(" ".join(map(str, pose)) for pose in POSES))
    return folder


def expected(sequence, keep, *, without=(), **options):
    known = options.pop("global_map", None)
    mapper = RollingMapper(
        POSES, LocalOptions(size=(3, 2), resolution=0.1, **options), keep=keep, global_map=known
    )
    for k in range(7):
        if k in without:
            mapper.skip()
            yield None
        else:
            mapper.add(np.loadtxt(sequence / f"{k}.csv", delimiter=",", ndmin=2))
            yield mapper.result()


def rolling(command, *words, keep="3", out="o"):
    return command("local", "--cloud", "scans", "--poses", "poses.txt", "--keep", keep, *SIZE,
                   "-o", out, *words)  # fmt: skip


@pytest.mark.parametrize(("keep", "number"), [("3", 3), ("1", 1), ("all", None)])
def test_a_rolling_sequence(command, sequence, keep, number):
    code, out, _ = rolling(command, keep=keep)
    assert code == 0
    assert out.startswith("o: 7 done")
    for k, made in enumerate(expected(sequence, number)):
        found = read_map(f"o/{k:04}/local.yaml")
        assert np.array_equal(found.occupancy, made.grid.occupancy)
        assert found.origin == made.grid.origin
        manifest = local_manifest(sequence.parent / "o" / f"{k:04}")
        figures = manifest["figures"]["local"]
        assert figures["clouds"] == min(k + 1, number or 7)
        assert figures["from_earlier"] == made.from_earlier
        assert manifest["stages"][0]["local"]["keep"] == (number or "all")
        assert list(manifest["inputs"]) == [f"{k}.csv"]


def test_a_rolling_sequence_on_a_map(command, sequence):
    known = grid_from_text("#..?\n....\n.#..", 0.1, (-0.5, 0.5, 0.0))
    write_map("small.npz", known)
    code, _, _ = rolling(command, "--map", "small.npz", "--unknown", "free", "--max-range", "1.2",
                         "--raytrace-range", "1")  # fmt: skip
    assert code == 0
    options = {"unknown": "free", "max_range": 1.2, "raytrace_range": 1.0, "global_map": known}
    for k, made in enumerate(expected(sequence, 3, **options)):
        assert np.array_equal(read_map(f"o/{k:04}/local.yaml").occupancy, made.grid.occupancy)


def contents(folder):
    return {
        str(p.relative_to(folder)): p.read_bytes()
        for p in sorted(folder.rglob("*"))
        if p.is_file() and p.name != "summary.json"
    }


@pytest.mark.parametrize("keep", ["2", "all"])
def test_a_rolling_sequence_goes_on_where_it_stopped(command, sequence, keep):
    assert rolling(command, keep=keep)[0] == 0
    whole = contents(sequence.parent / "o")
    for k in (3, 5, 6):
        shutil.rmtree(sequence.parent / "o" / f"{k:04}")
    code, out, _ = rolling(command, keep=keep)
    assert (code, out[:27]) == (0, "o: 3 done, 4 unchanged, 0 f")
    assert contents(sequence.parent / "o") == whole


def test_a_cloud_that_changes_changes_the_maps_after_it(command, sequence):
    assert rolling(command)[0] == 0
    np.savetxt(sequence / "2.csv", [[0.5, 0.1]], delimiter=",")
    code, _, err = rolling(command)
    assert code == 5
    told = [line.split("/")[1] for line in err.splitlines() if line.startswith("error: o/")]
    assert told == ["0002", "0003", "0004"]
    (sequence.parent / "poses.txt").write_text(
        "\n".join(" ".join(map(str, pose)) for pose in [*POSES[:-2], (0.4, 0, 0), POSES[-1]])
    )
    rolling(command, "--force", out="o")
    code, out, _ = rolling(command)
    assert (code, out[:11]) == (0, "o: 0 done, ")


def test_a_bad_cloud_is_left_out_of_the_maps_after_it(command, sequence):
    (sequence / "3.csv").write_text("0.5,0.5\na,b\n")
    code, out, err = rolling(command)
    assert code == 5
    assert "6 done, 0 unchanged, 1 failed" in out
    assert "error: scans/3.csv: line 2" in err
    told = "1 of the clouds before it could not be read: the map is without them"
    warned = [line for line in err.splitlines() if told in line]
    assert [line.split(":")[1].strip() for line in warned] == ["scans/4.csv", "scans/5.csv"]
    for k, made in enumerate(expected(sequence, 3, without=[3])):
        if made is None:
            assert not (sequence.parent / "o" / f"{k:04}").exists()
        else:
            found = read_map(f"o/{k:04}/local.yaml").occupancy
            assert np.array_equal(found, made.grid.occupancy)
    code, out, _ = rolling(command)
    assert (code, out[:24]) == (5, "o: 0 done, 6 unchanged, ")


def test_outputs_in_the_way_do_not_take_a_cloud_from_the_maps_after_it(command, sequence):
    (sequence.parent / "o" / "0003").mkdir(parents=True)
    (sequence.parent / "o" / "0003" / "cost.npz").write_bytes(b"somebody's")
    assert rolling(command)[0] == 5
    for k, made in enumerate(expected(sequence, 3)):
        if k != 3:
            found = read_map(f"o/{k:04}/local.yaml").occupancy
            assert np.array_equal(found, made.grid.occupancy)


def test_windows_too_far_apart_to_remember_all_between_are_refused(command, sequence):
    lines = [f"{1e5 * k} {1e5 * k} 0" for k in range(7)]
    (sequence.parent / "poses.txt").write_text("\n".join(lines))
    code, _, err = rolling(command, keep="all")
    assert code == 3
    assert err.startswith("error: scans/0.csv: 6000030 x 6000020 cells to remember need ")
    assert err.endswith("; a smaller --keep takes less\n")
    assert not (sequence.parent / "o").exists()
    assert rolling(command, keep="1")[0] == 0


def test_a_real_log_rolls_as_it_is_built(command, real_maps, tmp_path, monkeypatch):
    """Forty scans of the Intel Research Lab, against log-odds in which the last beam wins.

    Of the cells that both know, those differ which one scan both hits and passes: there build
    takes the last beam, and a local map the hit.
    """
    from mapdeal import Frame, MapBuilder, Scans
    from mapdeal.mapping.evidence import BeamLimits
    from mapdeal.sensors.scans import open_log

    monkeypatch.chdir(tmp_path)
    log = open_log(real_maps / "acschaefer__ple" / "intel-corrected.log")
    poses, angles, ranges, _ = next(iter(log.scans()))
    poses, ranges = poses[:40], ranges[:40]
    (tmp_path / "scans").mkdir()
    builder = MapBuilder(
        Frame(1200, 1200, 0.05, (-30.0, -30.0, 0.0)), "log-odds",
        BeamLimits(range_max=29.0, clear_max=29.0), log_free=-100.0, log_occ=100.0,
    )  # fmt: skip
    for k, (pose, row) in enumerate(zip(poses, ranges, strict=True)):
        points = np.stack([row * np.cos(angles), row * np.sin(angles)], axis=1)
        np.save(f"scans/{k:02}.npy", points)
        order = np.argsort(-row, kind="stable")  # far ones first: hits are not passed afterwards
        builder.add(Scans([pose], np.asarray(angles)[order], row[np.newaxis, order]))
    np.savetxt("poses.txt", poses, fmt="%.17g")
    code, _, _ = command("local", "--cloud", "scans", "--poses", "poses.txt", "--keep", "all",
                         "--max-range", "29", "--size", "16,14", "--no-images",
                         "-o", "o")  # fmt: skip
    assert code == 0
    local, built = read_map("o/0039/local.yaml"), builder.result().grid
    (first,) = built.frame.unbounded_rowcol_from_xy(local.frame.xy_from_rowcol([[0, 0]]))
    row, col = first.tolist()
    shared = built.occupancy[row : row + local.shape[0], col : col + local.shape[1]]
    assert np.array_equal(local.unknown(), shared == -1)
    differing = np.count_nonzero(local.occupancy != shared)
    assert differing <= 0.001 * np.count_nonzero(shared != -1)
