"""mapdeal's own files: layers and their geometry in an ``.npz``, format ``mapdeal/1``.

Read without trusting the file: every array's type, shape and size is checked before memory
is taken for it, and nothing is ever unpickled.
"""

from __future__ import annotations

import io
import warnings
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.lib import format as npy_format
from numpy.typing import NDArray

from mapdeal.errors import FileAccessError, MalformedInputError, ParameterError
from mapdeal.formats.deflate import Buffer, deflated, pieces
from mapdeal.formats.picture import LARGEST_CELLS
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.field import DistanceField
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.potential import PotentialField

FORMAT = "mapdeal/1"
_LARGEST_SMALL_ARRAY = 4096
_LARGEST_SMALL_NUMBER = 1 << 31

Grid = OccupancyGrid | Costmap | DistanceField | PotentialField


def write_npz(
    file: BinaryIO, grid: Grid, *, more: Mapping[str, NDArray[Any]] | None = None
) -> None:
    """Write a grid, all its layers and its geometry, and `more` layers, which no reader needs.

    The bytes depend on the grid alone: entries carry no time.
    """
    entries: dict[str, Any] = {
        "format": FORMAT,
        "resolution": np.float64(grid.resolution),
        "origin": np.asarray(grid.origin, dtype=np.float64),
        **_entries_of(grid),
        **(more or {}),
    }
    with zipfile.ZipFile(file, "w") as archive:
        for name, value in entries.items():
            _write_entry(file, archive, f"{name}.npy", np.asarray(value, order="C"))


def _write_entry(
    file: BinaryIO, archive: zipfile.ZipFile, name: str, array: NDArray[Any]
) -> None:  # fmt: skip
    """Add an array, compressed in threads.

    zipfile would compress in one. So it stores what is compressed already, and the entry's
    header is then corrected to say so. Layers of float64 are left as they are: their last
    digits are noise, and a tenth less to store costs ten times the time.
    """
    header = io.BytesIO()
    npy_format.write_array_header_1_0(header, npy_format.header_data_from_array_1_0(array))
    info = zipfile.ZipInfo(name, date_time=(1980, 1, 1, 0, 0, 0))
    checksum = 0

    def parts() -> Iterator[Buffer]:
        nonlocal checksum
        for part in (header.getvalue(), *pieces(array)):
            checksum = zlib.crc32(part, checksum)
            yield part

    is_noise = array.dtype == np.float64 and array.ndim > 1
    with archive.open(info, "w", force_zip64=True) as entry:
        for block in parts() if is_noise else deflated(parts()):
            entry.write(block)
    if is_noise:
        return
    info.compress_type = zipfile.ZIP_DEFLATED
    info.file_size = len(header.getvalue()) + array.nbytes
    info.CRC = checksum
    file.seek(info.header_offset)
    file.write(info.FileHeader(zip64=True))


def write_npy(file: BinaryIO, array: NDArray[Any]) -> None:
    """Write a bare array as ``.npy``."""
    npy_format.write_array(file, array, allow_pickle=False)


def read_npz(path: Path, *, max_cells: int | None = None) -> Grid:
    """Return the grid in an ``.npz`` file that mapdeal wrote.

    A file with costs gives a `Costmap`, one with distances a `DistanceField`, one with a
    repulsive layer a `PotentialField`, else an `OccupancyGrid`.

    Raises
    ------
    FileAccessError
        If the file cannot be read.
    MalformedInputError
        If it is not of mapdeal's format, damaged, or of more than `max_cells` cells (1e9).
    """
    reader = _Reader(path, LARGEST_CELLS if max_cells is None else max_cells)
    with reader:
        reader.check_format()
        resolution = reader.number("resolution")
        origin = reader.small("origin", np.float64, (3,)).tolist()
        names = reader.names()
        try:
            if "cost" in names:
                return _read_costmap(reader, resolution, origin)
            if "distance" in names:
                return _read_field(reader, resolution, origin)
            if "repulsive" in names:
                return _read_potential(reader, resolution, origin)
            return OccupancyGrid(reader.layer("occupancy", np.int8), resolution, origin)
        except ParameterError as error:
            raise error.in_file(path) from None


def _entries_of(grid: Grid) -> dict[str, Any]:
    if isinstance(grid, Costmap):
        entries: dict[str, Any] = {"cost": grid.cost, "cost_scale": grid.scale}
        if grid.circumscribed_cost is not None:
            entries["circumscribed_cost"] = np.int64(grid.circumscribed_cost)
        return entries
    if isinstance(grid, DistanceField):
        limit = np.inf if grid.max_distance is None else grid.max_distance
        return {
            "distance": grid.distance,
            "occupancy": grid.occupancy,
            "convention": grid.convention,
            "strength": np.float64(grid.strength),
            "max_distance": np.float64(limit),
            "lethal_threshold": np.int64(grid.lethal_threshold),
            "unknown": grid.unknown,
        }
    if isinstance(grid, PotentialField):
        return _potential_entries(grid)
    return {"occupancy": grid.occupancy}


def _potential_entries(field: PotentialField) -> dict[str, Any]:
    entries: dict[str, Any] = {"repulsive": field.repulsive, "normalised": field.normalised}
    if field.goal is not None:
        entries |= {
            "attractive": field.attractive,
            "potential": field.potential,
            "gradient": field.gradient,
            "gradient_magnitude": field.gradient_magnitude,
            "goal": np.array(field.goal),
        }
    return entries | {
        "occupancy": field.occupancy,
        "attractive_gain": np.float64(field.attractive_gain),
        "repulsive_gain": np.float64(field.repulsive_gain),
        "repulsive_cap": np.float64(field.repulsive_cap),
    }


def _read_costmap(reader: _Reader, resolution: float, origin: Any) -> Costmap:
    scale = reader.text("cost_scale", ("costmap2d", "occupancy"))
    cost = reader.layer("cost", np.uint8 if scale == "costmap2d" else np.int8)
    circumscribed = None
    if "circumscribed_cost" in reader.names():
        circumscribed = reader.whole_number("circumscribed_cost")
    return Costmap(cost, resolution, origin, scale, circumscribed)  # type: ignore[arg-type]


def _read_field(reader: _Reader, resolution: float, origin: Any) -> DistanceField:
    limit = reader.number("max_distance")
    return DistanceField(
        reader.layer("distance", np.float32),
        reader.layer("occupancy", np.int8),
        resolution,
        origin,
        convention=reader.text("convention", ("seed", "center", "border")),  # type: ignore[arg-type]
        strength=reader.number("strength"),
        max_distance=None if np.isinf(limit) else limit,
        lethal_threshold=reader.whole_number("lethal_threshold"),
        unknown=reader.text("unknown", ("free", "occupied")),  # type: ignore[arg-type]
    )


def _read_potential(reader: _Reader, resolution: float, origin: Any) -> PotentialField:
    """Return the field of a file; what follows from others of its layers is not read."""
    goal = None
    if "goal" in reader.names():
        x, y = reader.small("goal", np.float64, (2,)).tolist()
        goal = (x, y)
    return PotentialField(
        reader.layer("repulsive", np.float64),
        reader.layer("occupancy", np.int8),
        resolution,
        origin,
        goal=goal,
        attractive_gain=reader.number("attractive_gain"),
        repulsive_gain=reader.number("repulsive_gain"),
        repulsive_cap=reader.number("repulsive_cap"),
    )


class _Reader:
    """The entries of an npz file, each checked before its memory is taken."""

    def __init__(self, path: Path, max_cells: int) -> None:
        self._path = path
        self._max_cells = max_cells
        try:
            if not path.is_file():
                rule = "cannot be read: no such file" if not path.exists() else "no regular file"
                raise FileAccessError(rule, source=path)
            self._zip = zipfile.ZipFile(path)
        except (zipfile.BadZipFile, NotImplementedError, ValueError):
            raise MalformedInputError("is not an npz file", source=path) from None
        except OSError as error:
            rule = f"cannot be read: {error.strerror}"
            raise FileAccessError(rule, source=path) from None

    def __enter__(self) -> _Reader:
        return self

    def __exit__(self, *_: object) -> None:
        self._zip.close()

    def names(self) -> set[str]:
        return {name.removesuffix(".npy") for name in self._zip.namelist()}

    def check_format(self) -> None:
        if "format" not in self.names():
            hint = "only npz files that mapdeal wrote can be read"
            raise self._error("format", "missing key", hint=hint)
        found = self.text("format", None)
        if found != FORMAT:
            raise MalformedInputError(f"must be {FORMAT}", source=self._path, place="format",
                                      got=found)  # fmt: skip

    def layer(self, name: str, dtype: type[np.generic]) -> NDArray[Any]:
        array = self._read(name, np.dtype(dtype), None, self._max_cells)
        if array.ndim != 2:
            raise self._error(name, f"must have two axes, has {array.ndim}")
        return array

    def small(self, name: str, dtype: type[np.generic], shape: tuple[int, ...]) -> NDArray[Any]:
        return self._read(name, np.dtype(dtype), shape, _LARGEST_SMALL_ARRAY)

    def number(self, name: str) -> float:
        value = self._read(name, None, (), _LARGEST_SMALL_ARRAY)
        if value.dtype.kind not in "iuf":
            raise self._error(name, f"must be a number, is {value.dtype}")
        return float(value)

    def whole_number(self, name: str) -> int:
        value = self.number(name)
        if value % 1 or abs(value) > _LARGEST_SMALL_NUMBER:  # nan and inf leave a rest of nan
            raise self._error(name, f"must be a whole number, is {value:g}")
        return int(value)

    def text(self, name: str, choices: tuple[str, ...] | None) -> str:
        value = self._read(name, None, (), _LARGEST_SMALL_ARRAY)
        if value.dtype.kind != "U":
            raise self._error(name, f"must be text, is {value.dtype}")
        text = str(value)
        if choices is not None and text not in choices:
            raise self._error(name, f"must be one of {', '.join(choices)}")
        return text

    def _error(self, name: str, rule: str, *, hint: str | None = None) -> MalformedInputError:
        return MalformedInputError(rule, source=self._path, place=name, hint=hint)

    def _read(
        self,
        name: str,
        dtype: np.dtype[Any] | None,
        shape: tuple[int, ...] | None,
        most_elements: int,
    ) -> NDArray[Any]:
        try:
            info = self._zip.getinfo(f"{name}.npy")
        except KeyError:
            raise self._error(name, "missing key") from None
        if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise self._error(name, "compressed in a way that npz files are not")
        from tokenize import TokenError  # of use to few, and slow to import

        try:
            with self._zip.open(info) as entry:
                version = npy_format.read_magic(entry)
                read_header = {
                    (1, 0): npy_format.read_array_header_1_0,
                    (2, 0): npy_format.read_array_header_2_0,
                }.get(version)
                if read_header is None:
                    raise self._error(name, f"array format {version} is not supported")
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")  # of headers that Python 2 wrote
                    found_shape, fortran, found_dtype = read_header(entry)
                if found_dtype.hasobject:
                    raise self._error(name, "holds Python objects, which are never loaded")
                if dtype is not None and found_dtype != dtype:
                    raise self._error(name, f"must be {dtype}, is {found_dtype}")
                if shape is not None and found_shape != shape:
                    raise self._error(name, f"must have shape {shape}, has {found_shape}")
                count = int(np.prod([int(n) for n in found_shape], dtype=object))
                if count > most_elements:
                    raise self._error(name, f"{count} elements, above the limit of {most_elements}")
                if dtype is None and count * found_dtype.itemsize > _LARGEST_SMALL_ARRAY:
                    raise self._error(name, f"must be a single value, is {found_dtype}")
                # The header's word is only taken as far as the archive has bytes for it.
                if count * found_dtype.itemsize + entry.tell() != info.file_size:
                    raise self._error(name, "the array's size does not fit its data")
                array = np.empty(count, dtype=found_dtype)
                _read_into(entry, array)
                return array.reshape(found_shape, order="F" if fortran else "C")
        # What reading a damaged header or entry leads to, in numpy and in zipfile.
        except (zipfile.BadZipFile, zlib.error, EOFError, ValueError, NotImplementedError,
                RuntimeError, OSError, SyntaxError, TokenError, LookupError,
                TypeError) as error:  # fmt: skip
            raise self._error(name, f"damaged: {error}") from None


def _read_into(entry: Any, array: NDArray[Any]) -> None:
    """Fill `array` from a file, and read to the end so that the checksum is verified."""
    view = memoryview(array.reshape(-1).view(np.uint8).data) if array.size else memoryview(b"")
    done = 0
    while done < len(view):
        chunk = entry.read(min(1 << 24, len(view) - done))
        if not chunk:
            raise EOFError("the data end early")
        view[done : done + len(chunk)] = chunk
        done += len(chunk)
    entry.read(1)
