"""Tallies that are updated row by row, against counts of the whole map."""

import itertools
import re
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st

import oracles
from checks.pairs import write_pair
from mapdeal import OccupancyGrid, lint, read_map, write_map
from mapdeal.checks import facts
from mapdeal.checks.facts import CellTallies, GridFacts, PixelTallies, gather
from mapdeal.errors import MalformedInputError
from mapdeal.files.source import use_memory
from mapdeal.maps.dialects import DIALECTS, MapMetadata, cells_of
from mapdeal.maps.picture import Picture, Strips
from maps.pictures import SHAPE, picture_of_each_kind
from strategies import occupancies

METADATA = MapMetadata(
    "m.png", 0.25, (1.5, -2.0, 0.4), occupied_thresh=0.65, free_thresh=0.25, negate=False,
    mode="trinary",
)  # fmt: skip


PICTURES = picture_of_each_kind([0, 90, 100, 101, 128, 200, 205, 206, 254, 255])


def pixels_one_by_one(picture):
    for row, col in np.ndindex(picture.shape):
        place = slice(row, row + 1), slice(col, col + 1)
        alpha = None if picture.alpha is None else picture.alpha[place]
        yield replace(picture, samples=picture.samples[place], alpha=alpha)


def is_map_saver_unknown(pixel):
    if pixel.palette is not None:
        return pixel.palette[pixel.samples[0, 0], :3].tolist() == [205] * 3
    return {int(sample) * 255 for sample in pixel.samples.reshape(-1)} == {205 * pixel.maxval}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mode", "negate"), [("trinary", False), ("trinary", True), ("scale", False), ("raw", False)]
)
@pytest.mark.parametrize("name", PICTURES)
def test_tallies_of_pixels_equal_a_count_pixel_by_pixel(name, mode, negate):
    picture, metadata = PICTURES[name], replace(METADATA, mode=mode, negate=negate)
    kinds = ("occupied", "free", "unknown", "between")
    states = {name: dict.fromkeys(kinds, 0) for name in DIALECTS}
    differing, freed = {"humble": 0, "ros1": 0}, dict.fromkeys(DIALECTS, 0)
    coloured = see_through = lost = 0
    greys, readings = {}, {n: cells_of(picture, metadata, n)[::-1].flat for n in DIALECTS}
    for pixel, *cells in zip(pixels_one_by_one(picture), *readings.values(), strict=True):
        values = dict(zip(DIALECTS, map(int, cells), strict=True))
        for name, value in values.items():
            states[name][{0: "free", 100: "occupied", -1: "unknown"}.get(value, "between")] += 1
            freed[name] += mode != "raw" and value == 0 and is_map_saver_unknown(pixel)
        for name in differing:
            differing[name] += values[name] != values["nav2"]
        sample = pixel.samples[0, 0]
        coloured += pixel.colour == "rgb" and len(set(sample.tolist())) > 1
        if pixel.palette is not None:
            see_through += pixel.palette[sample][3] < 255
        else:
            see_through += pixel.alpha is not None and pixel.alpha[0, 0] < picture.maxval
        if pixel.colour == "grey" and pixel.maxval == 255:
            greys[int(sample)] = greys.get(int(sample), 0) + 1
            lost += mode == "raw" and 100 < sample < 255
    found = PixelTallies(metadata)
    for band in picture.bands(50):
        found.add(band)
    found.finish()
    assert found.size == SHAPE[0] * SHAPE[1]
    assert found.counts == states
    assert found.differing == differing
    assert {name: freed_cells.count for name, freed_cells in found.freed.items()} == freed
    assert (found.coloured, found.not_opaque, found.lost) == (coloured, see_through, lost)
    assert found.greys == greys


def by_hand(cells):
    height, width = cells.shape
    border = [(r, c) for r, c in np.ndindex(cells.shape)
              if r in (0, height - 1) or c in (0, width - 1)]  # fmt: skip
    known = np.argwhere(cells >= 0)
    box = tuple((known.max(axis=0) - known.min(axis=0) + 1).tolist()) if len(known) else (0, 0)
    return {
        "border": len(border),
        "free_on_border": sum(cells[place] == 0 for place in border),
        "known_box": box,
        "sizes": sorted(len(group) for group in oracles.groups(cells == 0)),
        "counts": {
            "occupied": int((cells == 100).sum()), "free": int((cells == 0).sum()),
            "unknown": int((cells == -1).sum()),
            "between": int(((cells > 0) & (cells < 100)).sum()),
        },
    }  # fmt: skip


def summary(found):
    sizes, counts = found.free_components
    figures = {name: getattr(found, name) for name in ("border", "free_on_border", "known_box")}
    return {**figures, "sizes": np.repeat(sizes, counts).tolist(), "counts": found.counts}


@given(occupancies(longest=14), st.integers(1, 5))
def test_cells_are_counted_as_in_the_whole_whichever_side_comes_first(cells, rows):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(facts, "_CELLS_PER_BAND", 2 * cells.shape[1])
        south = GridFacts.of(OccupancyGrid(cells, 1.0)).cells
        north = CellTallies(cells.shape, from_north=True)
        for first in range(0, len(cells), rows):
            north.add(cells[::-1][first : first + rows])
    assert summary(south) == summary(north) == by_hand(cells)
    for least, most in ((1, 3), (4, 10**6)):
        assert south.places_of_components(least, most) == north.places_of_components(least, most)
    if (cells >= 0).any():
        assert south.middle_of_known == north.middle_of_known


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["grey", "rgba"])
def test_memory_does_not_grow_with_the_number_of_rows(kind, tmp_path, monkeypatch):
    strip = np.tile(np.repeat(np.array([0, 205, 254, 254], np.uint8), 256), (1 << 8, 1))
    picture = Picture("PNM", "grey", strip)
    if kind == "rgba":
        noise = np.random.default_rng(2).integers(0, 256, (*strip.shape, 3)).astype(np.uint8)
        noise[:, :80] = strip[:, :80, np.newaxis]
        picture = Picture("PNG", "rgb", noise, alpha=np.full_like(strip, 255))
    count = 60 if kind == "grey" else 12

    class Opened:
        def __init__(self, *_, **__):
            pass

        def __enter__(self):
            shape = (count * strip.shape[0], strip.shape[1])
            return Strips(shape, lambda: itertools.repeat(picture, count)), b"P5 1 1 255\n"

        def __exit__(self, *_):
            pass

    monkeypatch.setattr(facts.images, "open_for_one_pass", Opened)
    path = write_pair(tmp_path, b"P5 1 1 255\n0")
    tracemalloc.start()
    pair, cells, findings = gather(path)
    current, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert findings == []
    assert pair.pixels.size == cells.cells.size == count * strip.size
    assert current < 1_000_000
    assert peak < (6_000_000 if kind == "grey" else 60_000_000)


def test_lint_asks_for_no_memory_for_cells(tmp_path):
    side = 3000
    path = write_pair(tmp_path, b"P5 %d %d 255\n" % (side, side) + bytes(side**2))

    def refusal_of_lint():
        (pair, _, findings) = gather(path)
        return None if pair is not None else findings[0].message

    def refusal_of_reading():
        try:
            read_map(path)
        except MalformedInputError as error:
            return str(error)

    reading, linting = least_memory(refusal_of_reading), least_memory(refusal_of_lint)
    assert linting == pytest.approx(reading - side**2, abs=500_000)  # messages have three digits


def least_memory(refusal):
    """Return the memory, bytes, with which a call is not refused; its last claim is the largest."""
    needed = 1_000_000
    while True:
        with use_memory(needed):
            message = refusal()
        if message is None:
            return needed
        needed = round(float(re.search(r"needs? ([0-9.]+) MB", message)[1]) * 1e6)


@pytest.mark.parametrize("is_changed", [False, True])
@pytest.mark.parametrize("side", [180, 900])
def test_a_map_that_looks_the_same_turned_is_ambiguous(tmp_path, side, is_changed):
    cells = np.zeros((side, side + 20), dtype=np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = 100
    cells[side // 4, : side // 2] = cells[-1 - side // 4, -side // 2 :] = 100
    if is_changed:
        cells[: side // 2, side // 6 : side // 2 : side // 6] = 100
    path = tmp_path / "m.npz"
    write_map(path, OccupancyGrid(cells, 0.05, (1.5, -2.0, 0.4)))
    found = [finding for finding in lint(path) if finding.check == "map.ambiguous"]
    assert len(found) == (not is_changed)
    assert all("turned by 180 degrees, the map looks the same" in f.message for f in found)
