"""What a report gathers: which paths become entries, which join others, and what is warned of."""

import json
import shutil

import numpy as np
import pytest

import mapdeal
from drawn import grid_from_text
from mapdeal.commands.report import gathered
from mapdeal.commands.report_entries import Grids
from mapdeal.errors import FileAccessError, MalformedInputError
from mapdeal.pipeline.settings import DEFAULT_SETTINGS
from pipeline.reported import layer_names, report_of, rooms_grid

OTHER = """
    #####
    #...#
    #####
"""


def test_a_run_has_a_layer_for_each_stage_and_all_that_its_manifest_tells(run):
    (entry,) = report_of(run).entries
    assert entry.name == "rooms"
    assert layer_names(entry) == ["inflated", "esdf", "cost"]
    assert [layer.title for layer in entry.layers[:2]] == [
        "Inflated by 0.25 m (disc)", "Signed distance field"
    ]  # fmt: skip
    field = entry.layers[1]
    assert (field.states, field.convention, field.unit) == ("inflated", "fast-planner", "m")
    told = {table.title: dict(table.rows) for table in entry.tables}
    manifest = json.loads((run / "manifest.json").read_text())
    assert told["inflate: parameters"]["radius"] == "0.25"
    assert told["Files written, and their SHA-256"] == manifest["outputs"]
    assert told["Files read, and their SHA-256"] == manifest["inputs"]
    assert entry.curve.inflation_radius == 0.8
    assert (entry.figures["cells"], entry.figures["m per cell"]) == ("20 x 8", 0.25)
    assert entry.warnings == ()


@pytest.mark.parametrize("first", ["map", "run"])
def test_the_map_that_a_run_was_made_of_joins_it_in_whatever_order(run, rooms, first):
    paths = [rooms, run] if first == "map" else [run, rooms]
    (entry,) = report_of(*paths).entries
    assert layer_names(entry) == ["input", "inflated", "esdf", "cost"]


def test_grids_join_what_covers_the_same_cells_and_maps_do_not(rooms, tmp_path):
    grid = mapdeal.read_map(rooms)
    mapdeal.write_map(tmp_path / "far.npz", mapdeal.esdf(grid_from_text(OTHER)))
    mapdeal.write_map(tmp_path / "near.npz", mapdeal.esdf(grid))
    mapdeal.write_map(tmp_path / "again.yaml", grid)
    near, far, again = (tmp_path / name for name in ("near.npz", "far.npz", "again.yaml"))
    joined, alone = report_of(rooms, near, far).entries
    assert layer_names(joined) == ["rooms", "near"]  # its map is that of the entry
    assert joined.layers[1].states == "rooms"
    assert layer_names(alone) == ["far-map", "far"]
    assert [layer_names(one) for one in report_of(rooms, again).entries] == [["rooms"], ["again"]]


def test_files_that_do_not_match_the_manifest_are_told_and_the_rest_is_shown(run):
    (run / "cost.npz").unlink()
    with (run / "inflated.pgm").open("ab") as file:
        file.write(b"more")
    with pytest.warns(mapdeal.MapdealWarning) as given:
        (entry,) = report_of(run).entries
    assert layer_names(entry) == ["inflated", "esdf"]
    texts = [str(one.message) for one in given]
    assert texts[:2] == [
        f"{run}/inflated.pgm: is not what the run wrote: its checksum differs",
        f"{run}/cost.npz: is missing, though the manifest lists it",
    ]
    # on the page files have their names alone: it may be sent to anybody
    assert entry.warnings == tuple(text.removeprefix(f"{run}/") for text in texts)


def test_a_damaged_layer_is_told_and_left_out(run):
    (run / "cost.npz").write_bytes(b"PK")
    with pytest.warns(mapdeal.MapdealWarning, match="cost"):
        (entry,) = report_of(run).entries
    assert layer_names(entry) == ["inflated", "esdf"]
    assert entry.warnings[1:] == ("cost.npz: is not an npz file, so layer cost is not shown",)


@pytest.fixture
def batch(tmp_path, command):
    (tmp_path / "maps" / "a").mkdir(parents=True)
    mapdeal.write_map(tmp_path / "maps" / "a" / "one.yaml", rooms_grid())
    mapdeal.write_map(tmp_path / "maps" / "two.yaml", grid_from_text(OTHER))
    (tmp_path / "maps" / "bad.yaml").write_text("image: none.pgm\nresolution: x\n")
    assert command("run", tmp_path / "maps", "-o", tmp_path / "batch")[0] == 5
    return tmp_path / "batch"


def test_a_batch_has_an_entry_for_each_map_and_one_that_failed_has_the_reason(batch):
    entries = {entry.name: entry for entry in report_of(batch).entries}
    assert {name: entry.status for name, entry in entries.items()} == {
        "a/one": "done", "bad": "failed", "two": "done"
    }  # fmt: skip
    assert entries["bad"].layers == ()
    assert "bad.yaml" in entries["bad"].warnings[0]
    assert len(entries["a/one"].layers) == 3


def test_a_folder_with_runs_below_is_as_a_batch_without_its_summary(batch):
    (batch / "summary.json").unlink()
    assert [entry.name for entry in report_of(batch).entries] == ["a/one", "two"]


def test_folders_without_runs_are_refused(tmp_path, run):
    (tmp_path / "empty").mkdir()
    with pytest.raises(FileAccessError, match="contains no run"):
        report_of(tmp_path / "empty")
    with pytest.raises(FileAccessError, match="No such file"):
        report_of(tmp_path / "nowhere")
    (run / "manifest.json").write_text("[]")
    with pytest.raises(MalformedInputError, match="is not the manifest of a run"):
        report_of(run)


def test_titles_of_maps_that_do_not_join(run, rooms, tmp_path):
    mapdeal.write_map(tmp_path / "other.yaml", grid_from_text(OTHER))
    assert report_of(run).title == "rooms"
    assert report_of(run, tmp_path / "other.yaml").title == "2 maps"
    assert report_of(run, title="<b>").title == "<b>"
    mapdeal.write_map(rooms, rooms_grid(walls=1), force=True)
    assert len(report_of(run, rooms).entries) == 2


@pytest.mark.parametrize("fits", [True, False])
def test_layers_hold_what_the_files_hold_whether_they_fit_the_memory_or_not(
    run, rooms, fits, monkeypatch
):
    if not fits:
        monkeypatch.setattr("mapdeal.commands.report_entries.memory_limit", lambda: (0, ""))
    with Grids(DEFAULT_SETTINGS) as grids:
        layers = gathered([run, rooms], grids).entries[0].layers
        values = [layer.values[:] for layer in layers]
        assert all(layer.values[2:4].tolist() == value[2:4].tolist()
                   for layer, value in zip(layers, values, strict=True))  # fmt: skip
        paths = (run / "esdf.npz", rooms)
        assert [grids.grid(path).is_lazy for path in paths] == [not fits] * 2
    with np.load(run / "esdf.npz") as field, np.load(run / "cost.npz") as costs:
        assert values[1].view(np.int8).tolist() == field["occupancy"].tolist()
        assert values[2].tobytes() == field["distance"].tobytes()
        assert values[3].tobytes() == costs["cost"].tobytes()
        assert layers[1].frame.origin == tuple(field["origin"])


def test_a_field_of_the_map_as_read_shows_it_once(rooms, tmp_path):
    (tmp_path / "bare.yaml").write_text("stages:\n- esdf: {}\n")
    run = mapdeal.run(rooms, tmp_path / "bare", tmp_path / "bare.yaml").folder
    for paths in ((run, rooms), (rooms, run)):
        (entry,) = report_of(*paths).entries
        assert layer_names(entry) == ["input", "esdf"]
        assert entry.layers[1].states == "input"


def test_a_run_that_asks_what_can_be_reached_shows_the_answer(rooms, tmp_path):
    x, y = mapdeal.read_map(rooms).frame.xy_from_rowcol([(3, 5)])[0].tolist()
    (tmp_path / "asks.yaml").write_text(
        f"stages:\n- reach: {{radius: 0.2, start: [{x}, {y}], goals: {{lab: [{x}, {y}]}}}}\n"
    )
    run = mapdeal.run(rooms, tmp_path / "asks", tmp_path / "asks.yaml").folder
    (entry,) = report_of(run).entries
    assert layer_names(entry) == ["reach-clearance", "reach-widest", "reach"]
    assert [item.kind for item in entry.items] == ["start", "goal", "passage"]
    assert "What the robot can reach" in [table.title for table in entry.tables]


def test_a_run_that_is_gone_leaves_the_others_of_its_batch(batch):
    shutil.rmtree(batch / "two")
    with pytest.warns(mapdeal.MapdealWarning) as given:
        entries = {entry.name: entry for entry in report_of(batch).entries}
    assert len(given) == 1
    assert entries["two"].layers == ()
    assert entries["two"].warnings[0].endswith("so this run is not shown")
    assert len(entries["a/one"].layers) == 3


def test_shares_are_those_of_the_map_as_read_and_not_of_what_a_run_made_of_it(run, rooms):
    (alone,) = report_of(run).entries
    assert not {"occupied %", "free %", "unknown %"} & set(alone.figures)
    (both,) = report_of(run, rooms).entries
    cells = mapdeal.read_map(rooms).occupancy
    assert both.figures["occupied %"] == round(100 * np.mean(cells == 100), 2)
    assert both.figures["unknown %"] == round(100 * np.mean(cells == -1), 2)
    assert both.figures["lethal %"] > both.figures["occupied %"]  # inflated
