"""Layers of npz files read by rows: the same as at once, in little memory."""

import zipfile

import numpy as np
import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st

import mapdeal
from mapdeal import Costmap, MalformedInputError, OccupancyGrid, esdf
from mapdeal.files.source import use_memory
from mapdeal.kernels.blocks import blocks_of
from mapdeal.maps.npz import _directory_size, open_npz, read_npz
from mapdeal.maps.reading import open_map
from strategies import examples
from traced_memory import memory_below

ORIGIN = (-3.5, 7.25, 0.3)


def _map(shape=(23, 17)):
    random = np.random.default_rng(1)
    occupancy = random.choice([-1, 0, 30, 100], shape, p=[0.1, 0.7, 0.1, 0.1]).astype(np.int8)
    return OccupancyGrid(occupancy, 0.1, ORIGIN)


def _grids():
    grid = _map()
    field = esdf(grid, convention="border", strength=1.5, max_distance=0.7)
    costs = np.arange(23 * 17, dtype=np.int64).reshape(23, 17) % 256
    return {
        "map": grid,
        "field": field,
        "costs": Costmap(costs.astype(np.uint8), 0.1, ORIGIN, circumscribed_cost=128),
        "published costs": Costmap((costs % 102 - 1).astype(np.int8), 0.1, ORIGIN, "occupancy"),
        "view": mapdeal.field_view(field),
        "potential": mapdeal.potential(grid),
    }


@pytest.fixture(scope="module", params=_grids())
def written(request, tmp_path_factory):
    path = tmp_path_factory.mktemp("npz") / "grid.npz"
    grid = _grids()[request.param]
    mapdeal.write_map(path, grid)
    return path, grid


def check_facts(found, expected):
    names = *expected.parameter_names, "scale", "circumscribed_cost"  # these of costmaps
    assert (type(found), found.frame) == (type(expected), expected.frame)
    for name in names:
        assert getattr(found, name, None) == getattr(expected, name, None), name


@pytest.mark.slow
@examples(20, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    requests=st.lists(st.tuples(st.sampled_from([0, 1]), st.integers(0, 22), st.integers(1, 23)))
)
def test_any_rows_are_what_was_written_in_whatever_order(written, requests):
    path, grid = written
    with open_npz(path, block_height=5) as lazy:
        assert lazy.is_lazy == (grid.kind != "potential field")
        assert not lazy.is_lazy or next(blocks_of(lazy.layer)) == slice(0, 5)
        check_facts(lazy, grid)
        for which, first, count in requests:
            name = grid.layer_names[which % len(grid.layer_names)]
            rows = slice(first, first + count)
            np.testing.assert_array_equal(getattr(lazy, name)[rows], getattr(grid, name)[rows])


@pytest.mark.usefixtures("mapdeal_warnings")
def test_all_at_once_is_what_was_written(written):
    path, grid = written
    again = mapdeal.read_map(path)
    check_facts(again, grid)
    for name in grid.layer_names:
        np.testing.assert_array_equal(getattr(again, name), getattr(grid, name))
    with open_map(path) as file:
        assert file.shape() == grid.shape


def _written_by_numpy(path, save=np.savez_compressed, **changes):
    entries = {"format": "mapdeal/1", "resolution": 0.1, "origin": np.array(ORIGIN)}
    entries |= {"occupancy": _map().occupancy, **changes}
    save(path, **{name: entry for name, entry in entries.items() if entry is not None})


def test_layers_stored_column_by_column_are_read(tmp_path):
    occupancy = _map().occupancy
    _written_by_numpy(tmp_path / "f.npz", occupancy=np.asfortranarray(occupancy))
    with open_npz(tmp_path / "f.npz") as lazy:
        np.testing.assert_array_equal(lazy.occupancy[3:9], occupancy[3:9])


_FIELD = {
    "distance": np.ones((23, 17), dtype=np.float32), "convention": "fast-planner", "strength": 1.0,
    "max_distance": np.inf, "lethal_threshold": 100, "unknown": "free",
}  # fmt: skip


@pytest.mark.parametrize("changes", [
    {"format": "mapdeal/2"}, {"resolution": -1.0}, {"occupancy": None},
    {"occupancy": np.zeros((3, 4), dtype=np.int16)},
    {"occupancy": np.zeros((3, 4, 5), dtype=np.int8)},
    {"occupancy": np.zeros((0, 4), dtype=np.int8)},
    {"occupancy": np.zeros((200, 40), dtype=np.int8)},
    {**_FIELD, "distance": np.ones((23, 18), dtype=np.float32)},
    {**_FIELD, "convention": "corner"},
    {**_FIELD, "convention": np.array([0xFFFFFFFF], dtype=np.uint32).view("U1").reshape(())},
    {**_FIELD, "strength": -1.0},
])  # fmt: skip
def test_what_headers_and_parameters_tell_is_refused_as_at_once(tmp_path, changes):
    path = tmp_path / "grid.npz"
    _written_by_numpy(path, **changes)
    with pytest.raises(MalformedInputError) as expected:
        read_npz(path, max_cells=1000)
    with pytest.raises(MalformedInputError) as found, open_npz(path, max_cells=1000):
        pass
    assert str(found.value) == str(expected.value)
    assert found.value.hint == expected.value.hint


@pytest.mark.parametrize("scale", [None, "occupancy"])
def test_values_that_are_none_are_refused_with_their_rows(tmp_path, scale):
    path, values = tmp_path / "grid.npz", _map().occupancy.copy()
    values[17, 3] = 101
    costs = {"occupancy": None, "cost": values, "cost_scale": scale}
    _written_by_numpy(path, **(costs if scale else {"occupancy": values}))
    with open_npz(path) as lazy:
        np.testing.assert_array_equal(lazy.layer[:17], values[:17])
        with pytest.raises(MalformedInputError, match=r"grid.npz: \w+ must lie in -1..100"):
            lazy.layer[17:20]


@pytest.mark.parametrize("save", [np.savez_compressed, np.savez])
@pytest.mark.parametrize("part", ["bytes", "checksum"])
def test_damage_is_found_with_the_last_row_at_the_latest(tmp_path, part, save):
    path = tmp_path / "field.npz"
    _written_by_numpy(path, save, occupancy=_map((430, 170)).occupancy)
    with zipfile.ZipFile(path) as archive:
        info = archive.getinfo("occupancy.npy")
    data = bytearray(path.read_bytes())
    if part == "bytes":
        inside = info.header_offset + info.compress_size // 2
        data[inside : inside + 10] = bytes(10)
    else:
        data = data.replace(info.CRC.to_bytes(4, "little"), bytes(4))
    path.write_bytes(data)
    with pytest.raises(MalformedInputError, match="damaged"):
        read_npz(path)
    with open_npz(path) as lazy:
        lazy.layer[:1]
        with pytest.raises(MalformedInputError, match="occupancy: damaged"):
            for first in range(1, 430):
                lazy.layer[first : first + 1]


def test_rows_take_the_memory_of_rows(tmp_path):
    path, occupancy = tmp_path / "map.npz", np.zeros((6000, 5000), dtype=np.int8)
    mapdeal.write_map(path, OccupancyGrid(occupancy, 0.1, ORIGIN))
    with memory_below(16_000_000), use_memory(60_000_000), open_npz(path) as lazy:
        for rows in blocks_of(lazy.layer):
            assert not lazy.layer[rows].any()
        with pytest.raises(MalformedInputError, match="may be used"):
            lazy.layer[:]


@pytest.mark.parametrize("comment", [b"", b"c" * 65_535])
def test_the_size_of_a_list_of_entries_is_read_before_the_list(tmp_path, comment):
    path = tmp_path / "a.npz"
    with zipfile.ZipFile(path, "w") as file:
        for name in "abc":
            file.writestr(name, bytes(99_999))
        file.comment = comment
        file.close()
        assert _directory_size(path) == path.stat().st_size - file.start_dir - 22 - len(comment)
    own, large = (70).to_bytes(4, "little"), (1 << 40).to_bytes(8, "little")
    for size, record in ((70, own), (0, b"\xff" * 4)):
        path.write_bytes(b"PK\5\6" + bytes(8) + record + bytes(6) + comment[:9])
        assert _directory_size(path) == size
        path.write_bytes(b"PK\6\6" + bytes(36) + large + bytes(8) + path.read_bytes())
        assert _directory_size(path) == 1 << 40
