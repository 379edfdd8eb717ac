"""build --compare: three methods on one log."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import oracles
from mapdeal import build_map, read_map

METHODS = ("log-odds", "counting", "tsdf")
PAIRS = [("log-odds", "counting"), ("log-odds", "tsdf"), ("counting", "tsdf")]
FILES = sorted(
    [f"{method}.{end}" for method in METHODS for end in ("pgm", "yaml", "png")]
    + [f"{first}_{second}.png" for first, second in PAIRS]
    + ["comparison.json"]
)
STATES = {100: "occupied", 0: "free", -1: "unknown"}
GRID = {"resolution": 0.1, "size": (7.3, 5.1), "origin": (-0.55, -0.35)}
WORDS = ["--resolution", "0.1", "--size", "7.3,5.1", "--origin", "-0.55,-0.35"]


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Noisy scans in a hall of 6 m x 4 m with a post that most beams miss."""
    monkeypatch.chdir(tmp_path)
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


def test_figures_are_those_of_loops_over_the_cells(command, run):
    code, _, err = command("build", "hall.npz", "--compare", "-o", "out", *WORDS)
    assert (code, err) == (0, "")
    assert sorted(path.name for path in Path("out").iterdir()) == FILES
    found = document()
    often_hit = build_map(*run, method="counting", **GRID).layers["hits"] >= 3
    assert found["cells_hit_three_times"] == often_hit.sum()
    groups = [group for group in oracles.groups(often_hit) if len(group) >= 3]
    assert found["groups_hit_three_times"] == len(groups)
    for method in METHODS:
        grid = build_map(*run, method=method, **GRID).grid
        written = read_map(Path("out", f"{method}.yaml"))
        assert np.array_equal(written.occupancy, grid.occupancy)
        assert written.origin == grid.origin == (*GRID["origin"], 0.0)
        expected = brute_force(grid, often_hit)
        its = found["methods"][method]
        assert {name: its[name] for name in expected} == expected
        assert sum(place["cells"] for place in its["vanished"]) == its["vanished_cells"]
        assert its["memory_bytes"] == its["bytes_per_cell"] * grid.occupancy.size
    lost = [found["methods"][method]["vanished_groups"] for method in METHODS]
    assert lost == [1, 1, 1]  # the post
    (place,) = found["methods"]["counting"]["vanished"]
    assert abs(place["x"] - 3.45) < 0.1
    assert abs(place["y"] - 2.3) < 0.15
    assert [found["methods"][method]["bytes_per_cell"] for method in METHODS] == [5, 8, 20]


def test_pairs_are_counted_cell_by_cell(command, run):
    assert command("build", "hall.npz", "--compare", "-o", "out", *WORDS)[0] == 0
    maps = {name: read_map(Path("out", f"{name}.yaml")).occupancy for name in METHODS}
    pairs = document()["pairs"]
    assert [(pair["first"], pair["second"]) for pair in pairs] == PAIRS
    for pair in pairs:
        counts = {a: dict.fromkeys(STATES.values(), 0) for a in STATES.values()}
        for cell in np.ndindex(maps["tsdf"].shape):
            counts[STATES[maps[pair["first"]][cell]]][STATES[maps[pair["second"]][cell]]] += 1
        assert pair["cells"] == counts
        differing = (maps[pair["first"]] != maps[pair["second"]]).sum()
        assert pair["differing"] == differing > 0


def test_all_methods_take_their_own_numbers(command, run):
    words = ["--log-occ", "4", "--ratio", "0.05", "--truncation", "1.5", "--truncation-behind", "3"]
    assert command("build", "hall.npz", "--compare", "-o", "out", *WORDS, *words)[0] == 0
    given = {
        "log-odds": {"log_occ": 4},
        "counting": {"ratio": 0.05},
        "tsdf": {"truncation": 1.5, "truncation_behind": 3},
    }
    for method, parameters in given.items():
        grid = build_map(*run, method=method, **parameters, **GRID).grid
        written = read_map(Path("out", f"{method}.yaml"))
        assert np.array_equal(written.occupancy, grid.occupancy)
        used = document()["methods"][method]["parameters"]
        assert used.items() >= parameters.items()
    assert document()["methods"]["log-odds"]["parameters"]["log_free"] == -1
    assert command("build", "hall.npz", "--compare", "-o", "w", *WORDS, "--as-written")[0] == 0
    written = read_map("w/tsdf.yaml").occupancy
    grid = build_map(*run, method="tsdf", as_written=True, **GRID).grid
    assert np.array_equal(written, grid.occupancy)
    used = document("w")["methods"]["tsdf"]["parameters"]
    assert used == {"truncation": 2.0, "truncation_behind": 3.0, "as_written": True}
    # the grid holds what the method that reaches farthest behind hits does: 4.5 cells
    assert (
        command("build", "hall.npz", "--compare", "-o", "a", "--resolution", "0.1", *words)[0] == 0
    )
    alone = build_map(*run, method="tsdf", resolution=0.1, **given["tsdf"]).grid
    assert read_map("a/log-odds.yaml").frame == alone.frame


def test_the_table_is_for_people_and_json_for_programs(command, run):
    words = ["build", "hall.npz", "--compare", *WORDS]
    code, out, _ = command(*words, "-o", "out")
    assert code == 0
    lines = out.splitlines()
    assert lines[0] == "out: 73 x 51 cells at -0.55, -0.35"
    assert "42 scans, 7560 beams: " in lines[1]
    assert lines[3].split() == [
        "method", "occupied", "free", "unknown", "one", "cell", "wide", "mean", "groups",
        "vanished", "bytes", "a", "cell", "seconds",
    ]  # fmt: skip
    figures = document()["methods"]
    for line, method in zip(lines[4:7], METHODS, strict=True):
        its = figures[method]
        share = f"{100 * its['one_cell_wide_share']:.1f}"
        mean = f"{its['mean_thickness_cells']:.2f}"
        told = [method, *(str(its[state]) for state in STATES.values()), share, "%", mean, "1"]
        assert line.split()[:8] == told
    assert lines[7].startswith("  log-odds, counting: ")
    code, out, _ = command(*words, "-o", "other", "--json")
    timed = json.loads(out)
    for method in METHODS:
        assert timed["methods"][method].pop("seconds") > 0
    assert timed == document("other") == document("out")
    assert command(*words, "-o", "quiet", "-q")[1] == ""


@pytest.mark.thorough
def test_bytes_do_not_depend_on_threads_or_engine(run):
    found = []
    for threads, engine in ((1, "scipy"), (2, ""), (1, "")):
        subprocess.run(
            [sys.executable, "-m", "mapdeal", "build", "hall.npz", "--compare", "-o", "out",
             "--force", "--threads", str(threads)],
            env={**os.environ, "MAPDEAL_KERNELS": engine}, check=True, capture_output=True,
        )  # fmt: skip
        found.append([Path("out", name).read_bytes() for name in FILES])
    assert found[0] == found[1] == found[2]


def test_pictures_show_what_differs_and_what_vanished(command, run):
    assert command("build", "hall.npz", "--compare", "-o", "out", *WORDS)[0] == 0
    red, blue = (225, 30, 60), (0, 120, 220)

    def colours(name):
        with Image.open(Path("out", name)) as image:
            return {colour for _, colour in image.convert("RGB").getcolors(1 << 20)}

    for method in METHODS:
        assert red in colours(f"{method}.png")  # a ring around the post
    for pair, found in zip(PAIRS, document()["pairs"], strict=True):
        cells = found["cells"]
        seen = colours("_".join(pair) + ".png")
        only_first = cells["occupied"]["free"] + cells["occupied"]["unknown"]
        only_second = cells["free"]["occupied"] + cells["unknown"]["occupied"]
        assert ((red in seen), (blue in seen)) == (only_first > 0, only_second > 0)


def test_a_folder_is_asked_for_and_files_in_it_are_kept(command, run):
    code, _, err = command("build", "hall.npz", "--compare", "-o", "out.yaml")
    assert (code, err) == (
        2, "error: --output: must be a folder: a comparison writes several maps, got 'out.yaml'\n"
    )  # fmt: skip
    code, out, err = command("build", "hall.npz", "-o", "map.yaml", "--json")
    assert (code, err, json.loads(out)["scans"]) == (0, "", 42)
    Path("out").mkdir()
    Path("out/tsdf.png").write_bytes(b"mine")
    code, _, err = command("build", "hall.npz", "--compare", "-o", "out")
    assert (code, "out/tsdf.png" in err) == (4, True)
    assert [path.name for path in Path("out").iterdir()] == ["tsdf.png"]
    assert command("build", "hall.npz", "--compare", "-o", "out", "--force")[0] == 0
    assert sorted(path.name for path in Path("out").iterdir()) == FILES


def test_nothing_seen_has_no_thickness(command, run):
    far = ["--size", "2,2", "--origin", "90,90"]
    code, _, err = command("build", "hall.npz", "--compare", "-o", "out", *far)
    assert code == 0
    assert err == ("warning: hall.npz: no beam reaches the grid: the whole map is unknown\n")
    for figures in document()["methods"].values():
        assert figures["one_cell_wide_share"] is figures["mean_thickness_m"] is None
        assert figures["vanished_groups"] == 0


INTEL = {"log-odds": (33.68, 21), "counting": (30.33, 14), "tsdf": (96.88, 14)}
ACES = {"log-odds": (53.61, 14), "counting": (48.19, 12), "tsdf": (96.49, 13)}


@pytest.mark.parametrize(
    ("log", "cells", "expected"),
    [("intel-corrected.log", 14_590, INTEL), ("aces-corrected.log.gz", 10_724, ACES)],
)
def test_real_logs_have_the_walls_and_losses_that_were_found_by_hand(
    command, real_maps, tmp_path, log, cells, expected
):
    """Figures of a study with scipy.ndimage, written apart from this code."""
    words = [real_maps / "acschaefer__ple" / log, "--compare", "-o", tmp_path / "out"]
    assert command("build", *words)[0] == 0
    found = document(tmp_path / "out")
    assert found["cells_hit_three_times"] == cells
    figures = found["methods"]
    shares = {name: round(100 * its["one_cell_wide_share"], 2) for name, its in figures.items()}
    assert shares == {
        name: pytest.approx(share, abs=0.011) for name, (share, _) in expected.items()
    }
    lost = {name: its["vanished_groups"] for name, its in figures.items()}
    assert lost == {name: count for name, (_, count) in expected.items()}
