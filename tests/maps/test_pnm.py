from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

from mapdeal import MalformedInputError, MapdealWarning
from mapdeal.maps.images import PnmImage, begin_pgm, check_pixels
from mapdeal.maps.picture import opened
from maps.pictures import joined

PIXELS = np.array([[0, 10, 255], [13, 205, 254]], dtype=np.uint8)
BODY = PIXELS.tobytes()


def decode(data, **options):
    with TemporaryDirectory() as folder:
        (Path(folder) / "map.pgm").write_bytes(data)
        with opened(Path(folder) / "map.pgm") as file, PnmImage(file, **options).strips() as strips:
            return joined(strips)


@pytest.mark.parametrize("header", [
    b"P5\n3 2\n255\n", b"P5 3 2 255 ",
    b"P5\n# CREATOR: map_saver.cpp 0.050 m/pix\n3 2\n255\n",
    b"P5\n#\n3\n#a\n#b\n2 # rows\n255\n", b"P5#glued\n3 2\n255\n", b"P5\n3 2\n255# end\n",
    b"P5\t3\r2\x0b255\x0c", b"P5\n3 2\n255\r",
])  # fmt: skip
@pytest.mark.parametrize("pixels", [PIXELS, PIXELS[:, [1, 0, 2]]], ids=["0 first", "10 first"])
def test_headers_with_comments_and_white_space_of_all_kinds(header, pixels):
    assert np.array_equal(decode(header + pixels.tobytes()).samples, pixels)


@pytest.mark.parametrize("header", [
    b"P5\n" + b"#" * 60, b"P5\n" + b"#\n" * 300, b"P5\n" + b"# \n \r#" * 300,
    b"P5\n3 2\n" + b"#25" * 200, b"P5\n3 2\n#255", b"P5\n3 #2\n", b"P5 " + b" " * 70_000,
    b"P5 3 2 #" + b"x" * 70_000 + b"\n255 " + BODY,
], ids=lambda header: str(header[2:22]))  # fmt: skip
def test_a_header_without_its_numbers_is_refused_at_once(header):
    with pytest.raises(MalformedInputError, match="the file ends early"):
        decode(header)


def test_long_plain_pictures_are_read_piece_by_piece_as_if_at_once():
    rng = np.random.default_rng(5)
    pixels = rng.integers(0, 999, (300, 700))
    words = [str(value) for value in pixels.reshape(-1).tolist()]
    blanks = rng.choice([" ", "\n", "\t \r\n"], len(words)).tolist()
    text = "".join(word + blank for word, blank in zip(words, blanks, strict=True))
    assert len(text) > 3 << 18
    head = b"P2 700 300 999\n"
    assert np.array_equal(decode(head + text.encode()).samples, pixels)
    for index in (3, 150_000, len(words) - 1):
        for bad, message in (("1000", "maxval"), ("x", "whole numbers")):
            damaged = " ".join([*words[:index], bad, *words[index + 1 :]])
            with pytest.raises(MalformedInputError, match=f"pixel {index}: .*{message}"):
                decode(head + damaged.encode())
    with pytest.raises(MalformedInputError, match="must hold 210000 pixel values, got 209999"):
        decode(head + " ".join(words[:-1]).encode())
    with pytest.raises(MalformedInputError, match="must hold 210000 pixel values, got 420000"):
        decode(head + " ".join(words + words).encode())


# bitmaps are black where they are 1
BITS = [[0, 255, 0, *[255] * 5, 0], [255, 0, *[255] * 7]]


@pytest.mark.parametrize(("data", "samples", "maxval"), [
    (b"P1\n9 2\n101000001\n0 1 0000000\n", BITS, 255), (b"P4\n9 2\n\xa0\x80\x40\x7f", BITS, 255),
    (b"P6 1 2 255\n\1\2\3\4\5\6", [[[1, 2, 3]], [[4, 5, 6]]], 255),
    (b"P3 1 2 9\n1 2 3 4 5 6\n", [[[1, 2, 3]], [[4, 5, 6]]], 9),
    (b"P5 2 1 1000\n\0\5\3\xe8", [[5, 1000]], 1000),
    (b"P5 2 1 254\n\0\xfe", [[0, 254]], 254),
    (b"P2 3 2 255\n0 10\n# a comment 7 7\n255 13 205 254", PIXELS.tolist(), 255),
])  # fmt: skip
def test_bits_colours_wide_samples_and_text(data, samples, maxval):
    picture = decode(data)
    assert (picture.samples.tolist(), picture.maxval) == (samples, maxval)


@pytest.mark.parametrize(("data", "message"), [
    (b"P5\r\n3 2\r\n255\r\n" + BODY, "DOS"),
    (b"P5 3 2 255\n" + BODY + b"tail", "4 bytes"),
])  # fmt: skip
def test_what_is_read_right_with_a_warning(data, message):
    with pytest.warns(MapdealWarning, match=message):
        assert np.array_equal(decode(data).samples, PIXELS)


@pytest.mark.parametrize(("data", "message"), [
    # a text conversion has damaged the pixels, or eaten one
    (b"P5\r\n3 2\r\n255\r\n" + BODY.replace(b"\n", b"\r\n"), "CRLF-damaged"),
    (b"P5\r\n3 2\r\n255\r" + b"\n" + BODY[1:], "CRLF-damaged"),
    (b"P5 3 2 255\n" + BODY[:-1], "expected 6 bytes, got 5"),
    (b"P5 3 2 255\n" + BODY + b"P5 3 2 255\n" + BODY, "more than one"),
    (b"P5 0 2 255\n", "above 0"), (b"P5 3 2 0\n" + BODY, "maxval"), (b"P5 3", "ends early"),
    (b"P5\n3 2\n255", "the file ends after its header"),
    (b"P5 " + b"9" * 5000 + b" 2 255\n", "width"), (b"P5 3 2 100\n" + BODY, "maxval 100, got 255"),
    *((b"P5 3 2 %d\n" % n + bytes([0, n, 0, 0, n + 1, 0]), f"got {n + 1}") for n in (1, 254)),
    (b"P2 3 2 255\n0 1 2 3 4", "6 pixel values, got 5"),
    (b"P2 3 2 255\n0 1 2 3 4 5 6", "6 pixel values, got 7"),
    (b"P2 3 2 255\n0 1 x 3 4 5", "pixel 2"), (b"P2 3 2 255\n0 1 2 3 256 5", "pixel 4"),
    (b"P1 3 2\n10120 1", "pixel 3"), (b"PF 3 2 -1.0\n" + BODY, "PFM"), (b"P7\nWIDTH 3\n", "PAM"),
])  # fmt: skip
def test_damaged_files_are_refused_with_the_place(data, message):
    with pytest.raises(MalformedInputError, match=message):
        decode(data)


def test_rows_may_be_written_in_any_order(tmp_path):
    rows = np.arange(35, dtype=np.uint8).reshape(7, 5)
    with (tmp_path / "map.pgm").open("wb") as file:
        write_rows = begin_pgm(file, rows, comment="CREATOR: mapdeal 0.05 m/pix")
        for part in (slice(3, 5), slice(0, 3), slice(5, 7)):
            write_rows(part)
    assert np.array_equal(decode((tmp_path / "map.pgm").read_bytes()).samples, rows[::-1])


def test_rows_of_a_picture_are_checked_and_the_pixel_is_counted_from_its_first():
    check_pixels(np.array([[0, 100], [100, 3]], np.uint8), 100, 6, "map.pgm")
    check_pixels(np.array([[255]], np.uint8), 255, 0, "map.pgm")
    with pytest.raises(MalformedInputError, match=r"pixel 9\b.*101") as caught:
        check_pixels(np.array([[0, 100], [4, 101]], np.uint8), 100, 6, "map.pgm")
    assert "map.pgm" in str(caught.value)
