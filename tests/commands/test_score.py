import hashlib
import json
import math
from pathlib import Path

import numpy as np
import pytest

import mapdeal
from mapdeal import OccupancyGrid, write_map


def room(shift=0):
    values = np.full((14, 20), -1, np.int8)
    values[2:12, 3:18] = 100
    values[3:11, 4:17] = 0
    if shift:
        values[3:11, 10 + shift] = 100
    return values


@pytest.fixture
def answer(sh, here):
    """What gives exit code, document and stderr of a score of these maps."""
    place = (1.5, -2.0, 0.3)
    # p_truth = p_own: the corner of the turned cells is the corner (0, width) of the first ones
    x, y = 1.5 + 20 * 0.25 * math.cos(0.3), -2.0 + 20 * 0.25 * math.sin(0.3)
    for name, values, resolution, origin in (
        ("truth", room(), 0.25, place),
        ("own", room(1), 0.25, place),
        ("other", np.rot90(room(1)), 0.25, (x - 10, y + 4, 0.3 + math.pi / 2)),
        ("empty", np.where(room() == 100, 0, room()), 0.25, place),
        ("unknown", np.full((14, 20), -1), 0.25, place),
        ("far", room(), 0.25, (900.0, 5.0, 0.0)),
        ("fine", np.kron(room(), np.ones((2, 2), np.int8)), 0.125, place),
    ):
        write_map(f"{name}.yaml", OccupancyGrid(np.ascontiguousarray(values), resolution, origin))
    Path("move.json").write_text('{"x": 10, "y": -4, "yaw": 0}')

    def ask(line):
        code, out, err = sh(f"score {line} --json")
        return code, json.loads(out), err

    return ask


PAIR = "own.yaml --truth truth.yaml"
MOVED = "other.yaml --truth own.yaml --transform move.json"


def test_a_map_alone_or_against_itself_has_the_best_of_all_figures(answer):
    code, found, err = answer("truth.yaml --truth truth.yaml")
    assert (code, err, found["transform"]["by"]) == (0, "", "frames")
    best = ["ssim_uniform7", "ssim_gauss", "iou_occupied", "iou_free", "coverage"]
    assert [found["values"][name] for name in best] == [1.0] * len(best)
    assert found["map"] == found["truth"]
    assert set(found["map"]["sha256"]) == {"truth.yaml", "truth.pgm"}
    code, found, err = answer("truth.yaml --min enclosed_areas=1")
    assert (code, err, found["truth"], found["transform"]) == (0, "", None, None)
    assert found["values"]["enclosed_areas"] == 1
    assert found["values"]["enclosed_m2"] == pytest.approx(8 * 13 / 16)


def test_a_transform_brings_the_map_onto_the_truth(answer):
    code, found, err = answer(MOVED)
    assert (code, err) == (0, "")
    assert found["values"]["iou_occupied"] == found["values"]["ssim_uniform7"] == 1.0
    assert found["transform"]["by"] == "transform"
    assert answer("other.yaml --truth own.yaml")[1]["values"]["iou_occupied"] < 0.5


@pytest.mark.parametrize(("own", "truth", "message"), [
    ("other", "own", None),
    ("own", "other", "aligned.json: leads from other to own; its inverse is used"),
    ("far", "own", "aligned.json: is between other maps"),
])  # fmt: skip
def test_a_transform_with_the_checksums_of_its_maps(answer, own, truth, message):
    document = {"transform": {"x": 10, "y": -4, "yaw": 0}}
    for end, name in (("first", "other"), ("second", "own")):
        files = [Path(f"{name}.yaml"), Path(f"{name}.pgm")]
        sums = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in files}
        document[end] = {"file": f"{name}.yaml", "sha256": sums}
    Path("aligned.json").write_text(json.dumps(document))
    _, found, err = answer(f"{own}.yaml --truth {truth}.yaml --transform aligned.json")
    assert message in err if message else err == ""
    assert (found["values"]["iou_occupied"] == 1.0) == (own != "far")


@pytest.fixture
def rooms(here):
    """A building of several rooms."""
    values = np.full((60, 90), -1, np.int8)
    values[5:55, 5:85] = 0
    values[[5, 54], 5:85] = values[5:55, [5, 84]] = 100
    values[5:40, 30], values[25, 30:60], values[40:55, 65] = 100, 100, 100
    write_map("truth.yaml", OccupancyGrid(values, 0.1, (1.5, -2.0, 0.3)))
    return values


def test_align_finds_how_the_map_lies(sh, rooms):
    turned = np.ascontiguousarray(np.rot90(rooms))
    write_map("own.yaml", OccupancyGrid(turned, 0.1, (-7.0, 3.0, 1.0)))
    line = f"score {PAIR} --align"
    found = json.loads(sh.ok(f"{line} --min iou_occupied=0.9 --min coverage=0.99 --json"))
    assert found["transform"]["by"] == "align"
    # the cells are turned by +90 degrees on a lattice at 1.0 instead of 0.3
    assert found["transform"]["yaw_deg"] == pytest.approx(math.degrees(0.3 - 1.0) + 90, abs=0.3)
    assert "found by align" in sh(line)[1]


@pytest.mark.usefixtures("rooms")
def test_a_map_that_cannot_be_aligned_with_certainty_has_no_score(sh):
    hall = np.zeros((80, 80), np.int8)
    hall[[0, -1]] = 100
    write_map("hall.yaml", OccupancyGrid(hall, 0.1))
    err = sh.err("score hall.yaml --truth truth.yaml --align", 1)
    assert err.startswith("error: hall.yaml: cannot be aligned to truth.yaml with certainty: ")
    assert "hint: --transform" in err


UNKNOWN = "truth.yaml --truth unknown.yaml"


@pytest.mark.usefixtures("answer")
@pytest.mark.parametrize(("words", "code", "message"), [
    (f"{PAIR} --min coverage=1", 0, "--min coverage=1: holds, found 1"),
    (f"{PAIR} --max dist_est_to_truth_m.max=1", 0, "max=1 m: holds, found 1 m"),
    (f"{PAIR} --max dist_est_to_truth_m.max=0.9", 1, "max=0.9 m: missed, found 1 m"),
    ("truth.yaml --max enclosed_areas=0", 1, "--max enclosed_areas=0: missed, found 1"),
    ("truth.yaml --max enclosed_areas=0", 1, "37.1 %"),  # 104 of 280 cells are free
    (f"{UNKNOWN} --min coverage=0.5", 1, "not measured: the truth has no such cells"),
    (f"{UNKNOWN} --max dist_truth_to_est_m.mean=1", 1, "one of the maps has no walls to measure"),
    (f"{UNKNOWN} --min ssim_gauss=0", 1, "missed, not measured: the maps have no known cell in c"),
    (f"{UNKNOWN} --max confusion_known_in_both.fp=9", 1, "verdict   none: the maps have no known"),
])  # fmt: skip
def test_bounds_decide_the_exit_code_and_are_printed(sh, words, code, message):
    found, out, _ = sh(f"score {words}")
    assert (found, message in out) == (code, True), out


@pytest.mark.parametrize(("own", "truth", "message"), [
    ("empty", "truth", "empty.yaml: has no occupied cell there, so no distances"),
    ("truth", "empty", "empty.yaml: has no occupied cell there, so no distances"),
    ("truth", "unknown", "unknown.yaml: has no known cell, so there is nothing to compare w"),
    ("far", "truth", "far.yaml: has no known cell on truth.yaml; --align finds how the maps"),
    ("fine", "truth", "fine.yaml: has cells of 0.125 m, truth.yaml of 0.25 m"),
])  # fmt: skip
def test_what_says_little_is_warned_of(answer, own, truth, message):
    code, found, err = answer(f"{own}.yaml --truth {truth}.yaml --max dist_est_to_truth_m.mean=0.5")
    assert message in err
    assert (found["verdict"] is None) == (own == "far" or truth == "unknown")
    mean = found["values"]["dist_est_to_truth_m"]["mean"]
    assert (code, mean is None) == ((0, False) if own == "fine" else (1, True))
    assert found["bounds"][0]["found"] == mean


def test_values_between_states_are_reported(answer):
    write_map("raw.npz", OccupancyGrid(np.where(room() == 0, 30, room()), 0.25, (1.5, -2.0, 0.3)))
    _, found, err = answer("raw.npz --truth truth.yaml")
    assert "raw.npz: 104 cells of 1..99 count as unknown" in err
    assert found["values"]["coverage_free"] == 0.0


def test_python_gives_what_the_command_prints(answer):
    bounds = {"coverage": 0.5, "iou_free": 1.0, "dist_est_to_truth_m.mean": 0.5}
    words = " ".join(f"--min {name}={value}" for name, value in bounds.items())
    code, printed, _ = answer(f"{MOVED} {words}")
    assert (code, printed["passes"]) == (1, False)
    printed_bounds = [(bound["name"], bound["side"], bound["holds"]) for bound in printed["bounds"]]
    assert printed_bounds == [(name, "min", not name.startswith("dist")) for name in bounds]
    found = mapdeal.score("other.yaml", "own.yaml", transform="move.json", minimum=bounds)
    assert found.document() == printed
    other_map, own = (mapdeal.read_map(f"{name}.yaml") for name in ("other", "own"))
    same = mapdeal.score(other_map, own, transform=(10, -4, 0), minimum=bounds)
    assert same.values == printed["values"]
    assert same.document() == {**printed, "map": None, "truth": None}
    assert mapdeal.score(other_map, "own.yaml", transform="move.json").values == printed["values"]
    assert mapdeal.score(own).values["enclosed_areas"] == 2
