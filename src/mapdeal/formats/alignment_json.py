"""The JSON document of align, read back."""

from __future__ import annotations

from mapdeal.formats.json_values import JsonValue
from mapdeal.formats.named_map import NamedMap, named_map
from mapdeal.grid.transform import Transform
from mapdeal.records import dataclass


@dataclass(frozen=True)
class AlignmentAnswer:
    """Content of a document written by ``mapdeal align``."""

    first: NamedMap | None
    second: NamedMap | None
    transform: Transform
    same_place: bool
    reason: str | None
    score: float
    runner_up: float
    overlap: float
    agreement: float


def alignment_answer(document: JsonValue) -> AlignmentAnswer:
    """Return the content of a document of align."""
    moved, reason = document["transform"], document["reason"]
    x, y, yaw = (moved[key].number() for key in ("x", "y", "yaw"))
    return AlignmentAnswer(
        named_map(document["first"]),
        named_map(document["second"]),
        Transform(x, y, yaw),
        document["same_place"].flag(),
        None if reason.is_null else reason.text(),
        document["score"].number(least=0),
        document["runner_up"].number(least=0),
        document["overlap"].number(least=0, most=1),
        document["agreement"].number(least=0, most=1),
    )
