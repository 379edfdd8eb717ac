"""Reports of runs whose documents anybody may have written: shown as far as they tell anything."""

import json
from pathlib import Path

import numpy as np
import pytest

import mapdeal
from mapdeal.commands.report import gathered
from mapdeal.commands.report_documents import MOST_POINTS, route_items
from mapdeal.commands.report_entries import Draft, Grids, columns_of
from mapdeal.errors import FileAccessError, MalformedInputError
from mapdeal.grid.reach import Route
from mapdeal.pipeline.settings import DEFAULT_SETTINGS
from mapdeal.report.document import Item, Table
from mapdeal.report.page import page_of
from pipeline.reported import changed, rooms_grid

pytestmark = pytest.mark.slow


def report_of(*paths):
    with Grids(DEFAULT_SETTINGS) as grids:
        report = gathered(paths, grids)
        page = b"".join(page_of(report, size=1 << 20)).decode()
    return report.entries, page


@pytest.mark.parametrize("value", [5, True, 1.5, "text", {"a": 1}, None])
def test_warnings_that_are_no_list_are_none(run, value):
    changed(run / "manifest.json", lambda manifest: manifest.update(warnings=value))
    (entry,), _ = report_of(run)
    assert (entry.warnings, len(entry.layers)) == ((), 3)


@pytest.mark.parametrize(
    ("name", "column"),
    [("width", "cells"), ("height", "cells"), ("resolution", "m per cell"), ("lethal", "lethal %")],
)  # fmt: skip
def test_figures_that_are_no_numbers_are_no_columns(run, name, column):
    """A text times a height, or a list, would fill the memory."""
    told = json.loads((run / "manifest.json").read_text())
    for value in (10**400, -(10**400), 1e308, "x" * 99, [1] * 99, {}, None, True):
        for figures in told["figures"].values():
            figures |= {"height": 10**9, name: value}
        (run / "manifest.json").write_text(json.dumps(told))
        (entry,), _ = report_of(run)
        assert len(entry.layers) == 3
        assert column not in entry.figures


def test_columns_of_figures():
    esdf = {"width": 20, "height": 5, "resolution": 0.25, "occupied": 7, "highest_distance": 1.2}
    assert columns_of({"esdf": esdf, "reach": {"reachable_m2": 4, "width": 3, "height": 1}}) == {
        "cells": "20 x 5", "m per cell": 0.25, "occupied %": 7.0,
        "reachable m2": 4.0,
    }  # fmt: skip
    cost = {"width": 20, "height": 5, "lethal": 3, "free": 9, "unknown": 9}
    assert columns_of({"cost": cost}) == {"cells": "20 x 5", "lethal %": 3.0}
    assert columns_of({"cost": {"width": 0, "height": 5, "free": 0}, "esdf": [1]}) == {}


def test_few_of_many_missing_files_are_told_one_by_one(run):
    def change(manifest):
        manifest["outputs"] |= {f"f{number}": "00" for number in range(300)}

    changed(run / "manifest.json", change)
    with pytest.warns(mapdeal.MapdealWarning) as given:
        (entry,), _ = report_of(run)
    texts = [str(one.message) for one in given]
    assert texts[19] == f"{run}/f19: is missing, though the manifest lists it"
    rule = "280 more of the files that it lists are missing, or are others"
    assert texts[20:] == [f"{run}/manifest.json: {rule}"]
    assert len(entry.warnings) == 21


def test_a_stage_is_in_a_manifest_but_once(run):
    """Recipes have each stage once; a hundred thousand of them would be as many layers."""
    changed(run / "manifest.json", lambda manifest: manifest["stages"].append({"esdf": {}}))
    with pytest.raises(MalformedInputError, match="is not the manifest of a run"):
        report_of(run)


@pytest.mark.filterwarnings("ignore::mapdeal.MapdealWarning")
def test_outputs_are_looked_for_in_the_folder_of_the_run_alone(run, tmp_path):
    (tmp_path / "cost.npz").write_bytes((run / "cost.npz").read_bytes())
    names = ["../cost.npz", str(tmp_path / "cost.npz"), "..", ".", "", "a\0", "\ud800", "n" * 9000]

    def change(manifest):
        del manifest["outputs"]["cost.npz"], manifest["outputs"]["cost.yaml"]
        manifest["outputs"] |= dict.fromkeys(names, "00")

    changed(run / "manifest.json", change)
    (entry,), _ = report_of(run)
    assert [layer.name for layer in entry.layers] == ["inflated", "esdf"]
    told = "manifest.json: the run wrote no values of stage cost"
    assert told in entry.warnings


def test_stages_with_names_of_other_places_have_no_layers(run):
    def change(manifest):
        manifest["stages"] += [{"../esdf": {}}, {"/etc/passwd": {}}, {"": {}}, {"a\0": {}}]

    changed(run / "manifest.json", change)
    with pytest.warns(mapdeal.MapdealWarning, match="no values of stage"):
        (entry,), page = report_of(run)
    assert len(entry.layers) == 3
    assert "\0" not in page


@pytest.fixture
def batch(run):
    folder = run.parent
    told = {"map": "rooms.yaml", "folder": run.name, "status": "done"}
    (folder / "summary.json").write_text(json.dumps({"maps": [told, dict(told)]}))
    return folder


@pytest.mark.parametrize("place", ["..", "../out/rooms", "rooms/../rooms", ".", "", "/etc", None])
def test_a_batch_shows_no_run_outside_of_its_folder(batch, place):
    place = str(batch / "rooms") if place is None else place
    changed(batch / "summary.json", lambda summary: summary["maps"][0].update(folder=place))
    with pytest.warns(mapdeal.MapdealWarning) as given:
        (first, second), _ = report_of(batch)
    rule = f"{place} is in no folder of this batch, so it is not shown"
    assert [str(one.message) for one in given] == [f"{batch}/summary.json: {rule}"]
    assert first.warnings == (f"summary.json: {rule.removeprefix(f'{batch}/')}",)
    assert (len(first.layers), len(second.layers)) == (0, 3)


def test_a_summary_without_maps_hides_no_run(batch):
    changed(batch / "summary.json", lambda summary: summary.update(maps=[]))
    (entry,), _ = report_of(batch)
    assert len(entry.layers) == 3
    (batch / "rooms" / "manifest.json").unlink()
    with pytest.raises(FileAccessError, match="contains no run"):
        report_of(batch)


BAD = "<img src=x onerror=alert(1)></script></title>-->]]>\u2028\u202e\0\ud800"


@pytest.mark.filterwarnings("ignore::mapdeal.MapdealWarning")
def test_names_in_documents_are_text_on_the_page(run, batch):
    def change(manifest):
        manifest["stages"].append({BAD: {BAD: BAD}})
        manifest["figures"][BAD] = {BAD: BAD}
        manifest |= {"warnings": [BAD], "options": {BAD: BAD}, "robot": {BAD: [BAD]}}
        manifest["version"] = BAD
        manifest["inputs"] = manifest["outputs"] = {**manifest["outputs"], BAD: BAD}

    def of_batch(summary):
        summary["maps"][1] = {"map": BAD, "folder": BAD, "status": BAD, "error": BAD}

    changed(run / "manifest.json", change)
    changed(batch / "summary.json", of_batch)
    _, page = report_of(batch)
    assert not [one for one in ("<img", "\0", "\u2028", "\u202e") if one in page]
    assert page.count("&lt;img src=x onerror=alert(1)&gt;&lt;/script&gt;") > 10
    assert (page.count("</script>"), page.count("</title>")) == (3, 1)


def test_an_entry_lists_no_more_than_browsers_can_show():
    draft = Draft("a", Path("a"))
    draft.items = [Item("goal", str(number)) for number in range(5002)]
    draft.tables = [Table("first", tuple((str(number), "x") for number in range(6000)))]
    draft.tables += [Table("other", (("a", "b"),))] * 5000
    draft.warn(str(number) for number in range(5000))
    entry = draft.entry()
    assert [one.text for one in entry.items[4999:]] == ["4999", "2 more are not listed"]
    assert entry.tables[0].rows[4999:] == (("4999", "x"), ("1000 more are not listed", ""))
    assert (len(entry.tables), entry.tables[-1].title) == (5001, "1 more are not listed")
    assert entry.warnings[-1] == "4999"


def test_a_page_keeps_to_its_size_whatever_it_lists(run):
    line = {"type": "LineString", "coordinates": [[k / 7, k / 3] for k in range(500)]}
    feature = {"type": "Feature", "properties": {}, "geometry": line}
    shapes = {"type": "FeatureCollection", "features": [feature] * 9}
    (run / "shapes.json").write_text(json.dumps(shapes))
    mapdeal.write_map(run / "noise.yaml", noise())
    sources = [run / "noise.yaml", run / "shapes.json"]
    page = mapdeal.write_report(run / "page.html", sources, max_size=400_000)
    assert 200_000 < page.size <= 400_000


def noise():
    values = np.random.default_rng(1).integers(0, 101, size=(700, 900), dtype=np.int8)
    return mapdeal.OccupancyGrid(values, 0.25, (1.5, -2.0, 0.4))


def test_a_path_by_another_name_is_the_same(run, tmp_path):
    (tmp_path / "link").symlink_to(run)
    mapdeal.write_map(tmp_path / "other.yaml", rooms_grid(walls=3))
    paths = [run, tmp_path / "other.yaml", run / ".." / run.name, tmp_path / "link"]
    entries, _ = report_of(*paths)
    assert [entry.name for entry in entries] == ["rooms", "other"]
    entries, _ = report_of(*paths[:0:-1])
    assert [entry.name for entry in entries] == ["link", "other"]


def test_a_long_route_keeps_its_ends_and_few_of_its_points():
    points = np.stack([np.arange(70_001.0), np.sqrt(np.arange(70_001.0))], axis=1)
    route = Route("astar", True, (0.0, 0.0), (1.0, 1.0), points, 1.0, 1.0, 1.0)
    *_, item = route_items(route)
    (line,) = item.lines
    assert len(line) == MOST_POINTS
    assert (line[0].tolist(), line[-1].tolist()) == (points[0].tolist(), points[-1].tolist())
    assert np.diff(line[:, 0]).max() <= 4
    assert set(map(tuple, line.tolist())) <= set(map(tuple, points.tolist()))
