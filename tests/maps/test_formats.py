"""What every format of maps holds to: the contract of the table `FORMATS`."""

import numpy as np
import pytest

import mapdeal
import states
from drawn import grid_from_text
from mapdeal import BitMap, FieldView, ParameterError, read_map, write_bit_map, write_map
from mapdeal.maps.formats import FORMATS
from mapdeal.maps.map_server import BITS
from mapdeal.maps.pbstream import PBSTREAM
from mapdeal.maps.reading import open_map

DRAWING = "..#\n#.."
STATE = states.pose_graph({(0, 0): (2.0, -1.0, 0.7)}), states.submap(states.random_cells(6, 5))
READ_ONLY = {
    BITS: lambda path, grid: write_bit_map(path, BitMap.from_occupancy(grid)),
    PBSTREAM: lambda path, _: path.write_bytes(states.state(*STATE)),
}
DAMAGE = {
    "missing": lambda _, path: path.unlink(), "empty": lambda _, path: path.write_bytes(b""),
    "other magic": lambda data, path: path.write_bytes(b"\x93?" + data[2:]),
    "cut": lambda data, path: path.write_bytes(data[: len(data) // 2]),
    "larger than allowed": lambda *_: None,
}  # fmt: skip


@pytest.fixture(params=FORMATS, ids=lambda entry: entry.endings[0])
def saved(request, tmp_path):
    path, grid = tmp_path / f"m{request.param.endings[0]}", grid_from_text(DRAWING)
    try:
        READ_ONLY.get(request.param, write_map)(path, grid)
    except ParameterError as error:
        assert "yaw" in str(error)  # a format without one refuses it
        grid = grid_from_text(DRAWING, 0.25, (1.5, -2.0, 0.0))
        write_map(path, grid)
    return path, grid


@pytest.mark.usefixtures("mapdeal_warnings")
def test_what_is_written_is_read_again(saved):
    path, grid = saved
    with open_map(path) as file:
        assert (file.shape(), file.files[0].parent) == (read_map(path).shape, path.parent)
    if path.suffix not in PBSTREAM.endings:
        assert (read_map(path).frame, read_map(path).kind) == (grid.frame, grid.kind)
        assert np.array_equal(read_map(path).occupancy, grid.occupancy)


@pytest.mark.parametrize("ending", [".yaml", ".npz"])
@pytest.mark.parametrize(("drawing", "strength", "scale"), [
    ("#....?\n?..+.#", 1.0, {"view_range": 0.7}), ("#....?\n?..+.#", 1.3, {"view": "per-map"}),
    ("#...\n....", 1.0, {}),  # obstacles and free cells alone, raw all the same
])  # fmt: skip
def test_a_view_comes_back_from_its_files(tmp_path, ending, drawing, strength, scale):
    view = mapdeal.field_view(mapdeal.esdf(grid_from_text(drawing), strength=strength), **scale)
    write_map(tmp_path / f"v{ending}", view)
    back = read_map(tmp_path / f"v{ending}")
    assert isinstance(back, FieldView)
    assert np.array_equal(back.occupancy, view.occupancy)
    assert (back.scale, back.frame) == (view.scale, view.frame)


@pytest.mark.parametrize("damage", DAMAGE)
def test_a_damaged_map_is_refused_on_one_line(saved, command, tmp_path, damage):
    with open_map(saved[0]) as file:
        cells = file.files[-1]
    DAMAGE[damage](cells.read_bytes(), cells)
    more = ["--max-cells", "5"] if damage == "larger than allowed" else []
    for words in (["info"], ["run", "-o", tmp_path / "out"]):
        code, out, err = command(*words, saved[0], *more)
        first, *hints = err.splitlines()
        assert (code, out) == (4 if damage == "missing" else 3, "")
        assert first.startswith((f"error: {cells}: ", f"error: {cells.with_suffix('.yaml')}: "))
        assert ("above the limit of 5" in first) == bool(more)
        assert all(hint.startswith("hint: ") for hint in hints)
        assert not (tmp_path / "out").exists()
