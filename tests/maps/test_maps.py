import hashlib
import os
import re
import stat
import warnings
import zipfile

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings, strategies as st

import mapdeal
from bad_maps import yaml_text
from drawn import grid_from_text
from mapdeal import Costmap, FileAccessError, MapdealWarning, OccupancyGrid, read_map, write_map
from mapdeal.errors import MalformedInputError
from mapdeal.files.source import free_memory, sums_of_reads
from mapdeal.kernels.blocks import blocks_of
from mapdeal.maps.dialects import DIALECTS
from mapdeal.maps.picture import HEAD, opened
from mapdeal.maps.reading import MapFile, open_map, read_source
from strategies import occupancies

ENDINGS = st.sampled_from([".yaml", ".pgm", ".png", ".npz"])
ORIGINS = st.tuples(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6), st.floats(-3.2, 3.2))


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(occupancies(), st.floats(1e-3, 10), ORIGINS, ENDINGS, st.sampled_from(list(DIALECTS)))
@pytest.mark.usefixtures("mapdeal_warnings")
def test_round_trips_change_nothing(tmp_path, occupancy, resolution, origin, ending, dialect):
    path = tmp_path / f"map{ending}"
    write_map(path, OccupancyGrid(occupancy, resolution, origin), force=True)
    path = path if ending == ".npz" else path.with_suffix(".yaml")
    with open_map(path) as file:
        assert file.shape() == occupancy.shape
    grid = read_map(path, dialect=dialect)
    assert np.array_equal(grid.occupancy, occupancy)
    assert (grid.resolution, grid.origin) == (resolution, origin)


def test_a_pair_is_what_map_saver_writes_with_digits_kept_and_the_north_on_top(tmp_path):
    grid = grid_from_text("#.?\n...", 0.0125, (12345.6789, -1e-7, 0.1))
    write_map(tmp_path / "map.yaml", grid)
    assert (tmp_path / "map.yaml").read_text().splitlines() == [
        "image: map.pgm", "mode: trinary", "resolution: 0.0125",
        "origin: [12345.6789, -1.0e-07, 0.1]", "negate: 0", "occupied_thresh: 0.65",
        "free_thresh: 0.196",
    ]  # fmt: skip
    head = b"P5\n# CREATOR: mapdeal 0.0125 m/pix\n3 2\n255\n"
    assert (tmp_path / "map.pgm").read_bytes() == head + bytes([0, 254, 205, 254, 254, 254])


def test_values_in_between_are_written_raw_by_default(tmp_path):
    grid = OccupancyGrid([[0, 1, 25, 26, 64, 65, 99, 100, -1]], 0.25)
    write_map(tmp_path / "raw.yaml", grid)
    assert yaml.safe_load((tmp_path / "raw.yaml").read_text())["mode"] == "raw"
    with pytest.warns(MapdealWarning, match="6 values between 1 and 99 are lost"):
        write_map(tmp_path / "trinary.yaml", grid, mode="trinary")
    trinary = read_map(tmp_path / "trinary.yaml").occupancy
    assert trinary.tolist() == [[0, 0, 0, -1, -1, 100, 100, 100, -1]]


def test_mode_scale_keeps_every_value_in_rounded_pixels(tmp_path):
    values = np.arange(-1, 101, dtype=np.int8).reshape(2, 51)
    write_map(tmp_path / "map.png", OccupancyGrid(values, 0.25), mode="scale")
    for dialect in ("nav2", "humble"):
        assert np.array_equal(read_map(tmp_path / "map.yaml", dialect=dialect).occupancy, values)
    write_map(tmp_path / "m.pgm", OccupancyGrid([[0, 1, 2, 5, 98, 99, 100]], 0.05), mode="scale")
    # (100 - v) * 2.55: 255, 252.45, 249.9, 242.25, 5.1, 2.55, 0
    assert list((tmp_path / "m.pgm").read_bytes()[-7:]) == [255, 252, 250, 242, 5, 3, 0]
    with pytest.raises(mapdeal.ParameterError, match="transparent"):
        write_map(tmp_path / "unknown.yaml", grid_from_text("#?."), mode="scale")
    assert not list(tmp_path.glob("unknown*"))


def test_costs_are_written_as_ros_would_publish_them_or_as_bytes(tmp_path):
    costmap = Costmap([[0, 1, 128, 253, 254, 255]], 0.25, (1.5, -2.0, 0.4))
    write_map(tmp_path / "cost.yaml", costmap)
    assert (tmp_path / "cost.pgm").read_bytes().endswith(bytes([0, 1, 50, 99, 100, 255]))
    for dialect in DIALECTS:
        values = read_map(tmp_path / "cost.yaml", dialect=dialect).occupancy
        assert values.tolist() == [[0, 1, 50, 99, 100, -1]]
    with pytest.warns(MapdealWarning, match="misread"):
        write_map(tmp_path / "bytes.yaml", costmap, encoding="costmap2d")
    back = read_map(tmp_path / "bytes.yaml")
    assert (type(back), back.origin) == (Costmap, costmap.origin)
    assert np.array_equal(back.cost, costmap.cost)


def test_the_keys_of_an_npz(tmp_path):
    field = mapdeal.esdf(grid_from_text("#..?"), max_distance=0.6, strength=1.5, unknown="occupied")
    write_map(tmp_path / "field.npz", field)
    expected = {"format": "mapdeal/1", "resolution": 0.25, "origin": [1.5, -2.0, 0.4],
                "convention": "fast-planner", "strength": 1.5, "max_distance": 0.6,
                "lethal_threshold": 100, "unknown": "occupied"}  # fmt: skip
    with zipfile.ZipFile(tmp_path / "field.npz") as archive:  # the same bytes at any time
        assert {info.date_time for info in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}
        assert {info.compress_type for info in archive.infolist()} == {zipfile.ZIP_DEFLATED}
    with np.load(tmp_path / "field.npz", allow_pickle=False) as data:
        assert {name: data[name].tolist() for name in expected} == expected
        assert (data["distance"].dtype, data["occupancy"].dtype) == (np.float32, np.int8)


def test_a_new_file_follows_the_umask(tmp_path):
    path = tmp_path / "map.npz"
    before = os.umask(0o027)
    try:
        write_map(path, grid_from_text("#."))
    finally:
        os.umask(before)
    assert stat.S_IMODE(path.stat().st_mode) == 0o640


def test_an_absolute_path_below_the_folder_is_not_one_of_another_machine(tmp_path):
    write_map(tmp_path / "m.yaml", grid_from_text("#."))
    text = (tmp_path / "m.yaml").read_text()
    (tmp_path / "m.yaml").write_text(text.replace("m.pgm", f"{tmp_path}/gone/m.pgm"))
    with pytest.raises(mapdeal.FileAccessError, match="the image does not exist"):
        read_map(tmp_path / "m.yaml")


HEIGHT, WIDTH = 37, 53
PIXELS = np.random.default_rng(7).integers(0, 256, (HEIGHT, WIDTH)).astype(np.uint8)
HEADERS = {
    "plain": b"P5\n53 37\n255\n",
    "with comments": b"P5\n# CREATOR: map_saver.cpp 0.050 m/pix\n53 37 # both\n255\n",
    "long comment": b"P5\n#" + b"x" * 3_000 + b"\n53 37\n255\n",
    "DOS line ends": b"P5\r\n53 37\r\n255\r\n",
    "smaller maxval": b"P5\n53 37\n100\n",
}


def pair(tmp_path, header=HEADERS["plain"], body=None, **more):
    (tmp_path / "map.yaml").write_text(yaml_text(image="map.pgm", resolution=0.3, **more))
    (tmp_path / "map.pgm").write_bytes(header + (PIXELS.tobytes() if body is None else body))
    return tmp_path / "map.yaml"


def rows_of(path, block_height=8, **options):
    with open_map(path, **options) as file:
        if file.shape_by_rows is None:
            return file.read(), None
        source = file.by_rows(block_height=block_height)
        layer = source.grid.occupancy
        return source, np.vstack([layer[rows] for rows in blocks_of(layer)])


def shape_by_rows(path):
    with open_map(path) as file:
        return file.shape_by_rows


def result_and_warnings(read, *arguments, **options):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            result = read(*arguments, **options)
        except mapdeal.MapdealError as error:
            result = (type(error), str(error))
    return result, [str(warning.message) for warning in caught]


def without_pixel(text):
    return re.sub(r"pixel \d+: (.*), got \d+", r"\1", text)


BITS = np.packbits(PIXELS < 128, axis=1).tobytes()
"""53 columns are 6 bytes and 5 bits."""
BODIES = {header: PIXELS.tobytes() for header in HEADERS.values()}
BODIES[HEADERS["smaller maxval"]] = (PIXELS % 101).tobytes()
BODIES |= dict.fromkeys((b"P4\n53 37\n", b"P4 # by hand\n53\n37\r"), BITS)


@pytest.mark.parametrize("dialect", ["nav2", "humble", "ros1"])
@pytest.mark.parametrize("keys", [{}, {"negate": 1}, {"mode": "scale"}, {"mode": "raw"}], ids=str)
@pytest.mark.parametrize("header", BODIES, ids=lambda header: header[:20])
def test_values_and_warnings_are_those_of_the_whole(tmp_path, header, keys, dialect):
    path = pair(tmp_path, header, BODIES[header], **keys)
    read_at_once, of_whole = result_and_warnings(read_source, path, dialect=dialect)
    for height in (1, 8, 40):
        (source, values), of_rows = result_and_warnings(rows_of, path, height, dialect=dialect)
        assert source.grid.is_lazy
        assert np.array_equal(values, read_at_once.grid.occupancy)
        assert of_rows == of_whole
    assert source.files == read_at_once.files
    assert (source.grid.resolution, source.grid.origin) == (0.3, (1.5, -2.0, 0.4))
    if BODIES[header] == BITS and not keys:
        assert np.array_equal(values == 100, PIXELS[::-1] < 128)


@pytest.mark.parametrize(("header", "body"), [
    (HEADERS["smaller maxval"], None),  # with pixels above it, of which either may be named
    (b"P4\n53 37\n", BITS[:-1]), (b"P4\n53 37\n", BITS + b"\0"), (b"P5\n53", b""),
    (b"P5\n53 37\n255\n", b"\0" * 100), (b"P5\n53 37\n255\n", PIXELS.tobytes() + b"\0" * 9),
    (b"P5\n53 0\n255\n", b""), (b"P5\n53 37\n0\n", None),
    (b"P5\n99999999 99999999\n255\n", None),
])  # fmt: skip
def test_malformed_images_get_the_same_line(tmp_path, header, body):
    path = pair(tmp_path, header, body)
    read_at_once, of_whole = result_and_warnings(read_source, path)
    rows, of_rows = result_and_warnings(rows_of, path)
    if isinstance(read_at_once, tuple):
        assert rows[0] == read_at_once[0]
        assert without_pixel(rows[1]) == without_pixel(read_at_once[1])
    else:
        assert of_rows == of_whole != []


@pytest.mark.parametrize("header", [b"P2\n2 1\n255\n0 254", b"P1\n2 1\n1 0", b"\x89PNG\r\n\x1a\n"])
def test_other_kinds_of_images_and_costs_are_left_to_be_read_whole(tmp_path, header):
    assert shape_by_rows(pair(tmp_path, header, b"")) is None
    assert shape_by_rows(pair(tmp_path, mode="raw", cost_scale="costmap2d")) is None


def test_the_shape_comes_from_the_header_alone(tmp_path, recwarn):
    path = pair(tmp_path, b"P5\n50000 40000\n255\n", b"")
    with open(tmp_path / "map.pgm", "r+b") as file:
        file.truncate(2_000_000_019)  # sparse: nobody reads it
    assert shape_by_rows(path) == (40000, 50000)
    with open_map(path, max_cells=2_000_000_000) as file:
        assert file.shape() == (40000, 50000)
    assert not recwarn.list
    with open_map(path) as file, pytest.raises(MalformedInputError, match="2000000000 cells"):
        file.shape()
    path = pair(tmp_path)
    with pytest.raises(MalformedInputError, match="1961"):
        rows_of(path, max_cells=1960)
    assert rows_of(path, max_cells=1961)


def test_checksums_are_of_the_bytes_that_were_read(tmp_path):
    path = pair(tmp_path)
    files = path, tmp_path / "map.pgm"
    expected = {path: hashlib.sha256(path.read_bytes()).hexdigest() for path in files}
    with sums_of_reads() as sums:
        read_source(path)
        files[1].write_bytes(b"replaced")
    assert sums == expected
    pair(tmp_path)
    with sums_of_reads() as sums, open_map(path) as file:
        assert sums == {path: expected[path]}
        assert file.sums_by_name(sums) == {path.name: sum_ for path, sum_ in expected.items()}


@pytest.mark.parametrize("change", [
    lambda data: data[:-1] + b"\1",  # of the rows just read, which nobody reads again
    lambda data: data[:100],
])  # fmt: skip
def test_a_file_that_is_written_to_or_cut_meanwhile_is_an_error(tmp_path, change):
    path, image = pair(tmp_path), tmp_path / "map.pgm"
    with open_map(path) as file:
        grid = file.by_rows(block_height=8).grid
        assert np.array_equal(grid.occupancy[0:8], read_source(path).grid.occupancy[0:8])
        image.write_bytes(change(image.read_bytes()))
        for read in (lambda: grid.occupancy[8:16], lambda: file.sums_by_name({})):
            with pytest.raises(FileAccessError, match="changed while it was read"):
                read()


@pytest.mark.parametrize("name", ["map.yaml", "map.pgm"])
def test_a_file_that_is_replaced_between_header_and_cells_is_an_error(tmp_path, name):
    path = pair(tmp_path)
    for read in (MapFile.read, lambda file: file.by_rows(block_height=8)):
        with open_map(path) as file:
            (tmp_path / "next").write_bytes((tmp_path / name).read_bytes())
            (tmp_path / "next").replace(tmp_path / name)
            with pytest.raises(FileAccessError, match=f"{name}: changed while it was read"):
                read(file)


def system(tmp_path, available, group, groups):
    meminfo = "" if available is None else f"MemTotal: 99 kB\nMemAvailable:   {available} kB\n"
    (tmp_path / "meminfo").write_text(meminfo)
    (tmp_path / "cgroup").write_text(f"1:name=systemd:/x\n0::/{group}\n")
    for name, (limit, used, cached) in groups.items():
        folder = tmp_path / "groups" / name
        folder.mkdir(parents=True)
        (folder / "memory.max").write_text(f"{limit}\n")
        (folder / "memory.current").write_text(f"{used}\n")
        (folder / "memory.stat").write_text(f"anon 5\ninactive_file {cached}\nslab 3\n")
    return free_memory(tmp_path / "meminfo", tmp_path / "cgroup", tmp_path / "groups")


@pytest.mark.parametrize(("available", "group", "groups", "free"), [
    (1000, "", {}, 1_024_000),
    (1000, "a/b", {"a": (500_000, 400_000, 30_000), "a/b": ("max", 100, 0)}, 130_000),
    (1000, "a/b", {"a": (500_000, 400_000, 0), "a/b": (90_000, 80_000, 0)}, 10_000),
    (1000, "a", {"a": (5, 10, 0)}, 0),
    (None, "", {}, None),
])  # fmt: skip
def test_the_tightest_group_of_processes_limits_memory(tmp_path, available, group, groups, free):
    assert system(tmp_path, available, group, groups) == free


@pytest.mark.parametrize("size", [0, 1, 1000, HEAD - 1, HEAD, HEAD + 1, 2 * HEAD + 5])
def test_any_bytes_are_those_of_the_file(tmp_path, size):
    (tmp_path / "a").write_bytes(data := os.urandom(size))
    with opened(tmp_path / "a") as file:
        assert file.head == data[:HEAD]
        for offset, count in [
            (0, HEAD), (0, size), (0, 3), (5, 7), (HEAD - 2, 4), (HEAD, 10), (size, 5),
            (size + 3, 5), (max(size - 4, 0), 100), (2, 1 << 22), (3, 0),
        ]:  # fmt: skip
            assert file.read(offset, count) == data[offset : offset + count]
