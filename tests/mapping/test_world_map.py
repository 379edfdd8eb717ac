"""Maps of worlds: mapdeal's own worlds give back their maps; a room with ramp, steps and table."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, strategies as st
from hypothesis.extra.numpy import arrays

import mapdeal
from mapdeal import MapdealWarning, OccupancyGrid, build_map_from_world, read_map, write_map
from strategies import examples

STORAGE = Path(__file__).parents[2] / "examples" / "worlds" / "storage.sdf"
REAL = [
    "ROBOTIS-GIT__turtlebot3/turtlebot3_navigation2/map/map", "WPI-RAIL__rail_maps/maps/ilab",
    "LihanChen2004__pb_rm_simulation/map/RMUC", "mit-racecar__racecar_simulator/maps/building_31",
    "mit-racecar__racecar_simulator/maps/stata_basement",
    "husky__husky/husky_navigation/maps/playpen_map",
    "at-wat__neonavigation/neonavigation_launch/map/demo_map",
    "ryuichiueda__value_iteration/maps/house",
    "turtlebot__turtlebot_simulator/turtlebot_stdr/maps/frieburg",
    "chifongip__cartographer_ros/maps/office/central/mymap",
]  # fmt: skip


def differing(command, folder, grid, ending):
    """Return how many cells of a map differ from those of its own world."""
    write_map(folder / "a.npz", grid, force=True)
    world = folder / f"w{ending}"
    code, _, err = command("convert", folder / "a.npz", "-o", world, "--force")
    assert code == 0, err
    place = {"resolution": grid.resolution, "size": grid.frame.size_xy, "origin": grid.origin}
    found = build_map_from_world(world, height=1.0, solid=True, **place)
    assert found.shape == grid.shape
    return np.count_nonzero((found.occupancy == 100) != (grid.occupancy == 100))


@pytest.mark.parametrize("ending", [".sdf", ".stl", ".obj"])
@examples(15, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(cells=arrays(np.int8, (7, 9), elements=st.sampled_from([0, 100])), yaw=st.floats(-3, 3))
def test_worlds_of_maps_give_back_their_cells(command, tmp_path_factory, ending, cells, yaw):
    cells[3, 4] = 100
    grid = OccupancyGrid(cells, 0.13, (3.7, -2.2, yaw))
    assert differing(command, tmp_path_factory.mktemp("w"), grid, ending) == 0


@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore::mapdeal.MapdealWarning")
@pytest.mark.parametrize("name", REAL)
@pytest.mark.parametrize("ending", [".sdf", ".stl", ".obj"])
def test_worlds_of_real_maps_give_back_their_cells(command, tmp_path, real_maps, name, ending):
    assert differing(command, tmp_path, read_map(real_maps / f"{name}.yaml"), ending) == 0


FREE, OCCUPIED, UNKNOWN = 0, 100, -1
PLACES = {
    "floor": (3.5, 3.5), "under the table": (2.2, 2.1), "leg": (1.17, 1.95), "column": (5.0, 2.0),
    "rim of the column": (5.0, 2.24), "trolley": (6.5, 1.5), "ramp": (5.2, 5.0),
    "platform": (7.0, 5.0), "edge of the platform": (7.0, 4.03), "threshold": (2.0, 5.0),
    "edge of the threshold": (2.0, 4.77), "outside": (4.0, 6.17), "wall": (4.0, 6.05),
}  # fmt: skip


@pytest.mark.parametrize(("options", "values"), [
    ({"height": 0.2}, ("floor=0, under the table=0, leg=100, column=-1, rim of the column=100, "
     "trolley=-1, platform=-1, threshold=0, outside=-1, wall=100")),
    ({"height": 0.2, "solid": True}, "column=100, trolley=100, platform=100, outside=0"),
    ({"height": 0.2, "static_only": True}, "trolley=0, column=-1"),
    ({"height": 0.72}, "under the table=-1, ramp=0, platform=0"),
    ({"robot_height": 0.5}, ("floor=0, under the table=0, leg=100, column=-1, trolley=100, "
     "ramp=0, platform=0, edge of the platform=100, threshold=0, outside=-1, wall=100")),
    ({"robot_height": 0.05, "climb": 0.04}, "trolley=0, edge of the threshold=0, floor=0"),
    ({"robot_height": 1.5, "climb": 0.025},
     "under the table=100, edge of the threshold=100, column=-1"),
    ({"robot_height": 1.5, "solid": True}, "column=100, outside=0, ramp=0, floor=0"),
    ({"robot_height": 1.5, "max_slope": 5}, "ramp=100, floor=0"),
    ({"robot_height": 0.5, "drops": "unknown"}, "floor=0, platform=0"),
])  # fmt: skip
def test_cells_of_the_storage_room(options, values):
    grid = build_map_from_world(STORAGE, **options)
    expected = dict(entry.split("=") for entry in values.split(", "))
    assert {name: str(grid.query([PLACES[name]]).values[0]) for name in expected} == expected


def test_origin_yaw_and_size_only_move_the_cells():
    whole = build_map_from_world(STORAGE, height=0.2)
    place = {"size": (4.0, 3.0), "origin": (5.0, 0.6, 0.4), "resolution": 0.05}
    turned = build_map_from_world(STORAGE, height=0.2, **place)
    assert turned.shape == (60, 80)
    centres = turned.frame.xy_from_rowcol(np.argwhere(turned.occupancy == OCCUPIED))
    steps = 0.05 * (np.indices((3, 3)).reshape(2, -1).T - 1)
    near = [whole.query(centres + step).values == OCCUPIED for step in steps]
    assert len(centres) > 40
    assert np.any(near, axis=0).all()


def rooms(folder):
    """Write a closed room, 3 m x 2 m, and beside it one of 2 m x 2 m."""
    walls, across = "", [(x, 0, x + 0.1, 2) for x in (0, 3, 5)]
    for k, (x0, y0, x1, y1) in enumerate([(0, 0, 5.1, 0.1), (0, 2, 5.1, 2.1), *across]):
        box = f"<box><size>{x1 - x0} {y1 - y0} 2</size></box>"
        pose = f"<pose>{(x0 + x1) / 2} {(y0 + y1) / 2} 1 0 0 0</pose>"
        walls += f'<collision name="c{k}">{pose}<geometry>{box}</geometry></collision>'
    path, link = folder / "rooms.sdf", f'<link name="l">{walls}</link>'
    path.write_text(f'<sdf version="1.7"><model name="m">{link}</model></sdf>')
    return path


@pytest.mark.parametrize("rule", [{"height": 1.0}, {"robot_height": 1.0, "floor": 0.0}])
def test_the_largest_room_or_that_at_a_place_is_known(tmp_path, rule):
    path = rooms(tmp_path)
    with pytest.warns(MapdealWarning, match=r"3\.\d+ m2 of free space behind walls are unknown"):
        grid = build_map_from_world(path, **rule)
    assert grid.query([(1.5, 1.0), (4.0, 1.0)]).values.tolist() == [FREE, UNKNOWN]
    with pytest.warns(MapdealWarning):
        grid = build_map_from_world(path, **rule, at=(4.0, 1.0, 0.0))
    assert grid.query([(1.5, 1.0), (4.0, 1.0)]).values.tolist() == [UNKNOWN, FREE]


@pytest.mark.parametrize(("options", "message"), [
    ({}, "needs exactly one of height (what a lidar sees) and robot_height"),
    ({"height": 0.2, "robot_height": 1.0}, "exactly one of height"),
    ({"height": 0.2, "climb": 0.1}, "climb: applies to robot_height, not"),
    ({"height": 9.0}, "height: meets nothing: solids reach from 0 to 2.5 m, got 9.0"),
    ({"height": 0.2, "at": (5.0, 2.0, 0.0)}, "at: must be free"),
    ({"height": 0.2, "at": (50.0, 2.0, 0.0)}, "at: lies outside of the map"),
    ({"robot_height": 1.0, "fill": 0.3}, "fill: does not apply to worlds"),
    ({"height": 0.2, "size": (1.0, 1.0)}, "size, origin: must be given together"),
])  # fmt: skip
def test_refusals(options, message):
    with pytest.raises(mapdeal.ParameterError) as caught:
        build_map_from_world(STORAGE, **options)
    assert message in str(caught.value)


def test_the_command_writes_the_map_and_gates_a_moved_world(command, tmp_path):
    for name in ("storage.sdf", "ramp.obj"):
        text = (STORAGE.parent / name).read_text().replace("6.5 1.5 0 0", "6.5 1.7 0 0")
        (tmp_path / name).write_text(text)
    for number, world in enumerate((STORAGE, STORAGE, tmp_path / "storage.sdf")):
        words = ("-o", tmp_path / f"{number}.yaml", "--height", "0.2", "--json")
        code, out, _ = command("build", "--world", world, *words)
        assert (code, '"solids": 15' in out) == (0, True)
    assert command("diff", tmp_path / "0.yaml", tmp_path / "1.yaml")[0] == 0
    assert command("diff", tmp_path / "0.yaml", tmp_path / "2.yaml")[0] == 1
    for words in (("--world", STORAGE, "--cloud", "c.pcd"), ("x.log", "--solid")):
        assert command("build", *words, "-o", tmp_path / "x.yaml")[0] == 2
