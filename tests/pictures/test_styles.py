"""What styles say of values, held against what the field calls them and against plain counting."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from drawn import grid_from_text
from mapdeal import esdf
from mapdeal.pictures import colours, styles
from mapdeal.pictures.colours import Scale, _oklab_from_rgb
from mapdeal.pictures.styles import FieldEnds, field_style

LENGTHS = st.floats(0, 1000).map(lambda x: 0.0 if x < 0.01 else x)
GRID = grid_from_text("#..?\n....\n..##", 0.25, (1.5, -2.0, 0.3))


def level_of(scale, value):
    step = (scale.high - scale.low) / scale.levels
    return scale.first + min(max(math.floor((value - scale.low) / step), 0), scale.levels - 1)


@given(LENGTHS, LENGTHS)
def test_a_field_s_scale_goes_evenly_through_zero(far, deep):
    style = field_style(esdf(GRID), FieldEnds(far, deep, far, -deep))
    scale = style.scale
    assert scale.low <= -deep * (1 - 1e-9)
    assert scale.high >= far * (1 - 1e-9)
    step = (scale.high - scale.low) / scale.levels
    below = -scale.low / step
    assert below == pytest.approx(round(below), abs=1e-6)  # zero is between two steps
    assert 1 <= round(below) < scale.levels
    for k in range(scale.levels):  # the middle of each step, on both sides of zero
        assert scale.indices(np.float32([scale.low + (k + 0.5) * step])) == [k]
    red, _, blue = style.colours[: scale.levels].astype(int).T
    assert (red[: round(below)] > blue[: round(below)]).all()
    assert (blue[round(below) + 3 :] > red[round(below) + 3 :]).all()
    assert (style.colours[scale.levels :][: scale.levels] != style.colours[: scale.levels]).any()


@given(LENGTHS, LENGTHS)
def test_a_field_s_labels_stand_beside_their_colours_and_apart(far, deep):
    style = field_style(esdf(GRID), FieldEnds(far, deep, far, -deep))
    scale, bar = style.scale, style.bar
    places = [place for place, _ in bar.ticks]
    assert all(b - a >= 0.079 for a, b in itertools.pairwise(places))
    assert "0" in [label for _, label in bar.ticks]
    for place, label in bar.ticks:
        shown = bar.indices[min(int(place * len(bar.indices)), len(bar.indices) - 1)]
        value = float(label)
        assert abs(shown - level_of(scale, value)) <= 1 + 0.006 * abs(value) / (
            (scale.high - scale.low) / scale.levels
        )  # three digits


@given(
    st.floats(-1e3, 1e3), st.floats(0.01, 1e3),
    st.lists(st.floats(-2e3, 2e3, width=32), min_size=1, max_size=20),
)  # fmt: skip
def test_a_scale_counts_even_steps_and_ends_where_it_ends(low, length, values):
    scale = Scale(low, low + length, 7, 100)
    found = scale.indices(np.float32(values)).tolist()
    expected = [level_of(scale, value) for value in values]
    assert all(abs(a - b) <= 1 for a, b in zip(found, expected, strict=True))
    ends = scale.indices(np.float32([-np.inf, np.inf]))
    assert ends.tolist() == [7, 106]


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [(-0.3, 2.1, [0, 0.5, 1, 1.5, 2]), (0, 10, [0, 2, 4, 6, 8, 10]), (7.9, 8.1, [7.9, 8, 8.1])],
)
def test_ticks_are_round(low, high, expected):
    ticks = styles.ticks_of(low, high, 6)
    assert set(expected) <= set(ticks)
    assert all(low - 1e-9 <= tick <= high + 1e-9 for tick in ticks)


# Machado, Oliveira, Fernandes 2009, severity 1: how people without one kind of cones see.
SEEN_WITHOUT = {
    "none": np.eye(3),
    "long": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216],
             [-0.003882, -0.048116, 1.051998]],
    "medium": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413],
               [-0.011820, 0.042940, 0.968881]],
    "short": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602],
              [0.004733, 0.691367, 0.303900]],
}  # fmt: skip


@pytest.mark.parametrize("cones", list(SEEN_WITHOUT))
def test_reachable_areas_are_distinct_for_colour_blind_people(cones):
    areas = np.array([
        colours.REACHABLE, colours.CUT_OFF, *colours.CUT_OFF_AREAS, colours.TOO_NARROW,
        colours.RVIZ_UNKNOWN,
    ]) / 255  # fmt: skip
    linear = np.where(areas <= 0.04045, areas / 12.92, ((areas + 0.055) / 1.055) ** 2.4)
    perceived = np.clip(linear @ np.transpose(SEEN_WITHOUT[cones]), 0, 1)
    perceived = np.where(
        perceived <= 0.0031308, 12.92 * perceived, 1.055 * perceived ** (1 / 2.4) - 0.055
    )
    lab = _oklab_from_rgb(perceived)
    assert np.linalg.norm(lab[1:] - lab[0], axis=1).min() > 0.075
    apart = [np.linalg.norm(a - b) for a, b in itertools.combinations(lab[2:8], 2)]
    assert min(apart) > 0.05
