import json
import zipfile

import numpy as np
import pytest
from hypothesis import HealthCheck, given, strategies as st

import mapdeal
from drawn import grid_from_text
from mapdeal import Costmap, Footprint, MalformedInputError, OccupancyGrid, ParameterError, Reach
from mapdeal.files.source import use_memory
from mapdeal.grid.canvas import on_canvas
from mapdeal.kernels.blocks import blocks_of
from mapdeal.maps.npz import NpzReader, _directory_size, open_npz, read_npz, read_reach
from mapdeal.maps.reading import open_map
from mapdeal.pipeline.folder import summary_of
from strategies import examples
from traced_memory import memory_below

ORIGIN = (-3.5, 7.25, 0.3)


def _map(shape=(23, 17)):
    random = np.random.default_rng(1)
    occupancy = random.choice([-1, 0, 30, 100], shape, p=[0.1, 0.7, 0.1, 0.1]).astype(np.int8)
    return OccupancyGrid(occupancy, 0.1, ORIGIN)


def _grids():
    grid = _map()
    field = mapdeal.esdf(grid, convention="border", strength=1.5, max_distance=0.7)
    costs = np.arange(23 * 17, dtype=np.int64).reshape(23, 17) % 256
    return {
        "map": grid, "field": field,
        "costs": Costmap(costs.astype(np.uint8), 0.1, ORIGIN, circumscribed_cost=128),
        "published costs": Costmap((costs % 102 - 1).astype(np.int8), 0.1, ORIGIN, "occupancy"),
        "view": mapdeal.field_view(field), "potential": mapdeal.potential(grid),
    }  # fmt: skip


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
@given(st.lists(st.tuples(st.integers(0, 1), st.integers(0, 22), st.integers(1, 23))))
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
    with NpzReader(tmp_path / "f.npz") as reader:
        found = np.concatenate(list(reader.rows("occupancy", 3)))
    np.testing.assert_array_equal(found, occupancy[:, :3])


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
        with pytest.raises(MalformedInputError, match=r"needs 96\.8 MB of memory, 60 MB"):
            read_npz(path)  # interpreter 50 MB, cells 30, pieces 2**24 bytes


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


MAP = grid_from_text("""
    #...?
    #.#.?
    #####
""", 0.25)  # fmt: skip
SHAPE = Footprint.polygon([(0.2, 0.1), (-0.1, 0.1), (-0.1, -0.1)])


def reach(**more):
    """A reach by hand: all free cells except one are open, and the two on the left are reached."""
    is_free = MAP.occupancy == 0
    headings = is_free * np.uint8(8)
    headings[2, 3] = 0
    reachable = is_free * np.uint8(1)
    reachable[:, 2:] = 0
    clearance = np.where(MAP.occupancy == 100, 0, 0.25).astype(np.float32)
    chosen = {"start": (1.5, -2.0, 0.5), "robot": SHAPE, "heading_count": 8, **more}
    return Reach(reachable, headings, clearance, clearance * reachable, MAP.occupancy, 0.25,
                 MAP.origin, **chosen)  # fmt: skip


@pytest.fixture
def path(tmp_path):
    mapdeal.write_map(tmp_path / "r.npz", reach())
    return tmp_path / "r.npz"


@pytest.mark.parametrize("more", [
    {},
    {"start": (1.5, -2.0), "robot": Footprint.circle(0.1), "through_unknown": True},
    {"robot": None, "heading_count": 255},
])  # fmt: skip
def test_it_is_read_as_it_was_written(tmp_path, more):
    grid = reach(**more)
    mapdeal.write_map(tmp_path / "r.npz", grid)
    again = read_reach(tmp_path / "r.npz")
    for name in Reach.layer_names:
        np.testing.assert_array_equal(getattr(again, name), getattr(grid, name))
        assert getattr(again, name).dtype == getattr(grid, name).dtype
    for name in ("resolution", "origin", *Reach.parameter_names):
        assert getattr(again, name) == getattr(grid, name), name
    with np.load(tmp_path / "r.npz") as arrays:  # as any other program sees it
        assert arrays["start"].tolist() == list(grid.start)


def test_as_a_map_it_is_the_one_that_was_looked_at_with_one_warning(path):
    rule = "is a result of reach; only its map is used"
    with pytest.warns(mapdeal.MapdealWarning, match=rule) as caught:
        again = mapdeal.read_map(path)
    assert len(caught) == 1
    assert (type(again), again.frame) == (mapdeal.OccupancyGrid, MAP.frame)
    np.testing.assert_array_equal(again.occupancy, MAP.occupancy)


def test_info_names_the_layers(command, path):
    code, out, err = command("info", path)
    assert (code, err) == (0, "")
    lines = dict(line.split(maxsplit=1) for line in out.splitlines()[1:])
    layers = "reachable, headings, clearance, widest, occupancy"
    assert (lines["kind"], lines["layers"]) == ("reach", layers)
    # 5 free cells of 1/16 m2, 4 of them open, 2 reached
    assert lines["area"] == "from 1.5, -2 the robot reaches 0.125 of 0.25 m2 open to it"
    assert "8 headings, unknown closed" in out
    report = json.loads(command("info", path, "--json")[1])
    assert (report["free_m2"], report["start"]) == (5 / 16, [1.5, -2.0, 0.5])
    assert report["share"] == pytest.approx(2 / 5)
    assert not {"goals", "passages", "closed_passages"} & set(report)


def test_the_answers_are_summed_up_in_a_line():
    passage = mapdeal.Passage(1.5, -2.0, 0.8, 12.0, False, ((1.0, -2.0), (2.0, -2.0)))
    names = ["kitchen", "hall", None, "lift", "stairs"]
    goals = [mapdeal.Goal(k, 0.5, name) for k, name in enumerate(names)]
    goals = [mapdeal.GoalReach(goal, goal.x == 0, goal.x == 0, 0.4) for goal in goals]
    area, *counts = summary_of(reach(goals=tuple(goals), passages=(passage,)).figures()).split("; ")
    assert area == "from 1.5, -2 the robot reaches 0.125 of 0.25 m2 open to it"
    assert counts == ["1 of 5 goals (not hall, 2,0.5, lift and 1 more)", "1 passage, 1 closed"]


@pytest.mark.parametrize(("name", "value", "message"), [
    ("start", np.array([1.0, np.nan]), "start: must be finite"),
    ("start", np.array([1.0]), r"start: must have shape \(2,\)"),
    ("heading_count", np.uint8(0), "heading_count: must be from 1 to 255"),
    ("widest", np.zeros((2, 5), np.float32), "of one shape"),
    ("headings", np.zeros((3, 5), np.int32), "headings: must be uint8"),
    ("robot", np.zeros((3, 5)), r"robot: must have shape \(3, 2\)"),
    ("clearance", None, "clearance: missing key"),
])  # fmt: skip
def test_damaged_ones_are_refused(command, path, name, value, message):
    with np.load(path) as arrays:
        remaining = {key: arrays[key] for key in arrays if key != name}
    np.savez(path, **remaining, **({} if value is None else {name: value}))
    with pytest.raises((MalformedInputError, ParameterError), match=message):
        read_reach(path)
    code, _, err = command("info", path)
    assert (code, err.count("\n")) == (3, 1)


def test_it_only_fits_an_npz_and_a_byte_counts_no_more_headings(tmp_path):
    with pytest.raises(ParameterError, match=r"heading_count: must be from 1 to 255"):
        reach(heading_count=256)
    with pytest.raises(ParameterError, match="a reach is written as npz"):
        mapdeal.write_map(tmp_path / "r.yaml", reach())


@pytest.mark.parametrize(("through_unknown", "free_area"), [(False, 5 / 16), (True, 7 / 16)])
def test_on_a_larger_canvas_nothing_around_it_is_counted(through_unknown, free_area):
    grid = reach(through_unknown=through_unknown, start=(1.5, -2.0))
    extended = on_canvas(grid, grid.frame.window(-1, -2, 6, 9))
    for name in ("reachable_area", "open_area", "free_area", "share"):
        assert getattr(extended, name) == getattr(grid, name)
    assert extended.free_area == pytest.approx(free_area)
