import subprocess
import sys

import numpy as np
import pytest

from mapdeal.render.glyphs import (
    ATLAS_CHARACTERS,
    ATLAS_SIZES,
    REPLACEMENT,
    SHADES,
    advance,
    ascent,
    capital_height,
    drawn_glyph,
    glyph,
    middle,
    printable,
    text_width,
)
from mapdeal.render.pen import Pen

SIZES = range(14, 51)  # of the text, and of titles


def test_letters_have_the_shape_that_the_font_gives_them():
    ell = glyph("L", 40).shades
    height, width = ell.shape
    assert (ell[: height // 2, width // 2 :] == 0).all()  # nothing right of the stem
    assert ell[-2, 2:-3].min() >= 11  # the foot
    assert ell[:, 1:4].sum(axis=1).min() >= 2 * (SHADES - 1)
    dot = glyph(".", 50).shades
    assert dot[2:-2, 2:-2].min() == SHADES - 1


@pytest.mark.parametrize("size", SIZES)
def test_capitals_and_digits_stand_on_the_baseline_and_are_equally_tall(size):
    for character in "HEL1470":
        drawn = glyph(character, size)
        assert drawn.top == capital_height(size)
        inked = np.flatnonzero(drawn.shades.any(axis=1))
        assert inked[0] == 0
        assert inked[-1] == capital_height(size) - 1
    assert 0.66 * size <= capital_height(size) <= 0.73 * size


@pytest.mark.parametrize("size", [14, 23, 40, 50])
def test_strokes_are_as_thick_as_the_font_s(size):
    stem = glyph("l", size).shades[size // 4].sum() / (SHADES - 1)
    assert stem == pytest.approx(0.08 * size, abs=0.35)
    bar = glyph("\u2013", size).shades
    assert bar[:, bar.shape[1] // 2].sum() / (SHADES - 1) == pytest.approx(0.055 * size, abs=0.35)


def test_the_hole_of_a_letter_is_empty():
    for character in "oO0D" + REPLACEMENT:
        shades = glyph(character, 40).shades
        height, width = shades.shape
        assert shades[height // 2, width // 2] == 0
        assert shades[height // 2].max() == SHADES - 1


def test_the_metrics_of_a_line():
    assert [ascent(size) for size in (14, 20, 40, 50)] == [14, 20, 39, 49]
    assert [middle(size) for size in (14, 20, 40, 50)] == [5, 7, 14, 18]
    assert [advance(c, 20) for c in " .0mW"] == [4, 4, 12, 17, 19]
    assert text_width("0.5 m", 20) == 12 + 4 + 12 + 4 + 17
    assert text_width("", 20) == 0
    assert glyph(" ", 20).shades.size == 0


def test_the_letters_of_western_europe_have_outlines_of_their_own():
    for text in (
        "K\u00fcche",
        "\u00c9t\u00e9 n\u00b0 2",
        "5 \u00d7 7 m\u00b2",
        "\u2026",
        "\u22121",
    ):
        assert printable(text) == text
    assert printable("u\u0308") == "\u00fc"
    assert not np.array_equal(glyph("\u00fc", 20).shades, glyph("u", 20).shades)
    two, squared = glyph("2", 40), glyph("\u00b2", 40)
    assert squared.shades.shape[0] < 0.75 * two.shades.shape[0]
    assert squared.top >= two.top - 1


def test_other_scripts_lose_accents_or_become_boxes():
    assert printable("Gda\u0144sk") == "Gdansk"
    assert printable("\u5009 A") == f"{REPLACEMENT} A"
    assert printable("a\nb\x00") == f"a{REPLACEMENT}b{REPLACEMENT}"
    assert printable("\U0001f600") == REPLACEMENT


def test_a_text_is_written_where_it_belongs():
    pen = Pen(20)
    pen.open(60, 40)
    pen.text(5, 3, "H", limit=50)
    inked = np.argwhere(pen.sheet < 255)
    assert inked[:, 0].min() == 3 + ascent(20) - capital_height(20)
    assert inked[:, 0].max() == 3 + ascent(20) - 1
    assert inked[:, 1].min() == 5 + glyph("H", 20).left
    pen.open(60, 40)
    pen.text(5, 3, "HHHHHHHHHHHH", limit=50)
    assert np.flatnonzero((pen.sheet < 255).any(axis=0)).max() < 55
    assert (pen.sheet[3 + ascent(20) - 1, 30:55] < 255).sum() >= 4  # the dots


def test_a_letter_at_the_edge_of_a_sheet_is_cut():
    pen = Pen(20)
    pen.open(12, 12)
    pen.text(5, 3, "Hg", limit=50)
    assert pen.sheet.shape == (12, 12)


def test_pictures_need_no_other_library_s_letters_or_lines():
    code = (
        "import sys, mapdeal, numpy as np\n"
        "from mapdeal.render.layers import cost_image\n"
        "from mapdeal.render.pose import PoseOverlay\n"
        "import mapdeal.render.potential, mapdeal.render.route, mapdeal.render.difference\n"
        "import mapdeal.render.cost_curve\n"
        "costmap = mapdeal.Costmap(np.zeros((9, 9), np.uint8), 0.5)\n"
        "cost_image(costmap, title='t', overlay=PoseOverlay((1.0, 1.0, 0.0)))\n"
        "print([m for m in sys.modules if m.split('.')[0] in ('PIL', 'matplotlib', 'cv2')])"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"


@pytest.mark.parametrize("size", ATLAS_SIZES)
def test_the_atlas_holds_what_the_outlines_give(size):
    for character in ATLAS_CHARACTERS:
        stored, drawn = glyph(character, size), drawn_glyph(character, size)
        np.testing.assert_array_equal(stored.shades, drawn.shades)
        assert (stored.left, stored.top) == (drawn.left, drawn.top)
        assert stored.advance == drawn.advance == advance(character, size)
        assert printable(character) == character
