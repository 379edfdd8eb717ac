import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import oracles
from mapdeal import build_map, read_map

METHODS = ("log-odds", "counting", "tsdf")
PAIRS = [("log-odds", "counting"), ("log-odds", "tsdf"), ("counting", "tsdf")]
FILES = [f"{method}.{end}" for method in METHODS for end in ("pgm", "yaml", "png")]
FILES = sorted([*FILES, *("_".join(pair) + ".png" for pair in PAIRS), "comparison.json"])
STATES = {100: "occupied", 0: "free", -1: "unknown"}
GRID = {"resolution": 0.1, "size": (7.3, 5.1), "origin": (-0.55, -0.35)}
COMPARE = "build hall.npz --compare --resolution 0.1"
LINE = f"{COMPARE} --size 7.3,5.1 --origin -0.55,-0.35"


@pytest.fixture
def run(here):
    """Noisy scans in a hall of 6 m x 4 m with a post that most beams miss."""
    rng = np.random.default_rng(8)
    poses = np.column_stack([rng.uniform(1, 5, 12), rng.uniform(1, 3, 12), rng.uniform(-3, 3, 12)])
    angles = np.radians(np.arange(-180, 180, 2))
    ranges = np.empty((12, 180))
    for k, (x, y, yaw) in enumerate(poses):
        c, s = np.cos(yaw + angles), np.sin(yaw + angles)
        with np.errstate(divide="ignore"):
            ranges[k] = np.minimum(np.where(c > 0, 6.02 - x, 0.03 - x) / c,
                                   np.where(s > 0, 4.01 - y, 0.02 - y) / s)  # fmt: skip
    ranges = ranges + rng.normal(0, 0.05, ranges.shape)
    # a post seen by three scans of thirty from one place, the others pass it by
    poses = np.vstack([poses, np.tile([[0.5, 2.0, 0.1]], (30, 1))])
    post = np.full((30, 180), np.nan)
    post[:, 85:95] = 5.0
    post[:3, 85:95] = 3.0
    ranges = np.vstack([ranges, post])
    np.savez("hall.npz", poses=poses, angles=angles, ranges=ranges)
    return poses, angles, ranges


def document(folder="out"):
    return json.loads(Path(folder, "comparison.json").read_text())


def names_in(folder):
    return sorted(path.name for path in Path(folder).iterdir())


def brute_force(grid, often_hit):
    """The figures of one map, by loops."""
    occupied = grid.occupancy == 100
    thick = list(oracles.thickness(occupied).values())
    walls = np.argwhere(occupied).tolist()
    lost = [
        group
        for group in oracles.groups(often_hit)
        if len(group) >= 3
        and all(max(abs(r - y), abs(c - x)) > 2 for r, c in group for y, x in walls)
    ]
    return {
        **{name: int((grid.occupancy == value).sum()) for value, name in STATES.items()},
        "one_cell_wide": thick.count(1),
        "one_cell_wide_share": pytest.approx(thick.count(1) / len(thick), abs=1e-6),
        "mean_thickness_cells": pytest.approx(sum(thick) / len(thick), abs=1e-6),
        "mean_thickness_m": pytest.approx(0.1 * sum(thick) / len(thick), abs=1e-6),
        "vanished_groups": len(lost),
        "vanished_cells": sum(map(len, lost)),
    }


def test_figures_are_those_of_loops_over_the_cells(sh, run):
    sh.ok(f"{LINE} -o out")
    assert names_in("out") == FILES
    found = document()
    often_hit = build_map(*run, method="counting", **GRID).layers["hits"] >= 3
    assert found["cells_hit_three_times"] == often_hit.sum()
    groups = [group for group in oracles.groups(often_hit) if len(group) >= 3]
    assert found["groups_hit_three_times"] == len(groups)
    for method, bytes_per_cell in zip(METHODS, (5, 8, 20), strict=True):
        grid = build_map(*run, method=method, **GRID).grid
        written = read_map(f"out/{method}.yaml")
        assert np.array_equal(written.occupancy, grid.occupancy)
        assert written.origin == grid.origin == (*GRID["origin"], 0.0)
        expected = brute_force(grid, often_hit)
        expected["memory_bytes"] = bytes_per_cell * grid.occupancy.size
        its = found["methods"][method]
        assert its.items() >= expected.items()
        assert its["bytes_per_cell"] == bytes_per_cell
        assert sum(place["cells"] for place in its["vanished"]) == its["vanished_cells"]
        assert its["vanished_groups"] == 1  # the post
    (place,) = found["methods"]["counting"]["vanished"]
    assert abs(place["x"] - 3.45) < 0.1
    assert abs(place["y"] - 2.3) < 0.15


def test_pairs_are_counted_cell_by_cell_and_drawn(sh, run):
    sh.ok(f"{LINE} -o out")
    red, blue = (225, 30, 60), (0, 120, 220)

    def colours(name):
        with Image.open(f"out/{name}.png") as image:
            return {colour for _, colour in image.convert("RGB").getcolors(1 << 20)}

    maps = {name: read_map(f"out/{name}.yaml").occupancy for name in METHODS}
    assert all(red in colours(name) for name in METHODS)  # a ring around the post
    pairs = document()["pairs"]
    assert [(pair["first"], pair["second"]) for pair in pairs] == PAIRS
    for pair, names in zip(pairs, PAIRS, strict=True):
        first, second = (maps[name] for name in names)
        cells = {a: {b: int(((first == x) & (second == y)).sum()) for y, b in STATES.items()}
                 for x, a in STATES.items()}  # fmt: skip
        assert pair["cells"] == cells
        assert pair["differing"] == (first != second).sum() > 0
        drawn = colours("_".join(names))
        only_first = cells["occupied"]["free"] + cells["occupied"]["unknown"]
        only_second = cells["free"]["occupied"] + cells["unknown"]["occupied"]
        assert ((red in drawn), (blue in drawn)) == (only_first > 0, only_second > 0)


def test_all_methods_take_their_own_numbers(sh, run):
    numbers = "--log-occ 4 --ratio 0.05 --truncation 1.5 --truncation-behind 3"
    assert sh(f"{LINE} {numbers} -o out")[0] == 0
    options = {"log-odds": {"log_occ": 4}, "counting": {"ratio": 0.05}}
    options["tsdf"] = {"truncation": 1.5, "truncation_behind": 3}
    for method, parameters in options.items():
        grid = build_map(*run, method=method, **parameters, **GRID).grid
        assert np.array_equal(read_map(f"out/{method}.yaml").occupancy, grid.occupancy)
        used = document()["methods"][method]["parameters"]
        assert used.items() >= parameters.items()
    assert document()["methods"]["log-odds"]["parameters"]["log_free"] == -1
    assert sh(f"{LINE} --as-written -o w")[0] == 0
    grid = build_map(*run, method="tsdf", as_written=True, **GRID).grid
    assert np.array_equal(read_map("w/tsdf.yaml").occupancy, grid.occupancy)
    used = document("w")["methods"]["tsdf"]["parameters"]
    assert used == {"truncation": 2.0, "truncation_behind": 3.0, "as_written": True}
    # the grid holds what the method that reaches farthest behind hits does: 4.5 cells
    assert sh(f"{COMPARE} {numbers} -o a")[0] == 0
    alone = build_map(*run, method="tsdf", resolution=0.1, **options["tsdf"]).grid
    assert read_map("a/log-odds.yaml").frame == alone.frame


@pytest.mark.usefixtures("run")
def test_the_table_and_json_hold_the_same_figures(sh):
    lines = sh.ok(f"{LINE} -o out").splitlines()
    assert lines[0] == "out: 73 x 51 cells at -0.55, -0.35"
    for line, (method, its) in zip(lines[4:7], document()["methods"].items(), strict=True):
        share = f"{100 * its['one_cell_wide_share']:.1f}"
        mean = f"{its['mean_thickness_cells']:.2f}"
        cells = [method, *(str(its[state]) for state in STATES.values()), share, "%", mean, "1"]
        assert line.split()[:8] == cells
    timed = sh.json(f"{LINE} -o other --json")
    assert all(timed["methods"][method].pop("seconds") > 0 for method in METHODS)
    assert timed == document("other") == document("out")
    assert sh.ok(f"{LINE} -o quiet -q") == ""


@pytest.mark.usefixtures("run")
def test_the_output_must_be_a_folder_and_files_in_it_stay(sh):
    assert "must be a folder, not a file, got 'out.yaml'" in sh.err(f"{COMPARE} -o out.yaml", 2)
    Path("out").mkdir()
    Path("out/tsdf.png").write_bytes(b"mine")
    assert "out/tsdf.png" in sh.err(f"{COMPARE} -o out", 4)
    assert names_in("out") == ["tsdf.png"]
    assert sh(f"{COMPARE} -o out --force")[0] == 0
    assert names_in("out") == FILES


@pytest.mark.usefixtures("run")
def test_nothing_seen_has_no_thickness(sh):
    err = sh.err(f"{COMPARE} -o out --size 2,2 --origin 90,90")
    assert err == "warning: hall.npz: no beam reaches the grid: the whole map is unknown\n"
    for figures in document()["methods"].values():
        assert figures["one_cell_wide_share"] is figures["mean_thickness_m"] is None
        assert figures["vanished_groups"] == 0


@pytest.mark.parametrize(("log", "cells", "expected"), [
    ("intel-corrected.log", 14_590, [(33.68, 21), (30.33, 14), (96.88, 14)]),
    ("aces-corrected.log.gz", 10_724, [(53.61, 14), (48.19, 12), (96.49, 13)]),
])  # fmt: skip
def test_walls_and_losses_of_real_logs_are_those_of_a_study(sh, real_maps, log, cells, expected):
    assert sh(f"build {real_maps}/acschaefer__ple/{log} --compare -o out")[0] == 0
    assert document()["cells_hit_three_times"] == cells
    assert tuple(document()["methods"]) == METHODS
    for its, (share, lost) in zip(document()["methods"].values(), expected, strict=True):
        assert round(100 * its["one_cell_wide_share"], 2) == pytest.approx(share, abs=0.011)
        assert its["vanished_groups"] == lost
