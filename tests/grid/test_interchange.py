import math
import pickle
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, strategies as st

import mapdeal
from mapdeal import Costmap, OccupancyGrid, from_msg

CELLS = np.array([[0, 100, -1, 7], [0, 0, 50, -1]], dtype=np.int8)
MAP = OccupancyGrid(CELLS, 0.05, (-1.2, 3.4, 0.0))
TURNED = OccupancyGrid(CELLS, 0.05, (-1.2, 3.4, 0.3))
COSTS = Costmap([[0, 1, 128], [253, 254, 255]], 0.5, (1.0, 2.0, 0.5))
FIELD = mapdeal.esdf(MAP)
POTENTIAL = mapdeal.potential(FIELD, attractive_gain=0.5)


@pytest.mark.parametrize("grid", [MAP, TURNED, COSTS, FIELD, POTENTIAL])
def test_an_array_of_a_grid_is_its_main_layer(grid):
    assert np.array_equal(np.asarray(grid), grid.layer, equal_nan=True)
    assert np.asarray(grid, dtype=np.float32).dtype == np.float32
    copied = np.array(grid)
    copied[0, 0] = 1
    assert np.array_equal(np.asarray(grid), grid.layer, equal_nan=True)


def test_an_array_of_a_bit_map_has_a_bool_for_each_cell():
    bits = mapdeal.BitMap.from_occupancy(MAP)
    assert np.asarray(bits).tolist() == (CELLS == 100).tolist()
    assert np.asarray(bits, dtype=int).sum() == 1
    with pytest.raises(mapdeal.ParameterError, match=r"must have the shape of the grid, \(2, 4\)"):
        MAP.with_values(CELLS[:1])


def test_extent_and_bounds_are_the_outer_borders_in_metres():
    assert MAP.extent == (-1.2, -1.0, 3.4, 3.5)
    assert MAP.bounds == (-1.2, 3.4, -1.0, 3.5)
    with pytest.raises(mapdeal.ParameterError, match="rotated") as refused:
        _ = TURNED.extent
    assert "plot()" in refused.value.hint


@given(st.floats(-4, 4), st.floats(-9, 9), st.floats(0.01, 2), st.integers(0, 2), st.integers(0, 4))
def test_the_transform_leads_from_columns_and_rows_to_metres(yaw, x, resolution, row, col):
    grid = OccupancyGrid(CELLS, resolution, (x, 2 * x, yaw))
    place = grid.transform @ (col, row, 1)
    cos, sin = math.cos(yaw), math.sin(yaw)
    expected = (
        x + resolution * (col * cos - row * sin), 2 * x + resolution * (col * sin + row * cos), 1
    )  # fmt: skip
    assert np.allclose(place, expected)
    west, bottom, east, top = grid.bounds
    assert west - 1e-6 <= place[0] <= east + 1e-6
    assert bottom - 1e-6 <= place[1] <= top + 1e-6


def test_values_are_read_by_metres():
    values, inside = COSTS.query([[1.05, 2.1], [50.0, 2.0]])
    assert (values.tolist(), inside.tolist()) == ([0, 255], [True, False])
    rows, cols = np.indices(COSTS.shape).reshape(2, -1)
    centres = COSTS.frame.xy_from_rowcol(np.stack([rows, cols], axis=1))
    assert COSTS.query(centres).values.tolist() == COSTS.cost.reshape(-1).tolist()


@pytest.mark.parametrize("grid", [MAP, TURNED, COSTS, FIELD])
def test_matplotlib_draws_cells_where_they_lie(grid):
    pyplot = pytest.importorskip("matplotlib.pyplot")
    pyplot.switch_backend("agg")
    axes = grid.plot(pyplot.figure().gca(), alpha=0.5)
    (image,) = axes.images
    assert (image.get_alpha(), image.origin) == (0.5, "lower")
    corner = (image.get_transform() - axes.transData).transform(image.get_extent()[1::2])
    height, width = grid.shape
    assert np.allclose(corner, (grid.transform @ (width, height, 1))[:2])
    unknown = np.ma.getmaskarray(image.get_array())
    expected = np.isnan(grid.layer) if grid is FIELD else grid.layer == grid.unknown_value
    assert np.array_equal(unknown, expected)
    if grid is not FIELD:
        colours = image.to_rgba(image.get_array()).reshape(-1, 4)
        assert len({tuple(colour) for colour in colours}) == len({*grid.layer.flat})
        grid.plot(norm=image.norm, cmap="gray")


def test_xarray_has_the_centres_of_cells_as_coordinates():
    pytest.importorskip("xarray")
    array = MAP.to_xarray()
    assert array.sel(x=-1.12, y=3.42, method="nearest") == 100
    assert np.allclose(array.x, [-1.175, -1.125, -1.075, -1.025])
    assert (array.name, array.attrs["resolution"]) == ("occupancy", 0.05)
    turned = TURNED.to_xarray()
    assert turned.dims == ("row", "col")
    assert np.allclose((turned.x[1, 2], turned.y[1, 2]), TURNED.frame.xy_from_rowcol([[1, 2]])[0])


@pytest.mark.parametrize(("name", "call"), [("matplotlib", MAP.plot), ("xarray", MAP.to_xarray)])
def test_a_missing_library_is_named(monkeypatch, name, call):
    for module in ("matplotlib", "matplotlib.pyplot", "xarray"):
        monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(mapdeal.ParameterError, match=f"{name}: is not installed") as refused:
        call()
    assert refused.value.hint == f"pip install {name}"


@pytest.mark.parametrize("grid", [MAP, TURNED, COSTS])
def test_messages_and_grids_are_each_other_s_inverse(grid):
    published = grid.to_occupancy()
    back = from_msg(grid.to_msg())
    assert np.array_equal(back.occupancy, published.occupancy)
    assert back.resolution == grid.resolution
    assert np.allclose(back.origin, grid.origin, atol=1e-12)


class Message(SimpleNamespace):
    """A message of ROS: only the fields that its type has can be set."""

    def __setattr__(self, name, value):
        if not hasattr(self, name):
            raise AttributeError(name)
        super().__setattr__(name, value)


def ros_grid():
    place = {"x": 0.0, "y": 0.0, "z": 0.0}
    pose = Message(position=Message(**place), orientation=Message(**place, w=1.0))
    info = Message(map_load_time=None, resolution=0.0, width=0, height=0, origin=pose)
    return Message(header=Message(stamp=None, frame_id=""), info=info, data=[])


def test_objects_of_ros_are_filled_and_read():
    message = TURNED.to_msg(ros_grid, frame_id="floor_2")
    assert (message.header.frame_id, message.data) == ("floor_2", CELLS.reshape(-1).tolist())
    assert np.array_equal(from_msg(message).occupancy, CELLS)


def test_updates_change_the_map_that_they_belong_to():
    update = {"header": {}, "x": 1, "y": 0, "width": 2, "height": 2, "data": [1, 2, 3, 4]}
    assert from_msg(update, onto=MAP).occupancy.tolist() == [[0, 1, 2, 7], [0, 3, 4, -1]]
    for wrong, onto in ((update, None), ({**update, "x": 3}, MAP), ({**update, "y": -1}, MAP)):
        with pytest.raises(mapdeal.ParameterError):
            from_msg(wrong, onto=onto)


@pytest.mark.parametrize("message", [
    {}, 3, {"info": {}, "data": []}, {**MAP.to_msg(), "data": [0]},
    {**MAP.to_msg(), "data": [101] * 8}, {"x": 0, "y": 0, "width": 2, "height": 1, "data": [1]},
])  # fmt: skip
def test_what_is_no_grid_is_refused_in_one_line(message):
    with pytest.raises(mapdeal.MalformedInputError) as refused:
        from_msg(message, onto=MAP)
    assert "Namespace" not in str(refused.value)


def test_footprints_may_be_lists():
    corners = [[0.3, 0.2], [0.3, -0.2], [-0.3, 0.1]]
    costs = [mapdeal.costmap(MAP, footprint=form(corners)).cost for form in (list, str, np.array)]
    assert not np.ptp(costs, axis=0).any()
    layer = {"inflation_radius": 0.2, "cost_scaling_factor": 30}
    changes = {f"cost.{name}": value for name, value in layer.items()}
    made = mapdeal.apply_recipe(MAP, "nav2", changes, robot_radius=0.01)["cost"]
    assert made.equals(mapdeal.costmap(MAP, robot_radius=0.01, **layer))


def test_wrong_arguments_are_named():
    costs = mapdeal.costmap(MAP, robot_radius=0.01)
    robot = mapdeal.Footprint.circle(0.2)
    for call, text, hint in (
        (lambda: mapdeal.inflate(MAP, 0.3), "too many positional arguments", "radius=..."),
        (lambda: mapdeal.inflate(MAP, radus=0.3), "keyword argument 'radus'", "radius?"),
        (lambda: mapdeal.footprint_costs(robot, costs, []), "footprint: .* got Costmap", ""),
        (lambda: mapdeal.graph(MAP, radius=0.2), "keyword argument 'radius'", "Footprint.circle"),
        (lambda: mapdeal.graph(MAP, max_memry=1), "argument 'max_memry'", "max_memory?"),
        (lambda: mapdeal.footprint_costs("a.npz", robot, [[0, 0, 0]]), "got 'a.npz'", "read_map"),
        (lambda: mapdeal.footprint_costs(costs.cost, robot, [[0, 0, 0]]), "Costmap", "Occupancy"),
        (lambda: mapdeal.read_map(3), "path: must be str or PathLike, got 3", ""),
        (lambda: mapdeal.reach(MAP, start=(0, 0), goals=None), "goals", ""),
        (lambda: mapdeal.inflate("m.yaml"), "inflate: grid must be a grid, got", "read_map"),
        (lambda: mapdeal.write_map(MAP, "x.yaml"), "path: must be Path or str", "comes first"),
        (lambda: mapdeal.merge(MAP, MAP), "too many", "pass one list: merge([a, b])"),
        (lambda: mapdeal.merge(MAP), "maps: must be a sequence", ""),
        (lambda: mapdeal.costmap(MAP, robot_radius="x"), "robot radius must be", ""),
        (lambda: mapdeal.costmap(MAP), "needs a robot", "robot_radius=0.2"),
        (lambda: mapdeal.costmap(MAP, 0.2), "paths of parameter files", "robot_radius=0.2"),
        (lambda: mapdeal.reach(MAP, radius=0.3, footprint=[[1, 1], [1, 0], [0, 0]]), "radius", ""),
        (lambda: MAP.to_msg(dict), "message_type: must be nav_msgs.msg.OccupancyGrid", ""),
        (lambda: mapdeal.Frame(-3, 3, 0.05), "height: must not be negative", ""),
        (lambda: mapdeal.costmap(MAP, [[0, 1]]), "paths of parameter files", "footprint="),
        (lambda: mapdeal.costmap(CELLS, robot_radius=1), "takes a grid", "OccupancyGrid("),
        (lambda: mapdeal.costmap(MAP, footprint=[1, 2, 3]), "must be a pair of numbers", ""),
        (lambda: OccupancyGrid([[0, 300]], 0.1), "or bool, got 300", ""),
        (lambda: OccupancyGrid("m.yaml", 0.1), "0 to 100, or bool, got 'm.yaml'", ""),
        (lambda: mapdeal.cloud_map("a.pcd"), "points: must be numbers, got 'a.pcd'", ""),
        (lambda: mapdeal.score(MAP, MAP, minimum=0.9), "minimum: must be Mapping, got 0.9", ""),
        (lambda: mapdeal.scan(MAP, route=MAP), "route: must be a file or a Route", ""),
        (lambda: mapdeal.scan(MAP, tour="yes"), "tour: must be bool, got 'yes'", ""),
        (lambda: mapdeal.rescale(MAP, 0.1, rule=np.zeros(2)), "one of area, nearest", ""),
        (lambda: mapdeal.blank(3), "grid: must be ", ""),
        (lambda: mapdeal.Costmap.from_static_layer("a"), "must be an OccupancyGrid", ""),
        (lambda: mapdeal.Footprint.circle("0.2"), "robot radius must be a finite number", ""),
        (lambda: robot.padded(None), "footprint padding must be a finite number", ""),
        (lambda: mapdeal.Footprint.parse(None), "a footprint must look like", ""),
    ):
        with pytest.raises(mapdeal.ParameterError, match=text) as refused:
            call()
        assert hint in (refused.value.hint or "")


def test_public_functions_can_be_sent_to_other_processes():
    assert pickle.loads(pickle.dumps(mapdeal.inflate)) is mapdeal.inflate  # noqa: S301
