"""mapdeal's own files: layers and their geometry in an ``.npz``, format ``mapdeal/1``.

Read without trusting the file: every array's type, shape and size is checked before memory
is taken for it, and nothing is ever unpickled.
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
from numpy.typing import NDArray

from mapdeal.errors import FileAccessError, MalformedInputError, ParameterError
from mapdeal.files.source import PIECES, check_expansion, check_readable, claim
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.field import ESDF_VIEW, DistanceField, FieldView, PotentialField, View, ViewScale
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.frame import Frame, Origin, check_origin, check_resolution
from mapdeal.grid.occupancy import CloudLayers, OccupancyGrid
from mapdeal.grid.reach import Reach
from mapdeal.grid.values import OCCUPIED, UNKNOWN, Convention
from mapdeal.inputs.kinds import MAP, recognised
from mapdeal.kernels.blocks import Layer, LazyLayer, is_lazy
from mapdeal.maps.images import one_at_a_time
from mapdeal.maps.picture import LARGEST_CELLS
from mapdeal.maps.png import Buffer, deflated, pieces

_LONGEST_HEADER = 1 << 16
_READERS = {
    (1, 0): npy_format.read_array_header_1_0,
    (2, 0): npy_format.read_array_header_2_0,
    # which differs from 2 in letters of names alone: x, y and z are the same in both
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
    from tokenize import TokenError  # of use to few, and slow to import

    try:
        head = io.BytesIO(file.read(_LONGEST_HEADER))  # numpy would read any length
        version = npy_format.read_magic(head)
        if version not in _READERS:
            raise ValueError(f"version {version} is not supported")
        with one_at_a_time(), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of headers that Python 2 wrote
            header = _READERS[version](head)
    # What a damaged header leads to, in numpy and in Python's parser; some texts have more lines.
    except (ValueError, EOFError, SyntaxError, TokenError, LookupError, TypeError,
            OverflowError, RecursionError, MemoryError) as error:  # fmt: skip
        raise ValueError(str(error).partition("\n")[0]) from None
    file.seek(head.tell())
    return NpyHeader(*header, head.tell())


def write_npy(file: BinaryIO, array: Layer) -> None:
    file.write(npy_header(array.shape, array.dtype))
    file.writelines(pieces(array))


def npy_header(shape: tuple[int, ...], dtype: np.dtype[Any]) -> bytes:
    header = io.BytesIO()
    facts = {"descr": npy_format.dtype_to_descr(dtype), "fortran_order": False, "shape": shape}
    npy_format.write_array_header_1_0(header, facts)
    return header.getvalue()


_LARGEST_SMALL_ARRAY = 4096
_LARGEST_DIRECTORY = 1 << 20
_END_OF_ZIP = (1 << 16) + 256
_TOLD_BY_ZIP64 = 0xFFFFFFFF
_LARGEST_SMALL_NUMBER = 1 << 31
_MOST_COLUMNS = 1 << 16
_CHUNK = 1 << 22


class NpzReader:
    """The entries of an npz file, each checked before its memory is taken."""

    # If a height of blocks is given, layers are lazy, but for those that are stored column by
    # column. Rows before those that were read last are read from the start again. Memory is taken
    # for the rows that are asked for, so data that expand a thousand times do no harm. What is
    # damaged is found when its rows are read, a wrong checksum with the last row.
    def __init__(
        self, path: Path, max_cells: int | None = None, block_height: int | None = None
    ) -> None:
        self.path = path
        self._max_cells = LARGEST_CELLS if max_cells is None else max_cells
        self._block_height = block_height
        self._taken = 0
        self._files = ExitStack()
        check_readable(path)
        try:
            if _directory_size(path) > _LARGEST_DIRECTORY:
                raise MalformedInputError("holds too many arrays", source=path)
            self._zip = self._files.enter_context(zipfile.ZipFile(path))
        except (zipfile.BadZipFile, NotImplementedError, ValueError):
            raise MalformedInputError("is not an npz file", source=path) from None
        except OSError as error:
            rule = f"cannot be read: {error.strerror}"
            raise FileAccessError(rule, source=path) from None

    def __enter__(self) -> NpzReader:
        return self

    def __exit__(self, *_: object) -> None:
        self._files.close()

    def names(self) -> set[str]:
        return {name.removesuffix(".npy") for name in self._zip.namelist()}

    def header(self, name: str) -> NpyHeader:
        with self._opened(name) as (_, header):
            return header

    def layer(self, name: str, dtype: type[np.generic]) -> Layer:
        header = self._checked(name, self._max_cells, np.dtype(dtype))
        if len(header.shape) != 2:
            raise self._error(name, f"must have two axes, has {len(header.shape)}")
        if self._block_height is None or header.is_fortran:
            return self._values(name, header.nbytes * (1 + header.is_fortran))
        file, header = self._files.enter_context(self._opened(name))
        height, width = header.shape
        row_size = width * header.dtype.itemsize
        lock = Lock()

        def read(rows: slice) -> NDArray[Any]:
            size = (rows.stop - rows.start) * row_size
            claim(self.path, size + min(PIECES, size))
            values = np.empty((rows.stop - rows.start, width), dtype=dtype)
            with lock, self._damage_told(name):
                file.seek(header.start + rows.start * row_size)
                _fill(values, file)
            if dtype is np.int8 and values.size:  # as a map or costs in memory would refuse them
                lowest, highest = int(values.min()), int(values.max())
                if lowest < UNKNOWN or highest > OCCUPIED:
                    rule = f"{name} must lie in -1..100"
                    raise ParameterError(rule, got=(lowest, highest)).in_file(self.path)
            return values

        layer = LazyLayer((height, width), dtype, read, block_height=self._block_height)
        return cast("Layer", layer)

    def small(self, name: str, dtype: type[np.generic], shape: tuple[int, ...]) -> NDArray[Any]:
        header = self._checked(name, _LARGEST_SMALL_ARRAY, np.dtype(dtype), shape)
        return self._values(name, header.nbytes)

    def number(self, name: str) -> float:
        return float(self._single(name, "iuf", "a number"))

    def whole_number(self, name: str) -> int:
        value = self.number(name)
        if value % 1 or abs(value) > _LARGEST_SMALL_NUMBER:  # nan and inf leave a rest of nan
            raise self._error(name, f"must be a whole number, is {value:g}")
        return int(value)

    def text(self, name: str, choices: tuple[str, ...] | None) -> str:
        value = self._single(name, "U", "text")
        little = value.astype(value.dtype.newbyteorder("<"))
        try:  # not by numpy, which makes broken strings of characters beyond Unicode
            text = little.tobytes().decode("utf-32-le").rstrip("\0")
        except UnicodeDecodeError:
            raise self._error(name, "must be text, is not Unicode") from None
        if choices is not None and text not in choices:
            raise self._error(name, f"must be one of {', '.join(choices)}")
        return text

    def numbers(self, name: str, axes: int) -> NDArray[np.float64]:
        header = self._checked(name, self._max_cells)
        if header.dtype.kind not in "iuf" or len(header.shape) != axes:
            found = f"{header.dtype} of shape {header.shape}"
            raise self._error(name, f"must be numbers with {axes} axes, is {found}")
        wide = 16 * header.elements  # converted to float64, and looked at
        return self._values(name, header.nbytes + wide).astype(np.float64)

    def rows(
        self, name: str, columns: int, *, shape: tuple[int, int] | None = None
    ) -> Iterator[NDArray[np.float64]]:
        """Yield the first `columns` numbers of each row of a table, many rows at a time."""
        # Rows that have fewer are yielded whole; at least two numbers make a row. If a shape is
        # given, the table must have it. A table that is stored column by column is held in memory.
        with self._opened(name) as (file, header):
            if shape is not None and header.shape != shape:
                raise self._error(name, f"must have shape {shape}, has {header.shape}")
            least = 2 if shape is None else 0
            if header.dtype.kind not in "iuf" or len(header.shape) != 2 or header.shape[1] < least:
                found = f"{header.dtype} of shape {header.shape}"
                raise self._error(name, f"must be numbers of shape (N, 2) or wider, is {found}")
            height, width = header.shape
            if width > _MOST_COLUMNS:
                raise self._error(name, f"{width} columns, above the limit of {_MOST_COLUMNS}")
            # as many as are little memory, too, when they are converted
            together = max(1, _CHUNK // (max(1, width) * max(8, header.dtype.itemsize)))
            table = self._values(name, header.nbytes) if header.is_fortran else None
            for first in range(0, height, together):
                if table is None:
                    part = np.empty((min(together, height - first), width), header.dtype)
                    _fill(part, file)
                else:
                    part = table[first : first + together]
                yield part[:, :columns].astype(np.float64)

    def _single(self, name: str, kinds: str, what: str) -> NDArray[Any]:
        header = self._checked(name, _LARGEST_SMALL_ARRAY, shape=())
        if header.dtype.kind not in kinds or header.nbytes > _LARGEST_SMALL_ARRAY:
            raise self._error(name, f"must be {what}, is {header.dtype}")
        return self._values(name, header.nbytes)

    def _checked(
        self, name: str, most: int, dtype: Any = None, shape: tuple[int, ...] | None = None
    ) -> NpyHeader:
        header = self.header(name)
        if dtype is not None and header.dtype != dtype:
            raise self._error(name, f"must be {dtype}, is {header.dtype}")
        if shape is not None and header.shape != shape:
            raise self._error(name, f"must have shape {shape}, has {header.shape}")
        if header.elements > most:
            raise self._error(name, f"{header.elements} elements, above the limit of {most}")
        return header

    def _error(self, name: str, rule: str) -> MalformedInputError:
        return MalformedInputError(rule, source=self.path, place=name)

    def _values(self, name: str, taken: int) -> NDArray[Any]:
        with self._opened(name) as (file, header):
            check_expansion(
                self.path, self._zip.getinfo(f"{name}.npy").compress_size, header.nbytes, place=name
            )
            self._taken += taken
            claim(self.path, self._taken + min(PIECES, self._taken))
            array = np.empty(header.elements, dtype=header.dtype)
            _fill(array, file)
            return array.reshape(header.shape, order="F" if header.is_fortran else "C")

    @contextmanager
    def _opened(self, name: str) -> Iterator[tuple[IO[bytes], NpyHeader]]:
        """Yield the file of an entry behind its header, and this; report damage met meanwhile."""
        try:
            info = self._zip.getinfo(f"{name}.npy")
        except KeyError:
            raise self._error(name, "missing key") from None
        if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise self._error(name, "compressed by a method that npz files do not use")
        with self._damage_told(name), self._zip.open(info) as file:
            header = read_npy_header(file)
            if header.dtype.hasobject:
                raise self._error(name, "holds Python objects, which are never loaded")
            # The header's word is only taken as far as the archive has bytes for it.
            if header.start + header.nbytes != info.file_size:
                raise self._error(name, "the array's size does not fit its data")
            yield file, header

    @contextmanager
    def _damage_told(self, name: str) -> Iterator[None]:
        """Raise what reading a damaged entry leads to, in zipfile and zlib, as such."""
        try:
            yield
        except (zipfile.BadZipFile, zlib.error, EOFError, ValueError, NotImplementedError,
                RuntimeError, OSError) as error:  # fmt: skip
            raise self._error(name, f"damaged: {error}") from None


def _directory_size(path: Path) -> int:
    """Return the bytes of a zip file's list of entries, which takes ten times as many."""
    with path.open("rb") as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(size - _END_OF_ZIP, 0))
        tail = file.read()
    end = tail.rfind(b"PK\5\6")
    if end < 0:
        return 0
    own = int.from_bytes(tail[end + 12 : end + 16], "little")
    large = tail.rfind(b"PK\6\6", 0, end)  # the record of zip64, with wider numbers
    wide = int.from_bytes(tail[large + 40 : large + 48], "little") if large >= 0 else 0
    return max(wide, own if own < _TOLD_BY_ZIP64 else 0)


def _fill(array: NDArray[Any], file: IO[bytes]) -> None:
    """Fill a contiguous array from a file, which verifies its checksum at the end."""
    view = memoryview(array.reshape(-1).view(np.uint8).data) if array.size else memoryview(b"")
    for start in range(0, len(view), _CHUNK):
        part = view[start : start + _CHUNK]
        if file.readinto(part) < len(part):  # type: ignore[attr-defined]
            raise EOFError("the data end early")


FORMAT = "mapdeal/1"
_OF_REACH = "reachable"
_BLOCK_HEIGHT = 512
_OF_EVIDENCE: dict[str, type[np.generic]] = {
    "log_odds": np.float64, "hits": np.int32, "misses": np.int32
}  # fmt: skip
Grid = OccupancyGrid | Costmap | DistanceField | PotentialField | Reach


def write_npz(
    file: BinaryIO, grid: Grid, *, more: Mapping[str, NDArray[Any]] | None = None
) -> None:
    """Write a grid, all its layers and its geometry, and `more` layers, which no reader needs."""
    # The bytes depend on the grid alone: entries carry no time.
    entries: dict[str, Any] = {
        "format": FORMAT,
        "resolution": np.float64(grid.resolution),
        "origin": np.asarray(grid.origin, dtype=np.float64),
        **grid.entries(),
        **(more or {}),
    }
    with zipfile.ZipFile(file, "w") as archive:
        for name, value in entries.items():
            array = value if is_lazy(value) else np.asarray(value, order="C")
            _write_entry(file, archive, f"{name}.npy", array)


def _write_entry(file: BinaryIO, archive: zipfile.ZipFile, name: str, array: Layer) -> None:
    # zipfile would compress in one. So it stores what is compressed already, and the entry's header
    # is then corrected to say so. Layers of float64 are left as they are: their last digits are
    # noise, and a tenth less to store costs ten times the time.
    header = npy_header(array.shape, array.dtype)
    info = zipfile.ZipInfo(name, date_time=(1980, 1, 1, 0, 0, 0))
    checksum = 0

    def parts() -> Iterator[Buffer]:
        nonlocal checksum
        for part in itertools.chain([header], pieces(array)):
            checksum = zlib.crc32(part, checksum)
            yield part

    is_noise = array.dtype == np.float64 and array.ndim > 1
    with archive.open(info, "w", force_zip64=True) as entry:
        for block in parts() if is_noise else deflated(parts()):
            entry.write(block)
    if is_noise:
        return
    info.compress_type = zipfile.ZIP_DEFLATED
    info.file_size = len(header) + array.nbytes
    info.CRC = checksum
    file.seek(info.header_offset)
    file.write(info.FileHeader(zip64=True))


def read_npz(path: Path, *, max_cells: int | None = None) -> Grid:
    # A file with costs gives a `Costmap`, one with distances a `DistanceField`, one with a
    # repulsive layer a `PotentialField`, else an `OccupancyGrid`: so does what was reached, whose
    # other layers `read_reach` returns.
    with NpzReader(path, max_cells) as reader:
        return _grid_in(reader)


@contextmanager
def open_npz(
    path: Path, *, block_height: int = _BLOCK_HEIGHT, max_cells: int | None = None
) -> Iterator[Grid]:
    """Open an ``.npz`` file: give the grid that `read_npz` returns, of lazy layers."""
    # Rows are best requested in their order: those before others are read from the start again. A
    # potential field is read as a whole. The region of a distance field, the box of cells that have
    # a distance, is not known.
    with NpzReader(path, max_cells, block_height) as reader:
        if _own_layer(reader.names()) != "repulsive":
            yield _grid_in(reader)
            return
    yield read_npz(path, max_cells=max_cells)


def _grid_in(reader: NpzReader) -> Grid:
    with _geometry_in(reader) as (resolution, origin):
        return _NPZ_READERS[_own_layer(reader.names())](reader, resolution, origin)


def holds_reach(path: Path) -> bool:
    with NpzReader(path) as reader:
        return _own_layer(reader.names()) == _OF_REACH


def read_reach(path: Path, *, max_cells: int | None = None) -> Reach:
    """Return what an ``.npz`` file holds of a `Reach`: all but its goals and passages."""
    with NpzReader(path, max_cells) as reader, _geometry_in(reader) as (resolution, origin):
        start = reader.small(
            "start", np.float64, (3,) if reader.header("start").shape == (3,) else (2,)
        )
        if not np.isfinite(start).all():
            raise MalformedInputError("must be finite numbers", source=path, place="start")
        robot = None
        if "robot" in reader.names():
            corners = reader.small("robot", np.float64, (*reader.header("robot").shape[:1], 2))
            if len(corners):
                robot = Footprint.polygon(corners.tolist())
            else:
                robot = Footprint.circle(reader.number("robot_radius"))
        return Reach(
            reader.layer("reachable", np.uint8), reader.layer("headings", np.uint8),
            reader.layer("clearance", np.float32), reader.layer("widest", np.float32),
            reader.layer("occupancy", np.int8), resolution, origin,
            start=tuple(start.tolist()), robot=robot,
            heading_count=reader.whole_number("heading_count"),
            through_unknown=bool(reader.whole_number("through_unknown")),
        )  # fmt: skip


def read_cloud_layers(path: Path, *, max_cells: int | None = None) -> CloudLayers | None:
    """Return the map of a cloud in an ``.npz`` file with its layers; None if it has none."""
    with NpzReader(path, max_cells) as reader:
        if not reader.names() >= set(CloudLayers.layer_names):
            return None
        with _geometry_in(reader) as (resolution, origin):
            return CloudLayers(
                reader.layer("occupancy", np.int8), resolution, origin,
                floor_height=reader.layer("floor_height", np.float32),
                obstacle_height=reader.layer("obstacle_height", np.float32),
                slope=reader.layer("slope", np.float32), points=reader.layer("points", np.int32),
            )  # fmt: skip


def read_evidence(path: Path, *, max_cells: int | None = None) -> dict[str, NDArray[Any]]:
    """Return the layers of an ``.npz`` that say what beams have hit; none if it has none."""
    with NpzReader(path, max_cells) as reader:
        there = reader.names()
        return {
            name: reader.layer(name, kind) for name, kind in _OF_EVIDENCE.items() if name in there
        }


def npz_frame(path: Path) -> Frame:
    """Return where the grid in an ``.npz`` file lies; of its layers headers are read."""
    with NpzReader(path) as reader, _geometry_in(reader) as geometry:
        layer = _layer_read(reader.names())
        shape = reader.header(layer).shape
        if len(shape) != 2:
            rule = f"must have two axes, has {len(shape)}"
            raise MalformedInputError(rule, source=path, place=layer)
        return Frame(*shape, *geometry)


def npz_memory(path: Path) -> int:
    """Return the bytes that reading an ``.npz`` file takes; of its layers headers are read."""
    with NpzReader(path) as reader:
        layers = {_layer_read(reader.names())}
        if layers & {"distance", "repulsive"}:  # fields hold the occupancy that they are of, too
            layers |= {"occupancy"} & reader.names()
        taken = sum(reader.header(layer).nbytes for layer in layers)
    return taken + min(PIECES, taken)


@contextmanager
def _geometry_in(reader: NpzReader) -> Iterator[tuple[float, Origin]]:
    """Yield resolution and origin of mapdeal's own file, which errors of its values name."""
    path = reader.path
    if "format" not in reader.names():
        hint = "only npz files that mapdeal wrote can be read"
        with recognised(path, "a map", MAP):
            raise MalformedInputError("missing key", source=path, place="format", hint=hint)
    found = reader.text("format", None)
    if found != FORMAT:
        raise MalformedInputError(f"must be {FORMAT}", source=path, place="format", got=found)
    try:
        resolution = check_resolution(reader.number("resolution"))
        yield resolution, check_origin(reader.small("origin", np.float64, (3,)).tolist())
    except ParameterError as error:
        raise error.in_file(path) from None


def _read_costmap(reader: NpzReader, resolution: float, origin: Any) -> Costmap:
    scale = reader.text("cost_scale", ("costmap2d", "occupancy"))
    cost = reader.layer("cost", np.uint8 if scale == "costmap2d" else np.int8)
    is_told = "circumscribed_cost" in reader.names()
    circumscribed = reader.whole_number("circumscribed_cost") if is_told else None
    return Costmap(cost, resolution, origin, scale, circumscribed)  # type: ignore[arg-type]


def _read_field(reader: NpzReader, resolution: float, origin: Any) -> DistanceField:
    limit = reader.number("max_distance")
    return DistanceField(
        reader.layer("distance", np.float32), reader.layer("occupancy", np.int8), resolution,
        origin,
        convention=reader.text("convention", get_args(Convention)),  # type: ignore[arg-type]
        strength=reader.number("strength"), max_distance=None if np.isinf(limit) else limit,
        lethal_threshold=reader.whole_number("lethal_threshold"),
        unknown=reader.text("unknown", ("free", "occupied")),  # type: ignore[arg-type]
    )  # fmt: skip


def _read_potential(reader: NpzReader, resolution: float, origin: Any) -> PotentialField:
    # What follows from others of its layers is not read.
    goal = None
    if "goal" in reader.names():
        x, y = reader.small("goal", np.float64, (2,)).tolist()
        goal = (x, y)
    return PotentialField(
        reader.layer("repulsive", np.float64), reader.layer("occupancy", np.int8), resolution,
        origin, goal=goal, attractive_gain=reader.number("attractive_gain"),
        repulsive_gain=reader.number("repulsive_gain"),
        repulsive_cap=reader.number("repulsive_cap"),
    )  # fmt: skip


def _read_occupancy(reader: NpzReader, resolution: float, origin: Any) -> OccupancyGrid:
    occupancy = reader.layer("occupancy", np.int8)
    if "layer" not in reader.names():
        return OccupancyGrid(occupancy, resolution, origin)
    reader.text("layer", (ESDF_VIEW,))
    view: View = reader.text("view", get_args(View))  # type: ignore[assignment]
    lengths = {name: reader.number(name) for name in ViewScale.keys_of(view)}
    return FieldView(occupancy, resolution, origin, ViewScale(view, **lengths))


_NPZ_READERS: dict[str, Callable[[NpzReader, float, Any], Grid]] = {
    "cost": _read_costmap,
    "distance": _read_field,
    "repulsive": _read_potential,
    _OF_REACH: lambda reader, *lies: OccupancyGrid(reader.layer("occupancy", np.int8), *lies),
    "occupancy": _read_occupancy,
}
"""By the layer that a file is about."""


def _layer_read(names: Collection[str]) -> str:
    own = _own_layer(names)
    return "occupancy" if own == _OF_REACH else own


def _own_layer(names: Collection[str]) -> str:
    return next((layer for layer in _NPZ_READERS if layer in names), "occupancy")
