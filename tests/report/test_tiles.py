"""Tiles of layers, read back by a decoder that knows the format's description alone."""

import base64
import json
import math
import shutil
import struct
import subprocess
import threading
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

import mapdeal
from mapdeal import OccupancyGrid, esdf
from mapdeal.grid.frame import Frame
from mapdeal.kernels.blocks import lazy_layer
from mapdeal.kernels.threads import Worker, use_threads
from mapdeal.pictures.colours import LayerStyle
from mapdeal.report import tiles
from mapdeal.report.document import PageLayer
from mapdeal.report.tiles import encoded, finest_reduce
from strategies import examples

pytestmark = pytest.mark.slow

STYLE = LayerStyle(np.zeros((1, 3), dtype=np.uint8))
ROOM = 1 << 40
DECODER = Path(mapdeal.__file__).parent / "report" / "page" / "decode.js"


def _layer(values, *, shape=None, resolution=0.05, **more):
    height, width = shape or values.shape
    frame = Frame(height, width, resolution, (-3.5, 7.25, 0.3))
    return PageLayer("layer", "A layer", frame, values, STYLE, **more)


def _decoded_tile(coding, data, width, height):
    """Return the values of an inflated tile, as docs/report.md describes the format."""
    if coding["kind"] == "bytes":
        return np.frombuffer(data, dtype=np.uint8).reshape(height, width)
    scheme_index, planes, top, count = struct.unpack_from("<4i", data)
    exceptions = struct.unpack_from(f"<{count}f", data, 16)
    start, size = 16 + 4 * count, width * height
    assert len(data) == start + planes * size
    numbers = np.zeros((height, width), dtype=np.int64)
    for plane in range(planes):
        part = np.frombuffer(data, dtype=np.uint8, count=size, offset=start + plane * size)
        numbers += part.reshape(height, width).astype(np.int64) * 256**plane
    numbers = np.where(numbers % 2 == 1, -(numbers + 1) // 2, numbers // 2)
    # each number is left + below - below left + its residue: a sum over cells south-west of it
    numbers = numbers.cumsum(axis=0).cumsum(axis=1)
    numbers = (numbers + 2**31) % 2**32 - 2**31
    scheme, distinct = coding["ways"][scheme_index], np.unique(numbers)
    found = distinct.tolist()
    meanings = [_meaning(scheme, n) if n <= top else exceptions[n - top - 1] for n in found]
    return np.array(meanings, dtype=np.float32)[np.searchsorted(distinct, numbers)]


def _meaning(scheme, number):
    if scheme["kind"] == "steps":
        return number * scheme["step"]
    if scheme["kind"] == "squares":
        offset, unit = scheme["above"] if number >= 0 else scheme["below"]
        distance = (math.sqrt(abs(number)) - offset) * unit
        return distance if number >= 0 else -distance
    assert scheme["kind"] == "bits"
    bits = number << scheme["hidden"]
    return struct.unpack("<f", struct.pack("<i", bits if bits >= 0 else bits ^ 0x7FFFFFFF))[0]


def _tiles_of(levels):
    """Yield the place of each tile: level, the slices of its cells, and where its text is."""
    for level in levels:
        columns = math.ceil(level["width"] / 512)
        assert len(level["tiles"]) == columns * math.ceil(level["height"] / 512)
        for index, where in enumerate(level["tiles"]):
            row, column = (512 * part for part in divmod(index, columns))
            rows = slice(row, min(row + 512, level["height"]))
            yield level, rows, slice(column, min(column + 512, level["width"])), where


def _inflated(result, where):
    offset, length = where
    text = b"".join(result.data)[offset : offset + length]
    return zlib.decompress(base64.b64decode(text, validate=True))


def _decoded(result, place=0):
    header, levels = result.layers[place], {}
    dtype = np.uint8 if header["coding"]["kind"] == "bytes" else np.float32
    for level, rows, columns, where in _tiles_of(header["levels"]):
        values = np.zeros((level["height"], level["width"]), dtype=dtype)
        values = levels.setdefault(level["reduce"], values)
        width, height = columns.stop - columns.start, rows.stop - rows.start
        data = _inflated(result, where)
        values[rows, columns] = _decoded_tile(header["coding"], data, width, height)
    return levels


def _schemes_used(result):
    header = result.layers[0]
    data = [_inflated(result, where) for where in header["levels"][-1]["tiles"]]
    return {header["coding"]["ways"][struct.unpack_from("<i", tile)[0]]["kind"] for tile in data}


def _same(found, values, *, within=0.0, relative=0.0):
    strange = ~np.isfinite(values)
    np.testing.assert_array_equal(found[strange], values[strange])
    expected = values[~strange].astype(np.float64)
    error = np.abs(found[~strange].astype(np.float64) - expected)
    assert np.all(error <= within + relative * np.abs(expected)), error.max()


SHAPES = st.one_of(
    st.tuples(st.integers(1, 40), st.integers(1, 40)),
    st.sampled_from([(1, 1), (1, 700), (1100, 1), (512, 512), (513, 511), (1025, 3), (513, 520)]),
)


@st.composite
def _numbers(draw, scales=(1e-3, 0.05, 7.0, 3000.0)):
    shape, seed = draw(SHAPES), draw(st.integers(0, 2**32 - 1))
    random, scale = np.random.default_rng(seed), draw(st.sampled_from(scales))
    values = np.full(shape, random.normal() * scale)
    if draw(st.booleans()):
        values = random.normal(size=shape) * scale
    for strange in draw(st.lists(st.sampled_from([np.nan, np.inf, -np.inf]), max_size=3)):
        values[random.random(shape) < draw(st.sampled_from([0.01, 0.5, 1.0]))] = strange
    return values.astype(np.float32)


@examples(12)
@given(values=_numbers(), convention=st.sampled_from([None, "fast-planner", "center", "border"]))
def test_metres_are_exact_to_half_a_millimetre_whatever_they_are(values, convention):
    result = encoded([_layer(values, unit="m", convention=convention)], size=ROOM)
    _same(_decoded(result)[1], values, within=0.00051, relative=2**-24)


@examples(10)
@given(values=_numbers(scales=(1e-20, 1.0, 1e9, 1e37)))
def test_other_numbers_are_exact_to_four_digits_at_any_scale(values):
    _same(_decoded(encoded([_layer(values)], size=ROOM))[1], values, within=1e-30, relative=2**-15)


@examples(15)
@given(
    shape=SHAPES, seed=st.integers(0, 2**32 - 1),
    share=st.sampled_from([0.0, 0.001, 0.02, 0.6, 1.0]),
    convention=st.sampled_from(["fast-planner", "center", "border"]),
    strength=st.sampled_from([1.0, 1.7, 1e-3]), max_distance=st.sampled_from([None, 0.13, 1.03]),
)  # fmt: skip
def test_fields_are_stored_as_their_squares(shape, seed, share, convention, strength, max_distance):
    occupancy = np.where(np.random.default_rng(seed).random(shape) < share, 100, 0).astype(np.int8)
    if share == 0.02:
        occupancy[: shape[0] // 2] = 100  # deep inside
    more = {"convention": convention, "strength": strength}
    field = esdf(OccupancyGrid(occupancy, 0.05), max_distance=max_distance, **more)
    result = encoded([_layer(field.distance, unit="m", **more)], size=ROOM)
    _same(_decoded(result)[1], field.distance, within=1e-4)
    assert _schemes_used(result) == {"squares"}


def _roots(factor):
    row, column = np.mgrid[:300, :600]
    values = factor * 0.05 * np.sqrt((row - 70.0) ** 2 + (column - 20) ** 2)
    values[:40, 500:] = np.nan
    return values


STEEP = esdf(OccupancyGrid([[100, *[0] * 11]], 0.05), strength=1.23).distance
BEYOND = [[46_340.0, 46_341.0, 60_000.0, -46_341.0, 65_536.0]]
"""Their squares are beyond what a whole number holds."""


@pytest.mark.parametrize(("values", "more", "within", "scheme"), [
    ([[3e6, -3e6, 0.001]], {}, 0.00051, None),  # beyond the range of steps
    ([[1e30, -1e30, 0.0]], {}, 0.00051, None),
    ([[2147483.5, -2147483.5, 1e-9]], {}, 0.00051, None),
    (BEYOND, {"convention": "center", "resolution": 1.0}, 0.00051, None),
    (_roots(1), {}, 1e-4, "squares"),  # clearances
    (_roots(2), {}, 1e-4, "squares"),  # widths
    (STEEP, {"convention": "fast-planner"}, 0.00051, "steps"),  # tiles lack the factor
], ids=["3e6", "1e30", "2e6", "beyond", "clearances", "widths", "steep"])  # fmt: skip
def test_metres_are_stored_as_squares_where_these_fit(values, more, within, scheme):
    values = np.array(values, dtype=np.float32)
    result = encoded([_layer(values, unit="m", **more)], size=ROOM)
    _same(_decoded(result)[1], values, within=within, relative=2**-24)
    assert scheme is None or _schemes_used(result) == {scheme}


def test_a_field_takes_a_quarter_of_npz_or_less():
    occupancy = np.where(np.random.default_rng(7).random((700, 600)) < 0.0001, 100, 0)
    distance = esdf(OccupancyGrid(occupancy, 0.05)).distance
    result = encoded([_layer(distance, unit="m", convention="fast-planner")], size=ROOM)
    assert result.encoded[0].levels[-1].size < len(zlib.compress(distance.tobytes(), 6)) / 4


def _pooled(values, reduce, choose):
    """Return the value of each square of cells, cell by cell."""
    height, width = (math.ceil(length / reduce) for length in values.shape)
    pooled = np.empty((height, width), dtype=values.dtype)
    for row in range(height):
        for column in range(width):
            square = values[row * reduce :, column * reduce :][:reduce, :reduce]
            pooled[row, column] = choose(square.ravel().tolist())
    return pooled


@pytest.mark.parametrize("pooled", ["largest", "smallest"])
@pytest.mark.parametrize("has_rank", [False, True])
def test_levels_of_bytes_hold_the_value_of_extreme_rank(pooled, has_rank):
    random = np.random.default_rng(3)
    values = random.integers(0, 256, (70, 517), dtype=np.uint8)
    rank = random.integers(0, 40, 256).astype(np.uint8) if has_rank else None

    def choose(square):
        key = (lambda v: (rank[v], v)) if has_rank else None
        return (max if pooled == "largest" else min)(square, key=key)

    levels = _decoded(encoded([_layer(values, pooled=pooled, rank=rank)], size=ROOM))
    assert list(levels) == [4, 1]
    np.testing.assert_array_equal(levels[1], values)
    np.testing.assert_array_equal(levels[4], _pooled(values, 4, choose))


@pytest.mark.parametrize("pooled", ["largest", "smallest"])
def test_levels_of_numbers_hold_the_extreme_and_nan_only_where_there_is_no_other(pooled):
    random = np.random.default_rng(4)
    values = (random.integers(-40, 400, (109, 330)) / 8).astype(np.float32)
    values[random.random(values.shape) < 0.3] = np.nan
    values[8:24, 40:80] = np.nan
    values[100, 100] = np.inf

    def choose(square):
        known = [value for value in square if value == value]
        return (max if pooled == "largest" else min)(known) if known else math.nan

    levels = _decoded(encoded([_layer(values, pooled=pooled)], size=ROOM))
    assert list(levels) == [4, 1]
    _same(levels[4], _pooled(values, 4, choose), relative=2**-15)
    assert np.isnan(levels[4]).any()


def _some_layers(make=lambda values: values):
    random = np.random.default_rng(5)
    occupancy = np.where(random.random((1100, 300)) < 0.003, 100, 0).astype(np.int8)
    distance = esdf(OccupancyGrid(occupancy, 0.05)).distance
    rank = np.roll(np.arange(256), 1).astype(np.uint8)
    return [
        _layer(make(occupancy.view(np.uint8)), shape=distance.shape, rank=rank),
        _layer(make(distance), shape=distance.shape, unit="m", convention="fast-planner",
               pooled="smallest"),
    ]  # fmt: skip


@pytest.mark.parametrize("threads", [1, 3])
def test_lazy_layers_are_read_once_in_order_and_give_the_same_bytes(threads):
    requested = []

    def lazily(values):
        def make(rows):
            requested.append((rows.start, rows.stop))
            return values[rows]

        return lazy_layer(values.shape, values.dtype, make, block_height=37)

    with use_threads(2):
        expected = encoded(_some_layers(), size=ROOM)
    with use_threads(threads):
        result = encoded(_some_layers(lazily), size=ROOM)
    assert (result.layers, result.data) == (expected.layers, expected.data)
    assert requested == 2 * [(0, 512), (512, 1024), (1024, 1100)]


def _noise(side, seed, **more):
    values = np.random.default_rng(seed).integers(0, 256, (side, side), dtype=np.uint8)
    return _layer(values, **more)


def _reduces(result):
    return [[level.reduce for level in layer.levels] for layer in result.encoded]


def test_what_is_too_large_gets_coarser_cells_where_that_saves_most():
    layers = [_noise(300, 1), _noise(600, 2), _noise(600, 3), _noise(450, 4)]
    complete = encoded(layers, size=ROOM)
    assert _reduces(complete) == [[4, 1], [4, 1], [4, 1], [4, 1]]
    result = encoded(layers, size=sum(map(len, complete.data)) - 1)
    assert _reduces(result) == [[4, 1], [8, 2], [8, 2], [4, 1]]
    np.testing.assert_array_equal(_decoded(result, 3)[1], layers[3].values)
    np.testing.assert_array_equal(_decoded(result, 2)[2], _pooled(layers[2].values, 2, max))
    np.testing.assert_array_equal(_decoded(result, 2)[8], _pooled(layers[2].values, 8, max))
    again = encoded(layers, size=sum(map(len, result.data)))
    assert (again.layers, again.data) == (result.layers, result.data)
    smaller = encoded(layers, size=sum(map(len, result.data)) - 1)
    assert _reduces(smaller) == [[4, 1], [8, 2], [8, 2], [2]]
    assert smaller.encoded[3].levels[-1].reduce == 2
    # there is an end to how coarse cells become
    result = encoded([_noise(600, 1), _noise(256, 2), _noise(257, 3)], size=0)
    assert _reduces(result) == [[8], [1], [4]]


@pytest.mark.parametrize("shape", [(256, 256), (257, 3), (3, 513), (700, 1100)])
@pytest.mark.parametrize("size", [ROOM, 40_000, 4_000])
def test_the_coarsest_level_is_a_thumbnail_and_each_other_four_times_finer(shape, size):
    values = np.random.default_rng(8).integers(0, 256, shape, dtype=np.uint8)
    (reduces,) = _reduces(encoded([_layer(values)], size=size))
    assert max(shape) / reduces[0] <= 256
    assert reduces == [reduces[-1] * 4**k for k in range(len(reduces))][::-1]


@pytest.mark.parametrize(("shape", "reduce"), [
    ((1, 1), 1), ((4097, 30), 1), ((8192, 8192), 1), ((8193, 8192), 2), ((30_000, 30_000), 4),
    ((1, 1_000_000_000), 16),
])  # fmt: skip
def test_the_finest_level_of_large_layers_has_so_many_cells(shape, reduce):
    assert finest_reduce(shape) == reduce
    assert math.ceil(shape[0] / reduce) * math.ceil(shape[1] / reduce) <= 2**26


def test_a_large_layer_is_read_without_being_held(monkeypatch):
    monkeypatch.setattr(tiles, "MOST_CELLS", 1 << 18)
    shape, rows_at_once = (4500, 300), []

    def make(rows):
        rows_at_once.append(rows.stop - rows.start)
        values = np.zeros((rows.stop - rows.start, shape[1]), dtype=np.uint8)
        values[:, ::100] = 100
        values[0, 7] = 200
        return values

    values = lazy_layer(shape, np.uint8, make, block_height=512)
    result = encoded([_layer(values, shape=shape)], size=ROOM)
    assert _reduces(result) == [[64, 16, 4]]
    expected = np.zeros((1125, 75), dtype=np.uint8)
    expected[:, ::25] = 100
    expected[::128, 1] = 200
    np.testing.assert_array_equal(_decoded(result)[4], expected)
    assert max(rows_at_once) <= 512


def test_the_page_reads_what_is_written(tmp_path):
    node = shutil.which("node")
    if node is None:
        pytest.skip("node is not installed")
    strange = np.random.default_rng(6).normal(size=(530, 40)).astype(np.float32)
    strange[3:7], strange[0, 0], strange[0, 1] = np.nan, np.inf, -np.inf
    layers = [*_some_layers(), _layer(strange, unit="m"), _layer(1e7 * strange)]
    layers.append(_layer(strange * 1e30, unit="m"))
    for convention in ("center", "border"):
        field = esdf(OccupancyGrid(strange[:50] > 1, 0.05), convention=convention, strength=3.0)
        more = {"convention": convention, "strength": 3.0}
        layers.append(_layer(field.distance, unit="m", **more))
    result, page = encoded(layers, size=ROOM), tmp_path / "page.json"
    page.write_text(json.dumps({"data": b"".join(result.data).decode(), "layers": result.layers}))
    script = Path(__file__).with_name("decode_page.mjs")
    out = subprocess.run([node, script, DECODER, page], capture_output=True, check=True)
    tiles = iter(json.loads(out.stdout))
    for place, header in enumerate(result.layers):
        levels = _decoded(result, place)
        for level, rows, columns, _ in _tiles_of(header["levels"]):
            expected, tile = levels[level["reduce"]][rows, columns], next(tiles)
            assert (tile["height"], tile["width"]) == expected.shape
            assert tile["type"] == {"u": "Uint8Array", "f": "Float32Array"}[expected.dtype.kind]
            found = np.frombuffer(base64.b64decode(tile["values"]), dtype=expected.dtype)
            np.testing.assert_array_equal(found.reshape(expected.shape), expected)
    assert next(tiles, None) is None


def test_threads_that_compress_tiles_start_no_further_threads(monkeypatch):
    starters, start = set(), Worker.start
    monkeypatch.setattr(Worker, "start", lambda w: starters.add(threading.get_ident()) or start(w))
    with use_threads(2):
        encoded([_layer(np.zeros((1024, 512), np.uint8), rank=np.arange(256))], size=ROOM)
    assert starters == {threading.get_ident()}
