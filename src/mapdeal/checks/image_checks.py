"""Checks of a map's image, and of what readers make of it."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np

from mapdeal.checks.check import check
from mapdeal.checks.facts import MAP_SAVER_UNKNOWN, PairFacts, counts_of
from mapdeal.checks.finding import Remark
from mapdeal.formats.images.catalogue import IMAGE_FORMATS

_CARTOGRAPHER_UNKNOWN = 128
_TRINARY = {0, MAP_SAVER_UNKNOWN, 254, 255}
# A number begins where none is before it and has an end, in a long comment of digits, too.
_PER_PIXEL = re.compile(
    r"(?<![0-9.])([0-9]{1,15}(?:\.[0-9]{0,15})?|\.[0-9]{1,15})\s{0,9}m(?:eters?)?/pix"
)


@check("thresholds.unknown-becomes-free", "error", "map_saver's unknown, grey 205, is read as free")
def unknown_becomes_free(facts: PairFacts) -> Iterator[Remark]:
    """Count the cells that a free_thresh above 0.196 makes free, for each reader."""
    if MAP_SAVER_UNKNOWN not in facts.greys or facts.metadata.mode == "raw":
        return
    is_grey = facts.picture.samples[::-1] == MAP_SAVER_UNKNOWN
    free = {name: int((is_grey & (cells == 0)).sum()) for name, cells in facts.readings.items()}
    if any(free.values()):
        counts = ", ".join(f"{name} {count}" for name, count in free.items())
        rule = f"free_thresh {facts.metadata.free_thresh:g} makes cells of grey 205 free"
        yield Remark(
            f"{rule}, which map_saver writes for unknown: {counts}; 0.196 does not", "free_thresh"
        )


@check("thresholds.on-grey", "warning", "a threshold that is exactly a grey of the image")
def on_grey(facts: PairFacts) -> Iterator[Remark]:
    """Look for equality: readers compare in different precision, some with and some without it."""
    if facts.metadata.mode == "raw":
        return
    for key in ("occupied_thresh", "free_thresh"):
        threshold = getattr(facts.metadata, key)
        for grey, count in facts.greys.items():
            shade = (grey if facts.metadata.negate else 255 - grey) / 255
            if abs(shade - threshold) < 1e-6:
                text = f"{threshold:g} is the shade of grey {grey} ({count} pixels)"
                yield Remark(f"{text}: readers disagree on it", key)


@check("readers.differ", "warning", "cells that nav2, humble and ROS 1 read differently")
def readers_differ(facts: PairFacts) -> Iterator[str]:
    """Compare all cells as the three readers have them."""
    if not facts.readings:
        return
    base = facts.readings["nav2"]
    for name in ("humble", "ros1"):
        other = facts.readings[name]
        cells = int(np.count_nonzero(base != other))
        if cells:
            counts = "; ".join(
                f"{who}: {', '.join(f'{kind} {n}' for kind, n in counts_of(grid).items() if n)}"
                for who, grid in (("nav2", base), (name, other))
            )
            yield f"{cells} cells differ between nav2 and {name} ({counts})"


@check("image.ending", "note", "an image whose name ends as another format does")
def ending(facts: PairFacts) -> Iterator[Remark]:
    """Compare name and contents; these decide, here and in ROS, but people are misled."""
    suffix, kind = facts.image_path.suffix.lower(), facts.picture.file_format
    if suffix not in IMAGE_FORMATS[kind].suffixes:
        yield Remark(f"{facts.image_path.name} is a {kind} image", "image")


@check("image.maxval", "warning", "a brightness that does not end at 255")
def maxval(facts: PairFacts) -> Iterator[str]:
    """Look at the header of PNM images: readers disagree on other maxvals."""
    if facts.picture.file_format == "PNM" and facts.picture.maxval not in (1, 255):
        yield f"maxval is {facts.picture.maxval}: not all readers scale it"


@check("image.alpha", "note", "pixels that are not opaque")
def alpha(facts: PairFacts) -> Iterator[str]:
    """Count them: they are unknown to Nav2, and averaged into the brightness by ROS 1."""
    opacity = facts.picture.alpha
    if opacity is not None:
        full = 255 if facts.picture.colour == "palette" else facts.picture.maxval
        count = int(np.count_nonzero(opacity < full))
        if count:
            yield f"{count} pixels are not opaque: unknown to Nav2, grey to ROS 1"


@check("image.gamma", "note", "a gamma or colour profile (PNG gAMA, iCCP), which is not applied")
def gamma(facts: PairFacts) -> Iterator[str]:
    """Look for them: viewers may show other greys than map readers take."""
    if facts.picture.display:
        display = " and ".join(facts.picture.display)
        yield f"{display}: viewers may show other greys than map readers, which ignore it, take"


@check("image.colour", "warning", "pixels that are no grey")
def colour(facts: PairFacts) -> Iterator[str]:
    """Count them: colour becomes grey by rules that differ between readers."""
    if facts.picture.colour == "rgb":
        samples = facts.picture.samples
        count = int(np.count_nonzero((samples != samples[..., :1]).any(axis=2)))
        if count:
            yield f"{count} pixels are coloured; readers make grey of them differently"


@check("image.palette", "warning", "an image with a palette, of which ROS 1 reads the indices")
def palette(facts: PairFacts) -> Iterator[str]:
    """Look for a palette: ROS 1 takes the indices for brightness."""
    if facts.picture.colour == "palette" and facts.picture.file_format != "BMP":
        yield "ROS 1 reads indices of the palette, not colours"


@check("image.greys", "note", "greys other than 0, 205, 254 and 255 in a trinary map")
def greys(facts: PairFacts) -> Iterator[str]:
    """Count them: of edited or anti-aliased maps, thresholds decide what they are."""
    others = {g: n for g, n in facts.greys.items() if g not in _TRINARY}
    if others and facts.metadata.mode == "trinary":
        most = sorted(others.items(), key=lambda item: -item[1])[:5]
        shown = ", ".join(f"{grey}: {count}" for grey, count in most)
        rest = f", and {len(others) - len(most)} more greys" if len(others) > len(most) else ""
        yield f"{sum(others.values())} pixels have greys other than 0, 205, 254 ({shown}{rest})"


@check("image.cartographer", "note", "Cartographer's grey for unknown, 128")
def cartographer(facts: PairFacts) -> Iterator[str]:
    """Look for a tenth of the pixels and more."""
    count = facts.greys.get(_CARTOGRAPHER_UNKNOWN, 0)
    if count > facts.picture.samples.size / 10:
        yield f"{count} pixels have grey 128, Cartographer's unknown"


@check("image.comment-resolution", "warning", "a resolution in the image that is not the YAML's")
def comment_resolution(facts: PairFacts) -> Iterator[Remark]:
    """Read the comments that map_saver and Cartographer write into the image's header."""
    for comment in facts.comments:
        match = _PER_PIXEL.search(comment)
        if match is None:
            continue
        noted, used = float(match[1]), facts.metadata.resolution
        if abs(noted - used) > 0.51e-3 + 1e-6 * used:  # it is written with 3 decimals
            yield Remark(f"the image says {noted:g} m per pixel, the YAML {used:g}", "resolution")
