"""Several runs, one after the other."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mapdeal.errors import MapdealError, MapdealWarning, ParameterError, one_line
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
    on_warning: Callable[[str], None],
    *,
    what: str = "map",
) -> list[RunReport | MapdealError]:
    """Run every job, none stopped by another's failure, and write ``summary.json``.

    Parameters
    ----------
    jobs : sequence of (Path, Path)
        Input and output folder of each.
    output : Path
        Where the summary goes.
    run_one : callable
        Runs one job.
    on_error : callable
        Told of each failure when it happens.
    on_warning : callable
        Told of each job's warnings when it is done; the summary has them, too.
    what : str
        What the summary calls the input of a job.
    """
    results: list[RunReport | MapdealError] = []
    entries: list[dict[str, Any]] = []
    for path, folder in jobs:
        with _recorded_warnings() as texts:
            result = _outcome(path, folder, run_one)
        for text in texts:
            on_warning(text)
        if isinstance(result, MapdealError):
            on_error(result)
        results.append(result)
        entry = {what: path.name, "folder": folder.name, **_entry(result)}
        entries.append({**entry, "warnings": texts} if texts else entry)
    summary = output / SUMMARY
    with Transaction([summary], force=True) as transaction:
        transaction.write_bytes(summary, json_of({"maps": entries}))
    return results


def _outcome(
    path: Path, folder: Path, run_one: Callable[[Path, Path], RunReport]
) -> RunReport | MapdealError:
    try:
        return run_one(path, folder)
    except MapdealError as error:
        return error
    except Exception as problem:  # noqa: BLE001 - a bug met by one map is not to stop the rest
        text = f"internal error: {type(problem).__name__}: {problem}"
        return MapdealError(text, source=path, hint="this is a bug in mapdeal")


@contextmanager
def _recorded_warnings() -> Iterator[list[str]]:
    """Fill a list with the texts of mapdeal's warnings in the block; others go on as they are."""
    texts: list[str] = []
    with warnings.catch_warnings():
        warnings.simplefilter("always", MapdealWarning)
        show = warnings.showwarning

        def record(message: Warning | str, category: type[Warning], *rest: Any) -> None:
            if issubclass(category, MapdealWarning):
                texts.append(one_line(str(message)))
            else:
                show(message, category, *rest)

        warnings.showwarning = record  # type: ignore[assignment]
        yield texts


def _entry(result: RunReport | MapdealError) -> dict[str, Any]:
    if isinstance(result, MapdealError):
        return {"status": "failed", "exit_code": result.exit_code, "error": str(result)}
    return {"status": result.status, "figures": result.figures}
