"""Draw the pictures of the documentation.

Run it as ``python docs/figures.py [intel-corrected.log] [tmcl]``.
Most pictures are files that the commands of a page write: they are run, and the files copied into
docs/images. The pictures of the Intel lab are drawn only if its log is given, those of an office
floor only if the folder with PRBonn/tmcl's maps of it is.
"""

from __future__ import annotations

import io
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

import mapdeal
from mapdeal.compare.difference import frame_around
from mapdeal.grid.canvas import sampled
from mapdeal.grid.frame import Transform
from mapdeal.maps.png import write_png
from mapdeal.pictures.colours import Colour, LayerStyle, Swatch
from mapdeal.pictures.comparisons import difference_image
from mapdeal.pictures.layers import occupancy_image
from mapdeal.pictures.overlay import Brush, Surface

DOCS = Path(__file__).parent
IMAGES = DOCS / "images"
MAPS = DOCS.parent / "examples" / "maps"

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

    def draw(self, on: Surface, first_index: int) -> list[Swatch]:
        """Draw the routes; see `Overlay`."""
        brush = Brush(on.pixels)
        swatches = []
        for index, (name, route) in enumerate(self.routes.items(), first_index):
            path = on.places(route.points_xy)
            brush.polyline(path, index, thickness=3)
            swatches.append(Swatch(index, name))
        return swatches


PICTURES = {
    "README.md": {"office_reach.png": "out/reach.png"},
    "quickstart.md": {
        "office_esdf.png": "out/quickstart/office/esdf.png",
        "office_cost.png": "out/quickstart/office/cost.png",
        "office_cost_nav2.png": "out/quickstart/footprint/office/cost.png",
        "arena_active.png": "out/quickstart/sim/arena/active.png",
    },
    "stages.md": {
        "arena.png": "out/stages/canvas/arena/input.png",
        "arena_cost.png": "out/stages/arena/arena/cost.png",
        "cost_curve.png": "out/stages/curve.png",
        "office_cost_rings.png": "out/stages/rings.png",
    },
    "robots.md": {
        "robot_cost.png": "out/robots/cost.png",
        "robot_curve.png": "out/robots/curve.png",
        "robot_window.png": "out/robots/window.png",
    },
    "asking.md": {"office_route.png": "out/asking/route.png"},
    "potentials.md": {
        "office_potential.png": "out/potentials/potential.png",
        "office_descent.png": "out/potentials/descent.png",
    },
    "route_graphs.md": {"route_graph.png": "out/routes/office.png"},
    "reach.md": {
        "reach_before.png": "out/before.png",
        "reach_after.png": "out/after.png",
        "reach_long.png": "out/long.png",
    },
    "plan.md": {"plan.png": "out/plan.png"},
    "guides/nav2.md": {"nav2_mask.png": "out/nav2/masked.png"},
    "guides/gmapping_cartographer.md": {"merged_office.png": "out/slam/merged.png"},
    "guides/simulation.md": {"simulated_cost.png": "out/sim/full/arena/cost.png"},
    "editing.md": {"office_mask.png": "out/editing/cost.png"},
    "filters.md": {"office_filters.png": "out/filters.png"},
    "local_maps.md": {
        "local_map.png": "out/local/local.png",
        "local_cost.png": "out/local/cost.png",
        "local_rolling.png": "out/rolling/0003/local.png",
    },
    "mapping.md": {"cloud_ramp.png": "out/mapping/ramp.png"},
    "bags.md": {"bag_corridor.png": "out/bags/corridor.png"},
}
"""Files that the commands of a page write, by the picture of docs/images that they are."""

INTEL = """\
build {log} -o {out}/intel_{method}.yaml --method {method} --size 36.25,38.9 --origin -20,-23.35
window {out}/intel_{method}.yaml -o {out}/intel_corner_{method}.yaml --corner -11,-1.5 \
--size 9.5,8 --image {images}/intel_{method}.png"""
INTEL_DIFFERENCE = """\
diff {out}/intel_corner_counting.yaml {out}/intel_corner_tsdf.yaml \
--image {images}/intel_counting_tsdf.png"""


def main() -> None:
    """Draw every picture."""
    IMAGES.mkdir(exist_ok=True)
    for page, pictures in PICTURES.items():
        with commands_run(page) as folder:
            for name, file in pictures.items():
                shutil.copy(folder / file, IMAGES / name)
    draw_pairs()
    draw_report()
    for given in map(Path, sys.argv[1:]):
        if given.is_dir():
            draw_floor(given)
        else:
            draw_intel(given)


@contextmanager
def commands_run(page: str) -> Iterator[Path]:
    """Run the commands of a page; give the folder that they have run in."""
    text = (DOCS if (DOCS / page).exists() else DOCS.parent).joinpath(page).read_text()
    blocks = re.findall(r"^```sh\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    with tempfile.TemporaryDirectory() as name:
        shutil.copytree(DOCS.parent / "examples", Path(name) / "examples")
        for line in "".join(blocks).replace("\\\n", " ").splitlines():
            words = shlex.split(line.strip().removeprefix(".venv/bin/"), comments=True)
            if words[:1] == ["mapdeal"]:
                _run(words[1:], Path(name))
        yield Path(name)


def _run(words: list[str], folder: Path) -> None:
    """Run mapdeal; a finding is no failure."""
    target = words[-1] if words[-2:-1] == [">"] else None
    command = [sys.executable, "-m", "mapdeal", *(words[:-2] if target else words)]
    done = subprocess.run(command, capture_output=True, cwd=folder, check=False)  # noqa: S603 - ours
    if done.returncode > 2:
        raise SystemExit(done.stderr.decode())
    if target is not None:
        (folder / target).write_bytes(done.stdout)


def draw_pairs() -> None:
    """Draw the routes of three methods on one map."""
    office = mapdeal.read_map(MAPS / "office.yaml")
    costmap = mapdeal.apply_recipe(office, "nav2")["cost"]
    ends = dict(zip(("start", "goal"), COMPARED, strict=True))
    routes = {
        "plain": mapdeal.route(costmap, **ends),
        "in the cost": mapdeal.route(costmap, **ends, field_weight=1.0),
        "in the heuristic": mapdeal.route(costmap, **ends, heuristic="field"),
    }
    image = occupancy_image(
        office, title="office: routes of three methods", overlay=Routes(routes),
        image_max=LONG_SIDE, image_extent="known",
    )  # fmt: skip
    with (IMAGES / "office_pairs.png").open("wb") as file:
        write_png(file, image.indices, image.palette)


def draw_intel(log: Path) -> None:
    """Draw a corner of the Intel Research Lab as each method maps it, and what differs."""
    with tempfile.TemporaryDirectory() as out:
        places = {"log": log.absolute(), "out": out, "images": IMAGES.absolute()}
        lines = [INTEL.format(method=name, **places) for name in ("log-odds", "counting", "tsdf")]
        for line in "\n".join([*lines, INTEL_DIFFERENCE.format(**places)]).splitlines():
            _run([*shlex.split(line), "--force"], Path(out))


def draw_report() -> None:
    """Draw pages of reports, if there is a browser: values at a pinned point, and zones."""
    browser = shutil.which("chromium")
    if browser is None:
        print("report.png and report_zones.png are left as they are: there is no chromium")
        return
    from playwright.sync_api import sync_playwright

    with commands_run("report.md") as folder, sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=browser, args=["--no-sandbox"])
        page = chromium.new_page(viewport={"width": 1400, "height": 1100})
        page.goto((folder / "out" / "report" / "office.html").as_uri())
        page.wait_for_timeout(1000)
        page.mouse.click(460, 560)
        page.wait_for_timeout(1000)
        pictures = {"report.png": page.screenshot()}
        page.set_viewport_size({"width": 1200, "height": 700})
        page.goto((folder / "out" / "report" / "zones.html").as_uri())
        page.wait_for_timeout(1000)
        page.locator("#zones li button").first.click()
        page.locator("label:has([name=draw])").click()
        page.wait_for_timeout(1000)
        pictures["report_zones.png"] = page.screenshot()
        chromium.close()
    for name, picture in pictures.items():
        with Image.open(io.BytesIO(picture)) as image:
            image.convert("RGB").quantize(128).save(IMAGES / name, optimize=True)


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
    aligned = [Transform()] + [mapdeal.align(one, maps[0]).transform for one in maps[1:]]
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
        write_png(file, image.indices, image.palette)


if __name__ == "__main__":
    main()
