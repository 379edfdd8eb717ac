"""The score of a map against a true one."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.frame import Frame
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.resample import sampled
from mapdeal.grid.transform import Transform
from mapdeal.grid.values import UNKNOWN as UNKNOWN_VALUE
from mapdeal.kernels.distance import squared_distance
from mapdeal.records import dataclass
from mapdeal.scoring.distances import WallDistances, wall_distances
from mapdeal.scoring.overlap import Overlap
from mapdeal.scoring.similarity import gaussian_similarity, uniform_similarity
from mapdeal.scoring.states import FREE, OCCUPIED, UNKNOWN, States, states_of

Values = dict[str, Any]
"""Figures by name: numbers, None where there is nothing to measure, or more of such."""


@dataclass(frozen=True, eq=False)
class Comparison:
    """A map beside the true one, on the lattice of that, and its score."""

    frame: Frame
    estimate: States
    truth: States
    values: Values
    wall_squares: NDArray[np.signedinteger]
    missed: NDArray[np.signedinteger]


def compare_to_truth(
    estimate: OccupancyGrid, truth: OccupancyGrid, transform: Transform | None = None
) -> Comparison:
    """Return the score of a map against the true one."""
    frame = truth.frame
    values = on_lattice(frame, estimate, transform or Transform())
    return compare_states(states_of(values), states_of(truth.occupancy), frame)


def on_lattice(
    frame: Frame, estimate: OccupancyGrid, transform: Transform
) -> NDArray[np.int8]:  # fmt: skip
    """Return the values of a map at the centres of another one's cells; -1 where it has none."""
    values, inside = sampled(frame, estimate.occupancy, transform.frame(estimate.frame))
    values[~inside] = UNKNOWN_VALUE
    return values


def compare_states(estimate: States, truth: States, frame: Frame) -> Comparison:
    """Return the score of a map that is on the lattice of the true one already."""
    walls, true_walls = estimate == OCCUPIED, truth == OCCUPIED
    to_truth = squared_distance(true_walls)[walls]
    to_estimate = squared_distance(walls)[true_walls]
    cell = frame.resolution
    overlap = Overlap.of(estimate, truth)
    known, whole = overlap.known_confusion, overlap.whole_confusion
    values = {
        "cells": list(frame.shape),
        "ssim_uniform7": uniform_similarity(truth, estimate),
        "ssim_gauss": gaussian_similarity(truth, estimate),
        "dist_est_to_truth_m": _told(wall_distances(to_truth, cell)),
        "dist_truth_to_est_m": _told(wall_distances(to_estimate, cell)),
        "dist_est_to_truth_where_truth_known_m": _told(
            wall_distances(to_truth[truth[walls] != UNKNOWN], cell)
        ),
        "dist_truth_to_est_where_est_known_m": _told(
            wall_distances(to_estimate[estimate[true_walls] != UNKNOWN], cell)
        ),
        "iou_occupied": overlap.iou(OCCUPIED),
        "iou_free": overlap.iou(FREE),
        "precision_occupied_known_in_both": known.precision,
        "recall_occupied_known_in_both": known.recall,
        "coverage": overlap.coverage,
        "coverage_free": overlap.coverage_free,
        "known_in_both": overlap.known_in_both,
        "mcc_known_in_both": known.mcc,
        "confusion_known_in_both": asdict(known),
        "mcc_whole_lattice": whole.mcc,
        "confusion_whole_lattice": asdict(whole),
    }
    return Comparison(frame, estimate, truth, values, to_truth, to_estimate)


def _told(found: WallDistances) -> dict[str, float | None]:
    return asdict(found)
