"""What documents tell, added to the entry that it belongs to."""

from __future__ import annotations

from mapdeal.formats.answers import (
    Answer,
    DiffAnswer,
    LintedFile,
    ReachAnswer,
    RouteAnswer,
    ShapesAnswer,
)
from mapdeal.pipeline.reports.draft import Draft
from mapdeal.pipeline.reports.items import (
    diff_tables,
    finding_items,
    lint_table,
    reach_items,
    reach_table,
    route_items,
    route_table,
    shape_items,
)


def add_answer(draft: Draft, answer: Answer) -> None:
    """Add items and tables of a document about one map, or about two, to an entry.

    Raises
    ------
    TypeError
        If it is a document of another kind.
    """
    if isinstance(answer, ReachAnswer):
        draft.items += reach_items(answer)
        draft.tables.append(reach_table(answer))
    elif isinstance(answer, RouteAnswer):
        draft.items += route_items(answer)
        draft.tables.append(route_table(answer))
    elif isinstance(answer, ShapesAnswer):
        draft.items += shape_items(answer.shapes)
    elif isinstance(answer, DiffAnswer):
        draft.tables += diff_tables(answer)
    else:
        raise TypeError(f"a {type(answer).__name__} is of no single map")


def add_findings(draft: Draft, told: LintedFile) -> None:
    """Add what lint has found in one map to its entry."""
    draft.items += finding_items(told)
    draft.tables.append(lint_table(told))
