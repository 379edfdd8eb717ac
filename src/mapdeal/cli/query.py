"""``mapdeal query``: what a distance field says of points."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from mapdeal.cli import options as opt
from mapdeal.cli import terminal
from mapdeal.cli.shared_options import shared_options
from mapdeal.cli.streams import FROM_STDIN
from mapdeal.errors import FindingError, ParameterError
from mapdeal.formats.points import PointLines, read_points
from mapdeal.formats.source import chunks_of
from mapdeal.kernels.threads import use_threads
from mapdeal.pipeline.query import answers_of, field_to_ask
from mapdeal.pipeline.settings import Settings
from mapdeal.stages.esdf import esdf as esdf_stage

app = typer.Typer(rich_markup_mode=None, add_completion=False)

_STDIN = Path("-")


@app.command()
@shared_options("dialect", "max_cells", "threads", "max_memory")
def query(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="MAP", help=f"A distance field (.npz), or a map to make one of. {opt.OR_STDIN}"
        ),
        FROM_STDIN,
    ],
    at: Annotated[
        list[str] | None,
        typer.Option("--at", metavar="X,Y", help="A point, metres; more may follow."),
    ] = None,
    points: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE|-",
            help="Points in lines x,y or of JSON, from a file, or - for standard input.",
        ),
    ] = None,
    unknown: Annotated[
        str | None, opt.stage_option(esdf_stage, "unknown", "Of a map: what unknown cells are.")
    ] = None,
    convention: Annotated[
        str | None, opt.stage_option(esdf_stage, "convention", "Of a map: where zero lies.")
    ] = None,
    lethal_threshold: Annotated[
        int | None,
        opt.stage_option(
            esdf_stage, "lethal_threshold", "Of a map: occupancy of an obstacle, 1..100."),
    ] = None,
    strict: Annotated[
        bool, typer.Option("--strict", help="Exit with 1 if a point lies outside of the map.")
    ] = False,
    *,
    settings: Settings,
) -> None:  # fmt: skip
    """Tell distance, gradient and state at points, as lines of JSON.

    Distances and gradients are interpolated between the centres of cells. The gradient points
    away from obstacles, in the map frame. One line comes out for each point, in order.
    """
    if not at and points is None:
        raise ParameterError("one of the two is needed", source="--at, --points")
    asked = _of_options(at or [])
    parameters = opt.given(
        unknown=unknown, convention=convention, lethal_threshold=lethal_threshold
    )
    field = field_to_ask(source, settings, parameters)
    count = outside = bad = 0
    with use_threads(settings.threads):
        for some in _asked(asked, points):
            answers = answers_of(field, some)
            if answers.lines:
                terminal.result("\n".join(answers.lines))
            terminal.flush()
            count += len(answers.lines)
            outside += answers.outside
            bad += len(some.errors)
            if not terminal.is_read():
                break
    terminal.detail(f"{count} points, {outside} of them outside of the map")
    if bad:
        terminal.warn(f"{_name_of(points)}: {bad} of {count} hold no finite point")
    if strict and outside:
        rule = f"{outside} of {count} points are not inside of the map"
        raise FindingError(rule, source=source)


def _of_options(at: list[str]) -> PointLines:
    numbers = [opt.pair(text, "--at") for text in at]
    points = np.array(numbers, dtype=np.float64).reshape(-1, 2)
    finite = np.isfinite(points).all(axis=1)
    errors = {k: f"must be finite, got {at[k]}" for k in np.flatnonzero(~finite).tolist()}
    return PointLines(points, [0] * len(at), errors)


def _asked(first: PointLines, path: Path | None) -> Iterator[PointLines]:
    if first.lines:
        yield first
    if path is not None:
        chunks = terminal.input_chunks() if path == _STDIN else chunks_of(path)
        yield from read_points(chunks, _name_of(path))


def _name_of(path: Path | None) -> Path | str:
    if path is None:
        return "--at"
    return "standard input" if path == _STDIN else path
