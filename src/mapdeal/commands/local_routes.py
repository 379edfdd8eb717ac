"""Routes over local maps to a goal, of one pose or step by step along a path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from mapdeal.commands.route import route_document, warn_of_border
from mapdeal.errors import FindingError, ParameterError
from mapdeal.files.transaction import Transaction
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.frame import Point, check_point
from mapdeal.grid.reach import Route
from mapdeal.maps.reading import read_map
from mapdeal.pictures.overlay import Overlay, RouteOverlay, StepsOverlay
from mapdeal.pipeline.folder import rounded, rounded_place, write_picture
from mapdeal.pipeline.local import LocalCommon, LocalJob
from mapdeal.pipeline.settings import adding_warnings
from mapdeal.planning.goal_routes import route_in_window, shortest_over
from mapdeal.planning.routes import Terrain

ROUTE, PICTURE, STEPS = "route.json", "route.png", "routes.json"


@dataclass(frozen=True, eq=False)
class WindowPlanner:
    """Plans the shortest route from a robot in its local map to a goal, in it or beyond it."""

    goal: Point
    common: LocalCommon
    known: Terrain | None

    @classmethod
    def for_goal(cls, goal: Point, common: LocalCommon) -> WindowPlanner:
        steps, known = common.recipe.steps, None
        if not steps or steps[-1].stage.product_type is not Costmap:
            raise ParameterError("needs a recipe that ends in costs", place="route_to")
        if common.global_map is not None:
            grid: Any = common.global_map.grid
            for step in steps:
                grid = step.apply(grid, common.global_map.files[0])
            known = Terrain.of(grid)
        return cls(check_point(goal, "route_to"), common, known)

    def plan(self, job: LocalJob, number: int = 0, *, is_last: bool = True) -> Route:
        """Plan on the costs in the job's folder, and write the route and its picture there."""
        folder, x, y = job.folder, job.pose[0], job.pose[1]
        costs = self.costs_in(folder)
        terrain, goal, known = Terrain.of(costs), self.goal, self.known
        find = partial(shortest_over, terrain)
        route = route_in_window(terrain, find, (x, y), goal, by_length=True, known=known)
        files = (folder / ROUTE, folder / PICTURE)
        title = f"route {number}: {'reached' if route.reached else 'to the border'}"
        self.write(files, route_document(route), costs, title, RouteOverlay(route))
        if is_last:
            warn_of_border(route, costs)
        return route

    def plan_steps(self, jobs: Sequence[LocalJob], output: Path) -> str:
        """Plan at each pose; write all routes and the path driven, and return a line about them."""
        last = len(jobs) - 1
        routes = [self.plan(job, k, is_last=k == last) for k, job in enumerate(jobs)]
        driven = np.array([job.pose[:2] for job in jobs])
        length = float(np.hypot(*np.diff(driven, axis=0).T).sum())
        steps = [
            {"folder": job.folder.name, **route_document(route)}
            for job, route in zip(jobs, routes, strict=True)
        ]
        document: dict[str, Any] = {"goal": rounded_place(*self.goal), "driven_m": rounded(length)}
        document |= {"driven": driven.tolist(), "steps": steps}
        files, overlay = (output / STEPS, output / "routes.png"), StepsOverlay(routes, driven)
        self.write(files, document, self._canvas(jobs), f"{len(jobs)} steps", overlay)
        reached, beyond = (sum(getattr(route, name) for route in routes)
                           for name in ("reached", "beyond_window"))  # fmt: skip
        if reached + beyond < len(routes):
            rule = f"no route leads on from {len(routes) - reached - beyond} of {len(routes)} poses"
            raise FindingError(rule, source=output / STEPS)
        return (
            f"{output / STEPS}: {len(routes)} routes, {reached} to the goal, driven {length:.2f} m"
        )

    def _canvas(self, jobs: Sequence[LocalJob]) -> Costmap:
        """Return what all steps are drawn on: the costs of the global map, or of all windows."""
        if self.known is not None:
            return self.known.costmap
        costs = [self.costs_in(job.folder) for job in jobs]
        side, yaw = costs[0].resolution, costs[0].origin[2]
        lows = np.array([window.origin[:2] for window in costs])
        shapes = np.array([window.shape for window in costs])
        places = np.rint((lows - lows.min(axis=0)) / side).astype(int)[:, ::-1]
        values = np.full((places + shapes).max(axis=0), costs[0].unknown_value)
        for window, (row, col), (height, width) in zip(costs, places, shapes, strict=True):
            values[row : row + height, col : col + width] = window.cost
        x, y = lows.min(axis=0).tolist()
        layer: Any = values.astype(costs[0].cost.dtype)
        return Costmap(layer, side, (x, y, yaw), costs[0].scale)

    def costs_in(self, folder: Path) -> Costmap:
        with adding_warnings([]):  # the run that wrote these costs has shown its warnings
            costs = read_map(folder / f"{self.common.recipe.steps[-1].stage.product}.npz")
        if not isinstance(costs, Costmap):
            raise TypeError("the recipe of a planner ends in costs")
        return costs

    def write(
        self, files: tuple[Path, Path], document: Any, costs: Costmap, title: str, overlay: Overlay
    ) -> None:
        settings = self.common.settings
        with Transaction(files[: 1 + settings.images], force=True) as transaction:
            transaction.write_json(files[0], document)
            if settings.images:
                write_picture(transaction, files[1], costs, title, settings, overlay)


def describe(route: Route, path: Path) -> str:
    """Return a line about a route; raise FindingError if there is none."""
    if not (route.reached or route.beyond_window):
        raise FindingError("no route leads to the goal, nor to the border", source=path)
    ending = "to the goal" if route.reached else "to the border, the goal is beyond it"
    return f"{path}: {route.length:.2f} m {ending}"
