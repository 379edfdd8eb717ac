"""Warnings about dangerous or meaningless maps: one each, with the share of the cells."""

import warnings

import numpy as np
import pytest
from PIL import Image

from bad_maps import yaml_text
from mapdeal import Costmap, MapdealWarning, OccupancyGrid, read_map, write_map
from mapdeal.checks.lint import lint_file
from mapdeal.maps.reading import open_map

# 40 rows of 60: a wall, a free hall, and 205 in 300 cells, 12.5 %.
GREYS = np.full((40, 60), 254, dtype=np.uint8)
GREYS[5, :] = 0
GREYS[10:20, 30:60] = 205
GREY_IMAGE = Image.fromarray(GREYS)


def write_pair(folder, image, end="png", *, free=0.25, mode="trinary"):
    path = folder / "m.yaml"
    path.write_text(yaml_text(image=f"m.{end}", free_thresh=free, mode=mode))
    image.save(folder / f"m.{end}")
    return path


def warnings_of(read):
    """Return the warnings of a call, checks and texts."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        read()
    assert all(warning.category is MapdealWarning for warning in caught)
    return [(warning.message.check, str(warning.message)) for warning in caught]


def freed_of(path):
    """Return the texts about freed cells; of which, see tests/checks as well."""
    checks = warnings_of(lambda: read_map(path))
    return [text for check, text in checks if check == "thresholds.unknown-becomes-free"]


def _palette(greys):
    image = Image.fromarray(255 - greys)  # indices that are not the greys
    image.putpalette([255 - k for k in range(256) for _ in range(3)])
    return image


KINDS = {
    **dict.fromkeys(("pgm", "png", "bmp", "tiff"), GREY_IMAGE),
    **{f"{mode}.png": GREY_IMAGE.convert(mode) for mode in ("RGB", "RGBA", "LA")},
    "palette.png": _palette(GREYS),
    "wide.png": Image.fromarray(GREYS.astype(np.uint16) * 257),
}


@pytest.mark.parametrize("kind", KINDS)
def test_grey_205_that_is_read_as_free_is_warned_of_with_its_share(tmp_path, kind):
    image, end = KINDS[kind], kind.rpartition(".")[2]
    path = write_pair(tmp_path, image, end)
    (remark,) = freed_of(path)
    assert remark == (f"{path}: 300 cells (12.5 %) of grey 205, which map_saver writes for unknown,"
                    " are read as free; lower free_thresh from 0.25 to 0.196")  # fmt: skip
    assert freed_of(write_pair(tmp_path, image, end, free=0.196)) == []


def test_a_map_read_by_rows_is_judged_as_one_in_memory(tmp_path):
    path = write_pair(tmp_path, GREY_IMAGE, "pgm")

    def by_rows():
        with open_map(path) as file:
            file.by_rows(block_height=7)

    assert warnings_of(by_rows) == warnings_of(lambda: read_map(path))
    path = write_pair(tmp_path, Image.new("L", (60, 40), 205), "pgm", free=0.196)
    text = f"{path}: every cell is unknown; are the thresholds, mode and negate right?"
    for read in (by_rows, lambda: read_map(path)):
        assert warnings_of(read) == [("map.all-unknown", text)]


@pytest.mark.parametrize(("value", "remark"), [(-1, ["map.all-unknown"]), (0, [])])
def test_a_map_in_an_npz_of_which_nothing_is_known(tmp_path, value, remark):
    occupancy = np.full((3, 5), -1, dtype=np.int8)
    occupancy[1, 2] = value
    write_map(tmp_path / "u.npz", OccupancyGrid(occupancy, 0.1, (1.5, -2.0, 0.4)))
    assert [check for check, _ in warnings_of(lambda: read_map(tmp_path / "u.npz"))] == remark


LOW = "a larger inflation_radius, or lower up and down, grade more of them"
HIGH = "a higher cost_scaling_factor, or the metric view, grades more of them"


@pytest.mark.parametrize(("costs", "start"), [
    ([254] + [0] * 98 + [1], f"98.99 % of the open cells cost 0: {LOW}"),
    ([254] + [0] * 97 + [1, 1], None),
    ([254] + [252] * 99, f"100 % of the open cells cost 252: {HIGH}"),
    ([0] * 100, "100 % of the open cells cost 0: there is no obstacle"),
    ([253] * 99 + [255], "every known cell is lethal or inscribed"),
    ([255] * 100, "every cell is unknown"),
])  # fmt: skip
@pytest.mark.filterwarnings("ignore:.*which map_server would misread")
@pytest.mark.parametrize("end", ["npz", "yaml"])
def test_uniform_costs_of_a_file_are_warned_of_and_found_by_lint(tmp_path, costs, start, end):
    grid = Costmap(np.array(costs, dtype=np.uint8).reshape(4, 25), 0.1, (1.5, -2.0, 0.4))
    path = tmp_path / f"c.{end}"
    write_map(path, grid, encoding="occupancy" if end == "npz" else "costmap2d")
    expected = [] if start is None else [("run.uniform-cost", f"{path}: {start}")]
    assert warnings_of(lambda: read_map(path)) == expected
    found = [finding for finding in lint_file(path) if finding.check == "run.uniform-cost"]
    assert [finding.severity for finding in found] == ["warning"] * len(expected)
    assert all(start.startswith(finding.message) for finding in found)


@pytest.mark.parametrize("end", ["pgm", "png", "bmp"])
def test_all_strips_of_an_image_count(tmp_path, monkeypatch, end):
    """Strips of two rows: those with the odd pixels are neither the first nor the last."""
    monkeypatch.setattr("mapdeal.maps.picture.STRIP", 120)
    path = write_pair(tmp_path, GREY_IMAGE, end)
    (text,) = freed_of(path)
    assert ": 300 cells (12.5 %) of grey 205" in text
    path = write_pair(tmp_path, GREY_IMAGE, end, mode="raw")
    remarks = str(warnings_of(lambda: read_map(path)))
    assert f"{path.with_suffix(f'.{end}')}: 2340 pixels of mode raw hold 101..254, read" in remarks
