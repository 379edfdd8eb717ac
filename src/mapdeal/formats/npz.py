"""mapdeal's own files: layers and their geometry in an ``.npz``, format ``mapdeal/1``.

Read without trusting the file: every array's type, shape and size is checked before memory
is taken for it, and nothing is ever unpickled.
"""

from __future__ import annotations

import itertools
import zipfile
import zlib
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, get_args

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import MalformedInputError, ParameterError
from mapdeal.formats.budget import PIECES
from mapdeal.formats.kinds import MAP, recognised
from mapdeal.formats.npy import npy_header
from mapdeal.formats.npz_reader import NpzReader
from mapdeal.formats.picture import LARGEST_CELLS
from mapdeal.formats.png import Buffer, deflated, pieces
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.field import ESDF_VIEW, DistanceField, FieldView, View, ViewScale
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.frame import Frame, Origin, check_origin, check_resolution
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.potential import PotentialField
from mapdeal.grid.reach import Reach
from mapdeal.grid.values import Convention
from mapdeal.kernels.blocks import Layer, is_lazy

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
    """Add an array, compressed in threads."""
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
    """Return the grid in an ``.npz`` file that mapdeal wrote."""
    # A file with costs gives a `Costmap`, one with distances a `DistanceField`, one with a
    # repulsive layer a `PotentialField`, else an `OccupancyGrid`: so does what was reached, whose
    # other layers `read_reach` returns.
    with NpzReader(path, LARGEST_CELLS if max_cells is None else max_cells) as reader:
        return _grid_in(reader, path)


@contextmanager
def open_npz(
    path: Path, *, block_height: int = _BLOCK_HEIGHT, max_cells: int | None = None
) -> Iterator[Grid]:
    """Open an ``.npz`` file: give the grid that `read_npz` returns, of lazy layers."""
    # Rows are best requested in their order: those before others are read from the start again. A
    # potential field is read as a whole. The region of a distance field, the box of cells that have
    # a distance, is not known.
    most = LARGEST_CELLS if max_cells is None else max_cells
    with NpzReader(path, most, block_height) as reader:
        if _own_layer(reader.names()) != "repulsive":
            yield _grid_in(reader, path)
            return
    yield read_npz(path, max_cells=max_cells)


def _grid_in(reader: NpzReader, path: Path) -> Grid:
    with _geometry_in(reader, path) as (resolution, origin):
        return _READERS[_own_layer(reader.names())](reader, resolution, origin)


def holds_reach(path: Path) -> bool:
    """Return whether an ``.npz`` file holds a `Reach`."""
    with NpzReader(path, LARGEST_CELLS) as reader:
        return _own_layer(reader.names()) == _OF_REACH


def read_reach(path: Path, *, max_cells: int | None = None) -> Reach:
    """Return what an ``.npz`` file holds of a `Reach`: all but its goals and passages."""
    most = LARGEST_CELLS if max_cells is None else max_cells
    with NpzReader(path, most) as reader, _geometry_in(reader, path) as (resolution, origin):
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


def read_evidence(path: Path, *, max_cells: int | None = None) -> dict[str, NDArray[Any]]:
    """Return the layers of an ``.npz`` that say what beams have hit; none if it has none."""
    with NpzReader(path, LARGEST_CELLS if max_cells is None else max_cells) as reader:
        there = reader.names()
        return {
            name: reader.layer(name, kind) for name, kind in _OF_EVIDENCE.items() if name in there
        }


def npz_frame(path: Path) -> Frame:
    """Return where the grid in an ``.npz`` file lies; of its layers headers are read."""
    with NpzReader(path, LARGEST_CELLS) as reader, _geometry_in(reader, path) as geometry:
        own = _own_layer(reader.names())
        layer = _LAYER_READ.get(own, own)
        shape = reader.header(layer).shape
        if len(shape) != 2:
            rule = f"must have two axes, has {len(shape)}"
            raise MalformedInputError(rule, source=path, place=layer)
        return Frame(*shape, *geometry)


def npz_memory(path: Path) -> int:
    """Return the bytes that reading an ``.npz`` file takes; of its layers headers are read."""
    with NpzReader(path, LARGEST_CELLS) as reader:
        own = _own_layer(reader.names())
        layers = {_LAYER_READ.get(own, own)}
        if own in _WITH_OCCUPANCY:
            layers |= {"occupancy"} & reader.names()
        taken = sum(reader.header(layer).nbytes for layer in layers)
    return taken + min(PIECES, taken)


@contextmanager
def _geometry_in(reader: NpzReader, path: Path) -> Iterator[tuple[float, Origin]]:
    """Yield resolution and origin of mapdeal's own file, which errors of its values name."""
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
        reader.layer("distance", np.float32),
        reader.layer("occupancy", np.int8),
        resolution,
        origin,
        convention=reader.text("convention", get_args(Convention)),  # type: ignore[arg-type]
        strength=reader.number("strength"),
        max_distance=None if np.isinf(limit) else limit,
        lethal_threshold=reader.whole_number("lethal_threshold"),
        unknown=reader.text("unknown", ("free", "occupied")),  # type: ignore[arg-type]
    )


def _read_potential(reader: NpzReader, resolution: float, origin: Any) -> PotentialField:
    """Return the field of a file; what follows from others of its layers is not read."""
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


_READERS: dict[str, Callable[[NpzReader, float, Any], Grid]] = {
    "cost": _read_costmap,
    "distance": _read_field,
    "repulsive": _read_potential,
    _OF_REACH: lambda reader, *lies: OccupancyGrid(reader.layer("occupancy", np.int8), *lies),
    "occupancy": _read_occupancy,
}
_LAYER_READ = {_OF_REACH: "occupancy"}
"""By the layer that a file is about, what is read of it where that is another one."""
_WITH_OCCUPANCY = ("distance", "repulsive")
"""By the layer that a grid is about; fields hold the occupancy that they are of, too."""


def _own_layer(names: Collection[str]) -> str:
    return next((layer for layer in _READERS if layer in names), "occupancy")
