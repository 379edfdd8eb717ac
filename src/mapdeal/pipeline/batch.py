"""Several runs: none is stopped by another's failure."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from mapdeal.errors import MapdealError, refuse_warnings
from mapdeal.formats.json_text import json_of
from mapdeal.formats.source import exists
from mapdeal.formats.transaction import Transaction, make_folder
from mapdeal.pipeline.applied import RunReport
from mapdeal.pipeline.dispatch import Workers, dispatch
from mapdeal.pipeline.jobs import SUMMARY, Job, Outcome, attempt


def run_all(
    jobs: Sequence[Job],
    output: Path,
    run_one: Callable[[Job], RunReport],
    on_done: Callable[[Job, Outcome], None],
    *,
    workers: Workers | None = None,
    what: str = "map",
) -> list[Outcome]:
    """Run every job, none stopped by another's failure, and write ``summary.json``."""
    marked: dict[int, Job] = {}
    outcomes: dict[int, Outcome] = {}

    def job_of(index: int) -> Job:
        """Return the job, as it was when its turn came first."""
        if index not in marked:
            job = jobs[index]
            marked[index] = replace(job, is_new=not exists(job.folder))
        return marked[index]

    def done(index: int, outcome: Outcome) -> None:
        outcomes[index] = outcome
        on_done(jobs[index], outcome)

    refuse_warnings()
    make_folder(output)
    try:
        if workers is None:
            for index in range(len(jobs)):
                done(index, attempt(run_one, job_of(index)))
        else:
            dispatch(len(jobs), job_of, partial(attempt, run_one), workers, done)
    except KeyboardInterrupt:
        _write_summary(jobs, outcomes, output, what)
        told = f"{len(outcomes)} of {len(jobs)} {what}s are done, run the same command to continue"
        raise KeyboardInterrupt(told) from None
    except MapdealError:
        if outcomes:
            _write_summary(jobs, outcomes, output, what)
        raise
    _write_summary(jobs, outcomes, output, what)
    return [outcomes[index] for index in range(len(jobs))]


def _write_summary(
    jobs: Sequence[Job], outcomes: dict[int, Outcome], output: Path, what: str
) -> None:
    entries = [
        _entry(job, outcomes.get(index, Outcome(None)), what) for index, job in enumerate(jobs)
    ]
    summary = output / SUMMARY
    with Transaction([summary], force=True) as transaction:
        transaction.write_bytes(summary, json_of({"maps": entries}))


def _entry(job: Job, outcome: Outcome, what: str) -> dict[str, Any]:
    result = outcome.result
    entry: dict[str, Any] = {what: job.name, "folder": job.place, "status": outcome.status}
    if isinstance(result, MapdealError):
        entry |= {"exit_code": result.exit_code, "error": text_of(str(result), job)}
    elif result is not None:
        entry["figures"] = result.figures
        if getattr(result, "local", None) is not None:
            entry["local"] = result.local.figures
    texts = [text_of(text, job) for text in outcome.warnings]
    return {**entry, "warnings": texts} if texts else entry


def text_of(text: str, job: Job) -> str:
    """Return a message with files named as the summary names them, wherever one stands."""
    for path, name in ((job.folder, job.place), (job.path.parent, Path(job.name).parent)):
        if str(path) not in (".", path.anchor):
            shown = "" if str(name) == "." else f"{name}/"
            parts = re.split(rf"(?<![\w./-]){re.escape(f'{path}/')}", text)
            text = shown.join(parts)
    return text
