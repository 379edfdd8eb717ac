import json
import math
import warnings

import pytest

from mapdeal import Footprint, MapdealWarning, ParameterError


def test_radii_of_a_rectangle_off_its_centre():
    # Edges at x = 0.4, -0.2 and y = +-0.25; the farthest corner is (0.4, 0.25).
    shape = Footprint.polygon([[0.4, 0.25], [0.4, -0.25], [-0.2, -0.25], [-0.2, 0.25]])
    assert shape.inscribed_radius == pytest.approx(0.2)
    assert shape.circumscribed_radius == pytest.approx(math.hypot(0.4, 0.25))


def test_either_sense_of_rotation_gives_the_same_radii():
    corners = [(0.3, 0.1), (-0.1, 0.3), (-0.2, -0.3)]
    one, other = Footprint.polygon(corners), Footprint.polygon(corners[::-1])
    assert one.inscribed_radius == pytest.approx(other.inscribed_radius)
    assert one.circumscribed_radius == other.circumscribed_radius


def test_padding_moves_each_coordinate_by_its_sign_and_leaves_zero():
    shape = Footprint.polygon([[0.3, 0.0], [-0.2, 0.2], [-0.2, -0.2]]).padded(0.01)
    assert shape.vertices == ((0.31, 0.0), (-0.21000000000000002, 0.21000000000000002),
                              (-0.21000000000000002, -0.21000000000000002))  # fmt: skip


def test_a_circle_is_a_circle_and_no_polygon():
    shape = Footprint.circle(0.25).padded(0.05)
    assert shape.inscribed_radius == shape.circumscribed_radius == pytest.approx(0.3)


def test_radii_are_those_of_costmap_2d(real_maps):
    peers = json.loads((real_maps / "expected" / "peers.json").read_text())["footprints"]
    assert len(peers) == 12
    for case in peers:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            shape = Footprint.polygon(case["polygon"])
        assert shape.inscribed_radius == pytest.approx(case["result"]["inscribed"], rel=1e-12)
        expected = case["result"]["circumscribed"]
        assert shape.circumscribed_radius == pytest.approx(expected, rel=1e-12)


def test_the_sixteen_gon_of_costmap_2d_is_a_little_smaller_than_its_circle():
    shape = Footprint.sixteen_gon(0.5)
    assert len(shape.vertices) == 16
    assert shape.vertices[0] == (0.5, 0.0)
    assert shape.vertices[4] == pytest.approx((0.0, 0.5))
    assert shape.circumscribed_radius == pytest.approx(0.5)
    assert shape.inscribed_radius == pytest.approx(0.98079 * 0.5, rel=1e-5)
    with pytest.raises(ParameterError, match="radius"):
        Footprint.sixteen_gon(0.0)


def test_a_repeated_corner_does_no_harm():
    shape = Footprint.polygon([[0.3, 0.2], [0.3, 0.2], [-0.3, 0.2], [0.0, -0.4]])
    assert math.isfinite(shape.inscribed_radius)


def test_text_in_ros_form_is_parsed():
    shape = Footprint.parse("[[0.3, 0.2], [0.3,-.2],[-3e-1, -0.2], [-0.3, +0.2]]")
    assert shape.vertices == ((0.3, 0.2), (0.3, -0.2), (-0.3, -0.2), (-0.3, 0.2))


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("[[0.1, 0.2], [0.3, 0.4]]", "three"),
        ("[[0.1, 0.2], [0.3, 0.4], [0.5]]", "vertex 3"),
        ("[[0.1, 0.2], [nan, 0.4], [0.5, 0.1]]", "vertex 2"),
        ("[[0.1, 0.2], [0.3, 0.4], [1e9, 0.1]]", "vertex 3"),
        ("[[1,1],[-1,-1],[1,-1],[-1,1]]", "vertex 1"),
        ("0.3", "look like"),
        ("[[1,1],[2,2],[3,'a']]", "look like"),
    ],
)
def test_shapes_that_are_none_are_refused_by_name(text, named):
    with pytest.raises(ParameterError, match=named):
        Footprint.parse(text)


@pytest.mark.parametrize(
    "text",
    [
        "[[" + "1" * 300,
        "[[1,1],[-1,-1" + "1" * 200 + ",[1,-1]]",
        "[" + "[1,1]," * 500,
        "[[" + "1," * 500,
        "[" * 500,
        "[[1,1]" + " " * 500,
        "[[" + "1." * 200 + "]]",
        "[[1,1],[2,2],[3,1]",
        "[1,1],[2,2],[3,1]]",
        "[[1,1],[2,2],[3,1]]]",
        "[[[1,1],[2,2],[3,1]]]",
        "[[1,1] [2,2],[3,1]]",
        "[[1,1],,[2,2],[3,1]]",
        "[[1,1],[2,2],[3,1],]",
        "[[1,1],[2,2],[3,1]]x",
        "[[1,1],[2,2],[]]",
        "[[1,1],[2,2],[3,]]",
        "[[1,1],[2,2],[3 1]]",
        "[[1,1],[2,2],[3,1e]]",
        "[[1,1],[2,2],[3,1_0]]",
        "[[1,1],[2,2],[3,0x1]]",
        "[[1,1],[2,2],[3,\x001]]",
        "[[1,1],[2,2],[3,\x1b[31m1]]",
        "[]",
        "[[]]",
        "",
    ],
)
def test_text_with_a_bracket_too_few_or_other_faults_is_refused_at_once(text):
    with pytest.raises(ParameterError, match="look like") as caught:
        Footprint.parse(text)
    assert str(caught.value).isprintable()


@pytest.mark.parametrize("space", [" ", "\t", "\n", "\r\n", "\v", "\f", "\x1c", "\x85", "\u2003"])
def test_white_space_of_any_kind_may_stand_between_numbers(space):
    text = " [ [ 1 , 1 ] , [ -1 , 1 ] , [ 0 , -1 ] ] ".replace(" ", space)
    assert Footprint.parse(text).vertices == ((1, 1), (-1, 1), (0, -1))


def test_a_robot_beside_its_centre_is_warned_of():
    with pytest.warns(MapdealWarning, match="outside"):
        Footprint.polygon([[1.0, 1.0], [2.0, 1.0], [2.0, 2.0]])
