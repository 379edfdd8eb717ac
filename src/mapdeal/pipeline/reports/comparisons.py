"""Maps beside each other: two that were compared, and those of several methods."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from mapdeal.errors import MalformedInputError, MapdealError, kept_warnings, one_line
from mapdeal.formats.alignment_json import AlignmentAnswer
from mapdeal.formats.answers import ComparisonAnswer, DiffAnswer, read_answer
from mapdeal.formats.named_map import NamedMap
from mapdeal.formats.source import exists
from mapdeal.pipeline.compare import DOCUMENT
from mapdeal.pipeline.diff import diff_files
from mapdeal.pipeline.reports.differences import difference_items
from mapdeal.pipeline.reports.draft import Draft
from mapdeal.pipeline.reports.grids import Grids
from mapdeal.pipeline.reports.items import comparison_items, comparison_tables
from mapdeal.pipeline.reports.runs import rows_of
from mapdeal.pipeline.settings import Settings
from mapdeal.render.styles import difference_style
from mapdeal.report.document import PageLayer, Table


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
    """Return the draft of a document of ``diff``: both maps, and what differs.

    The maps are read again. A map that is missing, or has changed since, is reported.
    """
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
