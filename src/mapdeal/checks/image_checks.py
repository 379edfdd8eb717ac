"""Checks of a map's image, and of what readers make of it."""

from __future__ import annotations

import re
from collections.abc import Iterator

from mapdeal.checks.check import check
from mapdeal.checks.facts import PairFacts
from mapdeal.checks.finding import Remark
from mapdeal.formats.image import IMAGE_FORMATS
from mapdeal.formats.map_remarks import MAP_SAVER_UNKNOWN, percent, remark_on_freed

_CARTOGRAPHER_UNKNOWN = 128
_TRINARY = {0, MAP_SAVER_UNKNOWN, 254, 255}
# A number begins where none is before it and has an end, in a long comment of digits, too.
_PER_PIXEL = re.compile(
    r"(?<![0-9.])([0-9]{1,15}(?:\.[0-9]{0,15})?|\.[0-9]{1,15})\s{0,9}m(?:eters?)?/pix"
)


@check(
    "thresholds.unknown-becomes-free",
    "error",
    "map_saver's unknown, grey 205, is read as free in 0.1 % of the cells or more",
)
def unknown_becomes_free(facts: PairFacts) -> Iterator[Remark]:
    """Count them for each reader: free_thresh is above 0.196, or opacity makes them lighter."""
    if facts.pixels.freed:
        text = remark_on_freed(facts.pixels.freed, facts.pixels.size, facts.metadata)
        if text is not None:
            places = facts.places_of_greys(facts.pixels.freed_greys)
            yield Remark(text, "free_thresh", places=places)


@check("thresholds.on-grey", "warning", "a threshold that is exactly a grey of the image")
def on_grey(facts: PairFacts) -> Iterator[Remark]:
    """Look for equality: readers compare in different precision, some with and some without it."""
    if facts.metadata.mode == "raw":
        return
    for key in ("occupied_thresh", "free_thresh"):
        threshold = getattr(facts.metadata, key)
        for grey, count in facts.pixels.greys.items():
            shade = (grey if facts.metadata.negate else 255 - grey) / 255
            if abs(shade - threshold) < 1e-6:
                text = f"{threshold:g} is the shade of grey {grey} ({count} pixels)"
                places = facts.places_of_greys([grey])
                yield Remark(f"{text}: readers disagree on it", key, places=places)


@check("readers.differ", "warning", "cells that nav2, humble and ROS 1 read differently")
def readers_differ(facts: PairFacts) -> Iterator[Remark]:
    """Compare all cells as the three readers have them."""
    pixels = facts.pixels
    for name, cells in pixels.differing.items():
        if cells:
            counts = "; ".join(
                f"{who}: {', '.join(f'{kind} {n}' for kind, n in pixels.counts[who].items() if n)}"
                for who in ("nav2", name)
            )
            share = percent(cells, pixels.size)
            text = f"{cells} cells ({share}) differ between nav2 and {name} ({counts})"
            yield Remark(text, places=facts.places_of_greys(pixels.differing_greys[name]))


@check("image.ending", "note", "an image whose name ends as another format does")
def ending(facts: PairFacts) -> Iterator[Remark]:
    """Compare name and contents; these decide, here and in ROS, but people are misled."""
    suffix, kind = facts.image_path.suffix.lower(), facts.kind.file_format
    if suffix not in IMAGE_FORMATS[kind].suffixes:
        yield Remark(f"{facts.image_path.name} is a {kind} image", "image")


@check("image.maxval", "warning", "a brightness that does not end at 255")
def maxval(facts: PairFacts) -> Iterator[str]:
    """Look at the header of PNM images: readers disagree on other maxvals."""
    if facts.kind.file_format == "PNM" and facts.kind.maxval not in (1, 255):
        yield f"maxval is {facts.kind.maxval}: not all readers scale it"


@check("image.alpha", "note", "pixels that are not opaque")
def alpha(facts: PairFacts) -> Iterator[str]:
    """Count them: they are unknown to Nav2, and averaged into the brightness by ROS 1."""
    count = facts.pixels.not_opaque
    if count:
        share = percent(count, facts.pixels.size)
        yield f"{count} pixels ({share}) are not opaque: unknown to Nav2, grey to ROS 1"


@check("image.gamma", "note", "a gamma or colour profile (PNG gAMA, iCCP), which is not applied")
def gamma(facts: PairFacts) -> Iterator[str]:
    """Look for them: viewers may show other greys than map readers take."""
    if facts.kind.display:
        display = " and ".join(facts.kind.display)
        yield f"{display}: viewers may show other greys than map readers, which ignore it, take"


@check("image.colour", "warning", "pixels that are not grey")
def colour(facts: PairFacts) -> Iterator[str]:
    """Count them: colour becomes grey by rules that differ between readers."""
    count = facts.pixels.coloured
    if count:
        share = percent(count, facts.pixels.size)
        yield f"{count} pixels ({share}) are coloured; readers make grey of them differently"


@check("image.palette", "warning", "an image with a palette, of which ROS 1 reads the indices")
def palette(facts: PairFacts) -> Iterator[str]:
    """Look for a palette: ROS 1 takes the indices for brightness."""
    if facts.kind.colour == "palette" and facts.kind.file_format != "BMP":
        yield "ROS 1 reads indices of the palette, not colours"


@check("image.greys", "note", "greys other than 0, 205, 254 and 255 in a trinary map")
def greys(facts: PairFacts) -> Iterator[Remark]:
    """Count them: of edited or anti-aliased maps, thresholds decide what they are."""
    others = {g: n for g, n in facts.pixels.greys.items() if g not in _TRINARY}
    if others and facts.metadata.mode == "trinary":
        most = sorted(others.items(), key=lambda item: -item[1])[:5]
        shown = ", ".join(f"{grey}: {count}" for grey, count in most)
        rest = f", and {len(others) - len(most)} more greys" if len(others) > len(most) else ""
        text = f"{sum(others.values())} pixels have greys other than 0, 205, 254 ({shown}{rest})"
        yield Remark(text, places=facts.places_of_greys(grey for grey, _ in most))


@check("image.cartographer", "note", "Cartographer's grey for unknown, 128")
def cartographer(facts: PairFacts) -> Iterator[str]:
    """Look for a tenth of the pixels and more."""
    count = facts.pixels.greys.get(_CARTOGRAPHER_UNKNOWN, 0)
    if count > facts.pixels.size / 10:
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
