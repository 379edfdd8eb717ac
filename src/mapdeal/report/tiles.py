"""Pictures of a page, cut into tiles.

Fields are stored as errors of a prediction. The square of an exact distance in cells is an integer,
``(r - r0)^2 + (c - c0)^2`` of the nearest obstacle cell. Predicted by left + below - below left,
its error is 0 wherever those four cells have the same nearest obstacle, nearly everywhere.
"""

from __future__ import annotations

import math
import struct
import zlib
from base64 import b64encode
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from functools import partial
from itertools import accumulate
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.kernels.arrays import Bytes
from mapdeal.kernels.lookup import look_up, pooled
from mapdeal.kernels.threads import ThreadPool, thread_count
from mapdeal.pictures.overlay import known_box
from mapdeal.records import asdict, dataclass, field, replace
from mapdeal.report.document import Item, PageLayer

_MARGIN = 0.04  # width of the border around the known cells, as a share of the longer side
_UNKNOWN = 255  # of maps and of costs, as bytes
Numbers = NDArray[np.float32]
SQUARE_ERROR = 1e-4  # metres that a distance coded by its square may be off; else it is by steps
STEP = 1e-3  # metres of a step
_STEP_ERROR = 0.51 * STEP
_MOST_EXCEPTIONS = 8
_LARGEST = 2.0**31 - 16
_HIDDEN_BITS = 8
_RELATIVE_ERROR = 2.0**-16
_SMALLEST_ERROR = 1e-30
Cells = NDArray[Any]
TILE = 512  # cells of a tile's side; those at the north and east edges have fewer
ALL_CELLS_SIDE = 4096  # side up to which a layer's own cells are kept, if there is room for them
MOST_CELLS = 1 << 26  # of the finest level of a larger layer: three layers take some ten seconds
_COARSEST_SIDE = 256
# zlib's 8 takes a tenth off fields and a third off maps; 9 as much again for twice the time. Of
# coarser cells, which differ more from their neighbours, there is less to gain.
_COMPRESSION, _COMPRESSION_OF_LARGE = 8, 6


def extent_of(
    layers: Sequence[PageLayer], items: Sequence[Item]
) -> tuple[float, float, float, float] | None:
    """Return the box in the map frame of the known cells of all layers, and of all items."""
    points = []
    own = [layer for layer in layers if layer.style.labels.get(_UNKNOWN) == "unknown"]
    by_frame = {layer.frame: layer for layer in reversed(own)}  # the first of each
    for frame, layer in by_frame.items():
        if (box := known_box(layer.values, _UNKNOWN)) is not None:
            rows, cols = (box.row, box.row + box.height), (box.col, box.col + box.width)
            corners = [(row, col) for row in rows for col in cols]
            points.append(frame.xy_from_continuous_rowcol(corners))
    if not points:
        return None
    for item in items:
        points += [line for line in item.lines if len(line)]
        points += [] if item.place is None else [np.array([item.place], dtype=np.float64)]
    every = np.vstack(points)
    low, high = every.min(axis=0), every.max(axis=0)
    margin = _MARGIN * float((high - low).max())
    return (*(low - margin).tolist(), *(high + margin).tolist())


# A coding represents numbers by integers: `integers_of` returns the nearest integer of each value,
# any integer where the value has none, `values_of` the numbers that integers represent, and
# `is_near` where these are close enough to the values.


@dataclass(frozen=True)
class Squares:
    """Distances by their squares in cells: (sqrt(n) - offset) unit, negative ones alike."""

    above: tuple[float, float]
    below: tuple[float, float]

    def integers_of(self, values: Numbers) -> NDArray[np.float64]:
        is_below = values < 0
        offset, unit = self._offset_and_unit(is_below)
        squares = np.rint((np.abs(values.astype(np.float64)) / unit + offset) ** 2)
        return np.asarray(np.where(is_below, -squares, squares))

    def values_of(self, integers: NDArray[np.float64]) -> Numbers:
        is_below = integers < 0
        offset, unit = self._offset_and_unit(is_below)
        distances = (np.sqrt(np.abs(integers)) - offset) * unit
        return np.asarray(np.where(is_below, -distances, distances), np.float32)

    def is_near(self, found: Numbers, values: Numbers) -> NDArray[np.bool_]:
        return np.asarray(np.abs(found - values) <= SQUARE_ERROR)

    def _offset_and_unit(self, is_below: NDArray[np.bool_]) -> Iterator[NDArray[Any]]:
        return (np.where(is_below, *two) for two in zip(self.below, self.above, strict=True))


@dataclass(frozen=True)
class Steps:
    step: float = STEP

    def integers_of(self, values: Numbers) -> NDArray[np.float64]:
        return np.rint(values.astype(np.float64) / self.step)

    def values_of(self, integers: NDArray[np.float64]) -> Numbers:
        return (integers * self.step).astype(np.float32)

    def is_near(self, found: Numbers, values: Numbers) -> NDArray[np.bool_]:
        return np.asarray(np.abs(found - values) <= _STEP_ERROR)


@dataclass(frozen=True)
class Bits:
    """Numbers by the bits of float32, in an order that is that of the numbers."""

    hidden: int = 0

    def integers_of(self, values: Numbers) -> NDArray[np.float64]:
        """Return the bits of each number, those of negative ones turned round."""
        bits = values.view(np.int32)
        ordered = np.where(bits < 0, bits ^ 0x7FFFFFFF, bits).astype(np.float64)
        return np.asarray(np.rint(ordered / 2**self.hidden))

    def values_of(self, integers: NDArray[np.float64]) -> Numbers:
        ordered = np.clip(integers * 2**self.hidden, -(2.0**31), 2.0**31 - 1).astype(np.int32)
        return np.asarray(np.where(ordered < 0, ordered ^ 0x7FFFFFFF, ordered).view(np.float32))

    def is_near(self, found: Numbers, values: Numbers) -> NDArray[np.bool_]:
        """Return where both are the same to five digits; exactly, if no bits are left out."""
        if not self.hidden:
            return np.asarray(found == values)
        error = _RELATIVE_ERROR * np.abs(values) + _SMALLEST_ERROR
        return np.asarray(np.abs(found - values) <= error)


Coding = Squares | Steps | Bits


def _codings_of(layer: PageLayer) -> tuple[Coding, ...]:
    """Return the codings of a layer's numbers, the best first, the last one always fitting."""
    resolution, convention = layer.frame.resolution, layer.convention
    if convention is None and layer.unit != "m":
        return Bits(_HIDDEN_BITS), Bits()
    if convention is None:  # a clearance, or a width
        by_cell, by_two = (0.0, resolution), (0.0, 2 * resolution)
        return Squares(by_cell, by_cell), Squares(by_two, by_two), Steps(), Bits()
    offsets = {"fast-planner": (0.0, 1.0), "center": (0.0, 0.0), "border": (0.5, 0.5)}
    above, below = offsets[convention]
    return Squares((above, resolution * layer.strength), (below, resolution)), Steps(), Bits()


def packed(values: Numbers, codings: Sequence[Coding]) -> bytes:
    fits = (_fit(values, coding) for coding in codings)
    # the last coding holds any number
    index, (integers, top, exceptions) = next((k, fit) for k, fit in enumerate(fits) if fit)
    planes = _planes(_folded(integers))
    header = struct.pack("<4i", index, len(planes), top, len(exceptions))
    return b"".join([header, exceptions.astype("<f4").tobytes(), *planes])


def _fit(values: Numbers, coding: Coding) -> tuple[NDArray[np.int32], int, Numbers] | None:
    """Return a tile's integers, the largest one, and the exceptions; None if these are too many."""
    with np.errstate(invalid="ignore", over="ignore"):
        integers = coding.integers_of(values)
        is_coded = np.isfinite(values) & (np.abs(integers) < _LARGEST)
        is_coded &= coding.is_near(coding.values_of(np.where(is_coded, integers, 0)), values)
    if is_coded.all():
        return integers.astype(np.int32), int(integers.max()), np.empty(0, dtype=np.float32)
    exceptional = values[~is_coded]
    exceptions = np.unique(exceptional)
    if len(exceptions) > _MOST_EXCEPTIONS:
        return None
    top = int(integers[is_coded].max()) if is_coded.any() else 0
    integers[~is_coded] = top + 1 + np.searchsorted(exceptions, exceptional)
    return integers.astype(np.int32), top, exceptions


def _folded(integers: NDArray[np.int32]) -> NDArray[np.uint32]:
    """Return the error of each number's prediction, the sign in the lowest bit."""
    residuals = np.diff(np.diff(integers, axis=0, prepend=np.int32(0)), axis=1, prepend=np.int32(0))
    return (residuals.view(np.uint32) << np.uint32(1)) ^ (residuals >> np.int32(31)).view(np.uint32)


def _planes(numbers: NDArray[np.uint32]) -> list[bytes]:
    count = (int(numbers.max()).bit_length() + 7) // 8
    by_byte = numbers.astype("<u4").view(np.uint8).reshape(*numbers.shape, 4)
    return [by_byte[..., place].tobytes() for place in range(count)]


@dataclass(frozen=True)
class Level:
    reduce: int
    shape: tuple[int, int]
    tiles: tuple[bytes, ...]
    size: int  # bytes of all tiles, also once these are dropped


@dataclass(frozen=True)
class EncodedLayer:
    coding: dict[str, Any]
    levels: tuple[Level, ...]


@dataclass(frozen=True)
class Encoded:
    encoded: tuple[EncodedLayer, ...]

    @property
    def layers(self) -> list[dict[str, Any]]:
        headers, offsets = [], accumulate(map(len, self.data), initial=0)
        for layer in self.encoded:
            levels = []
            for level in layer.levels:
                tiles = [[next(offsets), len(tile)] for tile in level.tiles]
                size = {"width": level.shape[1], "height": level.shape[0]}
                levels.append({"reduce": level.reduce, **size, "tiles": tiles})
            headers.append({"coding": layer.coding, "levels": levels})
        return headers

    @property
    def data(self) -> list[bytes]:
        return [tile for layer in self.encoded for level in layer.levels for tile in level.tiles]


def encoded(layers: Sequence[PageLayer], *, size: int) -> Encoded:
    # A level is four times coarser than the next; the coarsest is 256 cells a side or less. The
    # finest has the layer's own cells if none of its sides is longer than 4096, else as many as
    # 2^26 allow. If all is too large, the cells of the finest level become twice as long, of all
    # layers of one shape, so that those on one another agree: of the shape that this saves most of,
    # as often as it takes.
    threads, shapes = thread_count(), [layer.frame.shape for layer in layers]
    sizes: dict[tuple[int, int], list[int]] = {}
    dropped: dict[tuple[int, int], int] = {}  # how many resolutions have only sizes
    encoded_layers: list[EncodedLayer] = []
    waiting: deque[Future[bytes]] = deque()  # few, so that few of the cells are in memory
    with ThreadPool(threads if threads > 1 else 0) as pool:  # without threads submit does it

        def submit(cells: Cells, **options: Any) -> Future[bytes]:
            while len(waiting) >= 2 * threads:
                waiting.popleft().result()
            waiting.append(pool.submit(_tile, cells, **options))
            return waiting[-1]

        for layer in layers:
            new, shape = _encoded_layer(layer, submit), layer.frame.shape
            sums = sizes.setdefault(shape, [0] * len(new.levels))
            for left_out in range(len(sums)):
                sums[left_out] += sum(level.size for level in _chain(new, left_out))
            # Further layers only add to the size, so tiles that are too large now are dropped.
            fits = (left_out for left_out, total in enumerate(sums) if total <= size)
            unused = next(fits, len(sums) - 1)
            if unused > dropped.get(shape, 0):
                for place, member in enumerate(encoded_layers):
                    if shapes[place] == shape:
                        encoded_layers[place] = _without_finest(member, unused)
            dropped[shape] = unused
            encoded_layers.append(_without_finest(new, unused))
    return Encoded(tuple(_fitted(encoded_layers, shapes, sizes, size)))


def finest_reduce(shape: tuple[int, int]) -> int:
    """Return how many cells share a side of the finest cells, as far as the shape shows."""
    reduce = 1
    while max(shape) > ALL_CELLS_SIDE and math.prod(-(-n // reduce) for n in shape) > MOST_CELLS:
        reduce *= 2
    return reduce


def _fitted(
    layers: Sequence[EncodedLayer], shapes: Sequence[tuple[int, int]],
    sizes: Mapping[tuple[int, int], Sequence[int]], size: int,
) -> Iterator[EncodedLayer]:  # fmt: skip
    # Yields each layer, given in all of its resolutions, in those that fit together. `sizes` are
    # those of all layers of a shape, if no resolution is left out, or one, or two.
    finest = dict.fromkeys(shapes, 0)  # how many resolutions are left out
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


def _without_finest(layer: EncodedLayer, count: int) -> EncodedLayer:
    """Return a layer that has only the sizes of its finest levels, not their tiles."""
    first = len(layer.levels) - count
    dropped = (replace(level, tiles=()) for level in layer.levels[first:])
    return replace(layer, levels=(*layer.levels[:first], *dropped))


def _tile(cells: Cells, codings: Sequence[Coding], order: Bytes | None, compression: int) -> bytes:
    values: Cells = cells if order is None else order[cells]  # `look_up` would start threads
    data = packed(values, codings) if codings else values.tobytes()
    return b64encode(zlib.compress(data, compression))


def _encoded_layer(layer: PageLayer, submit: Callable[..., Future[bytes]]) -> EncodedLayer:
    codings = () if layer.is_bytes else _codings_of(layer)
    headers = [{"kind": type(coding).__name__.lower(), **asdict(coding)} for coding in codings]
    header: dict[str, Any] = {"kind": "numbers", "ways": headers} if codings else {"kind": "bytes"}
    shape = layer.frame.shape
    choose = np.fmax if layer.pooled == "largest" else np.fmin
    order = places = None
    if layer.rank is not None:  # cells become places in it; of equal rank the larger is later
        order = np.argsort(layer.rank, kind="stable").astype(np.uint8)
        places = np.argsort(order).astype(np.uint8)
    reduces = [finest_reduce(shape)]
    while max(shape) > reduces[-1] * _COARSEST_SIDE:
        reduces.append(2 * reduces[-1])
    if len(reduces) > 1:  # every second one, too, has a level as small as that
        reduces.append(2 * reduces[-1])
    compression = _COMPRESSION if max(shape) <= ALL_CELLS_SIDE else _COMPRESSION_OF_LARGE
    submit_cells = partial(submit, codings=codings, order=order, compression=compression)
    maker: _LevelMaker | None = None
    makers = []
    for reduce in reversed(reduces):
        level_shape = -(-shape[0] // reduce), -(-shape[1] // reduce)
        maker = _LevelMaker(reduce, level_shape, choose, submit_cells, maker)
        makers.append(maker)
    for first in range(0, shape[0], TILE):  # a multiple of any `reduces[0]`
        rows = np.asarray(layer.values[first : first + TILE])
        rows = rows if places is None else look_up(rows, places)
        makers[-1].add(rows if reduces[0] == 1 else pooled(rows, reduces[0], choose))
    return EncodedLayer(header, tuple(maker.level() for maker in makers))


@dataclass(eq=False)
class _LevelMaker:
    reduce: int
    shape: tuple[int, int]
    choose: np.ufunc  # of several cells the one that represents them
    submit: Callable[[Cells], Future[bytes]]
    coarser: _LevelMaker | None
    _band: Cells = field(default_factory=lambda: np.empty((0, 0)))
    _filled: int = 0
    _rows_cut: int = 0
    _tiles: list[Future[bytes]] = field(default_factory=list)

    def add(self, rows: Cells) -> None:
        while len(rows):
            if not self._filled:
                height = min(TILE, self.shape[0] - self._rows_cut)
                self._band = np.empty((height, self.shape[1]), dtype=rows.dtype)
            part = rows[: len(self._band) - self._filled]
            self._band[self._filled : self._filled + len(part)] = part
            self._filled += len(part)
            rows = rows[len(part) :]
            if self._filled == len(self._band):
                self._cut()

    def _cut(self) -> None:
        band, self._filled = self._band, 0
        self._rows_cut += len(band)
        if self.coarser is not None:
            self.coarser.add(pooled(band, 2, self.choose))
        for first in range(0, band.shape[1], TILE):
            self._tiles.append(self.submit(np.ascontiguousarray(band[:, first : first + TILE])))

    def level(self) -> Level:
        tiles = tuple(tile.result() for tile in self._tiles)
        return Level(self.reduce, self.shape, tiles, sum(map(len, tiles)))
