"""``mapdeal mask``: masks of Nav2's costmap filters, of zones, with all that loads them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, cast

import numpy as np

from mapdeal import errors, records
from mapdeal.checks.facts import MaskFacts, PairFacts, gather
from mapdeal.checks.lint import lint_mask
from mapdeal.command import Condition, Output, Result, Words, command
from mapdeal.commands.reach import GoalOption, RobotOption, StartOption
from mapdeal.grid import filters, occupancy, reach, values
from mapdeal.grid.footprint import Footprint
from mapdeal.kernels.lookup import histogram
from mapdeal.maps import dialects, map_server, shapes
from mapdeal.maps.reading import write_grid
from mapdeal.pictures.canvas import Image
from mapdeal.pipeline import inputs, recipe
from mapdeal.pipeline.inputs import InShell, KeepoutMask, MapInput, refuse
from mapdeal.pipeline.settings import Settings
from mapdeal.ros.filters import filter_launch, filter_parameters
from mapdeal.stages.cost import closed_by

PER_CELL = 60.0  # bytes for each cell of the map: what a robot reaches, without a mask and with it
_PARAMETERS, _LAUNCH = "filters.yaml", "filters.launch.py"
_NOT_0 = Condition("other than 0", lambda value: value != 0)


@records.dataclass(frozen=True, eq=False, repr=False)
class FilterMask:
    grid: occupancy.OccupancyGrid
    info: filters.FilterInfo
    zones: tuple[shapes.Zone, ...]
    path: Path

    @property
    def kind(self) -> filters.FilterKind:
        return self.info.kind

    @property
    def mode(self) -> dialects.Mode:
        if self.kind == "speed":
            return "scale"  # greys that all readers take for 0..100, with thresholds 1 and 0
        return "raw" if histogram(self.grid.occupancy)[1 : values.OCCUPIED].any() else "trinary"

    def document(self) -> dict[str, Any]:
        zones = [{"name": zone.name, **({} if zone.speed is None else {"speed": zone.speed})}
                 for zone in self.zones]  # fmt: skip
        named = {"file": self.path.name, "mode": self.mode, "zones": zones}
        return filters.mask_description(self.info, self.grid) | named

    def line(self) -> str:
        document = self.document()
        text = f"{self.path.name}: {values.count_text(len(self.zones), f'{self.kind} zone')}, "
        text += f"{values.decimal_text(document['area_m2'])} m2"
        if self.kind == "speed":
            found = [limit["limit"] for limit in document["limits"]]
            limits = sorted(limit for limit in found if limit is not None)
            listed = ", ".join(f"{limit:.4g} {self.info.sign}" for limit in limits)
            text += f", limited to {listed}" if listed else ""
        return text


@records.dataclass(frozen=True, eq=False, repr=False)
class FilterMasks(Result):
    map: MapInput
    masks: tuple[FilterMask, ...]
    folder: Path
    problems: tuple[str, ...] = ()  # findings about the masks, a line each

    def document(self) -> dict[str, Any]:
        masks = [mask.document() for mask in self.masks]
        files = {"parameters": _PARAMETERS, "launch": _LAUNCH}
        return {"map": self.map.name, "masks": masks, **files}

    def lines(self) -> Iterator[str]:
        yield f"{self.folder}:"
        yield from (f"  {mask.line()}" for mask in self.masks)
        yield f"  {_LAUNCH}: starts their servers, with the parameters in {_PARAMETERS}"

    def check(self) -> None:
        if self.problems:
            raise errors.FindingError("; ".join(self.problems), source=self.folder)

    def drawn(self, **look: Any) -> Image:
        from mapdeal.pictures.layers import zones_image

        masks = [(mask.grid, mask.info) for mask in self.masks]
        return zones_image(self.map.occupancy, masks, title=f"{self.map.title}: zones", **look)


@command(
    group="Changing a map",
    output=Output("DIR", "Folder for masks, parameters and launch file.", streams=False),
    shared=("robot", "files"),
    makes_costs=lambda _: False,
    example="""\
mapdeal mask examples/maps/office.yaml -o out/filters --image out/filters.png \\
    --file examples/shapes/office_filters.geojson
mapdeal mask examples/maps/office.yaml --kind keepout \\
    --file examples/shapes/office_filters.geojson --robot-radius 0.22 \\
    --from -8,0 --to dock=9,4 -o out/keepout""",
)
def mask(
    source: Annotated[Path, Words("MAP", streams=True)], *, work: InShell, output: Path,
    file: Annotated[Path, Words("ZONES")], kind: filters.FilterKind | None = None,
    speed_unit: filters.SpeedUnit = "percent", base: float | None = None,
    multiplier: Annotated[float, _NOT_0] | None = None, start: StartOption = None,
    goals: GoalOption = (), footprint: Footprint | None = None, robot: RobotOption = None,
) -> FilterMasks:  # fmt: skip
    """Make masks for Nav2's costmap filters from zones in GeoJSON.

    Writes a mask for each kind of zone, as an image with its .yaml, and for all of them together
    filters.yaml, with the parameters of the servers and the filters of the costmaps, and
    filters.launch.py, which starts the servers. Each zone is a polygon, with the property kind
    (keepout, speed or binary), for a speed zone the property speed, and optionally a name.

    A warning names keepout zones that close the only way to a part of the map. If they close a
    place given with --to, the exit code is 1.

    Parameters
    ----------
    source : path
        A map_server .yaml, a .pbm with its .yaml, or an .npz written by mapdeal.
    output : path
        Folder for masks, parameters and launch file.
    file : path
        GeoJSON file of the zones, metres in the map frame.
    kind : {'keepout', 'speed', 'binary'}, optional
        Make the mask of this kind only; zones without a kind count as this one. [default: all]
    speed_unit : {'percent', 'm/s'}
        Unit of the zones' speeds: percent of the robot's maximum, or m/s.
    base, multiplier : float, optional
        Of a speed filter: the limit is base + v x multiplier for a mask value v of 1..100.
        [default: 100 and -1 for percent; 0 and the finest step that fits for m/s]
    start : tuple of float, optional
        With keepout zones: start of the robot, metres and radians. [default: the widest place]
    goals : sequence of Goal
        With keepout zones: place that must stay reachable, such as a dock; more may follow.
    footprint : Footprint, optional
        The robot's shape, instead of that of `robot`.
    """
    zones = shapes.read_zones(file, kind)
    kinds = [kind for kind in filters.KINDS if any(zone.kind == kind for zone in zones)]
    if "speed" not in kinds:
        refuse("applies to speed zones, and there are none", base=base, multiplier=multiplier)
    if "keepout" not in kinds:
        refuse("applies to keepout zones, and there are none", start=start, goals=tuple(goals))
    paths = [output / f"{kind}_mask.yaml" for kind in kinds]
    work.outputs += [file for path in paths for file in map_server.pair_paths(path)]
    work.outputs += [output / _PARAMETERS, output / _LAUNCH]
    also = [file, *(robot.paths if robot else ())]
    (map_read,) = inputs.open_inputs(source, names=("the map",), also=also)
    inputs.claim_cells(map_read, PER_CELL)
    options: Any = {"unit": speed_unit, "base": base, "multiplier": multiplier}
    ends: Any = {"robot": recipe.planned_shape(robot, footprint), "start": start, "goals": goals}
    masks, problems = [], []
    with inputs.errors_named(map_read.name):
        for kind, path in zip(kinds, paths, strict=True):
            own = tuple(zone for zone in zones if zone.kind == kind)
            grid, info = shapes.filter_mask(map_read.occupancy, kind, own, **options)
            masks.append(FilterMask(grid, info, own, path))
            for found in lint_mask(path, mask_facts(map_read, grid, info, zones=own, **ends)):
                if found.severity == "error":
                    problems.append(f"{path.name}: {found.message}")
                else:
                    errors.emit_warning(f"{path}: {found.message}")
    result = FilterMasks(map_read, tuple(masks), output, tuple(problems))
    if work.settings.strict:
        result.check()  # before anything is written
    transaction = work.begin()
    for mask in masks:
        write_grid(transaction, mask.path, mask.grid, mode=mask.mode, extra=mask.info.entries())
    infos, names = [mask.info for mask in masks], [path.name for path in paths]
    transaction.write_bytes(output / _PARAMETERS, filter_parameters(infos).encode())
    transaction.write_bytes(output / _LAUNCH, filter_launch(kinds, _PARAMETERS, names).encode())
    return result


def read_mask(path: Path, settings: Settings, beside: MapInput) -> tuple[KeepoutMask, PairFacts]:
    with settings.reading():
        pair, _, findings = gather(path, max_cells=settings.max_cells)
    for found in findings:
        if found.severity == "error" and found.check.startswith("file."):
            kinds = {"file.access": errors.FileAccessError}
            raise kinds.get(found.check, errors.MalformedInputError)(found.message, source=path)
    if pair is None:
        rule, hint = "is no mask that Nav2 loads", "pass the .yaml of a mask"
        raise errors.MalformedInputError(rule, source=path, hint=hint)
    with errors.capture_warnings():  # warnings about maps do not apply to masks
        mask = cast("KeepoutMask", inputs.mask_of(path, settings, beside.grid))
    return mask, pair


def info_of(metadata: dialects.MapMetadata, kind: filters.FilterKind | None) -> filters.FilterInfo:
    """Return the kind of a mask and the meaning of its values: by its YAML, `kind` or its mode."""
    own = filters.FilterInfo.of(metadata.extra)
    if own is not None and kind in (None, own.kind):
        return own
    return filters.info_for(kind or ("speed" if metadata.mode == "scale" else "keepout"), ())


def mask_facts(
    map_read: MapInput, mask: occupancy.OccupancyGrid, info: filters.FilterInfo, *,
    pair: PairFacts | None = None, robot: Footprint | None = None,
    start: tuple[float, ...] | None = None, goals: Sequence[reach.Goal] = (),
    zones: Sequence[shapes.Zone] = (),
) -> MaskFacts:  # fmt: skip
    grid = map_read.occupancy
    inputs.claim_work(map_read.name, grid, PER_CELL)
    known = np.asarray(grid.occupancy) != values.UNKNOWN
    with errors.capture_warnings():  # on costs, which do not exist here
        closed = closed_by(mask, grid.frame) if info.kind == "keepout" else np.zeros_like(known)
        full = np.full(mask.shape, values.OCCUPIED, dtype=np.int8)
        inside = closed_by(mask.with_values(full), grid.frame)
    covered = int(np.count_nonzero(inside & known)) / max(int(np.count_nonzero(known)), 1)
    return MaskFacts(
        pair, mask, info, grid, map_read.name, closed, covered, robot, start, tuple(goals),
        name_of=lambda xy: shapes.name_at(zones, grid, xy),
    )  # fmt: skip
