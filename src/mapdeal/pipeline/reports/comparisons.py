"""Findings, scores and comparisons of maps, as parts of a page."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path, PurePath

from mapdeal.errors import MalformedInputError, MapdealError, emit_warning, kept_warnings, one_line
from mapdeal.formats.answers import ComparisonAnswer, DiffAnswer, read_answer
from mapdeal.formats.documents import AlignmentAnswer, ScoreAnswer, ToldBound
from mapdeal.formats.json_values import NamedMap
from mapdeal.formats.source import exists, is_same_file
from mapdeal.pipeline.compare import DOCUMENT
from mapdeal.pipeline.diff import diff_files
from mapdeal.pipeline.reports.draft import Draft
from mapdeal.pipeline.reports.grids import Grids
from mapdeal.pipeline.reports.items import comparison_items, comparison_tables, difference_items
from mapdeal.pipeline.reports.runs import rows_of
from mapdeal.pipeline.settings import Settings
from mapdeal.render.styles import difference_style
from mapdeal.report.document import PageLayer, Table
from mapdeal.scoring.bounds import figure_text, figures_named


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
