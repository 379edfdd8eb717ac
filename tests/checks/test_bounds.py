"""Bounds on what may differ, against figures in plain Python."""

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drawn import grid_from_text
from mapdeal import OccupancyGrid, ParameterError, diff, write_map
from mapdeal.compare.difference import compare
from strategies import occupancies

RES = 0.25
ORIGIN = (1.0, -2.0, 0.3)


def farthest(own, other, other_extent):
    """The largest distance of an obstacle in the common area to the nearest of the other map."""
    walls = [cell for cell, value in own.items() if value == 100 and cell in other_extent]
    others = [cell for cell, value in other.items() if value == 100]
    if not walls:
        return 0.0
    if not others:
        return math.inf
    return RES * max(min(math.dist(a, b) for b in others) for a in walls)


@given(
    a=occupancies(6), b=occupancies(6), shift=st.tuples(st.integers(-7, 7), st.integers(-3, 3)),
    bound=st.floats(0, 2), percent=st.floats(0, 100),
)  # fmt: skip
def test_bounds_hold_as_plain_python_says(a, b, shift, bound, percent):
    first = OccupancyGrid(a, RES, ORIGIN)
    second = OccupancyGrid(b, RES, first.frame.window(*shift, *b.shape).origin)
    cells_a = {(r, c): int(a[r, c]) for r, c in np.ndindex(a.shape)}
    cells_b = {(r + shift[0], c + shift[1]): int(b[r, c]) for r, c in np.ndindex(b.shape)}
    common = cells_a.keys() & cells_b.keys()
    found = compare(first, second)
    by_shift, by_share = found.bounds_of(bound, percent)
    assert found.not_compared == sum(
        value >= 0 and cell not in common for cell, value in cells_a.items()
    )
    if not common:
        assert not by_shift.holds
        assert not by_share.holds
        assert math.isnan(by_shift.found) and math.isnan(by_share.found)  # noqa: PT018
        return
    shift_found = max(farthest(cells_a, cells_b, common), farthest(cells_b, cells_a, common))
    share = 100 * sum(cells_a[cell] != cells_b[cell] for cell in common) / len(common)
    assert by_shift.found == pytest.approx(shift_found)
    assert by_share.found == pytest.approx(share)
    if abs(bound - shift_found) > 1e-6:
        assert by_shift.holds == (shift_found <= bound)
    if abs(percent - share) > 1e-6:
        assert by_share.holds == (share <= percent)


def test_six_cells_are_as_far_as_one_writes_it():
    first = grid_from_text("#.......", 0.05)
    second = grid_from_text("......#.", 0.05)
    assert diff(first, second, max_shift=0.3).passes
    assert not diff(first, second, max_shift=0.2999).passes


@pytest.mark.parametrize(
    "values", [(-0.1, None), (math.nan, None), (math.inf, None), (None, -1), (None, 100.1),
               (None, math.nan)],
)  # fmt: skip
def test_odd_bounds_are_refused(values):
    grid = OccupancyGrid([[100]], RES)
    with pytest.raises(ParameterError, match=r"max_shift|max_differing"):
        diff(grid, grid, max_shift=values[0], max_differing=values[1])


@pytest.fixture
def maps(tmp_path, monkeypatch):
    """A map, one whose wall is two cells to the right, one that is smaller, one far away."""
    monkeypatch.chdir(tmp_path)
    walls = np.zeros((5, 10), np.int8)
    walls[:, 3] = 100
    moved = np.roll(walls, 2, axis=1)
    grid = OccupancyGrid(walls, RES, ORIGIN)
    write_map("a.yaml", grid)
    write_map("b.yaml", OccupancyGrid(moved, RES, ORIGIN))
    write_map("part.yaml", OccupancyGrid(walls[:, :7], RES, ORIGIN))
    write_map("far.yaml", OccupancyGrid(walls, RES, (50.0, 0.0, 0.3)))
    write_map("empty.yaml", OccupancyGrid(np.zeros((5, 10), np.int8), RES, ORIGIN))


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["a", "b"], 1),
        (["a", "b", "--max-shift", "0.5"], 0),
        (["a", "b", "--max-shift", "0.49"], 1),
        (["a", "b", "--max-differing", "20"], 0),
        (["a", "b", "--max-differing", "19.9"], 1),
        (["a", "b", "--max-differing", "20", "--max-shift", "0.49"], 1),
        (["a", "b", "--max-differing", "19.9", "--max-shift", "0.5"], 1),
        (["a", "b", "--max-differing", "20", "--max-shift", "0.5"], 0),
        (["a", "b", "--max-differing", "0", "--tolerance", "2"], 0),
        (["a", "part"], 1),
        (["a", "part", "--max-shift", "0", "--max-differing", "0"], 0),
        (["a", "far", "--max-shift", "1000", "--max-differing", "100"], 1),
        (["a", "empty", "--max-shift", "1000"], 1),
        (["empty", "a", "--max-shift", "1000"], 1),
        (["empty", "empty", "--max-shift", "0", "--max-differing", "0"], 0),
        (["a", "b", "--max-shift", "-1"], 2),
        (["a", "b", "--max-differing", "101"], 2),
    ],
)
def test_the_exit_code_is_that_of_the_bounds(command, maps, words, code):
    names = [f"{word}.yaml" for word in words[:2]]
    assert command("diff", *names, *words[2:])[0] == code


def test_the_missed_bound_is_named(command, maps):
    _, out, err = command("diff", "a.yaml", "b.yaml", "--max-shift", "0.1", "--max-differing", "50")
    lines = out.splitlines()
    assert lines[0] == "a.yaml, b.yaml: different, beyond the bounds"
    assert lines[-2:] == [
        "  bound     --max-shift 0.1 m: missed, found 0.5 m",
        "  bound     --max-differing 50 %: holds, found 20 %",
    ]
    assert err == ""


def test_json_has_the_bounds(command, maps):
    words = ["--max-shift", "9", "--max-differing", "50", "--json"]
    code, out, _ = command("diff", "a.yaml", "empty.yaml", *words)
    document = json.loads(out)
    assert (code, document["passes"], document["equal"]) == (1, False, False)
    assert document["bounds"] == {
        "max_shift": {"allowed": 9.0, "found": None, "holds": False},
        "max_differing": {"allowed": 50.0, "found": 10.0, "holds": True},
    }
    document = json.loads(command("diff", "a.yaml", "a.yaml", "--json")[1])
    assert (document["bounds"], document["passes"]) == ({}, True)


def test_what_a_bound_does_not_see_is_warned_of(command, maps):
    code, _, err = command("diff", "a.yaml", "part.yaml", "--max-shift", "0.1")
    assert code == 0
    assert err == (
        "warning: part.yaml: does not cover 15 known cells of a.yaml, which are not compared\n"
    )
    assert command("diff", "part.yaml", "a.yaml", "--max-shift", "0.1")[2] == ""


@pytest.mark.parametrize("words", [("--max-shift", "-1"), ("--max-differing", "120")])
def test_a_bound_that_is_refused_is_called_as_it_was_given(command, words):
    code, _, err = command("diff", "a.yaml", "b.yaml", *words)
    assert code == 2
    assert err.startswith(f"error: {words[0]}: must be a finite number, ")
    assert err.endswith(f", got {float(words[1])}\n")
