"""States that Cartographer saves (``.pbstream``): their map and their trajectories.

Submaps are painted byte for byte as by the graphics library that Cartographer uses.

References
----------
Cartographer, ``io/proto_stream.cc`` and ``mapping/proto``; ``io/submap_painter.cc``: the order, the
frame and the colours of submaps. Protocol Buffers, "Encoding".
cairo 1.16 and pixman: the matrix in 16.16 fixed point, which is exact in the middle of the area;
bilinear weights of 7 bits; the 8-bit operator OVER.
"""

from __future__ import annotations

import itertools
import math
import struct
import zlib
from collections.abc import Container, Iterable, Iterator
from contextlib import ExitStack
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import MalformedInputError, ParameterError, emit_warning
from mapdeal.files import source as sources
from mapdeal.grid.frame import Frame
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.kernels.arrays import Bytes, Floats, Integers
from mapdeal.kernels.rotations import inverse_matrices, product
from mapdeal.maps import map_file, map_server
from mapdeal.maps.dialects import Dialect, MapMetadata, cells_of
from mapdeal.maps.picture import LARGEST_CELLS, Picture, check_size

_MAGIC = (0x7B1D1F7B5BF501DB).to_bytes(8, "little")
_RESOLUTION = 0.05  # Cartographer's default
_PER_BYTE = 48  # bytes in memory for each byte of a message: its numbers, and cells
_VARINT, _BYTES = 0, 2
_SIZES = {1: 8, 5: 4}  # of other types
_FORMATS = {8: "<d", 4: "<f"}
_LARGEST_SIDE = 1 << 15
_LARGEST_NUMBER = 1e12
_UPDATED = 1 << 15  # a bit of cells, which does not count
_MOST_SCALE = 1e3  # of sides of pixels and cells
_MOST_TILT = 0.01
_EPOCH, _TICKS = 621_355_968_000_000_000, 10_000_000  # 1970 in ticks since the year 1; a second


class Message:
    """The fields of a protobuf message by their numbers; unknown ones do no harm."""

    def __init__(self, data: bytes, place: str) -> None:
        self.size, self._place = len(data), place
        self._fields: dict[int, list[Any]] = {}
        at = 0
        value: Any
        while at < len(data):
            tag, at = self._varint(data, at)
            number, kind = tag >> 3, tag & 7
            if kind == _VARINT:
                value, at = self._varint(data, at)
            elif kind in (_BYTES, *_SIZES):
                size, at = (_SIZES[kind], at) if kind in _SIZES else self._varint(data, at)
                value, at = data[at : at + size], at + size
                if at > len(data):
                    raise self.error(f"field {number} is longer than its message")
            else:
                raise self.error(f"field {number} has a type that is not used", got=kind)
            self._fields.setdefault(number, []).append(value)

    def _varint(self, data: bytes, at: int) -> tuple[int, int]:
        value = 0
        for index, byte in enumerate(data[at : at + 10]):
            value |= (byte & 127) << 7 * index
            if byte < 128:
                return value & (1 << 64) - 1, at + index + 1
        raise self.error("a number does not end")

    def error(self, rule: str, **more: Any) -> MalformedInputError:
        return MalformedInputError(rule, place=self._place, **more)

    def __contains__(self, field: int) -> bool:
        return field in self._fields

    def _values(self, field: int, kind: Any, sizes: Container[int] | None = None) -> list[Any]:
        values = self._fields.get(field, [])
        for value in values:
            if not isinstance(value, kind) or (sizes and len(value) not in sizes):
                raise self.error(f"field {field} has another type than it should")
        return values

    def integer(self, field: int) -> int:
        value: int = [0, *self._values(field, int)][-1]
        return value - (1 << 64) if value >> 63 else value

    def number(self, field: int, default: float = 0.0) -> float:
        values = self._values(field, bytes, _FORMATS)
        value = struct.unpack(_FORMATS[len(values[-1])], values[-1])[0] if values else default
        if not abs(value) < _LARGEST_NUMBER:
            raise self.error(f"field {field} must be a number below {_LARGEST_NUMBER:g}", got=value)
        return float(value)

    def numbers(self, *fields: int) -> list[float]:
        return [self.number(field) for field in fields]

    def message(self, field: int) -> Message:
        return Message([b"", *self._values(field, bytes)][-1], self._place)

    def messages(self, field: int) -> Iterator[Message]:
        return (Message(data, self._place) for data in self._values(field, bytes))

    def integers(self, field: int) -> Integers:
        """Return a list of integers, packed or not; those above 2**49 are not exact."""
        values = self._fields.get(field, [])
        if all(isinstance(value, int) for value in values):
            return np.array([min(value, 1 << 49) for value in values], dtype=np.int64)
        data = np.frombuffer(b"".join(self._values(field, bytes)), dtype=np.uint8)
        ends = np.flatnonzero(data < 128)
        if not len(ends) or ends[-1] + 1 < len(data):
            raise self.error(f"the integers of field {field} are damaged")
        starts = np.append(0, ends[:-1] + 1)
        places = np.arange(len(data)) - np.repeat(starts, ends + 1 - starts)
        return np.add.reduceat((data & 127).astype(np.int64) << 7 * np.minimum(places, 7), starts)


def _planar(pose: Message) -> Floats:
    """Return a pose as a matrix of the plane, shape (3, 3)."""
    (x, y), (qx, qy, qz, qw) = pose.message(1).numbers(1, 2), pose.message(2).numbers(1, 2, 3, 4)
    a, b = 1 - 2 * (qy * qy + qz * qz), 2 * (qx * qy - qz * qw)
    c, d = 2 * (qx * qy + qz * qw), 1 - 2 * (qx * qx + qz * qz)
    if not abs(a * d - b * c - 1) < _MOST_TILT:
        raise pose.error("the rotation of a submap must be a unit quaternion about z")
    return np.array([(a, b, x), (c, d, y), (0, 0, 1)])


class Block(NamedTuple):  # of the compressed bytes of a message
    offset: int
    length: int

    def read(self, file: BinaryIO) -> Message:
        place = f"message at byte {self.offset}"
        sources.claim(file.name, self.length)
        file.seek(self.offset)
        data = file.read(self.length)
        most, stream = sources.most_expanded(len(data)), zlib.decompressobj(wbits=31)
        try:
            content = stream.decompress(data, most + 1)
        except zlib.error as error:
            raise MalformedInputError(f"is damaged: {error}", place=place) from None
        if len(content) > most:
            rule = f"{len(data)} bytes would expand to more than {most}"
            hint = "--max-memory SIZE allows more, if that much is available"
            raise MalformedInputError(rule, place=place, hint=hint)
        if not stream.eof:
            raise MalformedInputError("its compressed data end early", place=place)
        sources.claim(file.name, _PER_BYTE * len(content))
        return Message(content, place)


def _blocks(file: BinaryIO, size: int) -> Iterator[Block]:
    if file.read(len(_MAGIC)) != _MAGIC:
        raise MalformedInputError("is no state of Cartographer: it begins with other bytes")
    while start := file.read(8):
        block = Block(file.tell(), int.from_bytes(start, "little"))
        if len(start) < 8 or block.length > size - block.offset:
            place = f"message at byte {block.offset}"
            raise MalformedInputError("the file ends within it", place=place)
        yield block
        file.seek(sum(block))


class Submap(NamedTuple):  # without its cells
    block: Block
    is_finished: bool
    resolution: float
    size: tuple[int, int]
    known: tuple[slice, slice]  # rows and columns around its known cells, which become the texture
    in_frame: Floats  # the frame of the texture in that of the submap, shape (3, 3)

    @classmethod
    def of(cls, message: Message, block: Block, name: str) -> Submap:
        if 3 in message:
            raise message.error(f"submap {name} is 3-D; only 2-D submaps can be painted")
        submap = message.message(2)
        grid = submap.message(4)
        if 5 in grid:
            raise message.error(f"submap {name} is a TSDF; only probability grids can be painted")
        limits, box = grid.message(1), grid.message(3)
        width, height = map(limits.message(3).integer, (1, 2))
        last_col, last_row, col, row = map(box.integer, (1, 2, 3, 4))
        is_within = 0 <= col <= last_col < width and 0 <= row <= last_row < height
        if not is_within or max(width, height) > _LARGEST_SIDE:
            rule = f"the known cells of submap {name} must lie within its {height} x {width} cells"
            rule += f", at most {_LARGEST_SIDE} a side"
            raise message.error(rule, got=(row, col, last_row, last_col))
        resolution = limits.number(1)
        if not resolution > 0:
            raise message.error(f"the resolution of submap {name} must be above 0", got=resolution)
        corner = np.eye(3)
        corner[:2, 2] = limits.message(2).numbers(1, 2)
        corner[:2, 2] -= resolution * row, resolution * col
        known = slice(row, last_row + 1), slice(col, last_col + 1)
        in_frame = product(inverse_matrices(_planar(submap.message(1))), corner)
        return cls(block, submap.integer(3) != 0, resolution, (height, width), known, in_frame)

    def texture(self, file: BinaryIO) -> NDArray[np.uint32]:
        message = self.block.read(file)
        grid = next(message.messages(3)).message(2).message(4)
        cells, (height, width) = grid.integers(2), self.size
        if len(cells) != height * width:
            rule = f"a grid of {height} x {width} cells must have {height * width}"
            raise message.error(rule, got=len(cells))
        if cells.max() >= 2 * _UPDATED:
            raise message.error(f"cells must be 0..{2 * _UPDATED - 1}", got=int(cells.max()))
        texels = _texels(grid.number(6, 0.1), grid.number(7, 0.9))
        return np.asarray(texels[cells.reshape(self.size)[self.known] % _UPDATED])


@lru_cache(maxsize=4)
def _texels(least_cost: float, most_cost: float) -> NDArray[np.uint32]:
    """Return the texel of each value of a cell, of which 0 is unknown."""
    unit, low, high = map(np.float32, (1, least_cost, most_cost))
    scale = (high - low) / np.float32(_UPDATED - 2)
    costs = np.arange(_UPDATED, dtype=np.float32) * scale + (low - scale)
    ends = np.array([0.1, 0.9], dtype=np.float32)
    odds, (lowest, highest) = (np.log(p / (unit - p)) for p in (np.clip(unit - costs, *ends), ends))
    steps = np.rint((odds - lowest) * np.float32(254) / (highest - lowest)) + 1
    change = UNKNOWN_GREY - steps.astype(np.int64)
    opacity = np.where(change == 0, 1, np.maximum(-change, 0))
    texels: NDArray[np.uint32] = (np.maximum(change, 0) | opacity << 16).astype(np.uint32)
    texels[0] = 0
    return texels


class Trajectory(NamedTuple):
    ticks: Integers  # times in steps of 100 ns since the year 1
    poses: Floats  # x, y, z, metres, and the quaternion x, y, z, w, shape (N, 7)

    @classmethod
    def of(cls, message: Message) -> Trajectory:
        nodes = list(message.messages(1))
        poses = [node.message(5) for node in nodes]
        rows = [p.message(1).numbers(1, 2, 3) + p.message(2).numbers(1, 2, 3, 4) for p in poses]
        ticks = np.array([node.integer(1) for node in nodes], dtype=np.int64)
        return cls(ticks, np.array(rows).reshape(-1, 7))

    def described(self) -> dict[str, Any]:
        steps = np.linalg.norm(np.diff(self.poses[:, :2], axis=0), axis=1)
        seconds = (int(self.ticks.max()) - int(self.ticks.min())) / _TICKS
        return {"poses": len(self.ticks), "length_m": float(steps.sum()), "duration_s": seconds}

    def tum_lines(self) -> Iterator[str]:
        for ticks, pose in zip(self.ticks.tolist(), self.poses.tolist(), strict=True):
            seconds, fraction = divmod(ticks - _EPOCH, _TICKS)
            yield f"{seconds}.{fraction:07d} {' '.join(map(repr, pose))}\n"


class StateFile(map_file.MapFile):
    """An open state, whose map is that of Cartographer's own program."""

    def __init__(self, path: Path, _: ExitStack, dialect: Dialect, max_cells: int | None) -> None:
        super().__init__(path)
        self._dialect: Dialect = dialect
        self._max_cells = LARGEST_CELLS if max_cells is None else max_cells
        self._resolution, origin = map_server.bare_geometry.get() or (_RESOLUTION, (0.0, 0.0, 0.0))
        if any(origin):
            raise ParameterError("applies to images; a state has its own", place="origin")
        self._submaps: dict[tuple[int, int], Submap] = {}
        self._poses: dict[tuple[int, int], Floats] = {}
        self._graph = Block(0, 0)
        self._version = self._largest = self._nodes = self._nodes_of_graph = 0
        with sources.binary_file(path) as file:
            for block in _blocks(file, sources.check_readable(path).st_size):
                self._add(block.read(file), block)
            self._slices = self._placed()
            self._canvas = canvas_of(self._slices)

    def _add(self, message: Message, block: Block) -> None:
        self._largest = max(self._largest, message.size)
        self._nodes += 4 in message
        if not self._version:
            self._version = message.integer(1)
            if self._version not in (1, 2):
                raise message.error("the format must have version 1 or 2", got=self._version)
            return
        for graph in message.messages(1):
            self._graph = block
            for trajectory in graph.messages(4):
                self._nodes_of_graph += sum(1 for _ in trajectory.messages(1))
                for entry in trajectory.messages(2):
                    key = trajectory.integer(3), entry.integer(2)
                    self._poses[key] = _planar(entry.message(1))
        for submap in message.messages(3):
            identity = submap.message(1)
            key = identity.integer(1), identity.integer(2)
            if key in self._submaps:
                raise message.error(f"submap {key} occurs twice")
            self._submaps[key] = Submap.of(submap, block, str(key))

    def _placed(self) -> list[tuple[Submap, Slice]]:
        if not self._submaps:
            raise MalformedInputError("has no submaps")
        for key in self._submaps.keys() ^ self._poses.keys():
            rule = "has no pose" if key in self._submaps else "is missing: the file is cut"
            raise MalformedInputError(f"submap {key} {rule}", place="pose graph")
        placed = []
        for key, submap in sorted(self._submaps.items()):
            scale = submap.resolution / self._resolution
            if not 1 / _MOST_SCALE < scale < _MOST_SCALE:
                rule = f"submap {key} has cells of {submap.resolution:g} m"
                raise MalformedInputError(f"{rule}, too different from {self._resolution:g} m")
            (a, b, x), (c, d, y) = product(self._poses[key], submap.in_frame)[:2].tolist()
            turn, shift = np.array([(c, -d), (a, -b)]) * scale, np.array([x, -y]) / self._resolution
            height, width = (side.stop - side.start for side in submap.known)
            placed.append((submap, Slice(width, height, turn, shift)))
        return placed

    def frame(self) -> Frame:
        width, height, (x, y) = self._canvas
        check_size(self.path, width, height, self._max_cells)
        # Cartographer writes six digits
        corner = [float(f"{cells * self._resolution:.6g}") for cells in (-x, y - height)]
        return Frame(height, width, self._resolution, (corner[0], corner[1], 0.0))

    def memory_to_read(self) -> int:
        height, width = self.shape()
        return 3 * height * width + _PER_BYTE * self._largest + sources.PIECES

    def painting(self) -> map_file.Painting:
        return self._pixels, f"Cartographer map; {self._resolution:g} m/pixel"

    @cached_property
    def _pixels(self) -> Bytes:
        height, width = self.shape()
        sources.claim(self.path, self.memory_to_read(), what=f"{width} x {height} cells")
        pixels = np.full((height, width), UNKNOWN_GREY, dtype=np.uint8)
        with sources.binary_file(self.path) as file:
            *_, origin = self._canvas
            for submap, place in self._slices:
                paint(pixels, submap.texture(file), place._replace(shift=place.shift + origin))
        sources.note_sum(self.path, lambda: sources.sha256_of(self.path))
        return pixels[::-1]

    def cells(self) -> OccupancyGrid:
        frame = self.frame()
        metadata = MapMetadata("", frame.resolution, frame.origin)
        cells = cells_of(Picture("PNM", "grey", self._pixels[::-1]), metadata, self._dialect)
        return OccupancyGrid(cells, frame.resolution, frame.origin)

    def trajectories(self) -> dict[int, Trajectory]:
        with sources.binary_file(self.path) as file:  # which names the file in errors
            graphs = list(self._graph.read(file).messages(1))
            found = [trajectory for graph in graphs for trajectory in graph.messages(4)]
            return {path.integer(3): Trajectory.of(path) for path in found if 1 in path}

    def remark(self, grid: map_file.Grid) -> None:
        super().remark(grid)
        if self._nodes < self._nodes_of_graph:  # Cartographer writes all of them after the submaps
            text = f"{self.path}: holds {self._nodes} of the {self._nodes_of_graph} nodes of its "
            emit_warning(f"{text}pose graph: the file is cut behind its submaps, or was stripped")

    def described(self) -> dict[str, Any]:
        trajectories = self.trajectories().items()
        return {
            "format_version": self._version,
            "submaps": len(self._submaps),
            "unfinished": sum(not submap.is_finished for submap in self._submaps.values()),
            "trajectories": [{"id": key, **path.described()} for key, path in trajectories],
        }


PBSTREAM = map_file.MapFormat(
    "a .pbstream of Cartographer", (".pbstream",), StateFile, magic=(_MAGIC,),
    takes_resolution=True, yields_to_yaml=True,
)  # fmt: skip

UNKNOWN_GREY = 128
_PADDING = 5  # pixels around all submaps
_UNIT, _HALF = 1 << 16, 1 << 15  # in fixed point
_WEIGHTS = 128
_PIXELS_AT_ONCE = 1 << 16
_WIDEST_IN_32_BITS = 1 << 13
_FARTHEST = 2**30
_ALIGNED = 1 / 256  # cairo treats smaller elements of a matrix as 0


class Slice(NamedTuple):
    """Where a texture lies on the canvas: x, y = scale (col, row) + shift, in pixels."""

    width: int
    height: int
    scale: Floats
    shift: Floats


def canvas_of(slices: Iterable[tuple[Any, Slice]]) -> tuple[int, int, tuple[float, float]]:
    """Return width, height and the map's origin from the upper left corner, pixels."""
    # The bounds are float32, as Cartographer has them.
    corners = [
        product(np.array([(0, 0), (w, 0), (0, h), (w, h)]), scale.T) + shift
        for _, (w, h, scale, shift) in slices
    ]
    points = np.concatenate(corners)
    if not (np.abs(points) < _FARTHEST).all():
        raise MalformedInputError("a submap lies too far away", place="pose graph")
    points = points.astype(np.float32)
    low = points.min(axis=0)
    width, height = np.ceil(points.max(axis=0) - low).astype(int) + 2 * _PADDING
    x, y = (np.float32(_PADDING) - low).tolist()
    return int(width), int(height), (x, y)


def paint(pixels: NDArray[np.uint8], texture: NDArray[np.uint32], place: Slice) -> None:
    """Paint a texture over grey pixels, row 0 at the top."""
    # The lower half of each texel is its intensity, the upper half its opacity.
    inverse = _inverse(place.scale)
    shift = -(inverse * place.shift).sum(axis=1)
    west, north, east, south = _covered(place, inverse, pixels.shape)
    if west >= east or north >= south:
        return
    matrix, offset = _fixed(inverse, shift, ((west + east) / 2, (north + south) / 2))
    is_exact = _is_aligned(inverse) and not (np.rint(shift * 256) % 256).any()
    filters = None if _is_bilinear(inverse, shift) else [_box_filter(row) for row in inverse]
    wide = np.pad(texture, 2)
    step = max(1, _PIXELS_AT_ONCE // (east - west))
    dtype = np.int32 if max(texture.shape) < _WIDEST_IN_32_BITS else np.int64
    for first in range(north, south, step):
        rows = np.arange(first, min(first + step, south))
        starts = ((west + offset[0]) * _UNIT + _HALF, (rows + offset[1]) * _UNIT + _HALF)
        firsts = [value - (1 if is_exact else _HALF) for value in _applied(matrix, *starts)]
        steps = matrix[:, :1] * np.arange(east - west)
        x, y = (np.stack(firsts)[:, :, np.newaxis] + steps[:, np.newaxis]).astype(dtype)
        if is_exact:
            x, y = x >> 16 << 16, y >> 16 << 16
        if filters is None:
            texels = _interpolated(wide, x, y)
        else:
            texels = _averaged(texture, x + _HALF, y + _HALF, *filters)
        area = pixels[first : rows[-1] + 1, west:east]
        shown = area * (255 - (texels >> 16)) + 128
        area[...] = np.minimum(((shown + (shown >> 8)) >> 8) + (texels & 0xFFFF), 255)


def _covered(place: Slice, inverse: Floats, shape: tuple[int, ...]) -> list[int]:
    """Return the columns and rows of the area that cairo paints: west, north, east, south."""
    pads = [0.5 if math.hypot(*inverse[:, axis]) < 1 else 0.0 for axis in (0, 1)]
    xs, ys = ((-pad, size + pad) for pad, size in zip(pads, place[:2], strict=True))
    corners = np.array([(x, y) for x in xs for y in ys])
    corners = product(corners, place.scale.T) + place.shift
    beyond = 0.5 - np.array(pads)
    low, high = corners.min(axis=0) - beyond, corners.max(axis=0) + beyond
    ends = np.floor(np.concatenate([low, high]) + 0.5)
    return np.clip(ends, 0, [shape[1], shape[0]] * 2).astype(int).tolist()  # type: ignore[no-any-return]


def _fixed(
    inverse: Floats, shift: Floats, middle: tuple[float, float]
) -> tuple[NDArray[np.int64], list[int]]:
    """Return the matrix from pixels to texels in fixed point, and an offset of pixels before it."""
    # The offset keeps the shift small; corrections make the matrix exact at `middle`.
    (xx, xy), (yx, yy) = inverse.tolist()
    x0, y0 = shift.tolist()
    offsets = [(x0, y0)] + [
        ((y0 * xy - x0 * (yy + j)) / det, (x0 * yx - y0 * (xx + i)) / det)
        for i, j in itertools.product((-1, 1), repeat=2)
        if abs(det := (xx + i) * (yy + j) - xy * yx) >= np.finfo(float).eps
    ]
    offset = np.floor(min(offsets, key=lambda xy: max(map(abs, xy))))
    shift = shift + (inverse * offset).sum(axis=1)
    matrix = np.rint(np.column_stack([inverse, shift]) * _UNIT).astype(np.int64)
    for _ in range(0 if _is_aligned(inverse) else 5):
        texel = np.array(_applied(matrix, *(np.rint(np.array(middle) * _UNIT).astype(np.int64))))
        error = (_inverse(inverse) * (texel / _UNIT - shift)).sum(axis=1) - middle
        correction = np.rint((inverse * error).sum(axis=1) * _UNIT).astype(np.int64)
        if not correction.any():
            break
        matrix[:, 2] -= correction
    return matrix, (-offset).astype(int).tolist()


def _determinant(matrix: Floats) -> float:
    (a, b), (c, d) = matrix.tolist()
    return float(a * d - b * c)


def _inverse(matrix: Floats) -> Floats:
    (a, b), (c, d) = matrix.tolist()
    return np.array([[d, -b], [-c, a]]) / _determinant(matrix)


def _is_aligned(inverse: Floats) -> bool:
    """Return whether cairo treats a matrix as a rotation by quarter turns without scaling."""
    is_small = np.abs(inverse) < _ALIGNED
    is_turned = is_small.trace() == 2 or is_small[::-1].trace() == 2
    return bool(is_turned and abs(_determinant(inverse) ** 2 - 1) < _ALIGNED)


def _applied(matrix: NDArray[np.int64], x: Any, y: Any) -> list[Any]:
    return [(row[0] * x + row[1] * y + row[2] * _UNIT + _HALF) >> 16 for row in matrix]


def _is_bilinear(inverse: Floats, shift: Floats) -> bool:
    """Return whether cairo interpolates: for pixels below 4/3 of a texel, and exact halves."""
    squares = (inverse * inverse).sum(axis=1)
    is_half = (abs(squares - 4) < 0.01) & (np.rint(256 * inverse.prod(axis=1)) == 0)
    is_half &= np.rint(256 * shift) % 256 == 0
    return bool(((squares < 16 / 9) | is_half).all())


_BoxFilter = tuple[int, NDArray[np.int64]]
"""Weights of texels, in fixed point, for places between them: bits, and shape (2**bits, width)."""


def _box_filter(row: Floats) -> _BoxFilter:
    """Return the filter by which cairo averages along an axis of a smaller picture."""
    size = min(math.hypot(*row), 16.0)
    size = size if size >= 1 / 0.75 else 1.0
    width, bits = math.ceil(size + 1), math.floor(math.log2(128 / size)) + 1
    place = (np.arange(1 << bits) + 0.5) / (1 << bits)
    first = np.ceil(place - width / 2 - 0.5) - place + 0.5
    overlap = np.clip((size + 1) / 2 - np.abs(first[:, np.newaxis] + np.arange(width)), 0, 1)
    share = 1 / overlap.sum(axis=1, keepdims=True)
    weights = (np.floor(overlap * _UNIT) * share).astype(np.int64)
    weights[:, width // 2] += _UNIT - weights.sum(axis=1)
    return bits, weights


def _averaged(
    texture: NDArray[np.uint32], x: NDArray[Any], y: NDArray[Any], *filters: _BoxFilter
) -> NDArray[np.uint32]:
    """Return the means of texels around places in fixed point; those outside are 0."""
    starts, weights = [], []
    border = max(table.shape[1] for _, table in filters) + 1
    for values, size, (bits, table) in zip((x, y), texture.shape[::-1], filters, strict=True):
        middle = (values >> 16 - bits << 16 - bits) + (1 << 16 - bits) // 2
        weights.append(table[(middle & _UNIT - 1) >> 16 - bits])
        start = (middle - 1 - (table.shape[1] - 1) * _HALF) >> 16
        starts.append(np.clip(start + border, 0, size + border))
    wide = np.pad(texture, ((border, 2 * border), (border, 2 * border))).astype(np.int64)
    total = np.zeros((2, *x.shape), dtype=np.int64)
    for row in range(weights[1].shape[-1]):
        for col in range(weights[0].shape[-1]):
            weight = (weights[1][..., row] * weights[0][..., col] + _HALF) >> 16
            texels = wide[starts[1] + row, starts[0] + col]
            total += np.array([texels & 0xFFFF, texels >> 16]) * weight
    intensity, opacity = np.clip((total + _HALF) >> 16, 0, 255).astype(np.uint32)
    return np.asarray(intensity | opacity << 16)


def _interpolated(wide: NDArray[np.uint32], x: NDArray[Any], y: NDArray[Any]) -> NDArray[np.uint32]:
    """Return texels at places in fixed point; those in a border of 2 and beyond it are 0."""
    height, width = wide.shape
    at = np.clip((y >> 16) + 2, 0, height - 2) * width + np.clip((x >> 16) + 2, 0, width - 2)
    right, below = (((place >> 9) & (_WEIGHTS - 1)).astype(np.uint32) for place in (x, y))
    texels = wide.reshape(-1)
    # both halves of a texel stay below 16 bits
    upper = texels[at] * (_WEIGHTS - right) + texels[at + 1] * right
    at += width
    lower = texels[at] * (_WEIGHTS - right) + texels[at + 1] * right
    above = _WEIGHTS - below
    intensity = ((upper & 0xFFFF) * above + (lower & 0xFFFF) * below) >> 14
    opacity = ((upper >> 16) * above + (lower >> 16) * below) >> 14
    return np.asarray(intensity | opacity << 16)
