"""Write the JSON schemas of what the commands print with ``--json``: ``docs/schemas.py FOLDER``.

FOLDER/COMMAND.json is the schema of the document of a command, or of each line where it prints JSON
Lines; manifest.json and routes.json are those of two files in folders of outputs. Enumerations,
entries that are data classes and parameters of stages follow from the types in the code; the other
keys are listed here. The tests check all documents that commands print in them by these schemas.
"""

from __future__ import annotations

import json
import sys
from dataclasses import fields
from pathlib import Path
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from mapdeal.checks.findings import Explanation, Finding, Severity
from mapdeal.cli.main import command_names
from mapdeal.command import Parameter, Stage
from mapdeal.commands.score import Placement
from mapdeal.compare.difference import ChangeKind, WallShift
from mapdeal.compare.merge import MapCounts, Rule
from mapdeal.compare.score import Fault, ScoreBound
from mapdeal.files import json_values as formats
from mapdeal.grid.costmap import Metric
from mapdeal.grid.filters import FilterKind, SpeedUnit
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.reach import Method, PlaceOfLimit
from mapdeal.grid.values import Convention, CostScale
from mapdeal.mapping import build as mapping, evidence
from mapdeal.maps.dialects import Dialect, Mode
from mapdeal.planners.planner import Reason
from mapdeal.report.document import About, State
from mapdeal.ros.robot import CostmapName, Flavour
from mapdeal.stages.catalogue import STAGES

Schema = dict[str, Any]

DRAFT = "https://json-schema.org/draft/2020-12/schema"
ANY: Schema = {}
FLAG: Schema = {"type": "boolean"}
NUMBER: Schema = {"type": "number"}
INTEGER: Schema = {"type": "integer"}
COUNT: Schema = {"type": "integer", "minimum": 0}
TEXT: Schema = {"type": "string"}
NONE: Schema = {"type": "null"}
SHA256: Schema = {"type": "string", "pattern": "^[0-9a-f]{64}$"}


class Optional(dict[str, Any]):
    """The schema of a key that may be missing."""


def one_of(*schemas: Schema) -> Schema:
    return {"anyOf": list(schemas)}


def or_none(schema: Schema) -> Schema:
    return one_of(schema, NONE)


def words(*texts: str) -> Schema:
    return {"enum": list(texts)}


def listed(item: Schema, count: int | None = None) -> Schema:
    length = {} if count is None else {"minItems": count, "maxItems": count}
    return {"type": "array", "items": item, **length}


def table(value: Schema) -> Schema:
    return {"type": "object", "additionalProperties": value}


def record(*parts: Schema, is_open: bool = False, **keys: Schema) -> Schema:
    """Return the schema of an object with the keys of `parts` and `keys`, and no others."""
    properties: Schema = {}
    for part in parts:
        names = part["required"]
        properties |= {k: v if k in names else Optional(v) for k, v in part["properties"].items()}
        is_open = is_open or part["additionalProperties"]
    properties |= keys
    return {
        "type": "object",
        "properties": {key: dict(value) for key, value in properties.items()},
        "required": [key for key, value in properties.items() if not isinstance(value, Optional)],
        "additionalProperties": is_open,
    }


def of_type(hint: Any) -> Schema:
    """Return the schema of a value of a type; any value for types that JSON does not have."""
    simple = {bool: FLAG, int: INTEGER, float: NUMBER, str: TEXT, type(None): NONE}
    if hint in simple:
        return simple[hint]
    if hint is Footprint:
        return one_of(POINTS, record(radius=NUMBER))
    origin, values = get_origin(hint), get_args(hint)
    if origin is Literal:
        return words(*values)
    if origin in (Union, UnionType):
        return one_of(*map(of_type, values))
    return ANY


def entry_of(data_class: type[Any], *without: str) -> Schema:
    """Return the schema of a data class as `asdict` writes it."""
    hints = get_type_hints(data_class)
    names = [field.name for field in fields(data_class) if field.name not in without]
    return record(**{name: of_type(hints[name]) for name in names})


NUMBER_OR_NONE = or_none(NUMBER)
POINT = listed(NUMBER, 2)
POINTS = listed(POINT)
POSE = listed(NUMBER, 3)
PLACE = record(x=NUMBER, y=NUMBER)
AREA = record(area_m2=NUMBER)
FRAME = record(width=COUNT, height=COUNT, resolution=NUMBER, origin=POSE)
STATES = record(occupied=COUNT, free=COUNT, unknown=COUNT)
NAMED_MAP = or_none(record(file=TEXT, sha256=table(SHA256)))
NAMED_FILES = listed(record(name=TEXT, sha256=SHA256))
TRANSFORM = record(PLACE, yaw=NUMBER, yaw_deg=NUMBER)
TWO_MAPS = record(first=NAMED_MAP, second=NAMED_MAP)

# Grids, runs and their parameters

OCCUPANCY = record(FRAME, STATES, between=COUNT, without_value=Optional(COUNT))
COSTS = record(
    FRAME, cost_scale=of_type(CostScale), free=COUNT, lethal=COUNT, inscribed=Optional(COUNT),
    unknown=COUNT, graded=COUNT, most_common=or_none(record(cost=INTEGER, share=NUMBER)),
    circumscribed_cost=Optional(or_none(INTEGER)), without_value=Optional(COUNT),
)  # fmt: skip
DISTANCES = record(
    FRAME, convention=of_type(Convention), obstacles=COUNT, lowest_distance=NUMBER_OR_NONE,
    highest_distance=NUMBER_OR_NONE,
)  # fmt: skip
POTENTIAL = record(
    FRAME, goal=or_none(POINT), cost_to_go_of=Optional(TEXT), obstacles=COUNT,
    lowest_potential=NUMBER, highest_potential=NUMBER, steepest_gradient=NUMBER,
)  # fmt: skip
REACHED = record(
    FRAME, start=listed(NUMBER), reachable_m2=NUMBER, open_m2=NUMBER, free_m2=NUMBER, share=NUMBER,
    goals=table(FLAG), passages=COUNT, closed_passages=COUNT, stopped_by=table(TEXT),
)  # fmt: skip
LOCAL = record(
    OCCUPANCY, pose=POSE, angle_min=Optional(NUMBER_OR_NONE), angle_max=Optional(NUMBER_OR_NONE),
    rear_heading=NUMBER_OR_NONE, is_open=True,
)  # fmt: skip
GRID = one_of(OCCUPANCY, COSTS, DISTANCES, POTENTIAL)
FIGURES = table(one_of(GRID, REACHED, LOCAL))


def of_parameter(parameter: Parameter) -> Schema:
    schema = words(*parameter.choices) if parameter.choices else of_type(parameter.kind)
    return schema if schema == ANY else or_none(schema)


def parameters_of(stage: Stage) -> Schema:
    model = {"model": words(stage.model)} if stage.model else {}
    return record(**model, **{key: of_parameter(p) for key, p in stage.parameters.items()})


def step_of(name: str) -> Schema:
    return one_of(*(parameters_of(stage) for stage in STAGES if stage.name == name))


STEPS = listed({
    "type": "object", "minProperties": 1, "maxProperties": 1,
    "properties": {stage.name: step_of(stage.name) for stage in STAGES},
})  # fmt: skip
STATUS = words("done", "unchanged", "failed")
CLAIM = record(about=of_type(About), state=of_type(State), text=TEXT)
REPORT = record(
    format=words("mapdeal-report/1"), path=TEXT, maps=COUNT, bytes=COUNT,
    state=or_none(of_type(State)),
    entries=listed(record(name=TEXT, state=of_type(State), claims=listed(CLAIM), next=TEXT)),
)  # fmt: skip
CURVE = record(
    cost_scale=of_type(CostScale), metric=of_type(Metric), inscribed_radius=NUMBER_OR_NONE,
    circumscribed_radius=NUMBER_OR_NONE, circumscribed_cost=or_none(INTEGER),
    inflation_radius=NUMBER_OR_NONE, marks=table(NUMBER), reach_cells=NUMBER, reach_m=NUMBER,
    cost_at_reach=INTEGER, distances=COUNT, every_distance=FLAG,
    curve=listed(record(cells=NUMBER, distance_m=NUMBER, cost=INTEGER)),
)  # fmt: skip
LAYER = record(name=TEXT, plugin=TEXT, is_open=True)
ROBOT = record(
    flavour=of_type(Flavour), files=NAMED_FILES, costmap=of_type(CostmapName), node=TEXT,
    footprint=of_type(Footprint), robot_radius=NUMBER_OR_NONE, footprint_padding=NUMBER,
    inscribed_radius=NUMBER, circumscribed_radius=NUMBER, track_unknown_space=FLAG,
    rolling_window=FLAG, layers=listed(LAYER),
)  # fmt: skip
MANIFEST = record(
    format=words("mapdeal-run/1"), version=TEXT, inputs=table(SHA256), options=table(ANY),
    robot=Optional(ROBOT), mask=Optional(table(ANY)), stages=STEPS, figures=FIGURES,
    warnings=listed(TEXT), outputs=table(SHA256),
)  # fmt: skip

# Questions about a map

PASSAGE = record(
    PLACE, width_m=NUMBER_OR_NONE, cuts_off_m2=NUMBER_OR_NONE, open=FLAG, ends=listed(PLACE, 2)
)
LIMIT = record(PLACE, width_m=NUMBER_OR_NONE, at=of_type(PlaceOfLimit))
GOAL = record(
    PLACE, name=Optional(TEXT), reachable=FLAG, heading_count=COUNT, reason=or_none(TEXT),
    widest_radius_m=NUMBER_OR_NONE, limited_by=or_none(LIMIT), nearest_open=or_none(PLACE),
)  # fmt: skip
SHAPE = record(
    headings=COUNT, radius=Optional(NUMBER), footprint=Optional(POINTS),
    inscribed_radius=Optional(NUMBER), circumscribed_radius=Optional(NUMBER),
)  # fmt: skip
REACH = record(
    robot=SHAPE, start=record(PLACE, yaw=NUMBER_OR_NONE), through_unknown=FLAG, reachable_m2=NUMBER,
    open_m2=NUMBER, free_m2=NUMBER, share=NUMBER, goals=listed(GOAL), passages=listed(PASSAGE),
)  # fmt: skip
COSTMAP = record(costmap=of_type(CostmapName), files=NAMED_FILES)
RESULT_OF_ROUTE = record(
    reached=FLAG, start=PLACE, goal=PLACE, length_m=NUMBER_OR_NONE, min_clearance_m=NUMBER_OR_NONE,
    mean_clearance_m=NUMBER_OR_NONE, cost=NUMBER_OR_NONE, expanded=or_none(COUNT), optimal=FLAG,
)  # fmt: skip
ROUTE = record(
    RESULT_OF_ROUTE, method=of_type(Method), beyond_window=Optional(words(True)), points=POINTS,
    local_minimum=Optional(or_none(PLACE)),
)  # fmt: skip
PAIR = record(pair=COUNT)
FAILED_PAIR = record(
    PAIR, line=or_none(COUNT), error=TEXT, hint=Optional(TEXT), start=Optional(PLACE),
    goal=Optional(PLACE),
)  # fmt: skip
STEP_OF_ROUTES = record(ROUTE, folder=TEXT)
ROUTES = record(goal=PLACE, driven_m=NUMBER, driven=POINTS, steps=listed(STEP_OF_ROUTES))

CHANGE = one_of(
    record(
        parameter=TEXT, **{"from": ANY}, to=ANY, note=Optional(TEXT), scale=Optional(NUMBER),
        monotonic=Optional(words(False)), text=Optional(TEXT),
    ),
    record(PLACE, map=words("passage", "obstacle"), is_open=True),
)  # fmt: skip
PLAN = record(
    found=or_none(FLAG), reason=or_none(of_type(Reason)), detail=Optional(TEXT),
    length_m=NUMBER_OR_NONE, cost=Optional(NUMBER_OR_NONE),
)  # fmt: skip
GOAL_OF_PLAN = record(
    PLACE, PLAN, name=Optional(TEXT), yaw=NUMBER, clearance_m=Optional(NUMBER_OR_NONE),
    narrowest=Optional(record(x=NUMBER_OR_NONE, y=NUMBER_OR_NONE)),
    margins=Optional(listed(CHANGE)), changes=Optional(listed(CHANGE)), stopped_at=Optional(PLACE),
    points=listed(POSE),
)  # fmt: skip
PLANNER = record(name=TEXT, plugin=TEXT, parameters=table(ANY))
PLAN_REPORT = record(
    files=NAMED_FILES, planner=PLANNER, goals=listed(GOAL_OF_PLAN), start=POSE, map=NAMED_MAP,
    format=words(formats.PLAN_FORMAT), differences=Optional(listed(TEXT)),
)  # fmt: skip

ANSWER = record(  # places that are not finite are null, and have an error
    x=NUMBER_OR_NONE, y=NUMBER_OR_NONE, inside=FLAG, line=Optional(COUNT), error=Optional(TEXT)
)
STATE_OF_CELL = or_none(words("free", "occupied", "unknown"))
POINT_ANSWER = record(
    ANSWER, row=or_none(COUNT), col=or_none(COUNT), state=STATE_OF_CELL, distance=NUMBER_OR_NONE,
    gradient=or_none(POINT), cell_distance=NUMBER_OR_NONE,
)  # fmt: skip
POSE_ANSWER = record(
    ANSWER, yaw=NUMBER_OR_NONE, cost=or_none(INTEGER),
    state=or_none(words("free", "collision", "unknown", "outside")),
)  # fmt: skip

FILTER = record(
    AREA, kind=of_type(FilterKind), type=COUNT, base=NUMBER, multiplier=NUMBER,
    unit=Optional(of_type(SpeedUnit)),
    limits=Optional(listed(record(AREA, value=COUNT, limit=NUMBER_OR_NONE))),
)  # fmt: skip
ZONE = record(name=or_none(TEXT), speed=Optional(NUMBER))
MASK = record(FILTER, file=TEXT, mode=of_type(Mode), zones=listed(ZONE))
FILE = record(file=TEXT)
INFO_OF_MAP = record(
    FILE, FRAME, kind=TEXT, sha256=SHA256, known_box=Optional(or_none(listed(COUNT, 4))),
    dialect=Optional(of_type(Dialect)), mode=Optional(of_type(Mode)), filter=Optional(FILTER),
    made_by=Optional(ANY), is_open=True,
)  # fmt: skip
TOPIC = record(
    topic=TEXT, type=TEXT, count=COUNT, first_ns=or_none(INTEGER), last_ns=or_none(INTEGER),
    frame=or_none(TEXT), commands=listed(TEXT),
)  # fmt: skip
EDGE = record(topic=TEXT, parent=TEXT, child=TEXT, count=COUNT)
INFO_OF_BAG = record(
    FILE, kind=words("bag"), messages=COUNT, start_ns=or_none(INTEGER), end_ns=or_none(INTEGER),
    duration_s=NUMBER_OR_NONE, topics=listed(TOPIC), transforms=listed(EDGE), use=listed(TEXT),
    **{"is": TEXT},
)  # fmt: skip
INFO_OF_ROBOT = record(
    FILE, ROBOT, kind=words("robot parameters"), layers=listed(record(LAYER, effect=TEXT)),
    warnings=listed(TEXT), planners=Optional(listed(PLANNER)), map=Optional(TEXT),
    on_map=Optional(listed(record(layer=TEXT, resolution=NUMBER, is_open=True))),
)  # fmt: skip
INFO_OF_RUN = record(
    FILE, kind=words("run"), version=ANY, inputs=ANY, options=ANY, stages=ANY, figures=ANY,
    warnings=ANY, robot=Optional(ANY),
)  # fmt: skip
INFO_OF_FILE = record(FILE, kind=TEXT, figures=table(ANY), use=TEXT, **{"is": TEXT})
INFO_OF_ERROR = record(FILE, kind=words("error"), error=TEXT)

# Several maps

FAULT = entry_of(Fault, "place", "severity")
BOUND = record(allowed=NUMBER, found=NUMBER_OR_NONE, holds=FLAG)
BOUNDS = table(BOUND)
PAIRS = table(listed(ANY, 2))
WITH_BETWEEN = record(STATES, between=COUNT)
DIFFERENCE = record(
    TWO_MAPS, equal=FLAG, geometry=PAIRS, metadata=PAIRS, common_cells=COUNT, differing=COUNT,
    beyond_tolerance=COUNT, tolerance=NUMBER, known_only_in_first=COUNT,
    confusion=record(**dict.fromkeys(WITH_BETWEEN["required"], WITH_BETWEEN)),
    symmetry=or_none(TEXT), faults=listed(FAULT), transform=or_none(TRANSFORM),
    changes=listed(record(PLACE, AREA, kind=of_type(ChangeKind))),
    walls=record(first_to_second=or_none(entry_of(WallShift)),
                 second_to_first=or_none(entry_of(WallShift))),
    bounds=BOUNDS, passes=FLAG,
)  # fmt: skip
CHANGED_COSTS = record(
    AREA, cells=COUNT, regions=COUNT, by_size=Optional(table(COUNT)),
    largest=listed(record(PLACE, AREA, cells=COUNT)),
)  # fmt: skip
KINDS_OF_COSTS = ("closed", "opened", "unknown", "known", "rose", "fell")
DIFFERENT_COSTS = record(
    cost_scale=of_type(CostScale), common_cells=COUNT, differing=COUNT, differing_m2=NUMBER,
    known_only_in_first=COUNT, changes=record(**dict.fromkeys(KINDS_OF_COSTS, CHANGED_COSTS)),
)  # fmt: skip
COST_DIFFERENCE = record(
    TWO_MAPS, DIFFERENT_COSTS, format=words(formats.COST_DIFF_FORMAT), equal=FLAG, geometry=PAIRS,
    transform=or_none(TRANSFORM), bounds=BOUNDS, passes=FLAG,
)  # fmt: skip
ROBOT_DIFFERENCE = record(
    format=words(formats.ROBOT_DIFF_FORMAT), map=NAMED_MAP, mask=NAMED_MAP,
    robots=listed(record(files=listed(record(FILE, sha256=SHA256)), namespace=or_none(TEXT),
                         costmap=of_type(CostmapName)), 2),
    parameters=PAIRS, costs=DIFFERENT_COSTS, start=listed(NUMBER), reachable_m2=POINT,
    passages=record(closed=listed(PASSAGE), opened=listed(PASSAGE)),
    goals=record(lost=listed(TEXT), gained=listed(TEXT)), reach=listed(REACH, 2), passes=FLAG,
)  # fmt: skip
PLACEMENT = record(TRANSFORM, score=NUMBER, overlap=NUMBER, agreement=NUMBER_OR_NONE)
ALIGNMENT = record(
    TWO_MAPS, PLACEMENT, format=words(formats.ALIGNMENT_FORMAT), same_place=FLAG,
    reason=or_none(TEXT), transform=TRANSFORM, runner_up=NUMBER,
    runner_up_transform=or_none(TRANSFORM), bend=NUMBER_OR_NONE, bend_xy=or_none(POINT),
    chosen_by=words("score", "user"),
    candidates=listed(record(PLACEMENT, contradicting_m=NUMBER)),
)  # fmt: skip
MERGED = record(
    entry_of(MapCounts), file=or_none(TEXT), sha256=or_none(table(SHA256)), transform=TRANSFORM,
    conflicts=COUNT, conflict_share=NUMBER,
)  # fmt: skip
MERGE = record(
    rule=of_type(Rule), merged=listed(MERGED), common=COUNT, conflicts=COUNT,
    thickness=NUMBER_OR_NONE, kept=COUNT, figures=OCCUPANCY,
)  # fmt: skip
FIGURE = one_of(NUMBER_OR_NONE, listed(NUMBER), table(NUMBER_OR_NONE))
SCORE = record(
    format=words(formats.SCORE_FORMAT), map=NAMED_MAP, truth=NAMED_MAP,
    transform=or_none(record(TRANSFORM, by=of_type(Placement))), lattice=FRAME,
    verdict=or_none(TEXT), faults=listed(FAULT), values=table(FIGURE),
    bounds=listed(record(entry_of(ScoreBound), holds=FLAG)), passes=FLAG,
)  # fmt: skip

# Sensors, formats, and checks

BEAMS = entry_of(evidence.BeamCounts)
SCANNED = record(OCCUPANCY, BEAMS)
SHARES = {f"{state}_share": NUMBER for state in ("floor", "obstacle", "unknown")}
AREAS = {f"{state}_m2": NUMBER for state in ("floor", "obstacle", "unknown", "overlaid")}
OF_CLOUD = record(
    OCCUPANCY, points=COUNT, not_finite=COUNT, beyond=COUNT, at_sensor=COUNT, **SHARES, **AREAS,
    floor_height_min=NUMBER, floor_height_max=NUMBER, tilt_deg=NUMBER, noise=NUMBER,
    clearance=NUMBER, storeys=listed(NUMBER), cleared=COUNT,
)  # fmt: skip
OF_WORLD = record(OCCUPANCY, solids=COUNT, triangles=COUNT, moving=COUNT, files=COUNT)
OF_METHOD = record(
    STATES, parameters=table(ANY), one_cell_wide=COUNT, one_cell_wide_share=NUMBER_OR_NONE,
    mean_thickness_cells=NUMBER_OR_NONE, mean_thickness_m=NUMBER_OR_NONE, vanished_groups=COUNT,
    vanished_cells=COUNT, vanished=listed(ANY), bytes_per_cell=NUMBER, memory_bytes=COUNT,
    seconds=Optional(NUMBER),
)  # fmt: skip
COMPARED = of_type(mapping.Method)
COMPARISON = record(
    FRAME, BEAMS, format=words(formats.COMPARISON_FORMAT), version=TEXT, inputs=listed(TEXT),
    limits=entry_of(evidence.BeamLimits), cells_hit_three_times=COUNT, groups_hit_three_times=COUNT,
    methods=record(**dict.fromkeys(get_args(mapping.Method), OF_METHOD)),
    pairs=listed(record(first=COMPARED, second=COMPARED, differing=COUNT,
                        cells=record(**dict.fromkeys(STATES["required"], STATES)))),
)  # fmt: skip
SCANS = record(
    scans=COUNT, beams=COUNT, hits=COUNT, no_return=COUNT, too_near=COUNT, length_m=NUMBER,
    duration_s=NUMBER, visible_wall_cells=or_none(COUNT), seen_wall_cells=or_none(COUNT),
)  # fmt: skip
GRAPH = record(
    nodes=COUNT, edges=COUNT, kinds=table(COUNT), reachable_m2=NUMBER, covered_m2=NUMBER,
    cover_m=NUMBER, parts=COUNT, min_clearance_m=NUMBER_OR_NONE, length_m=NUMBER, tight_ways=COUNT,
    near_unknown_ways=COUNT,
)  # fmt: skip
OUTLINES = Optional(record(AREA, polygons=COUNT, corners=COUNT))
DRAWING = record(FILE, free=OUTLINES, reachable=OUTLINES, obstacles=OUTLINES, known=OUTLINES)
SOLID = record(
    FILE, cells=COUNT, volume_m3=NUMBER, wall_height=NUMBER, triangles=Optional(COUNT),
    boxes=Optional(COUNT),
)  # fmt: skip
PATCHES = record(components=COUNT, cells=COUNT)
CLEANED = record(
    map=NAMED_MAP, limits=table(COUNT), free_holes=PATCHES, islands=PATCHES, wall_holes=PATCHES,
    specks=PATCHES, changed=COUNT,
)  # fmt: skip
FINDING = record(entry_of(Finding, "places", "file"), places=listed(PLACE), file=Optional(TEXT))
LINTED = record(FILE, findings=listed(FINDING), suppressed=COUNT, repairs=Optional(listed(TEXT)))
TOTALS = record(**{f"{severity}s": COUNT for severity in get_args(Severity)}, suppressed=COUNT)
CHECK = record(check=TEXT, severity=of_type(Severity))

RUN = record(figures=FIGURES, local=Optional(FIGURES), why=Optional(listed(TEXT)))
JOB = record(
    map=Optional(TEXT), cloud=Optional(TEXT), folder=TEXT, status=STATUS, figures=Optional(FIGURES),
    local=Optional(FIGURES), warnings=Optional(listed(TEXT)), exit_code=Optional(COUNT),
    error=Optional(TEXT),
)  # fmt: skip
SUMMARY = record(
    maps=listed(JOB), report=Optional(REPORT), differing=Optional(listed(TEXT)),
    reach=Optional(listed(record(REACH, map=FILE, costmap=Optional(or_none(COSTMAP))))),
)  # fmt: skip
PLANNED_JOB = record(
    map=TEXT, folder=TEXT, status=words("new", "replace", "unchanged", "refused", "failed"),
    width=COUNT, height=COUNT, memory=Optional(COUNT), in_blocks=Optional(FLAG),
    reads=listed(TEXT), writes=listed(TEXT), exit_code=Optional(COUNT), error=Optional(TEXT),
)  # fmt: skip
DRY_RUN = record(dry_run=words(True), maps=listed(PLANNED_JOB), also_writes=listed(TEXT))


def of_stage(name: str) -> Schema:
    """Return the schema of a command that computes one stage."""
    document = record(parameters=step_of(name), figures=GRID)
    if name == "cost":
        return one_of(record(document, CURVE), record(document, curve=NONE))
    return CLEANED if name == "clean" else document


DOCUMENTS: dict[str, Schema] = {
    **{stage.name: of_stage(stage.name) for stage in STAGES},
    "align": ALIGNMENT,
    "build": one_of(SCANNED, OF_CLOUD, OF_WORLD, COMPARISON),
    "convert": one_of(GRID, DRAWING, SOLID, record(count=COUNT)),
    "diff": one_of(DIFFERENCE, COST_DIFFERENCE, ROBOT_DIFFERENCE),
    "edit": one_of(OCCUPANCY, COSTS),
    "graph": GRAPH,
    "info": one_of(
        INFO_OF_MAP, INFO_OF_BAG, INFO_OF_ROBOT, INFO_OF_RUN, INFO_OF_FILE, INFO_OF_ERROR
    ),
    "lint": one_of(
        record(TOTALS, parameter_files=Optional(listed(LINTED)), maps=listed(LINTED)),
        record(TOTALS, statistics=listed(record(CHECK, count=COUNT))),
        record(checks=listed(record(CHECK, entry_of(Explanation), on_request=FLAG))),
    ),
    "local": one_of(RUN, SUMMARY),
    "mask": record(map=TEXT, masks=listed(MASK), parameters=TEXT, launch=TEXT),
    "merge": MERGE,
    "pack": OCCUPANCY,
    "plan": one_of(
        PLAN_REPORT,
        record(
            plans=listed(one_of(PLAN_REPORT, record(exit_code=COUNT, error=TEXT))),
            differences=Optional(listed(TEXT)),
        ),
        record(PAIR, PLAN, poses=COUNT, changes=Optional(or_none(listed(CHANGE)))),
        FAILED_PAIR,
    ),
    "query": one_of(POINT_ANSWER, POSE_ANSWER),
    "reach": record(REACH, map=NAMED_MAP, costmap=or_none(COSTMAP)),
    "report": REPORT,
    "route": one_of(ROUTE, record(PAIR, RESULT_OF_ROUTE, method=TEXT), FAILED_PAIR),
    "run": one_of(SUMMARY, DRY_RUN),
    "scan": one_of(SCANS, record(maps=listed(record(JOB, scan=Optional(SCANS))))),
    "score": SCORE,
    "unpack": OCCUPANCY,
    "view": record(path=TEXT, opened=FLAG),
    "manifest": MANIFEST,
    "routes": ROUTES,
}  # fmt: skip
"""Schemas by command, and of files in folders of outputs."""


def write_schemas(folder: Path) -> None:
    missing = {*command_names()} - {*DOCUMENTS, "completion"}
    if missing:
        raise SystemExit(f"no schema for the JSON of {', '.join(sorted(missing))}")
    folder.mkdir(parents=True, exist_ok=True)
    for name, schema in DOCUMENTS.items():
        titled = {"$schema": DRAFT, "title": f"mapdeal {name}", **schema}
        (folder / f"{name}.json").write_text(f"{json.dumps(titled, indent=1)}\n")


if __name__ == "__main__":
    write_schemas(Path(sys.argv[1]))
