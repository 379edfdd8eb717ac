"""The figures of a grid as one line for a person."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeGuard

from mapdeal.grid.display import count_text
from mapdeal.grid.framed import Figures

_SHOWN_GOALS = 3
_DEEPEST = 3
"""Mappings in mappings whose entries are listed one by one."""
_COST_SHARES = ["lethal", "inscribed", "graded", "free", "unknown"]
_OCCUPANCY_SHARES = ["occupied", "between", "free", "unknown"]
_SHOWN_AS = {"between": "values 1..99", "graded": "intermediate"}
"""What people read for names of figures that say too little."""


def summary_of(figures: Figures) -> str:
    cells = figures["width"] * figures["height"]

    def share(name: str) -> str:
        percent = 100 * figures[name] / cells
        return f"{_SHOWN_AS.get(name, name)} {percent:.2f} %"

    around = ""  # of fields on a larger canvas than they were computed on
    if "without_value" in figures:
        around = f", {100 * figures['without_value'] / cells:.2f} % of the cells without a value"
    if "lowest_distance" in figures:
        least, most = figures["lowest_distance"], figures["highest_distance"]
        if least is None or most is None:
            what = "no obstacle" if figures["obstacles"] == 0 else "nothing but obstacles"
            return what + around
        return f"{least + 0.0:.4g} .. {most:.4g} m, convention {figures['convention']}{around}"
    if "lowest_potential" in figures:
        least, most = figures["lowest_potential"], figures["highest_potential"]
        x, y = figures["goal"] or (None, None)
        what = "no goal, repulsion" if x is None else f"goal {x:.10g}, {y:.10g}, potential"
        text = f"{what} {least:.5g} .. {most:.5g}"
        return f"{text}, gradient up to {figures['steepest_gradient']:.5g} per metre{around}"
    if "reachable_m2" in figures:
        return _summary_of_reach(figures)
    if "lethal" in figures:
        names = [name for name in _COST_SHARES if name in figures]
        text = ", ".join(share(name) for name in names)
        if figures.get("circumscribed_cost") is not None:
            text += f", circumscribed_cost {figures['circumscribed_cost']}"
        return text
    names = [name for name in _OCCUPANCY_SHARES if figures[name] or name != "between"]
    return ", ".join(share(name) for name in names)


def _summary_of_reach(figures: Figures) -> str:
    x, y, *_ = figures["start"]
    reached, room = figures["reachable_m2"], figures["open_m2"]
    parts = [f"from {x:.10g}, {y:.10g} the robot reaches {reached:.4g} of {room:.4g} m2 open to it"]
    goals = dict(figures.get("goals", {}))
    missed = [name for name, is_reached in goals.items() if not is_reached]
    if goals:
        parts.append(f"{len(goals) - len(missed)} of {count_text(len(goals), 'goal')}")
    if missed:
        parts[-1] += f", not {_named(missed)}"
    if figures.get("passages"):
        text = count_text(figures["passages"], "passage")
        parts.append(f"{text}, {figures['closed_passages']} closed")
    return "; ".join(parts)


def _named(names: Sequence[str]) -> str:
    more = len(names) - _SHOWN_GOALS
    return ", ".join(names[:_SHOWN_GOALS]) + f" and {more} more" * (more > 0)


def changes_between(old: Figures, new: Figures) -> list[str]:
    """Return what differs between the figures of two runs, a text each."""
    # Goals that are not reached any more come first. Of what differs within a mapping each entry is
    # listed by its own name.
    texts = []
    before, after = (figures.get("goals") for figures in (old, new))
    if are_goals(before) and are_goals(after) and set(before) == set(after):
        for is_reached, words in ((False, "no longer reachable"), (True, "reachable now")):
            turned = [name for name in after if after[name] is is_reached is not before[name]]
            if turned:
                texts.append(f"{_named(turned)} {words}")
        old, new = ({**figures, "goals": None} for figures in (old, new))
    return [*texts, *_changed_entries(old, new, "", _DEEPEST)]


def are_goals(value: object) -> TypeGuard[dict[str, bool]]:
    return isinstance(value, dict) and all(isinstance(one, bool) for one in value.values())


def _changed_entries(old: Figures, new: Figures, place: str, depth: int) -> list[str]:
    texts = []
    for name in {**old, **new}:
        one, other = old.get(name), new.get(name)
        if isinstance(one, dict) and isinstance(other, dict) and depth:
            texts += _changed_entries(one, other, f"{place}{name}.", depth - 1)
        elif one != other:
            texts.append(f"{place}{name} {one} -> {other}")
    return texts


def are_figures_of(stored: object, stages: Sequence[str]) -> TypeGuard[dict[str, Figures]]:
    """Return whether what a manifest says are figures of exactly these stages, with sizes."""
    if not isinstance(stored, dict) or set(stored) != set(stages):
        return False
    return all(
        isinstance(figures, dict) and all(_is_size(figures.get(k)) for k in ("width", "height"))
        for figures in stored.values()
    )


def _is_size(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value > 0


def said(value: object) -> str:
    """Return a value of a parameter, option or figure as a recipe would have it."""
    if value is None or isinstance(value, bool):
        return {None: "none", True: "yes", False: "no"}[value]
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {said(one)}" for key, one in value.items()) + "}"
    if isinstance(value, list):
        return f"[{', '.join(map(said, value))}]"
    return str(value)
