"""A stage that only tests list: it looks at a map for a robot, and hands nothing on."""

from typing import Annotated

import numpy as np

from mapdeal import Costmap, DistanceField, Footprint, OccupancyGrid
from mapdeal.command import AT_LEAST_0, METRES, RobotShape, stage, stage_of
from mapdeal.stages import catalogue
from mapdeal.stages.structured import Goals

visited = []
"""The grids that `visit` was given, the last at the end."""


@stage(
    name="visit",
    summary="Count goals.",
    title=lambda _: "visited",
    memory=4.0,
    passes_output_on=False,
    is_whole=lambda _: True,
    robot=RobotShape("radius", ("footprint",), lambda footprint: {"footprint": footprint}),
)
def visit(
    source: OccupancyGrid | DistanceField | Costmap,
    *,
    goals: Goals = (),
    radius: Annotated[float, AT_LEAST_0, METRES] = 0.0,
    footprint: Footprint | None = None,
) -> OccupancyGrid:
    """Return a map of zeros.

    Parameters
    ----------
    source : OccupancyGrid, DistanceField or Costmap
        Any of them.
    goals : tuple of Goal
        Where to.
    radius : float
        How large a round robot is, metres.
    footprint : Footprint, optional
        The robot's shape.
    """
    visited.append(source)
    return OccupancyGrid(np.zeros(source.shape, np.int8), source.resolution, source.origin)


def list_visit(monkeypatch):
    """Append the stage to the list of stages."""
    monkeypatch.setattr(catalogue, "STAGES", (*catalogue.STAGES, stage_of(visit)))
    monkeypatch.setattr(catalogue, "STAGE_NAMES", (*catalogue.STAGE_NAMES, "visit"))
    for module in ("step", "recipe"):
        monkeypatch.setattr(f"mapdeal.pipeline.{module}.STAGE_NAMES", catalogue.STAGE_NAMES)
