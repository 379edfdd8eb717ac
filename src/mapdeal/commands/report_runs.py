"""Runs in folders: what a report shows of them, from their manifests."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import islice
from pathlib import Path, PurePath
from typing import Any, TypeGuard

import numpy as np

from mapdeal.commands.build import DOCUMENT
from mapdeal.commands.diff import diff_files
from mapdeal.commands.report_answers import ComparisonAnswer, DiffAnswer, read_answer
from mapdeal.commands.report_draft import Draft, Grids
from mapdeal.commands.report_items import (
    comparison_items,
    comparison_tables,
    difference_items,
    items_of,
    tables_of,
)
from mapdeal.compare.bounds import figure_text, figures_named
from mapdeal.errors import (
    MalformedInputError,
    MapdealError,
    ParameterError,
    emit_warning,
    kept_warnings,
    one_line,
)
from mapdeal.files.json_values import NamedMap, read_json
from mapdeal.files.source import contents_of, exists, holds, is_same_file
from mapdeal.grid.costmap import CostCurve
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.inputs.listing import folders_below
from mapdeal.kernels.blocks import blocks_of
from mapdeal.pictures.styles import difference_style
from mapdeal.pipeline.batch import SUMMARY
from mapdeal.pipeline.documents import AlignmentAnswer, ScoreAnswer, ToldBound
from mapdeal.pipeline.folder import MANIFEST, manifest_in, product_of, said
from mapdeal.pipeline.settings import Settings
from mapdeal.pipeline.step import Step, make_step
from mapdeal.report.document import MAP, PageLayer, Table

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


def drafts_about(file: str, drafts: Sequence[Draft]) -> list[Draft]:
    """Return the drafts of a map or run that lint has called by a name."""
    # The map or the folder itself, wherever lint was started, counts most; then a name that a batch
    # gives a map, or a folder; then a file that a run was made of, if no other run was made of one
    # of its name.
    path = Path(file)
    same = [draft for draft in drafts if any(is_same_file(path, one) for one in draft.places)]
    if same:
        return same
    ends = [draft for draft in drafts if any(_ends_with(file, name) for name in draft.names)]
    if ends:
        return ends
    named = [draft for draft in drafts if path.name in draft.files]
    return named if len(named) == 1 else []


def _ends_with(file: str, name: str) -> bool:
    """Return whether the last parts of a path are those of a name.

    Examples
    --------
    >>> _ends_with("maps/a/one.yaml", "a/one.yaml"), _ends_with("maps/aa/one.yaml", "a/one.yaml")
    (True, False)
    """
    parts = PurePath(name).parts
    return bool(parts) and PurePath(file).parts[-len(parts) :] == parts


_MOST_ROWS = 200
_LONGEST = 200


def score_table(answer: ScoreAnswer) -> Table:
    rows = [("bound", _bound(one)) for one in answer.bounds]
    if answer.has_truth:
        rows.append(("truth", _text(answer.truth or "no file")))
    if answer.transform is not None and any(answer.transform):
        x, y, yaw = answer.transform
        rows.append(("moved by", f"x {x:.6g} m, y {y:.6g} m, yaw {math.degrees(yaw):.6g} deg"))
    size = f"{answer.width} x {answer.height} cells of {answer.resolution:.6g} m"
    rows.append(("compared on" if answer.has_truth else "size", size))
    names = figures_named(with_truth=answer.has_truth)
    known = [name for name in names if name in answer.figures]
    for name in known:
        unit, meaning = names[name]
        rows.append((f"{meaning} ({name})", figure_text(answer.figures[name], unit)))
    for name in answer.figures:
        if name not in names and name != "resolution_m":
            value = answer.figures[name]
            rows.append((_text(name), "-" if value is None else f"{value:.6g}"))
    verdict = "" if not answer.bounds else f": {'passes' if answer.passes else 'does not pass'}"
    return Table(f"Score{verdict}", tuple(rows[:_MOST_ROWS]))


def _bound(one: ToldBound) -> str:
    told = f"{_text(one.name)} {'at least' if one.is_least else 'at most'} {one.allowed:g}: "
    told += "holds" if one.holds else "missed"
    return f"{told}, {'not measured' if one.found is None else f'found {one.found:.9g}'}"


def map_of(answer: ScoreAnswer, document: Path) -> Path | None:
    if answer.file is None:
        return None
    places = (Path(answer.file), document.parent / Path(answer.file).name)
    return next((one for one in places if exists(one)), places[0])


def give_score(
    document: Path, answer: ScoreAnswer, drafts: list[Draft], grids: Grids
) -> None:  # fmt: skip
    """Add the table of a score to the entries that it is about."""
    named = None if answer.file is None else map_of(answer, document)
    owners = [] if named is None else drafts_about(str(named), drafts)
    if not owners and len(drafts) == 1:
        owners = drafts
    for draft in owners:
        draft.tables.append(score_table(answer))
        if named is not None and answer.sums:
            _check_unchanged(draft, named, answer, document, grids)
    if not owners:
        name = "a map that is not a file" if answer.file is None else _text(answer.file)
        text = f"{document}: the score of {name} is left out: the map is not shown here"
        emit_warning(text, stacklevel=2)


def _check_unchanged(
    draft: Draft, named: Path, answer: ScoreAnswer, document: Path, grids: Grids
) -> None:
    for place in (one for one in draft.paths if is_same_file(named, one)):
        if sorted(grids.open(place).sums.values()) != sorted(answer.sums.values()):
            text = f"{place}: is not the map that {document.name} scores: its checksum differs"
            draft.miss(text, place)


def _text(text: str) -> str:
    """Return a text that may come from anywhere as one short line."""
    line = one_line(text)
    return line if len(line) <= _LONGEST else f"{line[:_LONGEST]}..."


def methods_in(folder: Path, grids: Grids) -> Draft:
    """Return the draft of a folder of ``build --compare``: a layer for each method."""
    answer = read_answer(folder / DOCUMENT)
    if not isinstance(answer, ComparisonAnswer):
        raise MalformedInputError("is not a comparison of methods", source=folder / DOCUMENT)
    draft = Draft(folder.name or str(folder), folder)
    for method in answer.methods:
        _add_method(draft, method, grids)
        draft.items += comparison_items(answer, method)
    names = [layer.name for layer in draft.layers]
    if len(names) > 1:
        draft.compared = names[0], names[1]
    draft.tables[:0] = comparison_tables(answer)
    return draft


def _add_method(draft: Draft, method: str, grids: Grids) -> None:
    path = draft.path / Path(f"{method}.yaml").name
    if path in draft.paths:  # of a method of another name
        return
    draft.paths.append(path)
    try:
        opened = grids.open(path)
    except MapdealError as error:
        draft.miss(f"{one_line(str(error))}, so layer {method} is not shown", path)
        return
    draft.layers += grids.layers(path, method, f"Map by {method}")
    draft.tables.append(Table(f"{method}: SHA-256", rows_of(opened.sums)))


def two_maps(path: Path, answer: DiffAnswer, grids: Grids, settings: Settings) -> Draft:
    """Return the draft of a document of ``diff``: both maps, and what differs."""
    # The maps are read again. A map that is missing, or has changed since, is reported.
    if answer.first is None or answer.second is None:
        rule = "does not name its two maps"
        hint = "mapdeal diff A B --json also writes their names"
        raise MalformedInputError(rule, source=path, hint=hint)
    draft = Draft(f"{_stem(answer.first)} and {_stem(answer.second)}", path)
    found = [_found(draft, one, path, grids) for one in (answer.first, answer.second)]
    maps = [one for one in found if one is not None]
    for place, name, title in zip(found, ("first", "second"), ("First", "Second"), strict=True):
        if place is not None:
            layers = grids.layers(place, name, f"{title} map: {place.name}")
            draft.layers.append(layers[-1])
            draft.paths.append(place)
    if len(maps) == 2:
        _add_difference(draft, maps[0], maps[1], settings)
        draft.compared = "first", "second"
    return draft


def _stem(named: NamedMap) -> str:
    return Path(named.file).stem


def _found(draft: Draft, named: NamedMap, document: Path, grids: Grids) -> Path | None:
    """Return where a map is: as it was named, or beside the document; None if it is not there."""
    places = (Path(named.file), document.parent / Path(named.file).name)
    place = next((one for one in places if exists(one)), places[0])
    try:
        opened = grids.open(place)
    except MapdealError as error:
        draft.miss(f"{one_line(str(error))}, so this map is not shown", place)
        return None
    if named.sha256 and dict(opened.sums) != dict(named.sha256):
        text = f"{place}: is not the map that {document.name} names: its checksum differs"
        draft.miss(text, place)
    return place


def aligned_maps(path: Path, answer: AlignmentAnswer, grids: Grids) -> Draft:
    """Return the draft of a document of ``align``: the first map where it lies on the second."""
    if answer.first is None or answer.second is None:
        raise MalformedInputError("does not name its two maps", source=path)
    draft = Draft(f"{_stem(answer.first)} on {_stem(answer.second)}", path)
    titles = ("First map, moved", "Second map")
    for named, name, title in zip(
        (answer.first, answer.second), ("first", "second"), titles, strict=True
    ):
        place = _found(draft, named, path, grids)
        if place is None:
            continue
        layers = grids.layers(place, name, f"{title}: {place.name}")
        if named is answer.first:
            layers = [replace(one, frame=answer.transform.frame(one.frame)) for one in layers]
        draft.layers += layers
        draft.tables.append(Table(f"{name}: SHA-256", rows_of(grids.open(place).sums)))
    names = [layer.name for layer in draft.layers]
    if len(names) > 1:
        draft.compared = names[0], names[-1]
    return draft


def _add_difference(draft: Draft, first: Path, second: Path, settings: Settings) -> None:
    with kept_warnings():  # they were given when the maps were opened
        found = diff_files(first, second, replace(settings, image=None)).found
    style = difference_style()
    title = "What differs"
    draft.layers.append(PageLayer("difference", title, found.frame, found.changes, style))
    draft.items += difference_items(found)
