"""Each recorded value, from the stored pictures and from the maps themselves."""

import hashlib
import importlib.util
import json
import math

import numpy as np
import pytest
from PIL import Image

from mapdeal import OccupancyGrid, read_map
from mapdeal.compare.score import FREE, OCCUPIED, UNKNOWN, compare_states, compare_to_truth
from mapdeal.grid.frame import Frame, Transform
from recorded_scores import PAIRS, agreement, recorded_pairs

GREYS = {UNKNOWN: 205, FREE: 254, OCCUPIED: 0}


def states_in(path):
    greys = np.asarray(Image.open(path))[::-1]
    states = np.full(greys.shape, 9, np.uint8)
    for state, grey in GREYS.items():
        states[greys == grey] = state
    return states


def disagreeing(values, pair):
    told = agreement(values, pair["values"])
    assert len(told) == 48
    return [name for name, agrees in told.items() if not agrees]


@pytest.mark.parametrize("name", PAIRS)
def test_all_values_of_the_stored_cells_are_those_recorded(real_maps, name):
    pair = recorded_pairs(real_maps)[name]
    estimate, truth = (
        states_in(real_maps / pair["lattice"][which]["file"]) for which in ("est", "truth")
    )
    frame = Frame(*truth.shape, pair["resolution"])
    assert disagreeing(compare_states(estimate, truth, frame).values, pair) == []


@pytest.mark.parametrize("name", PAIRS[:3])
def test_all_values_of_the_maps_are_those_recorded(real_maps, name):
    pair = recorded_pairs(real_maps)[name]
    place = pair["est_to_truth"]
    transform = Transform(place["dx"], place["dy"], math.radians(place["dtheta_deg"]))
    maps = [read_map(real_maps / pair[which]) for which in ("est", "truth")]
    check_maps(*maps, transform, pair)


@pytest.mark.thorough
def test_all_values_of_the_generated_maps_are_those_recorded(real_maps):
    pair = recorded_pairs(real_maps)[PAIRS[3]]
    place = pair["est_to_truth"]
    transform = Transform(place["dx"], place["dy"], math.radians(place["dtheta_deg"]))
    check_maps(*generated(real_maps), transform, pair)


def generated(folder):
    """Return the estimate and the truth of the pair that a script of the data makes."""
    spec = importlib.util.spec_from_file_location("make_pairs", folder / "align" / "make_pairs.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    name, recipe = module.RECIPES[2]
    assert name == "any"
    source, resolution, _ = module.SOURCES["visible"]["conestogo"]
    cells = module.load(folder / source)
    truth, estimate, _ = module.pair(
        cells, resolution, np.random.Generator(np.random.PCG64([20, 2, 2])), recipe
    )
    table = np.zeros(256, np.int8)
    table[[0, 205, 254]] = 100, -1, 0
    return [OccupancyGrid(table[made], cell, origin) for made, cell, origin in (estimate, truth)]


def check_maps(estimate, truth, transform, pair):
    found = compare_to_truth(estimate, truth, transform)
    for which, states in (("est", found.estimate), ("truth", found.truth)):
        greys = np.array([GREYS[state] for state in range(3)], np.uint8)[states[::-1]]
        digest = hashlib.sha256(greys.tobytes()).hexdigest()
        assert digest == pair["lattice"][which]["sha256_cells_image_order"]
    assert disagreeing(found.values, pair) == []


def test_the_command_prints_all_recorded_values(real_maps, command):
    pair = recorded_pairs(real_maps)["tmcl-gmap-faro-asis"]
    words = [real_maps / pair["est"], "--truth", real_maps / pair["truth"], "--json"]
    code, out, err = command("score", *words)
    assert (code, err) == (0, "")
    assert disagreeing(json.loads(out)["values"], pair) == []
