"""Options and arguments that lint and diff refuse, and the errors."""

import math

import pytest

import mapdeal
from mapdeal import OccupancyGrid, ParameterError

GRID = OccupancyGrid([[100]], 0.25)
POLYGON = "[[0.9,0.5],[0.9,-0.5],[-0.9,-0.5],[-0.9,0.5]]"


@pytest.mark.parametrize(("words", "error"), [
    (["lint", "--robot-radius", 0.5], "--robot-radius: needs a MAP"),
    (["lint", "--footprint", POLYGON, "--params-file", "p.yaml"], "--robot-radius: needs a MAP"),
    (["lint", "m.yaml", "--robot-radius", 0], "robot radius must be a finite number"),
    (["lint", "m.yaml", "--robot-radius", 1, "--footprint", POLYGON],
     "together with --robot-radius"),
    (["lint", "m.yaml", "--robot-radius", 1, "--fix", "--in-place"], "together with --fix"),
    (["diff", "a.yaml", "b.yaml", "--max-shift", -1],
     "--max-shift: must be a finite number, at least 0, got -1.0"),
    (["diff", "a.yaml", "b.yaml", "--max-differing", 120],
     "--max-differing: must be a finite number, "),
])  # fmt: skip
def test_options_that_are_refused(command, words, error):
    code, out, err = command(*words)
    assert (code, out) == (2, "")
    assert err.startswith("error: ")
    assert error in err


@pytest.mark.parametrize(("name", "value"), [
    *[("tolerance", value) for value in (-1, math.nan, 1e9)],
    *[("max_shift", value) for value in (-0.1, math.nan, math.inf, "x")],
    *[("max_differing", value) for value in (-1, 100.1, math.nan, [1])],
])  # fmt: skip
def test_numbers_that_no_comparison_takes(name, value):
    with pytest.raises(ParameterError, match=name):
        mapdeal.diff(GRID, GRID, **{name: value})


def test_maps_that_are_too_far_apart():
    with pytest.raises(ParameterError, match="too far apart"):
        mapdeal.diff(GRID, OccupancyGrid([[100]], 0.25, (1e7, 1e7, 0.0)))


@pytest.mark.parametrize(("footprint", "words", "error"), [
    (0.5, {"paths": "m.yaml"}, "footprint: must be a Footprint"),
    (mapdeal.Footprint.circle(0.5), {"params_file": "p.yaml"}, "footprint: needs a MAP"),
])  # fmt: skip
def test_footprints_of_lint(footprint, words, error):
    with pytest.raises(ParameterError, match=error):
        mapdeal.lint(**words, footprint=footprint)
