"""Laser scans of a bag, each with the pose that its sensor had."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import groupby
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from mapdeal.errors import emit_warning
from mapdeal.formats.bags.bag import Bag
from mapdeal.formats.bags.decoding import Decoder
from mapdeal.formats.bags.messages import LASER_SCAN, LaserScan, laser_scan_of
from mapdeal.formats.bags.reader import chosen_connections, open_bag
from mapdeal.formats.budget import claim
from mapdeal.formats.scans.source import ScanArrays, ScanSource
from mapdeal.mapping.beams import Stances, beams_in_plane, stances
from mapdeal.mapping.transforms import Posed
from mapdeal.pipeline.bags.frames import FrameOptions, SensorFrames
from mapdeal.pipeline.files import errors_named

T = TypeVar("T", Posed, Stances)

_SCANS_TOGETHER = 512
_READINGS_TOGETHER = 1 << 18
_OF_READING = 140
"""Bytes of a reading, in all that is made of it."""


class BagScans(ScanSource):
    """The laser scans of a bag that is open."""

    # Scans come in the order of their recording times. Those outside of the times of the transforms
    # are left out and counted, as are those of a sensor that leans by more than 10 degrees.

    def __init__(
        self, bag: Bag, topics: Sequence[str], options: FrameOptions, *, deskew: bool = False
    ) -> None:
        connections = chosen_connections(bag, topics, (LASER_SCAN,), "laser scans")
        self._index = bag.index([one.id for one in connections])
        if not len(self._index):
            raise bag.malformed("holds no messages", ", ".join({c.topic for c in connections}))
        self._bag = bag
        self._decoder = Decoder(bag)
        self._deskew = deskew
        self._frames = SensorFrames(bag, options)
        self._is_prepared = False
        self._outside: dict[str, int] = {}
        self._leaning = self._unstamped = 0
        self._has_steps = False
        self.files = (*bag.files, *self._frames.files)

    @property
    def named(self) -> Path:
        return self._bag.path

    @property
    def count(self) -> int:
        return len(self._index)

    @property
    def preparation(self) -> int:
        """How many transforms are read before; see `ScanSource`."""
        return self._frames.count

    def prepare(self, advance: Callable[[int], object] = lambda _: None) -> None:
        """Read all transforms; see `ScanSource`."""
        if not self._is_prepared:
            self._frames.read(self._sensors(), advance)
            self._is_prepared = True

    def scans(self) -> Iterator[ScanArrays]:
        """Yield all scans in their order, some at a time; see `ScanSource.scans`."""
        self.prepare()
        self._outside = {}
        self._leaning = self._unstamped = 0
        together: list[LaserScan] = []
        readings = 0
        for place in self._index:
            scan = self._decoder.read(place, laser_scan_of)
            if scan.time == 0:
                self._unstamped += 1
                scan = scan.at(place.time)
            together.append(scan)
            count = len(scan.ranges)
            claim(self._bag.path, _OF_READING * count, what=f"the {count} readings of a scan")
            readings += count
            if len(together) == _SCANS_TOGETHER or readings > _READINGS_TOGETHER:
                yield from self._placed(together)
                together, readings = [], 0
        yield from self._placed(together)

    def warn(self) -> None:
        for frame, count in sorted(self._outside.items()):
            text = f"{self._bag.path}: {count} of {self.count} scans are left out: where {frame} "
            text += f"was is known {self._frames.told_span(frame)}"
            emit_warning(text, stacklevel=2)
        if self._leaning:
            text = f"{self._leaning} of {self.count} scans are left out: their sensor leans by more"
            emit_warning(f"{self._bag.path}: {text} than 10 degrees", stacklevel=2)
        if self._unstamped:
            text = f"{self._unstamped} scans have no time: that of their recording is taken"
            emit_warning(f"{self._bag.path}: {text}", stacklevel=2)
        if self._deskew and not self._has_steps:
            text = "no scan has a time between beams: --deskew has no effect"
            emit_warning(f"{self._bag.path}: {text}", stacklevel=2)

    def _sensors(self) -> set[str]:
        """Return the frames of all topics, by the first message of each connection."""
        _, firsts = np.unique(self._index.connections, return_index=True)
        return {self._decoder.header(self._index[int(first)])[1] for first in firsts}

    def _placed(self, scans: list[LaserScan]) -> Iterator[ScanArrays]:
        """Yield scans with the poses of their sensors, those of one kind together."""
        if self._deskew and any(scan.between for scan in scans):
            self._has_steps = True
            yield from self._deskewed(scans)
            return
        for run in self._runs(scans, [np.array([scan.time], np.int64) for scan in scans]):
            yield from _as_arrays(*run)

    def _runs(
        self, scans: list[LaserScan], times: list[NDArray[np.int64]]
    ) -> Iterator[tuple[list[LaserScan], Posed, Stances]]:
        """Yield scans of the same geometry that follow each other, without those left out."""
        # The poses are those of all times of a scan, one scan behind the other.
        found = self._looked_up(scans, times)
        kept: list[tuple[LaserScan, Posed, Stances]] = []
        for scan, (posed, stance) in zip(scans, found, strict=True):
            if not posed.known.all():
                self._outside[scan.frame] = self._outside.get(scan.frame, 0) + 1
            elif stance.leans.any():
                self._leaning += 1
            else:
                kept.append((scan, posed, stance))
        for _, some in groupby(kept, lambda one: (*one[0].geometry, *_kind(one[2]))):
            run = list(some)
            yield (
                [scan for scan, _, _ in run],
                _joined([posed for _, posed, _ in run]),
                _joined([stance for _, _, stance in run]),
            )

    def _looked_up(
        self, scans: list[LaserScan], times: list[NDArray[np.int64]]
    ) -> list[tuple[Posed, Stances]]:
        """Return where the sensor of each scan was at its times: asked for by frame, at once."""
        found: list[tuple[Posed, Stances] | None] = [None] * len(scans)
        for frame in {scan.frame for scan in scans}:
            numbers = [k for k, scan in enumerate(scans) if scan.frame == frame]
            with errors_named(self._bag.path):
                posed = self._frames.at(frame, np.concatenate([times[k] for k in numbers]))
            stance = stances(posed.translations, posed.quaternions)
            start = 0
            for k in numbers:
                some = slice(start, start + len(times[k]))
                start = some.stop
                found[k] = (
                    Posed(posed.translations[some], posed.quaternions[some], posed.known[some]),
                    Stances(*(getattr(stance, name)[some] for name in Stances.__annotations__)),
                )
        return [one for one in found if one is not None]

    def _deskewed(self, scans: list[LaserScan]) -> Iterator[ScanArrays]:
        times = [scan.beam_times() for scan in scans]
        for run, posed, stance in self._runs(scans, times):
            angles = np.concatenate([scan.angles for scan in run])
            headings, shares = beams_in_plane(posed.quaternions, angles)
            ranges = np.concatenate([scan.ranges for scan in run])
            ranges = np.where(stance.is_level, ranges, ranges * shares)
            poses = np.column_stack([posed.translations[:, :2], headings])
            yield ScanArrays(poses, np.zeros(1), ranges[:, np.newaxis], len(run))


def _kind(stance: Stances) -> tuple[bool, bool]:
    return bool(stance.is_level.all()), bool(stance.is_flipped[0])


def _as_arrays(scans: list[LaserScan], posed: Posed, stance: Stances) -> Iterator[ScanArrays]:
    angles = scans[0].angles
    if stance.is_level.all():
        if stance.is_flipped[0]:
            angles = -angles
        yield ScanArrays(stance.poses, angles, np.stack([scan.ranges for scan in scans]))
        return
    for k, scan in enumerate(scans):
        quaternions = np.broadcast_to(posed.quaternions[k], (len(angles), 4))
        headings, shares = beams_in_plane(quaternions, angles)
        pose = np.array([[*posed.translations[k, :2], 0.0]])
        yield ScanArrays(pose, headings, (scan.ranges * shares)[np.newaxis])


def _joined(parts: list[T]) -> T:
    names = type(parts[0]).__annotations__
    arrays = (np.concatenate([getattr(one, name) for one in parts]) for name in names)
    return type(parts[0])(*arrays)


@contextmanager
def scans_of_bag(
    path: Path, topics: Sequence[str], options: FrameOptions, *, deskew: bool = False
) -> Iterator[BagScans]:
    """Open the laser scans of a bag within a ``with`` block; see `BagScans`."""
    with open_bag(path) as bag:
        yield BagScans(bag, topics, options, deskew=deskew)
