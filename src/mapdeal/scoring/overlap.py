"""Counts of cells in which two maps agree or differ."""

from __future__ import annotations

import math

import numpy as np

from mapdeal.records import dataclass
from mapdeal.scoring.states import FREE, OCCUPIED, UNKNOWN, States


@dataclass(frozen=True)
class Confusion:
    """Cells by whether the estimate has them occupied, and whether the truth has."""

    tp: int
    tn: int
    fp: int
    fn: int

    @property
    def precision(self) -> float | None:
        """The share of the estimate's occupied cells that are occupied in the truth."""
        return share(self.tp, self.tp + self.fp)

    @property
    def recall(self) -> float | None:
        """The share of the truth's occupied cells that are occupied in the estimate."""
        return share(self.tp, self.tp + self.fn)

    @property
    def mcc(self) -> float | None:
        """Matthews' correlation coefficient, -1..1; None where one map has cells of one kind alone.

        Examples
        --------
        >>> Confusion(6, 3, 1, 2).mcc
        0.47809144373375745
        """
        tp, tn, fp, fn = self.tp, self.tn, self.fp, self.fn
        product = (tp + fp) * (tp + fn) * (tn + fp) * (tn + fn)
        return (tp * tn - fp * fn) / math.sqrt(product) if product else None


@dataclass(frozen=True)
class Overlap:
    """Cells of two maps on one lattice, by what they are in each."""

    counts: tuple[tuple[int, ...], ...]

    @classmethod
    def of(cls, estimate: States, truth: States) -> Overlap:
        """Return the counts of two maps on one lattice.

        Examples
        --------
        >>> estimate, truth = np.array([[2, 1, 0]], np.uint8), np.array([[2, 2, 1]], np.uint8)
        >>> Overlap.of(estimate, truth).counts
        ((0, 0, 0), (1, 0, 0), (0, 1, 1))
        """
        from mapdeal.kernels.lookup import histogram

        pairs = truth * np.uint8(3)
        pairs += estimate
        table = histogram(pairs)[:9].reshape(3, 3).tolist()
        return cls(tuple(tuple(row) for row in table))

    def _in_truth(self, state: int) -> int:
        return sum(self.counts[state])

    def _in_estimate(self, state: int) -> int:
        return sum(row[state] for row in self.counts)

    def iou(self, state: int) -> float | None:
        """Return cells that are of a kind in both maps, per cell that is of it in one or both."""
        both = self.counts[state][state]
        return share(both, self._in_truth(state) + self._in_estimate(state) - both)

    @property
    def known_in_both(self) -> int:
        """Cells that neither map has unknown."""
        known = (FREE, OCCUPIED)
        return sum(self.counts[one][other] for one in known for other in known)

    @property
    def coverage(self) -> float | None:
        """The share of the truth's known cells that the estimate knows."""
        return share(self.known_in_both, self._in_truth(FREE) + self._in_truth(OCCUPIED))

    @property
    def coverage_free(self) -> float | None:
        """The share of the truth's free cells that the estimate knows."""
        free = self.counts[FREE]
        return share(free[FREE] + free[OCCUPIED], sum(free))

    @property
    def known_confusion(self) -> Confusion:
        """Of cells that neither map has unknown."""
        table = self.counts
        return Confusion(
            table[OCCUPIED][OCCUPIED],
            table[FREE][FREE],
            table[FREE][OCCUPIED],
            table[OCCUPIED][FREE],
        )

    @property
    def whole_confusion(self) -> Confusion:
        """Of all cells of the lattice: unknown ones are not occupied."""
        tp = self.counts[OCCUPIED][OCCUPIED]
        fp, fn = self._in_estimate(OCCUPIED) - tp, self._in_truth(OCCUPIED) - tp
        cells = sum(self._in_truth(state) for state in (UNKNOWN, FREE, OCCUPIED))
        return Confusion(tp, cells - tp - fp - fn, fp, fn)


def share(part: int, whole: int) -> float | None:
    """Return a share, None of nothing."""
    return part / whole if whole else None
