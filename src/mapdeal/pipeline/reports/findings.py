"""Which entries of a report findings of lint belong to."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path, PurePath

from mapdeal.formats.source import is_same_file
from mapdeal.pipeline.reports.draft import Draft


def drafts_about(file: str, drafts: Sequence[Draft]) -> list[Draft]:
    """Return the drafts of a map or run that lint has called by a name.

    The map or the folder itself, wherever lint was started, counts most; then a name that a batch
    gives a map, or a folder; then a file that a run was made of, if no other run was made of one
    of its name.
    """
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
