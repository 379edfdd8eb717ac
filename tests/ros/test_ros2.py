"""Files of ROS 2 parameters, against results of ``rcl_yaml_param_parser`` 10.1.3."""

import pytest
import yaml

from mapdeal.errors import MalformedInputError
from mapdeal.ros.ros2_files import read_ros2


@pytest.fixture
def read(files):
    """Return a function that reads texts as files, in their order."""
    return lambda *texts, **options: read_ros2(files(*texts), **options)


def test_later_values_override_earlier_ones_of_other_names(read):
    text = """\
a: {b: {ros__parameters: {x: 1, y: 1}}}
/**: {ros__parameters: {x: 2.0, e: []}}
/*/b: {ros__parameters: {z: 3}}
/c: {ros__parameters: {y: 4}}
"""
    parameters = read(text)
    assert {name: value.value for name, value in parameters.for_node("/a/b").items()} == {
        "x": 2.0, "y": 1, "e": None, "z": 3,
    }  # fmt: skip
    assert [name for name, _ in parameters.unset_for("/a/b")] == ["e"]
    assert [node.name for node in parameters.matching("/c")] == ["/**", "/c"]


@pytest.mark.slow
@pytest.mark.parametrize(("data", "rule"), [
    (b"a: \xff", "not UTF-8"),
    (b"a: \0", "not UTF-8 text: it holds a NUL byte"),
    (b"\x89PNG\r\n\x1a\n", "looks like an image"),
    (b"P5\n1 1\n255\n0", "looks like a P5 image"),
    (b"#" * (1 << 20) + b"\n", "must not be larger than 1048576 bytes"),
    (b"a: {ros__parameters: {x: [" + b"1," * 50_000 + b"]}}", "more than 50000 keys"),
    (b"a: {ros__parameters: " + b"\n- " * 3 + b"- " * 60 + b"1}", "not valid YAML"),
    (b"a:\n ros__parameters:\n  x:\n  " + b"- " * 60 + b"1", "nested deeper than 40"),
], ids=lambda value: str(value)[:20])  # fmt: skip
def test_bad_bytes_are_refused_in_one_line(read, data, rule):
    with pytest.raises(MalformedInputError) as caught:
        read(data)
    assert caught.value.rule.startswith(rule)
    assert "\n" not in str(caught.value)


TABS = """\
a:\t# behind a colon
  ros__parameters:\t
    x: 0.22\t# behind a value
    y:\t1
    z: two\twords
    v: [1,\t2\t,
\t3]
    w: several
      lines\t
      \tmore
"""


@pytest.mark.skipif(not yaml.__with_libyaml__, reason="PyYAML comes without libyaml here")
def test_tabs_are_those_of_libyaml(read):
    assert {name: value.value for name, value in read(TABS).for_node("/a").items()} == {
        "x": 0.22, "y": 1, "z": "two\twords", "v": (1, 2, 3), "w": "several lines more",
    }  # fmt: skip


@pytest.mark.skipif(not yaml.__with_libyaml__, reason="PyYAML comes without libyaml here")
def test_a_byte_order_mark_within_a_file_is_as_wide_as_a_blank(read):
    values = read("\ufeffa:\n  ros__parameters:\n    x: \ufeff1\n\ufeff   y: 2\n").for_node("/a")
    assert [value.value for value in values.values()] == ["\ufeff1", 2]
    with pytest.raises(MalformedInputError, match="line 3: not valid YAML"):
        read("a:\n  ros__parameters: {x: 1}\n\ufeffb:\n  ros__parameters: {x: 2}\n")


@pytest.mark.parametrize("every", [5, pytest.param(1, marks=pytest.mark.thorough)])
def test_real_files_are_read_completely(real_maps, every):
    for path in sorted((real_maps / "params").rglob("*.yaml"))[::every]:
        if "ros__parameters" not in path.read_text():
            continue
        for node in read_ros2([path]).nodes:
            for name, value in node.entries:
                assert value.kind != "not set", (path, name)
                line = path.read_text().splitlines()[value.line - 1]
                assert value.text.split()[0][:1] in line, (path, name)
