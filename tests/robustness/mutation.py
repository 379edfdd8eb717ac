"""Damage to files: what makes a mutant of a good one.

All chance comes from `Dice`, which takes nothing but ``random.Random.random``: Python promises the
same numbers of it for a seed in every version, and promises that of nothing else there.
"""

import random
import re
import struct

from robustness.words import words_of

NUMBERS = words_of("numbers")
"""What may stand for a number in a text: limits of types, odd spellings, what is none."""

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


class Dice:
    """Numbers by chance, the same for a seed everywhere."""

    def __init__(self, seed):
        self._random = random.Random(seed).random

    def below(self, sides):
        """Return a whole number of at least 0, below `sides`."""
        return int(self._random() * sides)

    def one_of(self, things):
        return things[int(self._random() * len(things))]


def mutant(data, others, words, dice):
    """Return `data` with some damage.

    `others` are good files of the same kind, to take parts of; `words` are what may be put in,
    beside what is put into all kinds of files.
    """
    text = bytearray(data)
    for _ in range(dice.one_of((1, 1, 1, 2, 2, 4))):
        dice.one_of(_DAMAGES)(text, others, words, dice)
    return bytes(text)


def _damage_bytes(text, others, words, dice):
    """Change a bit, a byte, or what may be a binary number."""
    kind = dice.below(7)
    at = dice.below(len(text)) if text else 0
    if kind > 3:
        _damage_number(text, dice)
    elif not text:
        return
    elif kind == 0:
        text[at] = dice.below(256)
    elif kind == 1:
        text[at] = dice.one_of(BYTES)
    else:
        text[at] ^= 1 << dice.below(8)


def _damage_number(text, dice):
    """Put a limit, the length of the file, a neighbour, or a float where a number may be."""
    code = dice.one_of("BBHHIIQQfd")
    layout = dice.one_of("<>") + code
    size = struct.calcsize(layout)
    if len(text) < size:
        return
    at = dice.below(len(text) - size + 1)
    if code in "fd":
        value = dice.one_of(_FLOATS)
        if code == "f" and _SINGLE_LIMIT < abs(value) < float("inf"):
            value = _SINGLE_LIMIT
        struct.pack_into(layout, text, at, value)
        return
    (here,) = struct.unpack_from(layout, text, at)
    value = dice.one_of((here + dice.one_of((-1, 1)), len(text) + dice.one_of((-1, 0, 1)),
                         dice.one_of(_LIMITS[code]), dice.one_of(_LIMITS[code])))  # fmt: skip
    struct.pack_into(layout, text, at, value & (1 << 8 * size) - 1)


def _damage_parts(text, others, words, dice):
    """Put in, leave out, repeat, move, or overwrite some bytes, or go on with another file."""
    start = dice.below(len(text) + 1)
    stop = start + 1 + dice.below(dice.one_of((1, 4, 16, 60)))  # most parts are short
    at = dice.below(len(text) + 1)
    part = text[start:stop]
    match dice.below(9):
        case 0:
            text[at:at] = bytes(dice.below(256) for _ in range(1 + dice.below(8)))
        case 1:
            text[at:at] = bytes([dice.one_of(BYTES)]) * dice.one_of((1, 1, 1, 2, 3, 40))
        case 2:
            text[at:at] = dice.one_of(words) if words else b"\n"
        case 3:
            del text[start:stop]
        case 4:
            del text[at:]
        case 5:
            text[start:start] = part * dice.one_of((1, 1, 1, 2, 30))
        case 6:
            del text[start:stop]
            at = dice.below(len(text) + 1)
            text[at:at] = part
        case 7:
            text[at : at + len(part)] = part
        case 8:
            other = dice.one_of(others)
            text[at:] = other[at if dice.below(2) else dice.below(len(other) + 1) :]


def _damage_words(text, others, words, dice):
    """Put other numbers into a text, something else for what brackets hold, or repeat a word."""
    pattern = dice.one_of((_NUMBER, _NUMBER, _NUMBER, _OPENING, _OPENING, _WORD))
    found = pattern.search(text, dice.below(len(text) + 1)) or pattern.search(text)
    if found is None:
        return
    if pattern is _NUMBER:
        text[found.start() : found.end()] = dice.one_of(NUMBERS)
    elif pattern is _WORD:
        between = dice.one_of((b" ", b",", b", ", b"", b"\n"))
        text[found.end() : found.end()] = (between + found[0]) * dice.one_of((1, 1, 2, 40))
    else:
        other = dice.one_of(words) if words and dice.below(2) else dice.one_of(NUMBERS)
        text[found.start() : _end_of_group(text, found)] = dice.one_of(
            (other, other, b"[]", b"{}", b'""', b"[" + other + b"]")
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


def _damage_lines(text, others, words, dice):
    """Swap, drop or repeat lines, or end them otherwise."""
    lines = text.split(b"\n")
    one, other = dice.below(len(lines)), dice.below(len(lines))
    match dice.below(4):
        case 0:
            lines[one], lines[other] = lines[other], lines[one]
        case 1:
            del lines[one]
        case 2:
            lines[one:one] = [lines[one]] * dice.one_of((1, 1, 2, 20))
        case 3:
            lines = text.replace(b"\n", dice.one_of((b"\r\n", b"\r", b"\n\n", b" \n"))).split(b"\n")
    text[:] = b"\n".join(lines)


_DAMAGES = (*[_damage_bytes] * 7, *[_damage_parts] * 9, *[_damage_words] * 6, *[_damage_lines] * 4)
