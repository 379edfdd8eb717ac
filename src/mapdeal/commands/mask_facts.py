"""What `mask` and `lint` look at: a mask on the cells of its map."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mapdeal.checks.facts import MaskFacts, PairFacts, gather
from mapdeal.errors import FileAccessError, MalformedInputError, capture_warnings
from mapdeal.grid.filters import FilterInfo, FilterKind, info_for
from mapdeal.grid.footprint import Footprint
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.reach import Goal
from mapdeal.grid.values import OCCUPIED, UNKNOWN
from mapdeal.maps.dialects import MapMetadata
from mapdeal.maps.zones import Zone, name_at
from mapdeal.pipeline.inputs import KeepoutMask, MapInput, claim_work, mask_of
from mapdeal.pipeline.settings import Settings
from mapdeal.stages.cost import closed_by

PER_CELL = 60.0
"""Bytes for each cell of the map: what a robot reaches, without a mask and with it."""


def read_mask(path: Path, settings: Settings, beside: MapInput) -> tuple[KeepoutMask, PairFacts]:
    with settings.reading():
        pair, _, findings = gather(path, max_cells=settings.max_cells)
    for found in findings:
        if found.severity == "error" and found.check.startswith("file."):
            is_missing = found.check == "file.access"
            kind = FileAccessError if is_missing else MalformedInputError
            raise kind(found.message, source=path)
    if pair is None:
        rule = "is no mask that Nav2 loads"
        raise MalformedInputError(rule, source=path, hint="pass the .yaml of a mask")
    with capture_warnings():  # warnings about maps do not apply to masks
        mask = mask_of(path, settings, beside.grid)
    if mask is None:
        raise TypeError("there is a mask")
    return mask, pair


def info_of(metadata: MapMetadata, kind: FilterKind | None) -> FilterInfo:
    """Return how a mask is to be read: as its YAML says, as asked, or as its mode suggests."""
    own = FilterInfo.of(metadata.extra)
    if own is not None and kind in (None, own.kind):
        return own
    return info_for(kind or ("speed" if metadata.mode == "scale" else "keepout"), ())


def mask_facts(
    given: MapInput, mask: OccupancyGrid, info: FilterInfo, *, pair: PairFacts | None = None,
    robot: Footprint | None = None, start: tuple[float, ...] | None = None,
    goals: Sequence[Goal] = (), zones: Sequence[Zone] = (),
) -> MaskFacts:  # fmt: skip
    grid = given.occupancy
    claim_work(given.name, grid, PER_CELL)
    known = np.asarray(grid.occupancy) != UNKNOWN
    with capture_warnings():  # of costs, which there are none of
        closed = closed_by(mask, grid.frame) if info.kind == "keepout" else np.zeros_like(known)
        full = np.full(mask.shape, OCCUPIED, dtype=np.int8)
        inside = closed_by(mask.with_values(full), grid.frame)
    covered = int(np.count_nonzero(inside & known)) / max(int(np.count_nonzero(known)), 1)
    return MaskFacts(
        pair,
        mask,
        info,
        grid,
        given.name,
        closed,
        covered,
        robot,
        start,
        tuple(goals),
        name_of=lambda xy: name_at(zones, grid, xy),
    )
