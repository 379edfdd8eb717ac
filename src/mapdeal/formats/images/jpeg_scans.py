"""The scans of a JPEG stream: whether all coefficients are there.

libjpeg fills up what is missing, with grey, and says nothing; so that is seen here.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import nullcontext
from itertools import pairwise
from pathlib import Path
from typing import Any

from mapdeal.errors import MalformedInputError
from mapdeal.formats.images.pillow import damage_refused, have_same_pixels

_TEM, _SOI, _EOI, _SOS, _DRI = 0x01, 0xD8, 0xD9, 0xDA, 0xDD
_RESTARTS = range(0xD0, 0xD8)
_FRAMES = [code for code in range(0xC0, 0xD0) if code not in (0xC4, 0xC8, 0xCC)]
_HUFFMAN_SEQUENTIAL, _HUFFMAN_PROGRESSIVE = (0xC0, 0xC1), 0xC2

# What decodes to all kinds of coefficients; no byte is 0xFF, which would begin a marker.
_FILLERS = [bytes((at * step + step) % 255 for at in range(64)) for step in (83, 101, 167, 229)]


class _Frame:
    """Content of the headers of a JPEG stream and its scans."""

    def __init__(self, marker: int, body: bytes) -> None:
        self.height, self.width = (int.from_bytes(body[at : at + 2], "big") for at in (1, 3))
        self.data_ends: list[int] = []
        self._is_progressive = marker == _HUFFMAN_PROGRESSIVE
        factors = zip(body[6::3], body[7::3], strict=True)
        self._sampling = {component: (both >> 4, both & 15) for component, both in factors}
        # the lowest bit that has come, of each coefficient of each component
        self._low_bits: dict[int, list[int | None]] = {n: [None] * 64 for n in self._sampling}

    @property
    def is_sound(self) -> bool:
        """Whether there is a picture, with samples of all components."""
        factors = [factor for pair in self._sampling.values() for factor in pair]
        return min(self.height, self.width, *factors) > 0

    def add_scan(self, body: bytes) -> int | None:
        """Note which coefficients a scan has; return its units, None if its header is damaged."""
        count = body[0] if body else 0
        components = list(body[1 : 1 + 2 * count : 2])
        if len(body) != 4 + 2 * count or not components or not {*components} <= {*self._sampling}:
            return None
        first, last, low = (*body[-3:-1], body[-1] & 15) if self._is_progressive else (0, 63, 0)
        if not first <= last < 64:
            return None
        for component in components:
            self._low_bits[component][first : last + 1] = [low] * (last + 1 - first)
        return self._units(components)

    def _units(self, components: list[int]) -> int:
        """Return how many units (MCUs) a scan of some components has: of blocks of 8 x 8."""
        most = [max(pair[axis] for pair in self._sampling.values()) for axis in (0, 1)]
        lengths = [self.width, self.height]
        if len(components) == 1:  # these are not padded to whole units of all components
            own = self._sampling[components[0]]
            blocks = [-(-n * own[a] // most[a]) for a, n in enumerate(lengths)]
            return -(-blocks[0] // 8) * -(-blocks[1] // 8)
        return -(-lengths[0] // (8 * most[0])) * -(-lengths[1] // (8 * most[1]))

    @property
    def has_all_scans(self) -> bool:
        """Whether the scans have all bits of all coefficients."""
        return all(low == 0 for row in self._low_bits.values() for low in row)

    def filled_up(self, data: bytes, filler: bytes) -> bytes:
        """Return the stream with some bytes more wherever data end."""
        edges = [0, *self.data_ends, len(data)]
        return filler.join(data[first:last] for first, last in pairwise(edges))


def check_scans(data: bytes, path: Path, image: Any = None) -> tuple[int, int]:
    """Refuse a JPEG stream of which some coefficients are missing.

    Notes
    -----
    The headers of the scans say whether there is one for each bit of each coefficient, and how
    many restarts there must be. That data reach to their end is seen from decoding them with
    other bytes behind them, where a decoder of complete data never gets to. Data that end early
    are not found where no bytes behind them would change a pixel; neither is damage within the
    data, since JPEG has no checksums.
    """
    frame = _frame_of(data, path)
    if not frame.has_all_scans:
        raise MalformedInputError("scans of the JPEG image are missing", source=path)
    for filler in _FILLERS:
        with (
            damage_refused(path),
            nullcontext(image) if image is not None else _opened(data) as expected,
            _opened(frame.filled_up(data, filler)) as filled,
        ):
            expected.load()
            filled.load()
            is_same = have_same_pixels(expected, filled)
        if not is_same:
            raise _ends_early(path)
    return frame.height, frame.width


def _frame_of(data: bytes, path: Path) -> _Frame:
    """Return what the headers of a stream say, and where the data behind them end."""
    frame: _Frame | None = None
    restart_interval = 0
    for marker, start, end in _segments(data, path):
        body = data[start:end]
        if marker == _DRI:
            restart_interval = int.from_bytes(body, "big")
        elif marker in _FRAMES:
            if frame is not None:
                raise _damaged(path, "it has two frames")
            frame = _checked_frame(marker, body, path)
        elif marker == _SOS:
            units = None if frame is None else frame.add_scan(body)
            if frame is None or units is None:
                raise _damaged(path, "the header of a scan does not fit")
            ends, restarts = _ends_of_data(data, end, path)
            expected = -(-units // restart_interval) - 1 if restart_interval else 0
            if restarts != [_RESTARTS[at % len(_RESTARTS)] for at in range(expected)]:
                raise _ends_early(path)
            frame.data_ends += ends
    if frame is None:
        raise _damaged(path, "it has no frame")
    return frame


def _checked_frame(marker: int, body: bytes, path: Path) -> _Frame:
    if marker not in (*_HUFFMAN_SEQUENTIAL, _HUFFMAN_PROGRESSIVE):
        rule = f"JPEG images of kind SOF{marker - _FRAMES[0]} are not supported"
        raise MalformedInputError(rule, source=path)
    has_length = len(body) > 6 and len(body) == 6 + 3 * body[5]
    frame = _Frame(marker, body) if has_length else None
    if frame is None or not frame.is_sound:
        raise _damaged(path, "the header of its frame does not fit")
    return frame


def _segments(data: bytes, path: Path) -> Iterator[tuple[int, int, int]]:
    """Yield marker, start and end of the body of each segment, up to the mark of the end."""
    offset = 0
    while True:
        offset = data.find(b"\xff", offset)
        if offset < 0 or offset + 1 >= len(data):
            raise _ends_early(path)
        marker = data[offset + 1]
        if marker == _EOI:
            return
        if marker in (0, _TEM, _SOI, 0xFF, *_RESTARTS):
            offset += 1 if marker == 0xFF else 2
            continue
        start = offset + 4
        offset += 2 + int.from_bytes(data[offset + 2 : start], "big")
        if not start <= offset <= len(data):
            raise _ends_early(path)
        yield marker, start, offset


def _ends_of_data(data: bytes, start: int, path: Path) -> tuple[list[int], list[int]]:
    """Return where the pieces of a scan's data end, and the restarts between them."""
    ends: list[int] = []
    restarts: list[int] = []
    offset = start
    while True:
        mark = offset = data.find(b"\xff", offset)
        if offset < 0:
            raise _ends_early(path)
        while data[offset : offset + 1] == b"\xff":  # any number may stand before the code
            offset += 1
        if offset == len(data):
            raise _ends_early(path)
        code = data[offset]
        offset += 1
        if code:  # 0 says that the 0xFF before it was a value
            ends.append(mark)
            if code not in _RESTARTS:
                return ends, restarts
            restarts.append(code)


def _opened(data: bytes) -> Any:
    from PIL import Image

    return Image.open(io.BytesIO(data), formats=("JPEG",))


def _ends_early(path: Path) -> MalformedInputError:
    return MalformedInputError("the pixels end early", source=path, place="JPEG data")


def _damaged(path: Path, what: str) -> MalformedInputError:
    return MalformedInputError(f"the JPEG data are damaged: {what}", source=path)
