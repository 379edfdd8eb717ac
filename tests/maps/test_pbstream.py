import ctypes.util
import math
from contextlib import nullcontext

import numpy as np
import pytest

import states
from mapdeal import MalformedInputError, read_map, read_poses
from mapdeal.maps.map_server import bare_images
from mapdeal.maps.pbstream import Slice, canvas_of, paint
from mapdeal.maps.reading import open_map

OFFICE = "chifongip__cartographer_ros/maps/office/central/mymap"
TURNED = {(0, 0): (2.0, -1.0, 0.7)}


def written(tmp_path, *messages, name="m.pbstream", **options):
    (tmp_path / name).write_bytes(states.state(*messages, **options))
    return tmp_path / name


def grey_of(path):
    with open_map(path) as file:
        return file.painting()[0][::-1], file.frame()


def rigid(x, y, yaw):
    cos, sin = math.cos(yaw), math.sin(yaw)
    return np.array([(cos, -sin, x), (sin, cos, y), (0, 0, 1)])


def painted(submaps, shape, origin, resolution):
    """Paint submaps in metres and floats, as the semantics say it and not as cairo does it."""
    height, width = shape
    rows, cols = np.mgrid[:height, :width]
    x = origin[0] + (cols + 0.5) * resolution
    y = origin[1] + (height - rows - 0.5) * resolution
    grey = np.full(shape, 128.0)
    for cells, placed, local, corner, cell in submaps:
        values = cells & 32767
        p = np.clip(1 - (0.1 + (values - 1) * 0.8 / 32766), 0.1, 0.9)
        odds = np.log(p / (1 - p))
        delta = 128 - (np.rint((odds + np.log(9)) * 254 / (2 * np.log(9))) + 1)
        layers = [np.where(values > 0, part, 0) for part in (delta.clip(0), (-delta).clip(0))]
        back = np.linalg.inv(rigid(*placed) @ np.linalg.inv(rigid(*local)))
        u = (corner[1] - (back[1, 0] * x + back[1, 1] * y + back[1, 2])) / cell - 0.5
        v = (corner[0] - (back[0, 0] * x + back[0, 1] * y + back[0, 2])) / cell - 0.5
        intensity, opacity = (between(np.pad(layer, 1), v + 1, u + 1) for layer in layers)
        grey = intensity + grey * (1 - opacity / 255)
    return grey


def between(layer, v, u):
    v, u = v.clip(0, layer.shape[0] - 1.001), u.clip(0, layer.shape[1] - 1.001)
    i, j = v.astype(int), u.astype(int)
    f, g = v - i, u - j
    upper = layer[i, j] * (1 - g) + layer[i, j + 1] * g
    return upper * (1 - f) + (layer[i + 1, j] * (1 - g) + layer[i + 1, j + 1] * g) * f


CASES = {
    "one, turned": [((0, 0), (2, -1, 0.7), (0.3, 0.2, -0.4), (31, 47), None)],
    "two overlap": [
        ((0, 0), (0, 0, 0.0), (0, 0, 0), (40, 25), None),
        ((0, 1), (0.4, -0.3, 2.9), (1, 2, 0.1), (33, 38), None),
    ],
    "two trajectories, written in another order": [
        ((1, 0), (0.5, 0.5, -1.2), (0, 0, 0.5), (28, 30), None),
        ((0, 3), (-0.5, 0, 1.6), (0, 1, 0), (30, 28), None),
    ],
    "unknown borders": [((0, 0), (1, 1, 0.2), (0, 0, 0), (30, 40), (5, 3, 32, 20))],
}


@pytest.mark.parametrize("packed", [True, False])
@pytest.mark.parametrize("resolution", [0.05, 0.04])
@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_submaps_are_painted_as_by_an_independent_painter(tmp_path, case, resolution, packed):
    # cells of 0.048 m: cairo's borders would hide in whole pixels
    messages, layers = [], []
    for key, placed, local, size, box in case:
        cells, corner = states.random_cells(*size, seed=size[0]), (1.0, 2.5)
        options = {"corner": corner, "box": box, "resolution": 0.048, "packed": packed}
        messages.append(states.submap(cells, key=key, local=local, **options))
        left, top, right, bottom = box or (0, 0, size[1] - 1, size[0] - 1)
        corner = corner[0] - 0.048 * top, corner[1] - 0.048 * left
        known = cells[top : bottom + 1, left : right + 1]
        layers.append((key, (known, placed, local, corner, 0.048)))
    graph = states.pose_graph({key: placed for key, placed, *_ in case})
    path = written(tmp_path, *messages, graph)
    with bare_images(resolution, (0, 0, 0)) if resolution != 0.05 else nullcontext():
        grey, frame = grey_of(path)
    assert frame.resolution == resolution
    expected = painted([layer for _, layer in sorted(layers)], grey.shape, frame.origin, resolution)
    assert np.abs(grey - expected).max() < 2 * len(layers) + 1
    assert np.abs(grey - expected).mean() < 0.6 * len(layers)
    assert grey.std() > 15


@pytest.mark.parametrize("resolution", [0.05, 0.02, 0.068, 0.1, 0.4])
def test_painting_has_the_bytes_of_cairo(resolution):
    rng, textures, placed = np.random.default_rng(3), [], []
    for _ in range(12):
        height, width = rng.integers(1, 150, 2)
        opacity = np.where(rng.random((height, width)) < 0.5, rng.integers(0, 128), 0)
        intensity = np.where(opacity == 0, rng.integers(0, 128, (height, width)), 0)
        turn = rigid(0, 0, rng.uniform(-3, 3))[:2, :2] * (0.048 / resolution)
        textures.append((intensity | opacity << 16).astype(np.uint32))
        placed.append(Slice(int(width), int(height), turn, rng.uniform(-90, 90, 2)))
    width, height, origin = canvas_of([(None, part) for part in placed])
    pixels = np.full((height, width), 128, dtype=np.uint8)
    places = [part._replace(shift=part.shift + origin) for part in placed]
    expected = painted_by_cairo(pixels.shape, textures, places)
    for texture, place in zip(textures, places, strict=True):
        paint(pixels, texture, place)
    differences = np.abs(pixels.astype(int) - expected)
    # where cairo averages, the last digits of its matrices decide on some roundings
    assert differences.max() <= (resolution > 0.064)
    assert differences.mean() < 0.001


def painted_by_cairo(shape, textures, places):
    """Paint textures on 128 with cairo itself, as 32-bit pixels of opacity and red."""
    name = ctypes.util.find_library("cairo")
    if name is None:
        pytest.skip("needs the library cairo")
    cairo = ctypes.CDLL(name)
    matrix, double, pointer = ctypes.c_double * 6, ctypes.c_double, ctypes.c_void_p
    cairo.cairo_create.restype = pointer
    cairo.cairo_image_surface_create_for_data.restype = pointer
    buffers = [(part & 0xFFFF) << 16 | part >> 16 << 24 for part in textures]
    buffers.append(np.full(shape, 0xFF800000, dtype=np.uint32))
    surfaces = [
        pointer(cairo.cairo_image_surface_create_for_data(
            pointer(part.ctypes.data), 0, part.shape[1], part.shape[0], 4 * part.shape[1]))
        for part in map(np.ascontiguousarray, buffers)
    ]  # fmt: skip
    context = pointer(cairo.cairo_create(surfaces[-1]))
    for surface, (_, _, scale, shift) in zip(surfaces, places, strict=False):
        cairo.cairo_set_matrix(context, matrix(*scale.T.ravel(), *shift))
        cairo.cairo_set_source_surface(context, surface, double(0), double(0))
        cairo.cairo_paint(context)
    cairo.cairo_surface_flush(surfaces[-1])
    return (buffers[-1] >> 16 & 255).astype(np.uint8)


def test_the_map_of_a_real_state_has_the_bytes_of_cartographer(real_maps, tmp_path, command):
    state = real_maps / f"{OFFICE}.pbstream"
    assert command("convert", state, "-o", tmp_path / "m.yaml", "--strict")[0] == 0
    assert (tmp_path / "m.pgm").read_bytes() == (real_maps / f"{OFFICE}.pgm").read_bytes()
    assert "[-4.34093, -16.4299, 0.0]" in (tmp_path / "m.yaml").read_text()
    assert np.array_equal(read_map(state).occupancy, read_map(tmp_path / "m.yaml").occupancy)


def test_trajectories_become_files_of_poses(tmp_path, command):
    cells = states.random_cells(4, 5)
    nodes = [(0, 0.0, 1, 2, 0.5), (0, 1.25, 1, 4.5, 0.6), (3, 7.0, -1, 0, -3)]
    graph = states.pose_graph({(0, 0): (0, 0, 0), (3, 0): (1, 1, 1)}, nodes)
    maps = [states.submap(cells, key=key, finished=key[0]) for key in ((0, 0), (3, 0))]
    state = written(tmp_path, graph, *maps)
    code, out, _ = command("convert", state, "-o", tmp_path / "p.txt")
    assert (code, out) == (0, f"{tmp_path}/p_0.txt, p_3.txt: 3 poses of {state}\n")
    assert np.allclose(read_poses(tmp_path / "p_0.txt"), [node[2:] for node in nodes[:2]])
    assert np.allclose(read_poses(tmp_path / "p_3.txt"), [nodes[2][2:]])
    seconds = (states.START - 621_355_968 * 10**9) / 1e7
    first, second = (tmp_path / "p_0.txt").read_text().splitlines()
    assert [float(line.split()[0]) for line in (first, second)] == [seconds, seconds + 1.25]
    code, out, _ = command("info", state)
    assert "submaps     2 of Cartographer, format version 2, 1 unfinished" in out
    assert "trajectory  0: 2 poses, 2.5 m in 1.25 s" in out
    assert command("report", state, "-o", tmp_path / "r.html")[0] == 0
    page = (tmp_path / "r.html").read_text()
    assert "trajectory 0: 2 poses, 2.5 m in 1.25 s" in page
    assert "trajectory 3: 1 pose" in page


def test_folders_have_states_as_maps_unless_their_map_lies_beside_them(tmp_path, command):
    state = states.pose_graph(TURNED), states.submap(states.random_cells(9, 7))
    for name in ("a", "b"):
        written(tmp_path, *state, name=f"{name}.pbstream")
    command("convert", tmp_path / "a.pbstream", "-o", tmp_path / "a.yaml")
    (tmp_path / "c.pbstream").write_bytes(b"other bytes")
    for name in (tmp_path, tmp_path / "*"):
        code, out, _ = command("lint", name)
        assert (code, out.splitlines()[-1][:7]) == (0, "2 maps:")
    assert command("run", tmp_path, "-o", tmp_path / "out")[0] == 0
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"a", "b", "summary.json"}


CELLS = states.random_cells(6, 5)
GOOD = states.pose_graph(TURNED), states.submap(CELLS)
WHOLE = states.state(*GOOD)
BOMB = states.state(states.message((3, bytes(10**8))))[len(states.state()) :]


@pytest.mark.parametrize("count", [0, 1, 2])
def test_states_cut_behind_their_submaps_are_warned_of(tmp_path, command, count):
    graph = states.pose_graph(TURNED, [(0, 0.0, 1, 2, 0.5), (0, 1.0, 1, 3, 0.5)])
    nodes = [states.message((4, b""))] * count
    state = written(tmp_path, graph, states.submap(CELLS), *nodes)
    code, _, err = command("convert", state, "-o", tmp_path / "m.yaml", "--strict")
    assert code == (count < 2)
    assert (f"holds {count} of the 2 nodes" in err) == (count < 2)


@pytest.mark.parametrize(("data", "rule"), [
    (b"PK" + WHOLE, "begins with other bytes"), (WHOLE[:-1], "the file ends within it"),
    (WHOLE[:8] + b"\xff" * 8 + WHOLE[16:], "the file ends within it"),
    (WHOLE[:-9] + bytes(9), "is damaged"), (WHOLE + BOMB, "would expand to"),
    (states.state(*GOOD, version=3), "version 1 or 2, got 3"),
    (states.state(GOOD[0]), "has no submaps"),
    (states.state(states.pose_graph({**TURNED, (0, 1): (0, 0, 0)}), GOOD[1]),
     "submap (0, 1) is missing: the file is cut"),
    (states.state(GOOD[1]), "submap (0, 0) has no pose"),
    (states.state(*GOOD, GOOD[1]), "submap (0, 0) occurs twice"),
    (states.state(GOOD[0], states.submap(CELLS, field=3)), "is 3-D"),
    (states.state(GOOD[0], states.submap(CELLS, kind=5)), "is a TSDF"),
    (states.state(GOOD[0], states.submap(CELLS, box=(0, 0, 5, 5))), "within its 6 x 5 cells"),
    (states.state(GOOD[0], states.submap(CELLS, more=[(2, [7])])), "must have 30, got 31"),
    (states.state(GOOD[0], states.submap(CELLS - 40_000)), "cells must be 0..65535"),
    (states.state(GOOD[0], states.submap(CELLS, resolution=math.nan)), "below 1e+12, got nan"),
    (states.state(GOOD[0], states.submap(CELLS, resolution=0.0)), "must be above 0"),
    (states.state(states.pose_graph({(0, 0): (1e11, 0, 0)}), GOOD[1]), "lies too far away"),
    (states.state(states.pose_graph({(0, 0): (1e6, 0, 0), (0, 1): (-1e6, 9e5, 0)}), GOOD[1],
                  states.submap(CELLS, key=(0, 1))), "above the limit"),
])  # fmt: skip
def test_hostile_states_are_refused_on_one_line(tmp_path, command, data, rule):
    (tmp_path / "m.pbstream").write_bytes(data)
    code, _, err = command("run", tmp_path / "m.pbstream", "-o", tmp_path / "out")
    assert (code, err.splitlines()[0].startswith(f"error: {tmp_path}/m.pbstream: ")) == (3, True)
    assert rule in err.splitlines()[0]
    assert not (tmp_path / "out").exists()


def test_unknown_fields_are_skipped(tmp_path):
    extra = states.message((15, b"anything"), (16, 3), (17, 2.5))
    plain = written(tmp_path, *GOOD)
    more = written(tmp_path, *(extra + part for part in GOOD), extra, name="more.pbstream")
    assert np.array_equal(grey_of(more)[0], grey_of(plain)[0])


def test_a_state_stays_within_the_memory(tmp_path):
    path = written(tmp_path, GOOD[0], states.submap(states.random_cells(300, 300)))
    with pytest.raises(MalformedInputError, match="of memory"):
        read_map(path, max_memory=53_000_000)
    with pytest.raises(MalformedInputError, match="above the limit of 1000"):
        read_map(path, max_cells=1000)
