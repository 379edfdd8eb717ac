"""Damage to files: what makes a mutant of a good one, by the numbers of a ``random.Random``."""

import ast
import re
import struct
from pathlib import Path

FOLDER = Path(__file__).with_name("words")


def words_of(*formats):
    """Return the words of some formats: each is a line of its file, written as in Python."""
    lists = [(FOLDER / f"{name}.dict").read_text().splitlines() for name in formats]
    return tuple(ast.literal_eval(f"b{line}") for lines in lists for line in lines)


NUMBERS = words_of("numbers")
"""Replacements of a number in a text: limits of types, odd spellings, and other words."""

BYTES = b"\0\1\x7f\x80\xff \t\n\r\v\f\x1a\x1c\x85\xa0\xc3#,;:.-+/\\'\"[]{}()<>&*!|%@~=?_$`^019eEnxX"
"""Bytes that mean something in one format or another."""

_NUMBER = re.compile(rb"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_WORD = re.compile(rb"[^\s,;:\[\]{}]+")
_OPENING = re.compile(rb"[\[{\"'(]")
_CLOSING = {b"[": b"]", b"{": b"}", b'"': b'"', b"'": b"'", b"(": b")"}
_LIMITS = {
    code: [0, 1, 2, 7, 8, 255 & (1 << bits - 1) - 1, (1 << bits - 1) - 1, 1 << bits - 1,
           (1 << bits) - 2, (1 << bits) - 1]
    for code, bits in (("B", 8), ("H", 16), ("I", 32), ("Q", 64))
}  # fmt: skip
_FLOATS = (0.0, -0.0, 1.0, -1.0, 0.5, 1e-320, 1e-40, 1e12, 1e13, 3e38, 1e39, -1e300, 1.7e308,
           float("inf"), float("-inf"), float("nan"))  # fmt: skip
_SINGLE_LIMIT = 3e38


def mutant(data, alike, words, rng):
    """Return `data` with some damage.

    `alike` are good files of the same kind, to take parts of; `words` are texts to insert, besides
    those that are inserted into all kinds of files.
    """
    text = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 2, 4))):
        rng.choice(_DAMAGES)(text, alike, words, rng)
    return bytes(text)


def _damage_bytes(text, alike, words, rng):
    """Change a bit, a byte, or what may be a binary number."""
    kind = rng.randrange(7)
    at = rng.randrange(len(text)) if text else 0
    if kind > 3:
        _damage_number(text, rng)
    elif not text:
        return
    elif kind == 0:
        text[at] = rng.randrange(256)
    elif kind == 1:
        text[at] = rng.choice(BYTES)
    else:
        text[at] ^= 1 << rng.randrange(8)


def _damage_number(text, rng):
    """Write a limit, the length of the file, a neighbour, or a float where a number may be."""
    code = rng.choice("BBHHIIQQfd")
    layout = rng.choice("<>") + code
    size = struct.calcsize(layout)
    if len(text) < size:
        return
    at = rng.randrange(len(text) - size + 1)
    if code in "fd":
        value = rng.choice(_FLOATS)
        if code == "f" and _SINGLE_LIMIT < abs(value) < float("inf"):
            value = _SINGLE_LIMIT
        struct.pack_into(layout, text, at, value)
        return
    (here,) = struct.unpack_from(layout, text, at)
    value = rng.choice((here + rng.choice((-1, 1)), len(text) + rng.choice((-1, 0, 1)),
                         rng.choice(_LIMITS[code]), rng.choice(_LIMITS[code])))  # fmt: skip
    struct.pack_into(layout, text, at, value & (1 << 8 * size) - 1)


def _damage_parts(text, alike, words, rng):
    """Insert, leave out, repeat, move, or overwrite some bytes, or go on with another file."""
    start = rng.randrange(len(text) + 1)
    stop = start + 1 + rng.randrange(rng.choice((1, 4, 16, 60)))  # most parts are short
    at, part = rng.randrange(len(text) + 1), text[start:stop]
    match rng.randrange(9):
        case 0:
            text[at:at] = rng.randbytes(1 + rng.randrange(8))
        case 1:
            text[at:at] = bytes([rng.choice(BYTES)]) * rng.choice((1, 1, 1, 2, 3, 40))
        case 2:
            text[at:at] = rng.choice(words) if words else b"\n"
        case 3:
            del text[start:stop]
        case 4:
            del text[at:]
        case 5:
            text[start:start] = part * rng.choice((1, 1, 1, 2, 30))
        case 6:
            del text[start:stop]
            at = rng.randrange(len(text) + 1)
            text[at:at] = part
        case 7:
            text[at : at + len(part)] = part
        case 8:
            donor = rng.choice(alike)
            text[at:] = donor[at if rng.randrange(2) else rng.randrange(len(donor) + 1) :]


def _damage_words(text, alike, words, rng):
    """Replace numbers of a text or the contents of brackets, or repeat a word."""
    pattern = rng.choice((_NUMBER, _NUMBER, _NUMBER, _OPENING, _OPENING, _WORD))
    found = pattern.search(text, rng.randrange(len(text) + 1)) or pattern.search(text)
    if found is None:
        return
    if pattern is _NUMBER:
        text[found.start() : found.end()] = rng.choice(NUMBERS)
    elif pattern is _WORD:
        between = rng.choice((b" ", b",", b", ", b"", b"\n"))
        text[found.end() : found.end()] = (between + found[0]) * rng.choice((1, 1, 2, 40))
    else:
        replacement = rng.choice(words) if words and rng.randrange(2) else rng.choice(NUMBERS)
        text[found.start() : _end_of_group(text, found)] = rng.choice(
            (replacement, replacement, b"[]", b"{}", b'""', b"[" + replacement + b"]")
        )


def _end_of_group(text, opening):
    """Return where what a bracket or a quote holds ends, or the whole text."""
    start, closing = opening.start(), _CLOSING[opening[0]]
    stop = text.find(closing, start + 1) + 1 or len(text)
    if closing != opening[0]:
        while text.count(opening[0], start, stop) > text.count(closing, start, stop):
            stop = text.find(closing, stop) + 1 or len(text)
            if stop == len(text):
                break
    return stop


def _damage_lines(text, alike, words, rng):
    """Swap, drop or repeat lines, or end them otherwise."""
    lines = text.split(b"\n")
    first, second = rng.randrange(len(lines)), rng.randrange(len(lines))
    match rng.randrange(4):
        case 0:
            lines[first], lines[second] = lines[second], lines[first]
        case 1:
            del lines[first]
        case 2:
            lines[first:first] = [lines[first]] * rng.choice((1, 1, 2, 20))
        case 3:
            lines = text.replace(b"\n", rng.choice((b"\r\n", b"\r", b"\n\n", b" \n"))).split(b"\n")
    text[:] = b"\n".join(lines)


_DAMAGES = (*[_damage_bytes] * 7, *[_damage_parts] * 9, *[_damage_words] * 6, *[_damage_lines] * 4)
