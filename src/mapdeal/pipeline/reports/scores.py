"""The score of a map, as a report lists it."""

from __future__ import annotations

import math
from pathlib import Path

from mapdeal.errors import emit_warning, one_line
from mapdeal.formats.score_json import ScoreAnswer, ToldBound
from mapdeal.formats.source import exists, is_same_file
from mapdeal.pipeline.reports.draft import Draft
from mapdeal.pipeline.reports.findings import drafts_about
from mapdeal.pipeline.reports.grids import Grids
from mapdeal.report.document import Table
from mapdeal.scoring.names import figure_text, figures_named

_MOST_ROWS = 200
_LONGEST = 200


def score_table(answer: ScoreAnswer) -> Table:
    """Return the figures of a score, with what they mean, and its bounds."""
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
    """Return where the map of a score is: as it was named, or beside the document."""
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
