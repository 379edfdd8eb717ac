"""A robot's parameters, and the footprint and layers that follow from them.

Footprints equal those of ROS 1 and Nav2 bit by bit.

References
----------
array_parser.cpp, footprint.cpp and costmap_math.cpp of costmap_2d and nav2_costmap_2d.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from difflib import SequenceMatcher
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np

from mapdeal.errors import MalformedInputError, ParameterError
from mapdeal.grid.footprint import Footprint, check_simple, contains_centre
from mapdeal.grid.frame import as_float32
from mapdeal.grid.values import FREE_SPACE, NO_INFORMATION, OneLineRepr
from mapdeal.layers import inflation, keepout
from mapdeal.layers.layer import CostmapLayer
from mapdeal.layers.stack import CostmapArea, CostmapLayers
from mapdeal.layers.static import StaticLayer
from mapdeal.records import asdict, dataclass, replace

Level = Literal["refused", "warning", "note"]
Flavour = Literal["nav2", "ros1"]
CostmapName = Literal["global", "local"]
T = TypeVar("T")


@dataclass(frozen=True)
class Problem:
    check: str
    level: Level
    text: str
    parameter: str = ""
    source: Path | None = None
    line: int | None = None
    got: str | None = None
    hint: str | None = None


class ParameterFileError(MalformedInputError):
    """A file that ROS 2's parser refuses: the line where it stops, and the text there."""

    line: int | None = None
    found: str | None = None


@dataclass(frozen=True)
class ParameterValue:
    value: Any
    kind: str
    source: Path
    line: int
    text: str
    ignored: ParameterValue | None = None
    replaced: ParameterValue | None = None  # an earlier value of the same name in the same file


def syntax_problem(error: MalformedInputError, path: Path) -> Problem:
    """Return the problem of a file that cannot be read; its text names places other than lines."""
    match = re.fullmatch(r"line (\d+)(?:, .*)?", error.place or "")
    text = error.rule if match or not error.place else f"{error.rule} ({error.place})"
    line, got = int(match[1]) if match else None, getattr(error, "found", None)
    return Problem("params.syntax", "refused", text, "", path, line, got, error.hint)


def repetition(line: int, later_line: int, *, is_equal: bool) -> tuple[str, Level, str]:
    """Return check, level and text of a problem: a file sets a parameter twice."""
    text = f"appears twice, on lines {line} and {later_line}"
    if is_equal:
        return "params.repeated", "note", f"{text}, with one value"
    return "params.twice", "warning", f"{text}; the later one counts"


def other_maps(topics: Iterable[tuple[T, str]]) -> Iterator[tuple[T, str]]:
    """Yield the parameters of topics other than the first, with a warning of static layers."""
    # mapdeal has one map for all of them
    first_topic = ""
    for parameter, topic in topics:
        first_topic = first_topic or topic
        if topic != first_topic:
            text = f"reads {topic}, another map than {first_topic}; here it gets the same map"
            yield parameter, text


Corners = tuple[tuple[float, float], ...]

MOST_CORNERS = 2000  # of a footprint: the search for crossing edges takes quadratic time
_NUMBER = re.compile(
    r"[ \t\n\v\f\r]*([-+]?(?:(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]*)?|\.?))"
)
"""Characters that a C++ stream consumes for a number; the result may be invalid, as ``1e``."""


class FootprintStringError(ValueError):
    """Reason why ``parseVVF`` or ``makeFootprintFromString`` rejects a footprint string."""


def corners_of_string(text: str) -> Corners:
    # Numbers are read as a C++ stream reads them: ``0.3-0.2`` is two numbers, and reading stops
    # behind ``0.3m``. Line ends are blanks only within the inner brackets.
    groups: list[list[float]] = []
    current: list[float] = []
    depth, index = 0, 0
    while index < len(text):
        char = text[index]
        if char == "[":
            depth += 1
            current = []
            if depth > 2:
                raise FootprintStringError("brackets are nested deeper than two")
        elif char == "]":
            depth -= 1
            if depth < 0:
                raise FootprintStringError("more closing than opening brackets")
            if depth == 1:
                groups.append(current)
        elif char not in ", \t":
            if depth != 2:
                raise FootprintStringError(f"{char!r} stands outside the inner brackets")
            value, index = _number_at(text, index)
            current.append(value)
            continue
        index += 1
    if depth:
        raise FootprintStringError("a bracket is not closed")
    if len(groups) < 3:
        raise FootprintStringError(f"a footprint needs three points or more, has {len(groups)}")
    if any(len(group) != 2 for group in groups):
        raise FootprintStringError("points must be pairs of numbers")
    return tuple((x, y) for x, y in groups)


def _number_at(text: str, index: int) -> tuple[float, int]:
    """Return the number that a C++ stream reads at an index, and the index where it stops."""
    start, end = _NUMBER.match(text, index).span(1)  # type: ignore[union-attr] # it may be empty
    try:
        value = float(text[start:end])
    except ValueError:  # consumed, but invalid, as "1e"
        word = text[start : max(end, start + 1) + 9].split("]")[0].split(",")[0].strip()
        raise FootprintStringError(f"{word!r} is not a number") from None
    single = as_float32(value)
    if math.isinf(single):
        raise FootprintStringError(f"{text[start:end][:20]!r} is too large")
    return single, end


def sixteen_corners(radius: float) -> Corners:
    """Return the corners of a round robot, as ``makeFootprintFromRadius``."""
    angles = [index * 2 * math.pi / 16 for index in range(16)]
    return tuple((math.cos(a) * radius, math.sin(a) * radius) for a in angles)


def padded_corners(corners: Corners, padding: float) -> Corners:
    """Return the corners moved outwards, each coordinate by its own sign, as ``padFootprint``."""
    with np.errstate(invalid="ignore"):  # infinite padding of a coordinate of 0
        padded = np.array(corners) + np.sign(corners) * padding
    return tuple((x, y) for x, y in padded.tolist())


def radii_of(corners: Corners) -> tuple[float, float]:
    """Return inscribed and circumscribed radius, as ``calculateMinAndMaxDistances``."""
    starts, ends = np.array(corners), np.roll(corners, -1, axis=0)
    edges = ends - starts
    squares = (edges * edges).sum(axis=1, keepdims=True)
    # the point of each edge that is nearest to (0, 0), as ``distanceToLine`` finds it
    shares = (-starts * edges).sum(axis=1, keepdims=True) / np.where(squares, squares, 1.0)
    nearest = np.where(shares > 1, ends, np.where(shares < 0, starts, starts + shares * edges))
    # numpy's hypot is C's, as in costmap_2d; Python's math.hypot rounds differently
    distances = np.hypot(*np.concatenate([starts, nearest]).T)
    return float(distances.min()), float(distances.max())


NOT_MODELLED = "not modelled"  # why a layer that sets costs is left out
INJECTED = "injected_static"  # the static layer that mapdeal adds to a local costmap without one


@dataclass(frozen=True)
class ListedLayer:
    name: str
    plugin: str
    layer: CostmapLayer | None
    is_enabled: bool = True
    is_filter: bool = False
    why_ignored: str = ""
    sensing: Any = None  # parameters of its sensors

    @property
    def needs(self) -> str:
        """Input besides the map without which the layer is idle."""
        return "" if self.layer is None else self.layer.needs


@dataclass(frozen=True)
class ParameterFile:
    path: Path
    sha256: str


@dataclass(frozen=True, repr=False)
class RobotParameters(OneLineRepr):
    """Shape of a robot and the layers of one of its costmaps, as ROS resolves them.

    Parameters
    ----------
    flavour : {'nav2', 'ros1'}
        Kind of parameter files.
    costmap : {'global', 'local'}
        Which of the robot's costmaps this is.
    node : str
        Full name of the node, such as ``/global_costmap/global_costmap``; for ROS 1, the
        namespace of the costmap.
    footprint : Footprint
        Padded polygon, metres; for a round robot a polygon of 16 vertices, as in ROS.
    footprint_padding : float
        Distance by which the vertices were moved outwards, metres.
    robot_radius : float, optional
        Radius from which the polygon was made, metres; None if the file lists the vertices.
    track_unknown_space : bool
        Whether the costmap is initially unknown rather than free.
    rolling_window : bool
        Whether the costmap moves with the robot.
    layers : tuple of ListedLayer
        All layers in the order of the file, followed by the filters.
    files : tuple of ParameterFile
        Files that were read.
    inscribed_radius, circumscribed_radius : float
        Radii of the padded footprint, as computed by ``calculateMinAndMaxDistances``, metres.
    remarks : tuple of str
        Warnings from reading the files.
    area : CostmapArea, optional
        Size and place that the files give to the costmap; where a static layer reads a map, and the
        costmap does not roll, the map's count instead.
    namespace : str, optional
        Namespace that was asked for when the files were read.
    base_frame : str
        Frame of the robot.
    """

    flavour: Flavour
    costmap: CostmapName
    node: str
    footprint: Footprint
    footprint_padding: float
    robot_radius: float | None
    track_unknown_space: bool
    rolling_window: bool
    layers: tuple[ListedLayer, ...]
    files: tuple[ParameterFile, ...]
    inscribed_radius: float
    circumscribed_radius: float
    remarks: tuple[str, ...] = ()
    area: CostmapArea | None = None
    namespace: str | None = None
    base_frame: str = "base_link"

    @property
    def paths(self) -> tuple[Path, ...]:
        """Paths of the files that were read."""
        return tuple(file.path for file in self.files)

    @property
    def costmap_layers(self) -> CostmapLayers:
        """Enabled layers for the whole map; the robot's pose is unknown."""
        layers = self._enabled_layers()
        return replace(layers, area=self.area) if self._has_own_size else layers.with_mask_last()

    @property
    def _has_own_size(self) -> bool:
        # For Nav2, mapdeal computes a costmap without a static layer on the cells of the map.
        return self.flavour == "ros1" and not self.rolling_window and not self.static_layers

    @property
    def layers_around_robot(self) -> CostmapLayers:
        """Layers for a robot with a known pose: as listed, on the area that the files define."""
        layers = self._enabled_layers()
        if layers.layers and layers.layers[0].name == INJECTED:
            layers = replace(layers, layers=layers.layers[1:])
        area = self.area if self.rolling_window or self._has_own_size else None
        return replace(layers, area=area, footprint=self.footprint)

    def _enabled_layers(self) -> CostmapLayers:
        enabled = (listed.layer for listed in self.layers if listed.is_enabled)
        layers = tuple(layer for layer in enabled if layer is not None)
        cost = NO_INFORMATION if self.track_unknown_space else FREE_SPACE
        return CostmapLayers(layers, cost, self.circumscribed_radius)

    @property
    def _keepout_filters(self) -> list[ListedLayer]:
        return [item for item in self.layers if isinstance(item.layer, keepout.KeepoutFilter)]

    @property
    def has_keepout_filter(self) -> bool:
        """Whether a keepout filter is listed and switched on."""
        return any(listed.is_enabled for listed in self._keepout_filters)

    @property
    def why_mask_unused(self) -> str | None:
        """Why a keepout mask has no effect on the costmap; None if it has one."""
        filters = self._keepout_filters
        if filters and not self.has_keepout_filter:
            return f"{' and '.join(listed.name for listed in filters)} is switched off"
        is_lost = self._enabled_layers().loses_keepout
        return "a layer after the keepout filter overwrites its costs" if is_lost else None

    @property
    def inflates_keepout(self) -> bool:
        """Whether an inflation layer spreads costs around the lethal cells of a keepout mask."""
        return self._enabled_layers().inflates_keepout

    @property
    def ignored(self) -> tuple[ListedLayer, ...]:
        """Layers and filters that have no effect on a map file."""
        effective = self.costmap_layers.effective
        return tuple(
            listed
            for listed in self.layers
            if listed.layer is None
            or (listed.needs and not any(listed.layer is layer for layer in effective))
        )

    @property
    def static_layers(self) -> tuple[StaticLayer, ...]:
        """Enabled static layers."""
        return self._enabled_layers().static_layers

    @property
    def frees_unknown(self) -> bool:
        """Whether unknown cells of a map become free, and are not inflated around either."""
        static, inflating = self.static_layers, self.inflation_layers
        if any(own.inflate_around_unknown and own.inflation_radius > 0 for own in inflating):
            return False
        return bool(static) and not any(layer.track_unknown_space for layer in static)

    @property
    def inflation_layers(self) -> tuple[inflation.InflationLayer, ...]:
        """Enabled inflation layers."""
        return self._enabled_layers().inflation_layers

    def without_inflation(self) -> RobotParameters:
        """Return the robot without its inflation layers."""
        layers = (item for item in self.layers if item.layer is None or not item.layer.spreads)
        return replace(self, layers=tuple(layers))

    def with_shape(self, footprint: Footprint) -> RobotParameters:
        """Return the robot with another footprint, used as it is, without padding.

        Inflation layers get its inscribed radius, unless the file sets one for them.
        """
        inner = self.inscribed_radius
        layers = [
            replace(item, layer=item.layer and item.layer.with_inscribed_radius(inner, footprint))
            for item in self.layers
        ]
        return replace(
            self, footprint=footprint, footprint_padding=0.0,
            robot_radius=footprint.radius or None, layers=tuple(layers),
            inscribed_radius=footprint.inscribed_radius,
            circumscribed_radius=footprint.circumscribed_radius,
        )  # fmt: skip

    def described(self) -> dict[str, Any]:
        """Return everything that was resolved, as values that JSON can represent."""
        shape = [list(corner) for corner in self.footprint.vertices]
        names = ("robot_radius", "footprint_padding", "inscribed_radius", "circumscribed_radius",
                 "track_unknown_space", "rolling_window")  # fmt: skip
        return {
            "flavour": self.flavour,
            "files": [{"name": file.path.name, "sha256": file.sha256} for file in self.files],
            "costmap": self.costmap,
            "node": self.node,
            "footprint": shape or {"radius": self.footprint.radius},
            **{name: getattr(self, name) for name in names},
            "layers": list(map(_layer_document, self.layers)),
        }

    def _repr_parts(self) -> Iterator[str]:
        yield self.node
        yield f"inscribed_radius {self.inscribed_radius:.6g} m"
        yield f"circumscribed_radius {self.circumscribed_radius:.6g} m"
        yield from (listed.name for listed in self.layers)


@dataclass(frozen=True)
class Shape:
    footprint: Footprint  # padded
    footprint_padding: float
    robot_radius: float | None
    inscribed_radius: float
    circumscribed_radius: float


def shape_of(
    corners: Corners, padding: float, radius: float | None,
    report: Callable[[str, Level, str], None],
) -> Shape | None:  # fmt: skip
    if len(corners) > MOST_CORNERS:
        report("params.too-large", "refused", f"must not have more than {MOST_CORNERS} points")
        return None
    padded = padded_corners(corners, padding)
    if radius is None:  # costmap_2d accepts outlines whose radii are meaningless
        effect = "its radii are meaningless"
        try:
            check_simple(padded, "footprint")
        except ParameterError as error:
            text = f"the outline crosses itself ({error.place}: {error.rule})"
            report("params.outline", "warning", f"{text}; {effect}")
        if not contains_centre(padded):
            text = "the robot's centre (0, 0) lies outside of the outline"
            report("params.outline", "warning", f"{text}; {effect}")
    return Shape(Footprint(vertices=padded), padding, radius, *radii_of(padded))


def erasing_layers(layers: Sequence[ListedLayer]) -> Iterator[tuple[str, str]]:
    """Yield the names of layers that overwrite the costs of a map without reading one, and why."""
    reads_map = False
    text = "replaces all costs of the layers below, by free ones until there are observations"
    for listed in layers:
        if listed.layer is not None and listed.is_enabled:
            if reads_map and listed.needs and listed.layer.overwrites_all:
                yield listed.name, text
            reads_map = reads_map or listed.layer.reads_map


LONGEST_CLASS_NAME = 100  # characters of a name that are compared with names of classes
_MISSPELT = 0.95  # likeness from which a class counts as misspelt, not as a user's own class
_MISSPELT_IN_PACKAGE = 0.9  # the same for classes that seem to be costmap_2d's own


def suggested_class(kind: str, classes: Sequence[str], prefix: str) -> str | None:
    """Return the class that a misspelt one stands for; None if it may be right."""
    package, _, plain = kind[:LONGEST_CLASS_NAME].replace("::", "/").rpartition("/")
    if kind in classes:
        return None
    if package in ("costmap_2d", "nav2_costmap_2d", ""):  # the other ROS's package, or none
        nearest = most_alike(prefix + plain, classes, least=_MISSPELT_IN_PACKAGE)
        known = (nearest or "").removeprefix(prefix)
        return None if plain != known and plain.endswith(known) else nearest  # MyStaticLayer
    return most_alike(kind[:LONGEST_CLASS_NAME], classes)


def hint_on_launch(replacement: str) -> str:
    return f"launch files replace it; pass the file that the node gets, or write the {replacement}"


def hint_on_class(kind: str, prefix: str) -> str | None:
    text = f"it is no class of {prefix[:-2]}: the node starts only if another package exports it"
    return text if kind.startswith(prefix) else None


def most_alike(word: str, names: Sequence[str], *, least: float = _MISSPELT) -> str | None:
    likeness = {name: SequenceMatcher(None, name, word).ratio() for name in names}
    nearest = max(names, key=likeness.__getitem__)
    return nearest if likeness[nearest] >= least else None


def _layer_document(listed: ListedLayer) -> dict[str, Any]:
    entry: dict[str, Any] = {"name": listed.name, "plugin": listed.plugin}
    if listed.is_filter:
        entry["filter"] = True
    if listed.layer is None:
        return entry | {"ignored": listed.why_ignored}
    if listed.needs:
        entry["needs"] = listed.needs
    values = asdict(listed.layer)
    values.pop("name")
    return entry | {"enabled": listed.is_enabled} | values


def effect_of(listed: ListedLayer, robot: RobotParameters) -> str:
    if (layer := listed.layer) is None:
        return f"ignored: {listed.why_ignored}"
    if not listed.is_enabled:
        return "switched off"
    is_effective = any(layer is effective for effective in robot.costmap_layers.effective)
    reason = layer.why_idle(True)
    if not (reason or is_effective or isinstance(layer, keepout.KeepoutFilter)):
        reason = layer.why_idle(False) or "a layer above it replaces all costs"
    if reason is not None:
        return f"no effect: {reason}"
    effect = layer.effect()
    return f"not in the file, put in front: {effect}" if listed.name == INJECTED else effect


def on_map(robot: RobotParameters, resolution: float) -> list[dict[str, Any]]:
    # ROS sends the resolution as float32: 0.45 m are 16 cells of 0.03 m, since float32(0.03) is
    # slightly less.
    cell = as_float32(resolution)
    return [
        {
            "layer": layer.name,
            "resolution": cell,
            "cell_inflation_radius": layer.reach_cells(cell),
            "reach": layer.reach_cells(cell) * cell,
            "inscribed_radius_cells": layer.inscribed_radius / cell,
            "circumscribed_cost": layer.cost_at(robot.circumscribed_radius),
        }
        for layer in robot.inflation_layers
    ]
