"""The cells of layers as compressed tiles, in several resolutions: the data of a page."""

from __future__ import annotations

import zlib
from base64 import b64encode
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.lookup import look_up
from mapdeal.kernels.thread_pool import ThreadPool
from mapdeal.kernels.threads import thread_count
from mapdeal.records import dataclass
from mapdeal.report.coding import Way, packed, ways_of
from mapdeal.report.document import PageLayer

Cells = NDArray[Any]

TILE = 512
"""Cells of a tile's side; those at the north and east edges have fewer."""

ALL_CELLS_SIDE = 4096
"""Side up to which a layer's own cells are kept, if there is room for them."""

MOST_CELLS = 1 << 26
"""Cells of the finest level of a larger layer: of three layers they take some ten seconds."""

_COARSEST_SIDE = 256
_COMPRESSION, _COMPRESSION_OF_LARGE = 8, 6
"""zlib's 8 takes a tenth off fields and a third off maps; 9 as much again for twice the time. Of
coarser cells, which differ more from their neighbours, there is less to gain."""


@dataclass(frozen=True)
class Level:
    """A layer in one of its resolutions."""

    reduce: int
    shape: tuple[int, int]
    tiles: tuple[bytes, ...]

    @property
    def size(self) -> int:
        """Characters of all tiles."""
        return sum(map(len, self.tiles))


@dataclass(frozen=True)
class EncodedLayer:
    """A layer in its resolutions, the coarsest first."""

    coding: dict[str, Any]
    levels: tuple[Level, ...]

    @property
    def reduce(self) -> int:
        """Cells of the layer along a side of the finest cells; 1 if all are kept."""
        return self.levels[-1].reduce


@dataclass(frozen=True)
class Encoded:
    """Layers in the encoding of a page."""

    encoded: tuple[EncodedLayer, ...]

    @property
    def layers(self) -> list[dict[str, Any]]:
        """Entries for the page's header, one per layer: ``coding`` and ``levels``."""
        headers, offset = [], 0
        for layer in self.encoded:
            levels = []
            for level in layer.levels:
                tiles = []
                for tile in level.tiles:
                    tiles.append([offset, len(tile)])
                    offset += len(tile)
                height, width = level.shape
                levels.append(
                    {"reduce": level.reduce, "width": width, "height": height, "tiles": tiles}
                )
            headers.append({"coding": layer.coding, "levels": levels})
        return headers

    @property
    def data(self) -> list[bytes]:
        """The base64 text of all tiles, in the order of their offsets."""
        return [tile for one in self.encoded for level in one.levels for tile in level.tiles]

    @property
    def size(self) -> int:
        """Characters of `data`."""
        return sum(map(len, self.data))


def encoded(layers: Sequence[PageLayer], *, size: int) -> Encoded:
    """Return layers as levels of compressed tiles.

    Notes
    -----
    A level is four times coarser than the next; the coarsest is 256 cells a side or less. The
    finest has the layer's own cells if none of its sides is longer than 4096, else as many as
    2^26 allow. If all is too large, the cells of the finest level become twice as long, of all
    layers of one shape, so that those on one another agree: of the shape that this saves most
    of, as often as it takes.
    """
    threads = thread_count()
    if threads == 1:
        made = [_encoded_layer(layer, _Compressor(None, 1)) for layer in layers]
    else:
        with ThreadPool(threads) as pool:
            compressor = _Compressor(pool, threads)
            made = [_encoded_layer(layer, compressor) for layer in layers]
    shapes = [layer.frame.shape for layer in layers]
    return Encoded(tuple(_fitted(made, shapes, size)))


def finest_reduce(shape: tuple[int, int]) -> int:
    """Return how many cells share a side of the finest cells, as far as the shape shows."""
    height, width = shape
    reduce = 1
    if max(shape) > ALL_CELLS_SIDE:
        while -(-height // reduce) * -(-width // reduce) > MOST_CELLS:
            reduce *= 2
    return reduce


def _fitted(
    layers: Sequence[EncodedLayer], shapes: Sequence[tuple[int, int]], size: int
) -> Iterator[EncodedLayer]:
    """Yield each layer, given in all of its resolutions, in those that fit together."""
    finest = dict.fromkeys(shapes, 0)  # how many resolutions are left out
    sizes = {
        shape: [sum(parts) for parts in zip(*map(_sizes, group), strict=True)]
        for shape, group in _by_shape(layers, shapes).items()
    }
    total = sum(of_shape[0] for of_shape in sizes.values())
    while total > size:
        savings = {
            shape: sizes[shape][place] - sizes[shape][place + 1]
            for shape, place in finest.items()
            if place + 1 < len(sizes[shape])
        }
        if not savings:
            break
        shape = max(savings, key=savings.__getitem__)  # the first of equals
        finest[shape] += 1
        total -= savings[shape]
    for layer, shape in zip(layers, shapes, strict=True):
        yield replace(layer, levels=_chain(layer, finest[shape]))


def _chain(layer: EncodedLayer, left_out: int) -> tuple[Level, ...]:
    """Return the levels that a layer keeps: every second of all, from a finest one on."""
    return layer.levels[::-1][left_out::2][::-1]


def _sizes(layer: EncodedLayer) -> list[int]:
    """Return what a layer takes if none of its resolutions is left out, or one, or two."""
    return [
        sum(level.size for level in _chain(layer, left_out))
        for left_out in range(len(layer.levels))
    ]


def _by_shape(
    layers: Sequence[EncodedLayer], shapes: Sequence[tuple[int, int]]
) -> dict[tuple[int, int], list[EncodedLayer]]:
    groups: dict[tuple[int, int], list[EncodedLayer]] = {}
    for layer, shape in zip(layers, shapes, strict=True):
        groups.setdefault(shape, []).append(layer)
    return groups


class _Compressor:
    """Makes tiles in threads, and holds no more cells than those are busy with."""

    def __init__(self, pool: ThreadPool | None, threads: int) -> None:
        self._pool = pool
        self._most = 2 * threads
        self._waiting: deque[Future[bytes]] = deque()

    def submit(self, cells: Cells, ways: Sequence[Way], compression: int) -> Future[bytes]:
        """Submit a tile for compression."""
        if self._pool is None:
            done: Future[bytes] = Future()
            done.set_result(_tile(cells, ways, compression))
            return done
        while len(self._waiting) >= self._most:
            self._waiting.popleft().result()
        future = self._pool.submit(_tile, cells, ways, compression)
        self._waiting.append(future)
        return future


def _tile(cells: Cells, ways: Sequence[Way], compression: int) -> bytes:
    data = packed(cells, ways) if ways else cells.tobytes()
    return b64encode(zlib.compress(data, compression))


def _encoded_layer(layer: PageLayer, compressor: _Compressor) -> EncodedLayer:
    """Return a layer in all resolutions, each half the one before: `_fitted` chooses of them."""
    ways: tuple[Way, ...] = ()
    coding: dict[str, Any] = {"kind": "bytes"}
    if not layer.is_bytes:
        are_metres = layer.unit == "m" or layer.convention is not None
        ways = ways_of(
            layer.frame.resolution, layer.convention, layer.strength, are_metres=are_metres
        )
        coding = {"kind": "numbers", "ways": [way.header() for way in ways]}
    pooling = _Pooling.of(layer)
    shape = layer.frame.shape
    reduces = [finest_reduce(shape)]
    while max(shape) > reduces[-1] * _COARSEST_SIDE:
        reduces.append(2 * reduces[-1])
    if len(reduces) > 1:  # every second one, too, has a level as small as that
        reduces.append(2 * reduces[-1])
    maker: _LevelMaker | None = None
    makers = []
    for reduce in reversed(reduces):
        maker = _LevelMaker(reduce, shape, pooling, ways, compressor, coarser=maker)
        makers.append(maker)
    finest = makers[-1]
    for first in range(0, shape[0], TILE):  # a multiple of any `finest.reduce`
        rows = np.asarray(layer.values[first : first + TILE])
        finest.add(pooling.pooled(pooling.ranked(rows), finest.reduce))
    return EncodedLayer(coding, tuple(maker.level() for maker in makers))


@dataclass(frozen=True)
class _Pooling:
    """Rule for the value that represents several cells."""

    choose: np.ufunc
    order: NDArray[np.uint8] | None

    @classmethod
    def of(cls, layer: PageLayer) -> _Pooling:
        is_largest = layer.pooled == "largest"
        if not layer.is_bytes:
            return cls(np.fmax if is_largest else np.fmin, None)
        order = None if layer.rank is None else np.argsort(layer.rank, kind="stable")
        choose = np.maximum if is_largest else np.minimum
        return cls(choose, None if order is None else order.astype(np.uint8))

    def ranked(self, rows: Cells) -> Cells:
        """Return bytes by their places in the order; of equal rank the larger comes later."""
        if self.order is None:
            return rows
        return look_up(rows, np.argsort(self.order).astype(np.uint8))

    def values(self, ranked: Cells) -> Cells:
        """Return the bytes at places in the order."""
        return ranked if self.order is None else look_up(ranked, self.order)

    def pooled(self, cells: Cells, step: int) -> Cells:
        """Return one cell for each square of `step` a side, fewer at the north and east edges."""
        if step == 1:
            return cells
        return self._of_rows(self._of_rows(cells, step).T, step).T

    def _of_rows(self, cells: Cells, step: int) -> Cells:
        merged = cells[::step].copy(order="K")  # of a transposed array, too
        for place in range(1, step):
            more = cells[place::step]
            self.choose(merged[: len(more)], more, out=merged[: len(more)])
        return merged


class _LevelMaker:
    """Cuts the rows of a level into tiles, and hands them on to the next coarser one."""

    def __init__(
        self,
        reduce: int,
        shape: tuple[int, int],
        pooling: _Pooling,
        ways: Sequence[Way],
        compressor: _Compressor,
        *,
        coarser: _LevelMaker | None,
    ) -> None:
        self.reduce = reduce
        self._is_small = max(shape) <= ALL_CELLS_SIDE
        self._shape = -(-shape[0] // reduce), -(-shape[1] // reduce)
        self._pooling = pooling
        self._ways = ways
        self._compressor = compressor
        self._coarser = coarser
        self._band = np.empty((0, 0))
        self._filled = 0
        self._done = 0
        self._tiles: list[Future[bytes]] = []

    def add(self, rows: Cells) -> None:
        """Take the next rows, ranked."""
        while len(rows):
            if not self._filled:
                height = min(TILE, self._shape[0] - self._done)
                self._band = np.empty((height, self._shape[1]), dtype=rows.dtype)
            part = rows[: len(self._band) - self._filled]
            self._band[self._filled : self._filled + len(part)] = part
            self._filled += len(part)
            rows = rows[len(part) :]
            if self._filled == len(self._band):
                self._cut()

    def _cut(self) -> None:
        band, self._filled = self._band, 0
        self._done += len(band)
        if self._coarser is not None:
            self._coarser.add(self._pooling.pooled(band, 2))
        values = self._pooling.values(band)
        for first in range(0, values.shape[1], TILE):
            tile = np.ascontiguousarray(values[:, first : first + TILE])
            compression = _COMPRESSION if self._is_small else _COMPRESSION_OF_LARGE
            self._tiles.append(self._compressor.submit(tile, self._ways, compression))

    def level(self) -> Level:
        """Return the level, all of whose rows were added."""
        tiles = tuple(tile.result() for tile in self._tiles)
        return Level(self.reduce, self._shape, tiles)
