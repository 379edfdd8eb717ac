import json
from pathlib import Path

import numpy as np
import pytest

import mapdeal
from mapdeal import Footprint, OccupancyGrid

ROOM = np.zeros((20, 30), dtype=np.int8)
ROOM[[0, -1], :] = ROOM[:, [0, -1]] = 100
ROOM[:8, 15] = ROOM[12:, 15] = 100  # a door of four cells
FRAME = (0.1, (1.0, -2.0, 0.3))
PARAMS = "--robot-radius 0.1"


def mask_of(cells, value=100):
    mask = np.full(ROOM.shape, -1, dtype=np.int8)
    mask[cells] = value
    return OccupancyGrid(mask, *FRAME)


@pytest.fixture
def files(here):
    mapdeal.write_map("room.yaml", OccupancyGrid(ROOM, *FRAME))
    mapdeal.write_map("mask.npz", mask_of(np.s_[6:14, 14:17]))
    return here


def test_a_run_lays_the_mask_over_costs_and_nothing_else(sh, files):
    room, mask = mapdeal.read_map("room.yaml"), mapdeal.read_map("mask.npz")
    line = f"run room.yaml --recipe nav2 --no-images {PARAMS} -o"
    with_mask = f"{line} masked --mask mask.npz"
    sh(f"{line} plain")
    sh(with_mask)
    plain, masked = (mapdeal.read_map(f"{name}/room/cost.npz") for name in ("plain", "masked"))
    assert np.array_equal(masked.cost, mapdeal.apply_keepout_mask(plain, mask).cost)
    assert masked.cost[10, 15] == 254 != plain.cost[10, 15]
    esdf = [Path(name, "room/esdf.npz").read_bytes() for name in ("plain", "masked")]
    assert esdf[0] == esdf[1]
    assert list(json.loads(Path("masked/room/manifest.json").read_text())["mask"]) == ["mask.npz"]
    assert "unchanged" in sh(with_mask)[1]
    mapdeal.write_map("mask.npz", mask_of(np.s_[:2, :2]), force=True)
    assert "the output exists" in sh.err(with_mask, 4)
    assert sh(f"{line} masked")[0] == 4
    products = mapdeal.apply_recipe(room, "nav2", mask=mask, robot_radius=0.1)
    assert np.array_equal(products["cost"].cost, masked.cost)


AREA = np.s_[3:9, 5:9]


def test_a_keepout_cell_is_closed_to_the_centre_of_a_round_robot_as_unknown_cells_are():
    room, hidden = OccupancyGrid(ROOM, *FRAME), ROOM.copy()
    hidden[AREA] = -1
    masked = mapdeal.reach(room, radius=0.15, mask=mask_of(AREA))
    unknown = mapdeal.reach(OccupancyGrid(hidden, *FRAME), radius=0.15)
    for layer in ("reachable", "headings", "clearance", "widest"):
        assert np.array_equal(getattr(masked, layer), getattr(unknown, layer)), layer
    through = mapdeal.reach(room, radius=0.15, mask=mask_of(AREA), through_unknown=True)
    assert not through.headings[AREA].any()


def test_the_corners_of_a_robot_may_reach_into_a_keepout_area():
    room = OccupancyGrid(ROOM, *FRAME)
    shape = Footprint.polygon([(0.3, 0.1), (0.3, -0.1), (-0.2, -0.1), (-0.2, 0.1)])
    plain = mapdeal.reach(room, footprint=shape, headings=24)
    masked = mapdeal.reach(room, footprint=shape, headings=24, mask=mask_of(AREA))
    assert plain.headings[AREA].any()
    expected = plain.headings.copy()
    expected[AREA] = 0
    assert np.array_equal(masked.headings, expected)
    assert not masked.reachable[AREA].any()


def test_reach_route_and_query_heed_the_mask(sh, files):
    x, y = OccupancyGrid(ROOM, *FRAME).frame.xy_from_rowcol([[10, 5], [10, 25], [10, 15]]).T
    start, goal, door = (f"{a:.4f},{b:.4f}" for a, b in zip(x, y, strict=True))
    for name in ("reach", "route"):
        line = f"{name} room.yaml --from {start} --to {goal} {PARAMS}"
        assert [sh(line)[0], sh(f"{line} --mask mask.npz")[0]] == [0, 1]
    line = f"reach room.yaml --from {start} --to {goal} {PARAMS} --mask mask.npz"
    assert sh.err(line, 1).endswith("hint: the cells of the keepout mask are closed\n")
    line = f"reach room.yaml --from {start} --to {door} {PARAMS} --mask mask.npz"
    assert "in a keepout area" in sh(line)[2]
    line = f"query room.yaml --at {door},0 {PARAMS}"
    assert [sh.json(line)["cost"], sh.json(f"{line} --mask mask.npz")["cost"]] == [0, 254]


def test_the_filter_of_a_robot_is_not_said_to_lack_its_mask(sh, files):
    robot = Path(__file__).parents[2] / "examples/robots/nav2_params.yaml"
    ask = f"cost room.yaml -o out.npz --params-file {robot}"
    assert "keepout_filter (no mask)" in sh(ask)[2]
    assert "keepout_filter (no mask)" not in sh(f"{ask} --mask mask.npz --force")[2]
