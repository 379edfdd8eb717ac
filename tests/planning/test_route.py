"""``mapdeal.route``: the command as a function, of files and of grids."""

import json

import numpy as np
import pytest

import mapdeal
from drawn import grid_from_text
from mapdeal import Costmap, read_map, shortest_route, write_map

HALL = "\n".join(["." * 24] * 6 + ["." * 12 + "#" + "." * 11] * 8)
FREE = Costmap(np.zeros((4, 9), np.uint8), 0.5)
ENDS = {"start": (0.25, 0.25), "goal": (3.75, 1.25)}


@pytest.fixture
def hall(tmp_path):
    write_map(tmp_path / "hall.yaml", grid_from_text(HALL, 0.25, (1.0, -2.0, 0.4)))
    return tmp_path / "hall.yaml"


@pytest.fixture
def ends(hall):
    points = read_map(hall).frame.xy_from_rowcol([(3, 3), (3, 20)]).round(3)
    return dict(zip(("start", "goal"), map(tuple, points.tolist()), strict=True))


@pytest.mark.usefixtures("mapdeal_warnings")
def test_files_and_grids_have_the_routes_of_the_command(command, hall, ends):
    start, goal = (",".join(map(str, ends[name])) for name in ("start", "goal"))
    descent = {"method": "descent", "attractive_gain": 50.0}
    for how in ({}, {"heuristic": "field"}, descent):
        more = [f"--{name.replace('_', '-')}={value}" for name, value in how.items()]
        code, out, _ = command("route", hall, f"--from={start}", f"--to={goal}", *more)
        for source in (hall, str(hall), read_map(hall)):
            found = mapdeal.route(source, **ends, **how)
            assert "".join(found.parts()) + "\n" == out
            assert found.document() == json.loads(out)
            assert found.passes is (code == 0)


def test_a_route_has_what_the_library_finds_and_a_picture():
    found = mapdeal.route(FREE, **ENDS, field_weight=1.0)
    alone = shortest_route(FREE, *ENDS.values(), field_weight=1.0)
    assert isinstance(found, mapdeal.Route)
    assert found.points_xy.tolist() == alone.points_xy.tolist()
    assert repr(found).startswith("PlannedRoute(")
    assert found.costs is FREE
    assert found.drawn().indices.ndim == 2
    found.check()
    assert mapdeal.draw_picture(FREE, route=found).indices.ndim == 2


def test_pairs_are_found_as_they_are_read(tmp_path):
    (tmp_path / "p.csv").write_text("0.25,0.25,3.75,1.25\n9,9,1,1\n")
    routes = mapdeal.route(FREE, pairs=tmp_path / "p.csv", compare=["plain"])
    assert routes.reached == 0
    first, second = map(json.loads, routes.parts())
    assert (first["pair"], first["method"], first["reached"]) == (1, "plain", True)
    assert "outside" in second["error"]
    assert (routes.reached, routes.counts["failed"]) == (1, 1)
    assert "".join(routes.remarks()).startswith("means of 1 pair")
    with pytest.raises(mapdeal.MapdealError, match="1 of 2 pairs have no routes"):
        routes.check()
