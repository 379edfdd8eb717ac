"""Maps that are dangerous or say nothing: whoever reads one is told, once, with the share."""

import warnings

import numpy as np
import pytest
from PIL import Image

from mapdeal import Costmap, MapdealWarning, OccupancyGrid, read_map, write_map
from mapdeal.maps.reading import open_map

YAML = "image: m.{end}\nresolution: 0.1\norigin: [1.5, -2.0, 0.4]\nnegate: {negate}\n"
YAML += "occupied_thresh: 0.65\nfree_thresh: {free}\nmode: {mode}\n"

# 40 rows of 60: a wall, a free hall, and 205 in 300 cells, 12.5 %.
GREYS = np.full((40, 60), 254, dtype=np.uint8)
GREYS[5, :] = 0
GREYS[10:20, 30:60] = 205


def write_pair(folder, image, end="png", *, free=0.25, mode="trinary", negate=0):
    path = folder / "m.yaml"
    path.write_text(YAML.format(end=end, free=free, mode=mode, negate=negate))
    image.save(folder / f"m.{end}")
    return path


def told_of(read):
    """Return the warnings of a call, checks and texts."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        read()
    assert all(one.category is MapdealWarning for one in caught)
    return [(one.message.check, str(one.message)) for one in caught]


def freed_of(path, **options):
    """Return the texts about freed cells."""
    checks = told_of(lambda: read_map(path, **options))
    return [text for check, text in checks if check == "thresholds.unknown-becomes-free"]


def _palette(greys):
    image = Image.fromarray(255 - greys)  # indices that are not the greys
    image.putpalette([255 - k for k in range(256) for _ in range(3)])
    return image


@pytest.mark.parametrize(("image", "end"), [
    (Image.fromarray(GREYS), "pgm"),
    (Image.fromarray(GREYS), "png"),
    (Image.fromarray(GREYS).convert("RGB"), "png"),
    (Image.fromarray(GREYS).convert("RGBA"), "png"),
    (Image.fromarray(GREYS).convert("LA"), "png"),
    (_palette(GREYS), "png"),
    (Image.fromarray(GREYS.astype(np.uint16) * 257), "png"),
    (Image.fromarray(GREYS), "bmp"),
    (Image.fromarray(GREYS), "tiff"),
], ids=["pgm", "grey", "rgb", "rgba", "la", "palette", "wide", "bmp", "tiff"])  # fmt: skip
def test_grey_205_that_is_read_as_free_is_told_with_its_share(tmp_path, image, end):
    path = write_pair(tmp_path, image, end)
    expected = (
        f"{path}: 300 cells (12.5 %) of grey 205, which map_saver writes for unknown, are read as"
        " free; lower free_thresh from 0.25 to 0.196"
    )
    assert freed_of(path) == [expected]
    assert freed_of(write_pair(tmp_path, image, end, free=0.196)) == []


@pytest.mark.parametrize("mode", ["trinary", "scale"])
@pytest.mark.parametrize("dialect", ["nav2", "humble", "ros1"])
def test_each_reader_is_judged_by_its_own_rule(tmp_path, dialect, mode):
    path = write_pair(tmp_path, Image.fromarray(GREYS), free=0.25, mode=mode)
    assert len(freed_of(path, dialect=dialect)) == 1
    limit = 1 - 205 / 255  # 0.19607843...: nav2 includes it in 32 bits, the others in none
    path = write_pair(tmp_path, Image.fromarray(GREYS), free=limit, mode=mode)
    freed = int((read_quietly(path, dialect).occupancy[20:30, 30:] == 0).sum())
    assert len(freed_of(path, dialect=dialect)) == (freed > 0)


def read_quietly(path, dialect="nav2"):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return read_map(path, dialect=dialect)


def test_opacity_that_ros1_averages_in_is_to_blame_and_no_threshold(tmp_path):
    path = write_pair(tmp_path, Image.fromarray(GREYS).convert("RGBA"), free=0.196)
    (told,) = freed_of(path, dialect="ros1")  # (3 * 205 + 255) / 4 is a shade of 0.147
    assert told.endswith("; save the image as a PGM, since ros1 averages the opacity into the grey")
    assert freed_of(path) == []


def test_transparent_cells_of_that_grey_are_unknown_to_nav2(tmp_path):
    image = Image.fromarray(GREYS).convert("RGBA")
    alpha = np.where(GREYS == 205, 0, 255).astype(np.uint8)
    alpha[10:12, 30:50] = 255  # 40 opaque ones
    image.putalpha(Image.fromarray(alpha))
    (told,) = freed_of(write_pair(tmp_path, image))
    assert ": 40 cells (1.67 %) of" in told


def test_raw_and_negated_maps_have_no_such_grey(tmp_path):
    for options in ({"mode": "raw"}, {"negate": 1}):
        assert freed_of(write_pair(tmp_path, Image.fromarray(GREYS), **options)) == []


def test_a_map_read_by_rows_is_judged_as_one_in_memory(tmp_path):
    path = write_pair(tmp_path, Image.fromarray(GREYS), "pgm")

    def by_rows():
        with open_map(path) as file:
            file.by_rows(block_height=7)

    assert told_of(by_rows) == told_of(lambda: read_map(path))
    blank = np.full((40, 60), 205, dtype=np.uint8)
    path = write_pair(tmp_path, Image.fromarray(blank), "pgm", free=0.196)
    ((check, text),) = told_of(by_rows)
    assert (check, text) == (
        "map.all-unknown",
        f"{path}: every cell is unknown; are the thresholds, mode and negate right?",
    )
    assert told_of(lambda: read_map(path)) == [(check, text)]


def test_a_map_in_an_npz_of_which_nothing_is_known(tmp_path):
    unknown = np.full((3, 5), -1, dtype=np.int8)
    write_map(tmp_path / "u.npz", OccupancyGrid(unknown, 0.1, (1.5, -2.0, 0.4)))
    ((check, _),) = told_of(lambda: read_map(tmp_path / "u.npz"))
    assert check == "map.all-unknown"
    unknown[1, 2] = 0
    write_map(tmp_path / "k.npz", OccupancyGrid(unknown, 0.1, (1.5, -2.0, 0.4)))
    assert told_of(lambda: read_map(tmp_path / "k.npz")) == []


LOW = "a larger inflation_radius, or lower up and down, grade more of them"
HIGH = "a higher cost_scaling_factor, or the metric view, grades more of them"


@pytest.mark.parametrize(("costs", "told"), [
    ([254] + [0] * 98 + [1], f"98.99 % of the open cells cost 0: {LOW}"),
    ([254] + [0] * 97 + [1, 1], None),
    ([254] + [252] * 99, f"100 % of the open cells cost 252: {HIGH}"),
    ([0] * 100, "100 % of the open cells cost 0: there is no obstacle"),
    ([253] * 99 + [255], "every known cell is lethal or inscribed"),
    ([255] * 100, "every cell is unknown"),
])  # fmt: skip
@pytest.mark.parametrize("end", ["npz", "yaml"])
def test_costs_of_a_file_that_say_nothing(tmp_path, costs, told, end):
    grid = Costmap(np.array(costs, dtype=np.uint8).reshape(4, 25), 0.1, (1.5, -2.0, 0.4))
    path = tmp_path / f"c.{end}"
    with warnings.catch_warnings():  # that map_server would misread costs as bytes
        warnings.simplefilter("ignore")
        write_map(path, grid, encoding="occupancy" if end == "npz" else "costmap2d")
    expected = [] if told is None else [("run.uniform-cost", f"{path}: {told}")]
    assert told_of(lambda: read_map(path)) == expected


@pytest.mark.parametrize("end", ["pgm", "png", "bmp"])
def test_all_strips_of_an_image_count(tmp_path, monkeypatch, end):
    """Strips of two rows: those with the odd pixels are neither the first nor the last."""
    monkeypatch.setattr("mapdeal.maps.picture.STRIP", 120)
    path = write_pair(tmp_path, Image.fromarray(GREYS), end)
    (text,) = freed_of(path)
    assert ": 300 cells (12.5 %) of grey 205" in text
    path = write_pair(tmp_path, Image.fromarray(GREYS), end, mode="raw")
    assert f"{path.with_suffix('.' + end)}: 2340 pixels of mode raw hold 101..254, read as" in str(
        told_of(lambda: read_map(path))
    )


@pytest.mark.parametrize(("height", "told"), [(25, True), (26, False)])
def test_a_thousandth_of_the_cells_is_told(tmp_path, height, told):
    greys = np.full((height, 40), 254, dtype=np.uint8)
    greys[3, :10], greys[7, 11] = 0, 205
    assert bool(freed_of(write_pair(tmp_path, Image.fromarray(greys)))) == told
