"""Runs of one map: the files written, the files left alone, and the whole canvas."""

import hashlib
import json
from dataclasses import replace

import numpy as np
import pytest
import yaml
from PIL import Image

import mapdeal
from drawn import grid_from_text
from mapdeal import FileAccessError, MalformedInputError, read_map, write_map
from mapdeal.pipeline.recipe import load_recipe
from mapdeal.pipeline.run import run_map
from mapdeal.pipeline.settings import Settings

ROOM = "\n".join(["?" * 30, *["??" + "#" * 20 + "?" * 8]] + ["??#" + "." * 18 + "#" + "?" * 8] * 9)
GAPPED_ROOM = ROOM.replace("#", ".", 1)


@pytest.fixture
def room(tmp_path):
    """A map of a room on a larger canvas, as files."""
    write_map(tmp_path / "room.yaml", grid_from_text(ROOM, 0.1))
    return tmp_path / "room.yaml"


def contents(folder):
    return {p.name: p.read_bytes() for p in sorted(folder.iterdir())}


def test_a_run_writes_every_file_and_a_manifest_of_them(room, tmp_path):
    folder = tmp_path / "out" / "room"
    report = run_map(room, folder, load_recipe("default", sim=True))
    names = [f"{stem}.{end}" for stem in ("active", "inflated") for end in ("pgm", "yaml", "png")]
    names += [f"{s}.{e}" for s in ("esdf", "cost") for e in ("npz", "pgm", "yaml", "png")]
    names.append("input.png")
    files = contents(folder)
    assert set(files) == {*names, "manifest.json"}
    manifest = json.loads(files["manifest.json"])
    assert manifest["outputs"] == {n: hashlib.sha256(files[n]).hexdigest() for n in names}
    image = (tmp_path / "room.pgm").read_bytes()
    assert manifest["inputs"]["room.pgm"] == hashlib.sha256(image).hexdigest()
    assert report.figures["active"]["width"] == 20
    as_read = mapdeal.draw_picture(mapdeal.read_map(room), title="room: map as read")
    assert files["input.png"] == as_read.png()
    assert str(tmp_path) not in files["manifest.json"].decode()


def edited(change):
    return lambda path: path.write_text(json.dumps({**json.loads(path.read_text()), **change}))


@pytest.mark.slow
@pytest.mark.parametrize(("file", "change"), [
    ("../room.yaml", lambda path: write_map(path, grid_from_text(GAPPED_ROOM, 0.1), force=True)),
    ("cost.pgm", lambda path: path.write_bytes(b"edited by hand")),
    ("manifest.json", lambda path: path.write_text("{")),
    ("manifest.json", edited({"version": "0.0.0"})),
    (None, {"changes": ["inflate.radius=0.2"]}),
    (None, {"image_max": 100}),
    (None, {"canvas": "full"}),
])  # fmt: skip
def test_what_has_changed_is_not_overwritten_without_force(room, tmp_path, file, change):
    recipe, folder, settings = load_recipe("default"), tmp_path / "out", Settings()
    run_map(room, folder, recipe)
    times = [path.stat().st_mtime_ns for path in sorted(folder.iterdir())]
    assert run_map(room, folder, recipe).status == "unchanged"
    assert [path.stat().st_mtime_ns for path in sorted(folder.iterdir())] == times
    if file:
        change(folder / file)
    elif "changes" in change:
        recipe = load_recipe("default", **change)
    else:
        settings = Settings(**change)
    before = contents(folder)
    with pytest.raises(FileAccessError, match="exists"):
        run_map(room, folder, recipe, settings)
    assert contents(folder) == before
    assert run_map(room, folder, recipe, replace(settings, force=True)).status == "done"
    assert run_map(room, folder, recipe, settings).status == "unchanged"


def test_a_replaced_run_leaves_no_outputs_of_the_old_one_behind(room, tmp_path):
    folder = tmp_path / "out"
    run_map(room, folder, load_recipe("default", sim=True))
    (folder / "notes.txt").write_text("mine")
    (folder / "active.png").write_bytes(b"edited by hand")
    run_map(room, folder, load_recipe("nav2"), Settings(force=True, images=False))
    remaining = {"esdf.npz", "esdf.pgm", "esdf.yaml", "cost.npz", "cost.pgm", "cost.yaml"}
    assert set(contents(folder)) == {*remaining, "manifest.json", "notes.txt", "active.png"}


FAIL = (
    "load_world_tests/map_invalid_A/map.yaml", "load_world_tests/map_invalid_B/map.yaml",
    "f1tenth_gym/maps/levine.yaml", "nav2_map_server/test/invalid_image.yaml",
)  # fmt: skip
LARGE = ("f1tenth__f1tenth_gym/maps/vegas.yaml", "tools/planner_benchmarking/100by100_10.yaml")
"""Left to be run by hand: this is about reading."""


@pytest.mark.parametrize("every", [4, pytest.param(1, marks=pytest.mark.thorough)])
def test_every_readable_real_map_runs(real_maps, tmp_path, mapdeal_warnings, every):
    listed = (path.relative_to(real_maps).as_posix() for path in real_maps.rglob("*.yaml"))
    manifest = (real_maps / "MANIFEST.md").read_text()
    names = sorted(name for name in listed if f"| {name} " in manifest)
    assert len(names) == 43
    recipe, settings = load_recipe("default"), Settings(images=False, threads=2)
    for number, name in enumerate(names[::every]):
        folder = tmp_path / str(number)
        if name.endswith(FAIL):
            with pytest.raises((MalformedInputError, FileAccessError)):
                run_map(real_maps / name, folder, recipe)
        elif not name.endswith(LARGE):
            run_map(real_maps / name, folder, recipe, settings)
            assert (folder / "manifest.json").exists()


OWN = (
    "stages:\n- active: {margin: 0.2}\n- esdf: {unknown: occupied, strength: 1.5}\n"
    "- potential: {goal: [1.5, -0.5]}\n- cost: {model: rings}\n"
)
BOX = (slice(0, 10), slice(2, 22))
"""The known part of `ROOM`, row 0 in the south."""
WIDER = (slice(0, 11), slice(0, 24))
"""With 2 cells of margin."""


def padded(array, shape, box):
    """Pad the last two axes by hand with the value of unknown cells; smaller arrays unchanged."""
    if array.ndim < 2:
        return array
    outside = {"i": -1, "u": 255, "f": np.nan}[array.dtype.kind]
    canvas = np.full((*array.shape[:-2], *shape), outside, dtype=array.dtype)
    canvas[(..., *box)] = array
    return canvas


@pytest.mark.usefixtures("mapdeal_warnings")
@pytest.mark.parametrize(
    ("recipe", "box"), [("design-sim", BOX), ("default", BOX), ("nav2", BOX), ("own", WIDER)]
)
def test_a_run_on_the_whole_canvas_is_the_run_without_padded_by_hand(room, tmp_path, recipe, box):
    """Each product of a plain run, padded with numpy; the origin is the map's, bit for bit."""
    (tmp_path / "own.yaml").write_text(OWN)
    steps = load_recipe(str(tmp_path / "own.yaml")) if recipe == "own" else None
    crop, full = tmp_path / "crop", tmp_path / "full"
    for folder in (crop, full):
        settings = Settings(canvas=folder.name)
        run_map(room, folder, steps or load_recipe(recipe, sim=True), settings)
    source = read_map(room)
    origin, shape = source.origin, source.shape
    assert {path.name for path in crop.iterdir()} == {path.name for path in full.iterdir()}
    for path in crop.iterdir():
        full_path = full / path.name
        if path.suffix == ".npz":
            with np.load(path) as old, np.load(full_path) as new:
                assert old.files == new.files
                for key in old.files:
                    expected = np.array(origin) if key == "origin" else padded(old[key], shape, box)
                if key == "cost_to_go":  # no way leads there
                    expected[np.isnan(expected)] = np.inf
                    np.testing.assert_array_equal(new[key], expected, err_msg=key)
        elif path.suffix == ".pgm":
            keys = yaml.safe_load(path.with_suffix(".yaml").read_text())
            old, new = (np.asarray(Image.open(image))[::-1] for image in (path, full_path))
            expected = np.full(shape, 205 if keys["mode"] == "trinary" else 255)
            expected[box] = old
            np.testing.assert_array_equal(new, expected)
        elif path.suffix == ".yaml":
            old, new = (yaml.safe_load(image.read_text()) for image in (path, full_path))
            assert new == {**old, "origin": list(origin)}
    endings = {".npz", ".pgm", ".yaml", ".png", ".json"}
    assert {path.suffix for path in crop.iterdir()} == endings
