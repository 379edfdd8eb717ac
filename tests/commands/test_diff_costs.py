import json
from pathlib import Path

import numpy as np
import pytest

import mapdeal
from drawn import grid_from_text
from mapdeal import write_map
from pipeline.reported import entries_of, layer_names

WALL = f"?{'#' * 22}?"
ROOM = "\n".join(["?" * 24, WALL, *[f"?#{'.' * 20}#?"] * 16, WALL])


def compared(paths):
    return mapdeal.compare_costmaps(*map(mapdeal.read_map, paths))


@pytest.fixture
def pair(here):
    """Costs of one room for two robots, in folders of their own under one name."""
    for name, radius in (("A", 0.2), ("B", 0.3)):
        room = grid_from_text(ROOM)
        costs = mapdeal.exponential_cost(room, inscribed_radius=radius, inflation_radius=1.0)
        write_map(f"{name}/cost.npz", costs)
        with pytest.warns(mapdeal.MapdealWarning, match="map_server would misread"):
            write_map(f"{name}/cost.yaml", costs, encoding="costmap2d")
    return "A/cost.npz", "B/cost.npz"


def test_two_costmaps_are_compared_by_cost(command, pair):
    first, second = (mapdeal.read_map(path).cost.astype(int) for path in pair)
    code, out, _ = command("diff", *pair, "--json")
    document = json.loads(out)
    assert (code, document["equal"], document["passes"]) == (1, False, False)
    assert document["differing"] == (first != second).sum()
    is_closed = [(costs >= 253) & (costs < 255) for costs in (first, second)]
    closed = (~is_closed[0] & is_closed[1]).sum()
    assert document["changes"]["closed"]["cells"] == closed > 0
    rose = (first < 255) & (second < 255) & (second > first)
    by_size = document["changes"]["rose"]["by_size"]
    assert sum(by_size.values()) == document["changes"]["rose"]["cells"] == rose.sum()
    assert by_size["10-49"] == (rose & np.isin(second - first, range(10, 50))).sum()
    area = rose.sum() * 0.0625
    assert document["changes"]["rose"]["area_m2"] == area
    code, out, _ = command("diff", *pair)
    assert code == 1
    assert f"  closed    {closed} cells ({closed * 0.0625:.4g} m2) now 253 or more" in out
    assert f"  rose      {rose.sum()} cells ({area:.4g} m2) cost more: " in out


def test_costs_in_yaml_and_npz_are_compared_alike(command, pair):
    _, of_npz, _ = command("diff", *pair, "--json")
    _, of_yaml, _ = command("diff", "A/cost.yaml", "B/cost.yaml", "--json")
    documents = [json.loads(text) for text in (of_npz, of_yaml)]
    for document in documents:
        del document["first"], document["second"]
    assert documents[0] == documents[1]
    assert command("diff", "A/cost.npz", "A/cost.yaml")[0] == 0
    out = command("diff", "A/cost.npz", "A/cost.npz")[1]
    assert out.startswith("A/cost.npz, A/cost.npz: equal costs\n")


def test_a_bound_on_the_share_of_differing_costs(command, pair):
    share = 100 * compared(pair).differing / (19 * 24)
    for bound, code in ((share + 0.1, 0), (share - 0.1, 1)):
        found, out, _ = command("diff", *pair, "--max-differing", f"{bound:.3f}")
        assert found == code
        assert ("within the bounds" if code == 0 else "beyond the bounds") in out


def test_options_and_functions_about_obstacles_are_refused(command, pair):
    for option, value in (("--tolerance", "1"), ("--max-shift", "0"), ("--max-shift", "0.5")):
        code, _, err = command("diff", *pair, option, value)
        assert (code, err) == (2, f"error: {option}: applies to maps, and both are costs\n")
    with pytest.raises(mapdeal.ParameterError, match="are both costs") as caught:
        mapdeal.diff(*pair)
    assert caught.value.hint == "compare_costmaps compares costs"


def test_costs_on_another_scale_are_converted_with_a_warning(command, pair):
    published = mapdeal.read_map(pair[0]).to_occupancy()
    cells = published.occupancy, published.resolution, published.origin
    write_map("C/cost.npz", mapdeal.Costmap(*cells, scale="occupancy"))
    for names in ((pair[0], "C/cost.npz"), ("C/cost.npz", pair[0])):
        code, out, err = command("diff", *names)
        assert (code, "equal costs" in out) == (0, True)
        assert "C/cost.npz: has costs on the occupancy scale: both are compared" in err


def test_the_memory_of_many_changes_is_claimed(command, tmp_path):
    is_even = np.indices((600, 600)).sum(axis=0) % 2
    for name, is_closed in (("a.npz", is_even), ("b.npz", 1 - is_even)):
        write_map(tmp_path / name, mapdeal.Costmap(np.uint8(254 * is_closed), 0.25))
    line = "diff", tmp_path / "a.npz", tmp_path / "b.npz", "--max-memory"
    code, _, err = command(*line, "80MB")
    assert (code, "600 x 600 cells need 102 MB" in err) == (3, True), err
    assert command(*line, "110MB")[0] == 1


def test_costs_that_were_moved_are_compared_where_they_belong(command, pair):
    first = mapdeal.read_map(pair[0])
    x, y, yaw = first.origin
    write_map("moved.npz", first.with_values(first.cost, (x + 0.75, y - 0.5, yaw)))
    Path("by.json").write_text('{"x": 0.75, "y": -0.5, "yaw": 0}')
    assert "0 differ" not in command("diff", pair[0], "moved.npz")[1]
    _, out, _ = command("diff", pair[0], "moved.npz", "--by", "by.json")
    assert "0 differ" in out
    assert "moved     A by x 0.75 m, y -0.5 m" in out


def test_the_page_shows_costs_and_never_says_that_obstacles_are_the_same(save_output, pair):
    (entry,) = entries_of(save_output("diff.json", "diff", *pair, "--json"))
    assert entry.name == "A/cost and B/cost"
    assert layer_names(entry) == ["first", "second", "difference"]
    result = compared(pair)
    claims = {claim.about: claim for claim in entry.claims}
    assert {about: claim.state for about, claim in claims.items()} == {
        "costmap": "warning", "cells": "warning", "geometry": "good",
    }  # fmt: skip
    area = result.changes["closed"].area
    assert claims["costmap"].text == f"The closed cells differ: {area:.3g} m2 are now closed"
    assert not any("obstacles are in the same" in claim.text for claim in entry.claims)
    closed = [item for item in entry.items if item.kind == "closed"]
    assert len(closed) == result.changes["closed"].regions
    assert closed[0].lines
    difference = entry.layers[-1]
    labels = difference.style.labels
    now_closed = next(code for code, label in labels.items() if label == "now closed")
    assert (difference.values[:] == now_closed).sum() == result.changes["closed"].cells
    (entry,) = entries_of(save_output("same.json", "diff", pair[0], "A/cost.yaml", "--json"))
    assert {claim.state for claim in entry.claims} == {"good"}
    missed = save_output("missed.json", "diff", *pair, "--json", "--max-differing", 1)
    (claim,) = (claim for claim in entries_of(missed)[0].claims if claim.state == "error")
    assert claim.text == "The bound on max_differing does not hold"


def test_a_page_of_costs_that_became_a_map_says_so(save_output, pair):
    path = save_output("diff.json", "diff", *pair, "--json")
    write_map("B/cost.npz", grid_from_text(ROOM), force=True)
    with pytest.warns(mapdeal.MapdealWarning) as caught:
        (entry,) = entries_of(path)
    assert [str(warning.message) for warning in caught] == [
        "B/cost.npz: is not the map that diff.json names: its checksum differs",
        "B/cost.npz: holds no costs, so what differs is not shown",
    ]
    assert layer_names(entry) == ["first", "second"]
