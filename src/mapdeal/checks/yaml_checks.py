"""Checks of a map's YAML file."""

from __future__ import annotations

import difflib
from collections.abc import Iterator
from pathlib import PurePosixPath, PureWindowsPath

import numpy as np

from mapdeal.checks.check import check
from mapdeal.checks.facts import PairFacts
from mapdeal.checks.finding import Remark
from mapdeal.checks.rounding import without_rounding_noise

_KNOWN = ("image", "resolution", "origin", "mode", "negate", "occupied_thresh", "free_thresh")
_OLD_MODES = ("trinary", "scale", "raw")
_STRING = "tag:yaml.org,2002:str"


@check("yaml.unknown-key", "warning", "a key that map_server does not know")
def unknown_key(facts: PairFacts) -> Iterator[Remark]:
    """Name the known key that it may be meant to be."""
    for key in facts.metadata.extra:
        near = difflib.get_close_matches(key, _KNOWN, n=1)
        meant = f"; did you mean {near[0]}?" if near else ""
        yield Remark(f"unknown key '{key}', which map_server ignores{meant}", key)


@check("yaml.mode-case", "warning", "a mode in capitals, which ROS 1 refuses")
def mode_case(facts: PairFacts) -> Iterator[Remark]:
    """Compare letter by letter, as ROS 1 does."""
    if "mode" in facts.entries:
        text = facts.entries["mode"].text()
        if text != text.lower():
            yield Remark(f"{text} is refused by ROS 1; write {text.lower()}", "mode")


@check("yaml.image-unquoted", "warning", "an image name that YAML takes for a date or number")
def image_unquoted(facts: PairFacts) -> Iterator[Remark]:
    """Look at its type: the readers of ROS take the text, others the value."""
    node = facts.entries["image"].node
    if node.tag != _STRING:
        yield Remark(f"{facts.metadata.image} is not text in YAML; put it in quotes", "image")


@check(
    "yaml.resolution-noise",
    "warning",
    "a resolution with the noise of rounding: 0.05000000074505806",
)
def resolution_noise(facts: PairFacts) -> Iterator[Remark]:
    """Name the decimal: cells lie a little off where other maps of that resolution have them."""
    value = facts.metadata.resolution
    plain = without_rounding_noise(value)
    if plain is not None:
        yield Remark(
            f"{value!r} is {plain!r} stored as a 32-bit float; write {plain!r}", "resolution"
        )


@check("yaml.resolution-unusual", "warning", "cells larger than 10 m or smaller than 1 mm")
def resolution_unusual(facts: PairFacts) -> Iterator[Remark]:
    """Look at the size: often a unit is wrong."""
    value = facts.metadata.resolution
    if not 1e-3 <= value <= 10:
        yield Remark(f"{value:g} m per cell is unusual; is the unit right?", "resolution")


@check("yaml.origin-noise", "note", "an origin with the noise of rounding, as -10.000000149011612")
def origin_noise(facts: PairFacts) -> Iterator[Remark]:
    """Name the decimal of each number."""
    for name, value in zip(("x", "y", "yaw"), facts.metadata.origin, strict=True):
        plain = without_rounding_noise(value)
        if plain is not None:
            yield Remark(f"{name} {value!r} is {plain!r} with the noise of rounding", "origin")


@check("yaml.origin-yaw", "warning", "a map that is turned, which costmap_2d and AMCL ignore")
def origin_yaw(facts: PairFacts) -> Iterator[Remark]:
    """Look for a yaw: mapdeal honours it, much of ROS does not."""
    yaw = facts.metadata.origin[2]
    if yaw:
        yield Remark(f"yaw {yaw:g} rad is ignored by costmap_2d and AMCL", "origin")


@check("yaml.origin-off-lattice", "note", "an origin that is not a multiple of the resolution")
def origin_off_lattice(facts: PairFacts) -> Iterator[Remark]:
    """Compare them: layers of different maps do not share their cells then."""
    x, y, _ = facts.metadata.origin
    cells = np.array([x, y]) / facts.metadata.resolution
    if np.abs(cells - np.rint(cells)).max() > 1e-3:
        yield Remark(f"{x:g}, {y:g} is not a multiple of {facts.metadata.resolution:g} m", "origin")


@check("yaml.origin-far", "warning", "an origin too far for the 32-bit floats of some readers")
def origin_far(facts: PairFacts) -> Iterator[Remark]:
    """Compare the step of such floats with the resolution, of UTM coordinates for example."""
    step = max(float(np.spacing(np.float32(abs(v)))) for v in facts.metadata.origin[:2])
    if step > facts.metadata.resolution / 10:
        yield Remark(f"32-bit floats have steps of {step:g} m there", "origin")


@check("image.absolute-path", "warning", "an absolute path, which holds on one machine")
def absolute_path(facts: PairFacts) -> Iterator[Remark]:
    """Name the path that is relative to the YAML file."""
    name = facts.metadata.image
    if PurePosixPath(name).is_absolute() or PureWindowsPath(name).is_absolute():
        yield Remark(f"{name} is absolute; write {facts.image_path.name}", "image")


@check("image.outside-folder", "note", "an image that is not beside its YAML file")
def outside_folder(facts: PairFacts) -> Iterator[Remark]:
    """Look for steps out of the folder: copying the pair needs care then."""
    name = facts.metadata.image
    if ".." in PurePosixPath(name).parts:
        yield Remark(f"{name} leaves the folder of the YAML file", "image")
