"""Pictures of grids, of routes over them, and of comparisons, as the commands draw them."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from mapdeal import errors, records
from mapdeal.commands import diff, merge
from mapdeal.commands.score import Score
from mapdeal.files.transaction import Transaction
from mapdeal.grid import field, footprint, reach, values
from mapdeal.grid.bit_map import BitMap
from mapdeal.grid.costmap import CostCurve
from mapdeal.mapping.build import BuiltMap
from mapdeal.mapping.local_map import LocalMap
from mapdeal.mapping.transforms import check_pose
from mapdeal.maps.npz import Grid
from mapdeal.maps.png import write_png
from mapdeal.pictures import cost_curve, overlay
from mapdeal.pipeline.folder import PICTURE, files_of, together
from mapdeal.pipeline.settings import Settings

Drawable = Grid | BitMap | LocalMap | BuiltMap | diff.DiffReport | merge.Merged | Score | CostCurve

_NOTHING_OVER = {diff.DiffReport: "a comparison", merge.Merged: "merged maps", Score: "a score",
                 CostCurve: "a cost curve"}  # fmt: skip

# Pixels along the longest side: a notebook keeps its pictures, and shows few more. Maps of up to
# so many cells look as those of commands do.
_IN_NOTEBOOKS = 1200
# Most cells that notebooks draw unasked: about a second's work, and less than 1 GB.
_MOST_CELLS, _MOST_CELLS_OF_POTENTIAL = 100_000_000, 4_000_000


@records.dataclass(frozen=True, eq=False, repr=False)
class Picture(values.OneLineRepr):
    r"""A picture that notebooks display, and that can be written or converted to an array.

    Parameters
    ----------
    indices : numpy.ndarray of uint8, shape (H, W)
        Palette index of each pixel. Row 0 is the top, the north of a map.
    palette : numpy.ndarray of uint8, shape (256, 3)
        Red, green and blue of each palette entry.

    Examples
    --------
    >>> picture = Picture(np.array([[0, 1]], np.uint8), np.eye(256, 3, dtype=np.uint8) * 255)
    >>> picture
    Picture(2 x 1 pixels)
    >>> picture.rgb().tolist()
    [[[255, 0, 0], [0, 255, 0]]]
    >>> picture.png()[:4]
    b'\x89PNG'
    """

    indices: NDArray[np.uint8]
    palette: NDArray[np.uint8]

    def png(self) -> bytes:
        """Return the picture as PNG bytes, as a command writes them."""
        file = io.BytesIO()
        write_png(file, self.indices, self.palette)
        return file.getvalue()

    def rgb(self) -> NDArray[np.uint8]:
        """Return red, green and blue of each pixel, shape (H, W, 3)."""
        return self.palette[self.indices]

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[Any]:
        """Return `rgb`, so that matplotlib accepts the picture directly."""
        return self.rgb().astype(dtype or np.uint8, copy=bool(copy))

    def _repr_png_(self) -> bytes:
        return self.png()

    def _repr_parts(self) -> Iterator[str]:
        height, width = self.indices.shape
        yield f"{width} x {height} pixels"


def draw_picture(
    shown: Drawable, *, title: str | None = None, route: reach.Route | None = None,
    pose: Sequence[float] | None = None, robot: footprint.Footprint | None = None,
    image_max: int = overlay.DEFAULT_IMAGE_MAX,
    image_extent: overlay.ImageExtent = overlay.DEFAULT_EXTENT,
) -> Picture:  # fmt: skip
    """Draw a grid, a result or a cost curve, as the commands do.

    Parameters
    ----------
    shown : grid, BitMap, LocalMap, BuiltMap, DiffReport, Merged, Score or CostCurve
        Object to draw. A local map includes the robot; a map built from scans lacks its evidence.
    title : str, optional
        Title above the map; by default the kind of object.
    route : Route, optional
        Route to draw over the map.
    pose : sequence of float, optional
        Robot pose to draw over the map: x, y (metres) and yaw (radians).
    robot : Footprint, optional
        Robot shape to draw to scale in a corner, as in the commands' pictures about a robot.
    image_max : int
        Longest side of the map, pixels; 0 for one pixel per cell. Larger maps are reduced by a
        whole factor that preserves obstacles. Cost curves have a fixed size.
    image_extent : {'known', 'all'}
        Area to draw: the known cells with a margin, or the whole map.

    Returns
    -------
    Picture
        Picture with a legend, a scale bar and the map coordinates along its edges.

    Raises
    ------
    ParameterError
        If the object cannot be drawn, a number is invalid, or a route, pose or robot is given
        with a comparison, merged maps, a score or a cost curve.

    Examples
    --------
    >>> from mapdeal import OccupancyGrid, esdf
    >>> picture = draw_picture(esdf(OccupancyGrid([[100, 0, 0, -1]], 0.5)))
    >>> picture.rgb().shape[2]
    3
    """
    settings = Settings(image_max=image_max, image_extent=image_extent)
    look: Any = {"image_max": settings.image_max, "image_extent": settings.image_extent}
    if title is not None and not isinstance(title, str):
        raise errors.ParameterError("must be a text", place="title", got=title)
    if route is not None and not isinstance(route, reach.Route):
        hint = "mapdeal.route returns one"
        raise errors.ParameterError("must be a Route", place="route", got=route, hint=hint)
    if robot is not None and not isinstance(robot, footprint.Footprint):
        raise errors.ParameterError("must be a Footprint", place="robot", got=robot)
    for kind, name in _NOTHING_OVER.items():
        if isinstance(shown, kind) and (route is not None or pose is not None or robot is not None):
            raise errors.ParameterError(f"nothing can be drawn over {name}", place="route, pose")
    if isinstance(shown, diff.DiffReport | merge.Merged | Score):
        image = shown.drawn(title=title, **look)
    elif isinstance(shown, CostCurve):
        image = cost_curve.cost_curve_image(shown, title=errors.one_line(title or "cost curve"))
    else:
        grid, name = _grid_in(shown)
        if pose is None and isinstance(shown, LocalMap):
            pose = shown.pose
        over: list[overlay.Overlay] = [] if route is None else [overlay.RouteOverlay(route)]
        over += [] if pose is None else [overlay.PoseOverlay(check_pose(pose))]
        over += [] if robot is None else [overlay.RobotOverlay(robot)]
        look["overlay"] = together(over)
        image = files_of(type(grid)).draw(grid, title=errors.one_line(title or name), **look)
    return Picture(image.indices, image.palette)


def write_picture(
    path: str | PathLike[str], shown: Drawable | Picture, *, title: str | None = None,
    route: reach.Route | None = None, pose: Sequence[float] | None = None,
    robot: footprint.Footprint | None = None, image_max: int = overlay.DEFAULT_IMAGE_MAX,
    image_extent: overlay.ImageExtent = overlay.DEFAULT_EXTENT, force: bool = False,
) -> None:  # fmt: skip
    """Write a picture of a grid, a result or a cost curve as a PNG.

    Parameters
    ----------
    path : path or str
        Output path, ``.png``. Missing folders are created.
    shown : Picture, grid, BitMap, LocalMap, BuiltMap, DiffReport, Merged, Score or CostCurve
        Picture to write, or object to draw.
    title, route, pose, robot, image_max, image_extent
        As for `draw_picture`; not for a `Picture`.
    force : bool
        Whether to replace an existing file.

    Raises
    ------
    ParameterError
        As for `draw_picture`, and if the path does not end in ``.png``.
    FileAccessError
        If the file exists and `force` is false, or it cannot be written.
    """
    output = Path(path)
    if output.suffix != PICTURE:
        raise errors.ParameterError("a picture must end in .png", source=output)
    drawn: Any = {"title": title, "route": route, "pose": pose, "robot": robot}
    if isinstance(shown, Picture):
        if any(value is not None for value in drawn.values()):
            raise errors.ParameterError("is drawn already", place="shown", got=shown)
        picture = shown
    else:
        picture = draw_picture(shown, **drawn, image_max=image_max, image_extent=image_extent)
    with Transaction([output], force=force) as transaction:
        transaction.write_bytes(output, picture.png())


def png_of(shown: object) -> bytes | None:
    """Return the PNG that notebooks display, None if drawing it would take long."""
    if not isinstance(shown, Drawable) or (isinstance(shown, Score) and not shown.is_drawn):
        return None
    if not isinstance(shown, diff.DiffReport | Score | CostCurve):
        grid = shown.grid if isinstance(shown, merge.Merged) else _grid_in(shown)[0]
        most = _MOST_CELLS_OF_POTENTIAL if isinstance(grid, field.PotentialField) else _MOST_CELLS
        if grid.is_lazy or grid.shape[0] * grid.shape[1] > most:
            return None
    return draw_picture(shown, image_max=_IN_NOTEBOOKS).png()


def _grid_in(shown: object) -> tuple[Grid, str]:
    if isinstance(shown, LocalMap | BuiltMap):
        return shown.grid, "local map" if isinstance(shown, LocalMap) else "map of scans"
    if isinstance(shown, BitMap):
        return shown.to_occupancy(), shown.kind
    if isinstance(shown, Grid):
        return shown, shown.kind
    rule = "must be a grid, a bit map, a local map, a map of scans, merged maps, a comparison, "
    raise errors.ParameterError(f"{rule}a score or a cost curve", place="shown", got=shown)
