"""Checks of maps, their YAML and their images."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

import numpy as np

from mapdeal.checks.facts import GridFacts, PairFacts, RoomFacts, check, without_rounding_noise
from mapdeal.checks.findings import CHECKS, Check, Finding, Remark, declare_checks
from mapdeal.errors import FileAccessError, one_line
from mapdeal.files import json_values, source
from mapdeal.grid import costmap, filters
from mapdeal.grid.values import count_text, decimal_text
from mapdeal.kernels.rotations import coincidences
from mapdeal.maps import dialects, kinds, listing, map_file
from mapdeal.maps.map_server import MAP_SAVER_UNKNOWN, percent, remark_on_freed

_UNKNOWN_SHADE = 127 / 255  # of Cartographer's grey, the darkest one in use for unknown
_CARTOGRAPHER_UNKNOWN = 128
_TRINARY = {0, MAP_SAVER_UNKNOWN, 254, 255}
# The bounds on digits keep the search linear in long comments of digits.
_PER_PIXEL = re.compile(
    r"(?<![0-9.])([0-9]{1,15}(?:\.[0-9]{0,15})?|\.[0-9]{1,15})\s{0,9}m(?:eters?)?/pix"
)


@check("thresholds.unknown-becomes-free", "error")
def unknown_becomes_free(facts: PairFacts) -> Iterator[Remark]:
    """The grey of unknown, 205, is read as free in 0.1 % of the cells or more.
    Planners lead the robot through unexplored space, where walls and stairs may be.
    Example: `free_thresh: 0.25`, above the shade 0.196 of grey 205.
    Fix: Write free_thresh: 0.196, or run lint --fix.
    """
    pixels = facts.pixels
    text = remark_on_freed(pixels.freed, pixels.size, facts.metadata) if pixels.freed else None
    if text is not None:
        yield Remark(text, "free_thresh", places=facts.places_of_greys(pixels.freed_greys))


@check("thresholds.on-grey", "warning")
def on_grey(facts: PairFacts) -> Iterator[Remark]:
    """A threshold that is exactly a grey of the image.
    Readers compare in different precision: cells are obstacles for some and unknown for others.
    Example: `free_thresh: 0.2` and pixels of grey 204.
    Fix: Move the threshold by 0.01.
    """
    if facts.metadata.mode == "raw":
        return
    for key in ("occupied_thresh", "free_thresh"):
        threshold = getattr(facts.metadata, key)
        if facts.metadata.mode == "scale" and threshold in (0, 1):
            continue  # usual for scale: readers.differ counts cells that really differ
        for grey, count in facts.pixels.greys.items():
            if abs(_shade(grey, facts) - threshold) < 1e-6:
                text = f"{threshold:g} is the shade of grey {grey} ({count} pixels)"
                text += ": readers disagree on it; move it by 0.01"
                yield Remark(text, key, places=facts.places_of_greys([grey]))


@check("readers.differ", "warning")
def readers_differ(facts: PairFacts) -> Iterator[Remark]:
    """Cells that nav2, humble and ROS 1 read differently.
    After a change of ROS the robot has other obstacles or other free space on the same files.
    Example: `occupied_thresh: 0.6` and pixels of grey 102.
    Fix: Write the map anew with mapdeal convert.
    """
    pixels = facts.pixels
    readers: dict[tuple[int, str], list[dialects.Dialect]] = {}  # those that agree share a finding
    for name, cells in pixels.differing.items():
        if cells:
            readers.setdefault((cells, _counts_text(pixels.counts[name])), []).append(name)
    for (cells, counts), names in readers.items():
        text = f"{cells} cells ({percent(cells, pixels.size)}) differ between nav2 and "
        listed = ", ".join(names)
        text += f"{listed} (nav2: {_counts_text(pixels.counts['nav2'])}; {listed}: {counts}); "
        text += "mapdeal convert writes a map that all read alike"
        greys = (grey for name in names for grey in pixels.differing_greys[name])
        yield Remark(text, places=facts.places_of_greys(dict.fromkeys(greys)))


def _counts_text(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{kind} {count}" for kind, count in counts.items() if count)


@check("image.maxval", "warning")
def maxval(facts: PairFacts) -> Iterator[str]:
    """A maximum brightness other than 255.
    Readers that do not scale greys take white for dark: free space becomes unknown or occupied.
    Example: A PGM with the maximum 127.
    Fix: Run mapdeal convert, which writes 255.
    """
    if facts.kind.file_format == "PNM" and facts.kind.maxval not in (1, 255):
        yield f"maxval is {facts.kind.maxval}: not all readers scale it; mapdeal convert writes 255"


@check("image.alpha", "note")
def alpha(facts: PairFacts) -> Iterator[str]:
    """Pixels that are not opaque.
    Nav2 makes them unknown, ROS 1 reads their grey: planners of both take different ways.
    Example: A PNG whose background was erased in an editor.
    Fix: Save the image without transparency.
    """
    if count := facts.pixels.not_opaque:
        text = f"{count} pixels ({percent(count, facts.pixels.size)}) are not opaque: unknown to "
        yield f"{text}Nav2, grey to ROS 1; make them opaque"


@check("image.gamma", "note", on_request=True)
def gamma(facts: PairFacts) -> Iterator[str]:
    """A gamma or colour profile (PNG gAMA, iCCP), which is not applied.
    The robot is not affected: map readers ignore it. Viewers may show other greys than it reads.
    Example: A PNG saved by GIMP with its profile.
    Fix: Export without a colour profile.
    """
    if display := " and ".join(facts.kind.display):
        yield f"{display}: viewers may show other greys than map readers, which ignore it, take"


@check("image.colour", "warning")
def colour(facts: PairFacts) -> Iterator[str]:
    """Pixels that are not grey.
    Readers compute grey from colour differently: marks may be walls for some robots only.
    Example: An orange note drawn on a map.
    Fix: Convert the image to greys.
    """
    if count := facts.pixels.coloured:
        text = f"{count} pixels ({percent(count, facts.pixels.size)}) are coloured; readers make "
        yield f"{text}grey of them differently: save the image in grey"


@check("image.palette", "warning")
def palette(facts: PairFacts) -> Iterator[str]:
    """An image with a palette: ROS 1 reads its indices as greys.
    In ROS 1 the robot gets another map, often with no free space at all.
    Example: A PNG with 8 colours, as optimisers write it.
    Fix: Save the image in mode grey.
    """
    if facts.kind.colour == "palette" and facts.kind.file_format != "BMP":
        yield "ROS 1 reads indices of the palette, not colours; save the image in grey"


@check("image.greys", "note")
def greys(facts: PairFacts) -> Iterator[Remark]:
    """Greys other than 205 that become unknown in a trinary map.
    Blurred edges and drawn marks become unknown cells: planners avoid or cross them, as set.
    Example: Grey 120 along walls after the image was scaled.
    Fix: Check the thresholds, or save 0, 205 and 254 only.
    """
    if facts.metadata.mode != "trinary":
        return
    usual = _TRINARY | {_CARTOGRAPHER_UNKNOWN} if _unknown_of_cartographer(facts) else _TRINARY
    low, high = facts.metadata.free_thresh, facts.metadata.occupied_thresh
    counts = facts.pixels.greys.items()
    unusual = {grey: n for grey, n in counts if low <= _shade(grey, facts) <= high}
    unusual = {grey: n for grey, n in unusual.items() if grey not in usual}
    if unusual:
        common = sorted(unusual.items(), key=lambda item: -item[1])[:5]
        shown = ", ".join(f"{grey}: {count}" for grey, count in common)
        rare = len(unusual) - len(common)
        omitted = f", and {rare} more greys" if rare else ""
        text = f"{sum(unusual.values())} pixels are neither free nor occupied and become unknown "
        text += f"({shown}{omitted}); check the thresholds"
        yield Remark(text, places=facts.places_of_greys(grey for grey, _ in common))


def _shade(grey: int, facts: PairFacts) -> float:
    return (grey if facts.metadata.negate else 255 - grey) / 255


_DARKER_THAN_UNKNOWN = 0.05  # least difference in shade of a wall from the darkest grey for unknown
_MOST_FADED = 0.25


@check("map.faded-walls", "warning")
def faded_walls(facts: PairFacts) -> Iterator[Remark]:
    """A quarter or more of the walls are too light to be obstacles.
    Neither planner nor localisation sees these walls, and the robot may drive into them.
    Example: Walls of grey 110 with `occupied_thresh: 0.65`.
    Fix: Lower occupied_thresh below the walls' shade.
    """
    if facts.metadata.mode != "trinary":
        return
    faded: dict[int, int] = {}
    walls = 0
    for grey, count in facts.pixels.greys.items():
        shade = _shade(grey, facts)
        if shade >= facts.metadata.occupied_thresh:
            walls += count
        elif shade > _UNKNOWN_SHADE + _DARKER_THAN_UNKNOWN:
            faded[grey] = count
    count = sum(faded.values())
    if count > _MOST_FADED * (count + walls):
        share = percent(count, count + walls)
        text = f"{count} pixels ({share} of the dark ones) are walls by their grey, and too light"
        text += f" for occupied_thresh {facts.metadata.occupied_thresh:g}: they are no obstacles"
        lightest = max(faded) if not facts.metadata.negate else 255 - min(faded)
        text += f"; write {math.floor(99 * (255 - lightest) / 255) / 100:g}"
        places = facts.places_of_greys(sorted(faded, key=lambda grey: -faded[grey])[:5])
        yield Remark(text, "occupied_thresh", places=places)


@check("image.cartographer", "note", on_request=True)
def cartographer(facts: PairFacts) -> Iterator[str]:
    """The grey that Cartographer writes for unknown, 128.
    With usual thresholds it is read as unknown, rightly. A free_thresh above 0.5 makes it free.
    Example: A map from cartographer_pbstream_to_ros_map.
    Fix: Nothing, with free_thresh below 0.49.
    """
    if count := _unknown_of_cartographer(facts):
        yield f"{count} pixels have grey 128, Cartographer's unknown"


def _unknown_of_cartographer(facts: PairFacts) -> int:
    count = facts.pixels.greys.get(_CARTOGRAPHER_UNKNOWN, 0)
    return count if count > facts.pixels.size / 10 else 0


@check("image.comment-resolution", "warning")
def comment_resolution(facts: PairFacts) -> Iterator[Remark]:
    """An image's resolution that differs from the YAML's.
    With a wrong cell size, all distances are wrong: the robot misses doors and does not localise.
    Example: `0.050 m/pix` in the PGM and 0.1 in the YAML.
    Fix: Measure a known wall, and correct the YAML.
    """
    used = facts.metadata.resolution
    for match in filter(None, map(_PER_PIXEL.search, facts.comments)):
        noted = float(match[1])
        if abs(noted - used) > 0.51e-3 + 1e-6 * used:  # comments have 3 decimals
            text = f"the image says {noted:g} m per pixel, the YAML {used:g}; measure a wall"
            yield Remark(text, "resolution")


_MIN_ISLAND_AREA = 1.0  # m2 from which a component of free space is an island, not a speck


@check("map.no-obstacle", "warning")
def no_obstacle(facts: GridFacts) -> Iterator[str]:
    """A map without any obstacle.
    Planners lead straight through walls, and localisation has nothing to match.
    Example: A map read with `negate: 1` by mistake.
    Fix: Check thresholds and negate.
    """
    if not facts.cells.counts["occupied"] and facts.cells.counts["unknown"] < facts.cells.size:
        yield "no cell is occupied; are the thresholds and negate right?"


@check("map.no-free", "warning")
def no_free(facts: GridFacts) -> Iterator[str]:
    """A map without any free cell.
    No plan is found from anywhere on this map.
    Example: A map read with too low an occupied_thresh.
    Fix: Check thresholds and negate.
    """
    if not facts.cells.counts["free"] and facts.cells.counts["unknown"] < facts.cells.size:
        yield "no cell is free; are the thresholds and negate right?"


@check("map.all-unknown", "error")
def all_unknown(facts: GridFacts) -> Iterator[str]:
    """A map with unknown cells only.
    The costmap is empty: with unknown allowed, planners lead straight through walls.
    Example: Thresholds between which all greys lie.
    Fix: Check thresholds, mode and negate.
    """
    if facts.cells.counts["unknown"] == facts.cells.size:
        yield map_file.NOTHING_KNOWN


@check("map.mostly-unknown", "note")
def mostly_unknown(facts: GridFacts) -> Iterator[Remark]:
    """A small known part on a large unknown canvas.
    Costmaps and planners of the robot take memory and time for the unknown part, too.
    Example: A gmapping canvas of 4000 x 4000 cells for one room.
    Fix: Crop it with mapdeal active.
    """
    height, width = facts.cells.known_box
    share = height * width / facts.cells.size
    if 0 < share < 0.5:
        text = f"all that is known lies in {width} x {height} cells, {100 * share:.0f} %"
        middle = facts.places([facts.cells.middle_of_known])
        yield Remark(f"{text}: the rest takes memory and time; try mapdeal active", places=middle)


_LEAST_CELLS = 1000  # smaller maps are made for tests
_WIDTH_OF_WALLS = 3.0  # cells
_PIECES_OF_WALLS, _LARGEST_PIECE = 10, 0.75


@check("map.inside-out", "warning")
def inside_out(facts: GridFacts) -> Iterator[str]:
    """More occupied cells than free ones, and the free ones look like walls.
    The robot may drive in walls only: no plan is found in rooms.
    Example: A map whose `negate` was swapped.
    Fix: Swap negate in the YAML.
    """
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


@check("map.islands", "warning")
def islands(facts: GridFacts) -> Iterator[Remark]:
    """Free space that cannot be reached from the largest part.
    A goal there is never reached. Often a door was closed or a doorway is painted over.
    Example: `...#..#...`: three areas behind walls.
    Fix: Open the doorway with mapdeal edit, or ignore it.
    """
    sizes, counts = facts.other_components
    is_large = sizes * facts.frame.resolution**2 >= _MIN_ISLAND_AREA
    count = int(counts[is_large].sum())
    if count:
        area = float((sizes * counts)[is_large].sum()) * facts.frame.resolution**2
        largest = facts.cells.free_components[0][-1] * facts.frame.resolution**2
        text = f"{count_text(count, 'area')} of free space, {decimal_text(area, 3)} m2, cannot be "
        text += f"reached from the largest, {decimal_text(largest)} m2: goals there fail; "
        cells = facts.cells.places_of_components(int(sizes[is_large][0]), facts.cells.size)
        yield Remark(f"{text}is a doorway closed?", places=facts.places(cells))


@check("map.specks", "note")
def specks(facts: GridFacts) -> Iterator[Remark]:
    """Small isolated patches of free space.
    Goals there fail, and global localisation may place the robot in them.
    Example: Cells behind a window that one beam has hit.
    Fix: Remove them with mapdeal clean --min-free.
    """
    sizes, counts = facts.other_components
    is_small = sizes * facts.frame.resolution**2 < _MIN_ISLAND_AREA
    count = int(counts[is_small].sum())
    if count:
        cells = int((sizes * counts)[is_small].sum())
        text = f"{count_text(count, 'speck')} of free space below 1 m2, {count_text(cells, 'cell')}"
        least = math.ceil(_MIN_ISLAND_AREA / facts.frame.resolution**2 - 1e-6)
        text += f": goals there fail; mapdeal clean --min-free {least} removes them"
        places = facts.cells.places_of_components(1, int(sizes[is_small][-1]))
        yield Remark(text, places=facts.places(places))


_COINCIDING, _TOLERANCE = 0.9, 0.25  # a share of walls and of free space; metres
_FEWEST_WALLS = 100  # blocks of cells: smaller maps are drawings


@check("map.ambiguous", "note")
def ambiguous(facts: GridFacts) -> Iterator[str]:
    """A map that looks the same when it is turned.
    AMCL confuses the two poses: without an initial pose, the robot may localise at the
    wrong end and drive to the wrong goals.
    Example: An arena with two equal halves.
    Fix: Set the initial pose, or add something that only one side has.
    """
    walls, free = facts.cells.pooled
    if np.count_nonzero(walls) < _FEWEST_WALLS:
        return
    tolerance = round(_TOLERANCE / facts.frame.resolution / facts.cells.pooling)
    turns = coincidences(walls, free, max(tolerance, 1))
    same = {90 * k: min(shares) for k, shares in enumerate(turns, 1)}
    same = {degrees: share for degrees, share in same.items() if share >= _COINCIDING}
    if same:
        text = f"turned by {' or '.join(map(str, same))} degrees, the map looks the same "
        text += f"({100 * min(same.values()):.0f} % of it coincides): localisation may take one "
        yield f"{text}pose for another; set the initial pose"


@check("map.open-border", "note")
def open_border(facts: GridFacts) -> Iterator[str]:
    """Free cells on the border of the map.
    Paths may lead to the edge of the map, and beyond it the robot knows no obstacle.
    Example: A hall cut off by a crop.
    Fix: Map further, or close the border with mapdeal edit.
    """
    if count := facts.cells.free_on_border:
        text = f"{count} of {facts.cells.border} cells on the border are free: paths can lead off "
        yield f"{text}the map; is it cut off?"


_MOST_PASSAGES, _MOST_PLACES = 10, 20


@check("map.disconnected", "warning")
def disconnected(facts: RoomFacts) -> Iterator[Remark]:
    """Areas joined only by passages too narrow for the robot; needs a robot's shape.
    Goals behind such a passage fail, although the map looks connected.
    Example: A door of 0.8 m for a radius of 0.4 m.
    Fix: Correct the doorway in the map, or exclude the area.
    """
    passages = sorted(facts.passages, key=lambda p: -p.cut_off)
    for p in passages[:_MOST_PASSAGES]:
        x, y = round(p.x, 2) + 0.0, round(p.y, 2) + 0.0
        text = f"{decimal_text(p.cut_off)} m2 are cut off from the largest area by a passage of "
        text += f"{p.width:.3g} m at {x:.10g}, {y:.10g}; the robot's inscribed circle needs more "
        text += f"than {2 * facts.radius:.3g} m"
        yield Remark(text, places=[(p.x, p.y)])
    omitted = passages[_MOST_PASSAGES:]
    if omitted:
        most = decimal_text(omitted[0].cut_off)
        text = f"{len(omitted)} more passages cut off {most} m2 or less each"
        yield Remark(text, places=[(p.x, p.y) for p in omitted[:_MOST_PLACES]])


_KNOWN_KEYS = ("image", "resolution", "origin", "mode", "negate", "occupied_thresh", "free_thresh")
_STRING = "tag:yaml.org,2002:str"


@check("yaml.unknown-key", "warning")
def unknown_key(facts: PairFacts) -> Iterator[Remark]:
    """A key that map_server does not know.
    map_server ignores it, so a misspelt key has its default on the robot.
    Example: `occupied_thresholds: 0.5`.
    Fix: Correct the spelling, or remove the key.
    """
    for key in facts.metadata.extra:
        if key in filters.FILTER_KEYS:  # mapdeal writes these into masks
            continue
        close = difflib.get_close_matches(key, _KNOWN_KEYS, n=1)
        suggestion = f"; did you mean {close[0]}?" if close else ""
        yield Remark(f"unknown key '{key}', which map_server ignores{suggestion}", key)


@check("yaml.mode-case", "warning")
def mode_case(facts: PairFacts) -> Iterator[Remark]:
    """A mode in capitals, which ROS 1 refuses.
    map_server of ROS 1 does not start with it.
    Example: `mode: Trinary`.
    Fix: Write it in lower case.
    """
    if "mode" in facts.entries:
        text = facts.entries["mode"].text()
        if text != text.lower():
            yield Remark(f"{text} is refused by ROS 1; write {text.lower()}", "mode")


@check("yaml.negate-word", "warning")
def negate_word(facts: PairFacts) -> Iterator[Remark]:
    """A negate that is a word, which ROS 1 refuses.
    map_server of ROS 1 reads whole numbers alone, and does not start with it.
    Example: `negate: false`.
    Fix: Write 0 or 1.
    """
    if "negate" in facts.entries and not (text := facts.entries["negate"].text()).isdigit():
        yield Remark(f"{text} is refused by ROS 1; write {facts.metadata.negate:d}", "negate")


@check("yaml.image-unquoted", "warning")
def image_unquoted(facts: PairFacts) -> Iterator[Remark]:
    """An image name that YAML takes for a date or number.
    Python tools read a date or number, and do not find the image.
    Example: `image: 2024-01-01`.
    Fix: Put the name in quotes.
    """
    if facts.entries["image"].node.tag != _STRING:
        yield Remark(f"{facts.metadata.image} is not text in YAML; put it in quotes", "image")


@check("yaml.resolution-noise", "warning")
def resolution_noise(facts: PairFacts) -> Iterator[Remark]:
    """A resolution with rounding noise, such as 0.05000000074505806.
    Tools that compare resolutions exactly refuse to merge two maps of one place.
    Example: `resolution: 0.05000000074505806`.
    Fix: Write 0.05, or run lint --fix.
    """
    value = facts.metadata.resolution
    plain = without_rounding_noise(value)
    if plain is not None:
        text = f"{value!r} is {plain!r} stored as a 32-bit float; write {plain!r}"
        yield Remark(text, "resolution")


@check("yaml.resolution-unusual", "warning")
def resolution_unusual(facts: PairFacts) -> Iterator[Remark]:
    """Cells larger than 2 m or smaller than 1 mm.
    The unit may be wrong: walls are thousands of metres apart, or the map is below the robot.
    Example: `resolution: 5`, centimetres written as metres.
    Fix: Write metres per cell.
    """
    value = facts.metadata.resolution
    if not 1e-3 <= value <= 2:
        yield Remark(f"{value:g} m per cell is unusual; is the unit right?", "resolution")


@check("yaml.origin-yaw", "warning")
def origin_yaw(facts: PairFacts) -> Iterator[Remark]:
    """A map with a yaw, which costmap_2d and AMCL ignore.
    The robot uses the map without the yaw, RViz with it: goals lie elsewhere than shown.
    Example: `origin: [-1.5, 2.0, 0.1]`.
    Fix: Run lint --fix, which turns the cells.
    """
    yaw = facts.metadata.origin[2]
    if yaw:
        text = f"yaw {yaw:g} rad is ignored by costmap_2d and AMCL; lint --fix turns the cells"
        yield Remark(text, "origin")


@check("yaml.origin-off-lattice", "note", on_request=True)
def origin_off_lattice(facts: PairFacts) -> Iterator[Remark]:
    """An origin that is not a multiple of the resolution.
    A single map is not affected. Merging two maps shifts one of them by half a cell.
    Example: `origin: [-1.52, 2.0, 0]` with cells of 0.05 m.
    Fix: Align it only where maps are combined.
    """
    x, y, _ = facts.metadata.origin
    cells = np.array([x, y]) / facts.metadata.resolution
    if np.abs(cells - np.rint(cells)).max() > 1e-3:
        yield Remark(f"{x:g}, {y:g} is not a multiple of {facts.metadata.resolution:g} m", "origin")


@check("yaml.origin-far", "warning")
def origin_far(facts: PairFacts) -> Iterator[Remark]:
    """An origin too far for the 32-bit floats of some readers.
    Positions are rounded to steps near the size of a cell: paths and scans jump.
    Example: `origin: [500000, 5400000, 0]`, UTM coordinates.
    Fix: Move the origin near 0, 0.
    """
    step = max(float(np.spacing(np.float32(abs(v)))) for v in facts.metadata.origin[:2])
    if step > facts.metadata.resolution / 10:
        text = f"32-bit floats have steps of {step:g} m there; move the origin near 0"
        yield Remark(text, "origin")


@check("image.absolute-path", "warning")
def absolute_path(facts: PairFacts) -> Iterator[Remark]:
    """An absolute path, which is valid on one machine only.
    Copied to the robot, the map does not load.
    Example: `image: /home/me/maps/m.pgm`.
    Fix: Write the file's name alone, or run lint --fix.
    """
    name = facts.metadata.image
    if PurePosixPath(name).is_absolute() or PureWindowsPath(name).is_absolute():
        path = facts.image_path
        is_beside = source.normal_path(path).parent == source.normal_path(facts.path).parent
        advice = f"write {path.name}" if is_beside else "move the image beside the YAML file"
        yield Remark(f"{name} is absolute; {advice}", "image")


@check("image.outside-folder", "note")
def outside_folder(facts: PairFacts) -> Iterator[Remark]:
    """An image that is not beside its YAML file.
    If the folder alone is copied to the robot, the image is missing and the map does not load.
    Example: `image: ../m.pgm`.
    Fix: Move the image beside the YAML.
    """
    name = facts.metadata.image
    if ".." in PurePosixPath(name).parts:
        yield Remark(f"{name} leaves the folder of the YAML file; move the image there", "image")


MANIFEST = "manifest.json"
LOCAL_FOLDER = "local"


def is_run(folder: Path) -> bool:
    """Return whether the manifest in a folder is a run's, or is damaged."""
    # Other programs write a manifest.json, too; their folders may contain maps.
    manifest = json_values.read_json(folder / MANIFEST)
    return manifest is None or (isinstance(manifest, dict) and "outputs" in manifest)


def _lines_on_failed_maps(folder: Path) -> list[str]:
    summary = json_values.read_json(folder / SUMMARY)
    maps = summary["maps"] if json_values.document_kind(summary) == json_values.SUMMARY else ()
    failed = [entry for entry in maps if entry["status"] == "failed"]
    return [one_line(str(entry.get("error") or entry.get("map") or "a map")) for entry in failed]


SUMMARY = "summary.json"
RUN_FOLDERS = listing.ListedFolders(
    MANIFEST, is_run, SUMMARY, lambda folder: bool(_lines_on_failed_maps(folder)), (LOCAL_FOLDER,)
)
"""Rule that distinguishes folders of runs from folders of maps."""

declare_checks(
    """
    run.no-manifest (error)
        A folder without a map, and without the manifest of a run.
        Nothing in it was checked. A gate that passes it would pass anything.
        Example: A misspelt path in a CI job.
        Fix: Name the folder of maps, or of a run.
    run.failed-map (error)
        A map that failed in a batch.
        Its folder has no results, or those of an earlier run.
        Example: An entry of `summary.json` whose status is failed.
        Fix: Correct the map and run mapdeal run again.
    run.missing-file (error)
        A file that the manifest lists is gone.
        Robots and pages that read the run do not find its result.
        Example: A deleted `cost.pgm`.
        Fix: Run mapdeal run again.
    run.other-file (error)
        A file that differs from the manifest: edited, or from a killed run.
        The robot may use costs that do not belong to the map and parameters in the manifest.
        Example: A `cost.pgm` edited by hand.
        Fix: Run mapdeal run again with --force.
    run.uniform-cost (warning)
        Uninformative costs: equal in nearly all cells, or no cell open.
        Planners see no difference between a corridor's middle and its walls, or find no path.
        Example: An inflation radius of 5 m in rooms of 4 m.
        Fix: Check the radius and the thresholds of the map.
    """
)


def lint_run(folder: Path) -> list[Finding]:
    # Includes the local map, if the run has made one.
    try:
        _, files = source.contents_of(folder)
    except FileAccessError as error:
        return [Check.error_finding(error, folder)]
    manifest = json_values.read_json(folder / MANIFEST)
    outputs = manifest.get("outputs") if isinstance(manifest, dict) else None
    if not isinstance(outputs, dict) or not outputs:
        if failed := _lines_on_failed_maps(folder):
            return [CHECKS["run.failed-map"].finding(folder, text) for text in failed]
        text = f"has no {MANIFEST} of a run, and no map in it or below: no .yaml with the key image"
        text += "; --params-file checks a robot's parameters"
        if (kind := kinds.kind_of(folder)) is not None:
            text = f"is {kind.what}, not a folder of maps or of a run ({kind.use})"
        elif MANIFEST in files:
            text = f"its {MANIFEST} is not that of a run"
        return [CHECKS["run.no-manifest"].finding(folder, text)]
    findings = [*_check_outputs(folder, outputs), *_check_costs(folder, manifest.get("figures"))]
    if source.exists(folder / LOCAL_FOLDER / MANIFEST):
        findings += lint_run(folder / LOCAL_FOLDER)
    return findings


def _check_outputs(folder: Path, outputs: dict[str, Any]) -> Iterator[Finding]:
    for name, digest in outputs.items():
        path = folder / Path(name).name
        if not source.exists(path):
            yield CHECKS["run.missing-file"].finding(folder, f"{path.name} is gone")
        elif not source.holds(path, str(digest)):
            text = f"{path.name} is not the file that the manifest lists"
            yield CHECKS["run.other-file"].finding(folder, text)


def _check_costs(folder: Path, figures: object) -> Iterator[Finding]:
    for stage, costs in figures.items() if isinstance(figures, dict) else ():
        common = costs.get("most_common", {}) if isinstance(costs, dict) else {}
        share = common.get("share") if isinstance(common, dict) else None
        if common is None:
            yield CHECKS["run.uniform-cost"].finding(folder, f"{stage}: no cell is open")
        elif isinstance(share, float) and share > costmap.UNIFORM_SHARE:
            text = f"{stage}: {100 * share:.4g} % of the open cells cost {common.get('cost')}; "
            text += "check the inflation radius"
            yield CHECKS["run.uniform-cost"].finding(folder, text)
