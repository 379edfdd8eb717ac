"""What ``mapdeal run`` says of many maps: while they are run, in the end, and beforehand."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from mapdeal.cli import terminal
from mapdeal.errors import BatchError, MapdealError, one_line
from mapdeal.files.budget import size_text
from mapdeal.grid.framed import Figures
from mapdeal.pipeline.batch import (
    SUMMARY,
    Job,
    MapRun,
    Outcome,
    Plan,
    Workers,
    attempt,
    dispatch,
    plan_of,
    run_all,
    text_of,
)
from mapdeal.pipeline.folder import summary_of
from mapdeal.pipeline.run import RunReport

_LONGEST_REASON = 100
_LEAST_COLUMN = 8
_ALL_AROUND = 2 * math.pi - 0.1
"""Radians: with gaps as short as this there is no direction that a cloud does not cover."""


def run_single(job: Job, run: MapRun, workers: Workers | None) -> None:
    if workers is None:
        settings = replace(run.settings, progress=terminal.blocks_done)
        terminal.summary(lines_of(job.path, replace(run, settings=settings)(job)))
        return
    outcomes: list[Outcome] = []
    dispatch(
        1, lambda _: job, partial(attempt, run), workers, lambda _, done: outcomes.append(done)
    )
    for text in outcomes[0].warnings:
        terminal.warn(text)
    result = outcomes[0].result
    if isinstance(result, MapdealError):
        raise result
    if result is not None:
        terminal.summary(lines_of(job.path, result))


def run_batch(
    jobs: Sequence[Job], output: Path, run: MapRun, workers: Workers | None
) -> None:  # fmt: skip
    """Run all maps; report failures when they happen, and all maps at the end."""
    with (
        terminal.Progress(len(jobs), what="map") as bar,
        terminal.few_warnings(f"{output / SUMMARY} has them all") as warn,
    ):

        def say(job: Job, outcome: Outcome) -> None:
            for text in outcome.warnings:
                is_named = text.startswith(str(job.path.with_suffix("")))
                warn(text if is_named else f"{job.path}: {text}")
            if isinstance(outcome.result, MapdealError):
                terminal.error(outcome.result)
            elif outcome.result is not None:
                for line in lines_of(job.path, outcome.result):
                    terminal.detail(line)
            bar.advance(failed=outcome.status == "failed")

        outcomes = run_all(jobs, output, run, say, workers=workers)
    terminal.summary(_table(jobs, outcomes))
    failed = sum(outcome.status == "failed" for outcome in outcomes)
    if failed:
        raise BatchError(f"{failed} of {len(jobs)} maps failed", source=output / SUMMARY)


def lines_of(path: Path, report: RunReport) -> list[str]:
    local = [] if report.local is None else lines_of_local(path, report.local)
    if report.status == "unchanged":
        return [f"{path} -> {report.folder}: unchanged", *local]
    return [f"{path} -> {report.folder}", *lines_of_stages(report), *local]


def lines_of_local(path: Path, report: RunReport) -> list[str]:
    """Return what a local map has become of a cloud or a window, a line a stage."""
    head = f"{path} -> {report.folder}: "
    if report.status == "unchanged":
        return [f"{head}unchanged"]
    return [f"{head}{_summary_of_local(report.figures['local'])}", *lines_of_stages(report)]


def _summary_of_local(local: Figures) -> str:
    parts = []
    if "points" in local:
        parts.append(_points_in(local))
    if "from_map" in local:
        parts.append(f"{local['from_map']} cells from the map")
    if "clouds" in local:
        clouds = "1 cloud" if local["clouds"] == 1 else f"{local['clouds']} clouds"
        parts.append(f"of {clouds}, {local['from_earlier']} cells from earlier ones")
    if local.get("angle_min") is not None:
        around = local["angle_max"] - local["angle_min"] > _ALL_AROUND
        ends = f"from {local['angle_min']:.4g} to {local['angle_max']:.4g} rad of its heading"
        parts.append(f"seen {'all around' if around else ends}")
    return ", ".join([*parts, f"robot's back at {local['rear_heading']:.4g} rad"])


def _points_in(local: Figures) -> str:
    text = f"{local['marking']} of {local['points']} points in the window"
    dropped = {
        "not finite": local["not_finite"],
        "by height": local["beyond_height"],
        "by range": local["beyond_range"],
    }
    parts = [f"{count} {why}" for why, count in dropped.items() if count]
    return text + (f" (dropped: {', '.join(parts)})" if parts else "")


def lines_of_stages(report: RunReport) -> list[str]:
    width = max(_LEAST_COLUMN, *map(len, report.figures))
    return [
        f"  {stage:<{width}} {_size(figures['height'], figures['width'])} cells, "
        f"{summary_of(figures)}"
        for stage, figures in report.figures.items()
    ]


def _table(jobs: Sequence[Job], outcomes: Sequence[Outcome]) -> list[str]:
    """Return a line a map, those that failed at the end, where one looks first."""
    rows, failed = [("status", "cells", "map")], []
    for job, outcome in zip(jobs, outcomes, strict=True):
        result = outcome.result
        if isinstance(result, MapdealError):
            failed.append((f"failed ({result.exit_code})", "-", _failure(result, job)))
        elif result is not None:
            figures = next(iter(result.figures.values()))
            rows.append((result.status, _size(figures["height"], figures["width"]), job.name))
    counts = [f"{_count(outcomes, status)} {status}" for status in ("done", "unchanged", "failed")]
    return [*_aligned([*rows, *failed]), f"{_maps(len(jobs))}: {', '.join(counts)}"]


def _failure(error: MapdealError, job: Job) -> str:
    """Return the name of a map and why it has failed."""
    text = text_of(str(error), job)
    for source in (job.name, str(job.path)):
        text = text.removeprefix(f"{one_line(source)}: ")
    return f"{job.name}: {_cut(text, _LONGEST_REASON)}"


def _count(outcomes: Iterable[Outcome], status: str) -> int:
    return sum(outcome.status == status for outcome in outcomes)


def _maps(count: int) -> str:
    return "1 map" if count == 1 else f"{count} maps"


def _size(height: int, width: int) -> str:
    return f"{width} x {height}"


def _cut(text: str, length: int) -> str:
    return text if len(text) <= length else f"{text[: length - 3]}..."


def _aligned(rows: Sequence[tuple[str, ...]]) -> list[str]:
    """Return rows as lines, each column but the last as wide as its widest entry."""
    columns = list(zip(*rows, strict=True))[:-1]
    widths = [max(map(len, column)) for column in columns]
    return [
        "  ".join([*(f"{text:<{w}}" for text, w in zip(row[:-1], widths, strict=True)), row[-1]])
        for row in rows
    ]


def say_plans(
    jobs: Sequence[Job],
    run: MapRun,
    size: int | None,
    *,
    is_batch: bool,
    output: Path,
    page: Path | None = None,
) -> None:
    """Print what a run would do, and end as it would as far as that is known.

    `size` is the number of jobs at the same time, None on a cluster.
    """
    plans = [plan_of(job, run) for job in jobs]
    if not is_batch and plans[0].error is not None:
        raise plans[0].error
    rows = [
        ("what", "files", "cells", "memory", "map -> folder"),
        *(_planned(plan) for plan in sorted(plans, key=lambda plan: plan.error is not None)),
    ]
    terminal.summary(_aligned(rows))
    for plan in plans:
        for verb, paths in (("read", plan.reads), ("write", plan.writes)):
            for path in paths:
                terminal.detail(f"{plan.job.name}: {verb} {path}")
    others = [*([output / SUMMARY] if is_batch else []), *([page] if page else [])]
    terminal.summary(_totals(plans, size, others))
    wrong = [plan for plan in plans if plan.error is not None]
    if wrong:
        raise BatchError(f"{len(wrong)} of {_maps(len(plans))} would fail", source="--dry-run")


def _planned(plan: Plan) -> tuple[str, ...]:
    if plan.error is not None:
        what = f"{plan.what} ({plan.error.exit_code})"
        size = _size(plan.height, plan.width) if plan.height else "-"
        return what, "-", size, "-", _failure(plan.error, plan.job)
    files = str(len(plan.writes)) if plan.writes else "-"
    memory = "-" if plan.need is None else size_text(plan.need.memory)
    if plan.need is not None and plan.need.by_blocks:
        memory += " in blocks"
    where = f"{plan.job.name} -> {plan.job.folder}"
    return plan.what, files, _size(plan.height, plan.width), memory, where


def _totals(plans: Sequence[Plan], size: int | None, others: Sequence[Path]) -> list[str]:
    files = sum(len(plan.writes) for plan in plans)
    running = [plan for plan in plans if plan.writes]
    skipped = sum(plan.what == "unchanged" for plan in plans)
    lines = [
        f"{_maps(len(plans))}: {len(running)} to run, {skipped} unchanged, "
        f"{sum(plan.error is not None for plan in plans)} that would fail; {files} files to write"
        + (f", and {' and '.join(map(str, others))}" if others else "")
    ]
    needed = sorted((plan.need.memory for plan in plans if plan.need), reverse=True)
    if needed:
        at_once = min(size or 1, len(needed))
        text = f"memory: about {size_text(needed[0])} for the map that needs most"
        if at_once > 1:
            text += f", {size_text(sum(needed[:at_once]))} at most with {at_once} jobs"
        lines.append(text if size else f"{text}, on a worker")
    return [*lines, "nothing was written: this was --dry-run"]
