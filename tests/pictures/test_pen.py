import string

import numpy as np
import pytest

from mapdeal.pictures import canvas

SIZES = (14, 15, 16, 18, 20, 27, 50)  # of the text, and of titles
BOX = "\ufffd"


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
