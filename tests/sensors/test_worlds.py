"""Worlds and meshes: shapes and poses against trimesh's sections, and faulty files."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st

from mapdeal import FileAccessError, MalformedInputError, MapdealWarning
from mapdeal.grid.frame import Frame
from mapdeal.mapping.world_map import inside_runs, section_at, surface_cells
from mapdeal.sensors.meshes import read_mesh, strips_of
from mapdeal.sensors.worlds import read_world

trimesh, shapely = pytest.importorskip("trimesh"), pytest.importorskip("shapely")

BOX = "<box><size>1 0.6 2</size></box>"
FRAME = Frame(80, 80, 0.05, (-2.0, -2.0, 0.0))


def sdf(body):
    return f'<sdf version="1.9"><world name="w">{body}</world></sdf>'


def model(geometry, pose="0 0 0 0 0 0", *, shape_pose=""):
    shape = f'<collision name="c">{shape_pose}<geometry>{geometry}</geometry></collision>'
    link = f'<link name="l">{shape}</link>'
    return f'<model name="m"><static>1</static><pose>{pose}</pose>{link}</model>'


def write_world(folder, text, name="w.sdf"):
    (folder / name).write_text(text)
    return folder / name


def section_of(path, height=0.1, **options):
    world = read_world(path, **options)
    return inside_runs(section_at(world.triangles, world.solids, height), FRAME).depths() > 0


def outline_by_trimesh(mesh, height=0.1):
    """Return the cells inside, and each cell's distance from the outline."""
    lines = trimesh.intersections.mesh_plane(mesh, [0, 0, 1], [0, 0, height])[:, :, :2]
    centres = FRAME.xy_from_rowcol(np.indices(FRAME.shape).reshape(2, -1).T)
    distance = shapely.distance(shapely.points(centres), shapely.multilinestrings(lines))
    (x0, y0), (x1, y1) = lines.transpose(1, 2, 0)
    x, y = centres.T[:, :, np.newaxis]
    with np.errstate(divide="ignore", invalid="ignore"):
        is_left = x < x0 + (y - y0) / (y1 - y0) * (x1 - x0)
    crossings = (((y0 > y) != (y1 > y)) & is_left).sum(axis=1)
    return (crossings % 2 == 1).reshape(FRAME.shape), distance.reshape(FRAME.shape)


def section_by_trimesh(mesh):
    inside, distance = outline_by_trimesh(mesh)
    return inside, distance <= FRAME.resolution / 2


def move_to(mesh, pose):
    turn = trimesh.transformations.euler_matrix(*pose[3:], "sxyz")
    turn[:3, 3] = pose[:3]
    return mesh.apply_transform(turn)


def ball(*radii):
    return trimesh.creation.uv_sphere(1.0, count=[32, 64]).apply_scale(radii)


def capsule():
    mesh = trimesh.creation.capsule(height=1.0, radius=0.4, count=[32, 64])
    return mesh.apply_translation(-mesh.bounds.mean(axis=0))


NOTCHED = [(-1, -0.5), (1, -0.5), (1, 0.8), (0.2, 0.8), (0.2, 0), (-0.2, 0), (-0.2, 0.8), (-1, 0.8)]
BLOCKS = [(-1, -0.5, 0.3, 0), (0.9, -0.5, 1, 0), (0.3, -0.5, 0.9, -0.4), (0.3, -0.1, 0.9, 0),
          (-1, 0, -0.2, 0.8), (0.2, 0, 1, 0.8)]  # fmt: skip
HOLE = [(0.3, -0.4), (0.3, -0.1), (0.9, -0.1), (0.9, -0.4)]


def notched(*, hole=True):
    """The extruded outline, as boxes that touch: x0, y0, x1, y1 of each."""
    blocks = BLOCKS if hole else [*BLOCKS, (0.3, -0.4, 0.9, -0.1)]
    boxes = [trimesh.creation.box(bounds=[[a, b, 0], [c, d, 0.7]]) for a, b, c, d in blocks]
    return trimesh.util.concatenate(boxes)


def polyline(*rings):
    points = ("".join(f"<point>{x} {y}</point>" for x, y in ring) for ring in rings)
    return "".join(f"<polyline>{ring}<height>0.7</height></polyline>" for ring in points)


CYLINDER = "<cylinder><radius>0.5</radius><length>2</length></cylinder>"
SHAPES = {
    "box": (BOX, lambda: trimesh.creation.box((1, 0.6, 2))),
    "cylinder": (CYLINDER, lambda: trimesh.creation.cylinder(0.5, 2, sections=128)),
    "cone": ("<cone><radius>0.9</radius><length>2</length></cone>",
             lambda: trimesh.creation.cone(0.9, 2, sections=128).apply_translation([0, 0, -1])),
    "sphere": ("<sphere><radius>0.8</radius></sphere>", lambda: ball(0.8, 0.8, 0.8)),
    "ellipsoid": ("<ellipsoid><radii>1 0.4 0.7</radii></ellipsoid>", lambda: ball(1, 0.4, 0.7)),
    "capsule": ("<capsule><radius>0.4</radius><length>1</length></capsule>", capsule),
    "polyline": (polyline(NOTCHED, HOLE), notched),
    "clockwise": (polyline(NOTCHED[::-1]), lambda: notched(hole=False)),
}  # fmt: skip


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("pose", [(0.3, -0.2, 0.05, 0, 0, 0.7), (-0.2, 0.1, 0.0, 0.9, -0.5, 2.0)])
def test_shapes_have_the_sections_of_trimesh(tmp_path, name, pose):
    geometry, mesh_of = SHAPES[name]
    text = " ".join(map(str, pose))
    inside, distance = outline_by_trimesh(move_to(mesh_of(), pose))
    path = write_world(tmp_path, sdf(model(geometry, text)))
    assert inside.sum() > 50
    assert not (section_of(path) != inside)[distance > FRAME.resolution / 2].any()
    world = read_world(path)
    section = section_at(world.triangles, world.solids, 0.1)
    walls = surface_cells(section, FRAME, inside_runs(section, FRAME))
    # up to the error of chords
    assert not walls[distance > 0.51 * FRAME.resolution].any()
    if mesh_of is not notched and name != "clockwise":  # outlines of its boxes pass the inside
        assert walls[distance < 0.43 * FRAME.resolution].all()


def test_a_thin_leg_between_centres_of_cells_is_one_cell(tmp_path):
    world = read_world(write_world(tmp_path, sdf(model("<box><size>0.01 0.01 1</size></box>"))))
    section = section_at(world.triangles, world.solids, 0.1)
    rows, cols = np.nonzero(surface_cells(section, FRAME, inside_runs(section, FRAME)))
    assert len(rows) == 1
    assert np.abs(FRAME.xy_from_rowcol(np.stack([rows, cols], axis=1))).max() < FRAME.resolution


NESTED = """\
<frame name="f"><pose relative_to="g">0.2 0 0 0 0 0.5</pose></frame>
<frame name="g"><pose degrees="true">0 0.3 0 0 0 90</pose></frame>
<model name="outer"><static>1</static><pose relative_to="f">0.1 0 0 0 0 0.3</pose>
<model name="m" placement_frame="l"><pose>0.2 0.1 0 0 0 -0.4</pose><link name="l">
<pose>5 5 0 0 0 1</pose><collision name="c"><pose rotation_format="quat_xyzw">\
0.1 0 0 0 0 0.958851077208406 1.7551651237807455</pose><geometry>{}</geometry></collision>
</link>
<joint name="l" type="fixed"><parent>world</parent><child>l</child></joint></model></model>"""


def test_frames_nested_models_and_placement(tmp_path):
    mesh = trimesh.creation.box((1, 0.6, 2))
    for pose in ((0.1, 0, 0, 0, 0, 1.0), (0.2, 0.1, 0, 0, 0, -0.4), (0.1, 0, 0, 0, 0, 0.3),
                 (0.2, 0, 0, 0, 0, 0.5), (0, 0.3, 0, 0, 0, np.pi / 2)):  # fmt: skip
        move_to(mesh, pose)
    inside, near = section_by_trimesh(mesh)
    assert not (section_of(write_world(tmp_path, sdf(NESTED.format(BOX)))) != inside)[~near].any()


def dae_of(mesh, unit, up):
    axes = {"Z_UP": np.eye(3), "Y_UP": [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
            "X_UP": [[0, 0, 1], [-1, 0, 0], [0, -1, 0]]}[up]  # fmt: skip
    corners, stride = (mesh.vertices @ np.transpose(axes) / unit - [1, 2, 3]) / 2, ""
    if up == "Z_UP":
        stride = "<technique_common><accessor stride='4'/></technique_common>"
        corners = np.pad(corners, ((0, 0), (0, 1)), constant_values=7.0)
    faces = " ".join(f"{k} 0" for k in mesh.faces.ravel())
    return f"""<COLLADA><asset><unit meter="{unit}"/><up_axis>{up}</up_axis></asset>
<library_geometries><geometry id="g"><mesh><source id="p"><float_array>\
{" ".join(map(str, corners.ravel()))}</float_array>{stride}</source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices><polylist>
<input semantic="VERTEX" source="#v" offset="0"/><input semantic="NORMAL" source="#n" offset="1"/>
<vcount>{"3 " * len(mesh.faces)}</vcount><p>{faces}</p></polylist></mesh></geometry>
</library_geometries><library_visual_scenes><visual_scene id="s"><node id="n1">
<translate>1 2 3</translate><scale>2 2 2</scale><instance_geometry url="#g"/></node></visual_scene>
</library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


@pytest.mark.parametrize("scale", [(1, 1, 1), (-0.8, 1.2, 1)])
@pytest.mark.parametrize("form", ["binary", "ascii", "ASCII", "obj", "Z_UP", "Y_UP", "X_UP"])
def test_meshes_in_worlds(tmp_path, form, scale):
    mesh = notched()
    if form == "binary":
        mesh.invert()
    name = {"obj": "a.obj"}.get(form, "a.dae" if form.endswith("UP") else "a.stl")
    if form.endswith("UP"):
        write_world(tmp_path, dae_of(mesh, 0.0254, form), name)
    elif form.lower() == "ascii":
        halves = [mesh.submesh([part], append=True) for part in np.split(np.arange(72), [24])]
        text = "\n".join(map(trimesh.exchange.stl.export_stl_ascii, halves))
        write_world(tmp_path, text if form == "ascii" else text.upper().replace("\n", "\r\n"), name)
    else:
        mesh.export(tmp_path / name)
    numbers = " ".join(map(str, scale))
    geometry = f"<mesh><uri>{name}</uri><scale>{numbers}</scale></mesh>"
    mesh.vertices *= scale
    inside, near = section_by_trimesh(move_to(mesh, (0.1, 0.2, -0.1, 0.4, 0.2, 1.0)))
    world = write_world(tmp_path, sdf(model(geometry, "0.1 0.2 -0.1 0.4 0.2 1")))
    assert not (section_of(world) != inside)[~near].any()


OBJ_LINES = ["v {0} {1} {2}", "\tv  {0} {1}\t{2} 0.5", "v {0} {1} {2} .1 .2 .3 # red", "vn 0 0 1",
             "vt 1 0", "# f 1 2 3", "f {3} {4} {5}", "f {3}/1/2 {4}//3 {5}/7 {5}", "g a b", "o", "",
             "f {3} \\\n{4} {5} # last", "usemtl f", "s off"]  # fmt: skip


def obj_by_lines(text):
    corners, parts = [], [((), [])]
    for line in text.replace("\\\n", " ").split("\n"):
        key, *words = line.partition("#")[0].split() or [""]
        if key == "v":
            corners.append([float(word) for word in words[:3]])
        elif key == "f":
            numbers = [int(word.split("/")[0]) for word in words]
            a, *more = [corners[number - (number > 0)] for number in numbers]
            parts[-1][1].extend([a, b, c] for b, c in pairwise(more))
        elif key in ("g", "o"):
            parts.append((tuple(words), []))
    return [(names, sorted(triangles)) for names, triangles in parts]


@given(st.randoms(use_true_random=False), st.integers(20, 60), st.sampled_from(["\n", "\r\n"]))
def test_obj_in_pieces_equals_a_reader_of_lines(tmp_path_factory, random, length, eol):
    lines, count = ["v 0 0 1"] * 4 + ["f 1 2 3"], 4
    for line in random.choices(OBJ_LINES, k=length):
        x, y, z = (f"{random.random():{form}}" for form in random.choices([".6f", "e"], k=3))
        corners = random.choices(range(1, count + 1), k=3)
        lines.append(line.format(x, y, z, *[random.choice([k, k - count - 1]) for k in corners]))
        count += line.strip().startswith("v ")
    path = tmp_path_factory.mktemp("o") / "a.obj"
    path.write_text(eol.join(lines), newline="")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mapdeal.sensors.meshes._PIECE", 100)
        found = [(names, sorted(triangles.tolist())) for names, triangles in read_mesh(path)]
    assert found == [part for part in obj_by_lines("\n".join(lines)) if part[1]]


def test_a_concave_face_leaves_its_notch_open(tmp_path):
    corners = "".join(f"v {x} 0 {z}\n" for x, z in NOTCHED)
    path = write_world(tmp_path, f"o wall\n{corners}f {' '.join('12345678')}\n", "w.obj")
    wall = read_world(path, floor=0.0)
    section = section_at(wall.triangles, wall.solids, 0.5)
    assert np.abs(section.begin[:, 0]).min() >= 0.2  # no wall in the doorway
    assert np.abs(section.begin - section.end)[:, 0].sum() == pytest.approx(1.6)


@given(st.integers(0, 2**32), st.integers(3, 40), st.sampled_from([0, 1, 2]))
def test_strips_cover_the_area_between_rings(seed, count, axis):
    rng = np.random.default_rng(seed)
    angles = np.sort(rng.uniform(-3, 3, count))
    outline = rng.uniform(2, 3, (count, 1)) * np.column_stack([np.cos(angles), np.sin(angles)])
    assume(shapely.Polygon(outline).is_valid)  # few corners on one side may cross
    rings = [outline, [(-0.5, 0.1), (0.2, 0.6), (0.2, -0.7)][: 3 * (count > 20)]]
    area = shapely.Polygon(outline).symmetric_difference(shapely.Polygon(rings[1]))
    spots = [np.roll(np.insert(np.reshape(ring, (-1, 2)), 2, 0.0, axis=1), axis - 2, 1)
             for ring in rings]  # fmt: skip
    parts = shapely.polygons(np.roll(strips_of(spots, "w.sdf", axis), 2 - axis, axis=2)[:, :, :2])
    covered = shapely.union_all(parts, grid_size=1e-9)
    assert shapely.area(parts).sum() == pytest.approx(area.area)
    assert shapely.area(shapely.symmetric_difference(covered, area, grid_size=1e-9)) < 1e-6
    assert shapely.is_ccw(shapely.get_exterior_ring(parts[shapely.area(parts) > 1e-9])).all()


def test_urdf_joints_are_chained_and_visual_shapes_are_read_on_request(tmp_path):
    text = """<robot name="r"><link name="a"><visual><geometry><sphere radius="0.2"/></geometry>
</visual></link><link name="b"><collision><origin xyz="0.1 0 0" rpy="0 0 0.3"/><geometry>
<box size="1 0.6 2"/></geometry></collision></link><joint name="j" type="fixed">
<origin xyz="0.2 0.4 0" rpy="0 0 0.5"/><parent link="a"/><child link="b"/></joint></robot>"""
    path = write_world(tmp_path, text, "r.urdf")
    mesh = move_to(move_to(trimesh.creation.box((1, 0.6, 2)), (0.1, 0, 0, 0, 0, 0.3)),
              (0.2, 0.4, 0, 0, 0, 0.5))  # fmt: skip
    inside, near = section_by_trimesh(mesh)
    assert not (section_of(path) != inside)[~near].any()
    inside, near = section_by_trimesh(ball(0.2, 0.2, 0.2))
    assert not (section_of(path, visual=True) != inside)[~near].any()


def test_models_are_found_in_folders_variables_and_beside_the_world(tmp_path, monkeypatch):
    folder = tmp_path / "here" / "models" / "crate"
    folder.mkdir(parents=True)
    write_world(folder, f'<sdf version="1.7">{model(BOX, "9 9 9 0 0 0")}</sdf>', "crate-1_7.sdf")
    write_world(folder, "<sdf/>", "crate.sdf")
    config = '<sdf version="1.4">crate.sdf</sdf><sdf version="1.7">crate-1_7.sdf</sdf>'
    write_world(folder, f"<model>{config}</model>", "model.config")
    include = "<include><uri>model://crate</uri><pose>0 0 0 0 0 0</pose></include>"
    include += "<include><uri>model://sun</uri></include>"
    (folder.parent / "sun").mkdir()
    write_world(folder.parent / "sun", "<sdf><light/></sdf>", "model.sdf")
    elsewhere = tmp_path / "world" / "deep"
    elsewhere.mkdir(parents=True)
    path = write_world(elsewhere, sdf(include))
    with pytest.raises(FileAccessError, match="include model://crate: there is no such file"):
        read_world(path)
    expected = section_of(write_world(tmp_path, sdf(model(BOX)), "box.sdf"))
    assert np.array_equal(section_of(path, model_path=[folder.parent]), expected)
    monkeypatch.setenv("GZ_SIM_RESOURCE_PATH", f"/nowhere:{folder.parent}")
    assert np.array_equal(section_of(path), expected)
    monkeypatch.delenv("GZ_SIM_RESOURCE_PATH")
    assert np.array_equal(section_of(write_world(tmp_path / "here", sdf(include))), expected)


def test_saved_states_and_moving_models(tmp_path):
    text = model(BOX, "1 1 0 0 0 0").replace("<static>1</static>", "")
    link = '<link name="l"><pose>0 0 0 0 0 0</pose></link>'  # where it is in the world
    state = f'<state><model name="m"><pose>3 2 0 0 0 1</pose>{link}</model></state>'
    path = write_world(tmp_path, sdf(text + state + model(CYLINDER).replace('"m"', '"n"')))
    assert np.array_equal(section_of(path), section_of(write_world(tmp_path, sdf(
        model(BOX) + model(CYLINDER).replace('"m"', '"n"')), "b.sdf")))  # fmt: skip
    world = read_world(path, static_only=True)
    assert (world.moving, world.solid_count) == (1, 1)


def test_what_is_not_modelled_is_named(tmp_path):
    state = '<model name="m"><pose>0 0 0 0 0 0</pose><scale>1 2 1</scale></model>'
    text = f'<actor name="a"/><population name="p"/>{model(BOX)}<state>{state}</state>'
    with pytest.warns(MapdealWarning, match="3 not modelled: actor a, population p, state: "):
        read_world(write_world(tmp_path, sdf(text)))


LAUGHS = '<!DOCTYPE l [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]>'
SELF = '<sdf version="1.7"><model name="m"><include><uri>w.sdf</uri></include></model></sdf>'
TWICE = "<node id='n{0}'><instance_node url='#n{1}'/><instance_node url='#n{1}'/></node>"
DOUBLES = "".join(TWICE.format(k, k + 1) for k in range(40)) + "<node id='n40'/>"
PART = "<visual_scene id='s'><node>"
END = "</node></visual_scene><scene><instance_visual_scene url='#s'/></scene></COLLADA>"
SHAPE = f"<COLLADA><geometry id='g'>{{}}</geometry>{PART}<instance_geometry url='#g'/>{END}"
JOINT = "<joint name='j'><parent link='{}'/><child link='{}'/></joint>"
FAULTS = {
    "unknown": (sdf(model("<bux/>")), "collision c: bux: is no shape"),
    "heightmap": (sdf(model("<heightmap/>")), "heightmap: is not supported"),
    "no size": (sdf(model("<box/>")), "box: size: must be 3 finite numbers, got ''"),
    "nan": (sdf(model("<sphere><radius>nan</radius></sphere>")), "must be 1 finite numbers"),
    "negative": (sdf(model("<sphere><radius>-1</radius></sphere>")), "must be above 0"),
    "far": (sdf(model(CYLINDER.replace("0.5", "1e308"))), "must lie within 1e+12 m"),
    "pose": (sdf(model(BOX, "1 2 3")), "model m: pose: must be 6 finite numbers"),
    "frame": (sdf(model(BOX, shape_pose="<pose relative_to='q'/>")), "must be a frame here"),
    "empty": (sdf(""), "has no collision shapes"),
    "two": ("<sdf><world/><world/></sdf>", "sdf: must have one world"),
    "itself": (SELF, "include w.sdf: includes itself"),
    "entities": (LAUGHS + sdf("&b;"), "line 1: must not declare entities, got 'a'"),
    "external": ('<!DOCTYPE l [<!ENTITY a SYSTEM "file:///etc/passwd">]>' + sdf("&a;"),
                 "must not declare entities"),
    "deep": ("<sdf>" + "<a>" * 100_000, "200 deep"),
    "text": ("hello", "is not well-formed XML"),
    "html": ("<html/>", "first element: must be sdf or robot"),
    "a.urdf": ("<robot xmlns:xacro='x'><xacro:macro/></robot>", "is xacro that is not expanded"),
    "b.urdf": ("<robot><link name='${n}'/></robot>", "link: is xacro that is not expanded"),
    "twins": (sdf(model(BOX).replace("</model>", '<link name="l"/></model>')),
              "link l: must have a name that no other element has"),
    "nameless": (sdf(model(BOX).replace(' name="l"', "")),
                 "must have a name that no other element has"),
    "c.urdf": (f"<robot><link name='a'/>{JOINT.format('aa', 'a')}</robot>",
               "joint j: parent: must be a link here, got 'aa'"),
    "roots.urdf": ("<robot><link name='a'/><link name='b'/></robot>",
                   "robot: must have one link without a parent, got 'a, b'"),
    "d.urdf": (f"<robot><link name='a'/><link name='b'/>{JOINT.format('a', 'b') * 2}</robot>",
               "joint j: must be the only joint of its child, got 'b'"),
    "a.obj": ("v 0 0 0\nv 1 0 0\nf 1 2 3\n", "line 3: must be v and 3 finite"),
    "d.obj": ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 2 /3 3\nf 1 2 0\n", "line 5: must be v"),
    "e.obj": ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 2 0 3 1\n", "line 5: must be v"),
    "b.obj": ("v 0 0 0\nv 1 0 0\nv nan 0 1\nf 1 2 -1\n", "line 3: must be v and 3 finite"),
    "c.obj": ("", "has no triangles"),
    "a.stl": ("solid a\nfacet\nvertex 0 0 0\nendsolid\n", "ends within a triangle"),
    "b.stl": (" " * 80 + "\x7f\x7f\x7f\x7f" + " " * 50, "50 for each of its 2139062143 triangles"),
    "c.stl": ("version https://git-lfs.github.com/spec/v1\nsize 1\n", "is a Git LFS pointer"),
    "a.dae": ("<COLLADA/>", "has no triangles"),
    "b.dae": (f"<COLLADA>{PART}<instance_geometry url='#g'/>{END}",
              "must refer to a geometry of this file, got '#g'"),
    "d.dae": (SHAPE.format("<convex_mesh/>"), "geometry g: convex_mesh: is not supported"),
    "e.dae": (SHAPE.format("<mesh><polygons><ph/></polygons></mesh>"), "ph: must not have holes"),
    "c.dae": (f"<COLLADA>{DOUBLES}{PART}<instance_node url='#n0'/>{END}",
              "scene: must have at most 1000 nodes"),
}  # fmt: skip


@pytest.mark.parametrize("name", FAULTS)
def test_faults_are_named(tmp_path, monkeypatch, name):
    monkeypatch.setattr("mapdeal.sensors.meshes.MOST_INSTANCES", 1000)
    text, message = FAULTS[name]
    path = write_world(tmp_path, text, name if "." in name else "w.sdf")
    with pytest.raises(MalformedInputError) as caught:
        read_world(path)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("uri", ["model://a/b.stl", "file:///a/b.stl", "b.stl", "s3://a/b.stl", ""])
def test_missing_meshes_are_named(tmp_path, uri):
    path = write_world(tmp_path, sdf(model(f"<mesh><uri>{uri}</uri></mesh>")))
    with pytest.raises(FileAccessError, match="link l: collision c: mesh") as caught:
        read_world(path)
    assert uri in str(caught.value)
