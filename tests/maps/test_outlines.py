"""Polygons and drawings of maps: read again by others, and rasterised again."""

import json
import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from drawn import grid_from_text
from mapdeal import read_map, write_map

shapely = pytest.importorskip("shapely")

ROOMS = """\
#########
#..#....?
#..#....?
#.......#
#..#..#.#
#########"""
GRID = grid_from_text(ROOMS, resolution=0.25, origin=(1.5, -2.0, 0.4))
OF = {"free": 0, "obstacles": 100}
BASEMENT = "mit-racecar__racecar_simulator/maps/stata_basement.yaml"
REAL = [
    "ros-navigation__navigation2/nav2_bringup/maps/depot.yaml",
    "turtlebot__turtlebot_simulator/turtlebot_stdr/maps/frieburg.yaml",
    pytest.param(BASEMENT, marks=pytest.mark.thorough),
]


def polygons_in(path):
    features = json.loads(path.read_text())["features"]
    polygons = [shapely.geometry.shape(feature["geometry"]) for feature in features]
    areas = [feature["properties"]["area"] for feature in features]
    assert areas == pytest.approx([polygon.area for polygon in polygons], abs=1e-5)
    assert all(polygon.is_valid and shapely.is_ccw(polygon.exterior) for polygon in polygons)
    return polygons


def cells_in(polygons, grid):
    """Rasterise polygons: the cells whose centres they hold."""
    found = np.zeros(grid.shape, bool)
    for polygon in polygons:
        in_cells = shapely.transform(polygon, grid.frame.continuous_rowcol_from_xy)
        low, first_col, high, right = (round(bound) for bound in in_cells.bounds)
        rows, cols = np.indices((high - low, right - first_col))
        shapely.prepare(in_cells)
        covered = shapely.contains_xy(in_cells, rows + low + 0.5, cols + first_col + 0.5)
        found[low:high, first_col:right] |= covered
    return found


def exact_polygons(converted, source, grid, of):
    """Return the polygons of cells, which are these cells when they are rasterised again."""
    exact = polygons_in(converted(source, "a.geojson", "--of", of, "--tolerance", "0"))
    cells = grid.occupancy == OF[of]
    assert np.array_equal(cells_in(exact, grid), cells)
    area = cells.sum() * grid.resolution**2
    assert sum(polygon.area for polygon in exact) == pytest.approx(area, 1e-5)
    return exact


@pytest.mark.parametrize("of", OF)
def test_polygons_rasterised_again_are_the_cells(converted, of):
    exact_polygons(converted, GRID, GRID, of)


@pytest.mark.parametrize("of", OF)
@pytest.mark.parametrize("name", REAL)
def test_polygons_of_real_maps(real_maps, converted, of, name, mapdeal_warnings):
    exact = exact_polygons(converted, real_maps / name, read_map(real_maps / name), of)
    simple = polygons_in(converted(real_maps / name, "b.geojson", "--of", of))
    area = sum(polygon.area for polygon in exact)
    assert sum(polygon.area for polygon in simple) == pytest.approx(area, rel=0.01)
    corners = [sum(map(shapely.get_num_coordinates, many)) for many in (exact, simple)]
    assert corners[1] < corners[0]


def test_of_a_robot_it_is_what_it_reaches(converted):
    x, y = GRID.frame.xy_from_rowcol([[3, 5]])[0]
    robots = (), ("--from", f"{x},{y}"), ("--from", f"{x},{y}", "--robot-radius", "0.26")
    found = [polygons_in(converted(GRID, "a.geojson", "--tolerance", "0", *w)) for w in robots]
    exact, reached, narrow = ([polygon.area for polygon in polygons] for polygons in found)
    assert reached == pytest.approx(exact)
    assert sum(narrow) < sum(exact) / 2


def test_shapes_of_polygons_are_drawn_again_by_edit(converted, tmp_path, command):
    converted(GRID, "a.geojson", "--of", "obstacles")
    words = ("edit", "polygon", tmp_path / "map.yaml", "--blank", "--value", "100")
    code, _, err = command(*words, "--file", tmp_path / "a.geojson", "-o", tmp_path / "again.yaml")
    assert code == 0, err
    assert (read_map(tmp_path / "again.yaml").occupancy[GRID.occupancy == 100] == 100).all()


def test_drawings_are_to_scale(converted):
    text = converted(GRID, "a.svg", "--tolerance", "0").read_text()
    root = ET.fromstring(text)  # noqa: S314 - our own
    size = [float(root.get(name).removesuffix("mm")) for name in ("width", "height")]
    view = [float(number) for number in root.get("viewBox").split()]
    assert view[2:] == pytest.approx(size)
    x, y = map(float, re.search(r"\(0, 0\) is (\S+), (\S+) m", text).groups())
    layers = {group.get("id"): group for group in root.iter("{http://www.w3.org/2000/svg}g")}
    for name, cells in (("known", GRID.occupancy >= 0), ("obstacles", GRID.occupancy == 100)):
        area = shapely.Polygon()
        for part in (part for path in layers[name] for part in path.get("d")[1:-1].split("ZM")):
            ring = shapely.Polygon([tuple(map(float, p.split())) for p in part.split(" L")])
            area = shapely.symmetric_difference(area, ring)
        in_map = shapely.transform(area, lambda p: p / 1000 * (1, -1) + (x, y))
        assert np.array_equal(cells_in([in_map], GRID), cells)


REFUSED = [
    ("x.geojson --tolerance 0.2", 2, "--tolerance: must be at most half a cell, 0.125 m"),
    ("x.svg --of obstacles --robot-radius 0.1", 2, "applies to free space"),
    ("x.svg --mode raw", 2, "--mode: applies to maps"),
    ("x.svg --wall-height 1", 2, "--wall-height: applies to .sdf, .stl and .obj"),
    ("x.yaml --of free", 2, "--of: applies to .geojson and .svg"),
    ("x.yaml --robot-radius 1", 2, "applies to .geojson and .svg"),
    *[(f"x.stl --wall-height {odd}", 2, "between 0.001 and 10000") for odd in (0, 1e-308, 1e308)],
    ("x.stl --tolerance 0", 2, "--tolerance: applies to"), ("x.kml", 2, "must end in"),
    ("x.geojson --from 99,99", 2, "--from: lies outside of the map"),
    ("x.geojson", 3, "has no free cell"), ("x.stl", 3, "has no occupied cell"),
    ("x.svg", 3, "has no known cell"),
]  # fmt: skip


@pytest.mark.parametrize(("words", "code", "text"), REFUSED)
def test_bad_input_is_one_line_and_nothing_is_written(tmp_path, command, words, code, text):
    grid = GRID if code == 2 else grid_from_text("??\n??", resolution=0.5)
    write_map(tmp_path / "map.yaml", grid)
    before = sorted(tmp_path.iterdir())
    name, *options = words.split()
    found, _, err = command("convert", tmp_path / "map.yaml", "-o", tmp_path / name, *options)
    assert found == code, err
    errors = [line for line in err.splitlines() if line.startswith("error: ")]
    assert [text in line for line in errors] == [True]
    assert sorted(tmp_path.iterdir()) == before
