"""Pictures as they were recorded: each pixel, and each text with its place.

Letters depend on the library that draws them, so each text is a black box here, whose width goes by
its length. Where a picture is meant to change, look at the new one, and then record it:
``MAPDEAL_RECORD=1 python -m pytest -n0 tests/pictures/test_recorded.py``.
"""

import hashlib
import json
import os
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import mapdeal
from drawn import grid_from_text
from mapdeal import Costmap, Footprint, Frame, Goal, GoalReach, OccupancyGrid, Route
from mapdeal.grid.canvas import on_canvas
from mapdeal.grid.filters import FilterInfo
from mapdeal.grid.route_graph import RouteEdge, RouteGraph, RouteNode
from mapdeal.pictures import canvas, comparisons
from mapdeal.pictures.comparisons import difference_image, merge_image, score_image
from mapdeal.pictures.layers import cost_image, occupancy_image, zones_image
from mapdeal.pictures.overlay import (
    KeepoutOverlay,
    PlanOverlay,
    RingOverlay,
    StepsOverlay,
    TrajectoriesOverlay,
)
from mapdeal.pictures.reach import GraphOverlay, reach_image
from mapdeal.pictures.styles import alignment_style, cleaning_style
from pictures.samples import CURVES, TWO_AREAS, curve_of, passage_at, reach_of

RECORDED = Path(__file__).with_name("recorded.json")
draw = mapdeal.draw_picture

ROOM = grid_from_text("""
    ?????????????
    #######.#####
    #.....#....+?
    #..........??
    #.....#....#?
""")
STRAIGHT = OccupancyGrid(ROOM.occupancy, 0.25, (1.5, -2.0, 0.0))
EMPTY = OccupancyGrid(np.zeros((8, 12), np.int8), 0.5, (1.0, 2.0, 0.7))
ROBOT = Footprint.polygon([(0.3, 0.1), (0.3, -0.1), (-0.15, 0.0)])
POSE = (2.5, -1.2, 0.9)
ROUTE = Route("descent", False, (1.6, -1.6), (2.6, -0.6), [[1.6, -1.6], [2.1, -1.5], [2.3, -1.1]],
              0.98, 0.51, 1.0, local_minimum=(2.3, -1.1))  # fmt: skip
NODES = EMPTY.frame.xy_from_continuous_rowcol([[1, 1], [4, 9], [6, 2], [6, 2.3]]).tolist()
GRAPH = RouteGraph(
    tuple(RouteNode(k, *xy, metadata={"kind": kind, "name": "lift"})
          for k, (xy, kind) in enumerate(zip(NODES, ("goal", "door", "end", "end"), strict=True))),
    tuple(RouteEdge(9 + k, *ends) for k, ends in enumerate([(0, 1), (1, 0), (1, 2), (2, 3)])),
)  # fmt: skip
PATHS = [np.array([[1.6, -1.6], [2.1, -1.5], [2.3, -1.1]]), np.array([[1.6, -1.6], [3.9, -0.2]])]
SPEEDS = grid_from_text("?..+?\n#+#..\n?+...")
ALL_COSTS = Costmap(np.arange(256, dtype=np.uint8).reshape(8, 32), 0.25, (1.0, 2.0, 0.4))
OCCUPANCY_COSTS = Costmap(np.arange(-1, 101, dtype=np.int8).reshape(6, 17), 0.25, scale="occupancy")
RAMP = Costmap(np.tile(np.arange(100, 130, dtype=np.uint8), (9, 1)), 0.25, circumscribed_cost=115)
KINDS = np.arange(8, dtype=np.uint8).repeat(3).reshape(2, 12)
CONFLICTS = np.arange(65, dtype=np.uint8).reshape(5, 13) % 4
WALLS = comparisons.ScoredWalls(
    Frame(2, 7, 0.25, (1.0, -2.0, 0.0)),
    np.array([[0, 1, 0, 1, 1, 1, 2], [2, 2, 2, 0, 0, 0, 0]], np.uint8),
    np.array([[0, 0, 1, 1, 2, 2, 2], [1, 1, 1, 0, 0, 0, 0]], np.uint8),
    np.array([0.0, 0.625, 1.25, np.inf]), np.array([0.1, 0.25, 0.0]),
)  # fmt: skip


def large(values, seed=1):
    """A map of many cells in which single ones have some values."""
    rng = np.random.default_rng(seed)
    found = np.zeros((50, 420), np.int8)
    found[rng.integers(0, 50, 60), rng.integers(0, 420, 60)] = rng.choice(values, 60)
    found[20:24, 200:204] = -1
    return OccupancyGrid(found, 0.05, (-12345.5, 10.0, 0.0))


PART = ROOM.frame.window(-30, -40, 80, 120)
LARGE = large([100, 50, -1])
WIDER = LARGE.frame.window(-3, -5, 57, 431)


def reach_with_all():
    reach = reach_of(TWO_AREAS)
    (near, far) = reach.frame.xy_from_rowcol([[5, 3], [5, 15]]).tolist()
    goals = (GoalReach(Goal(*near, "dock"), True, 72, 1.0),
             GoalReach(Goal(*far, "Küche 2"), False, 0, 0.0), GoalReach(Goal(*near), True, 9, 1.0),
             GoalReach(Goal(900, 9, "outside"), False, 0, 0.0))  # fmt: skip
    doors = (passage_at(reach, (3, 11), (5, 11)),
             passage_at(reach, (2, 21), (2, 23), is_open=True, width=1.2, cut_off=1.0))  # fmt: skip
    return reach_of(TWO_AREAS, goals=goals, passages=doors, robot=ROBOT, start=(2.5, -1.2, 0.9))


ROOMS = "\n".join(f"#{'o' * k}{'#' * (30 - k)}\n{'#' * 31}" for k in range(2, 12))
SMALL = {"image_max": 150}
LAYERS = ["static", {"inflation": {"name": "x" * 400, "inflation_radius": 0.3}}, "inflation"]

PICTURES = {
    "map": lambda: draw(ROOM),
    "map, straight": lambda: draw(STRAIGHT, title="Küche 5 \u00d7 7 m² \u5009"),
    "map, whole": lambda: draw(LARGE, image_extent="all"),
    "map, known part": lambda: draw(on_canvas(ROOM, PART)),
    "map, a pixel per cell": lambda: draw(ROOM, image_max=0),
    "map, reduced": lambda: draw(LARGE, **SMALL),
    "map of one value": lambda: draw(EMPTY, title="x" * 300),
    "map with a route": lambda: draw(STRAIGHT, route=ROUTE),
    "map with a pose": lambda: draw(ROOM, pose=POSE),
    "map with a robot": lambda: draw(ROOM, robot=ROBOT),
    "map with rings": lambda: occupancy_image(ROOM, title="t", overlay=RingOverlay(
        np.array([[2.0, -1.0], [2.6, -0.7]]), "lost", "2 lost")),
    "map without rings": lambda: occupancy_image(
        ROOM, title="t", overlay=RingOverlay(np.empty((0, 2)), "lost", "none")),
    "map with a graph": lambda: occupancy_image(EMPTY, title="t", overlay=GraphOverlay(GRAPH)),
    "map with a graph below": lambda: occupancy_image(
        EMPTY, title="t", overlay=GraphOverlay(GRAPH, is_below=True)),
    "map with plans": lambda: occupancy_image(ROOM, title="t", overlay=PlanOverlay(
        PATHS[1:], (1.6, -1.6), [(3.9, -0.2)], [(4.1, -0.9)], [(2.3, -1.1)], [(2.5, -1.3, 0.2)])),
    "map with steps": lambda: occupancy_image(
        ROOM, title="t", overlay=StepsOverlay([ROUTE, ROUTE], PATHS[1])),
    "map with trajectories": lambda: occupancy_image(
        ROOM, title="t", overlay=TrajectoriesOverlay(PATHS)),
    "map with zones": lambda: zones_image(SPEEDS, [
        (SPEEDS, FilterInfo("speed", "percent", 100.0, -1.0)),
        (grid_from_text("#????\n?????\n??###"), FilterInfo("keepout")),
        (grid_from_text("..+..\n.....\n....."), FilterInfo("speed", "m/s", 1.0, -0.01))],
        title="t"),
    "two maps": lambda: canvas.beside_each_other([draw(ROOM), draw(STRAIGHT)]),
    "costs": lambda: draw(ALL_COSTS),
    "costs, known part": lambda: draw(mapdeal.exponential_cost(on_canvas(ROOM, PART))),
    "costs, reduced": lambda: draw(ALL_COSTS, image_max=8),
    "costs, occupancy": lambda: draw(OCCUPANCY_COSTS),
    "costs, circumscribed": lambda: draw(RAMP),
    "costs, circumscribed, a pixel per cell": lambda: draw(RAMP, image_max=0),
    "costs with all": lambda: draw(ALL_COSTS, pose=(3.0, 4.0, 0.3), robot=Footprint.circle(0.4)),
    "costs with a keepout": lambda: cost_image(
        ALL_COSTS, title="t",
        overlay=KeepoutOverlay.of(ALL_COSTS, ALL_COSTS.with_values(np.maximum(
            ALL_COSTS.cost, np.eye(8, 32, dtype=np.uint8) * 254)))),
    "field": lambda: draw(mapdeal.esdf(STRAIGHT)),
    "field, unknown is occupied": lambda: draw(mapdeal.esdf(ROOM, unknown="occupied")),
    "field, all unknown beyond": lambda: draw(mapdeal.esdf(grid_from_text("##..." + "?" * 20))),
    "field, known part": lambda: draw(mapdeal.esdf(on_canvas(ROOM, PART)), **SMALL),
    "field, reduced": lambda: draw(mapdeal.esdf(LARGE), **SMALL),
    "field on a canvas": lambda: draw(on_canvas(mapdeal.esdf(LARGE), WIDER), image_extent="all"),
    "field on a canvas, reduced": lambda: draw(on_canvas(mapdeal.esdf(LARGE), WIDER), **SMALL),
    "field without obstacles": lambda: draw(mapdeal.esdf(EMPTY)),
    "field without free cells": lambda: draw(mapdeal.esdf(grid_from_text("###"))),
    "potential": lambda: draw(mapdeal.potential(ROOM)),
    "potential with a goal": lambda: draw(mapdeal.potential(EMPTY, goal=(1.6, 3.5))),
    "potential, known part": lambda: draw(mapdeal.potential(on_canvas(ROOM, PART)), **SMALL),
    "potential, reduced": lambda: draw(mapdeal.potential(LARGE), **SMALL),
    "potential on a canvas": lambda: draw(on_canvas(mapdeal.potential(LARGE), WIDER)),
    "changes": lambda: difference_image(KINDS % 7, Frame(2, 12, 0.25), title="t"),
    "changes, reduced": lambda: difference_image(
        np.random.default_rng(1).choice(7, (40, 300), p=[0, 0, 0.97, 0.01, 0.01, 0, 0.01]).astype(
            np.uint8), Frame(40, 300, 0.25), title="t", image_max=100),
    "changes of methods": lambda: difference_image(
        KINDS % 7, Frame(2, 12, 0.25), title="t", only_in=("counting", "tsdf")),
    "changes of aligned maps": lambda: difference_image(
        KINDS % 7, Frame(2, 12, 0.25), title="t", style=alignment_style(("a", "b"))),
    "changes by cleaning": lambda: difference_image(
        KINDS, Frame(2, 12, 0.25), title="t", style=cleaning_style()),
    "two merged": lambda: merge_image(ROOM, CONFLICTS % 3, title="t", names=["hall", "later"]),
    "three merged": lambda: merge_image(ROOM, CONFLICTS, title="t", names=["a", "b", "c"]),
    "merged, reduced": lambda: merge_image(
        LARGE, (LARGE.occupancy == 50).astype(np.uint8) * 2, title="t", names="ab", image_max=60),
    "score": lambda: score_image(WALLS, title="t"),
    "score, reduced": lambda: score_image(
        comparisons.ScoredWalls(Frame(1, 400, 0.1), np.eye(1, 400, 6, dtype=np.uint8) + 1,
                    np.ones((1, 400), np.uint8), np.array([9.0]), np.array([])),
        title="t", image_max=200),
    "score without walls": lambda: score_image(
        comparisons.ScoredWalls(
            Frame(1, 1, 0.3), *np.zeros((2, 1, 1), np.uint8), *np.zeros((2, 0))), title="t"),
    "reach": lambda: draw(reach_of(TWO_AREAS)),
    "reach with all": lambda: draw(reach_with_all(), pose=(3.0, 0.0, 0.4)),
    "reach with all, reduced": lambda: reach_image(reach_with_all(), title="t", image_max=12),
    "reach, known part": lambda: draw(
        mapdeal.reach(on_canvas(ROOM, PART), start=(2.0, -1.5), radius=0.1)),
    "reach of many rooms": lambda: draw(reach_of(ROOMS), image_extent="all"),
    "reach of unknown cells": lambda: draw(reach_of("..u.\n-o:#", through_unknown=True)),
    **{f"curve, {name}": lambda name=name: draw(curve_of(name)) for name in CURVES},
    "curve of layers": lambda: draw(mapdeal.cost_curve(0.05, model="layers", layers=LAYERS)),
    "curve beyond all bounds": lambda: draw(mapdeal.cost_curve(
        0.05, inscribed_radius=1e300, inflation_radius=1e300, cost_scaling_factor=1e300)),
    "curve of tiny cells": lambda: draw(mapdeal.cost_curve(1e-6)),
}  # fmt: skip


def boxes(size):
    """Return a font whose letters all have one width."""
    return SimpleNamespace(
        getlength=lambda text: len(text) * size * 0.55,
        getmetrics=lambda: (size, size // 4),
        getbbox=lambda *_, **__: (0, -(size * 7 // 10), 0, 0),
    )


@pytest.fixture
def texts(monkeypatch):
    """Texts with their places, in boxes in place of letters."""
    written = []

    def write(pen, x, baseline, text, size):
        written.append([text, x, baseline])
        height, width = canvas.capital_height(size), canvas.text_width(text, size)
        rows, cols = slice(max(baseline - height, 0), baseline), slice(max(x, 0), x + width)
        pen.sheet[rows, cols] = np.minimum(pen.sheet[rows, cols], canvas.BLACK)

    monkeypatch.setattr(canvas, "_font", boxes)
    monkeypatch.setattr(canvas, "_has", str.isascii)
    monkeypatch.setattr(canvas.Pen, "write", write)
    canvas.text_width.cache_clear()
    yield written
    canvas.text_width.cache_clear()


@pytest.mark.parametrize("name", PICTURES)
def test_a_picture_is_as_it_was_recorded(name, texts):
    picture = PICTURES[name]()
    pixels = picture.palette[picture.indices] if hasattr(picture, "indices") else picture.rgb()
    digest = hashlib.sha256(np.ascontiguousarray(pixels)).hexdigest()
    found = {"size": list(pixels.shape[1::-1]), "pixels": digest, "texts": texts}
    recorded = json.loads(RECORDED.read_text()) if RECORDED.exists() else {}
    if "MAPDEAL_RECORD" in os.environ:
        lines = (f"{json.dumps(picture_name)}: {json.dumps(known)}"
                 for picture_name, known in sorted({**recorded, name: found}.items()))  # fmt: skip
        RECORDED.write_text("{\n" + ",\n".join(lines) + "\n}\n")
    else:
        assert found == recorded[name]


def test_every_recorded_picture_is_drawn():
    assert set(json.loads(RECORDED.read_text())) == set(PICTURES)
