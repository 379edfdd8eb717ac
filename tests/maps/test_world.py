"""Worlds for simulators: measured by trimesh, looked at from above, valid by SDFormat's rules."""

import os
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays
from PIL import Image, ImageDraw

from drawn import grid_from_text
from mapdeal import OccupancyGrid, ParameterError, read_map, write_map
from mapdeal.errors import one_line
from mapdeal.grid.frame import Frame
from mapdeal.kernels.outlines import surface
from mapdeal.maps.exports import mesh_of, stl_parts

trimesh = pytest.importorskip("trimesh")

TEXT = """\
########
#.#...?#
#..#.#.#
########"""
GRID = grid_from_text(TEXT, resolution=0.25, origin=(1.5, -2.0, 0.4))
BASEMENT = "mit-racecar__racecar_simulator/maps/stata_basement.yaml"
REAL = [
    "ros-navigation__navigation2/nav2_bringup/maps/depot.yaml",
    pytest.param(BASEMENT, marks=pytest.mark.thorough),
    "avidbots__flatland/conestogo_office_test/map.yaml",
]


def parsed(path):
    return ET.parse(path).getroot()  # noqa: S314 - our own


def numbers(text):
    return [float(part) for part in text.split()]


def boxes_in(path, name="collision"):
    """The boxes of the walls: centres in the map frame, (N, 3), and sizes."""
    (walls,) = (model for model in parsed(path).iter("model") if model.get("name") == "walls")
    x, y, *_, yaw = numbers(walls.find("pose").text)
    found = walls.findall(f"link/{name}")
    at = np.array([numbers(collision.find("pose").text)[:3] for collision in found])
    sizes = np.array([numbers(collision.find("geometry/box/size").text) for collision in found])
    cos, sin = np.cos(yaw), np.sin(yaw)
    return at @ [[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]] + np.array([x, y, 0]), sizes


def seen_from_above(mesh, grid):
    """Draw the faces that look up onto the map's cells, four pixels each; return those covered."""
    up = mesh.face_normals[:, 2] > 0.5
    corners = mesh.triangles[up][:, :, :2].reshape(-1, 2)
    at = grid.frame.continuous_rowcol_from_xy(corners).reshape(-1, 3, 2)[:, :, ::-1] * 4 - 0.5
    image = Image.new("1", (grid.shape[1] * 4, grid.shape[0] * 4))
    draw = ImageDraw.Draw(image)
    for row in np.round(at, 4).reshape(len(at), 6).tolist():
        draw.polygon(row, fill=1)
    return np.asarray(image)[2::4, 2::4]


@pytest.mark.parametrize("ending", [".stl", ".obj"])
@pytest.mark.parametrize(("unknown", "walls"), [("free", [100]), ("occupied", [100, -1])])
def test_meshes_are_closed_solids_of_the_walls_in_the_map_frame(converted, ending, unknown, walls):
    options = "--wall-height", "1.5", "--unknown", unknown
    mesh = trimesh.load_mesh(converted(GRID, f"w{ending}", *options))
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    cells = np.isin(GRID.occupancy, walls).sum()
    tolerance = 1e-8 if ending == ".obj" else 1e-5  # STL has float32
    assert mesh.volume == pytest.approx(cells * 0.25**2 * 1.5, rel=tolerance)
    assert mesh.bounds[:, 2].tolist() == [0, 1.5]
    corners = GRID.frame.xy_from_continuous_rowcol([[0, 0], [0, 8], [4, 8], [4, 0]])
    assert mesh.bounds[0, :2] == pytest.approx(corners.min(axis=0), abs=1e-5)
    assert mesh.bounds[1, :2] == pytest.approx(corners.max(axis=0), abs=1e-5)


TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])


@given(
    st.floats(0, 7), st.floats(0, 7), st.sampled_from([0.05, 0.25, 1.0]),
    st.sampled_from([0.0, 0.4, 2.0]), arrays(np.bool_, (4, 9)).filter(np.any),
)  # fmt: skip
def test_stl_keeps_walls_of_distant_maps_or_is_refused(x_log, y_log, cell, yaw, walls):
    frame = Frame(*walls.shape, cell, (10.0**x_log, -(10.0**y_log), yaw))
    mesh = mesh_of(surface(walls), frame, 2.0)
    moved = np.abs(mesh.corners.astype(np.float32) - mesh.corners).max()
    try:
        data = b"".join(stl_parts(mesh, Path("m.yaml"), cell))
    except ParameterError as refusal:
        assert "too far from 0 for .stl" in str(refusal)
        assert moved > 1e-3 * cell
        return
    corners = np.frombuffer(data[84:], TRIANGLE)["corners"].astype(float)
    assert np.abs(corners - mesh.corners[mesh.triangles]).max() <= cell / 10
    sides = np.diff(corners, axis=1)
    assert (np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1) > 0).all()


@pytest.mark.parametrize(("yaw", "moved"), [(0.0, "0.2"), (0.4, "0.23")])
def test_maps_in_utm_coordinates_become_obj_but_not_stl(tmp_path, command, converted, yaw, moved):
    grid = grid_from_text(TEXT, 0.05, (500000.0, 5400000.0, yaw))
    mesh = trimesh.load_mesh(converted(grid, "m.obj"))
    least = np.min(grid.frame.xy_from_continuous_rowcol([[0, 0], [4, 0]]), axis=0)
    assert mesh.bounds[0, :2] == pytest.approx(least, abs=1e-6)
    path = tmp_path / "map.yaml"
    code, out, err = command("convert", path, "-o", tmp_path / "m.stl")
    assert (code, out) == (2, "")
    rule = f"is too far from 0 for .stl, whose float32 moves walls by up to {moved} m"
    hint = f"mapdeal convert {path} -o map.obj keeps all digits"
    assert err == f"error: {path}: origin: {rule}\nhint: {hint}\n"
    assert not (tmp_path / "m.stl").exists()


def test_whole_metres_of_distant_maps_are_exact_in_stl(converted):
    data = converted(grid_from_text(TEXT, 1.0, (500000.0, 5400000.0, 0.0)), "m.stl").read_bytes()
    corners = np.frombuffer(data[84:], TRIANGLE)["corners"]
    assert corners.min(axis=(0, 1)).tolist() == [500000, 5400000, 0]
    assert corners.max(axis=(0, 1)).tolist() == [500008, 5400004, 2]


def test_boxes_are_the_walls_where_the_map_has_them(converted):
    path = converted(GRID, "w.sdf", "--wall-height", "1.5")
    at, sizes = boxes_in(path)
    assert sizes.prod(axis=1).sum() == pytest.approx((GRID.occupancy == 100).sum() * 0.25**2 * 1.5)
    assert (sizes[:, 2] == 1.5).all()
    assert (at[:, 2] == 0.75).all()
    places = GRID.frame.continuous_rowcol_from_xy(at[:, :2])
    covered = np.zeros(GRID.shape, int)
    for (row, col), (wide, deep, _) in zip(places, sizes / 0.25, strict=True):
        sides = (row, deep), (col, wide)
        covered[tuple(slice(round(v - d / 2), round(v + d / 2)) for v, d in sides)] += 1
    assert np.array_equal(covered, GRID.occupancy == 100)
    assert np.array_equal(boxes_in(path, "visual")[0], at)


NUMBER = r"[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?"
# Of SDFormat 1.7, what a world uses: children with how often they may occur, and attributes; or a
# value's form.
SDF = {
    "sdf": ("world+", ["version"]),
    "world": ("gravity magnetic_field atmosphere physics+ scene light* model*", ["name"]),
    "physics": ("max_step_size real_time_factor real_time_update_rate", ["type"]),
    "scene": ("ambient background shadows", []),
    "light": ("cast_shadows? pose? diffuse? specular? direction", ["name", "type"]),
    "model": ("static? pose? link*", ["name"]), "link": ("collision* visual*", ["name"]),
    "collision": ("pose? geometry", ["name"]), "visual": ("pose? geometry material?", ["name"]),
    "geometry": ("box? plane?", []), "box": ("size", []), "plane": ("normal size", []),
    "material": ("ambient? diffuse?", []), "atmosphere": ("", ["type"]), "box/size": 3,
    **dict.fromkeys(["max_step_size", "real_time_factor", "real_time_update_rate"], 1),
    **dict.fromkeys(["gravity", "magnetic_field", "direction", "normal"], 3), "plane/size": 2,
    **dict.fromkeys(["ambient", "background", "diffuse", "specular"], 4), "pose": 6,
    **dict.fromkeys(["static", "shadows", "cast_shadows"], "(true|false)"),
}  # fmt: skip


def check_element(element, parent=""):
    rule = SDF.get(f"{parent}/{element.tag}", SDF.get(element.tag))
    if not isinstance(rule, tuple):
        form = " ".join([NUMBER] * rule) if isinstance(rule, int) else rule
        assert re.fullmatch(form, element.text), (element.tag, element.text)
        return
    children, attributes = rule
    assert sorted(element.attrib) == attributes
    tags = [child.tag for child in element]
    for word in children.split():
        tag = word.rstrip("?*+")
        assert re.fullmatch(f"x{word[len(tag) :]}", "x" * tags.count(tag)), (element.tag, tag)
        tags = [following for following in tags if following != tag]
    assert tags == [], element.tag
    names = [child.get("name") for child in element if child.get("name")]
    assert len(names) == len(set(names))
    for child in element:
        check_element(child, element.tag)


def test_worlds_follow_the_rules_of_sdformat(converted):
    root = parsed(converted(GRID, "w.sdf"))
    assert root.get("version") == "1.7"
    check_element(root)
    floor = next(model for model in root.iter("model") if model.get("name") == "floor")
    x, y, z, *_, yaw = numbers(floor.find("pose").text)
    middle = GRID.frame.xy_from_continuous_rowcol([[2, 4]])[0]
    assert (x, y, z, yaw) == pytest.approx((*middle, 0, 0.4), abs=1e-5)


NOT_IN_XML = "[\x00-\x08\x0b\x0c\x0e-\x1f\ud800-\udfff\ufffe\uffff]"  # XML 1.0, section 2.2


@pytest.mark.parametrize("name", [
    b"m\xff", b"m\xed\xa0\x80", b"m\x01\x1b", b"m\n\t", b"m\xef\xbf\xbe<&", b'm"]]>\xef\xbf\xbf',
    b"m\\",
])  # fmt: skip
def test_files_are_well_formed_whatever_the_map_is_called(tmp_path, command, converted, name):
    source = tmp_path / f"{os.fsdecode(name)}.npz"
    try:
        write_map(source, GRID)
    except OSError:
        pytest.skip("the file system does not have this name")
    assert parsed(converted(source, "w.sdf")).find("world").get("name").startswith("m")
    title = "{http://www.w3.org/2000/svg}title"
    assert parsed(converted(source, "w.svg")).find(title).text.startswith("m")
    lines = converted(source, "w.obj").read_text().splitlines()
    assert lines[1].startswith("o m")
    assert len([line for line in lines if re.match("[vf] ", line)]) == len(lines) - 2
    assert trimesh.load_mesh(tmp_path / "w.obj").is_watertight
    report = ET.fromstring(command("lint", source, "--format", "junit")[1].encode())  # noqa: S314
    assert report.find("testsuite/testcase").get("name").startswith("m")
    assert command("report", source, "-o", tmp_path / "w.html")[0] == 0
    assert not re.search(NOT_IN_XML, (tmp_path / "w.html").read_text(encoding="utf-8"))


def test_all_characters_that_xml_forbids_are_escaped():
    forbidden = re.findall(NOT_IN_XML, "".join(map(chr, range(0x110000))))
    assert len(forbidden) == 29 + 2048 + 2
    assert re.fullmatch("[!-~]+", one_line("".join(forbidden)))


@pytest.mark.parametrize("name", REAL)
def test_worlds_of_real_maps(real_maps, converted, name, mapdeal_warnings):
    grid = read_map(real_maps / name)
    walls = grid.occupancy == 100
    volume = walls.sum() * grid.resolution**2 * 2.0
    mesh = trimesh.load_mesh(converted(real_maps / name, "w.obj"))
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(volume, rel=1e-9)
    assert np.array_equal(seen_from_above(mesh, grid), walls)
    _, sizes = boxes_in(converted(real_maps / name, "w.sdf"))
    assert sizes.prod(axis=1).sum() == pytest.approx(volume, rel=1e-9)


@pytest.mark.slow
def test_large_worlds_take_few_bytes(converted):
    rng = np.random.default_rng(4)
    values = np.zeros((2000, 2000), np.int8)
    for row, col in rng.integers(0, 1900, (100, 2)).tolist():
        values[row : row + 4, col : col + 100] = values[row : row + 100, col : col + 4] = 100
    grid = OccupancyGrid(values, 0.05, (-100.0, -100.0, 0.0))
    count = int((values == 100).sum())
    for ending in (".sdf", ".stl", ".obj"):
        assert converted(grid, f"w{ending}").stat().st_size <= 40 * count
