import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import mapdeal
from drawn import grid_from_text
from mapdeal.kernels.blocks import lazy_layer
from mapdeal.pictures import colours

OFFICE = str(Path(__file__).parents[2] / "examples" / "maps" / "office.yaml")
COST = "cost, inscribed 0 m, inflation 0.55 m, factor 10"
START, GOAL = (-7.5, 2.5), (9.0, 5.0)
ROUND = mapdeal.Footprint.circle(0.3)
DRAWING = """
    ?..#.
    .....
    .....
"""


@pytest.fixture(scope="module")
def office():
    return mapdeal.read_map(OFFICE)


@pytest.fixture
def drawn_by(command, tmp_path):
    def run(*words, out="out.npz"):
        words = [*words, *(["-o", tmp_path / out] if out else []), "--image", tmp_path / "x.png"]
        code, _, err = command(*words)
        assert code in (0, 1), err
        return (tmp_path / "x.png").read_bytes()

    return run


@pytest.mark.parametrize(("words", "make", "title", "robot"), [
    (["convert"], lambda grid: grid, None, None),
    (["inflate"], mapdeal.inflate, "office: inflated by 0.3 m (disc)", ROUND),
    (["esdf"], mapdeal.esdf, "office: signed distance field", None),
    (["cost"], mapdeal.exponential_cost, f"office: {COST}", None),
    (["potential", "--goal", "9,5"], lambda grid: mapdeal.potential(grid, goal=GOAL),
     "office: potential field", None),
], ids=["convert", "inflate", "esdf", "cost", "potential"])  # fmt: skip
def test_each_command_of_a_stage_writes_these_bytes(office, drawn_by, words, make, title, robot):
    product, expected = make(office), drawn_by(words[0], OFFICE, *words[1:])
    if title is not None:
        assert mapdeal.draw_picture(product, title=title, robot=robot).png() == expected
    if robot is None:  # and notebooks are given the picture under a plain title
        below = [np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))[60:]
                 for png in (product._repr_png_(), expected)]  # fmt: skip
        assert np.array_equal(*below)


def test_a_route_over_costs_is_the_commands_picture(office, drawn_by):
    costs = mapdeal.apply_recipe(office, "nav2")["cost"]
    route = mapdeal.route(costs, start=START, goal=GOAL)
    picture = mapdeal.draw_picture(costs, title="office: route, astar", route=route)
    ends = ["--from", "-7.5,2.5", "--to", "9,5"]
    assert picture.png() == drawn_by("route", OFFICE, *ends, out=None)


def test_comparisons_and_merged_maps_are_the_commands_pictures(office, drawn_by, tmp_path):
    later = mapdeal.draw(office, [mapdeal.Circle((1.0, -2.0), 0.4)], value=100)
    later_path = str(tmp_path / "later" / "office.yaml")
    mapdeal.write_map(later_path, later)
    merged = mapdeal.draw_picture(mapdeal.merge([office, later]))
    assert merged.png() == drawn_by("merge", OFFICE, later_path)
    differing = mapdeal.draw_picture(mapdeal.diff(OFFICE, later_path))
    assert differing.png() == drawn_by("diff", OFFICE, later_path, "--force", out=None)


def test_pictures_of_a_run_are_these_of_applied_recipes(office, tmp_path):
    report = mapdeal.run(OFFICE, tmp_path, "default", image_max=200)
    products = mapdeal.apply_recipe(office, "default")
    for stage, name, title, robot in (
        ("inflate", "inflated", "inflated by 0.3 m (disc)", ROUND),
        ("esdf", "esdf", "signed distance field", None),
        ("cost", "cost", COST, None),
    ):
        title = f"office: {title}"
        picture = mapdeal.draw_picture(products[stage], title=title, image_max=200, robot=robot)
        assert picture.png() == (report.folder / f"{name}.png").read_bytes()


@pytest.mark.parametrize("yaw", [0.0, 0.7])
def test_an_array_of_a_picture_shows_each_cell_north_up(yaw):
    picture = mapdeal.draw_picture(grid_from_text(DRAWING, origin=(1.5, -2.0, yaw)), image_max=0)
    rgb = np.asarray(picture)
    assert (rgb.dtype, rgb.shape) == (np.uint8, (*picture.indices.shape, 3))
    # One pixel a cell: the map's first row of pixels is its north, with the two that stand out;
    # the legend has patches of them, further to the right.
    row, col = np.argwhere((rgb == colours.RVIZ_UNKNOWN).all(axis=2))[0]
    assert (rgb[row, col + 3] == 0).all()
    assert (rgb[row, col + 1 : col + 3] == 255).all()
    assert (rgb[row + 1 : row + 3, col : col + 5] == 255).all()


def test_write_picture_draws_and_refuses_as_commands_do(office, tmp_path):
    path = tmp_path / "new" / "office.png"
    mapdeal.write_picture(str(path), office, title="one")
    picture = mapdeal.draw_picture(office, title="one")
    assert path.read_bytes() == picture.png()
    with Image.open(path) as image:
        assert np.array_equal(np.asarray(image.convert("RGB")), picture.rgb())
    with pytest.raises(mapdeal.FileAccessError, match="exists"):
        mapdeal.write_picture(path, office, title="two")
    assert path.read_bytes() == picture.png()
    mapdeal.write_picture(path, office, title="two", force=True)
    assert path.read_bytes() == mapdeal.draw_picture(office, title="two").png() != picture.png()
    with pytest.raises(mapdeal.ParameterError, match=r"must end in \.png"):
        mapdeal.write_picture(tmp_path / "office.jpg", office)
    with pytest.raises(mapdeal.ParameterError, match="drawn already"):
        mapdeal.write_picture(path, picture, title="three", force=True)


def test_notebooks_show_what_stands_for_a_map():
    grid = grid_from_text(DRAWING)
    bits = mapdeal.BitMap.from_occupancy(grid)
    assert bits._repr_png_() == mapdeal.draw_picture(bits.to_occupancy(), title="bit map").png()
    mapper = mapdeal.LocalMapper((0.5, 1, 0.3), mapdeal.LocalOptions(size=(2, 1)))
    local = mapper.result()
    with_robot = mapdeal.draw_picture(local.grid, title="local map", pose=(0.5, 1, 0.3))
    assert local._repr_png_() == with_robot.png()
    assert with_robot.png() != mapdeal.draw_picture(local.grid, title="local map").png()
    built = mapdeal.build_map([[0, 0, 0.3]], [0.0, 0.5], [[1.0, 1.2]], resolution=0.25)
    assert built._repr_png_() == mapdeal.draw_picture(built.grid, title="map of scans").png()
    report = mapdeal.diff(grid, grid)
    assert report._repr_png_() == mapdeal.draw_picture(report).png()


def test_what_would_keep_a_notebook_busy_is_not_drawn(monkeypatch):
    grid = grid_from_text(DRAWING)
    field = mapdeal.potential(grid)
    monkeypatch.setattr("mapdeal.commands.draw_picture._MOST_CELLS", 15)
    monkeypatch.setattr("mapdeal.commands.draw_picture._MOST_CELLS_OF_POTENTIAL", 14)
    assert grid._repr_png_()[:4] == b"\x89PNG"
    assert field._repr_png_() is None
    monkeypatch.setattr("mapdeal.commands.draw_picture._MOST_CELLS", 14)
    assert grid._repr_png_() is None

    def make(rows):
        raise AssertionError("a notebook asked for rows")

    lazy = mapdeal.OccupancyGrid(lazy_layer((3, 4), np.int8, make, block_height=1), 0.05)
    assert lazy._repr_png_() is None


def test_pictures_of_notebooks_have_a_longest_side():
    grid = mapdeal.OccupancyGrid(np.zeros((10, 3000), np.int8), 0.05)
    beside = mapdeal.OccupancyGrid(grid.occupancy, 0.05, (9.0, 0.0, 0.0))
    for shown, most in ((grid, 1400), (mapdeal.diff(grid, grid), 1500),
                        (mapdeal.merge([grid, beside]), 1500)):  # fmt: skip
        with Image.open(io.BytesIO(shown._repr_png_())) as image:
            assert 1000 <= image.width < most  # three pixels a cell, and a margin
