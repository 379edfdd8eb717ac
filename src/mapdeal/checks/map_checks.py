"""Checks of maps, their YAML and their images."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterator
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

import numpy as np

from mapdeal.checks.facts import GridFacts, PairFacts, RoomFacts, check, without_rounding_noise
from mapdeal.checks.findings import CHECKS, Finding, Remark, declare_check, places_of
from mapdeal.errors import FileAccessError
from mapdeal.files.json_values import read_json
from mapdeal.files.source import contents_of, exists, holds
from mapdeal.grid.costmap import UNIFORM_SHARE
from mapdeal.grid.filters import FILTER_KEYS
from mapdeal.grid.values import count_text, decimal_text
from mapdeal.inputs.kinds import kind_of
from mapdeal.inputs.listing import ListedFolders
from mapdeal.maps.dialects import MapMetadata
from mapdeal.maps.images import IMAGE_FORMATS
from mapdeal.maps.map_server import MAP_SAVER_UNKNOWN, NOTHING_KNOWN, percent, remark_on_freed

_UNKNOWN_SHADE = 127 / 255  # of Cartographer's grey, the darkest one in use for unknown
_CARTOGRAPHER_UNKNOWN = 128
_TRINARY = {0, MAP_SAVER_UNKNOWN, 254, 255}
# The bounds on digits keep the search linear in long comments of digits.
_PER_PIXEL = re.compile(
    r"(?<![0-9.])([0-9]{1,15}(?:\.[0-9]{0,15})?|\.[0-9]{1,15})\s{0,9}m(?:eters?)?/pix"
)


@check("thresholds.unknown-becomes-free", "error",
       "map_saver's unknown, grey 205, is read as free in 0.1 % of the cells or more")  # fmt: skip
def unknown_becomes_free(facts: PairFacts) -> Iterator[Remark]:
    """Count free cells of grey 205; free_thresh above 0.196 or transparency causes them."""
    if facts.pixels.freed:
        text = remark_on_freed(facts.pixels.freed, facts.pixels.size, facts.metadata)
        if text is not None:
            places = facts.places_of_greys(facts.pixels.freed_greys)
            yield Remark(text, "free_thresh", places=places)


@check("thresholds.on-grey", "warning", "a threshold that is exactly a grey of the image")
def on_grey(facts: PairFacts) -> Iterator[Remark]:
    """Compare thresholds with greys; on equality, the result depends on a reader's precision."""
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
    pixels = facts.pixels
    for name, cells in pixels.differing.items():
        if cells:
            counts = "; ".join(
                f"{r}: {', '.join(f'{kind} {n}' for kind, n in pixels.counts[r].items() if n)}"
                for r in ("nav2", name)
            )
            share = percent(cells, pixels.size)
            text = f"{cells} cells ({share}) differ between nav2 and {name} ({counts})"
            yield Remark(text, places=facts.places_of_greys(pixels.differing_greys[name]))


@check("image.ending", "note", "an image with the suffix of another format")
def ending(facts: PairFacts) -> Iterator[Remark]:
    """Compare the file's suffix with its contents; readers go by the contents."""
    suffix, kind = facts.image_path.suffix.lower(), facts.kind.file_format
    if suffix not in IMAGE_FORMATS[kind].suffixes:
        yield Remark(f"{facts.image_path.name} is a {kind} image", "image")


@check("image.maxval", "warning", "a maximum brightness other than 255")
def maxval(facts: PairFacts) -> Iterator[str]:
    if facts.kind.file_format == "PNM" and facts.kind.maxval not in (1, 255):
        yield f"maxval is {facts.kind.maxval}: not all readers scale it"


@check("image.alpha", "note", "pixels that are not opaque")
def alpha(facts: PairFacts) -> Iterator[str]:
    count = facts.pixels.not_opaque
    if count:
        share = percent(count, facts.pixels.size)
        yield f"{count} pixels ({share}) are not opaque: unknown to Nav2, grey to ROS 1"


@check("image.gamma", "note", "a gamma or colour profile (PNG gAMA, iCCP), which is not applied")
def gamma(facts: PairFacts) -> Iterator[str]:
    if facts.kind.display:
        display = " and ".join(facts.kind.display)
        yield f"{display}: viewers may show other greys than map readers, which ignore it, take"


@check("image.colour", "warning", "pixels that are not grey")
def colour(facts: PairFacts) -> Iterator[str]:
    count = facts.pixels.coloured
    if count:
        share = percent(count, facts.pixels.size)
        yield f"{count} pixels ({share}) are coloured; readers make grey of them differently"


@check("image.palette", "warning", "an image with a palette: ROS 1 reads its indices as greys")
def palette(facts: PairFacts) -> Iterator[str]:
    if facts.kind.colour == "palette" and facts.kind.file_format != "BMP":
        yield "ROS 1 reads indices of the palette, not colours"


@check("image.greys", "note", "greys other than 0, 205, 254 and 255 in a trinary map")
def greys(facts: PairFacts) -> Iterator[Remark]:
    """Count unusual greys, as in edited or anti-aliased maps: thresholds decide their state."""
    unusual = {g: n for g, n in facts.pixels.greys.items() if g not in _TRINARY}
    if unusual and facts.metadata.mode == "trinary":
        common = sorted(unusual.items(), key=lambda item: -item[1])[:5]
        shown = ", ".join(f"{grey}: {count}" for grey, count in common)
        rare = len(unusual) - len(common)
        omitted = f", and {rare} more greys" if rare else ""
        total = sum(unusual.values())
        text = f"{total} pixels have greys other than 0, 205, 254 ({shown}{omitted})"
        between = sum(n for grey, n in unusual.items() if _is_between(grey, facts.metadata))
        if between:
            text += f"; {between} of them are neither free nor occupied and become unknown"
        yield Remark(text, places=facts.places_of_greys(grey for grey, _ in common))


def _is_between(grey: int, metadata: MapMetadata) -> bool:
    share = (grey if metadata.negate else 255 - grey) / 255
    return metadata.free_thresh <= share <= metadata.occupied_thresh


_DARKER_THAN_UNKNOWN = 0.05  # least difference in shade of a wall from the darkest grey for unknown
_MOST_FADED = 0.25


@check("map.faded-walls", "warning", "a quarter or more of the walls are too light to be obstacles")
def faded_walls(facts: PairFacts) -> Iterator[Remark]:
    """Count the pixels that are darker than greys for unknown, but too light to be occupied."""
    if facts.metadata.mode != "trinary":
        return
    faded: dict[int, int] = {}
    walls = 0
    for grey, count in facts.pixels.greys.items():
        shade = (grey if facts.metadata.negate else 255 - grey) / 255
        if shade >= facts.metadata.occupied_thresh:
            walls += count
        elif shade > _UNKNOWN_SHADE + _DARKER_THAN_UNKNOWN:
            faded[grey] = count
    count = sum(faded.values())
    if count > _MOST_FADED * (count + walls):
        share = percent(count, count + walls)
        text = f"{count} pixels ({share} of the dark ones) are walls by their grey, and too light"
        text += f" for occupied_thresh {facts.metadata.occupied_thresh:g}: they are no obstacles"
        places = facts.places_of_greys(sorted(faded, key=lambda grey: -faded[grey])[:5])
        yield Remark(text, "occupied_thresh", places=places)


@check("image.cartographer", "note", "Cartographer's grey for unknown, 128")
def cartographer(facts: PairFacts) -> Iterator[str]:
    count = facts.pixels.greys.get(_CARTOGRAPHER_UNKNOWN, 0)
    if count > facts.pixels.size / 10:
        yield f"{count} pixels have grey 128, Cartographer's unknown"


@check("image.comment-resolution", "warning", "a resolution in the image other than the YAML's")
def comment_resolution(facts: PairFacts) -> Iterator[Remark]:
    """Read the comments that map_saver and Cartographer write into the image's header."""
    for comment in facts.comments:
        match = _PER_PIXEL.search(comment)
        if match is None:
            continue
        noted, used = float(match[1]), facts.metadata.resolution
        if abs(noted - used) > 0.51e-3 + 1e-6 * used:  # comments have 3 decimals
            yield Remark(f"the image says {noted:g} m per pixel, the YAML {used:g}", "resolution")


_MIN_ISLAND_AREA = 1.0
"""Square metres at or above which a component of free space is an island, not a speck."""


@check("map.no-obstacle", "warning", "a map without any obstacle")
def no_obstacle(facts: GridFacts) -> Iterator[str]:
    """Report maps without obstacles, because their distance field is infinite everywhere."""
    if not facts.cells.counts["occupied"] and facts.cells.counts["unknown"] < facts.cells.size:
        yield "no cell is occupied; are the thresholds and negate right?"


@check("map.no-free", "warning", "a map without any free cell")
def no_free(facts: GridFacts) -> Iterator[str]:
    if not facts.cells.counts["free"] and facts.cells.counts["unknown"] < facts.cells.size:
        yield "no cell is free; are the thresholds and negate right?"


@check("map.all-unknown", "error", "a map with unknown cells only")
def all_unknown(facts: GridFacts) -> Iterator[str]:
    if facts.cells.counts["unknown"] == facts.cells.size:
        yield NOTHING_KNOWN


@check("map.mostly-unknown", "note", "a small known part on a large unknown canvas")
def mostly_unknown(facts: GridFacts) -> Iterator[Remark]:
    """Compare the bounding box of known cells with the map; gmapping's canvas is often larger."""
    height, width = facts.cells.known_box
    share = height * width / facts.cells.size
    if 0 < share < 0.5:
        text = f"all that is known lies in {width} x {height} cells, {100 * share:.0f} %"
        middle = facts.places([facts.cells.middle_of_known])
        yield Remark(f"{text}: try mapdeal active", places=middle)


_LEAST_CELLS = 1000  # smaller maps are made for tests
_WIDTH_OF_WALLS = 2.0  # cells
_PIECES_OF_WALLS, _LARGEST_PIECE = 10, 0.75


@check("map.inside-out", "warning", "free cells that look like walls, and more cells occupied")
def inside_out(facts: GridFacts) -> Iterator[str]:
    """Judge by the shape of free space: race tracks and keepout masks are mostly occupied, too."""
    cells = facts.cells
    occupied, free = cells.counts["occupied"], cells.counts["free"]
    if not occupied > free > 0 or cells.size < _LEAST_CELLS:
        return
    sizes, counts = cells.free_components
    pieces = int(counts.sum())
    is_thin = cells.mean_free_width < _WIDTH_OF_WALLS
    is_scattered = pieces >= _PIECES_OF_WALLS and sizes[-1] < _LARGEST_PIECE * free
    if pieces > 1 and (is_thin or is_scattered):
        text = f"{occupied} cells are occupied, and the {free} free ones form {pieces} pieces "
        yield f"{text}of {cells.mean_free_width:.2g} cells' width, as walls do; is negate right?"


@check("map.islands", "warning", "free space that cannot be reached from the largest part")
def islands(facts: GridFacts) -> Iterator[Remark]:
    sizes, counts = facts.other_components
    is_large = sizes * facts.frame.resolution**2 >= _MIN_ISLAND_AREA
    count = int(counts[is_large].sum())
    if count:
        area = float((sizes * counts)[is_large].sum()) * facts.frame.resolution**2
        largest = facts.cells.free_components[0][-1] * facts.frame.resolution**2
        parts = "area" if count == 1 else "areas"
        text = (
            f"{count} {parts} of free space, {decimal_text(area, 3)} m2, cannot be reached from"
            f" the largest, {decimal_text(largest)} m2"
        )
        least = int(sizes[is_large][0])
        cells = facts.cells.places_of_components(least, facts.cells.size)
        yield Remark(text, places=facts.places(cells))


@check("map.specks", "note", "small isolated patches of free space")
def specks(facts: GridFacts) -> Iterator[Remark]:
    """Count the smaller components, mostly caused by stray beams."""
    sizes, counts = facts.other_components
    is_small = sizes * facts.frame.resolution**2 < _MIN_ISLAND_AREA
    count = int(counts[is_small].sum())
    if count:
        cells = int((sizes * counts)[is_small].sum())
        text = f"{count_text(count, 'speck')} of free space below 1 m2, {count_text(cells, 'cell')}"
        places = facts.cells.places_of_components(1, int(sizes[is_small][-1]))
        yield Remark(text, places=facts.places(places))


@check("map.open-border", "note", "free cells on the border of the map")
def open_border(facts: GridFacts) -> Iterator[Remark]:
    count = facts.cells.free_on_border
    if count:
        text = f"{count} of {facts.cells.border} cells on the border are free; is the map cut off?"
        yield Remark(text, places=facts.places(facts.cells.free_stretches))


_MOST_PASSAGES, _MOST_PLACES = 10, 20


@check(
    "map.disconnected",
    "warning",
    "areas joined only by passages too narrow for the robot; needs a robot's shape",
)
def disconnected(facts: RoomFacts) -> Iterator[Remark]:
    needed = 2 * facts.radius
    passages = sorted(facts.passages, key=lambda p: -p.cut_off)
    for p in passages[:_MOST_PASSAGES]:
        x, y = round(p.x, 2) + 0.0, round(p.y, 2) + 0.0
        text = (
            f"{decimal_text(p.cut_off)} m2 are cut off by a passage of {p.width:.3g} m at "
            f"{x:.10g}, {y:.10g}; the robot needs more than {needed:.3g} m"
        )
        yield Remark(text, places=places_of([(p.x, p.y)]))
    omitted = passages[_MOST_PASSAGES:]
    if omitted:
        most = decimal_text(omitted[0].cut_off)
        text = f"{len(omitted)} more passages cut off {most} m2 or less each"
        yield Remark(text, places=places_of((p.x, p.y) for p in omitted[:_MOST_PLACES]))


_KNOWN_KEYS = ("image", "resolution", "origin", "mode", "negate", "occupied_thresh", "free_thresh")
_OLD_MODES = ("trinary", "scale", "raw")
_STRING = "tag:yaml.org,2002:str"


@check("yaml.unknown-key", "warning", "a key that map_server does not know")
def unknown_key(facts: PairFacts) -> Iterator[Remark]:
    for key in facts.metadata.extra:
        if key in FILTER_KEYS:  # mapdeal writes these into masks
            continue
        close = difflib.get_close_matches(key, _KNOWN_KEYS, n=1)
        suggestion = f"; did you mean {close[0]}?" if close else ""
        yield Remark(f"unknown key '{key}', which map_server ignores{suggestion}", key)


@check("yaml.mode-case", "warning", "a mode in capitals, which ROS 1 refuses")
def mode_case(facts: PairFacts) -> Iterator[Remark]:
    if "mode" in facts.entries:
        text = facts.entries["mode"].text()
        if text != text.lower():
            yield Remark(f"{text} is refused by ROS 1; write {text.lower()}", "mode")


@check("yaml.image-unquoted", "warning", "an image name that YAML takes for a date or number")
def image_unquoted(facts: PairFacts) -> Iterator[Remark]:
    """Check the type of the name: ROS reads the text, other readers the value."""
    node = facts.entries["image"].node
    if node.tag != _STRING:
        yield Remark(f"{facts.metadata.image} is not text in YAML; put it in quotes", "image")


@check("yaml.resolution-noise", "warning",
       "a resolution with rounding noise, such as 0.05000000074505806")  # fmt: skip
def resolution_noise(facts: PairFacts) -> Iterator[Remark]:
    """Report the exact decimal: cells are displaced from those of maps with that resolution."""
    value = facts.metadata.resolution
    plain = without_rounding_noise(value)
    if plain is not None:
        yield Remark(
            f"{value!r} is {plain!r} stored as a 32-bit float; write {plain!r}", "resolution"
        )


@check("yaml.resolution-unusual", "warning", "cells larger than 10 m or smaller than 1 mm")
def resolution_unusual(facts: PairFacts) -> Iterator[Remark]:
    value = facts.metadata.resolution
    if not 1e-3 <= value <= 10:
        yield Remark(f"{value:g} m per cell is unusual; is the unit right?", "resolution")


@check("yaml.origin-noise", "note", "an origin with rounding noise, such as -10.000000149011612")
def origin_noise(facts: PairFacts) -> Iterator[Remark]:
    for name, value in zip(("x", "y", "yaw"), facts.metadata.origin, strict=True):
        plain = without_rounding_noise(value)
        if plain is not None:
            yield Remark(f"{name} {value!r} is {plain!r} with the noise of rounding", "origin")


@check("yaml.origin-yaw", "warning", "a map with a yaw, which costmap_2d and AMCL ignore")
def origin_yaw(facts: PairFacts) -> Iterator[Remark]:
    yaw = facts.metadata.origin[2]
    if yaw:
        yield Remark(f"yaw {yaw:g} rad is ignored by costmap_2d and AMCL", "origin")


@check("yaml.origin-off-lattice", "note", "an origin that is not a multiple of the resolution")
def origin_off_lattice(facts: PairFacts) -> Iterator[Remark]:
    """Compare origin and resolution: cells of different maps coincide only on the lattice."""
    x, y, _ = facts.metadata.origin
    cells = np.array([x, y]) / facts.metadata.resolution
    if np.abs(cells - np.rint(cells)).max() > 1e-3:
        yield Remark(f"{x:g}, {y:g} is not a multiple of {facts.metadata.resolution:g} m", "origin")


@check("yaml.origin-far", "warning", "an origin too far for the 32-bit floats of some readers")
def origin_far(facts: PairFacts) -> Iterator[Remark]:
    """Compare a 32-bit float's step at the origin with the resolution, as for UTM coordinates."""
    step = max(float(np.spacing(np.float32(abs(v)))) for v in facts.metadata.origin[:2])
    if step > facts.metadata.resolution / 10:
        yield Remark(f"32-bit floats have steps of {step:g} m there", "origin")


@check("image.absolute-path", "warning", "an absolute path, which is valid on one machine only")
def absolute_path(facts: PairFacts) -> Iterator[Remark]:
    name = facts.metadata.image
    if PurePosixPath(name).is_absolute() or PureWindowsPath(name).is_absolute():
        yield Remark(f"{name} is absolute; write {facts.image_path.name}", "image")


@check("image.outside-folder", "note", "an image that is not beside its YAML file")
def outside_folder(facts: PairFacts) -> Iterator[Remark]:
    name = facts.metadata.image
    if ".." in PurePosixPath(name).parts:
        yield Remark(f"{name} leaves the folder of the YAML file", "image")


MANIFEST = "manifest.json"
LOCAL_FOLDER = "local"


def is_run(folder: Path) -> bool:
    """Return whether the manifest in a folder is a run's, or is damaged."""
    # Other programs write a manifest.json, too; their folders may contain maps.
    manifest = read_json(folder / MANIFEST)
    return manifest is None or (isinstance(manifest, dict) and "outputs" in manifest)


RUN_FOLDERS = ListedFolders(MANIFEST, is_run, "summary.json", parts=(LOCAL_FOLDER,))
"""Rule that distinguishes folders of runs from folders of maps."""

declare_check(
    "run.no-manifest", "error", "a folder without a map, and without the manifest of a run"
)
declare_check("run.missing-file", "error", "a file that the manifest lists is gone")
declare_check(
    "run.other-file", "error", "a file is not the manifest's: changed, or of a run that was killed"
)
declare_check(
    "run.uniform-cost",
    "warning",
    "uninformative costs: nearly all cells have the same, or none is open",
)


def lint_run(folder: Path) -> list[Finding]:
    # Includes the local map, if the run has made one.
    try:
        _, files = contents_of(folder)
    except FileAccessError as error:
        return [CHECKS["file.access"].finding(folder, str(error).removeprefix(f"{folder}: "))]
    manifest = read_json(folder / MANIFEST)
    outputs = manifest.get("outputs") if isinstance(manifest, dict) else None
    if not isinstance(outputs, dict) or not outputs:
        kind = kind_of(folder)
        if kind is not None:
            text = f"is {kind.what}, not a folder of maps or of a run ({kind.use})"
            return [CHECKS["run.no-manifest"].finding(folder, text)]
        text = f"has no {MANIFEST} of a run, and no map in it or below: no .yaml with the key image"
        text += "; --params-file checks a robot's parameters"
        if MANIFEST in files:
            text = f"its {MANIFEST} is not that of a run"
        return [CHECKS["run.no-manifest"].finding(folder, text)]
    findings = [*_check_outputs(folder, outputs), *_check_costs(folder, manifest.get("figures"))]
    if exists(folder / LOCAL_FOLDER / MANIFEST):
        findings += lint_run(folder / LOCAL_FOLDER)
    return findings


def _check_outputs(folder: Path, outputs: dict[str, Any]) -> Iterator[Finding]:
    for name, digest in outputs.items():
        path = folder / Path(name).name
        if not exists(path):
            yield CHECKS["run.missing-file"].finding(folder, f"{path.name} is gone")
        elif not holds(path, str(digest)):
            text = f"{path.name} is not the file that the manifest lists"
            yield CHECKS["run.other-file"].finding(folder, text)


def _check_costs(folder: Path, figures: object) -> Iterator[Finding]:
    for stage, costs in figures.items() if isinstance(figures, dict) else ():
        if not isinstance(costs, dict) or "most_common" not in costs:
            continue
        common = costs["most_common"]
        if common is None:
            yield CHECKS["run.uniform-cost"].finding(folder, f"{stage}: no cell is open")
        elif isinstance(common, dict):
            share, cost = common.get("share"), common.get("cost")
            if isinstance(share, float) and share > UNIFORM_SHARE:
                text = f"{stage}: {100 * share:.4g} % of the open cells cost {cost}"
                yield CHECKS["run.uniform-cost"].finding(folder, text)
