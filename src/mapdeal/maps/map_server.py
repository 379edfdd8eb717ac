"""A map_server pair, yaml and image: the place where rows are flipped.

The module holds the readers, with their warnings about pixels, then the writers, then bit maps:
pairs of a ``.pbm`` and a YAML file whose bits stay packed in memory.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, ExitStack, suppress
from contextvars import ContextVar
from functools import cached_property, partial
from pathlib import Path, PureWindowsPath
from typing import Any, Literal
from urllib.parse import unquote

import numpy as np

from mapdeal import errors, records
from mapdeal.errors import FileAccessError, MalformedInputError, ParameterError, emit_warning
from mapdeal.files import source as sources, yaml_text
from mapdeal.files.transaction import RowsWriter, Transaction, Writer
from mapdeal.grid import costmap, field
from mapdeal.grid.bit_map import BitMap
from mapdeal.grid.frame import Frame, Framed, Origin
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import FREE, OCCUPIED, UNKNOWN, CostScale, join_words, occupancy_from_cost
from mapdeal.kernels import arrays, blocks, threads
from mapdeal.kernels.lookup import look_up
from mapdeal.maps import map_file, png
from mapdeal.maps.dialects import Dialect, MapMetadata, Mode, cells_of, read_metadata, yaml_of
from mapdeal.maps.images import IMAGE_SUFFIXES, PnmImage, begin_pgm, open_image, write_pbm
from mapdeal.maps.picture import OpenImage, Picture, Strips, by_sample, opened, warn_of

_HEAD = 1 << 20
MAP_SAVER_UNKNOWN = 205  # the grey that map_saver writes for unknown cells
USUAL_FREE_THRESH = 0.196  # default of free_thresh in ROS: just below the shade of that grey
# Smallest share of the cells at which this grey is map_saver's rather than that of blurred edges:
# anti-aliasing spreads a few percent of the cells over all greys.
FREED_SHARE = 0.001


class FreedCells:
    """Counter of the cells of map_saver's grey for unknown that a reader takes for free."""

    def __init__(self, metadata: MapMetadata, dialect: Dialect) -> None:
        self.count = 0
        self.stay_free = False  # whether some of them stay free with the usual free_thresh
        usual_thresh = min(USUAL_FREE_THRESH, metadata.free_thresh)
        self._metadata, self._usual = metadata, records.replace(metadata, free_thresh=usual_thresh)
        self._dialect: Dialect = dialect
        self._byte_is_free: bool | None = None

    def add(
        self, picture: Picture, occupancy: arrays.SignedBytes, times: arrays.Integers | None = None
    ) -> None:
        if not self.are_possible(picture):
            return
        mask = map_saver_grey_mask(picture) & (occupancy[::-1] == FREE)
        count = _count(mask, times)
        if count and not self.stay_free:
            cells = cells_of(picture.only(mask), self._usual, self._dialect)
            self.stay_free = bool((cells == FREE).any())
        self.count += count

    def are_possible(self, picture: Picture) -> bool:
        """Return whether the picture can have such cells; for opaque bytes one pixel decides."""
        if picture.maxval != 255 or picture.alpha is not None or picture.palette is not None:
            return True
        if self._byte_is_free is None:
            grey = np.full((1, 1, *picture.samples.shape[2:]), MAP_SAVER_UNKNOWN, dtype=np.uint8)
            cells = cells_of(records.replace(picture, samples=grey), self._metadata, self._dialect)
            self._byte_is_free = bool(cells[0, 0] == FREE)
        return self._byte_is_free


def map_saver_grey_mask(picture: Picture) -> arrays.Mask:
    """Return which pixels have the grey that map_saver writes for unknown, shape (H, W)."""
    # Only its exact brightness counts, 205 / 255 at any maxval: a neighbouring grey may be free
    # with the usual thresholds on purpose.
    if picture.palette is not None:
        has_grey = (picture.palette[:, :3] == MAP_SAVER_UNKNOWN).all(axis=1)
    else:
        has_grey = np.arange(picture.maxval + 1) * 255 == MAP_SAVER_UNKNOWN * picture.maxval
    mask: arrays.Mask = by_sample(has_grey, picture.samples)
    return mask[..., 0] & mask[..., 1] & mask[..., 2] if picture.colour == "rgb" else mask


def remark_on_freed(
    freed: Mapping[Dialect, FreedCells], cells: int, metadata: MapMetadata
) -> str | None:
    """Return the remark on map_saver's unknown cells that are read as free, unless few are."""
    counts = {dialect: counter.count for dialect, counter in freed.items() if counter.count}
    most = max(counts.values(), default=0)
    if most == 0 or most < FREED_SHARE * cells:
        return None
    cells_of_grey = f"{most} cells ({percent(most, cells)}) of grey {MAP_SAVER_UNKNOWN}"
    text = f"{cells_of_grey}, which map_saver writes for unknown, are read as free"
    for number in sorted(set(counts.values()), reverse=True) if len(freed) > 1 else ():
        text += "" if number == most else f", {number} ({percent(number, cells)})"
        names = [name for name, count in counts.items() if count == number]
        text += f" by {join_words(names, 'and')}"
    return f"{text}; {_advice(freed, metadata)}"


def _advice(freed: Mapping[Dialect, FreedCells], metadata: MapMetadata) -> str:
    # Readers that average the opacity into the grey see a lighter one, which is free even with the
    # usual free_thresh. Digits are not rounded: 0.1960785 must not look like 0.196.
    by_opacity = [dialect for dialect, counter in freed.items() if counter.stay_free]
    parts = []
    if metadata.free_thresh > USUAL_FREE_THRESH:
        parts.append(f"lower free_thresh from {metadata.free_thresh!r} to {USUAL_FREE_THRESH}")
    if metadata.mode == "scale":
        parts.append("write mode: trinary, since scale grades the grey as nearly free")
    elif by_opacity:
        readers = f"{join_words(by_opacity, 'and')} average{'s' * (len(by_opacity) == 1)}"
        parts.append(f"save the image as a PGM, since {readers} the opacity into the grey")
    return ", and ".join(parts)


def percent(count: int, total: int) -> str:
    """Return a share in percent for messages, which reads 0 or 100 only if it is exactly that."""
    share = 100 * count / total
    if 0 < share < 0.001:
        return "below 0.001 %"
    if 99.9 < share < 100:
        return "above 99.9 %"
    return f"{share:.3g} %"


class PixelRemarks:
    def __init__(self, metadata: MapMetadata, dialect: Dialect) -> None:
        self._metadata = metadata
        self._dialect: Dialect = dialect
        self._freed = FreedCells(metadata, dialect)
        self._cells = self._lost = 0
        self._reads_indices = False

    def are_possible(self, picture: Picture) -> bool:
        return self._metadata.mode == "raw" or self._freed.are_possible(picture)

    def add(self, picture: Picture, occupancy: arrays.SignedBytes) -> None:
        self._cells += occupancy.size
        self._reads_indices = self._dialect == "ros1" and picture.colour == "palette"
        if self._metadata.mode == "raw":
            self._lost += count_of_lost(picture)
        else:
            self._freed.add(picture, occupancy)

    def warn(self, yaml_path: Path, image: Path) -> None:
        if self._reads_indices:
            warn_of(image, "ROS 1 reads indices of the palette, not colours", "image.palette")
        if self._lost:
            warn_of(image, remark_on_lost(self._lost), "image.raw-values")
        remark = remark_on_freed({self._dialect: self._freed}, self._cells, self._metadata)
        if remark is not None:
            warn_of(yaml_path, remark, "thresholds.unknown-becomes-free")


def count_of_lost(picture: Picture, times: arrays.Integers | None = None) -> int:
    """Return how many pixels of mode raw hold no value of a map; only 8-bit grey can."""
    # `times` is how often each pixel occurs, as in `FreedCells.add`.
    if picture.colour != "grey" or picture.maxval != 255:
        return 0
    return _count((picture.samples > OCCUPIED) & (picture.samples < 255), times)


def _count(mask: arrays.Mask, times: arrays.Integers | None) -> int:
    return int(np.count_nonzero(mask) if times is None else times[mask].sum())


def remark_on_lost(count: int) -> str:
    return f"{count} pixels of mode raw hold 101..254, read as unknown"


bare_geometry: ContextVar[tuple[float, Origin] | None] = ContextVar("geometry", default=None)
"""Resolution and origin of images named in place of a YAML file, and the resolution of states."""


def bare_images(resolution: float, origin: Origin) -> AbstractContextManager[None]:
    """Read images named in place of a YAML file as maps, with the usual thresholds."""
    return threads.set_within(bare_geometry, (resolution, origin))


def is_bare_image(path: Path) -> bool:
    return bare_geometry.get() is not None and path.suffix.lower() in IMAGE_SUFFIXES


def bare_image(path: Path) -> MapMetadata | None:
    """Return the metadata of an image that is read without a YAML file; None for other files."""
    geometry = bare_geometry.get()
    if geometry is None or not is_bare_image(path):
        return None
    if sources.yaml_at(path):
        text = "is read with --resolution; the .yaml beside it is ignored"
        warn_of(path, text, "image.yaml-not-read")
    return MapMetadata(path.name, *geometry)


def _header(path: Path) -> Path:
    """Return the YAML file; refuse an image in its place, unless it is read without one."""
    if path.suffix.lower() in IMAGE_SUFFIXES:
        sources.status_of(path)
        if not is_bare_image(path):
            sibling = path.with_suffix(".yaml")
            hint = "pass its .yaml, or --resolution R to read the image without one"
            hint = f"pass {sibling}" if sources.exists(sibling) else hint
            rule = "looks like an image, not a map's YAML"
            raise MalformedInputError(rule, source=path, hint=hint)
    return path


def _is_yaml_of_map(path: Path) -> bool:
    """Return whether a YAML file is that of a map, possibly a broken one: it has the key image."""
    try:
        head = sources.head_of(path, _HEAD)
        return sources.IMAGE_KEY.search(head) is not None or "image" in yaml_text.read_mapping(path)
    except FileAccessError:
        return True  # reading it as a map reports the error
    except errors.MapdealError:
        return False


class PairFile(map_file.MapFile):
    """An open YAML file and its image, or an image without a YAML file."""

    metadata: MapMetadata

    def __init__(
        self, path: Path, opened: ExitStack, dialect: Dialect, max_cells: int | None,
        bits: Path | None = None,
    ) -> None:  # fmt: skip
        states = {path: sources.state_of(path)}
        metadata = None if bits is not None else bare_image(path)
        if metadata is None:
            metadata = read_metadata(path, dialect=dialect)
            image = image_of(path, metadata, bits)
            states[image] = sources.state_of(image)
        super().__init__(path, states)
        self.metadata = metadata
        self._opened, self._dialect, self._max_cells = opened, dialect, max_cells

    @cached_property
    def _image(self) -> OpenImage:
        return self._opened.enter_context(open_image(self.files[-1], max_cells=self._max_cells))

    @cached_property
    def _rows(self) -> Callable[[slice], Strips] | None:
        # Faults of the image are reported when the map is read.
        with errors.capture_warnings() as self._remarks, suppress(errors.MapdealError):
            if self.metadata.cost_scale is None and isinstance(self._image, PnmImage):
                return self._image.rows()
        return None

    @property
    def shape_by_rows(self) -> tuple[int, int] | None:  # type: ignore[override]
        return None if self._rows is None else (self._image.height, self._image.width)

    def memory_to_read(self) -> int:
        return self._image.memory()

    def frame(self) -> Frame:
        return Frame(*self._image.shape, self.metadata.resolution, self.metadata.origin)

    def cells(self) -> OccupancyGrid | costmap.Costmap:
        metadata, image = self.metadata, self._image
        with image.strips() as strips:
            if metadata.cost_scale is not None:
                cost = np.empty(strips.shape, dtype=np.uint8)
                for rows, picture in strips.placed():
                    cost[rows] = costs_of(picture, image.file.path)[::-1]
                return costmap.Costmap(cost, metadata.resolution, metadata.origin)
            occupancy = np.empty(strips.shape, dtype=np.int8)
            remarks = PixelRemarks(metadata, self._dialect)
            for rows, picture in strips.placed():
                cells_of(picture, metadata, self._dialect, out=occupancy[rows])
                remarks.add(picture, occupancy[rows])
        remarks.warn(self.path, image.file.path)
        return _grid_of(occupancy, metadata)

    def rows(self, block_height: int, budget: blocks.CacheBudget | None) -> OccupancyGrid:
        if (read := self._rows) is None:
            raise ValueError(f"{self.path} cannot be read by rows")
        metadata, dialect, shape = self.metadata, self._dialect, self._image.shape
        for remark in self._remarks:
            emit_warning(remark)

        def decoded(rows: slice) -> arrays.SignedBytes:
            part = read(rows)
            cells = np.empty(part.shape, dtype=np.int8)
            for cell_rows, picture in part.placed():
                cells_of(picture, metadata, dialect, out=cells[cell_rows])
            return cells

        layer = blocks.lazy_layer(shape, np.int8, decoded, block_height=block_height, budget=budget)
        grid = _grid_of(layer, metadata)
        remarks = PixelRemarks(metadata, dialect)
        for _, picture in read(slice(0, shape[0])).placed():
            if not remarks.are_possible(picture):
                break
            remarks.add(picture, cells_of(picture, metadata, dialect))
        remarks.warn(self.path, self._image.file.path)
        return grid


def image_of(path: Path, metadata: MapMetadata, bits: Path | None) -> Path:
    """Return the image of a YAML file; `bits` is the bit map that it must name, if any."""
    return find_image(path, metadata.image) if bits is None else find_bits(bits, path, metadata)


def _grid_of(occupancy: blocks.Layer, metadata: MapMetadata) -> OccupancyGrid:
    if metadata.view is not None:
        return field.FieldView(occupancy, metadata.resolution, metadata.origin, metadata.view)
    return OccupancyGrid(occupancy, metadata.resolution, metadata.origin)


def find_image(yaml_path: Path, image: str) -> Path:
    # Relative names are relative to the YAML file. A name that is valid only on another machine
    # (other folders, a URL, backslashes) falls back to the file beside the YAML file, with a
    # warning.
    if _expanded(image) != image:
        text = f"image: {image} was expanded; map_server does not"
        warn_of(yaml_path, text, "image.foreign-path")
    folder = yaml_path.parent
    path, *fallbacks = image_places(folder, image)
    if sources.exists(path):
        return path
    for fallback in fallbacks:
        if sources.exists(fallback):
            name = fallback.relative_to(folder) if folder in fallback.parents else fallback
            text = f"image: {image} does not exist here; using {name} beside the YAML file"
            warn_of(yaml_path, text, "image.foreign-path")
            return fallback
    rule = "the image does not exist"
    hint = next(filter(None, map(_nearest_name, [path, *fallbacks[-1:]])), None)
    raise FileAccessError(rule, source=yaml_path, place="image", got=image, hint=hint)


def yaml_beside(path: Path) -> Path:
    if found := sources.yaml_at(path):
        return found
    sources.status_of(path)
    rule = f"has no {path.with_suffix('.yaml').name} beside it, which holds its origin"
    hint = "a bit map is two files, as mapdeal pack writes them"
    raise FileAccessError(rule, source=path, hint=hint)


def find_bits(path: Path, yaml_path: Path, metadata: MapMetadata) -> Path:
    sources.status_of(path)
    image = find_image(yaml_path, metadata.image)
    if not sources.is_same_file(image, path):
        rule = f"names another image than {path.name}"
        raise MalformedInputError(rule, source=yaml_path, place="image", got=metadata.image)
    return image


def image_places(folder: Path, image: str) -> list[Path]:
    """Return the places to look for the image that a YAML file in a folder names, in order."""
    places = [folder / _expanded(image)]
    if "\\" in image:
        places.append(folder / image.replace("\\", "/"))
    if image.startswith("file:"):
        image = unquote(image.removeprefix("file:"))
        places.append(folder / image)
    if places[0].is_absolute() and image.startswith(str(folder)):  # a path of this machine
        return places
    return [*places, folder / PureWindowsPath(image).name]


def _expanded(image: str) -> str:
    with suppress(ValueError):
        return os.path.expanduser(image) if image.startswith("~") else image  # noqa: PTH111
    return image


def _nearest_name(path: Path) -> str | None:
    """Return a hint that lists files with similar names, whatever their case or ending."""
    try:
        names = sources.contents_of(path.parent)[1]
    except FileAccessError:
        return None
    import difflib

    images = [n for n in names if n != path.name and not n.endswith(sources.YAML)]
    lower = {n.lower(): n for n in images}
    similar = [n for n in images if Path(n).stem.lower() == path.stem.lower()]
    close = difflib.get_close_matches(path.name.lower(), lower, n=3, cutoff=0.75)
    similar += [lower[n] for n in close]
    return f"the folder has {', '.join(dict.fromkeys(similar))}" if similar else None


def costs_of(picture: Picture, path: Path) -> arrays.Bytes:
    if picture.colour != "grey" or picture.maxval != 255 or picture.alpha is not None:
        rule = "an image of costs must have one 8-bit grey channel"
        raise MalformedInputError(rule, source=path, got=picture.colour)
    return picture.samples.astype(np.uint8, copy=False)


Encoding = Literal["occupancy", "costmap2d"]

_PIXELS_AT_ONCE = 1 << 20
_FREE_PIXEL, _UNKNOWN_PIXEL, _OCCUPIED_PIXEL = 254, 205, 0
_TRINARY_FREE, _TRINARY_OCCUPIED = 25, 65  # map_saver's defaults for graded values, percent


def pair_paths(output: Path) -> tuple[Path, Path]:
    # ``.pgm`` and ``.png`` are the image's ending, ``.yaml`` that of the YAML file of a PGM pair.
    if output.suffix in (".pgm", ".png"):
        return _checked_image_name(output), output.with_suffix(".yaml")
    return _checked_image_name(output.with_suffix(".pgm")), output


def _checked_image_name(image: Path) -> Path:
    try:
        image.name.encode()
    except UnicodeEncodeError:
        rule = "the name of a map is not UTF-8, which its YAML file requires"
        raise ParameterError(rule, source=image, hint="an .npz takes any name") from None
    return image


def write_pair(
    transaction: Transaction, output: Path, grid: OccupancyGrid | costmap.Costmap, *,
    mode: Mode | None = None, encoding: Encoding = "occupancy",
    extra: Mapping[str, Any] | None = None, painted: map_file.Painting | None = None, **_: Any,
) -> None:  # fmt: skip
    image, yaml_path = pair_paths(output)
    cost_scale: CostScale | None = None
    if isinstance(grid, costmap.Costmap):
        if mode not in (None, "raw"):
            raise ParameterError("costs are written in mode raw", place="mode", got=mode)
        mode, pixels = "raw", grid.cost
        if grid.scale == "occupancy":  # already the values that ROS publishes
            if encoding == "costmap2d":
                rule = "these costs are on the occupancy scale and have no costmap2d bytes"
                raise ParameterError(rule, place="encoding", got=encoding)
            pixels = _raw_pixels(pixels)
        elif encoding == "costmap2d":
            cost_scale = "costmap2d"
            emit_warning(f"{yaml_path}: holds costmap_2d's bytes, which map_server would misread")
        else:
            pixels = _pixels_of(pixels, occupancy_from_cost().view(np.uint8))
        write_image = _pixel_writer(image, pixels, grid)
    elif painted is not None:
        pixels, comment = painted
        mode, write_image = "trinary", _pixel_writer(image, pixels, grid, comment)
    else:
        is_raw = isinstance(grid, field.FieldView) or _has_graded_values(grid.occupancy)
        mode = mode or ("raw" if is_raw else "trinary")
        if mode == "trinary":
            grid = in_trinary(grid)
        write_image = _occupancy_writer(image, grid, mode)
    scaled = mode == "scale"
    metadata = MapMetadata(
        image=image.name, resolution=grid.resolution, origin=grid.origin, mode=mode,
        occupied_thresh=1.0 if scaled else 0.65, free_thresh=0.0 if scaled else 0.196,
        cost_scale=cost_scale,
        view=grid.scale if isinstance(grid, field.FieldView) and mode == "raw" else None,
        extra=extra or {},
    )  # fmt: skip
    transaction.write(image, write_image)
    transaction.write_bytes(yaml_path, yaml_of(metadata))


PAIR = map_file.MapFormat(
    "a map_server .yaml", sources.YAML, PairFile, is_yaml=True, is_map=_is_yaml_of_map,
    header=_header, grids=(OccupancyGrid, costmap.Costmap), write=write_pair, paths=pair_paths,
    images=(".pgm", ".png"),
)  # fmt: skip
BITS = map_file.MapFormat(
    "a .pbm with its .yaml", (sources.BIT_MAP,),
    lambda path, opened, dialect, most: PairFile(yaml_beside(path), opened, dialect, most, path),
    header=yaml_beside, in_folders=False,
)  # fmt: skip


def write_map_image(transaction: Transaction, image: Path, grid: OccupancyGrid) -> Mode:
    mode: Mode = "raw" if _has_graded_values(grid.occupancy) else "trinary"
    transaction.write(image, _occupancy_writer(image, grid, mode))
    return mode


def in_trinary(grid: OccupancyGrid) -> OccupancyGrid:
    # As map_saver does by default: 0..25 free, 65..100 occupied, all else unknown.
    lost = int(blocks.counts_of(grid.occupancy)[FREE + 1 : OCCUPIED].sum())
    if not lost:
        return grid
    emit_warning(f"{lost} values between 1 and 99 are lost in mode trinary")
    table = np.full(256, UNKNOWN, dtype=np.int8)
    table[FREE : _TRINARY_FREE + 1] = FREE
    table[_TRINARY_OCCUPIED : OCCUPIED + 1] = OCCUPIED
    return grid.with_values(blocks.looked_up(grid.occupancy, table))


def _has_graded_values(values: blocks.Layer) -> bool:
    return bool(blocks.counts_of(values)[FREE + 1 : OCCUPIED].any())


def _occupancy_writer(image: Path, grid: OccupancyGrid, mode: Mode) -> Writer:
    values = grid.occupancy
    if mode == "raw":
        return _pixel_writer(image, _raw_pixels(values), grid)
    if mode == "trinary":
        table = np.full(256, _UNKNOWN_PIXEL, dtype=np.uint8)
        table[FREE], table[OCCUPIED] = _FREE_PIXEL, _OCCUPIED_PIXEL
        return _pixel_writer(image, _pixels_of(values, table), grid)
    values = np.asarray(values)  # the opacity of unknown cells is a second layer
    shades = (100 - np.clip(np.arange(256), 0, 100)) / 100 * 255
    shades[255] = 128  # unknown, -1
    scaled = look_up(values, np.rint(shades).astype(np.uint8))
    unknown = values == UNKNOWN
    if not unknown.any():
        return _pixel_writer(image, scaled, grid)
    if image.suffix != ".png":
        rule = "mode scale needs transparent pixels for unknown cells, which pgm has not"
        hint = "write to a .png, or in mode raw"
        raise ParameterError(rule, source=image, place="mode", got=mode, hint=hint)
    rgba = np.dstack([scaled, scaled, scaled, np.where(unknown, 0, 255).astype(np.uint8)])
    return lambda file: png.write_png(file, np.ascontiguousarray(rgba[::-1]))


def _pixel_writer(
    image: Path, pixels: blocks.Layer, grid: Framed, comment: str | None = None
) -> Writer:
    """Return the writer of grey pixels, which come with row 0 in the south."""
    comment = comment or f"CREATOR: mapdeal {grid.resolution!r} m/pix"
    if image.suffix == ".png":
        array = pixels[:]  # PNG needs all rows, which fit the memory as those of a picture do
        return lambda file: png.write_png(file, np.ascontiguousarray(array[::-1]))
    return RowsWriter(pixels, lambda file: (begin_pgm(file, pixels, comment=comment), lambda: None))


def _pixels_of(values: blocks.Layer, table: arrays.Bytes) -> blocks.Layer:
    # The pixels are computed band by band during writing, so they never fill an array.
    if blocks.is_lazy(values):
        return blocks.looked_up(values, table)
    height = max(1, _PIXELS_AT_ONCE // values.shape[1])
    return blocks.lazy_layer(
        values.shape, np.uint8, lambda rows: look_up(values[rows], table), block_height=height
    )


def _raw_pixels(values: blocks.Layer) -> blocks.Layer:
    return blocks.mapped(values, np.uint8, lambda part: part.view(np.uint8))  # -1 is 255 already


def read_bit_map(
    path: Path | str, *, max_cells: int | None = None, max_memory: int | None = None
) -> BitMap:
    """Read a bit map without expanding it to one byte per cell.

    Parameters
    ----------
    path : path or str
        A ``.pbm`` file with its ``.yaml`` next to it.
    max_cells : int, optional
        Largest number of cells to read, 1e9 by default.
    max_memory : int, optional
        Memory limit, bytes; by default half of the free memory.

    Returns
    -------
    BitMap
        Black pixels are obstacles, 1; with ``negate: 1`` in the YAML file, white ones are.

    Raises
    ------
    FileAccessError
        If one of the files cannot be read.
    MalformedInputError
        If one of the files is malformed, or they do not belong together.
    """
    with sources.use_memory(max_memory):
        return read_bit_map_pair(Path(path), max_cells=max_cells)[0]


def read_bit_map_pair(
    path: Path, *, max_cells: int | None = None
) -> tuple[BitMap, MapMetadata, tuple[Path, Path]]:
    if path.suffix.lower() != sources.BIT_MAP:
        rule = "a bit map must be a .pbm"
        hint = "pass the .pbm that the YAML names" if path.suffix in sources.YAML else None
        raise ParameterError(rule, source=path, got=path.suffix, hint=hint)
    yaml_path = yaml_beside(path)
    metadata = read_metadata(yaml_path)
    find_bits(path, yaml_path, metadata)
    refused = partial(MalformedInputError, source=yaml_path)
    if metadata.cost_scale is not None:
        raise refused("a bit map cannot hold costs", place="cost_scale")
    if metadata.mode == "raw":
        raise refused("must be trinary for a bit map", place="mode", got=metadata.mode)
    with opened(path) as file:
        image = PnmImage(file) if max_cells is None else PnmImage(file, max_cells)
        packed = image.bits()[::-1]  # image rows run from the north, grid rows from the south
    packed = ~packed if metadata.negate else packed
    bits = BitMap(packed, image.width, metadata.resolution, metadata.origin)
    return bits, metadata, (path, yaml_path)


def bit_map_paths(output: Path) -> tuple[Path, Path]:
    if output.suffix != sources.BIT_MAP:
        raise ParameterError("a bit map must end in .pbm", source=output, got=output.suffix)
    return _checked_image_name(output), output.with_suffix(".yaml")


def write_bit_map_pair(
    transaction: Transaction, output: Path, bits: BitMap, *, extra: Mapping[str, Any] | None = None
) -> None:
    """Write a bit map as PBM P4 and its YAML, which any map_server reads as a trinary map."""
    picture, yaml_path = bit_map_paths(output)
    metadata = MapMetadata(picture.name, bits.resolution, bits.origin, extra=extra or {})
    transaction.write(picture, lambda file: write_pbm(file, bits.packed[::-1], bits.width))
    transaction.write_bytes(yaml_path, yaml_of(metadata))


def write_bit_map(path: Path | str, bits: BitMap, *, force: bool = False) -> None:
    """Write a bit map.

    Parameters
    ----------
    path : path or str
        A ``.pbm`` file; its ``.yaml`` is written next to it. Missing folders are created.
    bits : BitMap
        Bit map to write.
    force : bool
        Whether to replace existing files.

    Raises
    ------
    FileAccessError
        If a file exists and `force` is not set, or cannot be written; nothing is changed then.
    """
    output = Path(path)
    with Transaction(bit_map_paths(output), force=force) as transaction:
        write_bit_map_pair(transaction, output, bits)
