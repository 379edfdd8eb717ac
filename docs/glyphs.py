"""Make the outlines of the letters in pictures.

Run it as ``python docs/glyphs.py aileron-latin-400-normal.woff``; the file is in the npm package
``@fontsource/aileron`` 5.3.0. Needs fonttools, which comes with matplotlib (in the extra ``dev``).
Writes ``src/mapdeal/render/glyphs.npz``; `mapdeal.render.glyphs` says what is in it.
"""

from __future__ import annotations

import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from fontTools.pens.basePen import BasePen
from fontTools.ttLib import TTFont

OUTPUT = Path(__file__).parents[1] / "src" / "mapdeal" / "render" / "glyphs.npz"

UNITS = 2048  # per em, as in the font
CHARACTERS = [
    *map(chr, range(0x20, 0x7F)),
    *map(chr, range(0xA1, 0x100)),
    *"\u0152\u0153\u0178\u2013\u2014\u2018\u2019\u201c\u201d\u201e\u2022\u2026\u20ac\u2122",
]
SUPERSCRIPTS = {"\u00b9": "1", "\u00b2": "2", "\u00b3": "3"}
MINUS, MINUS_LIKE = "\u2212", "\u2013"
REPLACEMENT = "\ufffd"

Point = tuple[float, float]
Contour = list[Point]


class OutlinePen(BasePen):
    """Collects contours as points on and off the curve by turns; a line has its start as both."""

    def __init__(self, glyphs: Any) -> None:
        super().__init__(glyphs)
        self.contours: list[Contour] = []

    def _moveTo(self, pt: Point) -> None:  # noqa: N802
        self.contours.append([pt])

    def _lineTo(self, pt: Point) -> None:  # noqa: N802
        self.contours[-1] += [self.contours[-1][-1], pt]

    def _qCurveToOne(self, pt1: Point, pt2: Point) -> None:  # noqa: N802
        self.contours[-1] += [pt1, pt2]

    def _closePath(self) -> None:  # noqa: N802
        contour = self.contours[-1]
        if contour[-1] == contour[0]:
            contour.pop()
        else:
            contour.append(contour[-1])


def main(path: str) -> None:
    """Write the outlines of a font."""
    font = TTFont(path)
    if font["head"].unitsPerEm != UNITS:
        raise SystemExit(f"{path}: expected {UNITS} units per em")
    outlines = {c: outline(font, c) for c in CHARACTERS if ord(c) in font.getBestCmap()}
    for sign, digit in SUPERSCRIPTS.items():
        outlines[sign] = superscript(outlines[digit])
    outlines[MINUS] = outlines[MINUS_LIKE]
    outlines[REPLACEMENT] = box()

    characters = sorted(outlines)
    contours = [outlines[c][1] for c in characters]
    lengths = [len(contour) for glyph in contours for contour in glyph]
    points = np.rint([p for glyph in contours for contour in glyph for p in contour])
    np.savez_compressed(
        OUTPUT,
        characters=np.array([ord(c) for c in characters], dtype=np.uint16),
        advances=np.array([outlines[c][0] for c in characters], dtype=np.uint16),
        contours=np.array([len(glyph) for glyph in contours], dtype=np.uint8),
        lengths=np.array(lengths, dtype=np.uint16),
        steps=np.diff(points.T, axis=1, prepend=0).astype(np.int16),
    )
    print(f"{OUTPUT.name}: {len(characters)} characters, {OUTPUT.stat().st_size} bytes")


def outline(font: TTFont, character: str) -> tuple[int, list[Contour]]:
    """Return the advance of a character and its contours."""
    glyphs = font.getGlyphSet()
    glyph = glyphs[font.getBestCmap()[ord(character)]]
    pen = OutlinePen(glyphs)
    glyph.draw(pen)
    return round(glyph.width), pen.contours


def superscript(digit: tuple[int, list[Contour]]) -> tuple[int, list[Contour]]:
    """Return a small, raised digit."""
    advance, contours = digit
    raised = [[(0.6 * x, 0.6 * y + 0.28 * UNITS) for x, y in contour] for contour in contours]
    return round(0.6 * advance), raised


def box() -> tuple[int, list[Contour]]:
    """Return what stands for a character that there is no outline of."""
    outer = ring(150, 0, 1050, 1412)
    inner = ring(280, 130, 920, 1282)
    return 1200, [outer, inner[:1] + inner[:0:-1]]


def ring(left: int, bottom: int, right: int, top: int) -> Contour:
    """Return the contour of a rectangle."""
    corners = [(left, bottom), (left, top), (right, top), (right, bottom), (left, bottom)]
    return [
        point
        for (x, y), (end_x, end_y) in pairwise(corners)
        for point in ((x, y), ((x + end_x) / 2, (y + end_y) / 2))
    ]


if __name__ == "__main__":
    main(sys.argv[1])
