"""Draw the pictures of the documentation.

Run it as ``python docs/figures.py [intel-corrected.log]``. Needs matplotlib (in the extra ``dev``).
Reads examples and writes docs/images; the pictures of the Intel lab only if its log is given.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray

import mapdeal
from mapdeal.checks.difference import changes_of, states_of
from mapdeal.formats.png import write_indexed_png
from mapdeal.formats.scans.reader import open_log
from mapdeal.render.canvas import Swatch
from mapdeal.render.colours import Colour
from mapdeal.render.difference import difference_image
from mapdeal.render.layers import cost_image, field_image, occupancy_image
from mapdeal.render.overlay import Brush, Overlay, place_of
from mapdeal.render.pose import PoseOverlay
from mapdeal.render.potential import potential_image
from mapdeal.render.raster import Raster
from mapdeal.render.route import RouteOverlay
from mapdeal.stages.cost_profile import cost_table

mpl.use("Agg")  # draws without a display

DOCS = Path(__file__).parent
IMAGES = DOCS / "images"
MAPS = DOCS.parent / "examples" / "maps"

INSCRIBED, CIRCUMSCRIBED = 0.2, 0.35  # metres, the example robot of the curve
RESOLUTION = 0.05  # metres per cell
FOOTPRINT = "[[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]]"
LONG_SIDE = 900  # pixels of a picture of a map

LETHAL_COLOUR = "#4d4d57"
INSCRIBED_COLOUR = "#7fd6dc"
POSSIBLE_COLOUR = "#f9c98b"
FADING_COLOUR = "#fdf3cf"
FREE_COLOUR = "#ffffff"
CURVE_COLOUR = "#5c0c5c"


COMPARED = ((-4.475, 2.925), (6.925, 5.025))  # start and goal of the routes that are compared
ROUTE_COLOURS = [(0, 100, 255), (225, 110, 0), (20, 150, 70)]


@dataclass(frozen=True)
class Routes:
    """Routes of several methods over the picture of a map."""

    routes: dict[str, mapdeal.Route]

    @property
    def colours(self) -> list[Colour]:
        """Of each route, in order."""
        return ROUTE_COLOURS[: len(self.routes)]

    @property
    def text(self) -> str:
        """The routes' mean clearances."""
        means = (f"{name} {route.mean_clearance:.2f} m" for name, route in self.routes.items())
        return f"mean clearance: {', '.join(means)}"

    def draw(
        self, pixels: NDArray[np.uint8], frame: mapdeal.Frame, raster: Raster, first_index: int
    ) -> list[Swatch]:
        """Draw the routes; see `Overlay`."""
        brush = Brush(pixels)
        swatches = []
        for index, (name, route) in enumerate(self.routes.items(), first_index):
            path = place_of(route.points_xy, frame, raster)
            brush.polyline(path, index, thickness=3)
            swatches.append(Swatch(index, name))
        return swatches


def main() -> None:
    """Draw every picture."""
    IMAGES.mkdir(exist_ok=True)
    draw_cost_curves(IMAGES / "cost_curve.png")
    draw_arena()
    draw_office()
    for log in sys.argv[1:]:
        draw_intel(Path(log))


def draw_cost_curves(path: Path) -> None:
    """Draw the exponential model's cost against the distance, for two sets of parameters."""
    figure, axes = plt.subplots(2, 1, figsize=(9.0, 9.4))
    _draw_curve(axes[0], inflation_radius=0.55, cost_scaling_factor=5.0, end=0.75)
    _draw_curve(axes[1], inflation_radius=1.75, cost_scaling_factor=2.58, end=2.05)
    axes[1].set_xlabel("distance d from the nearest obstacle cell, centre to centre (m)")
    figure.suptitle(
        f"A robot with inscribed radius {INSCRIBED:g} m and circumscribed radius "
        f"{CIRCUMSCRIBED:g} m, on a map of {RESOLUTION:g} m per cell",
        fontsize=12,
    )
    figure.tight_layout(rect=(0, 0, 1, 0.985), h_pad=2.0)
    figure.savefig(path, dpi=100, metadata={"Software": None}, pil_kwargs={"optimize": True})
    plt.close(figure)


def _draw_curve(
    axes: plt.Axes, *, inflation_radius: float, cost_scaling_factor: float, end: float
) -> None:
    line_d, line_cost = _curve(inflation_radius, cost_scaling_factor, end)
    dots_d, dots_cost = _dots(inflation_radius, cost_scaling_factor)
    lethal_end = RESOLUTION / 2
    zones = [
        (-lethal_end, lethal_end, LETHAL_COLOUR, "lethal\n254"),
        (lethal_end, INSCRIBED, INSCRIBED_COLOUR, "inscribed\n253"),
        (INSCRIBED, CIRCUMSCRIBED, POSSIBLE_COLOUR, "possibly\ncircumscribed"),
        (CIRCUMSCRIBED, inflation_radius, FADING_COLOUR, "no collision,\ncost falls off"),
        (inflation_radius, end, FREE_COLOUR, "free\n0"),
    ]
    top = 254
    heights = [306, 306, 306, 306, 306]
    if end > 1:  # the narrow zones' names stand in two rows
        heights = [372, 306, 372, 306, 306]
    for (left, right, colour, name), height in zip(zones, heights, strict=True):
        axes.axvspan(left, right, color=colour, zorder=0, lw=0)
        middle = (max(left, -lethal_end) + right) / 2
        axes.text(middle, height, name, ha="center", va="center", fontsize=10, zorder=5)
        if height > 330:
            axes.plot([middle, middle], [height - 28, 276], color="0.35", lw=0.8, zorder=4)
    axes.axhspan(272, 420, color="white", zorder=3, lw=0)

    axes.plot(line_d, line_cost, color=CURVE_COLOUR, lw=2, zorder=6)
    axes.plot(dots_d, dots_cost, "o", color=CURVE_COLOUR, ms=3.5, zorder=7, clip_on=False)
    axes.plot(0, top, "s", color="black", ms=6, zorder=8)

    circumscribed_cost = _cost_at(CIRCUMSCRIBED, cost_scaling_factor)
    cliff = _cost_at(inflation_radius, cost_scaling_factor)
    span = end + lethal_end
    axes.plot(CIRCUMSCRIBED, circumscribed_cost, "o", mfc="white", mec="black", ms=8, zorder=9)
    axes.annotate(
        f"circumscribed_cost = {circumscribed_cost}:\nfrom this cost on upwards\n"
        "a collision depends on\nthe heading",
        (CIRCUMSCRIBED, circumscribed_cost),
        (CIRCUMSCRIBED + 0.02 * span, max(circumscribed_cost + 55, 212)),
        fontsize=10,
        va="center",
        arrowprops={"arrowstyle": "-", "color": "0.2", "shrinkB": 5},
        zorder=10,
    )
    axes.annotate(
        f"last cost: {cliff}\nat inflation_radius {inflation_radius:g} m",
        (inflation_radius, cliff),
        (inflation_radius + (0.015 if end < 1 else -0.03) * span, cliff + 62),
        fontsize=10,
        va="center",
        ha="left" if end < 1 else "right",
        arrowprops={"arrowstyle": "-", "color": "0.2", "shrinkB": 3},
        zorder=10,
    )
    for radius, name in ((INSCRIBED, "inscribed"), (CIRCUMSCRIBED, "circumscribed")):
        axes.axvline(radius, ymax=272 / 410, color="0.25", lw=0.9, ls=(0, (4, 3)), zorder=2)
        axes.annotate(
            name + "\nradius",
            (radius, 0),
            (radius - 0.006 * span, 6),
            rotation=90,
            fontsize=9,
            ha="right",
            va="bottom",
            linespacing=1.0,
            color="0.2",
            zorder=5,
        )
    axes.set_title(
        f"inflation_radius {inflation_radius:g} m, cost_scaling_factor {cost_scaling_factor:g} /m",
        fontsize=12,
        fontweight="bold",
        loc="left",
    )
    axes.set_ylabel("cost (costmap2d scale)")
    axes.set_xlim(-lethal_end, end)
    axes.set_ylim(0, 410 if end > 1 else 345)
    axes.set_yticks([0, 50, 100, 150, 200, 252])
    axes.set_xticks(np.arange(0, end + 1e-9, 0.1 if end < 1 else 0.25))
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    axes.spines["left"].set_bounds(0, 272)


def _curve(
    inflation_radius: float, cost_scaling_factor: float, end: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return distances and costs along one row of fine cells beside an obstacle."""
    fine = 0.001
    row = np.zeros((1, round(end / fine) + 1), dtype=np.int8)
    row[0, 0] = 100
    costmap = mapdeal.exponential_cost(
        mapdeal.OccupancyGrid(row, resolution=fine),
        inscribed_radius=INSCRIBED,
        inflation_radius=inflation_radius,
        cost_scaling_factor=cost_scaling_factor,
    )
    return np.arange(row.size)[1:] * fine, costmap.cost[0, 1:]


def _dots(
    inflation_radius: float, cost_scaling_factor: float
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Return the distances that occur between cells of the map, and their costs."""
    reach = round(inflation_radius / RESOLUTION)
    table = cost_table(
        reach,
        resolution=RESOLUTION,
        inscribed_radius=INSCRIBED,
        cost_scaling_factor=cost_scaling_factor,
    )
    along = np.arange(1, reach + 1) ** 2  # along a row or a column
    return np.sqrt(along) * RESOLUTION, table[along]


def _cost_at(distance: float, cost_scaling_factor: float) -> int:
    cells = round(distance / RESOLUTION)
    table = cost_table(
        cells,
        resolution=RESOLUTION,
        inscribed_radius=INSCRIBED,
        cost_scaling_factor=cost_scaling_factor,
    )
    return int(table[cells * cells])


def draw_arena() -> None:
    """Draw the simulated world before and after the stage ``active``, and its costs."""
    arena = mapdeal.read_map(MAPS / "arena.yaml")
    region = mapdeal.active_region(arena)
    _picture("arena.png", arena, "arena: the whole canvas", side=500)
    _picture("arena_active.png", region, "arena: active region")
    field = mapdeal.esdf(mapdeal.inflate(region, kernel="square"), unknown="occupied")
    cost = mapdeal.threshold_cost(
        field, down_distance=1.0, up_distance=0.5, down_factor=0.5, up_factor=1.0
    )
    _picture("arena_cost.png", cost, "arena: cost, recipe arena")


def draw_office() -> None:
    """Draw what each stage makes of the office, cropped so that the pictures stay small."""
    office = mapdeal.active_region(mapdeal.read_map(MAPS / "office.yaml"), margin=0.5)
    inflated = mapdeal.inflate(office)
    field = mapdeal.esdf(inflated)
    robot = mapdeal.Footprint.parse(FOOTPRINT)
    around_robot = mapdeal.apply_recipe(office, "nav2", footprint=robot)["cost"]
    threshold = mapdeal.threshold_cost(mapdeal.esdf(office))
    rings = mapdeal.ring_cost(office)
    square = mapdeal.inflate(office, kernel="square")
    _picture("office.png", office, "office: the map")
    _picture("office_inflated.png", inflated, "office: inflated by 0.3 m, disc")
    _picture("office_inflated_square.png", square, "office: inflated by 0.3 m, square")
    _picture("office_esdf.png", field, "office: distance field of the inflated map")
    _picture("office_cost.png", mapdeal.exponential_cost(field), "office: cost, recipe default")
    _picture("office_cost_nav2.png", around_robot, "office: cost, recipe nav2, with a footprint")
    _picture("office_cost_threshold.png", threshold, "office: cost, model threshold")
    _picture("office_cost_rings.png", rings, "office: cost, model rings")
    zones = mapdeal.read_shapes(MAPS.parent / "shapes" / "office_zones.yaml")
    mask = mapdeal.draw(mapdeal.blank(office, -1), zones, overlay="max")
    masked = mapdeal.apply_keepout_mask(
        mapdeal.exponential_cost(
            office, inscribed_radius=0.22, inflation_radius=0.7, cost_scaling_factor=3.0
        ),
        mask,
    )
    goal = (9.0, 5.0)
    costmap = mapdeal.apply_recipe(office, "nav2")["cost"]
    route = mapdeal.shortest_route(costmap, (-7.5, 2.5), goal)
    _picture("office_route.png", costmap, "office: route, astar", overlay=RouteOverlay(route))
    routes = {
        "plain": mapdeal.shortest_route(costmap, *COMPARED),
        "in the cost": mapdeal.shortest_route(costmap, *COMPARED, field_weight=1.0),
        "in the heuristic": mapdeal.shortest_route(costmap, *COMPARED, heuristic_weight=2.0),
    }
    _picture("office_pairs.png", office, "office: where the field acts", overlay=Routes(routes))
    attraction = mapdeal.potential(office, goal=goal, attractive_gain=50.0)
    _picture("office_potential.png", attraction, "office: potential field")
    trapped = mapdeal.descend(costmap, attraction, (-7.5, 2.5))
    _picture("office_descent.png", costmap, "office: route, descent", overlay=RouteOverlay(trapped))
    _local_pictures(office)
    _picture("office_mask.png", masked, "office: cost, inscribed 0.22 m, with a keepout mask")


def draw_intel(log: Path) -> None:
    """Draw a corner of the Intel Research Lab as each method sees it, and what differs."""
    scans = [mapdeal.Scans(*arrays) for arrays in open_log(log).scans()]
    corners = {}
    for method in ("log-odds", "counting", "tsdf"):
        builder = mapdeal.MapBuilder(mapdeal.Frame(725, 778, 0.05, (-20.0, -23.35, 0.0)), method)
        for part in scans:
            builder.add(part)
        corner = mapdeal.window(builder.result().grid, corner_xy=(-11, -1.5), size_xy=(9.5, 8))
        _picture(f"intel_{method}.png", corner, f"Intel Research Lab: {method}", side=600)
        corners[method] = corner
    states = [states_of(corners[method].occupancy) for method in ("counting", "tsdf")]
    changes = changes_of(*states, np.ones(states[0].shape, dtype=bool))
    image = difference_image(
        changes, corners["tsdf"].frame, title="Intel Research Lab: counting and tsdf",
        image_max=600, only_in=("counting", "tsdf"),
    )  # fmt: skip
    with (IMAGES / "intel_counting_tsdf.png").open("wb") as file:
        write_indexed_png(file, image.indices, image.palette)


def _local_pictures(office: mapdeal.OccupancyGrid) -> None:
    pose = (-1.0, 0.35, 0.3)
    points = mapdeal.read_cloud(MAPS.parent / "clouds" / "corridor2.pcd")
    limits = {"min_height": 0.1, "max_height": 1.8}
    local = mapdeal.local_map(points, pose, size=(12, 8), global_map=office, **limits)
    inflated = mapdeal.inflate(local, radius=0.22)
    robot = PoseOverlay(pose)
    _picture("local_map.png", local, "corridor2: local map", overlay=robot)
    costs = mapdeal.ring_cost(inflated)
    _picture("local_cost.png", costs, "corridor2: cost, rings 90, 70, 50", overlay=robot)
    poses = mapdeal.read_poses(MAPS.parent / "clouds" / "corridor_poses.txt")
    mapper = mapdeal.RollingMapper(poses, mapdeal.LocalOptions(size=(12, 8), **limits))
    for k in range(len(poses)):
        mapper.add(mapdeal.read_cloud(MAPS.parent / "clouds" / f"corridor{k}.pcd"))
    rolling = mapper.result()
    robot = PoseOverlay(rolling.pose)
    _picture("local_rolling.png", rolling.grid, "corridor0 to 3: rolling map", overlay=robot)


def _picture(
    name: str,
    grid: mapdeal.OccupancyGrid | mapdeal.DistanceField | mapdeal.Costmap | mapdeal.PotentialField,
    title: str,
    *,
    side: int = LONG_SIDE,
    overlay: Overlay | None = None,
) -> None:
    draw = {
        mapdeal.OccupancyGrid: partial(occupancy_image, overlay=overlay),
        mapdeal.DistanceField: partial(field_image, overlay=overlay),
        mapdeal.Costmap: partial(cost_image, overlay=overlay),
        mapdeal.PotentialField: potential_image,
    }[type(grid)]
    image = draw(grid, title=title, image_max=side)
    with (IMAGES / name).open("wb") as file:
        write_indexed_png(file, image.indices, image.palette)


if __name__ == "__main__":
    main()
