"""The JSON document of score, read back."""

from __future__ import annotations

from collections.abc import Mapping

from mapdeal.formats.json_values import JsonValue
from mapdeal.grid.coordinates import FARTHEST
from mapdeal.records import dataclass

_LARGEST = FARTHEST**2


@dataclass(frozen=True)
class ToldBound:
    """A bound on a figure, as in a document."""

    name: str
    is_least: bool
    allowed: float
    found: float | None
    holds: bool


@dataclass(frozen=True)
class ScoreAnswer:
    """Content of a document printed by ``mapdeal score --json``."""

    file: str | None
    truth: str | None
    sums: Mapping[str, str]
    width: int
    height: int
    resolution: float
    transform: tuple[float, float, float] | None
    has_truth: bool
    figures: Mapping[str, float | None]
    bounds: tuple[ToldBound, ...]
    passes: bool


def score_answer(document: JsonValue) -> ScoreAnswer:
    """Return the content of a document of score."""
    own, truth, moved = document["map"], document["truth"], document["transform"]
    lattice = document["lattice"]
    return ScoreAnswer(
        None if own.is_null else own["file"].text(),
        None if truth.is_null else truth["file"].text(),
        {} if own.is_null else {
            name: digest.sha256() for name, digest in own["sha256"].fields().items()
        },
        lattice["width"].whole(1),
        lattice["height"].whole(1),
        lattice["resolution"].number(least=1e-6),
        None if moved.is_null else (
            moved["x"].number(), moved["y"].number(), moved["yaw"].number()
        ),
        not moved.is_null,
        _figures(document["values"]),
        tuple(_bound(one) for one in document["bounds"].items()),
        document["passes"].flag(),
    )  # fmt: skip


def _figures(values: JsonValue) -> dict[str, float | None]:
    found: dict[str, float | None] = {}
    for name, value in values.fields().items():
        if isinstance(value.value, dict):
            for part, inner in value.fields().items():
                found[f"{name}.{part}"] = _figure(inner)
        elif not isinstance(value.value, list):  # a size, which the lattice tells too
            found[name] = _figure(value)
    return found


def _figure(value: JsonValue) -> float | None:
    return None if value.is_null else value.number(least=-_LARGEST, most=_LARGEST)


def _bound(one: JsonValue) -> ToldBound:
    return ToldBound(
        one["name"].text(),
        one["side"].word("min", "max") == "min",
        one["allowed"].number(least=-_LARGEST, most=_LARGEST),
        _figure(one["found"]),
        one["holds"].flag(),
    )
