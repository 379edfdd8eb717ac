import math
import re
from pathlib import Path

import numpy as np
import pytest

import mapdeal
from mapdeal import FileAccessError, OccupancyGrid, ParameterError

EXAMPLES = Path(__file__).parents[2] / "examples"
NAV2 = EXAMPLES / "robots" / "nav2_params.yaml"
GRID = OccupancyGrid([[0, 100]], 0.25)
LATER = OccupancyGrid([[0, 100, 0]], 0.25)
ROUND = mapdeal.Footprint.circle(0.2)
LIKE = "changes: must look like {'stage.parameter': value}"


def build(log=EXAMPLES / "logs" / "office.log", **arguments):
    return lambda: mapdeal.build_map_from_log(log, **arguments)


def lint(paths="m.yaml", **arguments):
    return lambda: mapdeal.lint(paths, **arguments)


def recipe(name="default", changes=None, **arguments):
    return lambda: mapdeal.load_recipe(name, changes, **arguments)


def run(path="m.yaml", output="out", recipe="default", **arguments):
    return lambda: mapdeal.run(path, output, recipe, **arguments)


def score(**arguments):
    return lambda: mapdeal.score(GRID, GRID, **arguments)


def align(**arguments):
    return lambda: mapdeal.align(GRID, GRID, **arguments)


def graph(**arguments):
    return lambda: mapdeal.graph(GRID, **arguments)


def merge(transforms):
    return lambda: mapdeal.merge(["m.yaml"] * 3, transforms=transforms)


def draw(picture=GRID, **arguments):
    return lambda: mapdeal.draw_picture(picture, **arguments)


@pytest.fixture(autouse=True)
def folder(here):
    """A folder with a map and a transform."""
    Path("s.json").write_text('{"x": 1, "y": 2, "yaw": 0}')
    mapdeal.write_map("m.yaml", GRID)


@pytest.mark.parametrize(("call", "message"), [
    (build(truncation=3), "truncation: does not apply to method log-odds"),
    (build(threads=0), "threads: must be a whole number"),
    (lambda: mapdeal.diff(GRID, np.zeros((2, 2))), "map B: must be a file or a grid"),
    (lambda: mapdeal.diff("m.yaml", "m.yaml", dialect="ros2"), "dialect: must be one of nav2"),
    (lint("@-"), "@-: applies to the command line"),
    *[(lint(nothing), "names no map") for nothing in ([], (), iter([]))],
    *[(lint(odd), "lint: takes names or paths") for odd in (GRID, None, [b"m"])],
    *[(lint(select=odd), "lint: takes names or paths, got") for odd in (3, ["a", None])],
    (lint(select="yaml.defalt"), "select: unknown check, got 'yaml.defalt'"),
    (lint(costmap="global"), "costmap"),
    (lint(params_file=NAV2, costmap="both"), "costmap"),
    (draw(image_max=-1), "image_max: must be a whole number, at least 0, got -1"),
    (draw(pose=(1, 2, math.nan)), "pose"),
    (draw(title=3), "title: must be a text, got 3"),
    (draw(route=[(0, 0), (1, 1)]), "route: must be a Route"),
    (draw(robot=0.3), "robot: must be a Footprint, got 0.3"),
    (draw(image_extent="some"), "image_extent"),
    *[(draw(picture), "shown: must be a grid") for picture in (GRID.occupancy, None, "m.yaml")],
    (draw(mapdeal.diff(GRID, GRID), pose=(0, 0, 0)), "over a comparison"),
    (draw(mapdeal.merge([GRID, LATER]), pose=(0, 0, 0)), "over merged maps"),
    (lambda: mapdeal.read_robot_parameters(NAV2, costmap="both"), "costmap"),
    (lambda: mapdeal.read_robot_parameters(7), "robot: takes paths of parameter files"),
    (lambda: mapdeal.esdf(grid=7), "esdf: takes a grid: OccupancyGrid, got 'int'"),
    (lambda: mapdeal.layered_cost(GRID, mask=7), "mask: must be OccupancyGrid, got 7"),
    (lambda: mapdeal.write_report("r.html", [GRID]), "sources: must be str or PathLike, got Occ"),
    (lambda: mapdeal.costmap(GRID, NAV2, inflation_radius=0.3), "inflation_radius: cannot be"),
    (recipe(changes={"inflate.radis": 1}), "inflate.radis: no such parameter"),
    (recipe(changes={"inflate.radius": math.nan}), "inflate.radius: must be a finite number"),
    (recipe(changes={"inflation_radius": 1}), LIKE),
    (recipe(changes={"inflate": {"radius": 1}}), LIKE),
    (recipe(changes={"active.margin": 1}), "default has no stage active, got 'active.margin'"),
    (recipe(changes=[("inflate.radius", 1)]), "changes: must be values by name, got"),
    (recipe(mapdeal.load_recipe("nav2"), {"cost.inflation_radius": 1}), "cannot be changed"),
    (recipe("nav"), "no such recipe, got 'nav'\nhint: did you mean nav2?"),
    (recipe(["inflate"]), "must be the name of a recipe"),
    (run(GRID), "run: takes the path of a map"),
    (lambda: mapdeal.apply_recipe("m.yaml"), "apply_recipe: takes a grid"),
    (run(["m.yaml", "m.yaml"]), "different names"),
    (run(robot_radius=0.2, footprint=ROUND), "robot_radius: cannot be given together"),
    (run(canvas="whole"), "canvas: must be one of crop, full"),
    (run(dialect="ros2"), "dialect: must be one of nav2, humble, ros1"),
    (run(max_memory=-1), "max_memory: must be"),
    (recipe("nav2", footprint=0.3), "hint: footprint=mapdeal.Footprint.circle(0.2) is a round"),
    (recipe("nav2", footprint="circle"), "footprint: a footprint must look like"),
    *[(score(transform=odd), "transform: must be a transform, or three") for odd in ((1, 2), 3)],
    (score(transform=(1, 2, math.nan)), "yaw: must be a finite number"),
    (score(maximum={"walls": 0.1}), "maximum: is not a figure of a score, got 'walls'"),
    (lambda: mapdeal.Goal("4", "0"), "x: must be a number, got '4'"),
    (lambda: mapdeal.route(GRID, pairs=[((0, 0), (1, 0))]), "pairs: must be str or PathLike, got"),
    (score(transform=(1, 2, 3), align=True), "cannot be given together"),
    (merge("aligned"), "transforms: must be 2, one for each map except the first, or align, got"),
    (merge(["s.json"] * 4), "transforms: must be 2, one for each map except the first, got 4"),
    *[(align(prior=odd), "prior") for odd in ([1, 2], "north", 3.0)],
    (lambda: mapdeal.info("m.yaml", dialect="ros2"), "dialect"),
    *[(graph(**{name: odd}), f"{name}: must be a finite number")
      for name in ("spacing", "hall", "cover", "slow_below") for odd in ("x", math.nan, [1])],
    (graph(one_way="left"), "one_way: must be one of right"),
    (graph(robot=0.3), "robot: must be RobotParameters"),
    (lambda: mapdeal.cloud_map(np.zeros((9, 3)), frame=GRID), "frame: must be a Frame"),
    *[(lambda odd=odd: mapdeal.cloud_map(np.zeros((9, 3)), resolution=odd), "resolution must lie")
      for odd in ("x", [1], 0)],
    (lambda: mapdeal.build_map_from_clouds([]), "paths: names no cloud"),
    *[(lambda odd=odd: mapdeal.write_map("x.npz", odd), "grid: must be a grid")
      for odd in (None, GRID.occupancy)],
    *[(lambda odd=odd: OccupancyGrid([[0]], odd), "resolution must lie") for odd in (None, "x")],
    *[(lambda odd=odd: OccupancyGrid([[0]], 0.25, odd), "origin must be three numbers")
      for odd in (None, "abc", 3)],
], ids=lambda value: value if isinstance(value, str) else "")  # fmt: skip
def test_arguments_that_are_not_allowed(call, message):
    with pytest.raises(ParameterError, match=re.escape(message)):
        call()
    assert not Path("out").exists()


def test_files_that_are_not_there():
    for call in (
        build(log="none"), lambda: mapdeal.diff("m.yaml", "none"), lambda: mapdeal.info("none"),
        recipe("none.yaml"),
    ):  # fmt: skip
        with pytest.raises(FileAccessError, match=r"none.*: cannot be read"):
            call()


def test_a_parameter_that_nav2_refuses():
    Path("p.yaml").write_text(NAV2.read_text().replace("0.6\n", "1\n"))
    with pytest.raises(mapdeal.MalformedInputError, match="inflation_radius"):
        mapdeal.read_robot_parameters("p.yaml")
