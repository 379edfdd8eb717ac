"""Several runs, one after the other."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from mapdeal.errors import MapdealError, ParameterError
from mapdeal.formats.json_text import json_of
from mapdeal.formats.transaction import Transaction
from mapdeal.pipeline.run import RunReport

SUMMARY = "summary.json"

# Names that Windows keeps for devices: such a folder could not be copied there.
_DEVICES = ("COM", "LPT")
_RESERVED = {"CON", "PRN", "AUX", "NUL", *(f"{d}{n}" for d in _DEVICES for n in range(1, 10))}


def folders_of(paths: Sequence[Path], output: Path) -> list[Path]:
    """Return the output folder of each map, ``output/<stem>``.

    Raises
    ------
    ParameterError
        If two maps would write into one folder.
    """
    folders: dict[Path, Path] = {}
    for path in paths:
        folder = output / path.stem
        if path.stem in ("", ".", "..") or path.stem.upper() in _RESERVED:
            rule = "the map's name makes no name for a folder"
            raise ParameterError(rule, source=path, got=path.stem)
        if len(paths) > 1 and path.stem == SUMMARY:
            raise ParameterError(f"would write into the place of {SUMMARY}", source=path)
        if folder in folders:
            rule = f"would write into {folder}, as {folders[folder]} does"
            raise ParameterError(rule, source=path)
        folders[folder] = path
    return list(folders)


def run_all(
    jobs: Sequence[tuple[Path, Path]],
    output: Path,
    run_one: Callable[[Path, Path], RunReport],
    on_error: Callable[[MapdealError], None],
) -> list[RunReport | MapdealError]:
    """Run every job, none stopped by another's failure, and write ``summary.json``.

    Parameters
    ----------
    jobs : sequence of (Path, Path)
        Map and output folder of each.
    output : Path
        Where the summary goes.
    run_one : callable
        Runs one job.
    on_error : callable
        Told of each failure when it happens.
    """
    results: list[RunReport | MapdealError] = []
    for path, folder in jobs:
        try:
            results.append(run_one(path, folder))
        except MapdealError as error:
            on_error(error)
            results.append(error)
        except Exception as problem:  # noqa: BLE001 - a bug met by one map is not to stop the rest
            text = f"internal error: {type(problem).__name__}: {problem}"
            internal = MapdealError(text, source=path, hint="this is a bug in mapdeal")
            on_error(internal)
            results.append(internal)
    document = json_of({"maps": [_entry(job, r) for job, r in zip(jobs, results, strict=True)]})
    summary = output / SUMMARY
    with Transaction([summary], force=True) as transaction:
        transaction.write_bytes(summary, document)
    return results


def _entry(job: tuple[Path, Path], result: RunReport | MapdealError) -> dict[str, Any]:
    path, folder = job
    entry: dict[str, Any] = {"map": path.name, "folder": folder.name}
    if isinstance(result, MapdealError):
        return {**entry, "status": "failed", "exit_code": result.exit_code, "error": str(result)}
    return {**entry, "status": result.status, "figures": result.figures}
