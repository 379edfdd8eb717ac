import itertools
import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

import mapdeal
from mapdeal import Footprint, Frame, Goal, GoalReach, OccupancyGrid, cost_curve
from mapdeal.pictures import canvas, colours
from mapdeal.pictures.canvas import Pen, capital_height, sheet, text_width, ticks_between
from mapdeal.pictures.colours import Swatch, interpolated
from mapdeal.pictures.comparisons import ScoredWalls, bins_of
from mapdeal.pictures.cost_curve import ZoneKind, end_of, zones_of
from mapdeal.pictures.overlay import Raster, Surface
from mapdeal.pictures.reach import Captions, reach_image
from pictures.samples import curve_of, passage_at, reach_of
from strategies import examples, occupancies


@examples(12)
@given(
    occupancies(), st.sampled_from(["esdf", "exponential_cost", "potential", None]),
    st.sampled_from([2048, 5, 0]), st.sampled_from(["known", "all"]),
)  # fmt: skip
def test_every_map_has_pictures(occupancy, stage, image_max, image_extent):
    grid = OccupancyGrid(occupancy, 0.25, (1.5, -2.0, 0.4))
    picture = mapdeal.draw_picture(
        getattr(mapdeal, stage)(grid) if stage else grid, title="x" * 300, image_max=image_max,
        image_extent=image_extent, pose=(2.0, -1.6, 0.7), robot=Footprint.circle(3.0),
    )  # fmt: skip
    height, width, _ = picture.rgb().shape
    assert height > 100
    assert 100 < width < 3000


@given(st.integers(1, 5000), st.integers(1, 5000), st.sampled_from([2048, 600, 50]))
def test_small_maps_grow_by_a_whole_factor_and_large_ones_fit(height, width, image_max):
    raster = Raster.fitting((height, width), image_max)
    assert min(raster.enlarge, raster.reduce) == 1
    side = max(height, width)
    shown = -(-side // raster.reduce) * raster.enlarge
    assert shown <= image_max
    if image_max >= 1200:
        assert shown >= min(side, 600)


@given(
    st.floats(-1e7, 1e7), st.integers(1, 4000),
    st.sampled_from([1e-6, 0.003, 0.05, 0.0504, 1.0, 20.0, 1e6]), st.integers(14, 40),
)  # fmt: skip
def test_coordinates_stand_where_they_belong_and_apart(start, pixels, metres_per_pixel, size):
    ticks = ticks_between(start, pixels, metres_per_pixel, size)
    for pixel, label in ticks:
        assert 0 <= pixel <= pixels
        off = abs(start + pixel * metres_per_pixel - float(label))
        assert off <= 0.51 * metres_per_pixel + 1e-6 * abs(float(label)) + 1e-9
    places = [pixel for pixel, _ in ticks]
    widest = max((len(label) for _, label in ticks), default=0)
    assert all(b - a >= 0.5 * size * widest for a, b in itertools.pairwise(places))
    if pixels > 60 * size and metres_per_pixel > 1e-3:
        assert len(ticks) >= 2


@pytest.mark.parametrize(
    ("shape", "corner"),
    [((600, 300), (-12345.5, 0.25)), ((400, 700), None), ((1000, 2000), (-1.0, 10.0))],
)
def test_no_text_of_a_sheet_covers_another(monkeypatch, shape, corner):
    texts = []
    monkeypatch.setattr(Pen, "write", lambda _, *written: texts.append(written))
    image = sheet(np.zeros(shape, np.uint8), np.full((2, 3), 200, np.uint8), title="Title",
                  subtitle="and more", metres_per_pixel=0.01, corner_xy=corner,
                  swatches=[Swatch(1, "a rather long label")] * 5)  # fmt: skip
    assert {text for _, _, text, _ in texts} >= ({"x [m]", "y [m]"} if corner else {"Title"})
    boxes = {(x, y - capital_height(size), x + text_width(text, size), y)
             for x, y, text, size in texts}  # fmt: skip
    check_apart(boxes, image.indices.shape)


def check_apart(boxes, shape):
    """Boxes left, top, right, bottom lie in a picture, and none over another."""
    for left_x, top, right, bottom in boxes:
        assert 0 <= left_x < right <= shape[1]
        assert 0 <= top < bottom <= shape[0]
    for (a, b, c, d), (e, f, g, h) in itertools.combinations(boxes, 2):
        assert a >= g or e >= c or b >= h or f >= d


@pytest.mark.parametrize(("shape", "image_max"), [((9, 25), 2048), ((90, 250), 150)])
def test_texts_on_a_map_cover_neither_each_other_nor_a_door(monkeypatch, shape, image_max):
    boxes, sizes = [], []
    free_box = Captions._free_box

    def note(own, *arguments):
        found = free_box(own, *arguments)
        boxes.append(found and found[0])
        return found

    def record(pixels, palette, **options):
        sizes.append(pixels.shape)
        return sheet(pixels, palette, **options)

    monkeypatch.setattr(Captions, "_free_box", note)
    monkeypatch.setattr(canvas, "sheet", record)
    text = "\n".join(["." * shape[1]] * shape[0])
    reach = reach_of(text)
    places = (np.random.default_rng(3).random((40, 2)) * shape).astype(int).tolist()
    doors = tuple(passage_at(reach, (row, col), (row + 1, col + 2), cut_off=k)
                  for k, (row, col) in enumerate(places[:20]))  # fmt: skip
    ends = reach.frame.xy_from_rowcol(places[20:]).tolist()
    goals = tuple(GoalReach(Goal(*end, name="g" * k), bool(k % 2), 0, 0.0)
                  for k, end in enumerate(ends))  # fmt: skip
    reach = reach_of(text, passages=doors, goals=goals)
    reach_image(reach, title="t", image_max=image_max)
    assert len(boxes) == 40
    boxes = [box for box in boxes if box]
    assert boxes
    check_apart(boxes, *sizes)
    on = Surface(np.empty(reach.shape), reach.frame, Raster.fitting(reach.shape, image_max))
    for column, row in on.places([(door.x, door.y) for door in doors]):
        assert not any(b[0] <= column <= b[2] and b[1] <= row <= b[3] for b in boxes)


def test_no_colour_hinges_on_how_a_library_rounds(monkeypatch):
    exact = []
    rint = np.rint
    monkeypatch.setattr("numpy.rint", lambda x: (exact.append(x), rint(x))[1])
    scales = (colours.COST_ANCHORS, colours.POTENTIAL_ANCHORS, colours.FREE_ANCHORS,
              colours.OBSTACLE_ANCHORS)  # fmt: skip
    for anchors, levels in itertools.product(scales, [*range(2, 121), 200]):
        interpolated(anchors, levels)
    assert min(abs(values % 1 - 0.5).min() for values in exact) > 1e-9


@pytest.mark.parametrize(("name", "between", "last"), [
    ("polygon", [
        ("collision at any heading", 0.2, (253, 253)),
        # 252 e^(-5 (sqrt(17) / 20 - 0.2)) and 252 e^(-5 (sqrt(50) / 20 - 0.2))
        ("collision at some headings", 0.36, (244, 116)),
        # sqrt(52) and 11 cells
        ("no collision, with a cost", 0.55, (112, 43)),
    ], ZoneKind.FREE),
    ("cut off", [
        ("collision at any heading", 0.3, (253, 253)),
        ("collision at any heading, no cost", 0.6, (0, 0)),
        ("collision at some headings, no cost", 0.8, (0, 0)),
    ], ZoneKind.FREE),
    ("custom inscribed radius", [
        ("collision at any heading", 0.351, (253, 253)),
        # 252 e^(-5 (sqrt(50) / 20 - 0.351)) and 252 e^(-5 (0.55 - 0.351))
        ("no collision, with a cost", 0.55, (248, 93)),
    ], ZoneKind.FREE),
    ("point", [("with a cost", 0.05, (216, 216))], ZoneKind.NO_COST),
])  # fmt: skip
def test_zones_say_what_a_distance_means_for_the_robot(name, between, last):
    curve = curve_of(name)
    *zones, beyond = zones_of(curve, end_of(curve))[1:]
    assert [(zone.kind.text, round(zone.end, 4), zone.costs) for zone in zones] == between
    assert beyond.kind == last


@pytest.mark.parametrize("lookup", ["exact", "nav2"])
@pytest.mark.parametrize("cells", range(1, 14))
def test_a_cell_at_exactly_the_inscribed_radius_is_where_its_cost_says(lookup, cells):
    radii = {"inscribed_radius": cells * 5 / 100, "circumscribed_radius": 0.9}
    curve = cost_curve(0.05, **radii, inflation_radius=1.0, lookup=lookup)
    inside, beyond = zones_of(curve, end_of(curve))[1:3]
    assert (inside.kind, beyond.kind) == (ZoneKind.COLLISION, ZoneKind.HEADING)
    assert inside.costs in ((253, 253), None)
    assert beyond.costs[0] < 253


@pytest.mark.parametrize(("cell", "top"), [(0.01, 0.5), (0.1, 0.5), (0.2, 1.0)])
def test_the_scale_ends_at_half_a_metre_for_all_maps_of_ordinary_cells(cell, top):
    none, empty = np.zeros((1, 1), np.uint8), np.empty(0)
    assert ScoredWalls(Frame(1, 1, cell), none, none, empty, empty).top == top


def test_a_histogram_has_a_bar_for_each_cell_of_distance_and_all_beyond():
    metres = np.array([0, 0.05 * math.sqrt(2), 0.05, 0.1, 0.5, 0.55, 3, math.inf])
    bins = bins_of(metres, 0.05, 0.5)
    assert [middle for middle, _ in bins] == [*(k / 20 for k in range(11)), math.inf]
    assert [round(share * len(metres)) for _, share in bins] == [1, 2, 1, *[0] * 7, 1, 3]
    assert bins_of(np.array([]), 0.05, 0.5)[0] == (0.0, 0.0)


def test_python_draws_what_the_command_writes(tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    for name, row in (("truth", 3), ("own", 5)):
        grid = OccupancyGrid(np.eye(12, 30, row, dtype=np.int8) * 100, 0.2, (1.0, 2.0, 0.0))
        mapdeal.write_map(f"{name}.yaml", grid)
    code, _, err = command("score", "own.yaml", "--truth", "truth.yaml", "--image", "o.png")
    assert (code, err) == (0, "")
    found = mapdeal.score("own.yaml", "truth.yaml")
    picture = mapdeal.draw_picture(found, image_extent="known")
    assert picture.png() == (tmp_path / "o.png").read_bytes()
    assert found._repr_png_().startswith(b"\x89PNG")
    with pytest.raises(mapdeal.ParameterError, match="nothing can be drawn over a score"):
        mapdeal.draw_picture(found, pose=(0, 0, 0))


def test_a_score_without_a_truth_has_no_picture():
    alone = mapdeal.score(OccupancyGrid([[100, 0, 0]], 0.2))
    assert alone._repr_png_() is None
    with pytest.raises(mapdeal.ParameterError, match="has no picture"):
        mapdeal.draw_picture(alone)
