"""The rows S7 to S16 of laser scans, through the command."""

import math

import numpy as np

from mapdeal import read_map

HALF = " ".join(["2.0"] * 180)
GOOD = f"FLASER 180 {HALF} 1 2 0.5 0 0 0 7 host 7\n"
BUILD = ["build", "a.log", "-o", "out.yaml"]


def test_what_was_passed_over_is_told_also_if_there_is_no_map(folder, command):
    (folder / "a.log").write_text(GOOD.replace("2.0", "50") + GOOD[:300])
    code, _, err = command(*BUILD)
    assert code == 3
    assert "1 malformed lines ignored: line 2" in err
    assert "no beam hits anything: of 180 readings 180 are without return" in err


def test_a_truncated_last_line_is_passed_over_with_its_number_s13(folder, accepted):
    (folder / "a.log").write_text(GOOD + GOOD[:300])
    out, warned = accepted(*BUILD)
    assert len(warned) == 1
    assert "a.log: 1 malformed lines ignored: line 2: " in warned[0]
    assert "1 scans, 180 beams" in out


def test_angles_in_degrees_are_warned_of_s7(folder, accepted):
    np.savez("a.npz", poses=np.zeros((2, 3)), angles=[-90.0, 0, 90, 180], ranges=np.ones((2, 4)))
    for more in ([], ["--size", "5,5", "--origin", "-2,-2"]):
        _, warned = accepted("build", "a.npz", "-o", "m.npz", "--force", *more)
        assert len(warned) == 1
        assert "degrees" in warned[0]


def test_readings_of_every_kind_are_counted_s8(folder, accepted):
    readings = ["0", "-1", "nan", "inf", "81.83", "30", "0.3", *["2.0"] * 173]
    (folder / "a.log").write_text(f"FLASER 180 {' '.join(readings)} 1 2 0.5 0 0 0 7 host 7\n")
    out, _ = accepted(*BUILD, "--range-min", "0.5")
    assert "1 scans, 180 beams: 173 hits, 3 without return, 4 bad" in out


def test_a_robot_outside_of_the_grid_still_clears_inside_s11(folder, accepted):
    np.savez("a.npz", poses=[[-3.0, 0.25, 0.0]], angles=[0.0], ranges=[[9.0]])
    for method in ("log-odds", "counting", "tsdf"):
        accepted("build", "a.npz", "-o", f"{method}.npz", "--method", method, "--size", "2,0.5",
                 "--origin", "0,0", "--resolution", "0.5")  # fmt: skip
        assert read_map(folder / f"{method}.npz").occupancy.tolist() == [[0, 0, 0, 0]]


def test_a_grid_that_no_beam_reaches_is_warned_of(folder, accepted):
    (folder / "a.log").write_text(GOOD)
    _, warned = accepted(*BUILD, "--size", "1,1", "--origin", "50,50")
    assert len(warned) == 1
    assert "the whole map is unknown" in warned[0]


def test_a_beam_within_one_cell_is_a_hit_alone_s12(folder, accepted):
    np.savez("a.npz", poses=[[0.1, 0.1, 0.0]], angles=[0.0], ranges=[[0.05]])
    accepted("build", "a.npz", "-o", "m.npz", "--resolution", "0.5", "--layers", "l.npz",
             "--method", "counting")  # fmt: skip
    with np.load(folder / "l.npz") as layers:
        assert (layers["hits"].sum(), layers["misses"].sum()) == (1, 0)


def test_a_clockwise_scanner_sees_the_same_s9(folder, accepted):
    angles, ranges, found = np.linspace(-1, 1, 9), np.linspace(1, 2, 9), []
    for step in (1, -1):
        beams = {"angles": angles[::step], "ranges": ranges[np.newaxis, ::step]}
        np.savez("a.npz", poses=[[0.0, 0.0, math.pi / 3]], **beams)
        accepted("build", "a.npz", "-o", "m.npz", "--method", "counting", "--force")
        found.append(read_map("m.npz").occupancy)
    assert np.array_equal(*found)
