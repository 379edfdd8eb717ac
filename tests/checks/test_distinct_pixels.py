"""Pixels are counted as if they had been taken one by one."""

from collections import Counter

import numpy as np
import pytest

from mapdeal.checks import facts as distinct_pixels
from mapdeal.checks.facts import DistinctPixels
from mapdeal.maps.picture import Picture

RNG = np.random.default_rng(7)
SHAPE = (23, 17)


def values(most, *more, dtype=np.uint8):
    return RNG.integers(0, most + 1, (*SHAPE, *more)).astype(dtype)


def mostly(full, other, dtype=np.uint8):
    # a number alone would have to fit the other's type
    return np.where(RNG.random(SHAPE) < 0.8, np.array(full, dtype), other).astype(dtype)


def greyish(most, dtype=np.uint8):
    """Colours that are grey for the most part."""
    samples = np.repeat(values(most, 1, dtype=dtype), 3, axis=2)
    samples[3:5, 4:9, 1] //= 2
    return samples


PALETTE = RNG.integers(0, 256, (200, 4)).astype(np.uint8)
PICTURES = {
    "grey": Picture("PNM", "grey", values(255)),
    "grey of a low maxval": Picture("PNM", "grey", values(15), maxval=15),
    "16 bit": Picture("PNG", "grey", values(65535, dtype=np.uint16), maxval=65535),
    "10 bit": Picture("PNM", "grey", values(1023, dtype=np.uint16), maxval=1023),
    "grey and opacity": Picture("PNG", "grey", values(3), alpha=mostly(255, values(255))),
    "16 bit and opacity": Picture(
        "PNG", "grey", values(65535, dtype=np.uint16), maxval=65535,
        alpha=mostly(65535, values(65535), np.uint16), alpha_from="key",
    ),
    "palette": Picture("PNG", "palette", values(199), palette=PALETTE),
    "rgb": Picture("PNG", "rgb", greyish(255)),
    "coloured": Picture("PNG", "rgb", values(2, 3)),
    "wide rgb": Picture("PNM", "rgb", greyish(999, np.uint16), maxval=999),
    "rgba": Picture("PNG", "rgb", greyish(255), alpha=mostly(255, values(2))),
    "see-through": Picture("PNG", "rgb", greyish(9), alpha=np.zeros(SHAPE, np.uint8)),
}  # fmt: skip


def one_by_one(picture):
    samples = picture.samples.reshape(
        -1, picture.samples.shape[2] if picture.samples.ndim == 3 else 1
    )
    found = samples.tolist()
    if picture.alpha is not None:
        found = [
            [*pixel, a] for pixel, a in zip(found, picture.alpha.reshape(-1).tolist(), strict=True)
        ]
    return Counter(map(tuple, found))


def kind_of(picture):
    """All but the pixels."""
    return {k: v for k, v in vars(picture).items() if k not in ("samples", "alpha", "palette")}


@pytest.mark.parametrize(("together", "kept"), [(1 << 17, 1 << 18), (40, 5)])
@pytest.mark.parametrize("name", PICTURES)
def test_counts_are_those_of_taking_pixels_one_by_one(name, together, kept, monkeypatch):
    monkeypatch.setattr(distinct_pixels, "_PIXELS_TOGETHER", together)
    monkeypatch.setattr(distinct_pixels, "_MOST_KEPT", kept)
    picture = PICTURES[name]
    told = Counter()

    def tell(pixels, counts):
        assert kind_of(pixels) == kind_of(picture)
        assert pixels.samples.dtype == picture.samples.dtype
        assert pixels.shape == (1, len(counts))
        seen = one_by_one(pixels)
        assert set(seen.values()) == {1}
        told.update(dict(zip(seen, counts.tolist(), strict=True)))

    pixels = DistinctPixels(tell)
    for band in picture.bands(60):
        pixels.add(band)
    pixels.finish()
    pixels.finish()  # has nothing more to tell
    assert told == one_by_one(picture)


def test_without_pixels_nothing_is_told():
    DistinctPixels(pytest.fail).finish()


def test_bands_of_a_picture_are_all_of_it():
    picture = PICTURES["rgba"]
    bands = list(picture.bands(60))
    assert [band.shape for band in bands] == [(3, 17)] * 7 + [(2, 17)]
    assert np.array_equal(np.concatenate([band.samples for band in bands]), picture.samples)
    assert np.array_equal(np.concatenate([band.alpha for band in bands]), picture.alpha)
    assert [band.shape for band in picture.bands(1)] == [(1, 17)] * 23
