"""Counts of the distinct pixels of a picture: maps have few of them.

What a reader of ROS makes of a pixel depends on its samples alone. So to count what readers make
of a picture, it is enough to ask them of each different pixel once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.formats.picture import Picture, Samples
from mapdeal.kernels.lookup import histogram

Codes = NDArray[np.uint64]
Counts = NDArray[np.int64]

_PIXELS_TOGETHER = 1 << 18
_MOST_KEPT = 1 << 16
_BITS = 16


class DistinctPixels:
    """Counts the different pixels of pictures that are of one kind, such as strips of a picture."""

    def __init__(self, report: Callable[[Picture, Counts], None]) -> None:
        self.firsts: dict[int, int] = {}
        """The first pixel of each opaque 8-bit grey, or index of a palette, by its number."""
        self._seen = 0
        self._report = report
        self._kind: Picture | None = None
        self._greys = np.zeros(0, dtype=np.int64)
        self._others: list[tuple[Codes, Counts]] = []

    def add(self, picture: Picture) -> None:
        """Count the pixels of some rows."""
        self._kind = picture
        for band in picture.bands(_PIXELS_TOGETHER):
            self._add_band(band)

    def finish(self) -> None:
        """Report what was counted and not yet reported."""
        kind = self._kind
        if kind is None:
            return
        greys = np.flatnonzero(self._greys)
        if greys.size:
            channels = [greys] * (3 if kind.samples.ndim == 3 else 1)
            if kind.alpha is not None:
                channels.append(np.full_like(greys, kind.opaque))
            self._report(_row(channels, kind), self._greys[greys])
        self._greys = self._greys[:0]
        self._tell_of_others(kind)

    def _add_band(self, picture: Picture) -> None:
        """Count some pixels: grey and opaque ones, which are most, without sorting."""
        grey, others = picture.greys_and_others()
        counts = histogram(grey) if grey.dtype == np.uint8 else None
        if counts is not None:
            self._note_firsts(grey, others, counts)
        self._seen += grey.size
        if others.any():
            self._add_others(picture.only(others))
            grey = grey[~others][np.newaxis]
            counts = None if counts is None else histogram(grey)
        if counts is None:
            counts = np.bincount(grey.reshape(-1), minlength=256)
        if len(counts) > len(self._greys):
            counts, self._greys = self._greys, counts
        self._greys[: len(counts)] += counts

    def _note_firsts(self, grey: Samples, others: NDArray[np.bool_], counts: Counts) -> None:
        """Note where the greys are that have not come up before, few as they are."""
        new = [value for value in np.flatnonzero(counts).tolist() if value not in self.firsts]
        for value in new:
            is_here = (grey == value).reshape(-1)
            first = int(is_here.argmax())
            if others.reshape(-1)[first]:
                is_here &= ~others.reshape(-1)
                first = int(is_here.argmax())
            if is_here[first]:
                self.firsts[value] = self._seen + first

    def _add_others(self, row: Picture) -> None:
        code = np.zeros(row.shape[1], dtype=np.uint64)
        for channel in _channels_of(row):
            code <<= np.uint64(_BITS)
            code |= channel
        self._others.append(np.unique(code, return_counts=True))
        if sum(len(codes) for codes, _ in self._others) > _MOST_KEPT and self._kind is not None:
            self._tell_of_others(self._kind)

    def _tell_of_others(self, kind: Picture) -> None:
        if not self._others:
            return
        listed, times = (np.concatenate(parts) for parts in zip(*self._others, strict=True))
        self._others.clear()
        codes, places = np.unique(listed, return_inverse=True)
        counts = np.zeros(len(codes), dtype=np.int64)
        np.add.at(counts, places, times)
        count = (3 if kind.samples.ndim == 3 else 1) + (kind.alpha is not None)
        shifts = [np.uint64(_BITS * k) for k in reversed(range(count))]
        channels = [(codes >> shift) & np.uint64(0xFFFF) for shift in shifts]
        self._report(_row(channels, kind), counts)


def _channels_of(row: Picture) -> list[Samples]:
    samples = row.samples[0]
    channels = [samples] if samples.ndim == 1 else list(samples.T)
    return channels if row.alpha is None else [*channels, row.alpha[0]]


def _row(channels: Sequence[NDArray[np.integer[Any]]], kind: Picture) -> Picture:
    """Return a picture of one row; the opacity, if the kind has one, is the last channel."""
    alpha = None
    if kind.alpha is not None:
        alpha = channels[-1].astype(kind.alpha.dtype)[np.newaxis]
        channels = channels[:-1]
    samples = np.stack(channels, axis=-1).astype(kind.samples.dtype)[np.newaxis]
    return replace(
        kind, samples=samples if kind.samples.ndim == 3 else samples[..., 0], alpha=alpha
    )
