"""Runs in folders: what a report shows of them, from their manifests."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from itertools import islice
from pathlib import Path, PurePath
from typing import Any, TypeGuard

import numpy as np

from mapdeal.errors import MapdealError, ParameterError, one_line
from mapdeal.formats.answers import read_answer
from mapdeal.formats.json_values import read_json
from mapdeal.formats.listing import folders_below
from mapdeal.formats.source import contents_of, exists, holds
from mapdeal.grid.cost_curve import CostCurve
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.kernels.blocks import blocks_of
from mapdeal.pipeline.batch import SUMMARY
from mapdeal.pipeline.figures import said
from mapdeal.pipeline.folder import MANIFEST, manifest_in, product_of
from mapdeal.pipeline.reports.draft import Draft
from mapdeal.pipeline.reports.grids import Grids
from mapdeal.pipeline.reports.items import items_of, tables_of
from mapdeal.pipeline.step import Step, make_step
from mapdeal.report.document import PageLayer, Table
from mapdeal.report.layers import MAP

INPUT = "input"
"""The name of the layer with the map that a run was given."""

NOT_SHOWN = "not shown"
"""The status of a run of a batch that is in no folder of it."""

_GRIDS = (".npz", ".yaml")
"""The files of a product that hold its values, the most exact first."""

_MOST_WRONG = 20
"""Files of a run that are warned of one by one."""

_LARGEST_FIGURE = 1e15
"""Up to here a float has all whole numbers of a manifest."""

_DONE = ("done", "unchanged")

_OF_MAPS = ("occupied %", "free %", "unknown %")
"""Columns about the map that a run was made of."""
_UNKNOWN_MAP = np.full((1, 1), -1, dtype=np.int8)


def runs_in(folder: Path) -> list[Draft] | None:
    """Return a draft for each run in a folder: its own, those of a batch, or those below it."""
    # Those that have failed have what its summary contains. None if there is none.
    if exists(folder / MANIFEST):
        local = (one for one in contents_of(folder)[0] if exists(folder / one / MANIFEST))
        return [
            Draft(folder.name or str(folder), folder),
            *(Draft(f"{folder.name}/{one}", folder / one) for one in local),
        ]
    summary = read_json(folder / SUMMARY)
    entries = summary.get("maps") if isinstance(summary, dict) else None
    if isinstance(entries, list) and entries and all(isinstance(one, dict) for one in entries):
        return [draft for one in entries for draft in _drafts_of_batch(folder, one)]
    found = [path for path, files in folders_below([folder], contents_of) if MANIFEST in files]
    return [Draft(str(path.relative_to(folder)), path) for path in sorted(found)] or None


def _drafts_of_batch(folder: Path, told: Mapping[str, Any]) -> Iterator[Draft]:
    """Yield what a summary contains about a map, and about the local map beside it."""
    place, status = str(told.get("folder")), str(told.get("status"))
    if not _is_below(place):
        draft = Draft(place, folder, status=NOT_SHOWN)
        rule = "is in no folder of this batch, so it is not shown"
        draft.miss(f"{folder / SUMMARY}: {one_line(place)} {rule}", folder / SUMMARY)
        yield draft
        return
    draft = Draft(place, folder / place, status=status)
    draft.names.add(str(told.get("map")))
    if status not in _DONE:
        draft.tables.append(Table("Input", (("map", str(told.get("map"))),)))
        if "error" in told:
            draft.warn([str(told["error"])])
    yield draft
    if "local" in told:
        yield Draft(f"{place}/local", folder / place / "local", status=status)


def _is_below(place: str) -> bool:
    """Return whether a name leads into a folder, whatever there is: neither out of it nor to it."""
    parts = PurePath(place).parts
    return bool(parts) and ".." not in parts and not PurePath(place).is_absolute()


def fill_from_run(draft: Draft, grids: Grids) -> None:
    """Add to a draft what is in the folder of its run."""
    # What does not match the manifest, or is not there, becomes a warning; the rest is shown.
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
    # what a stage has made of a map says little of the map: inflated, most of it is occupied
    made = columns_of(manifest["figures"])
    draft.figures |= {name: value for name, value in made.items() if name not in _OF_MAPS}
    warnings = manifest.get("warnings")
    draft.warn(map(str, warnings if isinstance(warnings, list) else ()))


def _check_outputs(draft: Draft, manifest: Mapping[str, Any]) -> None:
    """Warn of files that are missing, or not those that the run has written."""
    wrong = _wrong_outputs(draft.path, manifest["outputs"])
    for path, rule in islice(wrong, _MOST_WRONG):
        draft.miss(f"{path}: {rule}", path)
    if left := sum(1 for _ in wrong):
        rule = f"{left} more of the files that it lists are missing, or are others"
        draft.miss(f"{draft.path / MANIFEST}: {rule}", draft.path / MANIFEST)


def _wrong_outputs(folder: Path, outputs: Mapping[str, str]) -> Iterator[tuple[Path, str]]:
    for name, digest in outputs.items():
        path = folder / Path(name).name
        if not exists(path):
            yield path, "is missing, though the manifest lists it"
        elif not holds(path, digest):
            yield path, "is not what the run wrote: its checksum differs"


def _add_product(draft: Draft, stage: str, manifest: Mapping[str, Any], grids: Grids) -> None:
    product = product_of(stage)
    names = [f"{product}{ending}" for ending in _GRIDS]
    name = next((one for one in names if one in manifest["outputs"]), None)
    if name is None:
        rule = f"the run wrote no values of stage {stage}"
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
    step = _step_of(stage, next(s[stage] for s in manifest["stages"] if stage in s))
    title = stage if step is None else step.title
    return title[:1].upper() + title[1:]


def _step_of(stage: str, parameters: Mapping[str, Any]) -> Step | None:
    with suppress(ParameterError):
        return make_step(stage, parameters)
    return None


def _curve_of(stage: str, parameters: Mapping[str, Any], figures: object) -> CostCurve | None:
    resolution: Any = figures.get("resolution") if isinstance(figures, dict) else None
    step = _step_of(stage, parameters)
    if step is None or not _is_figure(resolution):
        return None
    with suppress(MapdealError):
        return step.curve_on(OccupancyGrid(_UNKNOWN_MAP, resolution))
    return None


def columns_of(figures: Mapping[str, Any]) -> dict[str, str | float]:
    """Return figures of some stages as columns of a table of maps."""
    columns: dict[str, str | float] = {}
    for told in figures.values():
        if isinstance(told, dict):
            for name, value in _columns_of_grid(told).items():
                columns.setdefault(name, value)
    return columns


def _columns_of_grid(told: Mapping[str, Any]) -> dict[str, str | float]:
    """Return the columns of those figures that are numbers: anybody may have written them."""
    known = {name: value for name, value in told.items() if _is_figure(value)}
    cells = known.get("width", 0) * known.get("height", 0)
    columns: dict[str, str | float] = {}
    if cells > 0:
        columns["cells"] = f"{known['width']} x {known['height']}"
    if "resolution" in known:
        columns["m per cell"] = float(known["resolution"])
    # a costmap counts free and unknown cells, too, but on its own terms
    for name in ("lethal",) if "lethal" in known else ("occupied", "free", "unknown"):
        if name in known and cells > 0:
            columns[f"{name} %"] = round(100 * known[name] / cells, 2)
    if "reachable_m2" in known:
        columns["reachable m2"] = round(float(known["reachable_m2"]), 3)
    return columns


def _is_figure(value: object) -> TypeGuard[int | float]:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    return abs(value) <= _LARGEST_FIGURE


def _mapping(manifest: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    value = manifest.get(key)
    return value if isinstance(value, dict) else {}


def rows_of(values: object) -> tuple[tuple[str, str], ...]:
    """Return names and values of a mapping as the rows of a table."""
    if not isinstance(values, dict):
        return ()
    return tuple((str(name), one_line(said(value))) for name, value in values.items())
