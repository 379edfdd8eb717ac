import itertools
import math
import string

import numpy as np
import pytest
from hypothesis import given, strategies as st

from drawn import grid_from_text
from mapdeal import esdf
from mapdeal.pictures import canvas, colours, styles
from mapdeal.pictures.colours import Scale, _oklab_from_rgb
from mapdeal.pictures.styles import FieldEnds, field_style

LENGTHS = st.floats(0, 1000).map(lambda x: 0.0 if x < 0.01 else x)
GRID = grid_from_text("#..?\n....\n..##", 0.25, (1.5, -2.0, 0.3))
SIZES = (14, 15, 16, 18, 20, 27, 50)  # of the text, and of titles
BOX = "\ufffd"


def level_of(scale, value):
    step = (scale.high - scale.low) / scale.levels
    return scale.first + min(max(math.floor((value - scale.low) / step), 0), scale.levels - 1)


@given(LENGTHS, LENGTHS)
def test_a_field_s_scale_goes_evenly_through_zero(far, deep):
    style = field_style(esdf(GRID), FieldEnds(far, deep, far, -deep))
    scale = style.scale
    assert scale.low <= -deep * (1 - 1e-9)
    assert scale.high >= far * (1 - 1e-9)
    step = (scale.high - scale.low) / scale.levels
    below = -scale.low / step
    assert below == pytest.approx(round(below), abs=1e-6)  # zero is between two steps
    assert 1 <= round(below) < scale.levels
    for k in range(scale.levels):  # the middle of each step, on both sides of zero
        assert scale.indices(np.float32([scale.low + (k + 0.5) * step])) == [k]
    red, _, blue = style.colours[: scale.levels].astype(int).T
    assert (red[: round(below)] > blue[: round(below)]).all()
    assert (blue[round(below) + 3 :] > red[round(below) + 3 :]).all()
    assert (style.colours[scale.levels :][: scale.levels] != style.colours[: scale.levels]).any()


@given(LENGTHS, LENGTHS)
def test_a_field_s_labels_stand_beside_their_colours_and_apart(far, deep):
    style = field_style(esdf(GRID), FieldEnds(far, deep, far, -deep))
    scale, bar = style.scale, style.bar
    assert all(b - a >= 0.079 for a, b in itertools.pairwise([place for place, _ in bar.ticks]))
    assert "0" in [label for _, label in bar.ticks]
    for place, label in bar.ticks:
        shown = bar.indices[min(int(place * len(bar.indices)), len(bar.indices) - 1)]
        value = float(label)
        step = (scale.high - scale.low) / scale.levels
        assert abs(shown - level_of(scale, value)) <= 1 + 0.006 * abs(value) / step  # three digits


@given(
    st.floats(-1e3, 1e3), st.floats(0.01, 1e3),
    st.lists(st.floats(-2e3, 2e3, width=32), min_size=1, max_size=20),
)  # fmt: skip
def test_a_scale_counts_even_steps_and_ends_where_it_ends(low, length, values):
    scale = Scale(low, low + length, 7, 100)
    found = scale.indices(np.float32(values)).tolist()
    expected = [level_of(scale, value) for value in values]
    assert all(abs(a - b) <= 1 for a, b in zip(found, expected, strict=True))
    assert scale.indices(np.float32([-np.inf, np.inf])).tolist() == [7, 106]


@pytest.mark.parametrize(("low", "high", "expected"), [
    (-0.3, 2.1, [0, 0.5, 1, 1.5, 2]), (0, 10, [0, 2, 4, 6, 8, 10]), (7.9, 8.1, [7.9, 8, 8.1]),
])  # fmt: skip
def test_ticks_are_round(low, high, expected):
    ticks = styles.ticks_of(low, high, 6)
    assert set(expected) <= set(ticks)
    assert all(low - 1e-9 <= tick <= high + 1e-9 for tick in ticks)


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
def test_reachable_areas_are_distinct_for_colour_blind_people(cones):
    areas = np.array([
        colours.REACHABLE, colours.CUT_OFF, *colours.CUT_OFF_AREAS, colours.TOO_NARROW,
        colours.RVIZ_UNKNOWN,
    ]) / 255  # fmt: skip
    linear = np.where(areas <= 0.04045, areas / 12.92, ((areas + 0.055) / 1.055) ** 2.4)
    perceived = np.clip(linear @ np.transpose(SEEN_WITHOUT[cones]), 0, 1)
    curved = 1.055 * perceived ** (1 / 2.4) - 0.055
    lab = _oklab_from_rgb(np.where(perceived <= 0.0031308, 12.92 * perceived, curved))
    assert np.linalg.norm(lab[1:] - lab[0], axis=1).min() > 0.075
    apart = [np.linalg.norm(a - b) for a, b in itertools.combinations(lab[2:8], 2)]
    assert min(apart) > 0.05


def inked(text, size):
    """How dark each pixel is of a text whose pen begins at (20, 60), 0 to 15."""
    pen = canvas.Pen(size)
    pen.open(40 + canvas.text_width(text, size), 80)
    pen.write(20, 60, text, size)
    return canvas.WHITE - pen.sheet


def test_letters_have_the_shape_that_a_font_gives_them():
    ell = inked("L", 40)
    rows, cols = np.nonzero(ell)
    ell = ell[rows.min() : rows.max() + 1, cols.min() : cols.max() + 1]
    height, width = ell.shape
    assert (ell[: height // 2, width // 2 :] == 0).all()  # nothing right of the stem
    assert ell[-2, 2:-3].min() >= 11  # the foot
    assert ell[:, 1:4].sum(axis=1).min() >= 2 * 15


@pytest.mark.parametrize("size", SIZES)
def test_capitals_and_digits_stand_on_the_baseline_and_are_equally_tall(size):
    for character in "HEL147":
        rows = np.flatnonzero((inked(character, size) > 7).any(axis=1))
        assert rows[-1] == 59
        assert 59 - canvas.capital_height(size) <= rows[0] <= 60 - canvas.capital_height(size)
    assert 0.64 * size <= canvas.capital_height(size) <= 0.76 * size


@pytest.mark.parametrize("size", SIZES)
def test_a_text_is_no_wider_than_it_is_said_to_be(size):
    for text in ("-10.5", "office: 0.05 m each", "MWj"):
        cols = np.flatnonzero(inked(text, size).any(axis=0))
        assert cols[0] >= 20 - size // 10
        assert cols[-1] <= 20 + canvas.text_width(text, size)
        assert cols[-1] >= 20 + 0.9 * canvas.text_width(text, size) - 3
    assert canvas.text_width("", size) == 0


def test_every_character_of_ascii_is_drawn_and_no_box():
    box = inked(BOX, 20)
    assert box.any()
    for character in string.printable:
        if character.isprintable() and character != " ":
            drawn = inked(character, 20)
            assert drawn.any(), character
            assert drawn.shape != box.shape or (drawn != box).any(), character
            assert canvas.printable(character) == character


@pytest.mark.parametrize(("text", "shown"), [
    ("n\u00b0 2 \u00b1 1", "n\u00b0 2 \u00b1 1"),
    ("K\u00fcche, \u00c9t\u00e9, Gda\u0144sk, u\u0308", "Kuche, Ete, Gdansk, u"),
    ("Stra\u00dfe 5 \u00d7 7 m\u00b2", "Strasse 5 x 7 m2"),
    ("\u22121 \u2013 2", "-1 - 2"),
    ("\u5009 A", f"{BOX} A"),
    ("a\nb\x00", f"a{BOX}b{BOX}"),
    ("\U0001f600", BOX),
])  # fmt: skip
def test_characters_that_the_font_lacks_become_like_ones_or_boxes(text, shown):
    assert canvas.printable(text) == shown


def test_text_takes_only_its_greys_and_leaves_darker_ones():
    pen = canvas.Pen(20)
    pen.open(90, 40)
    pen.sheet[:, 30:50] = 3
    pen.text(5, 3, "HHHHHH", limit=80)
    assert (pen.sheet[:, 30:50] == 3).all()
    outside = np.delete(pen.sheet, np.s_[30:50], axis=1)
    assert canvas.MOST_COLOURS <= outside.min() < outside.max() == canvas.WHITE


@pytest.mark.parametrize("place", [(5, 3), (-8, -6), (40, 3), (3, 40), (-300, 0), (0, -300)])
def test_a_text_at_the_edge_of_a_sheet_is_cut(place):
    pen, complete = canvas.Pen(20), canvas.Pen(20)
    pen.open(12, 12)
    pen.text(*place, "Hg", limit=50)
    assert pen.sheet.shape == (12, 12)
    complete.open(700, 700)
    complete.text(place[0] + 310, place[1] + 310, "Hg", limit=50)
    assert np.array_equal(pen.sheet, complete.sheet[310:322, 310:322])


def test_the_bar_of_changes_leads_from_the_largest_fall_to_the_largest_rise():
    style = styles.cost_change_style()
    words = [style.labels[index].split() for index in style.bar.indices]
    changes = [{"fell": -1, "rose": 1, "equal": 0}[kind] * int([0, *n][-1]) for kind, *n in words]
    assert changes == sorted(set(changes))
    assert (changes[0], changes[-1]) == (-254, 254)
