"""What follows from a report: a few sentences on each map, in words that need no robotics."""

from __future__ import annotations

import math
import shlex
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import PurePath
from typing import Any, get_args

from mapdeal.compare.difference import Change, CostDifference, Difference
from mapdeal.grid import footprint, frame
from mapdeal.grid.reach import GoalReach, Passage, reach_radius
from mapdeal.grid.values import count_text, decimal_text, few_text
from mapdeal.report.document import About, Claim, Entry, State, Verdict, worst_of

GEOMETRY, COST_CHANGES = "Geometry and metadata, first \u2192 second", "Changes of the cost"
MOST_CLAIMS = 3  # claims of an entry, and names in one of them: more is not read
_NEARLY_ALL = 0.9  # of the area that a robot fits in: the rest is corners behind shelves, not rooms
_NOT_MODELLED = "not modelled"  # of a layer that would add nothing to the costs of a map
_ABOUT_COSTS = {
    "inscribed_radius": "inscribed radius {:.4g} m",
    "inflation_radius": "inflation radius {:.4g} m",
    "cost_scaling_factor": "cost scaling factor {:.4g}",
}


def settled(claims: Iterable[Claim]) -> tuple[Claim, ...]:
    """Return at most three claims, of those about the same the worst, in the order of `About`."""
    # A failed run has one claim: findings of lint would repeat its reason.
    chosen: dict[About, Claim] = {}
    for claim in claims:
        known = chosen.get(claim.about)
        if known is None or worst_of([claim.state, known.state]) != known.state:
            chosen[claim.about] = claim
    if "run" in chosen and chosen["run"].state == "error":
        return (chosen["run"],)
    return tuple(chosen[about] for about in get_args(About) if about in chosen)[:MOST_CLAIMS]


def on_findings(messages: Mapping[str, Sequence[str]]) -> Claim:
    errors, warnings = messages.get("error", ()), messages.get("warning", ())
    if errors:
        text = f"The map has {count_text(len(errors), 'error')}"
        text += f" and {count_text(len(warnings), 'warning')}" if warnings else ""
        return Claim("map", "error", f"{text}: {errors[0]}", "finding")
    if warnings:
        text = f"The map has no errors, but {count_text(len(warnings), 'warning')}"
        return Claim("map", "warning", f"{text}: {warnings[0]}", "finding")
    notes = len(messages.get("note", ()))
    also = f" ({count_text(notes, 'note')})" if notes else ""
    text = f"The map is sound: no errors, no warnings{also}"
    return Claim("map", "good", text, "finding" if notes else "")


def on_costs(manifest: Mapping[str, Any]) -> Claim | None:
    stages = {name: values for stage in manifest["stages"] for name, values in stage.items()}
    costs, robot = stages.get("cost"), manifest.get("robot")
    if not isinstance(costs, dict):
        return None
    if isinstance(robot, dict):
        return _on_robot(robot, has_mask=bool(manifest.get("mask")))
    inflation = stages.get("inflate")
    radius = inflation.get("radius") if isinstance(inflation, dict) else None
    parts = [f"walls inflated by {radius:.4g} m"] if footprint.is_number(radius) and radius else []
    parts += [text.format(costs[name]) for name, text in _ABOUT_COSTS.items()
              if footprint.is_number(costs.get(name)) and costs[name]]  # fmt: skip
    assumptions = f", but with {', '.join(parts)}" if parts else ""
    text = f"The costmap is not made from the robot's own parameter file{assumptions}"
    return Claim("costmap", "warning", text, "cost: parameters")


def _on_robot(robot: Mapping[str, Any], *, has_mask: bool) -> Claim:
    files = [str(file.get("name")) for file in _dicts_in(robot.get("files"))]
    text = f"The costmap is the robot's own: {robot.get('costmap')} costmap"
    text += f" of {', '.join(files)}" if files else ""
    layers = _dicts_in(robot.get("layers"))
    left_out = [f"{layer.get('name')} (not modelled)" for layer in layers
                if layer.get("ignored") == _NOT_MODELLED]  # fmt: skip
    masked = [] if has_mask else [layer for layer in layers if layer.get("needs") == "mask"]
    left_out += [f"{layer.get('name')}, whose mask was not given (--mask)"
                 for layer in masked if layer.get("enabled")]  # fmt: skip
    text += f", but lacks {', '.join(left_out)}" if left_out else ""
    return Claim("costmap", "warning" if left_out else "good", text, "Robot")


def _dicts_in(value: object) -> list[dict[str, Any]]:
    listed = value if isinstance(value, list) else []  # anybody may have written it
    return [item for item in listed if isinstance(item, dict)]


def on_goals(
    goals: Sequence[GoalReach], passages: Sequence[Passage], robot: footprint.Footprint | None, *,
    share: float,
) -> Claim:  # fmt: skip
    # `share` is the part that it reaches of the area in which it can stand.
    who = "The robot" if robot is not None else "A point, as no robot was given,"
    missed = [answer for answer in goals if not answer.reachable]
    closed = [answer for answer in passages if not answer.is_open]
    verb = "is" if len(closed) == 1 else "are"
    shut = f"{count_text(len(closed), 'passage')} {verb} closed to it"
    if missed:
        text = f"{who} reaches {len(goals) - len(missed)} of {count_text(len(goals), 'goal')}. "
        text += f"{shut}. Not reached: " if len(closed) > 1 else "Not reached: "
        names = [_named(answer, robot) for answer in missed[:MOST_CLAIMS]]
        names += [f"{len(missed) - MOST_CLAIMS} more"] if len(missed) > MOST_CLAIMS else []
        return Claim("goals", "error", text + "; ".join(names), "goal")
    state: State = "good" if robot is not None else "warning"
    if goals:
        every = {1: "its goal", 2: "both goals"}.get(len(goals), f"all {len(goals)} goals")
        widths = [answer.limited_by.width for answer in goals if answer.limited_by is not None]
        text = f"{who} reaches {every}"
        if widths and math.isfinite(min(widths)):
            text += f"; the narrowest place on the way is {min(widths):.3g} m wide"
        return Claim("goals", state, f"{text}; {shut}" if closed else text, "goal")
    text = f"{who} gets to {100 * share:.3g} % of the area that it fits in"
    if closed:
        return Claim("goals", "warning", f"{text}: {shut}", "passage")
    state = state if share >= _NEARLY_ALL else "warning"
    return Claim("goals", state, f"{text}; no goals were given", "start")


def _named(answer: GoalReach, robot: footprint.Footprint | None) -> str:
    name = answer.goal.label
    if answer.reason is not None or answer.limited_by is None:
        return f"{name} ({answer.stopped_by or 'no way leads there'})"
    needs = 2 * reach_radius(robot)
    if answer.limited_by.width <= needs + 2 * frame.RADIUS_TOLERANCE:
        return f"{name} ({answer.limited_by.text}, the robot needs {needs:.4g} m)"
    return f"{name} (it cannot turn on the way)"


def on_difference(found: Difference, changes: Sequence[Change], unlisted: int) -> list[Claim]:
    if not found.common_cells:
        return [Claim("obstacles", "error", "The maps have no cell in common")]
    claims = []
    if changes:
        parts = []
        for kind, count in Counter(change.kind for change in changes).items():
            area = sum(change.area for change in changes if change.kind == kind)
            parts.append(f"{decimal_text(area, 3)} m2 {kind} in {count_text(count, 'place')}")
        more = f", and {count_text(unlisted, 'smaller change')}" if unlisted else ""
        text = f"Obstacles differ: {' and '.join(parts)}{more}"
        claims.append(Claim("obstacles", "warning", text, changes[0].kind))
    else:
        claims.append(Claim("obstacles", "good", "All obstacles are in the same places"))
    share = 100 * found.beyond_tolerance / found.common_cells
    alone = found.not_compared
    text = f"{share:.3g} % of the common cells differ" if share else "All common cells are equal"
    if alone:
        known = decimal_text(alone * found.frame.resolution**2, 3)
        text += f"; {known} m2 are known in the first map alone"
    claims.append(Claim("cells", "warning" if share or alone else "good", text, "What differs"))
    if found.symmetry is None:
        return [*claims, _on_geometry(found.geometry)]
    text = f"The second map would be much more like the first if {found.symmetry}"
    return [*claims, Claim("geometry", "error", text, "What differs")]


def _on_geometry(geometry: Mapping[str, object]) -> Claim:
    if not geometry:
        return Claim("geometry", "good", "Both maps cover the same cells")
    names = ", ".join(geometry)
    text = f"The maps do not cover the same cells: {names} differ{'s' * (',' not in names)}"
    return Claim("geometry", "warning", text, GEOMETRY)


def on_cost_difference(found: CostDifference) -> list[Claim]:
    if not found.common_cells:
        return [Claim("costmap", "error", "The costmaps have no cell in common")]
    closed, opened, _, _, rose, fell = found.changes.values()
    claims = [Claim("costmap", "good", "The same cells are closed in both costmaps")]
    if closed.cells or opened.cells:
        words = ((closed, "are now"), (opened, "are no longer"))
        parts = [f"{decimal_text(change.area, 3)} m2 {verb} closed"
                 for change, verb in words if change.cells]  # fmt: skip
        text = f"The closed cells differ: {' and '.join(parts)}"
        claims = [Claim("costmap", "warning", text, COST_CHANGES)]
    share = 100 * found.differing / found.common_cells
    text = "All common cells have the same cost"
    if share:
        parts = [f"{change.kind} on {decimal_text(change.area, 3)} m2"
                 for change in (rose, fell) if change.cells]  # fmt: skip
        text = f"{share:.3g} % of the common cells have another cost"
        text += f": it {' and '.join(parts)}" if parts else ""
    claims.append(Claim("cells", "warning" if share else "good", text, COST_CHANGES))
    return [*claims, _on_geometry(found.geometry)]


def on_robots(
    parameters: Sequence[str], verdict: str, reach: str, costs: CostDifference, *, passes: bool
) -> list[Claim]:
    text = f"{count_text(len(parameters), 'parameter')} of the costmap differ"
    text += f": {few_text(parameters, MOST_CLAIMS)}" if parameters else ""
    state: State = "good" if passes else "error"
    text_on_goals = f"{verdict[:1].upper()}{verdict[1:]}; reached {reach}"
    return [
        Claim("run", "good", text, "Parameters that differ"),
        Claim("goals", state, text_on_goals, "Reach" if passes else "passage"),
        on_cost_difference(costs)[0],
    ]


def verdicts_of(entries: Sequence[Entry]) -> tuple[Verdict, ...]:
    shared = shared_by(entries)
    return tuple(
        Verdict(entry.name, state_of(entry, shared), entry.claims, entry.next_command)
        for entry in entries
    )


def portable_command(command: str) -> str:
    """Return a command as pages show it, without absolute paths of this machine."""
    words = shlex.split(command)
    return shlex.join(
        PurePath(word).name if word.startswith("/") and option != "--namespace" else word
        for option, word in zip(["", *words], words, strict=False)
    )


def most_urgent(verdicts: Sequence[Verdict]) -> str:
    order = get_args(State).index
    found = [verdict for verdict in verdicts if verdict.next_command]
    return min(found, key=lambda verdict: order(verdict.state)).next_command if found else ""


def shared_by(entries: Sequence[Entry]) -> tuple[Claim, ...]:
    """Return the claims that hold alike for all of several maps on which anything was found."""
    found = [entry.claims for entry in entries if entry.layers and entry.claims]
    if len(found) < 2:
        return ()
    return tuple(claim for claim in found[0] if all(claim in claims for claims in found))


def state_of(entry: Entry, shared: Sequence[Claim] = ()) -> State:
    """Return what an entry comes to, leaving out what holds for all; by its items if without."""
    own = worst_of(claim.state for claim in entry.claims if claim not in shared)
    if own is not None:
        return own
    if shared and entry.claims:
        return "good"
    tones = {item.tone for item in entry.items}
    if "error" in tones:
        return "error"
    return "warning" if "warning" in tones or entry.warnings else "unknown"
