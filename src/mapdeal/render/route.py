"""A route over the picture of a map."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.frame import Frame
from mapdeal.grid.route import Route
from mapdeal.render import colours
from mapdeal.render.canvas import Swatch
from mapdeal.render.overlay import brush_on
from mapdeal.render.raster import Raster

ROUTE_COLOURS = [colours.ROUTE, colours.START, colours.GOAL, colours.MINIMUM]
"""What a palette needs for a route, one after the other."""


def draw_route(
    pixels: NDArray[np.uint8], route: Route, frame: Frame, raster: Raster, first_index: int
) -> list[Swatch]:
    """Draw a route on the pixels of a map, in place; return its legend.

    Parameters
    ----------
    pixels : numpy.ndarray of uint8, shape (H, W)
        Palette indices, row 0 in the south.
    route : Route
        The route, in the map frame.
    frame : Frame
        The map's geometry.
    raster : Raster
        How its cells became pixels.
    first_index : int
        Where `ROUTE_COLOURS` begin in the palette.
    """
    line, start, goal, minimum = (first_index + k for k in range(len(ROUTE_COLOURS)))
    scale = raster.enlarge / raster.reduce
    side = max(pixels.shape)
    radius = max(4.0, side / 110)

    def place_of(points: object) -> NDArray[np.float64]:
        return frame.continuous_rowcol_from_xy(points)[:, ::-1] * scale  # type: ignore[arg-type]

    swatches = []
    with brush_on(pixels) as brush:
        if len(route.points_xy):
            brush.polyline(
                place_of(route.points_xy), line, thickness=max(3, round(side / 250))
            )  # fmt: skip
            swatches.append(Swatch(line, "route"))
        brush.dot(place_of([route.goal])[0], goal, radius=radius)
        brush.dot(place_of([route.start])[0], start, radius=radius)
        swatches += [Swatch(start, "start"), Swatch(goal, "goal")]
        if route.local_minimum is not None:
            brush.dot(place_of([route.local_minimum])[0], minimum, radius=radius)
            swatches.append(Swatch(minimum, "local minimum"))
    return swatches


def route_text(route: Route) -> str:
    """Return what there is to know of a route, for a subtitle."""
    if not len(route.points_xy):
        return "no route"
    text = f"{route.length:.4g} m"
    if math.isfinite(route.min_clearance):
        text += f", clearance {route.min_clearance:.3g} m"
    return text if route.reached else f"stopped after {text}"
