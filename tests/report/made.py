"""Reports made by hand, of grids that the library makes."""

import numpy as np

import mapdeal
from mapdeal.pictures import colours
from mapdeal.pictures.colours import ColourBar, LayerStyle, Scale, Swatch
from mapdeal.pictures.styles import COST_LEVELS, CostPalette
from mapdeal.report.document import Entry, PageLayer

FREE_LEVELS, OBSTACLE_LEVELS = 70, 49


def states_style():
    by_value = np.full(256, 101, dtype=np.uint8)
    by_value[:101] = np.arange(101)
    grey = np.rint(255 - 2.55 * np.arange(101)).astype(np.uint8)
    return LayerStyle(
        np.vstack([np.repeat(grey[:, None], 3, axis=1), [colours.RVIZ_UNKNOWN]]).astype(np.uint8),
        by_value=by_value,
        swatches=(Swatch(100, "occupied"), Swatch(0, "free"), Swatch(101, "unknown")),
        labels={0: "free", 100: "occupied", 255: "unknown"},
    )


def field_style(distance):
    finite = distance[np.isfinite(distance)]
    high = float(finite.max()) if len(finite) else 1.0
    low = min(-high * OBSTACLE_LEVELS / FREE_LEVELS, float(finite.min()) if len(finite) else 0.0)
    side = np.vstack([
        colours.interpolated(colours.OBSTACLE_ANCHORS, OBSTACLE_LEVELS)[::-1],
        colours.interpolated(colours.FREE_ANCHORS, FREE_LEVELS),
    ])  # fmt: skip
    faded = colours.mixed(side, colours.RVIZ_UNKNOWN, 0.6)
    levels = len(side)
    middle = -low / (high - low)
    ticks = [(0.0, f"{low:.2g}"), (middle, "0"), (1.0, f"{high:.2g}")]
    return LayerStyle(
        np.vstack([side, faded, [colours.LINE, colours.RVIZ_UNKNOWN]]).astype(np.uint8),
        scale=Scale(low, high, 0, levels),
        swatches=(Swatch(2 * levels, "obstacle edge"),),
        bar=ColourBar(tuple(range(levels)), ticks, "distance, m"),
        nowhere=2 * levels + 1,
        line=2 * levels,
        faded_by=levels,
    )


def cost_style():
    own = CostPalette.of("costmap2d")
    top = own.highest_graded
    return LayerStyle(
        own.colours,
        by_value=own.by_value,
        swatches=(
            Swatch(own.lethal, "lethal 254"), Swatch(own.inscribed, "inscribed 253"),
            Swatch(own.free, "free 0"), Swatch(own.unknown, "unknown"),
        ),
        bar=ColourBar(
            range(COST_LEVELS), [(v / top, str(v)) for v in (1, 50, 100, 150, 200, 252)], "cost"
        ),
        labels={0: "free", 253: "inscribed", 254: "lethal", 255: "unknown"},
    )  # fmt: skip


def layers_of(grid, *, inscribed_radius=0.2, inflation_radius=0.8, **more):
    """Return the map, its distance field and its costs, as the page takes them."""
    field = mapdeal.esdf(grid)
    costs = mapdeal.exponential_cost(
        grid, inscribed_radius=inscribed_radius, inflation_radius=inflation_radius
    )
    states = PageLayer(
        "occupancy", "Map", grid.frame, np.asarray(grid.occupancy).view(np.uint8), states_style(),
        rank=(np.arange(256) + 1).astype(np.uint8),
    )  # fmt: skip
    distance = np.asarray(field.distance)
    metres = PageLayer(
        "esdf", "Signed distance", field.frame, distance, field_style(distance), unit="m",
        pooled="smallest", states="occupancy", convention=field.convention,
    )  # fmt: skip
    cost = PageLayer(
        "cost", "Cost", costs.frame, np.asarray(costs.cost).view(np.uint8), cost_style(),
        rank=(np.arange(256) + 1).astype(np.uint8),
    )  # fmt: skip
    return (states, metres, cost), field, costs


def entry_of(grid, name="office", **more):
    layers, _, _ = layers_of(grid)
    return Entry(name, layers, **more)
