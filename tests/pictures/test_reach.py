import itertools
import math

import numpy as np
import pytest

from drawn import cells
from mapdeal import Footprint
from mapdeal.grid.reach import Goal, GoalReach, Passage, Reach
from mapdeal.pictures import colours
from mapdeal.pictures.canvas import sheet
from mapdeal.pictures.colours import _oklab_from_rgb
from mapdeal.pictures.overlay import PoseOverlay, Raster, Surface
from mapdeal.pictures.reach import Captions, reach_image

RESOLUTION, ORIGIN = 0.25, (1.5, -2.0, 0.4)


@pytest.fixture
def asked(monkeypatch):
    """What the picture asked of the sheet, and the boxes of all texts on the map."""
    seen = {"boxes": []}
    free_box = Captions._free_box

    def record(pixels, palette, **rest):
        image = sheet(pixels, palette, **rest)
        seen.update(rest, pixels=pixels, palette=image.palette)
        return image

    def note(own, *arguments):
        found = free_box(own, *arguments)
        seen["boxes"].append(found and found[0])
        return found

    monkeypatch.setattr("mapdeal.pictures.canvas.sheet", record)
    monkeypatch.setattr(Captions, "_free_box", note)
    return seen


def legend(seen):
    return {
        swatch.label: tuple(seen["palette"][swatch.index].tolist()) for swatch in seen["swatches"]
    }


def reach_of(text, **rest):
    """Return what a robot reaches of a drawing.

    # obstacle, ? unknown, . reached, - reached without room to turn, : no room, o out of reach.
    """
    drawn = np.array([list(line.strip()) for line in text.strip().splitlines()])[::-1]
    occupancy = cells(
        "\n".join("".join(c if c in "#?" else "." for c in row) for row in drawn[::-1])
    )
    reachable = np.isin(drawn, list(".-")).astype(np.uint8)
    headings = np.where(drawn == "-", 5, np.where(np.isin(drawn, list(".o")), 72, 0))
    nothing = np.zeros(drawn.shape, np.float32)
    parameters = {"resolution": RESOLUTION, "origin": ORIGIN, "start": (1.6, -1.8), **rest}
    return Reach(reachable, headings.astype(np.uint8), nothing, nothing, occupancy, **parameters)


TWO_AREAS = """
    ?????????????????????????
    #########################
    #........::#ooooooooooo:#
    #........::#ooooooooooo:#
    #-------.:::::ooooooooo:#
    #........::#ooooooooooo:#
    #........::###########:##
    #........::#oo#::oooo#..#
    #########################
"""


def at(seen, reach, row, col):
    """Return the colour in the middle of a cell."""
    step = seen["pixels"].shape[0] // reach.shape[0]
    index = seen["pixels"][row * step + step // 2, col * step + step // 2]
    return tuple(seen["palette"][index].tolist())


def test_each_kind_of_cell_has_its_colour(asked):
    reach = reach_of(TWO_AREAS, start=(9.0, 9.0))
    reach_image(reach, title="t")
    one, other, third = colours.CUT_OFF_AREAS[:3]
    for row, col, expected in (
        (5, 3, colours.REACHABLE),
        (4, 3, colours.NO_TURN),
        (5, 9, colours.TOO_NARROW),
        (5, 15, one),
        (4, 20, one),
        (1, 18, other),
        (1, 12, third),
        (0, 4, (0, 0, 0)),
        (8, 4, colours.RVIZ_UNKNOWN),
    ):
        assert at(asked, reach, row, col) == expected
    area = RESOLUTION**2
    assert legend(asked) == {
        f"reachable, room to turn {43 * area:.3g} m2": colours.REACHABLE,
        f"reachable, no room to turn {7 * area:.3g} m2": colours.NO_TURN,
        f"cut off {42 * area:.3g} m2": one,
        f"cut off {4 * area:.3g} m2": other,
        f"cut off {2 * area:.3g} m2": third,
        f"no room for the robot {22 * area:.3g} m2": colours.TOO_NARROW,
        "obstacle": (0, 0, 0),
        "unknown": colours.RVIZ_UNKNOWN,
        "start": colours.REACH_START,
    }
    told = f"reaches {50 * area:.3g} of {98 * area:.3g} m2"
    assert asked["subtitle"].startswith(told)


def test_only_the_largest_areas_have_their_own_colours(asked):
    rooms = [f"#{'o' * k}{'#' * (30 - k)}" for k in range(2, 12)]
    reach = reach_of("\n".join(f"{room}\n{'#' * 31}" for room in rooms), start=(90.0, 9.0))
    reach_image(reach, title="t")
    cut_off = [label for label in legend(asked) if "cut" in label]
    area = RESOLUTION**2
    assert cut_off == [
        *(f"cut off {k * area:.3g} m2" for k in range(11, 5, -1)),
        f"smaller cut-off areas {(2 + 3 + 4 + 5) * area:.3g} m2",
    ]
    assert at(asked, reach, 1, 2) == colours.CUT_OFF_AREAS[0]
    assert at(asked, reach, 19, 2) == colours.CUT_OFF


def test_unknown_cells_that_are_reached_look_so(asked):
    reach = reach_of("....\n....", through_unknown=True, start=(9.0, 9.0))
    occupancy = reach.occupancy.copy()
    occupancy[1, 2] = -1
    reach = Reach(reach.reachable, reach.headings, reach.clearance, reach.widest, occupancy,
                  RESOLUTION, ORIGIN, (9.0, 9.0), through_unknown=True)  # fmt: skip
    reach_image(reach, title="t")
    assert at(asked, reach, 1, 2) == colours.REACHABLE_UNKNOWN
    assert at(asked, reach, 0, 2) == colours.REACHABLE
    assert "reachable, unknown 0.0625 m2" in legend(asked)


def passage_at(reach, first, second, *, width=0.474, is_open=False, cut_off=3.0):
    ends = [tuple(end) for end in reach.frame.xy_from_rowcol([first, second]).tolist()]
    x, y = np.mean(ends, axis=0)
    return Passage(x, y, width, cut_off, is_open, (ends[0], ends[1]))


def with_marks(reach, **rest):
    return Reach(
        reach.reachable, reach.headings, reach.clearance, reach.widest, reach.occupancy,
        **{"resolution": RESOLUTION, "origin": ORIGIN, "start": (90.0, 9.0), **rest},
    )  # fmt: skip


@pytest.mark.parametrize("is_open", [False, True])
def test_a_bar_lies_across_its_door_and_its_width_stands_beside_it(asked, monkeypatch, is_open):
    texts = []
    write = Captions.write
    monkeypatch.setattr(
        Captions,
        "write",
        lambda own, text, *a, **k: (texts.append(text), write(own, text, *a, **k)),
    )
    reach = reach_of(TWO_AREAS)
    reach = with_marks(reach, passages=(passage_at(reach, (3, 11), (5, 11), is_open=is_open),))
    reach_image(reach, title="t")
    colour = colours.TIGHT_PASSAGE if is_open else colours.CLOSED_PASSAGE
    assert at(asked, reach, 4, 11) == colour
    step = asked["pixels"].shape[0] // reach.shape[0]
    bar = np.argwhere((asked["palette"][asked["pixels"]] == colour).all(axis=2)) / step - 0.5
    left, bottom, right, top = np.array(asked["boxes"][0]) / step - 0.5
    in_box = (bar >= (bottom - 1e-9, left - 1e-9)) & (bar <= (top, right))
    assert in_box.all(axis=1).any()  # the text has the colour of the bar
    bar = bar[~in_box.all(axis=1)]
    assert (bar[:, 0].min(), bar[:, 0].max()) == pytest.approx((3, 5), abs=0.25)
    assert (bar[:, 1].min(), bar[:, 1].max()) == pytest.approx((11, 11), abs=0.25)
    assert texts == ["47 cm"]
    assert abs((left + right) / 2 - 11) < 4
    assert abs((bottom + top) / 2 - 4) < 2
    assert ("open, but tight" if is_open else "closed passage") in legend(asked)
    assert ("1 tight passage" if is_open else "1 closed passage") in asked["subtitle"]


@pytest.mark.parametrize(("shape", "image_max"), [((9, 25), 2048), ((90, 250), 150)])
def test_texts_lie_on_the_map_and_not_over_each_other_or_a_bar(asked, shape, image_max):
    reach = reach_of("\n".join(["." * shape[1]] * shape[0]))
    rng = np.random.default_rng(3)
    cells_rowcol = (rng.random((40, 2)) * shape).astype(int).tolist()
    doors = tuple(
        passage_at(reach, cell, (cell[0] + 1, cell[1] + 2), cut_off=k)
        for k, cell in enumerate(cells_rowcol[:20])
    )
    goals = tuple(
        GoalReach(Goal(x, y, name="g" * k), bool(k % 2), 0, 0.0)
        for k, (x, y) in enumerate(reach.frame.xy_from_rowcol(cells_rowcol[20:]).tolist())
    )
    reach = with_marks(reach, passages=doors, goals=goals)
    reach_image(reach, title="t", image_max=image_max)
    boxes = [box for box in asked["boxes"] if box]
    assert len(asked["boxes"]) == 40
    assert len(boxes) >= 1
    height, width = asked["pixels"].shape
    for left, bottom, right, top in boxes:
        assert 0 <= left < right <= width
        assert 0 <= bottom < top <= height
    for one, other in itertools.combinations(boxes, 2):
        assert one[0] >= other[2] or other[0] >= one[2] or one[1] >= other[3] or other[1] >= one[3]
    raster = Raster.fitting(reach.shape, image_max)
    for door in doors:
        on = Surface(np.empty(reach.shape), reach.frame, raster)
        column, row = on.places([(door.x, door.y)])[0]
        assert not any(b[0] <= column <= b[2] and b[1] <= row <= b[3] for b in boxes)


@pytest.mark.parametrize("start", [(4.0, 1.0, 1.1), (4.0, 1.0)])
@pytest.mark.parametrize(
    "robot", [Footprint.circle(0.9), Footprint.polygon([(1.2, 0.5), (1.2, -0.5), (-0.8, 0.0)])]
)
def test_the_robot_s_outline_is_true_to_scale(asked, robot, start):
    reach = reach_of("\n".join(["." * 60] * 40))
    reach = with_marks(reach, robot=robot, start=start)
    reach_image(reach, title="t")
    marked = np.argwhere((asked["palette"][asked["pixels"]] == colours.ROBOT_OUTLINE).all(axis=2))
    step = asked["pixels"].shape[0] // 40
    drawn = reach.frame.xy_from_continuous_rowcol((marked + 0.5) / step) - start[:2]
    yaw = start[2] if len(start) > 2 else 0.0
    ahead = drawn @ [math.cos(yaw), math.sin(yaw)]
    aside = drawn @ [-math.sin(yaw), math.cos(yaw)]
    pixel = RESOLUTION / step
    if robot.vertices:
        assert (ahead.min(), ahead.max()) == pytest.approx((-0.8, 1.2), abs=3 * pixel)
        assert (aside.min(), aside.max()) == pytest.approx((-0.5, 0.5), abs=3 * pixel)
    else:
        assert np.hypot(ahead, aside) == pytest.approx(0.9, abs=3 * pixel)
    assert legend(asked)["robot, to scale"] == colours.ROBOT_OUTLINE


def test_goals_are_dots_that_say_whether_they_are_reached(asked):
    reach = reach_of("\n".join(["." * 60] * 40))
    places = reach.frame.xy_from_rowcol([[10, 10], [30, 40]]).tolist()
    goals = tuple(
        GoalReach(Goal(*place), reached, 0, 0.0)
        for place, reached in zip(places, (True, False), strict=True)
    )
    reach_image(with_marks(reach, goals=goals), title="t")
    shown = asked["palette"][asked["pixels"]]
    step = asked["pixels"].shape[0] // 40
    for colour, cell in ((colours.GOAL_REACHED, (10, 10)), (colours.GOAL_MISSED, (30, 40))):
        dot = np.argwhere((shown == colour).all(axis=2)) / step - 0.5
        assert dot.mean(axis=0) == pytest.approx(cell, abs=0.15)
    assert at(asked, reach, 30, 40) == (255, 255, 255)  # the cross of a goal that is missed
    assert asked["boxes"] == []


def test_an_obstacle_shows_where_cells_share_a_pixel_and_then_what_is_cut_off(asked):
    drawn = np.full((40, 400), ".")
    drawn[10, 100], drawn[20, 200], drawn[20, 201], drawn[30, 300] = "#", "o", ":", ":"
    reach = reach_of("\n".join("".join(row) for row in drawn[::-1]), start=(900.0, 9.0))
    reach_image(reach, title="t", image_max=200)
    shown = asked["palette"][asked["pixels"]]
    assert tuple(shown[5, 50]) == (0, 0, 0)
    assert tuple(shown[10, 100]) == colours.CUT_OFF
    assert tuple(shown[15, 150]) == colours.REACHABLE


@pytest.mark.parametrize(
    "drawing", [".", "#", "?", "o", ".o:\n#?-", "." * 300, "\n".join("o" * 90)]
)
def test_every_map_has_a_picture(drawing):
    reach = reach_of(drawing)
    goals = (GoalReach(Goal(1.6, -1.9, "kitchen, 2nd floor"), True, 72, 1.0),)
    passages = (passage_at(reach, (0, 0), (0, 0)), passage_at(reach, (-3, 0), (5, 900)))
    reach = with_marks(
        reach, goals=goals, passages=passages, robot=Footprint.circle(3.0), start=(1.6, -1.9, 2.0)
    )
    for image_max in (2048, 0, 50):
        image = reach_image(
            reach, title="x" * 300, image_max=image_max, overlay=PoseOverlay((2.0, -1.6, 0.7))
        )
        assert image.indices.size > 100
        assert image.palette.shape == (256, 3)


def test_an_overlay_is_drawn_over_all(asked):
    reach = reach_of("\n".join(["." * 60] * 40), start=(90.0, 9.0))
    place = reach.frame.xy_from_rowcol([[20, 30]])[0]
    overlay = PoseOverlay((*place, 0.4))
    reach_image(reach, title="t", overlay=overlay)
    assert at(asked, reach, 20, 30) == colours.ROBOT
    assert asked["subtitle"].endswith(overlay.text)
    assert legend(asked)["robot"] == colours.ROBOT


# Machado, Oliveira, Fernandes 2009, severity 1: how people without one kind of cones see.
SEEN_WITHOUT = {
    "none": np.eye(3),
    "long": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216],
             [-0.003882, -0.048116, 1.051998]],
    "medium": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413],
               [-0.011820, 0.042940, 0.968881]],
    "short": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602],
              [0.004733, 0.691367, 0.303900]],
}  # fmt: skip


@pytest.mark.parametrize("cones", list(SEEN_WITHOUT))
def test_what_is_reached_is_told_from_what_is_not_by_everybody(cones):
    areas = np.array([
        colours.REACHABLE, colours.CUT_OFF, *colours.CUT_OFF_AREAS, colours.TOO_NARROW,
        colours.RVIZ_UNKNOWN,
    ]) / 255  # fmt: skip
    linear = np.where(areas <= 0.04045, areas / 12.92, ((areas + 0.055) / 1.055) ** 2.4)
    seen = np.clip(linear @ np.transpose(SEEN_WITHOUT[cones]), 0, 1)
    seen = np.where(seen <= 0.0031308, 12.92 * seen, 1.055 * seen ** (1 / 2.4) - 0.055)
    lab = _oklab_from_rgb(seen)
    assert np.linalg.norm(lab[1:] - lab[0], axis=1).min() > 0.075
    apart = [np.linalg.norm(a - b) for a, b in itertools.combinations(lab[2:8], 2)]
    assert min(apart) > 0.05
