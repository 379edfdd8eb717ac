"""Numbers as whole ones whose neighbours foretell them: what compresses a distance field well.

The square of an exact distance in cells is a whole number, ``(r - r0)^2 + (c - c0)^2`` of the
nearest obstacle cell. What it differs from left + below - below left is 0 wherever those four
cells have the same nearest obstacle, which is nearly everywhere.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.values import Convention
from mapdeal.records import dataclass

Numbers = NDArray[np.float32]

SQUARE_ERROR = 1e-4
"""Metres that a distance coded by its square may be off; otherwise it is coded by steps."""

STEP = 1e-3
"""Metres of a step."""

_STEP_ERROR = 0.51 * STEP
_MOST_OTHERS = 8
_LARGEST = 2.0**31 - 16
_HIDDEN_BITS = 8
_RELATIVE_ERROR = 2.0**-16
_SMALLEST_ERROR = 1e-30


class Way(Protocol):
    """A way of telling numbers by whole ones."""

    def integers_of(self, values: Numbers) -> NDArray[np.float64]:
        """Return the whole number next to each value; anything where there is none."""

    def values_of(self, integers: NDArray[np.float64]) -> Numbers:
        """Return the value of each whole number."""

    def is_near(self, found: Numbers, values: Numbers) -> NDArray[np.bool_]:
        """Return where what was found stands for a value."""

    def header(self) -> dict[str, Any]:
        """Return what a reader must know."""


@dataclass(frozen=True)
class Squares:
    """Distances by their squares in cells: (sqrt(n) - offset) unit, negative ones alike."""

    above: tuple[float, float]
    below: tuple[float, float]

    def integers_of(self, values: Numbers) -> NDArray[np.float64]:
        """Return the signed square next to each distance."""
        is_below = values < 0
        offset, unit = self._offset_and_unit(is_below)
        squares = np.rint((np.abs(values.astype(np.float64)) / unit + offset) ** 2)
        signed: NDArray[np.float64] = np.where(is_below, -squares, squares)
        return signed

    def values_of(self, integers: NDArray[np.float64]) -> Numbers:
        """Return the distance of each signed square."""
        is_below = integers < 0
        offset, unit = self._offset_and_unit(is_below)
        distances = (np.sqrt(np.abs(integers)) - offset) * unit
        numbers: Numbers = np.where(is_below, -distances, distances).astype(np.float32)
        return numbers

    def is_near(self, found: Numbers, values: Numbers) -> NDArray[np.bool_]:
        """Return where both are the same to a tenth of a millimetre."""
        near: NDArray[np.bool_] = np.abs(found - values) <= SQUARE_ERROR
        return near

    def header(self) -> dict[str, Any]:
        """Return offsets and units."""
        return {"kind": "squares", "above": list(self.above), "below": list(self.below)}

    def _offset_and_unit(self, is_below: NDArray[np.bool_]) -> tuple[NDArray[Any], NDArray[Any]]:
        offset = np.where(is_below, self.below[0], self.above[0])
        return offset, np.where(is_below, self.below[1], self.above[1])


@dataclass(frozen=True)
class Steps:
    """Metres by steps of a millimetre."""

    step: float = STEP

    def integers_of(self, values: Numbers) -> NDArray[np.float64]:
        """Return the step next to each number."""
        return np.rint(values.astype(np.float64) / self.step)

    def values_of(self, integers: NDArray[np.float64]) -> Numbers:
        """Return the number of each step."""
        return (integers * self.step).astype(np.float32)

    def is_near(self, found: Numbers, values: Numbers) -> NDArray[np.bool_]:
        """Return where both are the same to half a millimetre."""
        near: NDArray[np.bool_] = np.abs(found - values) <= _STEP_ERROR
        return near

    def header(self) -> dict[str, Any]:
        """Return the length of a step."""
        return {"kind": "steps", "step": self.step}


@dataclass(frozen=True)
class Bits:
    """Numbers by the bits of float32, in an order that is that of the numbers."""

    hidden: int = 0

    def integers_of(self, values: Numbers) -> NDArray[np.float64]:
        """Return the bits of each number, those of negative ones turned round."""
        bits = values.view(np.int32)
        ordered = np.where(bits < 0, bits ^ 0x7FFFFFFF, bits).astype(np.float64)
        integers: NDArray[np.float64] = np.rint(ordered / 2**self.hidden)
        return integers

    def values_of(self, integers: NDArray[np.float64]) -> Numbers:
        """Return the number of each pattern of bits."""
        ordered = np.clip(integers * 2**self.hidden, -(2.0**31), 2.0**31 - 1).astype(np.int32)
        numbers: Numbers = np.where(ordered < 0, ordered ^ 0x7FFFFFFF, ordered).view(np.float32)
        return numbers

    def is_near(self, found: Numbers, values: Numbers) -> NDArray[np.bool_]:
        """Return where both are the same to five digits; exactly, if no bits are left out."""
        near: NDArray[np.bool_] = found == values
        if self.hidden:
            near = np.abs(found - values) <= _RELATIVE_ERROR * np.abs(values) + _SMALLEST_ERROR
        return near

    def header(self) -> dict[str, Any]:
        """Return how many bits are left out."""
        return {"kind": "bits", "hidden": self.hidden}


def ways_of(
    resolution: float, convention: Convention | None, strength: float, *, are_metres: bool
) -> tuple[Way, ...]:
    """Return the codings of a layer's numbers, the best first, the last one always fitting."""
    if not are_metres:
        return Bits(_HIDDEN_BITS), Bits()
    if convention is None:  # a clearance, or a width
        one, two = (0.0, resolution), (0.0, 2 * resolution)
        return Squares(one, one), Squares(two, two), Steps(), Bits()
    above, below = {"fast-planner": (0.0, 1.0), "center": (0.0, 0.0), "border": (0.5, 0.5)}[
        convention
    ]
    return Squares((above, resolution * strength), (below, resolution)), Steps(), Bits()


def packed(values: Numbers, ways: Sequence[Way]) -> bytes:
    """Return the bytes of a tile, in the first coding that holds all of its numbers."""
    for index, way in enumerate(ways):
        fit = _fit(values, way)
        if fit is not None:
            integers, top, others = fit
            planes = _planes(_folded(integers))
            header = struct.pack("<4i", index, len(planes), top, len(others))
            return b"".join([header, others.astype("<f4").tobytes(), *planes])
    raise AssertionError("the last coding holds any number")


def _fit(values: Numbers, way: Way) -> tuple[NDArray[np.int32], int, Numbers] | None:
    """Return the whole numbers of a tile, the largest, and which others follow it; None if many."""
    with np.errstate(invalid="ignore", over="ignore"):
        integers = way.integers_of(values)
        told = np.isfinite(values) & (np.abs(integers) < _LARGEST)
        told &= way.is_near(way.values_of(np.where(told, integers, 0)), values)
    if told.all():
        return integers.astype(np.int32), int(integers.max()), np.empty(0, dtype=np.float32)
    strange = values[~told]
    others = np.unique(strange)
    if len(others) > _MOST_OTHERS:
        return None
    top = int(integers[told].max()) if told.any() else 0
    integers[~told] = top + 1 + np.searchsorted(others, strange)
    return integers.astype(np.int32), top, others


def _folded(integers: NDArray[np.int32]) -> NDArray[np.uint32]:
    """Return what each number differs from the expected one, its sign in the lowest bit."""
    rest = np.diff(np.diff(integers, axis=0, prepend=np.int32(0)), axis=1, prepend=np.int32(0))
    return (rest.view(np.uint32) << np.uint32(1)) ^ (rest >> np.int32(31)).view(np.uint32)


def _planes(numbers: NDArray[np.uint32]) -> list[bytes]:
    """Return the lowest byte of all numbers, the next one of all, as far as any has one."""
    count = (int(numbers.max()).bit_length() + 7) // 8
    by_byte = numbers.astype("<u4").view(np.uint8).reshape(*numbers.shape, 4)
    return [by_byte[..., place].tobytes() for place in range(count)]
