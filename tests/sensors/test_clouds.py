"""Clouds, and OctoMap's files against trees written node by node."""

import io
import itertools
import math
import os
import struct
import zipfile

import numpy as np
import pytest
from hypothesis import given, strategies as st

from clouds import pcd, pcd_header, ply
from mapdeal import FileAccessError, MalformedInputError, MapdealWarning, read_cloud
from mapdeal.sensors import clouds as arrays
from mapdeal.sensors.clouds import cloud_chunks

XYZ = [("x", "f4", 1), ("y", "f4", 1), ("z", "f4", 1)]
ODD = [("rgb", "u8", 1), ("z", "f4", 1), ("hist", "f4", 3), ("y", "f8", 1), ("_", "u1", 2),
       ("x", "i2", 1)]  # fmt: skip


def row(x, y, z):
    return [[2**40 + 1], [z], [0.5, 1.5, -9.0], [y], [7, 8], [x]]


@pytest.fixture
def read(tmp_path):
    def read_bytes(name, data):
        path = tmp_path / name
        path.write_bytes(data)
        return read_cloud(path)

    return read_bytes


POINTS = [(-3, 0.1, -2.5), (0, -7e9, 0.25), (32767, math.inf, 1.0)]


def test_damage_behind_the_used_part_of_an_entry_is_an_error(read):
    for order in "CF":
        table = np.asfortranarray(TABLE) if order == "F" else TABLE
        data = bytearray(saved(np.savez, points=table))
        data[data.index(TABLE[5, 3].tobytes())] ^= 1
        with pytest.raises(MalformedInputError, match="damaged"):
            read("c.npz", bytes(data))


def test_clouds_larger_than_one_part_are_read_completely(read):
    points = np.random.default_rng(5).normal(size=(700_000, 3)).astype("<f4")
    head = pcd_header(XYZ, len(points), "binary")
    np.testing.assert_array_equal(read("c.pcd", head + points.tobytes()), points)


def test_more_than_padding_behind_the_points_is_warned_of(read):
    for data in ("ascii", "binary"):
        with pytest.warns(MapdealWarning, match="after the points"):
            assert len(read("c.pcd", pcd(XYZ, [[[1.0]] * 3], data, padding=b"4 5 6\n"))) == 1


def saved(save, *args, **kwargs):
    file = io.BytesIO()
    save(file, *args, **kwargs)
    return file.getvalue()


TABLE = np.arange(24.0).reshape(6, 4)
PCD = ["ascii", "binary", "binary_compressed"]
ENCODINGS = ["ascii", "binary_little_endian", "binary_big_endian"]
FIELDS = [("red", "u1"), ("y", "f8"), ("x", "i2"), ("z", "f4"), ("q", "i4")]
FLAT = pcd([("y", "f8", 1), ("x", "f8", 1)], [[[0.1], [-2.0]], [[math.nan], [4.0]]], "ascii")
DOS = pcd(XYZ, [[[1.5], [2.5], [3.5]]], "ascii").replace(b"\n", b"\r\n")
RECORDS = np.array([(0, 3, 1), (0, 4, 2)], dtype=[("i", "u1"), ("y", "f4"), ("x", "f8")])
TWO_COLUMNS = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]])
TEXTS = {
    "plain": b"1 2 3\n-4 5e1 .6\n",
    "tabs": b"1\t2\t3\n-4\t50\t0.6\n",
    "csv": b"1,2,3\n-4, 50 ,0.6\n",
    "semicolons": b"1;2;3\n-4;50;0.6",
    "names": b'"y","x",label,"z"\n2,1,9,3\n50,-4,9,0.6\n',
    "names-of-cloudcompare": b"//X Y Z R G B\n1 2 3 0 0 0\n-4 50 0.6 0 0 0\n",
    "names-behind-slashes": b"// X Y Z I\n1 2 3 9\n-4 50 0.6 9\n",
    "comments": b"\xef\xbb\xbf# a\n\n# b\r\n1 2 3\r\n#\n-4 50 0.6\r\n",
    "more-columns": b"1 2 3 99 x\n-4 50 0.6\n",
    "a-count": b"2\n1 2 3 -99 1 1 1\n-4 50 0.6 7 2 2 2\n",
    "counts-of-two-scans": b"# pts\n1\n1 2 3 9\n1\n-4 50 0.6 9\n",
    "names-of-veloview": b'"Points_m_XYZ:0","Points_m_XYZ:1","Points_m_XYZ:2",intensity\n'
    b"1,2,3,9\n-4,50,0.6,9\n",
}


def between_others(encoding):
    before = {"ascii": b"1 2\n3 4\n", "binary_little_endian": b"\0" * 18}.get(encoding, b"\1" * 18)
    return ply(
        [("x", "f4"), ("y", "f4")], [(1.5, -2.0)], encoding,
        before=before, before_head="element camera 2\nproperty uchar a\nproperty double b",
        after=b"\3\0\0\0" if encoding != "ascii" else b"3 0 1 2\n",
        after_head="element face 1\nproperty list uchar int vertex_indices",
    )  # fmt: skip


def tables():
    for dtype, order in itertools.product(["f4", ">f8", "i2", "u1"], "CF"):
        table = np.asarray(TABLE, dtype=dtype, order=order)
        yield f"{dtype}-{order}.npy", saved(np.save, table), TABLE[:, :3]
        yield f"{dtype}-{order}.npz", saved(np.savez, table), TABLE[:, :3]
        packed = saved(np.savez_compressed, points=table, other=1)
        yield f"{dtype}-{order}-packed.npz", packed, TABLE[:, :3]


GOOD = [
    *[(f"{form}.pcd", pcd(ODD, [row(*p) for p in POINTS], form, padding=b"\0" * 9), POINTS)
      for form in PCD],
    *[(f"none-{form}.pcd", pcd(XYZ, [], form), np.zeros((0, 3))) for form in PCD],
    ("flat.pcd", FLAT, [[-2.0, 0.1], [4.0, math.nan]]),
    *[(f"{kind}.pcd", pcd([("x", kind, 1), ("y", kind, 1)], [[[1], [2]]]), [[1.0, 2.0]])
      for kind in ("i1", "i4", "i8", "u2", "u4")],
    ("old-name.pcd", pcd(XYZ, [[[1.0], [2.0], [3.0]]]).replace(b"FIELDS", b"COLUMNS"),
     [[1.0, 2.0, 3.0]]),
    ("windows.pcd", DOS.replace(b"ascii\r\n", b"ascii\r\n# the first\r\n\r\n"), [[1.5, 2.5, 3.5]]),
    *[(f"{form}.ply", ply(FIELDS, [(255, y, x, z, -(2**31)) for x, y, z in POINTS], form), POINTS)
      for form in ENCODINGS],
    *[(f"elements-{form}.ply", between_others(form), [[1.5, -2.0]]) for form in ENCODINGS],
    *[(f"{name}.{ending}", text, [[1.0, 2.0, 3.0], [-4.0, 50.0, 0.6]])
      for name, text in TEXTS.items() for ending in ("xyz", "TXT", "csv", "asc", "pts")],
    ("large-names.pcd", pcd(XYZ, [[[1.0], [2.0], [3.0]]]).replace(b"x y z", b"X Y Z"),
     [[1.0, 2.0, 3.0]]),
    ("kitti.bin", np.arange(12, dtype="<f4").tobytes(),
     [[0.0, 1.0, 2.0], [4.0, 5.0, 6.0], [8.0, 9.0, 10.0]]),
    ("flat.csv", b"x,y\n1,nan\n", [[1.0, math.nan]]),
    ("comment.xyz", b"# nothing\n", np.zeros((0, 3))),
    ("empty.xyz", b"", np.zeros((0, 3))),
    *tables(),
    ("records.npy", saved(np.save, RECORDS), [[1.0, 3.0], [2.0, 4.0]]),
    ("flat.npy", saved(np.save, TWO_COLUMNS), TWO_COLUMNS),
]  # fmt: skip


@pytest.mark.parametrize(("name", "data", "points"), [pytest.param(*c, id=c[0]) for c in GOOD])
def test_points_of_every_kind_of_file(read, name, data, points):
    np.testing.assert_array_equal(read(name, data), points)


@pytest.mark.parametrize("order", ["C", "F"])
def test_large_arrays_are_read_some_rows_at_a_time(tmp_path, monkeypatch, order):
    monkeypatch.setattr(arrays, "_BYTES_TOGETHER", 100)
    table = np.asarray(np.arange(70.0).reshape(10, 7), order=order)
    np.save(tmp_path / "c.npy", table)
    np.testing.assert_array_equal(read_cloud(tmp_path / "c.npy"), table[:, :3])


@pytest.mark.parametrize("order", ["C", "F"])
def test_an_array_that_gets_shorter_while_it_is_read_is_an_error(tmp_path, monkeypatch, order):
    """With a memory map, the process would crash."""
    monkeypatch.setattr(arrays, "_POINTS_TOGETHER", 3)
    path = tmp_path / "c.npy"
    np.save(path, np.asarray(np.ones((100_000, 3)), order=order))
    chunks = cloud_chunks(path)
    next(chunks)
    os.truncate(path, 200)
    with pytest.raises(FileAccessError, match="changed while it was read"):
        for _ in chunks:
            pass


SIGNALLING = struct.pack("<I", 0x7F800001)


@pytest.mark.parametrize("name", ["c.pcd", "c.ply", "c.npy"])
def test_a_signalling_nan_is_a_nan_without_a_warning(read, name):
    three = [1.0, 2.0, 3.0]
    data = {
        "c.pcd": pcd(XYZ, [[[v] for v in three]]),
        "c.ply": ply([("x", "f4"), ("y", "f4"), ("z", "f4")], [three], "binary_little_endian"),
        "c.npy": saved(np.save, np.array([three], "<f4")),
    }[name]
    points = read(name, data[:-8] + SIGNALLING + data[-4:])
    np.testing.assert_array_equal(points, [[1.0, math.nan, 3.0]])


SINGLES = st.floats(width=32, allow_nan=False, allow_infinity=False)


@given(points=st.lists(st.tuples(SINGLES, SINGLES, SINGLES), max_size=30))
def test_all_formats_agree(tmp_path_factory, points):
    folder = tmp_path_factory.mktemp("clouds")
    rows = [[[v] for v in point] for point in points]
    files = {
        **{f"{form}.pcd": pcd(XYZ, rows, form) for form in PCD},
        **{f"{e}.ply": ply([("x", "f4"), ("y", "f4"), ("z", "f4")], points, e) for e in ENCODINGS},
        "d.csv": "".join(f"{x!r},{y!r},{z!r}\n" for x, y, z in points).encode(),
        "d.pts": "\n".join([str(len(points)), *(" ".join(map(repr, p)) for p in points)]).encode(),
        "e.npy": saved(np.save, np.array(points, "f4").reshape(-1, 3)),
    }
    for name, data in files.items():
        (folder / name).write_bytes(data)
        assert read_cloud(folder / name).reshape(-1, 3).tolist() == [list(p) for p in points], name


def head(**changes):
    lines = {"FIELDS": "x y z", "SIZE": "4 4 4", "TYPE": "F F F", "COUNT": "1 1 1", "WIDTH": "1",
             "HEIGHT": "1", "POINTS": "1", "DATA": "binary", **changes}  # fmt: skip
    return "".join(f"{key} {value}\n" for key, value in lines.items() if value is not None).encode()


def ply_head(*lines):
    return "\n".join(["ply", *lines, "end_header", ""]).encode()


XY = ("property float x", "property float y")
OBJECT_RECORDS = np.zeros(2, dtype=[("x", "f4"), ("y", "f4"), ("o", "O")])


def deflated(shape, size, dtype="<f8", order=False):
    """Return an npz that declares a shape but contains only a number of zeros."""
    file = io.BytesIO()
    archive = zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED)
    with archive, archive.open("a.npy", "w") as entry:
        header = {"descr": dtype, "fortran_order": order, "shape": shape}
        np.lib.format.write_array_header_1_0(entry, header)
        for start in range(0, size, 1 << 20):
            entry.write(bytes(min(1 << 20, size - start)))
    return file.getvalue()


def lzf(body, **changes):
    return head(DATA="binary_compressed", **changes) + body


def binary(*lines, body=b""):
    return ply_head("format binary_little_endian 1.0", *lines) + body


TWELVE, BIG = bytes(12), "30000000"
CAMERA = "property int a", "element vertex 1", *XY
BAD = [
    ("nothing.pcd", b"", "header"),
    ("no-x.pcd", head(FIELDS="a y z") + TWELVE, "FIELDS"),
    ("x-of-two.pcd", head(COUNT="2 1 1") + bytes(16), "FIELDS"),
    ("sizes.pcd", head(SIZE="4 4") + TWELVE, "SIZE"),
    ("type.pcd", head(TYPE="F F D") + TWELVE, "TYPE"),
    ("points.pcd", head(POINTS="2") + bytes(24), "POINTS"),
    ("negative.pcd", head(WIDTH="-1", POINTS="-1"), "WIDTH"),
    ("encoding.pcd", head(DATA="zip"), "DATA"),
    ("short.pcd", head(WIDTH="2", POINTS="2") + bytes(23), "1 of 2"),
    ("short-text.pcd", head(WIDTH="2", POINTS="2", DATA="ascii") + b"1 2 3\n", "1 of 2"),
    ("words.pcd", head(DATA="ascii") + b"1 2 here\n", "line 9"),
    ("wide.pcd", head(DATA="ascii") + b"1 2 3 4\n", "line 9"),
    ("unknown-line.pcd", b"PIXELS 4\n" + head(), "line 1"),
    ("twice.pcd", b"WIDTH 1\n" + head(), "WIDTH"),
    ("claims-a-lot.pcd", head(WIDTH="1000000000000", POINTS="1000000000000"), "0 of"),
    ("lzf-sizes.pcd", lzf(struct.pack("<II", 4, 99)), "12 bytes"),
    ("lzf-damaged.pcd", lzf(struct.pack("<II", 2, 12) + b"\x30\x40"), "damaged"),
    ("lzf-short.pcd", lzf(struct.pack("<II", 9, 12) + b"\x30\x40"), "ends after 2 of 9 bytes"),
    ("lzf-bomb.pcd", lzf(struct.pack("<II", 3, 360_000_000) + b"\xe0\xff\x00", WIDTH=BIG,
                         POINTS=BIG), "damaged"),
    ("format.ply", ply_head("format binary_middle_endian 1.0"), "binary_middle_endian"),
    ("list.ply", binary("element vertex 1", *XY, "property list uchar int near"), "near"),
    ("list-before.ply", binary("element face 1", "property list uchar int at", "element vertex 1",
                               *XY), "at"),
    ("no-vertex.ply", binary("element face 0"), "vertex"),
    ("short.ply", binary("element vertex 2", *XY, body=bytes(15)), "1 of 2"),
    ("line-after.ply",
     ply_head("format ascii 1.0", "element camera 2", *CAMERA) + b"1\n2\n3 x\n", "line 11"),
    ("cameras.ply", binary("element camera 4", *CAMERA, body=bytes(8)),
     "element camera: ends after 8 of 16 bytes"),
    ("long-header.ply", b"ply\n" + b"comment a\n" * 110_000 + b"end_header\n", "header"),
    ("words.xyz", b"1 2 3\n4 five 6\n", "line 2"),
    ("fewer.csv", b"x,y,z\n1,2,3\n1,2\n", "line 3"),
    ("names.csv", b"lat,lon\n1,2\n", "x and y"),
    ("objects.npy", saved(np.save, np.array([[None, 1]]), allow_pickle=True), "npy"),
    ("flat.npy", saved(np.save, np.arange(6.0)), "(6,)"),
    ("complex.npy", saved(np.save, np.ones((2, 2), complex)), "numbers"),
    ("no-x.npy", saved(np.save, np.zeros(3, dtype=[("a", "f4"), ("y", "f4")])), "x and y"),
    ("cut.npy", saved(np.save, TABLE)[:-8], "npy"),
    ("long-header.npy", b"\x93NUMPY\2\0" + struct.pack("<I", 4 * 10**9) + b"{}", "4000000000"),
    ("object-field.npy", saved(np.save, OBJECT_RECORDS, allow_pickle=True), "must be numbers"),
    ("two.npz", saved(np.savez, a=TABLE, b=TABLE), "a, b"),
    ("claims-rows.npz", deflated((10**12, 3), 1000), "size"),
    ("claims-columns.npz", deflated((3, 10**12), 1000), "size"),
    ("bomb.npz", deflated((40_000_000, 3), 120_000_000, "|u1", order=True), "would expand"),
    ("wide.npz", saved(np.savez, np.zeros((1, 70_000), "u1")), "70000 columns"),
    ("none", b"1 2 3\n", ".pcd"),
    ("count.pts", b"3\n1 2 3\n4 5 6\n", "ends after 2 of 3 points"),
    ("cut.bin", bytes(30), "16 bytes for each point"),
    ("other.bin", np.full(8, 1e30, "<f4").tobytes(), "within 100000 m"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "data", "rule"), [pytest.param(*c, id=c[0]) for c in BAD])
def test_invalid_clouds_are_refused(read, name, data, rule):
    with pytest.raises(MalformedInputError) as caught:
        read(name, data)
    assert name in str(caught.value)
    assert rule in str(caught.value)
    assert "\n" not in str(caught.value)


def test_real_clouds(real_maps):
    """Two projects published one frame in two formats; bounds were read in cloud viewers."""
    frame = read_cloud(real_maps / "koide3__fast_gicp" / "251370668.pcd")
    assert frame.shape == (69088, 3)
    np.testing.assert_array_equal(frame, read_cloud(real_maps / "koide3__small_gicp/target.ply"))
    pcl = real_maps / "PointCloudLibrary__pcl"
    sizes = {"car6": 10031, "curve2d": 51, "lamppost": 1771, "office1_keypoints": 1318}
    for name, count in sizes.items():
        points = read_cloud(pcl / f"{name}.pcd")
        assert points.shape == (count, 3)
        assert np.isfinite(points).all()
    assert np.abs(read_cloud(pcl / "car6.pcd").mean(axis=0) - (-37, -65, -6)).max() < 1.5


FREE, OCCUPIED = "free", "occupied"
DEPTH, RESOLUTION = 16, 0.05


def trees(depth=3):
    """Return a strategy for nodes whose up to 8 children are states or nodes."""
    leaf = st.sampled_from([FREE, OCCUPIED])
    if depth == 0:
        return leaf
    return st.dictionaries(st.integers(0, 7), leaf | trees(depth - 1), min_size=1, max_size=4)


def deep(tree, path):
    for slot in reversed(path):
        tree = {slot: tree}
    return tree


def points_of(tree, key=(0, 0, 0), height=DEPTH):
    if tree == OCCUPIED:
        side, corner = range(1 << height), np.array(key) - (1 << (DEPTH - 1))
        yield from ((corner + [x, y, z] + 0.5) * RESOLUTION
                    for x in side for y in side for z in side)  # fmt: skip
    elif tree != FREE:
        for slot, child in tree.items():
            step = 1 << (height - 1)
            moved = [axis + step * (slot >> k & 1) for k, axis in enumerate(key)]
            yield from points_of(child, moved, height - 1)


def binary_nodes(tree):
    codes = {FREE: 1, OCCUPIED: 2}
    word = sum(codes.get(str(child), 3) << 2 * slot for slot, child in tree.items())
    inner = [tree[slot] for slot in sorted(tree) if isinstance(tree[slot], dict)]
    return struct.pack("<H", word) + b"".join(map(binary_nodes, inner))


def full_nodes(tree, colour):
    if not isinstance(tree, dict):
        return struct.pack("<f", 0.8 if tree == OCCUPIED else -0.4) + colour + b"\0"
    children = sum(1 << slot for slot in tree)
    nodes = b"".join(full_nodes(tree[slot], colour) for slot in sorted(tree))
    return struct.pack("<f", 0.8) + colour + bytes([children]) + nodes


def file_of(tree, kind, name="OcTree"):
    if kind == "bt":
        first, body = "# Octomap OcTree binary file", binary_nodes(tree)
    else:
        body = full_nodes(tree, b"abc" if name == "ColorOcTree" else b"")
        first = "# Octomap OcTree file"
    return f"{first}\n# (a comment)\nid {name}\nsize 9\nres {RESOLUTION}\ndata\n".encode() + body


@given(
    trees().filter(lambda tree: isinstance(tree, dict)),
    st.lists(st.integers(0, 7), min_size=11, max_size=12),
    st.sampled_from([("bt", "OcTree"), ("ot", "OcTree"), ("ot", "ColorOcTree")]),
)
def test_occupied_voxels_are_those_of_the_tree(tmp_path_factory, tree, path, kind):
    deep_tree = deep(tree, path)
    file = tmp_path_factory.mktemp("trees") / f"map.{kind[0]}"
    file.write_bytes(file_of(deep_tree, *kind))
    expected = np.reshape(list(points_of(deep_tree)), (-1, 3))
    found = read_cloud(file)
    assert found.shape == expected.shape
    assert np.allclose(found[np.lexsort(found.T)], expected[np.lexsort(expected.T)])


TREE = deep({0: OCCUPIED, 3: FREE, 5: {1: OCCUPIED}}, [0] * 12)
BAD_TREES = {
    "cut.bt": (file_of(TREE, "bt")[:-2], "ends within its tree"),
    "cut.ot": (file_of(TREE, "ot")[:-5], "ends within its tree"),
    "id.ot": (file_of(TREE, "ot", "OcTree").replace(b"id OcTree", b"id Forest"), "id"),
    "res.bt": (file_of(TREE, "bt").replace(b"res 0.05", b"res nan"), "res"),
    "head.bt": (b"# Octomap OcTree binary file\n" * 200, "does not end"),
    "deep.bt": (file_of(deep({0: OCCUPIED}, [0] * 17), "bt"), "16 levels"),
}


@pytest.mark.parametrize("name", BAD_TREES)
def test_damaged_trees_are_refused(tmp_path, name):
    data, rule = BAD_TREES[name]
    (tmp_path / name).write_bytes(data)
    with pytest.raises(MalformedInputError, match=rule):
        read_cloud(tmp_path / name)


def test_a_huge_occupied_leaf_is_refused_by_its_memory(tmp_path):
    (tmp_path / "map.bt").write_bytes(file_of({0: OCCUPIED}, "bt"))
    with pytest.raises(MalformedInputError, match="voxels"):
        read_cloud(tmp_path / "map.bt", max_memory=10**9)


def test_a_real_office(real_maps, command, tmp_path):
    folder = real_maps / "pal-robotics__pmb2_navigation" / "small_office"
    assert read_cloud(folder / "map.bt").shape == (216749, 3)
    assert read_cloud(folder / "map.ot").shape == (216751, 3)
    assert "build --cloud" in command("info", folder / "map.bt")[1]
    code, _, err = command("build", "--cloud", folder / "map.bt", "-o", tmp_path / "office.yaml")
    assert (code, err) == (0, "")
