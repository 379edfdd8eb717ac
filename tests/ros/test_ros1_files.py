"""Files of ROS 1 parameters, against PyYAML and the rules of rosparam."""

from pathlib import Path

import pytest
import yaml

from mapdeal.ros.ros1 import (
    Ros1Namespace,
    parse_ros1_parameters,
    read_ros1_parameters,
    why_unsendable,
)

FILE = Path("a.yaml")


def as_mapping(namespace):
    """Return a namespace as plain dicts and values, as ``rosparam get`` prints it."""
    return {
        name: as_mapping(member) if isinstance(member, Ros1Namespace) else member.value
        for name, member in namespace.members.items()
    }


def read(text):
    return parse_ros1_parameters(FILE, text.encode())


SCALARS = """\
one: 1
octal: 010
minutes: 1:30
thousands: 1_000
no_number: 1e-1
number: 1.0e-1
bare: .5
yes: yes
off: off
text: "yes"
nested: {a: [1, [2.5, x]], b: {c: -0.0}}
anchor: &a {p: 1, q: 2}
merged: {<<: *a, q: 3}
aliased: *a
folded: >
  two
  lines
"""


def test_values_are_those_of_pyyaml():
    text = SCALARS.replace("yes: yes", '"yes": yes').replace("off: off", '"off": off')
    assert as_mapping(read(text).parameters) == yaml.safe_load(text)
    assert read(text).faults == ()


@pytest.mark.parametrize("every", [5, pytest.param(1, marks=pytest.mark.thorough)])
def test_real_files_hold_what_pyyaml_reads(real_maps, every):
    files = sorted((real_maps / "params").rglob("*.yaml"))
    assert len(files) > 60
    for path in files[::every]:
        if "wildcard" not in path.name:  # it has a name with a leading slash, for the root
            parameters = as_mapping(read_ros1_parameters(path).parameters)
            assert parameters == yaml.safe_load(path.read_text()), path


def test_later_values_stay_and_namespaces_are_merged():
    merged = Ros1Namespace()
    merged.merge(("x",), read("a: {b: 1, c: [1, 2]}\nd: 1\n").parameters)
    merged.merge(("x",), read("a: {c: [3]}\nd: {e: 2}\n").parameters)
    assert as_mapping(merged) == {"x": {"a": {"b": 1, "c": [3]}, "d": {"e": 2}}}
    merged.merge(("x",), read("a: 5").parameters)
    assert as_mapping(merged)["x"]["a"] == 5


def test_the_largest_whole_number_is_of_32_bits():
    assert why_unsendable(2**31 - 1) is None
    assert why_unsendable(-(2**31)) is None
    assert why_unsendable(2**31) is not None
