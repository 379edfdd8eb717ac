"""Costmap filters of Nav2: the meaning of a mask's values.

References
----------
``keepout_filter.cpp``, ``speed_filter.cpp`` and ``binary_filter.cpp`` of nav2_costmap_2d;
``CostmapFilterInfo`` of nav2_msgs.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Literal, get_args

import numpy as np

from mapdeal import errors, records
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import OCCUPIED, decimal_text
from mapdeal.kernels import arrays, lookup

FilterKind = Literal["keepout", "speed", "binary"]
SpeedUnit = Literal["percent", "m/s"]
KINDS: tuple[FilterKind, ...] = get_args(FilterKind)
_TYPES = {("keepout", None): 0, ("speed", "percent"): 1, ("speed", "m/s"): 2, ("binary", None): 3}
_KEY, _UNIT, _BASE, _MULTIPLIER = "filter", "speed_unit", "filter_base", "filter_multiplier"
FILTER_KEYS = (_KEY, _UNIT, _BASE, _MULTIPLIER)  # keys that mapdeal adds to a mask's YAML file
_STEPS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.25, 0.5, 1.0)  # multipliers in m/s
_SLACK = 1e-6


@records.dataclass(frozen=True)
class FilterInfo:
    """How a filter reads its mask: value v means ``base + v * multiplier``."""

    kind: FilterKind
    unit: SpeedUnit | None = None
    base: float = 0.0
    multiplier: float = 1.0

    @property
    def type(self) -> int:
        return _TYPES[self.kind, self.unit]

    @property
    def sign(self) -> str:
        return "%" if self.unit == "percent" else "m/s"

    def limit_of(self, value: int) -> float | None:
        limit = self.base + value * self.multiplier
        is_limit = limit > 0 and (self.unit == "m/s" or limit <= 100)
        return limit if is_limit and value > 0 else None

    def value_of(self, speed: float) -> tuple[int, bool]:
        exact = (speed - self.base) / self.multiplier
        nearest = round(exact)
        is_exact = abs(exact - nearest) <= _SLACK
        value = nearest if is_exact else (math.floor if self.multiplier > 0 else math.ceil)(exact)
        if not 1 <= value <= OCCUPIED or self.limit_of(value) is None:
            every_limit = map(self.limit_of, range(1, OCCUPIED + 1))
            limits = [limit for limit in every_limit if limit is not None]
            span = f"{min(limits):.6g} .. {max(limits):.6g} {self.sign}" if limits else "no number"
            rule = f"must be {span} with base {self.base:g} and multiplier {self.multiplier:g}"
            is_small = self.unit == "percent" and 0 < speed < 1
            hint = "for a speed in m/s use --speed-unit m/s" if is_small else None
            raise errors.ParameterError(rule, place="speed", got=speed, hint=hint)
        return value, is_exact

    def entries(self) -> dict[str, Any]:
        entries: dict[str, Any] = {_KEY: self.kind}
        if self.kind == "speed":
            entries |= {_UNIT: self.unit, _BASE: self.base, _MULTIPLIER: self.multiplier}
        return entries

    @classmethod
    def of(cls, entries: Mapping[str, Any]) -> FilterInfo | None:
        """Read the filter entries of a mask's YAML file, if it has them."""
        kind, unit = entries.get(_KEY), entries.get(_UNIT)
        base, multiplier = entries.get(_BASE, 0.0), entries.get(_MULTIPLIER, 1.0)
        if not isinstance(kind, str) or (kind, unit) not in _TYPES:
            return None
        if not all(isinstance(number, int | float) for number in (base, multiplier)):
            return None
        return cls(kind, unit, float(base), float(multiplier))  # type: ignore[arg-type]


def info_for(
    kind: FilterKind, speeds: Sequence[float], *, unit: SpeedUnit = "percent",
    base: float | None = None, multiplier: float | None = None,
) -> FilterInfo:  # fmt: skip
    """Return a way to encode a mask, by which the speeds are exact if possible."""
    # Percent follows Nav2's own example: 100 - v, so that darker pixels are slower.
    if kind != "speed":
        return FilterInfo(kind)
    if base is not None or multiplier is not None:
        return FilterInfo(kind, unit, base or 0.0, 1.0 if multiplier is None else multiplier)
    if unit == "percent":
        return FilterInfo(kind, unit, 100.0, -1.0)
    most = max(speeds, default=1.0)
    fitting = [step for step in _STEPS if most / step <= OCCUPIED + _SLACK]
    if not fitting:
        return FilterInfo(kind, unit, 0.0, float(math.ceil(most / OCCUPIED)))

    def is_exact(step: float) -> bool:
        return all(abs(speed / step - round(speed / step)) <= _SLACK for speed in speeds)

    return FilterInfo(kind, unit, 0.0, next(filter(is_exact, fitting), fitting[0]))


def mask_description(info: FilterInfo, grid: OccupancyGrid) -> dict[str, Any]:
    counts, area = lookup.histogram(grid.occupancy), grid.resolution**2
    description: dict[str, Any] = {"kind": info.kind, "type": info.type}
    description |= {"base": info.base, "multiplier": info.multiplier}
    description["area_m2"] = round(float(counts[1 : OCCUPIED + 1].sum()) * area, 9)
    if info.kind == "speed":
        description["unit"] = info.unit
        description["limits"] = [
            {"value": value, "limit": limit, "area_m2": round(cells * area, 9)}
            for value, limit, cells in limits_in(info, counts)
        ]
    return description


def mask_rows(description: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    if description["kind"] != "speed":
        yield "filter", f"{description['kind']}, zones of {decimal_text(description['area_m2'])} m2"
        return
    scale = f"base {description['base']:g}, multiplier {description['multiplier']:g}"
    yield "filter", f"{description['kind']}, {scale}"
    sign = "%" if description["unit"] == "percent" else "m/s"
    for entry in description["limits"]:
        limit = "no limit" if entry["limit"] is None else f"limit {entry['limit']:.4g} {sign}"
        yield limit, f"{decimal_text(entry['area_m2'])} m2"


def limits_in(info: FilterInfo, counts: arrays.Integers) -> list[tuple[int, float | None, int]]:
    values = np.flatnonzero(counts[1 : OCCUPIED + 1]) + 1
    return [(v, info.limit_of(v), int(counts[v])) for v in values.tolist()]
