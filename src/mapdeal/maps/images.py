"""Images of all formats of maps, decoded to integer samples.

The contents decide the format; the file's name does not. Netpbm images, P1 to P6, are read
without a library: libraries disagree on maxval, comments and damage, all common in ROS maps.
PNG, BMP, TIFF and JPEG are decoded by Pillow, which is imported by the functions that need it.

References
----------
The netpbm pages of the formats pbm, pgm and ppm.
"""

from __future__ import annotations

import io
import os
import re
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext, suppress
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from mapdeal import errors, records
from mapdeal.files import source as sources
from mapdeal.kernels.blocks import Layer
from mapdeal.maps import picture as pictures
from mapdeal.maps.picture import ImageFormat, OpenFile, OpenImage, Picture, Samples, Strips, warn_of

_NOT_AN_IMAGE = "is not an image in a supported format: pgm, pbm, ppm, png, bmp, tiff"
_NOT_SEPARATE = "white space must separate the header from the pixels"
_COMMENT_OR_WORD = re.compile(rb"#[^\n\r]*|[^ \t\n\v\f\r#]+")
_COMMENT = re.compile(rb"#[^\n\r]*")
_BLANK = re.compile(rb"[ \t\n\v\f\r]")
_DIGITS_AND_BLANKS = b"0123456789 \t\n\v\f\r"
_IN_A_LINE = bytes.maketrans(b"\n\r", b"  ")
_MOST_DIGITS = 9
_TEXT_AT_ONCE = 1 << 18
_LONGEST_HEADER = 1 << 16
_WRITTEN_AT_ONCE = 1 << 20
_PIXELS_AT_ONCE = 1 << 22
_TRAILING = 64


class PnmImage(OpenImage):
    # By the netpbm standard 1 is black in P1 and P4; the ROS 1 reader takes bits for grey levels.
    def __init__(self, file: OpenFile, limit: int = pictures.LARGEST_CELLS) -> None:
        self._magic, (width, height, self._maxval), self._header_end = _read_header(file)
        self._is_text, self._is_bits = self._magic <= 3, self._magic in (1, 4)
        self._channels = 3 if self._magic in (3, 6) else 1
        self._row_bytes = width * self._channels * (2 if self._maxval > 255 else 1)
        if self._is_bits:
            self._row_bytes = (width + 7) // 8
        super().__init__(file, height, width, limit)

    def memory(self) -> int:
        if self._is_text:
            return self._memory_of_text()
        per_row = max(self.width, self._row_bytes)
        return self.width * self.height + min(sources.PIECES, 8 * per_row * self.height)

    def _memory_of_text(self) -> int:
        cells = self.width * self.height
        if self._magic == 1:  # copies of the text, and samples, digits and a mask of digits
            return 6 * self.file.size + 3 * cells
        per_cell = 1 + self._channels * (1 + (self._maxval > 255)) if self._is_text else 0
        return 3 * self.file.size + per_cell * cells

    def _decoded(self) -> Strips:
        if (read := self.rows()) is not None:
            self._claim(self.memory())
            return read(slice(0, self.height))
        data = self.file.read_all()
        self._claim(self.memory())
        samples = self._plain_samples(data)
        if self._is_bits:
            samples = np.where(samples, np.uint8(0), np.uint8(255))
        picture = self._picture_of(samples)
        return Strips(picture.shape, lambda: picture.bands(_PIXELS_AT_ONCE))

    def bits(self) -> NDArray[np.uint8]:
        """Return the bits of a P1 or P4 file, packed, row 0 in the north."""
        file = self.file
        data = file.read_all()
        sources.note_sum(file.path, file.sha256)
        if not self._is_bits:
            raise file.error("must be a bit map, P1 or P4", "header", got=f"P{self._magic}")
        pictures.check_size(file.path, self.width, self.height, self._limit)
        self._claim(self._memory_of_text())
        if self._is_text:
            return np.packbits(self._plain_samples(data), axis=1)
        count = self._row_bytes * self.height
        packed = np.frombuffer(data, dtype=np.uint8, count=count, offset=self._start())
        return packed.reshape(self.height, -1)

    def _claim(self, count: int) -> None:
        sources.claim(self.file.path, count, what=f"{self.width} x {self.height} cells")

    def rows(self) -> Callable[[slice], Strips] | None:
        """Return a reader of ranges of rows, counted from the south; None for P1 to P3, texts."""
        return None if self._is_text else partial(self._part, self._start())

    def _part(self, start: int, rows: slice) -> Strips:
        north = self.height - rows.stop
        return pictures.strips_at_places(
            (rows.stop - rows.start, self.width), self._row_bytes,
            lambda first, end: self._picture(start, north + first, north + end),
        )  # fmt: skip

    def _picture(self, start: int, first: int, end: int) -> Picture:
        count = (end - first) * self._row_bytes
        data = self.file.read(start + first * self._row_bytes, count)
        if len(data) < count:
            raise errors.FileAccessError(sources.CHANGED, source=self.file.path)
        samples: Samples = np.frombuffer(data, dtype=np.uint8)
        if self._is_bits:
            bits = np.unpackbits(samples.reshape(-1, self._row_bytes), axis=1, count=self.width)
            np.subtract(bits, 1, out=bits)  # 0 becomes 255, and 1 becomes 0
            return self._picture_of(bits)
        if self._maxval > 255:
            samples = np.frombuffer(data, dtype=">u2").astype(np.uint16)
        if self._maxval not in (255, 65535):
            check_pixels(samples, self._maxval, first * self.width * self._channels, self.file.path)
        return self._picture_of(samples)

    def _picture_of(self, samples: Samples) -> Picture:
        """Return the picture of some rows; of bits `samples` are their brightness."""
        maxval = 255 if self._is_bits else self._maxval
        if self._channels == 3:
            return Picture("PNM", "rgb", samples.reshape(-1, self.width, 3), maxval)
        return Picture("PNM", "grey", samples.reshape(-1, self.width), maxval)

    def _start(self) -> int:
        """Return the offset of the first pixel of a binary file; check the file's length."""
        file, expected = self.file, self._row_bytes * self.height
        start = self._start_of_data(expected)
        actual = file.size - start
        if actual < expected:
            rule = f"the pixels end early: expected {expected} bytes"
            raise file.error(rule, "pixels", got=actual)
        if actual > expected:
            if re.match(PNM.signature, file.read(start + expected, _TRAILING).lstrip()):
                raise file.error("holds more than one picture")
            text = f"{actual - expected} bytes after the picture were ignored"
            warn_of(file.path, text, "image.trailing-bytes")
        return start

    def _start_of_data(self, expected: int) -> int:
        """Return the offset of the first pixel: one byte behind the header, or two after CR LF."""
        # A DOS text conversion puts CR LF into the header. If no pixel had the value of a line
        # feed, the pixels are intact and begin one byte later.
        file, end = self.file, self._header_end
        separator = file.head[end : end + 2]
        if separator[:1] == b"#":
            # A comment right behind maxval: its line end is the one byte before the pixels.
            line_end = file.head.find(b"\n", end)
            return line_end + 1 if line_end >= 0 else file.size
        if not separator:
            raise file.error("the file ends after its header")
        if not separator[:1].isspace():
            raise file.error(_NOT_SEPARATE, f"byte {end}")
        if separator != b"\r\n":
            return end + 1
        length = file.size - end - 1
        if length == expected + 1:
            text = "header: DOS line ends; the pixels are intact and were read"
            warn_of(file.path, text, "image.dos-header")
            return end + 2
        if length == expected and b"\r\n" not in file.head[:end]:
            return end + 1  # a lone CR, then a first pixel of value 10
        rule = f"CRLF-damaged: a text conversion has changed the pixels, expected {expected} bytes"
        raise file.error(rule, "pixels", got=length)

    def _plain_samples(self, data: bytes) -> Samples:
        count = self.width * self.height * self._channels
        body = data[self._header_end :]
        if b"#" in body:
            body = _COMMENT.sub(b"", body)
        if self._magic == 1:
            digits = np.frombuffer(body.translate(None, b" \t\n\v\f\r"), dtype=np.uint8)
            is_digit = (digits | 1) == 49
            if not is_digit.all():
                place = f"pixel {int(np.argmin(is_digit))}"
                raise self.file.error("a P1 pixel must be 0 or 1", place)
            self._check_count(len(digits), count)
            return (digits - 48).reshape(self.height, self.width)
        if not body[:1].isspace():
            raise self.file.error(_NOT_SEPARATE, f"byte {self._header_end}")
        return self._numbers(body, count)

    def _numbers(self, body: bytes, count: int) -> Samples:
        """Return the numbers of a text; it is parsed in parts, because words take much memory."""
        samples: Samples = np.empty(count, dtype=np.uint8 if self._maxval <= 255 else np.uint16)
        found = start = 0
        while start < len(body):
            blank = _BLANK.search(body, start + _TEXT_AT_ONCE)
            end = blank.start() if blank else len(body)
            part, start = body[start:end], end
            values = self._whole_numbers(part, found)
            check_pixels(values, self._maxval, found, self.file.path)
            samples[found : found + len(values)] = values[: max(count - found, 0)]
            found += len(values)
        self._check_count(found, count)
        return samples

    def _whole_numbers(self, text: bytes, first: int) -> NDArray[np.int64]:
        if not text.strip():
            return np.empty(0, dtype=np.int64)
        with suppress(ValueError):  # numpy refuses other words, and numbers above int64
            if not text.translate(None, _DIGITS_AND_BLANKS):
                values = np.loadtxt([text.translate(_IN_A_LINE)], dtype=np.int64, ndmin=1)
                if values.max() < 10**_MOST_DIGITS:
                    return values
        odd, word = next(
            (k, word) for k, word in enumerate(text.split())
            if not word.isdigit() or len(word) > _MOST_DIGITS
        )  # fmt: skip
        rule = f"pixels must be whole numbers from 0 to {self._maxval}"
        raise self.file.error(rule, f"pixel {first + odd}", got=word.decode("latin-1"))

    def _check_count(self, actual: int, expected: int) -> None:
        if actual != expected:
            place = f"pixel {min(actual, expected)}"
            raise self.file.error(f"must hold {expected} pixel values", place, got=actual)


def check_pixels(samples: NDArray[Any], maxval: int, first: int, source: Path) -> None:
    """Refuse samples above `maxval`; `first` is the index of the first sample in the picture."""
    if samples.max(initial=0) > maxval:
        flat = samples.reshape(-1)
        index = int(np.argmax(flat > maxval))
        rule, place = f"pixels must not exceed maxval {maxval}", f"pixel {first + index}"
        raise errors.MalformedInputError(rule, source=source, place=place, got=int(flat[index]))


def _read_header(file: OpenFile) -> tuple[int, list[int], int]:
    """Return the digit of the type, width, height and maxval, and where the last of them ends."""
    data = file.head
    kind = data[1:2].decode("latin-1")
    if not data.startswith(b"P") or kind not in list("1234567fF"):
        raise file.error("is not a netpbm image")
    if kind not in "123456":
        raise file.error(f"{'PAM' if kind == '7' else 'PFM'} images are not supported")
    magic, end = int(kind), 2
    numbers: list[int] = []
    for name in ["width", "height"] if magic in (1, 4) else ["width", "height", "maxval"]:
        parts = _COMMENT_OR_WORD.finditer(data, end, end + _LONGEST_HEADER)
        word = next((part for part in parts if not part[0].startswith(b"#")), None)
        if word is None:
            raise file.error("the file ends early", f"header {name}")
        text, end = word[0].decode("latin-1"), word.end()
        # Python takes long to convert numbers of a million digits.
        if not re.fullmatch(r"-?\d{1,12}", text):
            raise file.error("must be a whole number", f"header {name}", got=text)
        numbers.append(int(text))
    numbers = [*numbers, 1][:3]
    if not 1 <= numbers[2] <= 65535:
        raise file.error("must lie between 1 and 65535", "header maxval", got=numbers[2])
    return magic, numbers, end


def pnm_comments(head: bytes) -> list[str]:
    found: list[str] = []
    words = 0  # of type, width, height and maxval; the pixels follow
    for line in head.split(b"\n"):
        plain, mark, comment = line.partition(b"#")
        words += len(plain.split())
        if mark:
            found.append(comment.decode("latin-1").strip())
        if words >= 4:
            break
    return found


PNM = ImageFormat(
    name="PNM", suffixes=(".pgm", ".pbm", ".ppm", ".pnm"), signature=rb"P[1-7fF](\s|#)",
    open=PnmImage, max_cells=pictures.LARGEST_CELLS, comments=pnm_comments,
)  # fmt: skip
"""Netpbm images; those in the formats PFM and PAM are recognised and refused."""


def write_pbm(file: BinaryIO, packed: NDArray[np.uint8], width: int) -> None:
    """Write a P4 file of packed bits, shape (H, ceil(W / 8)), row 0 in the north, 1 black."""
    file.write(f"P4\n{width} {len(packed)}\n".encode())
    _write_rows(file, packed)


def begin_pgm(file: BinaryIO, pixels: Layer, *, comment: str = "") -> Callable[[slice], None]:
    """Begin a P5 file of 8-bit pixels; return the writer of its rows, row 0 in the south."""
    height, width = pixels.shape
    note = f"# {comment}\n" if comment else ""
    file.write(f"P5\n{note}{width} {height}\n255\n".encode())
    start = file.tell()

    def write_rows(rows: slice) -> None:
        file.seek(start + (height - rows.stop) * width)
        _write_rows(file, pixels[rows][::-1])

    return write_rows


def _write_rows(file: BinaryIO, rows: NDArray[np.uint8]) -> None:
    step = max(1, _WRITTEN_AT_ONCE // rows.shape[1])
    bands = (rows[first : first + step] for first in range(0, len(rows), step))
    file.writelines(np.ascontiguousarray(band).data for band in bands)


_EXIF_ORIENTATION = 0x0112

# Bits of a sample in PNG files with fewer than 8, by Pillow's raw modes.
_DEPTHS = {"1": 1, "L;2": 2, "L;4": 4, "P;1": 1, "P;2": 2, "P;4": 4}
# Bits of a pixel in files by Pillow's modes, and the most that any other mode has.
_BITS = {"1": 1, "L": 8, "P": 8, "I;16": 16, "I;16B": 16, "LA": 16, "RGB": 24}
_WIDE = 32
_IN_MEMORY = {"1": 1, "L": 1, "P": 1, "I;16": 2, "I;16B": 2}
_MOST_IN_MEMORY = 4  # bytes of a pixel in Pillow's memory
_RAW_BMP, _RAW_TIFF = 0, "raw"
_BITS_PER_SAMPLE, _SAMPLES, _ROWS_PER_STRIP, _PLANAR = 258, 277, 278, 284
# Tags of a TIFF file: offsets and sizes of parts, and width and height of a tile.
_STRIPS, _TILES, _TILE = (273, 279), (324, 325), (322, 323)

# Pillow's limit, the warning filters and standard error, to which libtiff writes, belong to the
# process: two threads that replace and restore them at once would leave them replaced.
PROCESS_WIDE_LOCK = threading.RLock()


class PillowImage(OpenImage):
    def __init__(self, name: str, file: OpenFile, limit: int) -> None:
        self._name = name
        self._image = image = _opened(name, file)
        super().__init__(file, image.height, image.width, limit)

    def memory(self) -> int:
        image, size, info = self._image, self.file.size, self._image.info
        with damage_refused(self.file.path):
            cells, bits = self.width * self.height, self._bits()
            file_bytes = size if self._name == "TIFF" else 0
            work = 0
            if self._name == "JPEG" and "progressive" in info:
                work = cells * bits // 4  # all scans are collected before decoding
            elif self._name == "TIFF" and info.get("compression") != _RAW_TIFF:
                across, down = self._part()
                work = max(4, bits // 8) * across * down
            elif self._name == "BMP" and (info["compression"] != _RAW_BMP or self._has_opacity()):
                work = 4 * cells
            decoded = _IN_MEMORY.get(image.mode, _MOST_IN_MEMORY) * cells
            needed = file_bytes + decoded + max(work, cells) + min(sources.PIECES, 16 * cells)
            return max(needed, 2 * size if self._name == "PNG" else 0)

    def _decoded(self) -> Strips:
        name, file, path = self._name, self.file, self.file.path
        self._check_room()
        if name == "TIFF":
            self._check_parts()
        with damage_refused(path):
            _opened(name, file).verify()  # checksums and the end of a PNG, which `load` ignores
        # libtiff needs all bytes, and without a standard error the file may have its descriptor
        data = io.BytesIO(file.read_all()) if name == "TIFF" else file.stream()
        image = _opened(name, file, data)
        (codec, _, offset, args), info = image.tile[0], dict(image.info)
        raw_mode = args if isinstance(args, str) else args[0]
        if name == "PNG" and image.mode == "P" and image.palette is None:
            raise file.error("has no palette", "chunk PLTE")
        with damage_refused(path), _silent_stderr() if name == "TIFF" else nullcontext():
            if self._has_opacity():
                from PIL import Image

                pixels = file.read(offset, 4 * image.width * image.height)
                image = Image.frombytes("RGBA", image.size, pixels, codec, "BGRA", *args[1:])
            image.load()
            orientation = image.getexif().get(_EXIF_ORIENTATION, 1)
        if orientation != 1:
            warn_of(path, "the EXIF orientation was not applied, as in ROS", "image.orientation")
        _warn_of_loss(name, image, raw_mode, info, path)
        width = self.width

        def rows_at(first: int, end: int) -> Picture:  # copied out of Pillow's memory
            with damage_refused(path):  # Pillow 12 checks its limit here as well
                rows = image.crop((0, first, width, end))
            return _picture_of(rows, name, raw_mode, info, path)

        return pictures.strips_at_places((self.height, width), 4 * width, rows_at)

    def _check_room(self) -> None:
        """Refuse more pixels than the file can expand to or than fit into memory."""
        path, cells, most = self.file.path, self.width * self.height, sources.BLANK_EXPANSION
        with damage_refused(path):
            across, down = self._part() if self._name == "TIFF" else (0, 0)
            tile = across * down
            expanded = -(-max(tile, cells) * self._bits() // 8)
        needed = self.memory()
        sources.check_expansion(path, self.file.size, expanded, most=most, place="image size")
        size = f"{self.width} x {self.height} cells"
        sources.claim(path, needed, what=f"{size}, in tiles of {tile}," if tile > cells else size)

    def _check_parts(self) -> None:
        """Refuse a TIFF that lacks strips or tiles: decoders leave their cells black."""
        tags, file = self._image.tag_v2, self.file
        with damage_refused(file.path):  # tags may be of any type
            is_tiled = _TILES[0] in tags
            offsets, sizes = (tags.get(tag, ()) for tag in (_TILES if is_tiled else _STRIPS))
            across, down = self._part()
            planes = tags.get(_SAMPLES, 1) if tags.get(_PLANAR) == 2 else 1
            expected = -(-self.width // across) * -(-self.height // down) * planes
            rows = expected * down if is_tiled else self.height * planes
            is_raw = self._image.info.get("compression") == _RAW_TIFF
            least = -(-across * (self._bits() // planes) // 8) * rows if is_raw else 1
            end = max(map(sum, zip(offsets, sizes, strict=False)), default=0)
        if {len(offsets), len(sizes)} != {expected}:
            rule = f"must list {expected} strips or tiles, as many as cover the picture"
            raise file.error(rule, "strips", got=min(len(offsets), len(sizes)))
        if sum(sizes) < least:
            raise file.error(f"the pixels end early: expected {least} bytes", got=sum(sizes))
        if end > file.size:
            raise file.error(f"the pixels end early: expected a file of {end} bytes", got=file.size)

    def _part(self) -> tuple[int, int]:
        tags = self._image.tag_v2
        if _TILES[0] in tags:
            return int(tags[_TILE[0]]), int(tags[_TILE[1]])
        return self.width, min(int(tags.get(_ROWS_PER_STRIP, self.height)), self.height)

    def _bits(self) -> int:
        if self._name == "TIFF":
            return max(1, int(sum(self._image.tag_v2.get(_BITS_PER_SAMPLE, (1,)))))
        raw_mode = self._image.tile[0][3] if self._name == "PNG" else ""
        return int(_DEPTHS.get(raw_mode, _BITS.get(self._image.mode, _WIDE)))

    def _has_opacity(self) -> bool:
        """Return whether a BMP has a fourth byte that Pillow drops and ROS reads as opacity."""
        image, is_bmp = self._image, self._name == "BMP"
        return is_bmp and image.tile[0][3][0] == "BGRX" and image.info["compression"] == _RAW_BMP


def _opened(name: str, file: OpenFile, data: BinaryIO | None = None) -> Any:
    """Return Pillow's image of a file, its header read and checked, its pixels not yet decoded."""
    from PIL import Image, UnidentifiedImageError

    path = file.path
    if name == "PNG":  # Pillow reads at once a chunk that may be as long as the file
        sources.claim(path, file.size)
    with damage_refused(path):
        try:
            image = Image.open(data or file.stream(), formats=(name,))
        except UnidentifiedImageError:
            raise file.error(_NOT_AN_IMAGE) from None
        frames = getattr(image, "n_frames", 1)
    pictures.check_size(path, image.width, image.height)
    if frames > 1:
        raise file.error("holds more than one picture")
    if not image.tile:
        raise file.error("holds no pixels")
    return image


def _warn_of_loss(name: str, image: Any, raw_mode: str, info: dict[str, Any], path: Path) -> None:
    if name == "JPEG":
        warn_of(path, "JPEG is lossy: greys may have moved across the thresholds", "image.lossy")
    if name == "PNG" and raw_mode.endswith(";16B") and not raw_mode.startswith("I"):
        warn_of(path, "16-bit colour was reduced to 8 bits; ROS 2 reads all 16", "image.depth")
    if name == "PNG" and image.mode == "RGB" and isinstance(info.get("transparency"), tuple):
        text = "one colour is transparent; read as ROS 2 does, where only black matches"
        warn_of(path, text, "image.transparent-colour")


def _picture_of(image: Any, name: str, raw_mode: str, info: dict[str, Any], path: Path) -> Picture:
    mode, pixels = image.mode, np.asarray(image)
    if mode == "1" and name == "BMP":  # Pillow's mode for a palette of black and white
        palette = np.array([[0, 0, 0, 255], [255, 255, 255, 255]], dtype=np.uint8)
        picture = Picture(name, "palette", pixels.astype(np.uint8), palette=palette)
    elif mode == "1":
        picture = Picture(name, "grey", pixels.astype(np.uint8) * np.uint8(255))
    elif mode == "L":
        picture = Picture(name, "grey", pixels)
    elif mode.startswith("I;16") or raw_mode == "I;16B":  # mode "I" in older Pillow
        picture = Picture(name, "grey", pixels.astype(np.uint16), maxval=65535)
    elif mode == "P":
        picture = Picture(name, "palette", pixels, palette=_palette(image, info))
    elif mode == "RGB":
        picture = Picture(name, "rgb", pixels)
    elif mode == "LA" or raw_mode.startswith("LA"):  # 16 bits are mode "RGBA" in older Pillow
        picture = Picture(name, "grey", pixels[..., 0], alpha=pixels[..., -1])
    elif mode == "RGBA":
        picture = Picture(name, "rgb", pixels[..., :3], alpha=pixels[..., 3])
    else:
        raise errors.MalformedInputError("unsupported pixel type", source=path, got=mode)
    return _with_png_facts(picture, raw_mode, info) if name == "PNG" else picture


def _palette(image: Any, info: Mapping[str, Any]) -> NDArray[np.uint8]:
    """Return red, green, blue, opacity of all 256 indices; those not defined are black."""
    colours = np.array(image.getpalette("RGB"), dtype=np.uint8).reshape(-1, 3)
    table = np.zeros((256, 4), dtype=np.uint8)
    table[:, 3] = 255
    table[: len(colours), :3] = colours
    clear = info.get("transparency")
    if isinstance(clear, int):  # the one index that is not opaque
        table[clear, 3] = 0
    elif isinstance(clear, bytes):
        opacities = np.frombuffer(clear, dtype=np.uint8)[:256]
        table[: len(opacities), 3] = opacities
    return table


def _with_png_facts(picture: Picture, raw_mode: str, info: Mapping[str, Any]) -> Picture:
    # a file may store texts under any name, these included
    facts = [(key, value) for key, value in info.items() if not isinstance(value, str)]
    display = [f"a gamma of {value:g}" if key == "gamma" else "a colour profile"
               for key, value in facts if key in ("gamma", "icc_profile")]  # fmt: skip
    picture = records.replace(picture, display=tuple(display))
    key = info.get("transparency")
    if picture.palette is not None or picture.alpha is not None or not isinstance(key, int | tuple):
        return picture
    if picture.colour == "rgb":
        # The ROS 2 readers compare an 8-bit key with 16-bit samples: only black ever matches.
        transparent = np.all(picture.samples == 0, axis=2) & (key == (0, 0, 0))
    elif raw_mode == "1":  # newer Pillow expands bits to 0 or 255
        transparent = picture.samples == (255 if key else 0)
    else:
        transparent = picture.samples == key * (255 // ((1 << _DEPTHS.get(raw_mode, 8)) - 1))
    full = np.array(picture.maxval, dtype=picture.samples.dtype)
    alpha = np.where(transparent, np.zeros_like(full), full)
    return records.replace(picture, alpha=alpha, alpha_from="key")


@contextmanager
def damage_refused(path: Path) -> Iterator[None]:
    """Turn the exceptions that Pillow raises on damaged files into one clear error."""
    # Only calls of Pillow belong into this block: in other code the same exceptions are bugs.
    import logging

    from PIL import Image, UnidentifiedImageError

    # Pillow's warnings about odd tags and its log of undecodable parts are ignored.
    log = logging.getLogger("PIL")
    if not log.handlers:
        log.addHandler(logging.NullHandler())
    try:
        with PROCESS_WIDE_LOCK, warnings.catch_warnings():
            # by module: warnings of other threads must pass
            warnings.filterwarnings("ignore", module=r"PIL\.")
            limit, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None  # `check_size` has ours
            try:
                yield
            finally:
                Image.MAX_IMAGE_PIXELS = limit
    except errors.MapdealError:
        raise
    except Exception as error:  # noqa: BLE001 - Pillow's readers fail in many ways
        if isinstance(error, OSError) and error.errno is not None:
            raise errors.FileAccessError(f"cannot be read: {error.strerror}", source=path) from None
        reason = str(error) or type(error).__name__
        if isinstance(error, UnidentifiedImageError):  # its text contains a memory address
            reason = "an embedded part is not an image"
        raise errors.MalformedInputError(f"the image is damaged: {reason}", source=path) from None


@contextmanager
def _silent_stderr() -> Iterator[None]:
    """Discard what libtiff writes to standard error."""
    with PROCESS_WIDE_LOCK:
        nowhere = os.open(os.devnull, os.O_WRONLY)  # 2 itself, if the caller has closed that
        saved = os.dup(2)
        try:
            os.dup2(nowhere, 2)
            yield
        finally:
            os.dup2(saved, 2)
            os.close(saved)
            os.close(nowhere)


_FORMATS = (
    PNM,
    ImageFormat("PNG", (".png",), rb"\x89PNG\r\n\x1a\n", partial(PillowImage, "PNG")),
    ImageFormat("BMP", (".bmp",), b"BM", partial(PillowImage, "BMP")),
    # All signatures that Pillow opens: both byte orders, a swapped version number, and BigTIFF.
    ImageFormat("TIFF", (".tif", ".tiff"), rb"(MM|II)(\0\*|\*\0)|MM\0\+|II\+\0",
                partial(PillowImage, "TIFF")),
    ImageFormat("JPEG", (".jpg", ".jpeg"), rb"\xff\xd8\xff", partial(PillowImage, "JPEG")),
)  # fmt: skip
IMAGE_FORMATS = {entry.name: entry for entry in _FORMATS}  # the formats that maps may have, by name
IMAGE_SUFFIXES = tuple(suffix for entry in _FORMATS for suffix in entry.suffixes)


def recognised_format(head: bytes) -> ImageFormat | None:
    return next((entry for entry in _FORMATS if re.match(entry.signature, head)), None)


@contextmanager
def open_image(path: Path, *, max_cells: int | None = None) -> Iterator[OpenImage]:
    with pictures.opened(path) as file:
        if (image_format := recognised_format(file.head)) is not None:
            limit = image_format.max_cells if max_cells is None else max_cells
            yield image_format.open(file, limit)
            return
    if not file.head:
        raise file.error("the image file is empty")
    if file.head.startswith(sources.LFS_POINTER):
        raise file.error("is a Git LFS pointer, not the image", hint="fetch it with: git lfs pull")
    raise file.error(_NOT_AN_IMAGE)


@contextmanager
def open_for_one_pass(path: Path, *, max_cells: int | None) -> Iterator[tuple[Strips, bytes]]:
    """Open an image file; yield its strips, of which no cells stay in memory, and its head."""
    with open_image(path, max_cells=max_cells) as image:
        height, width = image.shape
        with sources.holding(-height * width), image.strips() as strips:
            yield strips, image.file.head


def read_image_size(path: Path, *, max_cells: int | None = None) -> tuple[int, int]:
    with open_image(path, max_cells=max_cells) as image:
        return image.shape
