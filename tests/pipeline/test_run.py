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
from mapdeal.pipeline.folder import changes_between, differences_from_golden
from mapdeal.pipeline.recipe import load_recipe
from mapdeal.pipeline.run import run_map
from mapdeal.pipeline.settings import Settings
from pipeline.reported import changed

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
    report = run_map(room, folder, load_recipe("default", sim=True), Settings())
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
    (None, {"changes": ["inflate.radius=0.2"]}), (None, {"image_max": 100}),
    (None, {"canvas": "full"}),
])  # fmt: skip
def test_what_has_changed_is_not_overwritten_without_force(room, tmp_path, file, change):
    recipe, folder, settings = load_recipe("default"), tmp_path / "out", Settings()
    run_map(room, folder, recipe, Settings())
    times = [path.stat().st_mtime_ns for path in sorted(folder.iterdir())]
    assert run_map(room, folder, recipe, Settings()).status == "unchanged"
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
    run_map(room, folder, load_recipe("default", sim=True), Settings())
    (folder / "notes.txt").write_text("mine")
    (folder / "active.png").write_bytes(b"edited by hand")
    run_map(room, folder, load_recipe("nav2"), Settings(force=True, images=False))
    remaining = {"esdf.npz", "esdf.pgm", "esdf.yaml", "cost.npz", "cost.pgm", "cost.yaml"}
    assert set(contents(folder)) == {*remaining, "manifest.json", "notes.txt", "active.png"}


FAIL = ("map_invalid_A/map.yaml", "map_invalid_B/map.yaml", "f1tenth_gym/maps/levine.yaml",
        "nav2_map_server/test/invalid_image.yaml")  # fmt: skip
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
                run_map(real_maps / name, folder, recipe, Settings())
        elif not name.endswith(LARGE):
            run_map(real_maps / name, folder, recipe, settings)
            assert (folder / "manifest.json").exists()


OWN = (
    "stages:\n- active: {margin: 0.2}\n- esdf: {unknown: occupied, strength: 1.5}\n"
    "- potential: {goal: [1.5, -0.5]}\n- cost: {model: rings}\n"
)
BOX = (slice(0, 10), slice(2, 22))  # the known part of ROOM, row 0 in the south
WIDER = (slice(0, 11), slice(0, 24))  # with 2 cells of margin


def padded(array, shape, box):
    """Pad the last two axes by hand with the value of unknown cells; smaller arrays unchanged."""
    if array.ndim < 2:
        return array
    outside = {"i": -1, "u": 255, "f": np.nan}[array.dtype.kind]
    canvas = np.full((*array.shape[:-2], *shape), outside, dtype=array.dtype)
    canvas[(..., *box)] = array
    return canvas


@pytest.mark.usefixtures("mapdeal_warnings")
@pytest.mark.parametrize(("name", "box"), [
    ("design-sim", BOX), ("default", BOX), ("nav2", BOX), ("own.yaml", WIDER),
])  # fmt: skip
def test_a_run_on_the_whole_canvas_is_the_run_without_padded_by_hand(room, tmp_path, name, box):
    (tmp_path / "own.yaml").write_text(OWN)
    recipe = load_recipe(str(tmp_path / name) if box is WIDER else name, sim=box is BOX)
    crop, full = tmp_path / "crop", tmp_path / "full"
    for folder in (crop, full):
        run_map(room, folder, recipe, Settings(canvas=folder.name))
    origin, shape = read_map(room).origin, read_map(room).shape
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
    assert {path.suffix for path in crop.iterdir()} == {".npz", ".pgm", ".yaml", ".png", ".json"}


EMPTY, POST = "#" + "." * 23 + "#", "#" + "." * 11 + "#" + "." * 11 + "#"
GOLDEN_ROOM = "\n".join(["#" * 25, *[EMPTY] * 6, POST, *[EMPTY] * 6, "#" * 25])


@pytest.fixture
def golden(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_map("m.yaml", grid_from_text(GOLDEN_ROOM, 0.1))
    code, out, err = command("run", "m.yaml", "-o", "out", "--golden", "gold", "--update-golden")
    assert (code, err) == (0, "")
    assert "gold/m/manifest.json: stored" in out
    assert [p.name for p in (tmp_path / "gold" / "m").iterdir()] == ["manifest.json"]

    def run(*words, output="new", stored="gold"):
        code, out, err = command("run", "m.yaml", "-o", output, "--golden", stored, *words)
        lines = out.splitlines()
        return code, [line for line in lines if line.startswith("m: ")], lines[-1], err

    return run


def test_an_equal_run_passes_with_or_without_pictures(golden):
    # a whole run is golden, too
    for output, words, stored in (
        ("out", [], "gold"), ("other", ["--no-images"], "gold"), ("new", [], "out"),
    ):  # fmt: skip
        code, _, last, _ = golden(*words, output=output, stored=stored)
        assert (code, last) == (0, f"{stored}: all stages as stored")


def test_another_map_differs_in_the_stages_that_it_changes(golden):
    code, lines, *_ = golden("--recipe", "nav2")
    assert (code, "m: inflate: is missing" in lines) == (1, True)
    write_map("m.yaml", grid_from_text(GOLDEN_ROOM.replace(POST, EMPTY), 0.1), force=True)
    code, lines, _, err = golden("--set", "inflate.radius=0", output="other")
    assert (code, lines[0]) == (1, "m: inflate: other parameters: radius 0.3 -> 0.0")
    assert lines[1].startswith("m: esdf: esdf.npz, esdf.pgm differ: obstacles")
    assert "stages differ from the golden run" in err
    assert "--update-golden" in err


def test_bytes_that_differ_count_even_if_no_figure_does(golden, tmp_path):
    changed(tmp_path / "gold/m/manifest.json",
            lambda manifest: manifest["outputs"].update({"cost.npz": "0" * 64}))  # fmt: skip
    code, lines, _, err = golden()
    assert (code, lines) == (1, ["m: cost: cost.npz differ"])
    assert "1 stage differs from the golden run" in err


def test_several_maps(command, golden):
    write_map("n.yaml", grid_from_text(GOLDEN_ROOM + "\n" + "#" * 25, 0.1))
    words = ["run", "m.yaml", "n.yaml", "-o", "both", "-j", 1, "--no-images", "--golden", "gold"]
    assert command(*words, "--update-golden")[0] == 0
    assert command(*words)[0] == 0
    write_map("n.yaml", grid_from_text(GOLDEN_ROOM, 0.1), force=True)
    code, out, _ = command(*words, "--force")
    assert code == 1
    assert {line.split(":")[0] for line in out.splitlines() if "differ" in line} == {"n"}


FIGURES = {
    "width": 5, "height": 4, "reachable_m2": 80.5, "open_m2": 90.0, "share": 0.75,
    "goals": {"kitchen": True, "hall": True, "1.5,-2": False}, "passages": 3,
}  # fmt: skip
HALL = {"goals": {"hall": [1, 2]}, "margin": 0.1}


@pytest.mark.parametrize(("figures", "parameters", "message"), [
    ({}, HALL, None),
    ({"goals": {"kitchen": False, "hall": False, "1.5,-2": True}}, HALL,
     "visit.json differ: kitchen, hall no longer reachable, 1.5,-2 reachable now"),
    # what CI has to see comes first, however much else has changed
    ({"goals": {"kitchen": False, "hall": True, "1.5,-2": False}, "reachable_m2": 1.0,
      "share": 0.5, "passages": 4, "open_m2": 2.0}, HALL,
     ("visit.json differ: kitchen no longer reachable, reachable_m2 80.5 -> 1.0, "
      "open_m2 90.0 -> 2.0 and 2 more")),
    ({"goals": {"kitchen": True, "1.5,-2": False}}, HALL,
     "visit.json differ: goals.hall True -> None"),
    ({"goals": None}, HALL, f"visit.json differ: goals {FIGURES['goals']} -> None"),
    ({"most_common": {"cost": 0}}, HALL, "visit.json differ: most_common None -> {'cost': 0}"),
    ({"share": 0.5}, {"goals": {"hall": [1, 3], "lift": [0, 0]}, "margin": 0.1},
     "other parameters: goals.hall [1, 2] -> [1, 3], goals.lift None -> [0, 0]"),
    ({"goals": {**FIGURES["goals"], "a\nb": True}}, HALL,
     "visit.json differ: goals.a\\nb None -> True"),
])  # fmt: skip
def test_differences_of_a_stage_are_given_in_words(tmp_path, figures, parameters, message):
    for place, found, values in (("gold", FIGURES, HALL), ("out", FIGURES | figures, parameters)):
        folder = tmp_path / place / "m"
        folder.mkdir(parents=True)
        outputs = {"visit.json": str(sorted(found.items())), "visit.png": place}
        document = {"stages": [{"visit": values}], "figures": {"visit": found}, "outputs": outputs}
        (folder / "manifest.json").write_text(json.dumps(document))
    lines = differences_from_golden(tmp_path / "out" / "m", tmp_path / "gold")
    assert lines == ([] if message is None else [f"m: visit: {message}"])


def test_changes_are_counted_and_named_by_their_place():
    goals = {f"room {k}": True for k in range(5)}
    text = changes_between({"goals": goals}, {"goals": dict.fromkeys(goals, False)})
    assert text == "room 0, room 1, room 2 and 2 more no longer reachable"
    deep, later = ({"a": {"b": {"c": {"d": {"e": k}}}}} for k in (1, 2))
    assert changes_between(deep, later) == "a.b.c.d {'e': 1} -> {'e': 2}"
