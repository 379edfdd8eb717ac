"""OctoMap's files, against trees that the test writes node by node."""

import struct

import numpy as np
import pytest
from hypothesis import given, strategies as st

from mapdeal import MalformedInputError, read_cloud

FREE, OCCUPIED = "free", "occupied"
DEPTH, RESOLUTION = 16, 0.05


def trees(depth=3):
    """Return a strategy for nodes whose up to 8 children are states or nodes."""
    leaf = st.sampled_from([FREE, OCCUPIED])
    if depth == 0:
        return leaf
    slots = st.dictionaries(st.integers(0, 7), leaf | trees(depth - 1), min_size=1, max_size=4)
    return slots


def deep(tree, path):
    for slot in reversed(path):
        tree = {slot: tree}
    return tree


def points_of(tree, key=(0, 0, 0), height=DEPTH):
    if tree == OCCUPIED:
        side = range(1 << height)
        corner = np.array(key) - (1 << (DEPTH - 1))
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
    head = f"{first}\n# (a comment)\nid {name}\nsize 9\nres {RESOLUTION}\ndata\n"
    return head.encode() + body


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
BAD = {
    "cut.bt": (file_of(TREE, "bt")[:-2], "ends within its tree"),
    "cut.ot": (file_of(TREE, "ot")[:-5], "ends within its tree"),
    "id.ot": (file_of(TREE, "ot", "OcTree").replace(b"id OcTree", b"id Forest"), "id"),
    "res.bt": (file_of(TREE, "bt").replace(b"res 0.05", b"res nan"), "res"),
    "head.bt": (b"# Octomap OcTree binary file\n" * 200, "does not end"),
    "deep.bt": (file_of(deep({0: OCCUPIED}, [0] * 17), "bt"), "16 levels"),
}


@pytest.mark.parametrize("name", BAD)
def test_damaged_trees_are_refused(tmp_path, name):
    data, rule = BAD[name]
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
