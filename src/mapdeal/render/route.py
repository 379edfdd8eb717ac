"""A route over the picture of a map."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.frame import Frame
from mapdeal.grid.route import Route
from mapdeal.records import dataclass
from mapdeal.render import colours
from mapdeal.render.colours import Colour
from mapdeal.render.overlay import Brush, place_of
from mapdeal.render.raster import Raster
from mapdeal.render.style import Swatch


@dataclass(frozen=True)
class RouteOverlay:
    """A route with its ends, and the local minimum that it may have stopped in."""

    route: Route

    @property
    def colours(self) -> list[Colour]:
        """Of the line, the start, the goal and the minimum."""
        return [colours.ROUTE, colours.START, colours.GOAL, colours.MINIMUM]

    @property
    def text(self) -> str:
        """The route's length and clearance."""
        route = self.route
        if not len(route.points_xy):
            return "no route"
        text = f"{route.length:.4g} m"
        if math.isfinite(route.min_clearance):
            text += f", clearance {route.min_clearance:.3g} m"
        return text if route.reached else f"stopped after {text}"

    @property
    def places_xy(self) -> NDArray[np.float64]:
        """The way, and its ends."""
        return np.concatenate([self.route.points_xy, [self.route.start, self.route.goal]])

    def draw(
        self, pixels: NDArray[np.uint8], frame: Frame, raster: Raster, first_index: int
    ) -> list[Swatch]:
        """Draw the route; see `Overlay`."""
        route = self.route
        line, start, goal, minimum = (first_index + k for k in range(4))
        side = max(pixels.shape)
        radius = max(4.0, side / 110)
        swatches = []
        brush = Brush(pixels)
        if len(route.points_xy):
            path = place_of(route.points_xy, frame, raster)
            brush.polyline(path, line, thickness=max(3, round(side / 250)))
            swatches.append(Swatch(line, "route"))
        ends = [(route.goal, goal), (route.start, start)]
        swatches += [Swatch(start, "start"), Swatch(goal, "goal")]
        if route.local_minimum is not None:
            ends.append((route.local_minimum, minimum))
            swatches.append(Swatch(minimum, "local minimum"))
        for point, index in ends:
            brush.dot(place_of([point], frame, raster)[0], index, radius=radius)
        return swatches
