"""How the values of a layer become colours: one definition for pictures and for pages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field

import numpy as np
from numpy.typing import NDArray

from mapdeal.records import dataclass
from mapdeal.render.colours import Colours


@dataclass(frozen=True)
class Swatch:
    """A legend entry: a palette index and what it stands for."""

    index: int
    label: str


@dataclass(frozen=True)
class ColourBar:
    """A scale: palette indices from bottom to top, and labels at heights 0..1."""

    indices: Sequence[int]
    ticks: Sequence[tuple[float, str]]
    unit: str


@dataclass(frozen=True)
class Scale:
    """An even scale of numbers: `levels` palette indices from `first` on, from `low` to `high`."""

    # Values beyond an end take its index, infinite ones, too.

    low: float
    high: float
    first: int
    levels: int

    @property
    def factor(self) -> float:
        return self.levels / (self.high - self.low)

    def indices(self, values: NDArray[np.floating]) -> NDArray[np.uint8]:
        steps = (values - np.float32(self.low)) * np.float32(self.factor)
        indices: NDArray[np.uint8] = np.clip(steps, 0, self.levels - 1).astype(np.uint8)
        indices += np.uint8(self.first)
        return indices


@dataclass(frozen=True, eq=False)
class LayerStyle:
    """How the values of a layer become colours."""

    colours: Colours
    by_value: NDArray[np.uint8] | None = None
    scale: Scale | None = None
    swatches: tuple[Swatch, ...] = ()
    bar: ColourBar | None = None
    labels: Mapping[int, str] = field(default_factory=dict)
    nowhere: int | None = None
    line: int | None = None
    faded_by: int | None = None
