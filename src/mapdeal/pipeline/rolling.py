"""Rolling local maps: of a sequence of clouds, each with what the clouds before it have seen."""

from __future__ import annotations

from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path

from mapdeal.errors import MapdealError, ParameterError, emit_warning
from mapdeal.formats.budget import claim
from mapdeal.formats.json_text import json_of
from mapdeal.mapping.local_map import LocalMap
from mapdeal.mapping.rolling_map import RollingMapper
from mapdeal.pipeline.applied import RunReport
from mapdeal.pipeline.clouds import SummedCloud
from mapdeal.pipeline.files import errors_named
from mapdeal.pipeline.local import (
    LocalCommon,
    LocalJob,
    check_window,
    filled,
    filling_of,
    holding_map,
)

_PER_CELL = 10
"""Bytes for each cell that is remembered: while the cells move, twice."""


class RollingRun:
    """Makes the rolling maps of a sequence, in its order.

    A map is a function of the last clouds and their poses: those that are there already are
    skipped, and their clouds read only once a later map needs them.
    """

    def __init__(self, jobs: Sequence[LocalJob], common: LocalCommon) -> None:
        if common.keep is None:
            raise ParameterError("must be given", place="keep")
        known = common.global_map
        self._jobs = jobs
        self._common = common
        self._keep = None if common.keep == "all" else common.keep
        self._mapper = RollingMapper(
            [job.pose for job in jobs],
            common.options,
            keep=self._keep,
            global_map=None if known is None else known.grid,
            lethal_threshold=common.lethal_threshold,
        )
        with common.settings.memory(), holding_map(known):
            source = jobs[0].source(common)
            check_window(source, common)
            most = self._mapper.remembered
            claim(
                source,
                _PER_CELL * most.cells,
                what=f"{most.width} x {most.height} cells to remember",
                hint="a smaller --keep takes less",
            )
        self._summed: list[SummedCloud | None] = []

    def __call__(self, index: int) -> RunReport:
        """Make the map of a cloud; each is asked for after those before it, once."""
        job = self._jobs[index]
        self._summed.append(None)  # unless it can be read
        if job.cloud is None:
            raise ParameterError("must be given", place="cloud")
        summed = job.cloud.summed()
        first = 0 if self._keep is None else max(0, index + 1 - self._keep)
        before = self._summed[first:index]
        missing = sum(one is None for one in before)
        filling = filling_of(
            job,
            self._mapper.poses[index],
            summed.sums,
            self._common,
            lambda: self._made(index, missing),
            {"clouds_before": self._sum_before(first, index), **summed.options},
        )
        self._summed[index] = summed
        return filled(filling, self._common.settings, skip=True)

    def _cloud(self, index: int) -> Path:
        return self._jobs[index].source(self._common)

    def _sum_before(self, first: int, index: int) -> str:
        """Return one checksum of the earlier clouds of a map, and of their poses."""
        parts = [
            [*([None] if one is None else one.identity), *pose]
            for one, pose in zip(
                self._summed[first:index], self._mapper.poses[first:index], strict=True
            )
        ]
        return sha256(json_of(parts)).hexdigest()

    def _made(self, index: int, missing: int) -> LocalMap:
        while self._mapper.turn < index:
            self._catch_up(index)
        self._add(index)
        if missing:
            text = f"{missing} of the clouds before it could not be read: the map is without them"
            emit_warning(f"{self._cloud(index)}: {text}", stacklevel=2)
        return self._mapper.result()

    def _catch_up(self, index: int) -> None:
        """Add the cloud whose turn it is, if the map of a later one needs it."""
        turn = self._mapper.turn
        forgotten = self._keep is not None and turn + self._keep <= index
        if forgotten or self._summed[turn] is None:
            self._mapper.skip()
        else:
            self._add(turn)

    def _add(self, turn: int) -> None:
        """Add a cloud; one that cannot be read is left out of the maps after it."""
        known = self._summed[turn]
        if known is None:
            raise ParameterError("was not read", source=self._cloud(turn))
        try:
            with errors_named(self._cloud(turn)):
                self._mapper.add_in_parts(known.points())
        except MapdealError:
            self._summed[turn] = None
            self._mapper.skip()
            raise
