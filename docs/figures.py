"""Draw the pictures of the documentation.

Run it as ``python docs/figures.py [intel-corrected.log] [tmcl]``.
Reads examples and writes docs/images; the pictures of the Intel lab only if its log is given, those
of an office floor only if the folder with PRBonn/tmcl's maps of it is.
"""

from __future__ import annotations

import io
import shlex
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

import mapdeal
from mapdeal.alignment.align import align
from mapdeal.checks.difference import changes_of, frame_around, states_of
from mapdeal.formats.png import write_indexed_png
from mapdeal.formats.scans.reader import open_log
from mapdeal.grid.resample import sampled
from mapdeal.grid.transform import Transform
from mapdeal.render.colours import Colour
from mapdeal.render.difference import difference_image
from mapdeal.render.keepout import KeepoutOverlay
from mapdeal.render.layers import cost_image, field_image, occupancy_image
from mapdeal.render.overlay import Brush, Overlay, place_of
from mapdeal.render.pose import PoseOverlay
from mapdeal.render.potential import potential_image
from mapdeal.render.raster import Raster
from mapdeal.render.reach import reach_image
from mapdeal.render.route import RouteOverlay
from mapdeal.render.style import LayerStyle, Swatch

DOCS = Path(__file__).parent
IMAGES = DOCS / "images"
MAPS = DOCS.parent / "examples" / "maps"
WARTHOG = [(0.76, 0.69), (0.76, -0.69), (-0.76, -0.69), (-0.76, 0.69)]
ROBOT = DOCS.parent / "examples" / "robots" / "nav2_params.yaml"

SHELF = [(0.975, -0.825), (1.5, -0.825)]
LONG_ROBOT = [(0.45, 0.225), (0.45, -0.225), (-0.45, -0.225), (-0.45, 0.225)]
FOOTPRINT = "[[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]]"
LONG_SIDE = 900  # pixels of a picture of a map


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

    @property
    def places_xy(self) -> NDArray[np.float64]:
        """All ways."""
        return np.concatenate([route.points_xy for route in self.routes.values()])

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
    draw_cost_curve(IMAGES / "cost_curve.png")
    draw_arena()
    draw_corridor()
    draw_office()
    draw_reach()
    draw_report()
    for given in map(Path, sys.argv[1:]):
        if given.is_dir():
            draw_floor(given)
        else:
            draw_intel(given)


def draw_cost_curve(path: Path) -> None:
    """Draw what ``mapdeal cost --curve`` does for a robot on the office's cells."""
    curve = mapdeal.cost_curve(
        mapdeal.read_map(MAPS / "office.yaml"),
        footprint=mapdeal.Footprint.parse(FOOTPRINT),
        inflation_radius=0.55,
        cost_scaling_factor=5.0,
    )
    title = "office: cost, inscribed 0.2 m, inflation 0.55 m, factor 5"
    mapdeal.write_picture(path, curve, title=title, force=True)


def draw_corridor() -> None:
    """Draw the map of the example bag's scans."""
    built = mapdeal.build_map_from_bag(
        DOCS.parent / "examples" / "bags" / "office.mcap", method="counting"
    )
    title = "60 scans of a bag, counting"
    mapdeal.write_picture(IMAGES / "bag_corridor.png", built.grid, title=title, force=True)


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
    robot = mapdeal.read_robot_parameters(ROBOT)
    costs = mapdeal.apply_recipe(office, robot)["cost"]
    _picture("robot_cost.png", costs, "office: cost of examples/robots/nav2_params.yaml")
    curve = mapdeal.cost_curve(office, robot=robot)
    title = "office: cost of examples/robots/nav2_params.yaml"
    mapdeal.write_picture(IMAGES / "robot_curve.png", curve, title=title, force=True)
    warthog = mapdeal.Footprint.polygon(WARTHOG).padded(0.01)
    short = mapdeal.cost_curve(
        0.05, footprint=warthog, inflation_radius=1.0, cost_scaling_factor=4.0, lookup="nav2"
    )
    mapdeal.write_picture(IMAGES / "robot_short_curve.png", short, title="Warthog", force=True)
    _picture("office_cost_threshold.png", threshold, "office: cost, model threshold")
    _picture("office_cost_rings.png", rings, "office: cost, model rings")
    zones = mapdeal.read_shapes(MAPS.parent / "shapes" / "office_zones.yaml")
    mask = mapdeal.draw(mapdeal.blank(office, -1), zones, overlay="max")
    bare = mapdeal.exponential_cost(
        office, inscribed_radius=0.22, inflation_radius=0.7, cost_scaling_factor=3.0
    )
    masked = mapdeal.apply_keepout_mask(bare, mask)
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
    title = "office: cost, inscribed 0.22 m, with a keepout mask"
    _picture("office_mask.png", masked, title, overlay=KeepoutOverlay.of(bare, masked))


def draw_reach() -> None:
    """Draw where robots get to in the office, before and after a shelf stands in a door."""
    office = mapdeal.active_region(mapdeal.read_map(MAPS / "office.yaml"), margin=0.5)
    shelf = mapdeal.draw(office, mapdeal.Line(SHELF), value=100)
    asked = {"start": (-8.0, 0.0), "goals": {"kitchen": (3.0, -4.0), "lab": (9.0, 4.0)}}
    before = mapdeal.reach(office, radius=0.28, **asked)
    after = mapdeal.reach(shelf, radius=0.28, **asked)
    robot = mapdeal.Footprint.polygon(LONG_ROBOT)
    of_long = mapdeal.reach(shelf, start=(-8.0, 0.0, 0.0), footprint=robot)
    _picture("reach_before.png", before, "office: reach of a robot of radius 0.28 m")
    _picture("reach_after.png", after, "shelf: reach of a robot of radius 0.28 m")
    _picture("reach_long.png", of_long, "shelf: reach of a robot of 0.9 x 0.45 m")


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


FLOOR = ("Faro/FMap.yaml", "GMap/GMap.yaml", "2021_10_27/YouBotMap.yaml")
FLOOR_COLOURS = {
    "outside": (225, 225, 225), "unknown": (112, 137, 134), "free": (255, 255, 255),
    "wall of the laser scanner": (20, 20, 24), "wall of gmapping": (0, 120, 220),
    "wall of the later map": (225, 110, 0), "wall of several": (150, 150, 160),
}  # fmt: skip
FLOOR_COMMANDS = """\
merge {faro} {gmap} {youbot} --by align -o {out}/merged.yaml --image {images}/tmcl_merged.png
score {gmap} --truth {faro} --align --image {images}/tmcl_scored.png
clean {youbot} -o {out}/cleaned.yaml --image {images}/tmcl_cleaned.png"""


def draw_floor(folder: Path) -> None:
    """Draw three maps of an office floor before and after they are aligned, merged, and scored."""
    maps = [mapdeal.read_map(folder / name) for name in FLOOR]
    aligned = [Transform()] + [align(one, maps[0]).transform for one in maps[1:]]
    _draw_walls(
        "tmcl_frames.png", maps, [Transform()] * 3, "office floor: three maps, as their files say"
    )
    _draw_walls("tmcl_aligned.png", maps, aligned, "office floor: three maps, aligned")
    paths = dict(zip(("faro", "gmap", "youbot"), (folder / name for name in FLOOR), strict=True))
    with tempfile.TemporaryDirectory() as out:
        for words in FLOOR_COMMANDS.format(out=out, images=IMAGES, **paths).splitlines():
            command = [sys.executable, "-m", "mapdeal", *shlex.split(words), "--force"]
            subprocess.run(command, check=True, capture_output=True)  # noqa: S603 - ours


def _draw_walls(
    name: str, maps: list[mapdeal.OccupancyGrid], transforms: list[Transform], title: str
) -> None:
    """Draw the walls of maps in colours of their own, around all, on the first one's lattice."""
    frame = maps[0].frame
    for one, transform in zip(maps, transforms, strict=True):
        frame = frame_around(frame, transform.frame(one.frame))
    kinds = np.full(frame.shape, 1, dtype=np.uint8)
    walls = np.zeros((len(maps), *frame.shape), dtype=bool)
    for wall, one, transform in zip(walls, maps, transforms, strict=True):
        values, inside = sampled(frame, one.occupancy, transform.frame(one.frame))
        kinds[inside & (values == 0)] = 2
        wall[:] = inside & (values == 100)
    for number, wall in enumerate(walls, 3):
        kinds[wall] = number
    kinds[walls.sum(axis=0) > 1] = 6
    style = LayerStyle(
        np.array(list(FLOOR_COLOURS.values()), dtype=np.uint8),
        swatches=tuple(Swatch(kind, text) for kind, text in enumerate(FLOOR_COLOURS) if kind),
    )
    image = difference_image(
        kinds, frame, title=title, image_max=LONG_SIDE, image_extent="known", style=style
    )
    with (IMAGES / name).open("wb") as file:
        write_indexed_png(file, image.indices, image.palette)


def draw_report() -> None:
    """Draw the page of a report, if there is a browser; its values are those at a pinned point."""
    browser = shutil.which("chromium")
    if browser is None:
        print("report.png is left as it is: there is no chromium")
        return
    from playwright.sync_api import sync_playwright

    with tempfile.TemporaryDirectory() as name:
        for words in REPORT.format(office=MAPS / "office.yaml", out=name).splitlines():
            command = [sys.executable, "-m", "mapdeal", *shlex.split(words)]
            done = subprocess.run(command, check=True, capture_output=True)  # noqa: S603 - ours
            if "lint" in command:
                (Path(name) / "lint.json").write_bytes(done.stdout)
        with sync_playwright() as driver:
            chromium = driver.chromium.launch(executable_path=browser, args=["--no-sandbox"])
            page = chromium.new_page(viewport={"width": 1400, "height": 1100})
            page.goto((Path(name) / "office.html").as_uri())
            page.wait_for_timeout(1000)
            page.mouse.click(460, 560)
            page.wait_for_timeout(1000)
            picture = page.screenshot()
            chromium.close()
    with Image.open(io.BytesIO(picture)) as image:
        image.convert("RGB").quantize(128).save(IMAGES / "report.png", optimize=True)


ASKED = "--from -8,0 --to kitchen=3,-4 lab=9,4 --robot-radius 0.28 -q"
REPORT = f"""\
run {{office}} -o {{out}} -q
reach {{office}} {ASKED} -o {{out}}/r.json --layers {{out}}/reach.npz
route {{office}} --from -8,0 --to 9,4 --robot-radius 0.28 -o {{out}}/route.json -q
lint {{office}} --robot-radius 0.28 --format json
report {{out}}/office {{office}} {{out}}/reach.npz {{out}}/r.json {{out}}/route.json \
{{out}}/lint.json -o {{out}}/office.html -q"""
"""The commands of report.md."""


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
    grid: mapdeal.Grid,
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
        mapdeal.Reach: reach_image,
    }[type(grid)]
    image = draw(grid, title=title, image_max=side, image_extent="known")
    with (IMAGES / name).open("wb") as file:
        write_indexed_png(file, image.indices, image.palette)


if __name__ == "__main__":
    main()
