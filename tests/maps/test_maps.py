"""Writing grids and reading them back."""

import os
import stat
import zipfile

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings, strategies as st

import mapdeal
from drawn import grid_from_text
from mapdeal import Costmap, MapdealWarning, OccupancyGrid, esdf, read_map, write_map
from mapdeal.maps.dialects import DIALECTS
from mapdeal.maps.reading import open_map
from strategies import occupancies

IN_A_FOLDER = settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
ENDINGS = st.sampled_from([".yaml", ".pgm", ".png", ".npz"])
ORIGINS = st.tuples(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6), st.floats(-3.2, 3.2))


@IN_A_FOLDER
@given(occupancies(), st.floats(1e-3, 10), ORIGINS, ENDINGS, st.sampled_from(list(DIALECTS)))
@pytest.mark.usefixtures("mapdeal_warnings")
def test_values_and_geometry_survive_a_round_trip(
    tmp_path, occupancy, resolution, origin, ending, dialect
):
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
    assert (tmp_path / "map.yaml").read_text() == (
        "image: map.pgm\nmode: trinary\nresolution: 0.0125\n"
        "origin: [12345.6789, -1.0e-07, 0.1]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    head = b"P5\n# CREATOR: mapdeal 0.0125 m/pix\n3 2\n255\n"
    assert (tmp_path / "map.pgm").read_bytes() == head + bytes([0, 254, 205, 254, 254, 254])


def test_values_in_between_are_written_raw_by_default(tmp_path):
    """Trinary keeps free up to 25 and occupied from 65."""
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
    grid = OccupancyGrid([[0, 1, 2, 5, 98, 99, 100]], 0.05)
    write_map(tmp_path / "m.pgm", grid, mode="scale")
    # (100 - v) * 2.55: 255, 252.45, 249.9, 242.25, 5.1, 2.55, 0
    assert list((tmp_path / "m.pgm").read_bytes()[-7:]) == [255, 252, 250, 242, 5, 3, 0]


def test_mode_scale_of_unknown_cells_needs_a_png(tmp_path):
    with pytest.raises(mapdeal.ParameterError, match="transparent"):
        write_map(tmp_path / "map.yaml", grid_from_text("#?."), mode="scale")
    assert list(tmp_path.iterdir()) == []


def test_costs_as_ros_would_publish_them(tmp_path):
    costmap = Costmap([[0, 1, 128, 253, 254, 255]], 0.25, (1.5, -2.0, 0.4))
    write_map(tmp_path / "cost.yaml", costmap)
    assert (tmp_path / "cost.pgm").read_bytes().endswith(bytes([0, 1, 50, 99, 100, 255]))
    for dialect in DIALECTS:
        values = read_map(tmp_path / "cost.yaml", dialect=dialect).occupancy
        assert values.tolist() == [[0, 1, 50, 99, 100, -1]]


def test_costs_as_bytes_come_back_as_a_costmap(tmp_path):
    costmap = Costmap([[0, 1, 128], [253, 254, 255]], 0.25, (1.5, -2.0, 0.4))
    with pytest.warns(MapdealWarning, match="misread"):
        write_map(tmp_path / "cost.yaml", costmap, encoding="costmap2d")
    back = read_map(tmp_path / "cost.yaml")
    assert (type(back), back.origin) == (Costmap, costmap.origin)
    assert np.array_equal(back.cost, costmap.cost)


def test_the_keys_of_an_npz(tmp_path):
    field = esdf(grid_from_text("#..?"), max_distance=0.6, strength=1.5, unknown="occupied")
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
