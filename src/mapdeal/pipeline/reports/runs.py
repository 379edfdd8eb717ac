"""Runs in folders: what a report shows of them, as their manifests tell."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from mapdeal.errors import MapdealError, ParameterError, one_line
from mapdeal.formats.answers import read_answer
from mapdeal.formats.json_text import read_json
from mapdeal.formats.listing import folders_below
from mapdeal.formats.source import contents_of, exists, holds, is_folder
from mapdeal.grid.cost_curve import CostCurve
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.kernels.blocks import blocks_of
from mapdeal.pipeline.figures import said
from mapdeal.pipeline.folder import MANIFEST
from mapdeal.pipeline.jobs import SUMMARY
from mapdeal.pipeline.manifest import manifest_in, product_of
from mapdeal.pipeline.reports.draft import Draft
from mapdeal.pipeline.reports.grids import Grids
from mapdeal.pipeline.reports.items import items_of, tables_of
from mapdeal.pipeline.step import Step, make_step
from mapdeal.report.document import PageLayer, Table
from mapdeal.report.layers import MAP

INPUT = "input"
"""The name of the layer with the map that a run was given."""

_GRIDS = (".npz", ".yaml")
"""The files of a product that hold its values, the most exact first."""

_DONE = ("done", "unchanged")
_UNKNOWN_MAP = np.full((1, 1), -1, dtype=np.int8)


def runs_in(folder: Path) -> list[Draft] | None:
    """Return a draft for each run in a folder: its own, those of a batch, or those below it.

    Those that have failed have what its summary tells. None if there is none.

    Raises
    ------
    FileAccessError
        If the folder cannot be read.
    """
    if exists(folder / MANIFEST):
        local = (one for one in contents_of(folder)[0] if exists(folder / one / MANIFEST))
        return [
            Draft(folder.name or str(folder), folder),
            *(Draft(f"{folder.name}/{one}", folder / one) for one in local),
        ]
    summary = read_json(folder / SUMMARY)
    entries = summary.get("maps") if isinstance(summary, dict) else None
    if isinstance(entries, list) and all(isinstance(one, dict) for one in entries):
        return [draft for one in entries for draft in _drafts_of_batch(folder, one)]
    found = [path for path, files in folders_below([folder], contents_of) if MANIFEST in files]
    return [Draft(str(path.relative_to(folder)), path) for path in sorted(found)] or None


def _drafts_of_batch(folder: Path, told: Mapping[str, Any]) -> Iterator[Draft]:
    """Yield what a summary tells of a map, and of the local map beside it."""
    place, status = str(told.get("folder")), str(told.get("status"))
    draft = Draft(place, folder / place, status=status)
    draft.names.add(str(told.get("map")))
    if status not in _DONE:
        draft.tables.append(Table("Input", (("map", str(told.get("map"))),)))
        if "error" in told:
            draft.warn([str(told["error"])])
    yield draft
    if "local" in told:
        yield Draft(f"{place}/local", folder / place / "local", status=status)


def fill_from_run(draft: Draft, grids: Grids) -> None:
    """Add to a draft what is in the folder of its run.

    What does not match the manifest, or is not there, becomes a warning; the rest is shown.

    Raises
    ------
    MalformedInputError
        If there is no manifest of a run.
    """
    if draft.status and draft.status not in _DONE and not exists(draft.path / MANIFEST):
        return
    manifest = manifest_in(draft.path)
    draft.sums |= {str(sum_) for sum_ in _mapping(manifest, "inputs").values()}
    draft.files |= set(map(str, _mapping(manifest, "inputs")))
    _check_outputs(draft, manifest)
    for stage in manifest["stages"]:
        name, parameters = next(iter(stage.items()))
        _add_product(draft, name, manifest, grids)
        _add_answer(draft, name, manifest)
        figures = manifest["figures"].get(name)
        draft.tables.append(Table(f"{name}: parameters", rows_of(parameters)))
        if figures:
            draft.tables.append(Table(f"{name}: figures", rows_of(figures)))
        draft.curve = _curve_of(name, parameters, figures) or draft.curve
    draft.tables += [
        Table(
            "Run", (("mapdeal", said(manifest.get("version"))), *rows_of(manifest.get("options")))
        ),
        Table("Robot", rows_of(manifest.get("robot"))),
        Table("Files read, and their SHA-256", rows_of(manifest.get("inputs"))),
        Table("Files written, and their SHA-256", rows_of(manifest["outputs"])),
    ]
    draft.tables = [table for table in draft.tables if table.rows]
    draft.figures |= columns_of(manifest["figures"])
    draft.warn(map(str, manifest.get("warnings") or ()))


def _check_outputs(draft: Draft, manifest: Mapping[str, Any]) -> None:
    """Warn of files that are missing, or not those that the run has written."""
    for name, digest in manifest["outputs"].items():
        path = draft.path / Path(str(name)).name
        if not exists(path):
            draft.miss(f"{path}: is missing, though the manifest lists it", path)
        elif not is_folder(path) and not holds(path, digest):
            draft.miss(f"{path}: is not what the run has written, its checksum differs", path)


def _add_product(draft: Draft, stage: str, manifest: Mapping[str, Any], grids: Grids) -> None:
    """Add the layers of a stage's product, if its file is there."""
    product = product_of(stage)
    names = [f"{product}{ending}" for ending in _GRIDS]
    name = next((one for one in names if one in manifest["outputs"]), None)
    if name is None:
        rule = f"the run has written no values of stage {stage}"
        draft.miss(f"{draft.path / MANIFEST}: {rule}", draft.path / MANIFEST)
        return
    try:
        grids.open(draft.path / name, quietly=True)  # the run has warned of its products
    except MapdealError as error:
        text = f"{one_line(str(error))}, so layer {product} is not shown"
        draft.miss(text, draft.path / name)
        return
    add_layers(draft, grids.layers(draft.path / name, product, title_of(stage, manifest)))


def _add_answer(draft: Draft, stage: str, manifest: Mapping[str, Any]) -> None:
    """Add what a stage has answered, if it has: goals and passages of ``reach``."""
    name = f"{product_of(stage)}.json"
    if name not in manifest["outputs"]:
        return
    try:
        answer = read_answer(draft.path / name)
    except MapdealError as error:
        draft.miss(one_line(str(error)), draft.path / name)
        return
    draft.items += items_of(answer)
    draft.tables += tables_of(answer)


def add_layers(draft: Draft, layers: Iterable[PageLayer]) -> None:
    """Add layers to those of a draft, but no map of a field that is there already."""
    instead: dict[str | None, str] = {}
    for layer in layers:
        if layer.name.endswith(f"-{MAP}"):
            same = next((one for one in draft.layers if _are_equal(one, layer)), None)
            if same is not None:
                instead[layer.name] = same.name
                continue
        draft.layers.append(replace(layer, states=instead.get(layer.states, layer.states)))


def _are_equal(one: PageLayer, other: PageLayer) -> bool:
    colours = one.style.by_value, other.style.by_value
    if one.frame != other.frame or colours[0] is None or colours[1] is None:
        return False
    if not np.array_equal(colours[0], colours[1]):
        return False
    return all(np.array_equal(one.values[rows], other.values[rows])
               for rows in blocks_of(one.values))  # fmt: skip


def title_of(stage: str, manifest: Mapping[str, Any]) -> str:
    """Return what a stage of a run has done, in words."""
    step = _step_of(stage, next(s[stage] for s in manifest["stages"] if stage in s))
    title = stage if step is None else step.title
    return title[:1].upper() + title[1:]


def _step_of(stage: str, parameters: Mapping[str, Any]) -> Step | None:
    """Return the step that a manifest tells of, None if this version does not know it so."""
    with suppress(ParameterError):
        return make_step(stage, parameters)
    return None


def _curve_of(stage: str, parameters: Mapping[str, Any], figures: object) -> CostCurve | None:
    """Return the costs over the distance, if a stage makes costs that depend on it alone."""
    resolution = figures.get("resolution") if isinstance(figures, dict) else None
    step = _step_of(stage, parameters)
    if step is None or not isinstance(resolution, (int, float)):
        return None
    with suppress(MapdealError):
        return step.curve_on(OccupancyGrid(_UNKNOWN_MAP, resolution))
    return None


def columns_of(figures: Mapping[str, Any]) -> dict[str, str | float]:
    """Return figures of some stages as columns of a table of maps."""
    columns: dict[str, str | float] = {}
    for told in figures.values():
        if isinstance(told, dict):
            with suppress(LookupError, TypeError, ValueError, ZeroDivisionError):
                for name, value in _columns_of_grid(told).items():
                    columns.setdefault(name, value)
    return columns


def _columns_of_grid(told: Mapping[str, Any]) -> dict[str, str | float]:
    cells = told["width"] * told["height"]
    columns: dict[str, str | float] = {
        "cells": f"{told['width']} x {told['height']}",
        "m per cell": float(told["resolution"]),
    }
    # a costmap counts free and unknown cells, too, but on its own terms
    for name in ("lethal",) if "lethal" in told else ("occupied", "free", "unknown"):
        if name in told:
            columns[f"{name} %"] = round(100 * told[name] / cells, 2)
    for name, title in (("highest_distance", "largest clearance m"), ("reachable_m2", "reachable m2")):
        if told.get(name) is not None:
            columns[title] = round(float(told[name]), 3)
    return columns


def _mapping(manifest: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    value = manifest.get(key)
    return value if isinstance(value, dict) else {}


def rows_of(values: object) -> tuple[tuple[str, str], ...]:
    """Return names and values of a mapping as the rows of a table."""
    if not isinstance(values, dict):
        return ()
    return tuple((str(name), one_line(said(value))) for name, value in values.items())
