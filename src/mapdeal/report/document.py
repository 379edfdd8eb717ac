"""Content of a report: maps with their layers, and results about them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import ParameterError
from mapdeal.grid.cost_curve import CostCurve
from mapdeal.grid.frame import Frame
from mapdeal.grid.values import Convention
from mapdeal.kernels.blocks import Layer
from mapdeal.records import dataclass
from mapdeal.render.style import LayerStyle

Points = NDArray[np.float64]

Tone = Literal["error", "warning", "note", "good", "plain"]
"""Severity of an item: its colour on the page, never the only sign of it."""

ItemKind = Literal["finding", "passage", "start", "goal", "route", "shape"]


@dataclass(frozen=True, eq=False)
class PageLayer:
    """A layer that the page shows, with its values."""

    name: str
    title: str
    frame: Frame
    values: Layer
    style: LayerStyle
    unit: str = ""
    pooled: Literal["largest", "smallest"] = "largest"
    rank: NDArray[np.uint8] | None = None
    states: str | None = None
    convention: Convention | None = None
    lethal_threshold: int = 100
    strength: float = 1.0

    def __post_init__(self) -> None:
        if self.values.shape != self.frame.shape:
            rule = f"layer {self.name} must have the shape of its frame, {self.frame.shape}"
            raise ParameterError(rule, got=self.values.shape)
        if self.values.dtype not in (np.uint8, np.float32):
            raise ParameterError("a layer holds uint8 or float32", got=self.values.dtype.name)

    @property
    def is_bytes(self) -> bool:
        """Whether values are bytes, rather than numbers."""
        return bool(self.values.dtype == np.uint8)


@dataclass(frozen=True, eq=False)
class Item:
    """Something to be listed beside the map and, if it has a place, to be shown on it."""

    kind: ItemKind
    text: str
    tone: Tone = "plain"
    place: tuple[float, float] | None = None
    lines: tuple[Points, ...] = ()
    label: str = ""


@dataclass(frozen=True)
class Table:
    """Names and values under a heading: parameters, figures, checksums."""

    title: str
    rows: tuple[tuple[str, str], ...]


@dataclass(frozen=True, eq=False)
class Entry:
    """A map, and all that there is to show and to say of it."""

    name: str
    layers: tuple[PageLayer, ...] = ()
    items: tuple[Item, ...] = ()
    tables: tuple[Table, ...] = ()
    warnings: tuple[str, ...] = ()
    status: str = ""
    figures: Mapping[str, str | float] = field(default_factory=dict)
    curve: CostCurve | None = None
    compared: tuple[str, str] | None = None
    extent: tuple[float, float, float, float] | None = None


@dataclass(frozen=True, eq=False)
class Report:
    """Content of a page."""

    title: str
    entries: tuple[Entry, ...]
    version: str
