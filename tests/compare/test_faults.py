"""Kinds of faults, found in maps that each have one of them."""

import numpy as np
import pytest

from compare.buildings import WALLS, drawn
from compare.test_bend import bent
from mapdeal import diff, score
from mapdeal.compare.faults import NO_FAULT, faults_of, verdict
from mapdeal.compare.score import states_of

RNG = np.random.default_rng(4)


@pytest.fixture(scope="module")
def true_map():
    return drawn(WALLS, 0.1)


def without_a_quarter(values):
    height, width = values.shape
    values[height // 2 :, width // 2 :] = -1


def with_ghosts(values):
    walls = np.zeros_like(values, dtype=bool)
    walls[:, 6:100] = values[:, :94] == 100
    values[walls & (values == 0)] = 100


def with_noise(values):
    values[(values == 0) & (RNG.random(values.shape) < 0.02)] = 100


def faded(values):
    walls = values == 100
    walls[:, 120:] = False
    values[walls] = -1


CASES = {
    "missing area": without_a_quarter, "ghost walls": with_ghosts, "noisy": with_noise,
    "faded walls": faded, NO_FAULT: np.asarray,
}  # fmt: skip


@pytest.mark.parametrize("kind", CASES)
def test_the_worst_fault_names_the_verdict(true_map, kind):
    values = np.array(true_map.occupancy)
    CASES[kind](values)
    found = faults_of(states_of(values), states_of(true_map.occupancy), true_map.frame)
    assert verdict(found) == kind


def test_amount_and_place_of_what_is_missing(true_map):
    values = np.array(true_map.occupancy)
    without_a_quarter(values)
    wrong = true_map.with_values(values)
    missing = (np.asarray(true_map.occupancy) == 0) & (values == -1)
    result = score(wrong, true_map)
    (fault,) = (fault for fault in result.faults if fault.kind == "missing area")
    assert fault.amount == pytest.approx(missing.sum() * 0.01)
    assert fault.place.startswith("in the north-east")
    assert result.document()["verdict"] == "missing area"
    assert any("verdict   missing area: " in line for line in result.lines())
    assert diff(true_map, wrong).faults == result.faults
    assert diff(true_map, true_map).faults == ()


def test_a_bent_map_is_bent_and_has_no_ghosts(true_map):
    wrong = bent(true_map, 0.4)
    found = faults_of(states_of(wrong.occupancy), states_of(true_map.occupancy), true_map.frame)
    assert verdict(found) == "bent"
    assert found[0].amount == pytest.approx(0.4, abs=0.12)
    assert "ghost walls" not in {fault.kind for fault in found}
