"""What the commands of single stages have in common."""

from __future__ import annotations

import time
from pathlib import Path

from mapdeal.cli import options as opt
from mapdeal.cli import terminal
from mapdeal.formats.map_writer import Encoding
from mapdeal.grid.framed import Figures
from mapdeal.pipeline.figures import summary_of
from mapdeal.pipeline.settings import Settings
from mapdeal.pipeline.single import apply_to_file
from mapdeal.pipeline.step import make_step


def run_stage(
    name: str,
    source: Path,
    output: Path,
    parameters: dict[str, object],
    options: Settings,
    *,
    encoding: Encoding = "occupancy",
    mask: Path | None = None,
) -> None:
    """Run a stage from file to file and say what came out."""
    one = make_step(name, parameters)
    terminal.detail(opt.described(name, one.described()[name]))
    started = time.perf_counter()
    figures = apply_to_file(source, output, one, options, encoding=encoding, mask=mask)
    terminal.detail(f"{name}: {time.perf_counter() - started:.3f} s")
    say_written(output, figures)


def say_written(output: Path, figures: Figures, *, with_origin: bool = False) -> None:
    """Say in one line what was written."""
    text = f"{output}: {figures['width']} x {figures['height']} cells"
    if with_origin:
        x, y, yaw = figures["origin"]
        text += f" at {x:.10g}, {y:.10g}" + (f", yaw {yaw:.6g}" if yaw else "")
    terminal.summary([f"{text}, {summary_of(figures)}"])
