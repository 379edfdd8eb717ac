"""mapdeal's own files: layers and their geometry in an ``.npz``, format ``mapdeal/1``.

Files are not trusted: the type, shape and size of every array are checked before memory is
allocated for it, and nothing is ever unpickled.
"""

from __future__ import annotations

import io
import itertools
import math
import os
import warnings
import zipfile
import zlib
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from threading import Lock
from typing import IO, Any, BinaryIO, NamedTuple, cast, get_args

import numpy as np
from numpy.lib import format as npy_format

from mapdeal.errors import FileAccessError, MalformedInputError, ParameterError, emit_warning
from mapdeal.files.source import PIECES, check_expansion, check_readable, claim
from mapdeal.files.transaction import Transaction
from mapdeal.grid import costmap, field, footprint, reach, values as codes
from mapdeal.grid.frame import Frame, Origin, check_origin, check_resolution
from mapdeal.grid.occupancy import CloudLayers, OccupancyGrid
from mapdeal.kernels.arrays import Array, Floats
from mapdeal.kernels.blocks import CacheBudget, Layer, LazyLayer, is_lazy
from mapdeal.maps import images, picture, png
from mapdeal.maps.dialects import Dialect
from mapdeal.maps.map_file import Grid as Grid, MapFile, MapFormat

_LONGEST_HEADER = 1 << 16
_READERS = {
    (1, 0): npy_format.read_array_header_1_0,
    (2, 0): npy_format.read_array_header_2_0,
    # version 3 differs from 2 only in the encoding of field names
    (3, 0): npy_format.read_array_header_2_0,
}


class NpyHeader(NamedTuple):
    shape: tuple[int, ...]
    is_fortran: bool
    dtype: np.dtype[Any]
    start: int

    @property
    def elements(self) -> int:
        return math.prod(map(int, self.shape))

    @property
    def nbytes(self) -> int:
        return self.elements * self.dtype.itemsize


def read_npy_header(file: IO[bytes]) -> NpyHeader:
    """Read the header of an array from the start of a file; ValueError if it is damaged."""
    from tokenize import TokenError  # few commands need it, and it is slow to import

    try:
        head = io.BytesIO(file.read(_LONGEST_HEADER))  # numpy would read any length
        version = npy_format.read_magic(head)
        if version not in _READERS:
            raise ValueError(f"version {version} is not supported")
        with images.PROCESS_WIDE_LOCK, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # numpy warns of headers that Python 2 wrote
            header = _READERS[version](head)
    # numpy and Python's parser raise all these on damaged headers, some with several lines.
    except (ValueError, EOFError, SyntaxError, TokenError, LookupError, TypeError,
            OverflowError, RecursionError, MemoryError) as error:  # fmt: skip
        raise ValueError(str(error).partition("\n")[0]) from None
    file.seek(head.tell())
    return NpyHeader(*header, head.tell())


def write_npy(file: BinaryIO, array: Layer) -> None:
    file.write(npy_header(array.shape, array.dtype))
    file.writelines(png.pieces(array))


def npy_header(shape: tuple[int, ...], dtype: np.dtype[Any]) -> bytes:
    header = io.BytesIO()
    facts = {"descr": npy_format.dtype_to_descr(dtype), "fortran_order": False, "shape": shape}
    npy_format.write_array_header_1_0(header, facts)
    return header.getvalue()


_LARGEST_SMALL_ARRAY = 4096
_LARGEST_DIRECTORY = 1 << 20
_END_OF_ZIP = (1 << 16) + 256
_SIZE_IS_IN_ZIP64 = 0xFFFFFFFF
_LARGEST_SMALL_NUMBER = 1 << 31
_MOST_COLUMNS = 1 << 16
_CHUNK = 1 << 22


class NpzReader(ExitStack):
    """The entries of an npz file, each checked before memory is allocated for it."""

    # With `block_height`, layers are lazy unless they are stored column by column. Only requested
    # rows take memory, so data that expand a thousand times do no harm; reading backwards starts
    # again at the first row. Damage is found when its rows are read, a wrong checksum at the last
    # row.
    def __init__(
        self, path: Path, max_cells: int | None = None, block_height: int | None = None
    ) -> None:
        super().__init__()
        self.path, self._block_height, self._claimed = path, block_height, 0
        self._max_cells = picture.LARGEST_CELLS if max_cells is None else max_cells
        check_readable(path)
        try:
            if _directory_size(path) > _LARGEST_DIRECTORY:
                raise MalformedInputError("holds too many arrays", source=path)
            self._zip = self.enter_context(zipfile.ZipFile(path))
        except (zipfile.BadZipFile, NotImplementedError, ValueError):
            raise MalformedInputError("is not an npz file", source=path) from None
        except OSError as error:
            raise FileAccessError(f"cannot be read: {error.strerror}", source=path) from None

    def names(self) -> set[str]:
        return {name.removesuffix(".npy") for name in self._zip.namelist()}

    def header(self, name: str) -> NpyHeader:
        with self._open_entry(name) as (_, header):
            return header

    def layer(self, name: str, dtype: type[np.generic]) -> Layer:
        header = self._checked(name, self._max_cells, np.dtype(dtype))
        if len(header.shape) != 2:
            raise self.error(name, f"must have two axes, has {len(header.shape)}")
        if self._block_height is None or header.is_fortran:
            return self._values(name, header.nbytes * (1 + header.is_fortran))
        file, header = self.enter_context(self._open_entry(name))
        height, width = header.shape
        row_size = width * header.dtype.itemsize
        lock = Lock()

        def read(rows: slice) -> Array:
            size = (rows.stop - rows.start) * row_size
            claim(self.path, size + min(PIECES, size))
            values = np.empty((rows.stop - rows.start, width), dtype=dtype)
            with lock, self._damage_refused(name):
                file.seek(header.start + rows.start * row_size)
                _fill(values, file)
            if dtype is np.int8 and values.size:  # the checks of the grid types
                lowest, highest = int(values.min()), int(values.max())
                if lowest < codes.UNKNOWN or highest > codes.OCCUPIED:
                    rule = f"{name} must lie in -1..100"
                    raise ParameterError(rule, got=(lowest, highest)).in_file(self.path)
            return values

        layer = LazyLayer((height, width), dtype, read, block_height=self._block_height)
        return cast("Layer", layer)

    def small(self, name: str, dtype: type[np.generic], shape: tuple[int, ...]) -> Array:
        header = self._checked(name, _LARGEST_SMALL_ARRAY, np.dtype(dtype), shape)
        return self._values(name, header.nbytes)

    def number(self, name: str) -> float:
        return float(self._single(name, "iuf", "a number"))

    def whole_number(self, name: str) -> int:
        value = self.number(name)
        if value % 1 or abs(value) > _LARGEST_SMALL_NUMBER:  # nan % 1 and inf % 1 are nan
            raise self.error(name, f"must be a whole number, is {value:g}")
        return int(value)

    def text(self, name: str, choices: tuple[str, ...] | None) -> str:
        value = self._single(name, "U", "text")
        little = value.astype(value.dtype.newbyteorder("<"))
        try:  # numpy would make broken strings of invalid code points
            text = little.tobytes().decode("utf-32-le").rstrip("\0")
        except UnicodeDecodeError:
            raise self.error(name, "must be text, is not Unicode") from None
        if choices is not None and text not in choices:
            raise self.error(name, f"must be one of {', '.join(choices)}")
        return text

    def numbers(self, name: str, axes: int) -> Floats:
        header = self._checked(name, self._max_cells)
        if header.dtype.kind not in "iuf" or len(header.shape) != axes:
            found = f"{header.dtype} of shape {header.shape}"
            raise self.error(name, f"must be numbers with {axes} axes, is {found}")
        return self._values(name, header.nbytes + 16 * header.elements).astype(np.float64)

    def rows(
        self, name: str, columns: int, *, shape: tuple[int, int] | None = None
    ) -> Iterator[Floats]:
        """Yield the first `columns` numbers of each row of a table, many rows at a time."""
        # Shorter rows are yielded as they are, but a row needs two numbers. The table must have
        # `shape` if there is one. A table that is stored column by column is loaded at once.
        with self._open_entry(name) as (file, header):
            if shape is not None and header.shape != shape:
                raise self.error(name, f"must have shape {shape}, has {header.shape}")
            least_width = 2 if shape is None else 0
            is_table = header.dtype.kind in "iuf" and len(header.shape) == 2
            if not is_table or header.shape[1] < least_width:
                found = f"{header.dtype} of shape {header.shape}"
                raise self.error(name, f"must be numbers of shape (N, 2) or wider, is {found}")
            height, width = header.shape
            if width > _MOST_COLUMNS:
                raise self.error(name, f"{width} columns, above the limit of {_MOST_COLUMNS}")
            # as many rows as take little memory even as float64
            rows_at_once = max(1, _CHUNK // (max(1, width) * max(8, header.dtype.itemsize)))
            table = self._values(name, header.nbytes) if header.is_fortran else None
            for first in range(0, height, rows_at_once):
                if table is None:
                    part = np.empty((min(rows_at_once, height - first), width), header.dtype)
                    _fill(part, file)
                else:
                    part = table[first : first + rows_at_once]
                yield part[:, :columns].astype(np.float64)

    def _single(self, name: str, kinds: str, description: str) -> Array:
        header = self._checked(name, _LARGEST_SMALL_ARRAY, shape=())
        if header.dtype.kind not in kinds or header.nbytes > _LARGEST_SMALL_ARRAY:
            raise self.error(name, f"must be {description}, is {header.dtype}")
        return self._values(name, header.nbytes)

    def _checked(
        self, name: str, most: int, dtype: Any = None, shape: tuple[int, ...] | None = None
    ) -> NpyHeader:
        header = self.header(name)
        if dtype is not None and header.dtype != dtype:
            raise self.error(name, f"must be {dtype}, is {header.dtype}")
        if shape is not None and header.shape != shape:
            raise self.error(name, f"must have shape {shape}, has {header.shape}")
        if header.elements > most:
            raise self.error(name, f"{header.elements} elements, above the limit of {most}")
        return header

    def error(self, name: str, rule: str, **details: Any) -> MalformedInputError:
        return MalformedInputError(rule, source=self.path, place=name, **details)

    def _values(self, name: str, count: int) -> Array:
        with self._open_entry(name) as (file, header):
            stored = self._zip.getinfo(f"{name}.npy").compress_size
            check_expansion(self.path, stored, header.nbytes, place=name)
            self._claimed += count
            claim(self.path, self._claimed + min(PIECES, self._claimed))
            array = np.empty(header.elements, dtype=header.dtype)
            _fill(array, file)
            return array.reshape(header.shape, order="F" if header.is_fortran else "C")

    @contextmanager
    def _open_entry(self, name: str) -> Iterator[tuple[IO[bytes], NpyHeader]]:
        """Yield the file of an entry, positioned behind its header, and that; report damage."""
        try:
            info = self._zip.getinfo(f"{name}.npy")
        except KeyError:
            raise self.error(name, "missing key") from None
        if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise self.error(name, "compressed by a method that npz files do not use")
        with self._damage_refused(name), self._zip.open(info) as file:
            header = read_npy_header(file)
            if header.dtype.hasobject:
                raise self.error(name, "holds Python objects, which are never loaded")
            # A header may claim more bytes than the archive has.
            if header.start + header.nbytes != info.file_size:
                raise self.error(name, "the array's size does not fit its data")
            yield file, header

    @contextmanager
    def _damage_refused(self, name: str) -> Iterator[None]:
        try:
            yield
        except (zipfile.BadZipFile, zlib.error, EOFError, ValueError, NotImplementedError,
                RuntimeError, OSError) as error:  # fmt: skip
            raise self.error(name, f"damaged: {error}") from None


def _directory_size(path: Path) -> int:
    """Return the size of a zip file's list of entries in bytes; in memory it is ten times that."""
    with path.open("rb") as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(size - _END_OF_ZIP, 0))
        tail = file.read()
    end = tail.rfind(b"PK\5\6")
    if end < 0:
        return 0
    own = int.from_bytes(tail[end + 12 : end + 16], "little")
    large = tail.rfind(b"PK\6\6", 0, end)  # the record of zip64, with 64-bit sizes
    wide = int.from_bytes(tail[large + 40 : large + 48], "little") if large >= 0 else 0
    return max(wide, own if own < _SIZE_IS_IN_ZIP64 else 0)


def _fill(array: Array, file: IO[bytes]) -> None:
    """Fill a contiguous array from a file, which verifies its checksum at the end."""
    view = memoryview(array.reshape(-1).view(np.uint8).data) if array.size else memoryview(b"")
    for start in range(0, len(view), _CHUNK):
        part = view[start : start + _CHUNK]
        if file.readinto(part) < len(part):  # type: ignore[attr-defined]
            raise EOFError("the data end early")


FORMAT = "mapdeal/1"
_REACH_LAYER = "reachable"
_EVIDENCE: dict[str, type[Any]] = {"log_odds": np.float64, "hits": np.int32, "misses": np.int32}


def write_npz(file: BinaryIO, grid: Grid, *, more: Mapping[str, Array] | None = None) -> None:
    """Write a grid with all its layers and its geometry, and `more` layers that readers ignore."""
    resolution, origin = np.float64(grid.resolution), np.asarray(grid.origin, dtype=np.float64)
    common = {"format": FORMAT, "resolution": resolution, "origin": origin}
    write_arrays(file, {**common, **grid.entries(), **(more or {})})


def write_arrays(file: BinaryIO, entries: Mapping[str, Any]) -> None:
    # Entries have a fixed date, so equal arrays give equal bytes.
    with zipfile.ZipFile(file, "w") as archive:
        for name, value in entries.items():
            array = value if is_lazy(value) else np.asarray(value, order="C")
            _write_entry(file, archive, f"{name}.npy", array)


def _write_entry(file: BinaryIO, archive: zipfile.ZipFile, name: str, array: Layer) -> None:
    # zipfile compresses in one thread. So the data are compressed before it stores them, and the
    # entry's header is corrected afterwards. Layers of float64 stay uncompressed: their last digits
    # are noise, so compression would save a tenth and take ten times as long.
    header = npy_header(array.shape, array.dtype)
    info = zipfile.ZipInfo(name, date_time=(1980, 1, 1, 0, 0, 0))
    checksum = 0

    def parts() -> Iterator[png.Buffer]:
        nonlocal checksum
        for part in itertools.chain([header], png.pieces(array)):
            checksum = zlib.crc32(part, checksum)
            yield part

    is_noise = array.dtype == np.float64 and array.ndim > 1
    with archive.open(info, "w", force_zip64=True) as entry:
        for block in parts() if is_noise else png.deflated(parts()):
            entry.write(block)
    if is_noise:
        return
    info.compress_type = zipfile.ZIP_DEFLATED
    info.file_size = len(header) + array.nbytes
    info.CRC = checksum
    file.seek(info.header_offset)
    file.write(info.FileHeader(zip64=True))


def read_npz(path: Path, *, max_cells: int | None = None) -> Grid:
    with NpzReader(path, max_cells) as reader:
        return _grid_in(reader)


@contextmanager
def open_npz(
    path: Path, *, block_height: int = 512, max_cells: int | None = None
) -> Iterator[Grid]:
    """Open an ``.npz`` file: yield the grid of `read_npz` with lazy layers."""
    # Reading backwards starts again at the first row. A potential field is loaded at once.
    with NpzReader(path, max_cells, block_height) as reader:
        if _main_layer(reader.names()) != "repulsive":
            yield _grid_in(reader)
            return
    yield read_npz(path, max_cells=max_cells)


def _grid_in(reader: NpzReader) -> Grid:
    with _geometry_in(reader) as (resolution, origin):
        return _NPZ_READERS[_main_layer(reader.names())](reader, resolution, origin)


def read_reach(path: Path, *, max_cells: int | None = None) -> reach.Reach:
    """Return the `Reach` in an ``.npz`` file, which has neither goals nor passages."""
    with NpzReader(path, max_cells) as reader, _geometry_in(reader) as (resolution, origin):
        size = 3 if reader.header("start").shape == (3,) else 2
        start = reader.small("start", np.float64, (size,))
        if not np.isfinite(start).all():
            raise reader.error("start", "must be finite numbers")
        robot = None
        if "robot" in reader.names():
            corners = reader.small("robot", np.float64, (*reader.header("robot").shape[:1], 2))
            if len(corners):
                robot = footprint.Footprint.polygon(corners.tolist())
            else:
                robot = footprint.Footprint.circle(reader.number("robot_radius"))
        return reach.Reach(
            reader.layer("reachable", np.uint8), reader.layer("headings", np.uint8),
            reader.layer("clearance", np.float32), reader.layer("widest", np.float32),
            reader.layer("occupancy", np.int8), resolution, origin,
            start=tuple(start.tolist()), robot=robot,
            heading_count=reader.whole_number("heading_count"),
            through_unknown=bool(reader.whole_number("through_unknown")),
        )  # fmt: skip


@contextmanager
def _geometry_in(reader: NpzReader) -> Iterator[tuple[float, Origin]]:
    """Yield the resolution and origin of an open file; invalid values are errors of that file."""
    if "format" not in reader.names():
        hint = "only npz files that mapdeal wrote can be read"
        raise reader.error("format", "missing key", hint=hint)
    if (found := reader.text("format", None)) != FORMAT:
        raise reader.error("format", f"must be {FORMAT}", got=found)
    try:
        resolution = check_resolution(reader.number("resolution"))
        yield resolution, check_origin(reader.small("origin", np.float64, (3,)).tolist())
    except ParameterError as error:
        raise error.in_file(reader.path) from None


def _read_costmap(reader: NpzReader, resolution: float, origin: Any) -> costmap.Costmap:
    scale = reader.text("cost_scale", ("costmap2d", "occupancy"))
    cost = reader.layer("cost", np.uint8 if scale == "costmap2d" else np.int8)
    has_circumscribed = "circumscribed_cost" in reader.names()
    circumscribed = reader.whole_number("circumscribed_cost") if has_circumscribed else None
    return costmap.Costmap(cost, resolution, origin, scale, circumscribed)  # type: ignore[arg-type]


def _read_field(reader: NpzReader, resolution: float, origin: Any) -> field.DistanceField:
    limit = reader.number("max_distance")
    return field.DistanceField(
        reader.layer("distance", np.float32), reader.layer("occupancy", np.int8), resolution,
        origin,
        convention=reader.text("convention", get_args(codes.Convention)),  # type: ignore[arg-type]
        strength=reader.number("strength"), max_distance=None if np.isinf(limit) else limit,
        lethal_threshold=reader.whole_number("lethal_threshold"),
        unknown=reader.text("unknown", ("free", "occupied")),  # type: ignore[arg-type]
    )  # fmt: skip


def _read_potential(reader: NpzReader, resolution: float, origin: Any) -> field.PotentialField:
    # The attractive layer and the sums are computed again instead of read.
    names = reader.names()
    weight = "cost_travel_multiplier"
    goal = reader.small("goal", np.float64, (2,)).tolist() if "goal" in names else None
    return field.PotentialField(
        reader.layer("repulsive", np.float64), reader.layer("occupancy", np.int8), resolution,
        origin, goal=goal, attractive_gain=reader.number("attractive_gain"),
        repulsive_gain=reader.number("repulsive_gain"),
        repulsive_cap=reader.number("repulsive_cap"),
        cost_to_go=reader.layer("cost_to_go", np.float64) if "cost_to_go" in names else None,
        cost_travel_multiplier=reader.number(weight) if weight in names else 0.0,
    )  # fmt: skip


def _read_occupancy(reader: NpzReader, resolution: float, origin: Any) -> OccupancyGrid:
    occupancy = reader.layer("occupancy", np.int8)
    if "layer" not in reader.names():
        return OccupancyGrid(occupancy, resolution, origin)
    reader.text("layer", (field.ESDF_VIEW,))
    view: field.View = reader.text("view", get_args(field.View))  # type: ignore[assignment]
    lengths = {name: reader.number(name) for name in field.ViewScale.keys_of(view)}
    return field.FieldView(occupancy, resolution, origin, field.ViewScale(view, **lengths))


_NPZ_READERS: dict[str, Callable[[NpzReader, float, Any], Grid]] = {
    "cost": _read_costmap,
    "distance": _read_field,
    "repulsive": _read_potential,
    _REACH_LAYER: lambda reader, *lies: OccupancyGrid(reader.layer("occupancy", np.int8), *lies),
    "occupancy": _read_occupancy,
}
"""Readers by the main layer of a file."""


def _main_layer(names: Collection[str]) -> str:
    return next((layer for layer in _NPZ_READERS if layer in names), "occupancy")


class NpzFile(MapFile):
    has_lazy_rows = True

    def __init__(self, path: Path, opened: ExitStack, _: Dialect, max_cells: int | None) -> None:
        super().__init__(path)
        self._opened, self._max_cells = opened, max_cells
        with NpzReader(path) as reader, _geometry_in(reader):
            self._names = reader.names()

    def _layer_to_read(self) -> str:
        own = _main_layer(self._names)
        return "occupancy" if own == _REACH_LAYER else own

    def frame(self) -> Frame:
        layer = self._layer_to_read()
        with NpzReader(self.path) as reader, _geometry_in(reader) as geometry:
            shape = reader.header(layer).shape
            if len(shape) != 2:
                raise reader.error(layer, f"must have two axes, has {len(shape)}")
            return Frame(*shape, *geometry)

    def memory_to_read(self) -> int:
        layers = {self._layer_to_read()}
        if layers & {"distance", "repulsive"}:  # fields include the occupancy they are made of
            layers |= {"occupancy"} & self._names
        with NpzReader(self.path) as reader:
            size = sum(reader.header(layer).nbytes for layer in layers)
        return size + min(PIECES, size)

    def cells(self) -> Grid:
        return read_npz(self.path, max_cells=self._max_cells)

    def rows(self, block_height: int, _: CacheBudget | None) -> Grid:
        lazy = open_npz(self.path, block_height=block_height, max_cells=self._max_cells)
        return self._opened.enter_context(lazy)

    def layers_of(self, kind: type[Any]) -> Any:
        if kind is reach.Reach and _main_layer(self._names) == _REACH_LAYER:
            return read_reach(self.path, max_cells=self._max_cells)
        if kind is not CloudLayers or not self._names >= set(CloudLayers.layer_names):
            return None
        with NpzReader(self.path, self._max_cells) as reader, _geometry_in(reader) as geometry:
            return CloudLayers(
                reader.layer("occupancy", np.int8), *geometry,
                floor_height=reader.layer("floor_height", np.float32),
                obstacle_height=reader.layer("obstacle_height", np.float32),
                slope=reader.layer("slope", np.float32), points=reader.layer("points", np.int32),
            )  # fmt: skip

    def evidence(self) -> dict[str, Array]:
        with NpzReader(self.path, self._max_cells) as reader:
            found = [(key, kind) for key, kind in _EVIDENCE.items() if key in self._names]
            return {key: reader.layer(key, kind) for key, kind in found}

    def remark(self, grid: Grid) -> None:
        if type(grid) is OccupancyGrid and _main_layer(self._names) == _REACH_LAYER:
            emit_warning(f"{self.path}: is a result of reach; only its map is used")
        super().remark(grid)


def _write(
    transaction: Transaction, output: Path, grid: Grid, *,
    more: Mapping[str, Array] | None = None, **_: Any,
) -> None:  # fmt: skip
    transaction.write(output, lambda file: write_npz(file, grid, more=more))


NPZ = MapFormat(
    "an .npz written by mapdeal", (".npz",), NpzFile, in_folders=False, grids=get_args(Grid),
    write=_write, requests_rows=True,
)  # fmt: skip


def check_ends_in_npz(path: Path) -> None:
    if path.suffix not in NPZ.endings:
        raise ParameterError("must end in .npz", place="layers", got=str(path))
