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
    """A layer that the page shows, with its values.

    Parameters
    ----------
    name : str
        One word, of which an entry has no two: ``cost``, ``esdf``.
    title : str
        What a person calls it, with what made it where that matters.
    frame : Frame
        Where it lies; layers of an entry may differ in it.
    values : Layer of uint8 or float32, shape of `frame`
        Bytes, or metres and other numbers; row 0 in the south. Read once, from row 0 on.
    style : LayerStyle
        How values become colours; `by_value` for bytes, `scale` for numbers.
    unit : str
        What is written behind a number: ``m``, or nothing.
    pooled : {'largest', 'smallest'}
        Which value shows where cells share a pixel. Of bytes the one with the largest `rank`.
    rank : numpy.ndarray of uint8, shape (256,), optional
        Of bytes: what `pooled` compares; the value itself if not given.
    states : str, optional
        Of a distance field: the name of the layer, on the same frame, with the map that it was
        made from, as bytes of int8 (255 is unknown).
    convention : {'fast-planner', 'center', 'border'}, optional
        Of a distance field; None for other layers.
    lethal_threshold : int
        Of a distance field and of a map: from which occupancy on a cell is an obstacle.
    strength : float
        Of a distance field: what positive distances were multiplied by.
    """

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
    """Something to be listed beside the map and, if it has a place, to be shown on it.

    Parameters
    ----------
    kind : {'finding', 'passage', 'start', 'goal', 'route', 'shape'}
        What it is.
    text : str
        What the list says, one line.
    tone : {'error', 'warning', 'note', 'good', 'plain'}
        How serious it is.
    place : tuple of float, optional
        x and y in the map frame, metres: where a click goes, and where a mark stands.
    lines : tuple of numpy.ndarray of float64, shape (N, 2)
        Lines to draw, in the map frame, metres; a closed one ends where it begins.
    label : str
        What stands beside it on the map, if anything.
    """

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
    """A map, and all that there is to show and to say of it.

    Parameters
    ----------
    name : str
        What it is called; in a report of several a row of the table.
    layers : tuple of PageLayer
        The lowest first; the page shows the last at first. May be empty, of a map that failed.
    items : tuple of Item
        Findings, passages, goals, routes, shapes.
    tables : tuple of Table
        Parameters, figures, checksums.
    warnings : tuple of str
        What was warned of, and what is wrong with the files of the report itself.
    status : str
        Of a run in a batch: what became of it.
    figures : mapping of str to str or float
        Columns of the table of several maps.
    curve : CostCurve, optional
        Costs over the distance, as the robot at hand has them.
    compared : tuple of str, optional
        Names of two layers to begin with side by side: before, and after.
    extent : tuple of float, optional
        Left, low, right and high end, in the map frame, metres, of what is shown at first: the
        known cells. All of the layers if not given.
    """

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
    """Content of a page.

    Parameters
    ----------
    title : str
        Title at the top of the page.
    entries : tuple of Entry
        Entries, at least one; the page has a table if there are several.
    version : str
        Version of mapdeal.
    """

    title: str
    entries: tuple[Entry, ...]
    version: str
