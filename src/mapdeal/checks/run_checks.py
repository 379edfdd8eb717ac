"""Checks of a folder that a run has written."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mapdeal.checks.finding import CHECKS, Finding, declare_check
from mapdeal.errors import FileAccessError
from mapdeal.formats.json_values import read_json
from mapdeal.formats.kinds import kind_of
from mapdeal.formats.listing import WholeFolders
from mapdeal.formats.source import contents_of, exists, holds
from mapdeal.grid.costmap import UNIFORM_SHARE

MANIFEST = "manifest.json"
LOCAL_FOLDER = "local"


def is_run(folder: Path) -> bool:
    """Return whether the manifest in a folder is, or may have been, that of a run."""
    # Programs of other kinds have files of that name, too: such a folder may hold maps.
    manifest = read_json(folder / MANIFEST)
    return manifest is None or (isinstance(manifest, dict) and "outputs" in manifest)


RUN_FOLDERS = WholeFolders(MANIFEST, is_run, "summary.json", parts=(LOCAL_FOLDER,))
"""How the folders of runs are told from those of maps."""

declare_check(
    "run.no-manifest", "error", "a folder without a map, and without the manifest of a run"
)
declare_check("run.missing-file", "error", "a file that the manifest lists is gone")
declare_check(
    "run.other-file", "error", "a file is not the manifest's: changed, or of a run that was killed"
)
declare_check(
    "run.uniform-cost",
    "warning",
    "costs that say nothing: one for nearly all cells, or no cell open",
)


def lint_run(folder: Path) -> list[Finding]:
    """Return what is wrong with a folder of outputs: files that its manifest does not know."""
    # The local map that a run has made, too, is looked at with it.
    try:
        _, files = contents_of(folder)
    except FileAccessError as error:
        return [_finding("file.access", folder, str(error).removeprefix(f"{folder}: "))]
    manifest = read_json(folder / MANIFEST)
    outputs = manifest.get("outputs") if isinstance(manifest, dict) else None
    if not isinstance(outputs, dict) or not outputs:
        kind = kind_of(folder)
        if kind is not None:
            text = f"is {kind.what}, not a folder of maps or of a run ({kind.use})"
            return [_finding("run.no-manifest", folder, text)]
        text = f"has no {MANIFEST} of a run, and no map in it or below: no .yaml with the key image"
        if MANIFEST in files:
            text = f"its {MANIFEST} is not that of a run"
        return [_finding("run.no-manifest", folder, text)]
    found = [*_of_outputs(folder, outputs), *_of_costs(folder, manifest.get("figures"))]
    if exists(folder / LOCAL_FOLDER / MANIFEST):
        found += lint_run(folder / LOCAL_FOLDER)
    return found


def _of_outputs(folder: Path, outputs: dict[str, Any]) -> Iterator[Finding]:
    for name, digest in outputs.items():
        path = folder / Path(name).name
        if not exists(path):
            yield _finding("run.missing-file", folder, f"{path.name} is gone")
        elif not holds(path, str(digest)):
            text = f"{path.name} is not the file that the manifest lists"
            yield _finding("run.other-file", folder, text)


def _of_costs(folder: Path, figures: object) -> Iterator[Finding]:
    """Look for costs that say nothing of where to drive."""
    for stage, told in figures.items() if isinstance(figures, dict) else ():
        if not isinstance(told, dict) or "most_common" not in told:
            continue
        common = told["most_common"]
        if common is None:
            yield _finding("run.uniform-cost", folder, f"{stage}: no cell is open")
        elif isinstance(common, dict):
            share, cost = common.get("share"), common.get("cost")
            if isinstance(share, float) and share > UNIFORM_SHARE:
                text = f"{stage}: {100 * share:.4g} % of the open cells cost {cost}"
                yield _finding("run.uniform-cost", folder, text)


def _finding(name: str, folder: Path, text: str) -> Finding:
    return Finding(name, CHECKS[name].severity, str(folder), text)
