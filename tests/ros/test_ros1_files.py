"""Files of ROS 1 parameters, against PyYAML and the rules of rosparam."""

import math
from pathlib import Path

import pytest
import yaml

from mapdeal.errors import FileAccessError, MalformedInputError
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


def faults(text):
    return [(one.check, one.level, one.parameter, one.line) for one in read(text).faults]


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
        if "wildcard" not in path.name:  # its name begins with a slash, which is the root's
            read_it = as_mapping(read_ros1_parameters(path).parameters)
            assert read_it == yaml.safe_load(path.read_text()), path


def test_each_value_has_its_line_and_its_text():
    file = read("a:\n  b: 'x'  # why\n  c:\n    - 1\n    - 2\nd: 0x10\n")
    found = dict(file.parameters.values())
    assert [(v.value, v.kind, v.line, v.text) for v in found.values()] == [
        ("x", "string", 2, "'x'"),
        ([1, 2], "list", 4, "- 1\n    - 2"),
        (16, "int", 6, "0x10"),
    ]
    assert list(found) == [("a", "b"), ("a", "c"), ("d",)]


def test_angles_are_numbers():
    file = read("a: deg(180)\nb: rad(pi/2)\nc: !degrees 90\nd: !radians 2*pi**2\ne: 'deg(1)'\n")
    assert as_mapping(file.parameters) == {
        "a": math.pi, "b": math.pi / 2, "c": math.pi / 2, "d": 2 * math.pi**2, "e": "deg(1)",
    }  # fmt: skip


@pytest.mark.parametrize(
    "text",
    [
        "a: rad(x)", "a: rad(1/0)", "a: rad(9**9**9)", "a: deg(one)",
        "a: !radians __import__('os').getpid()",
        "a: !degrees [1]", "a: !radians ''", f"a: rad({'1+' * 200}1)", "a: !radians (1).real",
    ],
)  # fmt: skip
def test_angles_are_sums_and_no_programs(text):
    with pytest.raises(MalformedInputError, match=r"line 1: cannot be read"):
        read(text)


def test_binary_data_is_bytes():
    (value,) = (one for _, one in read("a: !!binary aGk=").parameters.values())
    assert (value.value, value.kind) == (b"hi", "binary")


def test_slashes_in_names_are_namespaces():
    file = read("a/b: 1\na:\n  c: 2\n  /d/e: 3\n")
    assert as_mapping(file.parameters) == {"a": {"b": 1, "c": 2}, "": {"d": {"e": 3}}}


def test_a_document_may_name_its_namespace():
    assert as_mapping(read("_ns: robot\na: 1\n").parameters) == {"robot": {"a": 1}}


def test_later_values_stay_and_namespaces_are_merged():
    into = Ros1Namespace()
    into.merge(("x",), read("a: {b: 1, c: [1, 2]}\nd: 1\n").parameters)
    into.merge(("x",), read("a: {c: [3]}\nd: {e: 2}\n").parameters)
    assert as_mapping(into) == {"x": {"a": {"b": 1, "c": [3]}, "d": {"e": 2}}}
    into.merge(("x",), read("a: 5").parameters)
    assert as_mapping(into)["x"]["a"] == 5


def test_faults_have_their_lines():
    assert faults("a: 1\nb:\nc: 3\n") == [("params.empty", "refused", "b", 2)]
    assert faults("a: {b: 1, c: ~}") == [("params.empty", "refused", "a/c", 1)]
    assert faults("a: 1\nb: 2\na: 3\n") == [("params.twice", "warning", "a", 3)]
    assert faults("a: 1\nb: 2\na: 1\n") == [("params.repeated", "note", "a", 3)]
    assert faults("a: 3000000000") == [("params.type", "refused", "a", 1)]
    assert faults("a: [1, [-2147483649]]") == [("params.type", "refused", "a", 1)]
    assert faults("a: -2147483648") == []
    assert faults("a: 2001-01-01") == [("params.type", "refused", "a", 1)]
    assert faults("on: 1") == [("params.name", "refused", "on", 1)]
    assert faults("a: 1\n---\nb: 2\n") == [("params.syntax", "refused", "", 3)]


def test_of_a_key_twice_the_later_value_counts():
    assert as_mapping(read("a: 1\nb: 2\na: 3\n").parameters) == {"a": 3, "b": 2}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: [1", "not valid YAML"),
        ("\ta: 1", "not valid YAML"),
        ("a: $(arg x)\n  b: 1", "not valid YAML"),
        ("- 1\n", "must be a mapping of parameters, is a list"),
        ("word", "is a single value"),
        ("a: !foo 1", "tag not allowed"),
        ("a: !!python/object:os.system {}", "tag not allowed"),
        ("a: {<<: 1}", "<< must name mappings"),
        ("a: &a [*a]", "within its own anchor"),
        ("a: " + "[" * 30, "nested deeper"),
    ],
)
def test_what_is_no_file_of_parameters_is_refused(text, message):
    with pytest.raises(MalformedInputError, match=message):
        read(text)


def test_an_empty_file_has_no_parameters(tmp_path):
    (tmp_path / "a.yaml").write_bytes(b"# nothing\n")
    assert as_mapping(read_ros1_parameters(tmp_path / "a.yaml").parameters) == {}
    with pytest.raises(FileAccessError):
        read_ros1_parameters(tmp_path / "b.yaml")


def test_the_largest_whole_number_is_of_32_bits():
    assert why_unsendable(2**31 - 1) is None
    assert why_unsendable(-(2**31)) is None
    assert why_unsendable(2**31) is not None
