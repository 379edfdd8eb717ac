"""What several tests draw: reaches drawn as text, and cost curves of all kinds."""

import numpy as np

from drawn import cells
from mapdeal import Passage, Reach, cost_curve

RESOLUTION, ORIGIN = 0.25, (1.5, -2.0, 0.4)

TWO_AREAS = """
    ?????????????????????????
    #########################
    #........::#ooooooooooo:#
    #........::#ooooooooooo:#
    #-------.:::::ooooooooo:#
    #........::#ooooooooooo:#
    #........::###########:##
    #........::#oo#::oooo#..#
    #########################
"""


def reach_of(text, **options):
    """Return what a robot reaches of a drawing.

    # obstacle, ? unknown, . reached, - reached without room to turn, : no room, o out of reach,
    u unknown and reached.
    """
    drawn = np.array([list(line.strip()) for line in text.strip().splitlines()])
    symbols = np.where(drawn == "u", "?", np.where(np.isin(drawn, list("#?")), drawn, "."))
    occupancy = cells("\n".join("".join(row) for row in symbols))
    drawn = drawn[::-1]
    reachable = np.isin(drawn, list(".-u")).astype(np.uint8)
    headings = np.where(drawn == "-", 5, np.where(np.isin(drawn, list(".ou")), 72, 0))
    nothing = np.zeros(drawn.shape, np.float32)
    parameters = {"resolution": RESOLUTION, "origin": ORIGIN, "start": (90.0, 9.0), **options}
    return Reach(reachable, headings.astype(np.uint8), nothing, nothing, occupancy, **parameters)


def passage_at(reach, first, second, *, width=0.474, is_open=False, cut_off=3.0):
    ends = [tuple(end) for end in reach.frame.xy_from_rowcol([first, second]).tolist()]
    x, y = np.mean(ends, axis=0)
    return Passage(x, y, width, cut_off, is_open, (ends[0], ends[1]))


POLYGON = {
    "inscribed_radius": 0.2, "circumscribed_radius": 0.36, "inflation_radius": 0.55,
    "cost_scaling_factor": 5.0,
}  # fmt: skip
CURVES = {
    "nav2": (0.05, {"inscribed_radius": 0.22549849949589046, "circumscribed_radius": 0.2299,
                    "inflation_radius": 0.7, "cost_scaling_factor": 3.0, "lookup": "nav2"}),
    "polygon": (0.05, POLYGON),
    "odd cells": (0.07, POLYGON),
    "cut off": (0.05, {**POLYGON, "inflation_radius": 0.3, "inscribed_radius": 0.6,
                       "circumscribed_radius": 0.8}),
    "custom inscribed radius": (0.05, {**POLYGON, "inscribed_radius": 0.351,
                                       "circumscribed_radius": 0.3}),
    "none": (0.05, {**POLYGON, "inflation_radius": 0.0}),
    "point": (0.05, {"inflation_radius": 0.02, "cost_scaling_factor": 3.0}),
    "flat": (0.05, {**POLYGON, "cost_scaling_factor": 0.0}),
    "huge": (0.05, {**POLYGON, "inflation_radius": 30.0}),
    "huge and slow": (0.05, {**POLYGON, "inflation_radius": 30.0, "cost_scaling_factor": 0.05}),
    "large cells": (1.0, POLYGON),
    "rings": (0.07, {"model": "rings", "values": (90, 20, 50)}),
    "thresholds": (0.05, {"model": "threshold", "down": 20, "up": 60, "down_factor": 0.5}),
}  # fmt: skip


def curve_of(name):
    resolution, parameters = CURVES[name]
    return cost_curve(resolution, **parameters)
