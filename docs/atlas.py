"""Draw the letters of small pictures: ``python docs/atlas.py``, after a change of the outlines.

Writes ``src/mapdeal/render/atlas.bin``; `mapdeal.render.glyphs` says what is in it.
"""

from pathlib import Path

from mapdeal.render.glyphs import ATLAS_CHARACTERS, ATLAS_SIZES, drawn_glyph, packed

OUTPUT = Path(__file__).parents[1] / "src" / "mapdeal" / "render" / "atlas.bin"

if __name__ == "__main__":
    drawn = [drawn_glyph(character, size) for size in ATLAS_SIZES for character in ATLAS_CHARACTERS]
    OUTPUT.write_bytes(packed(drawn))
