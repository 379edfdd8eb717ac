"""Parts of ``mapdeal diff``: what differs between two costmaps."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from mapdeal.command import Result
from mapdeal.commands import two_maps
from mapdeal.compare.costs import CostChange, CostDifference, compare_costmaps
from mapdeal.compare.difference import Bound, frame_around
from mapdeal.errors import ParameterError, emit_warning, one_line
from mapdeal.files.json_values import COST_DIFF_FORMAT
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.frame import Transform
from mapdeal.grid.values import count_text, decimal_text
from mapdeal.pictures.canvas import Image
from mapdeal.pictures.comparisons import difference_image
from mapdeal.pictures.styles import cost_change_codes, cost_change_style
from mapdeal.pipeline.folder import rounded
from mapdeal.pipeline.inputs import MapInput, claim_for, errors_named
from mapdeal.sensors.points import transform_document

_PER_CELL = 30
"""Bytes for each cell of a grid around both costmaps."""

_WORDS = {
    "closed": "now 253 or more", "opened": "no longer 253 or more", "unknown": "now unknown",
    "known": "no longer unknown", "rose": "cost more", "fell": "cost less",
}  # fmt: skip


def change_text(change: CostChange) -> str:
    text = (
        f"{count_text(change.cells, 'cell')} ({decimal_text(change.area)} m2) {_WORDS[change.kind]}"
    )
    if change.by_size:
        sizes = (f"{count} by {size}" for size, count in change.by_size.items() if count)
        text += f": {', '.join(sizes)}"
    text += f"; {count_text(change.regions, 'region')}, the largest "
    return text + change.largest[0].place


def costs_document(found: CostDifference) -> dict[str, Any]:
    """Return what differs between two costmaps, but not which ones they are."""
    return {
        "cost_scale": found.scale,
        "common_cells": found.common_cells,
        "differing": found.differing,
        "differing_m2": rounded(found.differing * found.frame.resolution**2),
        "known_only_in_first": found.not_compared,
        "changes": {
            change.kind: {
                "cells": change.cells,
                "area_m2": rounded(change.area),
                **({"by_size": change.by_size} if change.by_size else {}),
                "regions": change.regions,
                "largest": [
                    {"x": rounded(region.x), "y": rounded(region.y), "cells": len(region.cells),
                     "area_m2": rounded(region.area)}
                    for region in change.largest
                ],
            }
            for change in found.changes.values()
        },
    }  # fmt: skip


def costs_lines(found: CostDifference) -> Iterator[str]:
    counts = f"{found.common_cells} cells in both, {found.differing} differ"
    yield f"  costs     {counts} ({decimal_text(found.differing * found.frame.resolution**2)} m2)"
    for kind, change in found.changes.items():
        if change.cells:
            yield f"  {kind:<9} {change_text(change)}"


def costs_image(found: CostDifference, *, title: str, **look: Any) -> Image:
    return difference_image(
        change_codes(found), found.frame, title=title, style=cost_change_style(), **look
    )


def change_codes(found: CostDifference) -> Any:
    return cost_change_codes(found.first_costs, found.second_costs, found.is_common, found.masks)


@dataclass(frozen=True, eq=False, repr=False)
class CostmapDiff(Result):
    costs: CostDifference
    bounds: tuple[Bound, ...]
    maps: Sequence[MapInput]
    transform: Transform | None = None

    @property
    def passes(self) -> bool:  # type: ignore[override]
        return all(bound.holds for bound in self.bounds) if self.bounds else self.costs.is_equal

    def document(self) -> dict[str, Any]:
        return {
            "format": COST_DIFF_FORMAT,
            "first": self.maps[0].document(),
            "second": self.maps[1].document(),
            "equal": self.costs.is_equal,
            "geometry": {name: list(pair) for name, pair in self.costs.geometry.items()},
            **costs_document(self.costs),
            "transform": self.transform and transform_document(self.transform),
            "bounds": {bound.name.replace("-", "_"): bound.document() for bound in self.bounds},
            "passes": self.passes,
        }

    def lines(self) -> Iterator[str]:
        verdict = "equal costs" if self.costs.is_equal else "different costs"
        if self.bounds:
            verdict += f", {'within' if self.passes else 'beyond'} the bounds"
        yield f"{self.maps[0].name}, {self.maps[1].name}: {verdict}"
        for name, (a, b) in self.costs.geometry.items():
            yield f"  geometry  {name} {a} -> {b}"
        yield from costs_lines(self.costs)
        if self.transform is not None:
            yield two_maps.moved_line(self.transform)
        for bound in self.bounds:
            yield f"  bound     {bound.text}"

    def drawn(self, *, title: str | None = None, **look: Any) -> Image:
        names = two_maps.names_of_two(*(Path(source.name) for source in self.maps))
        shown = title or f"{' and '.join(names)}: costs that differ"
        return costs_image(self.costs, title=one_line(shown), **look)


def costmaps_compared(
    maps: Sequence[MapInput], move: Transform | None, max_differing: float | None, **reading: Any
) -> CostmapDiff:
    """Compare costs that were read, unless that takes too much memory."""
    for source in maps:
        if not isinstance(source.grid, Costmap):
            raise ParameterError("holds no costs", source=source.name)
    first, second = (cast("Costmap", source.grid) for source in maps)
    if move is not None:
        second = second.with_values(second.cost, move.inverse().frame(second.frame).origin)
    if first.scale != second.scale:
        rule = "has costs on the occupancy scale: both are compared as ROS publishes them"
        emit_warning(f"{maps[first.scale == 'costmap2d'].name}: {rule}", stacklevel=3)
    with errors_named(maps[1].name):
        frame = frame_around(first.frame, second.frame)
        size = f"{frame.width} x {frame.height} cells"
        claim_for(maps, _PER_CELL * frame.height * frame.width, size, **reading)
        found = compare_costmaps(first, second)
    bounds: tuple[Bound, ...] = ()
    if max_differing is not None:
        bounds = (Bound.on_share(max_differing, found.differing, found.common_cells),)
    two_maps.warn_of_uncovered(maps, bounds, found.not_compared)
    return CostmapDiff(found, bounds, maps, move)
