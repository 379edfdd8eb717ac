import json
import math
from pathlib import Path

import numpy as np
import pytest

import mapdeal
from checks.pairs import ROOM, good_yaml, write_pair
from mapdeal import OccupancyGrid, ParameterError, read_map
from mapdeal.checks.lint import lint_file


def test_a_runs_folder_is_compared_with_its_manifest(command, folder):
    words = ["--no-images", "--set", "inflate.radius=0.01"]
    assert command("run", "good.yaml", "-o", "out", *words)[0] == 0
    assert lint_file(folder / "out" / "good") == []
    (folder / "out" / "good" / "cost.npz").write_bytes(b"of another run")
    (folder / "out" / "good" / "esdf.pgm").unlink()
    assert [(f.check, f.message.split()[0]) for f in lint_file(folder / "out" / "good")] == [
        ("run.missing-file", "esdf.pgm"), ("run.other-file", "cost.npz"),
    ]  # fmt: skip
    assert command("lint", "out/good")[0] == 1
    assert [f.check for f in lint_file(folder)] == ["run.no-manifest"]


def test_a_run_whose_costs_say_nothing_has_a_finding(command, folder):
    words = ["--recipe", "design-real", "--set", "inflate.radius=0"]
    words += ["--set", "cost.down=100", "--set", "cost.up=100"]
    code, _, err = command("run", "good.yaml", "-o", "out", "--no-images", *words)
    warning = "% of the open cells (below 99) cost 0: lower up (100) and down (100)"
    assert (code, err.count(warning)) == (0, 1)
    (found,) = lint_file(folder / "out" / "good")
    assert (found.check, found.severity) == ("run.uniform-cost", "warning")
    assert found.message == "cost: 100 % of the open cells cost 0; check the inflation radius"
    assert command("lint", "out/good")[0] == 0
    assert command("lint", "out/good", "--strict")[0] == 1


def test_fix_puts_a_yaw_into_the_cells_and_loses_no_obstacle(command, folder):
    code, out, _ = command("lint", "turned.yaml", "--fix", "-o", "fixed.yaml")
    assert code == 0
    assert "yaw 1 rad is in the cells now" in out
    turned, fixed = read_map("turned.yaml"), read_map("fixed.yaml")
    assert fixed.origin[2] == 0
    rng = np.random.default_rng(1)
    for value in (100, 0, -1):
        cells = np.argwhere(turned.occupancy == value)[:, np.newaxis]
        inner = (0.5, 0.5) if value != 100 else rng.random((1, 20, 2))
        points = turned.frame.xy_from_continuous_rowcol((cells + inner).reshape(-1, 2))
        hit, inside = fixed.frame.bounded_rowcol_from_xy(points)
        assert inside.all()
        found = fixed.occupancy[tuple(hit.T)]
        assert np.all(found == 100) if value == 100 else np.isin(found, (value, 100)).mean() > 0.9
    assert not {f.check for f in lint_file(folder / "fixed.yaml")} & {
        "yaml.origin-yaw", "yaml.origin-off-lattice", "image.absolute-path",
    }  # fmt: skip


@pytest.mark.parametrize(("words", "code"), [
    (["bad.yaml", "--fix", "-o", "x.yaml"], 3),
    (["good.yaml", "--fix", "-o", "good.yaml"], 4),
    (["good.yaml", "--fix", "-o", "turned.yaml"], 4),
])  # fmt: skip
def test_fixes_that_cannot_be(command, folder, words, code):
    before = sorted(path.name for path in folder.iterdir())
    assert command("lint", *words)[0] == code
    assert sorted(path.name for path in folder.iterdir()) == before


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_pair(tmp_path)
    for name, change in (("good", {}), ("turned", {"origin": "[0, 0, 1]"}),
                         ("free", {"free_thresh": "0.25"}), ("bad", {"negate": "2"})):  # fmt: skip
        (tmp_path / f"{name}.yaml").write_text(good_yaml(**change))
    return tmp_path


def test_notes_are_no_failure_however_strict(command, folder):
    Path("noted.yaml").write_text(Path("good.yaml").read_text().replace("-1.5", "-1.51"))
    assert command("lint", "noted.yaml", "--strict")[0] == 0
    assert command("lint", "noted.yaml", "turned.yaml", "--strict")[0] == 1


@pytest.mark.parametrize(("before", "after", "expected"), [
    ("resolution: 0.05", "resolution: 5e-2", "3: warning: yaml.number-as-text: resolution: '5e"),
    ("negate: 0", "negate: 7", "5: error: file.malformed: negate: must be 0 or 1"),
    ("negate: 0", "negate: {0", "m.yaml:6: error: file.malformed: column "),
    ("image: m.pgm", "image: gone.pgm", "1: error: file.access: image: the image does not"),
    ("image: m.pgm", "image: /gone/m.pgm", "1: warning: image.foreign-path: image: /gone/m"),
    ("image: m.pgm", "", "m.yaml: error: file.malformed: missing key image"),
])  # fmt: skip
def test_findings_of_readers_have_a_line(command, folder, before, after, expected):
    text = (folder / "m.yaml").read_text()
    assert before in text
    Path("m.yaml").write_text(text.replace(before, after))
    _, out, _ = command("lint", "m.yaml")
    assert any(expected in line for line in out.splitlines()), out
    assert "(line " not in out


def test_real_maps_are_all_linted(command, real_maps):
    excluded = {"expected", "params"}
    maps = sorted(path for path in real_maps.rglob("*.yaml") if not excluded & {*path.parts})
    assert len(maps) > 35
    code, out, _ = command("lint", *maps, "--format", "json")
    assert code == 1
    found = {
        (entry["file"].rsplit("/", 1)[1], finding["check"])
        for entry in json.loads(out)["maps"]
        for finding in entry["findings"]
    }
    for name, expected in [
        ("stata_basement.yaml", "yaml.origin-yaw"),
        ("depot.yaml", "thresholds.unknown-becomes-free"), ("frieburg.yaml", "readers.differ"),
        ("mymap.yaml", "image.absolute-path"), ("map.yaml", "map.mostly-unknown"),
        ("invalid_image.yaml", "file.access"),
    ]:  # fmt: skip
        assert (name, expected) in found


@pytest.mark.parametrize(("name", "changes", "repair"), [
    ("free.yaml", [], f"{(ROOM == 205).sum()} cells are now unknown instead of free: map_saver's"),
    ("good.yaml", [("0.0]", "-nan]")], "yaw -nan, a fault of some map savers: must be 0"),
    ("good.yaml", [("0.0]", "0.00000001]")], ""),  # too small to change a cell
    ("good.yaml", [("0.05", "0.05000000074505806"), ("-1.5", "-1.5000000000000009")], ""),
])  # fmt: skip
def test_fix_repairs_findings(command, folder, name, changes, repair):
    text = (folder / name).read_text()
    for before, after in changes:
        text = text.replace(before, after)
    (folder / "odd.yaml").write_text(text)
    code, out, err = command("lint", "odd.yaml", "--fix", "-o", "new/fixed.yaml")
    assert (code, err, repair in out) == (0, "", True)
    assert lint_file(folder / "new" / "fixed.yaml") == []
    fixed, good = read_map("new/fixed.yaml"), read_map("good.yaml")
    assert (fixed.resolution, fixed.origin) == (0.05, (-1.5, 2.0, 0.0))
    assert np.array_equal(fixed.occupancy, good.occupancy)


@pytest.mark.parametrize("yaw", ["90", "6.2"])
def test_a_yaw_that_may_be_in_degrees_is_named(command, folder, yaw):
    (folder / "odd.yaml").write_text((folder / "good.yaml").read_text().replace("0.0]", f"{yaw}]"))
    assert ("yaml.yaw-in-degrees" in command("lint", "odd.yaml")[1]) == (yaw == "90")


GRID = OccupancyGrid([[100]], 0.25)
POLYGON = "[[0.9,0.5],[0.9,-0.5],[-0.9,-0.5],[-0.9,0.5]]"


@pytest.mark.parametrize(("words", "error"), [
    (["lint", "--robot-radius", 0.5], "--robot-radius: needs a MAP"),
    (["lint", "--footprint", POLYGON, "--params-file", "p.yaml"], "--robot-radius: needs a MAP"),
    (["lint", "m.yaml", "--robot-radius", 0], "robot radius must be a finite number"),
    (["lint", "m.yaml", "--robot-radius", 1, "--footprint", POLYGON],
     "together with --robot-radius"),
    (["lint", "m.yaml", "--robot-radius", 1, "--fix", "--in-place"], "together with --fix"),
    (["diff", "a.yaml", "b.yaml", "--max-shift", -1],
     "--max-shift: must be a finite number, at least 0, got -1.0"),
    (["diff", "a.yaml", "b.yaml", "--max-differing", 120],
     "--max-differing: must be a finite number, "),
])  # fmt: skip
def test_options_that_are_refused(command, words, error):
    code, out, err = command(*words)
    assert (code, out) == (2, "")
    assert err.startswith("error: ")
    assert error in err


@pytest.mark.parametrize(("name", "value"), [
    *[("tolerance", value) for value in (-1, math.nan, 1e9)],
    *[("max_shift", value) for value in (-0.1, math.nan, math.inf, "x")],
    *[("max_differing", value) for value in (-1, 100.1, math.nan, [1])],
])  # fmt: skip
def test_numbers_that_no_comparison_takes(name, value):
    with pytest.raises(ParameterError, match=name):
        mapdeal.diff(GRID, GRID, **{name: value})


def test_maps_that_are_too_far_apart():
    with pytest.raises(ParameterError, match="too far apart"):
        mapdeal.diff(GRID, OccupancyGrid([[100]], 0.25, (1e7, 1e7, 0.0)))


@pytest.mark.parametrize(("footprint", "words", "error"), [
    (0.5, {"paths": "m.yaml"}, "footprint: must look like"),
    (mapdeal.Footprint.circle(0.5), {"params_file": "p.yaml"}, "footprint: needs a MAP"),
])  # fmt: skip
def test_footprints_of_lint(footprint, words, error):
    with pytest.raises(ParameterError, match=error):
        mapdeal.lint(**words, footprint=footprint)
