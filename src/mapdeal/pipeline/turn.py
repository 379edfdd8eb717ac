"""Maps turned and rescaled, file to file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mapdeal.editing.rescale import rescale, rescaled_frame
from mapdeal.editing.turn import cells_when_turned, rotate, turn_of, yaw_to_straighten
from mapdeal.errors import emit_warning
from mapdeal.grid.coordinates import check_resolution
from mapdeal.grid.framed import Figures
from mapdeal.grid.resample import ResamplingRule
from mapdeal.grid.transform import Transform
from mapdeal.pipeline.edit import Editable, edit_file
from mapdeal.pipeline.memory import claim_work
from mapdeal.pipeline.settings import Settings

_TO_STRAIGHTEN = 6.0
"""Bytes for each cell while directions of walls are searched for: masks, and the edges of walls."""


def rotate_file(
    path: Path,
    output: Path,
    options: Settings,
    yaw: float | None,
    *,
    rule: ResamplingRule = "area",
    inputs: Sequence[Path] = (),
) -> tuple[Figures, Transform | None]:
    """Turn a map or costmap as `rotate` does; return its figures, and how points turn with it."""
    turn = None if yaw is None else turn_of(yaw)

    def cells(grid: Editable) -> int:
        nonlocal turn
        if turn is None:
            claim_work(path, grid, _TO_STRAIGHTEN)
            angle = yaw_to_straighten(grid)
            if angle is None:
                emit_warning(f"{path}: no direction of walls stands out, the map is not turned")
                return grid.shape[0] * grid.shape[1]
            turn = turn_of(angle)
        return cells_when_turned(grid.frame, turn.yaw)

    def change(grid: Editable) -> Editable:
        return grid if turn is None else rotate(grid, turn.yaw, rule=rule)

    figures = edit_file(path, output, options, change, what="turned", inputs=inputs, cells=cells)
    return figures, turn


def rescale_file(
    path: Path,
    output: Path,
    options: Settings,
    resolution: float,
    *,
    rule: ResamplingRule = "area",
    inputs: Sequence[Path] = (),
) -> Figures:
    """Bring a map or costmap to another resolution, as `rescale` does; return its figures."""
    check_resolution(resolution)

    def cells(grid: Editable) -> int:
        frame = rescaled_frame(grid.frame, resolution)
        return max(frame.height * frame.width, grid.shape[0] * grid.shape[1])

    return edit_file(
        path,
        output,
        options,
        lambda grid: rescale(grid, resolution, rule=rule),
        what=f"at {resolution:g} m",
        inputs=inputs,
        cells=cells,
    )
