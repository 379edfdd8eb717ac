"""Damage to files: what makes a mutant of a good one.

All chance comes from `Dice`, which takes nothing but ``random.Random.random``: Python promises the
same numbers of it for a seed in every version, and promises that of nothing else there.
"""

import random
import re
import struct

NUMBERS = (
    b"0", b"-0", b"1", b"-1", b"2", b"3", b"7", b"8", b"9", b"15", b"16", b"100", b"101", b"127",
    b"128", b"255", b"256", b"32768", b"65535", b"65536", b"2147483647", b"2147483648",
    b"4294967295", b"4294967296", b"9223372036854775807", b"9223372036854775808", b"99999999999",
    b"-99999999999", b"1" * 40, b"7" * 400,
    b"1e5", b"1e12", b"1e13", b"1e16", b"-1e300", b"1e308", b"1.8e308",
    b"1e-320", b"1e400", b"nan", b"-nan", b"inf", b"-inf", b".inf", b".nan", b"infinity", b"0x10",
    b"010", b"1_0", b"1,5", b"0.", b".5", b"1.0.0", b"1e", b"5e-2", b"1:30", b"+1", b"--1", b"",
    b" ", b"true", b"null", b"1j", "\u0661".encode(), "\uff11".encode(), "\u00b2".encode(),
)  # fmt: skip
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


def _flip(text, others, words, dice):
    if text:
        text[dice.below(len(text))] ^= 1 << dice.below(8)


def _set(text, others, words, dice):
    if text:
        text[dice.below(len(text))] = dice.below(256)


def _set_telling(text, others, words, dice):
    if text:
        text[dice.below(len(text))] = dice.one_of(BYTES)


def _insert(text, others, words, dice):
    at = dice.below(len(text) + 1)
    text[at:at] = bytes(dice.below(256) for _ in range(1 + dice.below(8)))


def _insert_telling(text, others, words, dice):
    at = dice.below(len(text) + 1)
    text[at:at] = bytes([dice.one_of(BYTES)]) * dice.one_of((1, 1, 1, 2, 3, 40))


def _insert_word(text, others, words, dice):
    at = dice.below(len(text) + 1)
    text[at:at] = dice.one_of(words) if words else b"\n"


def _delete(text, others, words, dice):
    start, stop = _part(text, dice)
    del text[start:stop]


def _truncate(text, others, words, dice):
    del text[dice.below(len(text) + 1) :]


def _repeat(text, others, words, dice):
    start, stop = _part(text, dice)
    text[start:start] = text[start:stop] * dice.one_of((1, 1, 1, 2, 30))


def _move(text, others, words, dice):
    start, stop = _part(text, dice)
    moved = text[start:stop]
    del text[start:stop]
    at = dice.below(len(text) + 1)
    text[at:at] = moved


def _overwrite(text, others, words, dice):
    start, stop = _part(text, dice)
    at = dice.below(len(text) + 1)
    text[at : at + stop - start] = text[start:stop]


def _splice(text, others, words, dice):
    """Go on with another file, from the same place or any other."""
    other = dice.one_of(others)
    at = dice.below(len(text) + 1)
    text[at:] = other[at if dice.below(2) else dice.below(len(other) + 1) :]


def _number_in_text(text, others, words, dice):
    found = _found_near(_NUMBER, text, dice)
    if found is not None:
        text[found.start() : found.end()] = dice.one_of(NUMBERS)


def _replace_group(text, others, words, dice):
    """Put something else where a bracket and what it holds are, or a word in quotes."""
    found = _found_near(_OPENING, text, dice)
    if found is None:
        return
    start, closing = found.start(), _CLOSING[found[0]]
    stop = text.find(closing, start + 1) + 1 or len(text)
    while (
        text.count(found[0], start, stop) > text.count(closing, start, stop) and closing != found[0]
    ):
        stop = text.find(closing, stop) + 1 or len(text)
        if stop == len(text):
            break
    other = dice.one_of(words) if words and dice.below(2) else dice.one_of(NUMBERS)
    text[start:stop] = dice.one_of((other, other, b"[]", b"{}", b'""', b"[" + other + b"]"))


def _number_as_whole(text, others, words, dice):
    """Put a limit, the length of the file, or a neighbour where a whole number may be."""
    code = dice.one_of("BHIQ")
    layout = dice.one_of("<>") + code
    size = struct.calcsize(layout)
    if len(text) < size:
        return
    at = dice.below(len(text) - size + 1)
    most = (1 << 8 * size) - 1
    kind = dice.below(4)
    if kind == 0:
        (value,) = struct.unpack_from(layout, text, at)
        value += dice.one_of((-1, 1))
    elif kind == 1:
        value = len(text) + dice.one_of((-1, 0, 1))
    else:
        value = dice.one_of(_LIMITS[code])
    struct.pack_into(layout, text, at, value & most)


def _number_as_float(text, others, words, dice):
    code = dice.one_of("fd")
    value = dice.one_of(_FLOATS)
    if code == "f" and _SINGLE_LIMIT < abs(value) < float("inf"):
        value = _SINGLE_LIMIT
    layout = dice.one_of("<>") + code
    size = struct.calcsize(layout)
    if len(text) >= size:
        struct.pack_into(layout, text, dice.below(len(text) - size + 1), value)


def _repeat_word(text, others, words, dice):
    found = _found_near(_WORD, text, dice)
    if found is not None:
        between = dice.one_of((b" ", b",", b", ", b"", b"\n"))
        text[found.end() : found.end()] = (between + found[0]) * dice.one_of((1, 1, 2, 40))


def _swap_lines(text, others, words, dice):
    lines = text.split(b"\n")
    one, other = dice.below(len(lines)), dice.below(len(lines))
    lines[one], lines[other] = lines[other], lines[one]
    text[:] = b"\n".join(lines)


def _drop_line(text, others, words, dice):
    lines = text.split(b"\n")
    del lines[dice.below(len(lines))]
    text[:] = b"\n".join(lines)


def _repeat_line(text, others, words, dice):
    lines = text.split(b"\n")
    at = dice.below(len(lines))
    lines[at:at] = [lines[at]] * dice.one_of((1, 1, 2, 20))
    text[:] = b"\n".join(lines)


def _end_lines_otherwise(text, others, words, dice):
    text[:] = text.replace(b"\n", dice.one_of((b"\r\n", b"\r", b"\n\n", b" \n")))


def _part(text, dice):
    """Return where a part begins and ends: most are short."""
    start = dice.below(len(text) + 1)
    return start, start + 1 + dice.below(dice.one_of((1, 4, 16, 60)))


def _found_near(pattern, text, dice):
    """Return the first match behind some place, or the first of all."""
    return pattern.search(text, dice.below(len(text) + 1)) or pattern.search(text)


_DAMAGES = (
    _flip, _flip, _set, _set_telling, _insert, _insert_telling, _insert_word, _delete, _truncate,
    _repeat, _move, _overwrite, _splice, _number_in_text, _number_in_text, _number_in_text,
    _replace_group, _replace_group, _number_as_whole, _number_as_whole, _number_as_float,
    _repeat_word, _swap_lines, _drop_line, _repeat_line, _end_lines_otherwise,
)  # fmt: skip
