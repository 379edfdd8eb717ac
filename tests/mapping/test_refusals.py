"""What maps of scans and of clouds refuse."""

import math

import numpy as np
import pytest

import mapdeal
from mapdeal import MalformedInputError, ParameterError

NAN, INF, HUGE = math.nan, math.inf, 10**400
SCAN = [[0.0, 0.0, 0.0]], [0.0], [[1.0]]
COUNTING, TSDF = {"method": "counting"}, {"method": "tsdf"}


@pytest.mark.parametrize(("options", "message"), [
    ({"method": "voting"}, "method"),
    ({"ratio": 0.5}, "ratio"),
    *[({**COUNTING, "ratio": bad}, "ratio") for bad in (1.0, NAN, "x")],
    *[({"log_free": bad}, "log_free") for bad in (0.0, -1e308, HUGE)],
    *[({"log_occ": bad}, "log_occ") for bad in (-1.0, 1e308, INF, "x")],
    ({"log_min": 49.999999}, "log_min"),
    ({"log_min": 80.0, "log_max": 20.0}, "log_min"),
    *[({"log_max": bad}, "log_max") for bad in (101.0, 50.000001)],
    *[({**TSDF, "truncation": bad}, "truncation") for bad in (None, 0.5, NAN)],
    ({**TSDF, "truncation_behind": 0.4}, "truncation_behind: must be 0.5 to 500 trunc"),
    *[({**TSDF, "truncation_behind": bad}, "truncation_behind") for bad in (501, NAN, "x")],
    ({**COUNTING, "truncation_behind": 3}, "truncation_behind"),
    ({**COUNTING, "as_written": True}, "as_written: does not apply to method counting"),
    ({"range_min": -1.0}, "range_min"),
    *[({"range_max": bad}, "range_max") for bad in (0.0, "x", HUGE)],
    ({"range_min": 3.0, "range_max": 2.0}, "range_max"),
    ({"clear_max": INF}, "clear_max"),
    ({"resolution": 0.0}, "resolution"),
    ({"size": (1.0, 1.0)}, "size"),
    *[({"size": bad, "origin": (0, 0)}, "size") for bad in ((0.0, 1.0), (1.0, -1.0))],
    ({"size": (1e5, 1e5), "origin": (0, 0)}, "cells"),
])  # fmt: skip
def test_options_of_built_maps_that_cannot_be_are_refused(options, message):
    with pytest.raises(ParameterError, match=message):
        mapdeal.build_map(*SCAN, **options)


@pytest.mark.parametrize(("poses", "angles", "ranges", "error", "message"), [
    ([[0, 0]], [0], [[1]], ParameterError, "poses"),
    ([[0, 0, NAN]], [0], [[1]], ParameterError, "poses"),
    ([[0, 0, 0]], [[0]], [[1]], ParameterError, "angles"),
    ([[0, 0, 0]], [INF], [[1]], ParameterError, "angles"),
    ([[0, 0, 0]], ["a"], [[1]], ParameterError, "angles"),
    ([[0, 0, 0]], [0], [[1, 2]], ParameterError, "ranges"),
    ([[0, 0, 0], [0, 0, 0]], [0, 1], [[1, 2], [3]], ParameterError, "ranges"),
    ([[0, 0, 0], [1e7, 0, 0]], [0, 1], np.ones((2, 2)), MalformedInputError, "too far for a m"),
    ([[0, 0, 0]], [0.0, 0.1], [[NAN, 50.0]], MalformedInputError, "no beam hits"),
])  # fmt: skip
def test_scans_that_do_not_fit_or_make_no_map_are_refused(poses, angles, ranges, error, message):
    with pytest.raises(error, match=message):
        mapdeal.build_map(poses, angles, ranges)


@pytest.mark.parametrize(("options", "message"), [
    ({"frame": "odom"}, "frame"),
    ({"offset": (1.0, NAN)}, "offset"),
    *[({"size": bad}, "size") for bad in ((0.0, 1.0), (1.0, INF), (1e6, 1e6))],
    ({"resolution": 0.0}, "resolution"),
    ({"min_range": -1.0}, "min_range"),
    ({"max_range": NAN}, "max_range"),
    ({"min_height": 2.0, "max_height": 1.0}, "min_height"),
    ({"max_height": 1.0}, "heights"),
    ({"unknown": "occupied"}, "unknown"),
    ({"raytrace_range": -0.1}, "raytrace_range"),
    *[({"pose": bad}, "pose") for bad in ((0, 0), (0, 0, NAN), (INF, 0, 0), (1e13, 0, 0), "abc")],
    *[({"points": bad}, "points") for bad in ([1.0, 2.0], [[1.0]], np.zeros((2, 2, 2)))],
])  # fmt: skip
def test_options_of_local_maps_that_cannot_be_are_refused(options, message):
    arguments = {"points": [[1.0, 2.0]], "pose": (0.0, 0.0, 0.0), **options}
    with pytest.raises(ParameterError, match=message):
        mapdeal.local_map(arguments.pop("points"), arguments.pop("pose"), **arguments)


def test_rolling_maps_keep_some_clouds_and_have_a_pose_for_each():
    with pytest.raises(ParameterError, match="keep"):
        mapdeal.RollingMapper([[0, 0, 0]], mapdeal.LocalOptions(), keep=0)
    mapper = mapdeal.RollingMapper([[0, 0, 0]], mapdeal.LocalOptions())
    mapper.add([[1.0, 0.0]])
    with pytest.raises(ParameterError, match="a pose for each cloud"):
        mapper.add([[1.0, 0.0]])
