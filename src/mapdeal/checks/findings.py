"""Checks, their findings, and the selection of findings by options, configuration and comments."""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from inspect import cleandoc
from pathlib import Path
from typing import Any, Literal

from mapdeal import compatibility, records
from mapdeal.errors import FileAccessError, MalformedInputError, ParameterError, one_line
from mapdeal.files.source import exists, is_folder, normal_path, read_file
from mapdeal.files.yaml_text import Entry
from mapdeal.grid.frame import Point
from mapdeal.ros.robot import ParameterValue

Severity = Literal["error", "warning", "note"]
_DECIMALS = 9
SEVERITIES: tuple[Severity, ...] = ("error", "warning", "note")


@records.dataclass(frozen=True)
class Finding:
    """Finding reported by a check.

    Parameters
    ----------
    check : str
        Name of the check, ``area.name``.
    severity : {'error', 'warning', 'note'}
        An error makes the map wrong or unsafe for some reader, a warning points out a trap, and
        a note is worth knowing.
    file : str
        File in which it was found.
    message : str
        Description, one line.
    line : int, optional
        Line number in the file, starting at 1.
    places : tuple of (x, y)
        Positions in the map frame, metres: a selection, the most important first.
    """

    check: str
    severity: Severity
    file: str
    message: str
    line: int | None = None
    places: tuple[Point, ...] = ()

    def __str__(self) -> str:
        """Return ``FILE:LINE: SEVERITY: CHECK: MESSAGE``, as ``mapdeal lint`` prints it."""
        place = self.file if self.line is None else f"{self.file}:{self.line}"
        return one_line(f"{place}: {self.severity}: {self.check}: {self.message}")


@records.dataclass(frozen=True)
class Remark:
    message: str
    key: str | None = None
    at: ParameterValue | None = None
    places: Iterable[Sequence[float]] = ()


@records.dataclass(frozen=True)
class Explanation:
    about: str
    why: str
    example: str
    fix: str


_PARTS = re.compile(r"([^\n]+)\n+(.+)\nExample: (.+)\nFix: (.+)", re.DOTALL)


def parse_explanation(text: str) -> Explanation:
    match = _PARTS.fullmatch(cleandoc(text))
    if match is None:
        raise ValueError(f"needs a summary, a reason, 'Example:' and 'Fix:', got {text!r}")
    return Explanation(*(" ".join(part.split()) for part in match.groups()))


@records.dataclass(frozen=True)
class Check:
    name: str
    severity: Severity
    explanation: Explanation
    run: Callable[[Any], Iterable[Remark | str]]
    facts: type | None
    on_request: bool  # if it runs only when it is selected, as it has no effect on most robots

    def finding(
        self, file: Path | str, message: str, line: int | None = None,
        places: Iterable[Sequence[float]] = (),
    ) -> Finding:  # fmt: skip
        points = tuple((round(x, _DECIMALS) + 0.0, round(y, _DECIMALS) + 0.0) for x, y in places)
        return Finding(self.name, self.severity, str(file), message, line, points)

    @staticmethod
    def error_finding(error: FileAccessError | MalformedInputError, path: Path) -> Finding:
        name = "file.access" if isinstance(error, FileAccessError) else "file.malformed"
        return CHECKS[name].finding(path, str(error).removeprefix(f"{path}: "))


CHECKS: dict[str, Check] = {}  # all checks by name, in the order in which they run


def add_check(
    name: str, severity: Severity, explanation: str, *, on_request: bool,
    run: Callable[[Any], Iterable[Remark | str]] = lambda _: (), facts: type | None = None,
) -> None:  # fmt: skip
    if name in CHECKS:
        raise ValueError(f"two checks are called {name}")
    CHECKS[name] = Check(name, severity, parse_explanation(explanation), run, facts, on_request)


def findings_on(
    facts: Mapping[type, Any], file: Path | str, entries: Mapping[str, Entry] = {}
) -> Iterator[Finding]:
    for check in CHECKS.values():
        for text in check.run(facts[check.facts]) if check.facts and check.facts in facts else ():
            remark = text if isinstance(text, Remark) else Remark(text)
            if remark.at is not None:
                yield check.finding(remark.at.source, remark.message, remark.at.line)
            else:
                entry = entries.get(remark.key or "")
                line = None if entry is None else entry.line
                yield check.finding(file, remark.message, line, remark.places)


_DECLARATION = re.compile(r"^(\S+) \((\w+)(, on request)?\)\n", re.MULTILINE)


def declare_checks(text: str) -> None:
    """Add checks of readers: a name and a severity, above an explanation that begins a line."""
    _, *parts = _DECLARATION.split(cleandoc(text))
    for name, severity, request, explanation in zip(*[iter(parts)] * 4, strict=True):
        add_check(name, severity, explanation, on_request=bool(request))


declare_checks(
    """
    file.access (error)
        A file is missing or cannot be read.
        Nothing of this map is checked, and map_server does not start with it.
        Example: `image: gone.pgm`, and there is no such file beside the YAML.
        Fix: Correct the name, or make the file readable.
    file.malformed (error)
        A file breaks the rules of its format.
        The robot's readers refuse such a file, or read something else than was meant.
        Example: `resolution: none`.
        Fix: Correct the place that the message names, or save the file again.
    yaml.defaults (warning)
        The key negate or a threshold is missing; ROS requires them.
        map_server refuses the YAML and the robot has no map. Other checks assume the usual values.
        Example: A YAML file without `negate`.
        Fix: Run lint --fix, which writes the usual values.
    yaml.number-as-text (warning)
        A number such as 5e-2 that YAML 1.1 reads as text.
        ROS reads the number, but Python tools with PyYAML get a text and fail or skip the map.
        Example: `resolution: 5e-2`.
        Fix: Write the number with a point: 0.05.
    yaml.yaw-in-degrees (warning)
        A yaw of more than a turn, probably in degrees.
        The map is turned by another angle than was meant, and all places on it are wrong.
        Example: `origin: [-1.5, 2.0, 90]`.
        Fix: Write the yaw in radians.
    yaml.nan-yaw (error)
        A yaw of nan, which some map savers write.
        Every pose computed with the yaw is nan, so the robot cannot be placed on the map.
        Example: `origin: [-1.5, 2.0, nan]`.
        Fix: Write 0, or run lint --fix.
    yaml.legacy-mode (warning)
        An outdated key instead of mode.
        map_server ignores the key and reads trinary: values between free and occupied are lost.
        Example: `trinary: true` without mode.
        Fix: Write mode: trinary, scale or raw.
    thresholds.equal (warning)
        The thresholds free_thresh and occupied_thresh are equal.
        No grey is left for unknown: unexplored space is free, and planners lead the robot there.
        Example: `free_thresh: 0.65`, equal to occupied_thresh.
        Fix: Write the usual 0.196 for free_thresh.
    image.foreign-path (warning)
        The image path is from another machine.
        The checks use the image beside the YAML; map_server looks at the path and does not start.
        Example: `image: /home/robot/maps/m.pgm`, which is missing here.
        Fix: Write the file's name alone, or run lint --fix.
    image.lossy (warning)
        The image is a JPEG, which changes greys.
        Greys near a threshold may cross it: walls get holes and free space gets specks.
        Example: An `office.jpg` that an editor has saved.
        Fix: Save the original again as PGM or PNG.
    image.orientation (warning)
        An EXIF orientation that ROS does not apply.
        Viewers turn the image and ROS does not: zones and goals drawn there lie elsewhere.
        Example: A photo of a floor plan, turned by the camera.
        Fix: Save the image without EXIF data.
    image.depth (warning)
        An image with 16 bits a channel, of which 8 were read.
        Readers round such greys differently, so cells near a threshold may differ on the robot.
        Example: A 16-bit PNG from an image editor.
        Fix: Save the image with 8 bits a channel.
    image.transparent-colour (warning)
        A transparent colour (PNG tRNS).
        Some readers make its cells unknown, others read its grey: the robot may see them as free.
        Example: A palette PNG whose white is transparent.
        Fix: Save the image without transparency.
    image.dos-header (warning)
        DOS line ends in the header of a PNM image.
        Some readers take the extra byte for a pixel: all cells are shifted by one column.
        Example: A PGM that an editor has saved under Windows.
        Fix: Run mapdeal convert, which writes the image anew.
    image.trailing-bytes (warning)
        Bytes after the picture.
        The header may give too small a size: the robot sees a part of the map, or a sheared one.
        Example: A PGM whose header was edited by hand.
        Fix: Compare the size in the header with the original.
    image.raw-values (warning)
        Values without a meaning in mode raw.
        Raw values are occupancy, 0 to 100 and 255: others become unknown or, in ROS 1, wrong.
        Example: Grey 130 with `mode: raw`.
        Fix: Write mode: trinary, or values of 0 to 100.
    image.yaml-not-read (warning)
        An image read by --resolution although its YAML file exists.
        Its origin and thresholds are not used: results are displaced against the robot's map.
        Example: `mapdeal info office.pgm --resolution 0.05` beside office.yaml.
        Fix: Name the YAML instead of the image.
    map.view (warning)
        The 0..100 view of a distance field, which is not a map.
        A robot would read distances as occupancy: most free space would be unknown or occupied.
        Example: The `esdf.yaml` in the folder of a run.
        Fix: Give the robot the map that the field was made from.
    graph.refused (error)
        A graph that Nav2's route server refuses to load.
        The route server does not start, so the robot has no routes.
        Example: A node without the property `id`.
        Fix: Correct the feature that the message names.
    graph.missing-end (error)
        An edge without a start or end node: Nav2 refuses the file.
        The route server does not load the graph, so the robot has no routes.
        Example: An edge to node 12 that was deleted.
        Fix: Delete the edge, or add the node.
    graph.double-id (error)
        Two nodes, or two edges, with the same id.
        Nav2 replaces the first by the second: routes lead to another place than was meant.
        Example: Two nodes with `"id": 7` after copying.
        Fix: Give one of them an unused id.
    graph.shared-id (warning)
        A node and an edge with the same id.
        Requests name an edge by its id, and operators may address the wrong feature.
        Example: Node 5 and edge 5.
        Fix: Number edges above all nodes.
    graph.whole-number (error)
        An integer where a scorer reads a float: the scorer throws an exception.
        The route server fails at the first request that scores this edge: the robot stays.
        Example: `"speed_limit": 1`.
        Fix: Write the number with a point: 1.0.
    graph.mixed-limits (warning)
        The property speed_limit on some edges only.
        Edges without it count as full speed, so routes may prefer them over limited ones.
        Example: A limit on one of three edges.
        Fix: Set speed_limit on every edge.
    graph.other-frame (error)
        Coordinates not in the map's frame.
        Nodes lie far from where they were drawn, and routes lead into walls or off the map.
        Example: Longitudes and latitudes from a GIS.
        Fix: Write metres in the map frame.
    graph.node-closed (error)
        A node in an obstacle or unknown space, or too near to one.
        The robot collides or stops before it reaches this node, and each route through it fails.
        Example: A node 0.1 m from a wall for a radius of 0.3 m.
        Fix: Move the node to the open cell named.
    graph.edge-blocked (error)
        An edge along which the robot collides.
        The route server does not look at the map: the robot drives at the obstacle and stops.
        Example: An edge drawn through a pillar.
        Fix: Lead the edge around with another node.
    graph.one-way (warning)
        Nodes that can be only entered or only left.
        A robot sent there cannot drive back, or routes to there fail.
        Example: A dock with an edge in and none out.
        Fix: Add edges in the other direction.
    graph.parts (warning)
        Parts of a graph that are not connected.
        No route leads from one part to another, although the robot could drive there.
        Example: A second floor's nodes in the file of the first.
        Fix: Add the missing edge, or split the file.
    lint.not-checked (error)
        A map that could not be checked: no memory, or a bug.
        The map may have any error, and nothing here would show it.
        Example: A map larger than the memory that may be used.
        Fix: Give more --max-memory, or report the bug.
    lint.left-out (note)
        A check was skipped because it needs too much memory.
        Rooms that the robot cannot enter are not reported for this map.
        Example: A map larger than the memory, with --robot-radius.
        Fix: Give more --max-memory, or crop with mapdeal active.
    """
)

OWN_FILE, PYPROJECT = "mapdeal.toml", "pyproject.toml"
_LARGEST = 1 << 20
_KEYS = ("select", "ignore", "strict")


@records.dataclass(frozen=True)
class LintConfig:
    source: Path
    table: str
    select: Sequence[str] | None = None
    ignore: Sequence[str] | None = None
    strict: bool = False


def find_lint_config(folder: Path) -> LintConfig | None:
    # A mapdeal.toml goes before a pyproject.toml, which is skipped without [tool.mapdeal.lint].
    start = normal_path(folder)
    for place in (start, *start.parents):
        if exists(place / OWN_FILE):
            return read_lint_config(place / OWN_FILE) or LintConfig(place / OWN_FILE, "lint")
        if exists(place / PYPROJECT) and (config := read_lint_config(place / PYPROJECT)):
            return config
    return None


def read_lint_config(path: Path) -> LintConfig | None:
    data = read_file(path, limit=_LARGEST)
    try:
        document = compatibility.parse_toml(data.decode("utf-8"))
    except UnicodeDecodeError as error:
        raise MalformedInputError("not UTF-8", source=path, place=f"byte {error.start}") from None
    except (RecursionError, ValueError) as error:  # or numbers of many thousand digits
        why = "nested too deeply" if isinstance(error, RecursionError) else error
        raise MalformedInputError(f"not valid TOML: {why}", source=path) from None
    if path.name == PYPROJECT:
        tool = document.get("tool", {})
        own_table = tool.get("mapdeal", {}) if isinstance(tool, dict) else {}
        table, prefix = "tool.mapdeal.lint", "tool.mapdeal."
    else:
        own_table, table, prefix = document, "lint", ""
    _check_table(own_table, ("lint",), path, prefix)
    if "lint" not in own_table:
        return None
    _check_table(own_table["lint"], _KEYS, path, f"{table}.")
    for key, value in own_table["lint"].items():
        is_names = isinstance(value, list) and all(isinstance(name, str) for name in value)
        if not (isinstance(value, bool) if key == "strict" else is_names):
            rule = f"must be {'true or false' if key == 'strict' else 'a list of names'}"
            raise ParameterError(rule, source=path, place=f"{table}.{key}", got=value)
    return LintConfig(path, table, **own_table["lint"])


def _check_table(table: Any, known: Sequence[str], path: Path, prefix: str) -> None:
    if not isinstance(table, dict):
        raise ParameterError("must be a table", source=path, place=prefix[:-1], got=table)
    for key in (key for key in table if key not in known):
        close = difflib.get_close_matches(key, known, n=1)
        hint = f"did you mean {close[0]}?" if close else f"known keys: {', '.join(known)}"
        if key in _KEYS:  # a key of lint in the table above
            hint = f"it belongs in the table [{prefix}lint]"
        raise ParameterError("unknown key", source=path, place=f"{prefix}{key}", hint=hint)


EVERYTHING = "all"


@records.dataclass(frozen=True)
class Selection:
    checks: frozenset[str]
    strict: bool = False

    def apply(
        self, findings: Iterable[Finding], ignored_names: Iterable[str] = ()
    ) -> tuple[tuple[Finding, ...], int]:
        """Return the findings of selected checks that no comment ignores, and how many one does."""
        selected = [found for found in findings if found.check in self.checks]
        ignored = {name for text in ignored_names for name in _matches(text)}
        remaining = [found for found in selected if found.check not in ignored]
        remaining.sort(key=lambda found: SEVERITIES.index(found.severity))
        return tuple(remaining), len(selected) - len(remaining)


def selection_of(
    select: Sequence[str] = (), ignore: Sequence[str] = (), *, strict: bool = False,
    config: LintConfig | None = None,
) -> Selection:  # fmt: skip
    checks = frozenset(name for name, check in CHECKS.items() if not check.on_request)
    config = config or LintConfig(Path(), "")
    source, table = config.source, config.table
    selected = _ranks(config.select or (), source, f"{table}.select")
    ignored = _ranks(config.ignore or (), source, f"{table}.ignore")
    checks = _refine(checks, selected, ignored, selects=config.select is not None)
    selected, ignored = _ranks(select, "--select"), _ranks(ignore, "--ignore")
    checks = _refine(checks, selected, ignored, selects=bool(select))
    return Selection(checks, strict or config.strict)


class Selections:
    def __init__(
        self, select: Sequence[str], ignore: Sequence[str], *, strict: bool, config: bool
    ) -> None:
        self._make = partial(selection_of, select, ignore, strict=strict)
        self._reads_config = config
        self._by_folder: dict[Path, Selection] = {}
        self._make()  # refuses unknown names before any work

    def of(self, path: Path) -> Selection:
        folder = normal_path(path if is_folder(path) else path.parent)
        if folder not in self._by_folder:
            config = find_lint_config(folder) if self._reads_config else None
            self._by_folder[folder] = self._make(config=config)
        return self._by_folder[folder]


def _refine(
    before: frozenset[str], select: Mapping[str, int], ignore: Mapping[str, int], *, selects: bool
) -> frozenset[str]:
    """Return the checks that are selected more precisely than they are ignored."""
    ranks = select if selects else dict.fromkeys(before, -1)
    return frozenset(name for name, rank in ranks.items() if rank > ignore.get(name, -2))


def _ranks(names: Iterable[str], source: Path | str, place: str | None = None) -> dict[str, int]:
    """Return how precisely each check is named, at best: 0 by all, 1 by its area, 2 by name."""
    ranks: dict[str, int] = {}
    for text in names:
        matching = _matches(text)
        if not matching:
            where: Any = {"source": source, "place": place, "hint": hint_for(text)}
            raise ParameterError("unknown check", got=text, **where)
        for name, rank in matching.items():
            ranks[name] = max(rank, ranks.get(name, 0))
    return ranks


def _matches(text: str) -> dict[str, int]:
    if text in CHECKS:
        return {text: 2}
    if text.lower() == EVERYTHING:
        return dict.fromkeys(CHECKS, 0)
    area = text.removesuffix(".")
    return dict.fromkeys((name for name in CHECKS if name.partition(".")[0] == area), 1)


def named_checks(names: Iterable[str], option: str) -> tuple[Check, ...]:
    return tuple(CHECKS[name] for name in sorted(_ranks(names, option)))


def hint_for(text: str) -> str:
    areas = dict.fromkeys(name.partition(".")[0] for name in CHECKS)
    close = difflib.get_close_matches(text.lower(), [*CHECKS, *areas], n=1)
    if not close:  # a check's name without its area
        close = [name for name in CHECKS if name.partition(".")[2] == text.lower()][:1]
    return f"did you mean {close[0]}?" if close else f"groups are {', '.join(areas)}"
