"""Files of ROS 2 parameters: what ``rcl_yaml_param_parser`` 10.1.3, run on them, made of each."""

import math
from pathlib import Path

import pytest
import yaml

from mapdeal.errors import FileAccessError, MalformedInputError
from mapdeal.ros.ros2_files import matches, read_ros2


@pytest.fixture
def read(tmp_path):
    """Return what reads texts as files, in their order."""

    def parameters(*texts):
        paths = [tmp_path / f"{number}.yaml" for number in range(len(texts))]
        for path, text in zip(paths, texts, strict=True):
            path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return read_ros2(paths)

    return parameters


@pytest.fixture
def of_a(read):
    """Return what reads lines below ``a: ros__parameters:`` as (name, kind, value)."""

    def entries(*lines):
        text = "a:\n  ros__parameters:\n" + "".join(f"    {line}\n" for line in lines)
        (node,) = read(text).nodes
        return [(name, one.kind, one.value) for name, one in node.entries]

    return entries


TYPES = {
    "bool": {
        True: ["Y", "y", "yes", "Yes", "YES", "true", "True", "TRUE", "on", "On", "ON"],
        False: ["N", "n", "no", "No", "NO", "false", "False", "FALSE", "off", "Off", "OFF"],
    },
    "integer": {
        0: ["0", "-0", "00"], 5: ["5", "+5", "0x5", "05"], 8: ["010"], -8: ["-010"], 31: ["0X1f"],
        2**63 - 1: ["9223372036854775807", "0x7fffffffffffffff"],
        -(2**63): ["-9223372036854775808"],
    },
    "double": {
        8.0: ["08", "8.", "8e0", "0x1p3"], 0.5: [".5", "+.5", "5e-1", "0.5"], 3.0: ["0x1.8p1"],
        2.0**63: ["9223372036854775808"],
        math.inf: [".inf", "+.Inf", ".INF", "inf", "Infinity", "+iNf"],
        -math.inf: ["-.inf", "-inf"],
        18446744073709551615.0: ["0xFFFFFFFFFFFFFFFF"], 5e-324: ["0x1p-1074"],
    },
}  # fmt: skip
STRINGS = [
    "tRUE", "null", "~", "1_000", "1:30", "2001-01-01", "0x", "1e", ".", "1,5", "0b101", "0o17",
    "1e400", "5e-324", "1e-400", "$(var x)", "x", "a b", "0x1p-1075", "1.2.3", "-1-", "nan()x",
]  # fmt: skip


def test_plain_values_have_the_types_of_strtoll_and_strtod(of_a):
    wanted = [
        (kind, value, text)
        for kind, by_value in TYPES.items()
        for value, texts in by_value.items()
        for text in texts
    ]
    lines = [f"p{index}: {text}" for index, (_, _, text) in enumerate(wanted)]
    for (_, kind, value), (expected, right, text) in zip(of_a(*lines), wanted, strict=True):
        assert (kind, value) == (expected, right), text
        assert type(value) is type(right)


def test_what_is_no_number_is_a_string(of_a):
    lines = [f"p{index}: {text}" for index, text in enumerate(STRINGS)]
    assert of_a(*lines) == [(f"p{i}", "string", text) for i, text in enumerate(STRINGS)]


def test_nan_has_many_spellings(of_a):
    texts = [".nan", ".NaN", ".NAN", "nan", "NAN", "-nan", "nan(ab_1)"]
    for (_, kind, value), text in zip(
        of_a(*(f"p{i}: {text}" for i, text in enumerate(texts))), texts, strict=True
    ):
        assert kind == "double", text
        assert math.isnan(value), text


def test_quotes_make_strings_and_block_scalars_do_not(of_a):
    assert of_a("a: '1'", 'b: "yes"', 'c: ""', 'd: "a\\0b"') == [
        ("a", "string", "1"), ("b", "string", "yes"), ("c", "string", ""), ("d", "string", "a"),
    ]  # fmt: skip
    assert of_a("a: >-", "  5", "b: |", "  5") == [("a", "integer", 5), ("b", "string", "5\n")]


def test_tags_say_the_type(of_a):
    lines = ["a: !!str 5", "b: !!float 5", 'c: !!int "0x10"', "d: !!bool 'on'", "e: ! 5",
             "f: !!binary aGk="]  # fmt: skip
    assert of_a(*lines) == [
        ("a", "string", "5"), ("b", "double", 5.0), ("c", "integer", 16), ("d", "bool", True),
        ("e", "integer", 5), ("f", "byte_array", b"hi"),
    ]  # fmt: skip


def test_lists_have_the_type_of_their_values(of_a):
    lines = ["a: [1, 2]", "b: [1.0, .inf]", "c: [on, n]", 'd: [x, "1"]', "e: []", "f:", "- 1",
             "- 2", "g: [[1, 2]]", "h: [1, [x]]"]  # fmt: skip
    assert of_a(*lines) == [
        ("a", "integer_array", (1, 2)), ("b", "double_array", (1.0, math.inf)),
        ("c", "bool_array", (True, False)), ("d", "string_array", ("x", "1")),
        ("e", "not set", None), ("f", "integer_array", (1, 2)), ("g", "integer_array", (1, 2)),
        ("h", "integer_array", (1,)),
    ]  # fmt: skip


def test_dots_and_mappings_nest_alike(of_a):
    assert of_a("a.b: 1", "c:", "  d: {e: 2}", "  f.g: 3", "h: 4") == [
        ("a.b", "integer", 1), ("c.d.e", "integer", 2), ("c.f.g", "integer", 3),
        ("h", "integer", 4),
    ]  # fmt: skip


def test_a_dotted_mapping_within_another_leaves_its_first_part_behind(of_a):
    assert of_a("a:", "  b.c: {d: 1}", "  e: 2") == [
        ("a.b.c.d", "integer", 1), ("a.b.e", "integer", 2),
    ]  # fmt: skip


def test_an_empty_mapping_swallows_what_follows(of_a):
    assert of_a("a:", "  b: {}", "  c: 1") == [("a.b.c", "integer", 1)]


def test_equal_keys_stay_in_order_or_are_taken_by_type(of_a, read):
    assert of_a("a: {b: 1}", "a: {b: 2.5}") == [("a.b", "integer", 1), ("a.b", "double", 2.5)]
    assert of_a("a: 2.5", "a: 3.5") == [("a", "double", 3.5)]
    assert of_a("a: 2", "a: 2.5") == [("a", "integer", 2)]  # by type, not by order
    assert of_a("a: [1]", "a: x") == [("a", "string", "x")]
    value = read("a: {ros__parameters: {x: 1,\n x: 2.5}}").for_node("/a")["x"]
    assert (value.value, value.line) == (1, 1)
    assert (value.ignored.value, value.ignored.line) == (2.5, 2)


def test_a_node_may_have_an_empty_mapping_of_parameters(read):
    text = "a: {ros__parameters: {}}\nb: {ros__parameters: {x: 1}}\n"
    assert [(one.name, len(one.entries)) for one in read(text).nodes] == [("/a", 0), ("/b", 1)]


def test_files_are_read_into_one_another(read):
    one = "a:\n  ros__parameters: {x: 1.5, y: 2, n: {z: 1}}\n"
    other = "\na:\n  ros__parameters: {x: 2.5, y: 3.5, n: {z: 2.5}}\n/b: {ros__parameters: {x: 1}}"
    parameters = read(one, other)
    values = parameters.for_node("/a")
    assert {name: value.value for name, value in values.items()} == {"x": 2.5, "y": 2, "n.z": 2.5}
    assert [(value.source.name, value.line) for value in values.values()] == [
        ("1.yaml", 3), ("0.yaml", 2), ("1.yaml", 3),
    ]  # fmt: skip
    assert [(node.name, node.source.name, node.line) for node in parameters.nodes] == [
        ("/a", "0.yaml", 2), ("/b", "1.yaml", 4),
    ]  # fmt: skip
    assert [path.name for path, _ in parameters.files] == ["0.yaml", "1.yaml"]
    assert len(parameters.files[0][1]) == 64


def test_names_of_nodes_are_nested_or_written_with_slashes(read):
    text = """\
a:
  b: {ros__parameters: {x: 1}}
  ros__parameters: {x: 2}
/c/d: {ros__parameters: {x: 3}}
/e/:
  f: {ros__parameters: {x: 4}}
---
/**: {ros__parameters_of_all: {x: 5}}
"""
    assert [(one.name, one.entries[0][1].value) for one in read(text).nodes] == [
        ("/a/b", 1), ("/a", 2), ("/c/d", 3), ("/e/f", 4), ("/**", 5),
    ]  # fmt: skip


def test_places_and_texts_of_values(read):
    text = 'a:\n  ros__parameters:\n    x:   0.50  # m\n    y: ["p",\n       "q"]\n    z: [ ]\n'
    values = read(text).for_node("/a")
    assert [(one.line, one.text) for one in values.values()] == [
        (3, "0.50"), (4, '["p", "q"]'), (6, "[]"),
    ]  # fmt: skip


WILDCARDS = {
    "/**": ["/a", "/a/b", "/a/b/c"],
    "/*": ["/a"],
    "/*/b": ["/a/b"],
    "/**/b": ["/b", "/a/b", "/a/c/b"],
    "/a/**": ["/a", "/a/b", "/a/b/c"],
    "/a/*/c": ["/a/b/c"],
    "/**/a/**": ["/a", "/a/b", "/c/a", "/c/a/b/d"],
    "/a/b": ["/a/b"],
}
NODES = sorted({node for nodes in WILDCARDS.values() for node in nodes} | {"/c/b", "/ab", "/d/e/f"})


def test_wildcards_match_as_rclcpps_regular_expressions():
    import re  # its own, which no user's text reaches

    for pattern, right in WILDCARDS.items():
        expression = pattern.replace("/*", r"(/\w+)")
        assert [node for node in NODES if matches(pattern, node)] == [
            node for node in NODES if re.fullmatch(expression, node)
        ]
        assert all(matches(pattern, node) for node in right)


def test_what_comes_later_overrides_wherever_it_stands(read):
    text = """\
a: {b: {ros__parameters: {x: 1, y: 1}}}
/**: {ros__parameters: {x: 2.0, e: []}}
/*/b: {ros__parameters: {z: 3}}
/c: {ros__parameters: {y: 4}}
"""
    parameters = read(text)
    values = parameters.for_node("/a/b")
    assert {name: value.value for name, value in values.items()} == {
        "x": 2.0, "y": 1, "e": None, "z": 3,
    }  # fmt: skip
    assert [name for name, _ in parameters.unset_for("/a/b")] == ["e"]
    assert [node.name for node in parameters.matching("/c")] == ["/**", "/c"]


PAIR = "a: {ros__parameters: {footprint: [[1, 2], [3, 4]]}}\n"
REFUSED = {
    "ros__parameters: {x: 1}": (1, "no name of a node stands above ros__parameters"),
    "a: 1": (1, "a value stands outside of ros__parameters"),
    "a:\n  b: x": (2, "a value stands outside of ros__parameters"),
    "a: [1]": (1, "a list stands outside of ros__parameters"),
    "- a": (1, "a list stands where a key should be"),
    "a:\n": (1, "the value of a is missing"),
    "a:\n  b:\nc: {ros__parameters: {x: 1}}": (2, "the value of a/b is missing"),
    "a:\n  ros__parameters:\n": (2, "ros__parameters of a holds no parameters"),
    "a:\n  ros__parameters:\n    # x: 1\nb: {ros__parameters: {x: 1}}": (
        2,
        "ros__parameters of a holds no parameters",
    ),
    "a: {ros__parameters: ~}": (1, "ros__parameters of a holds no parameters"),
    "a: {ros__parameters: {x: 1}}\na: {ros__parameters: }": (2, "ros__parameters of a holds"),
    "a:\n  ros__parameters:\n    x:\n    -\n": (4, "a value of a list is missing"),
    "a:\n  ros__parameters:\n    x:\n    y: 1": (3, "the value of x is missing"),
    "a:\n  ros__parameters:\n    x: !!str": (3, "the value of x is missing"),
    "a: {ros__parameters: {x: [1, ]}}\nb: {ros__parameters: {'': 1}}": (2, "an empty key"),
    "a: {ros__parameters: {x: &v 1,\n y: *v}}": (2, "ROS 2 does not support aliases"),
    "a: {ros__parameters: {x: [1,\n 2.5]}}": (2, "the values of a list must be of one type"),
    "a: {ros__parameters: {x: [a,\n 2]}}": (2, "the values of a list must be of one type"),
    PAIR: (1, "a list within a list"),
    "a: {ros__parameters: {x: [1, [2], 3, 4]}}": (1, "a value"),
    "a: {ros__parameters: {x: !ENV HOME}}": (1, "the value has a tag that ROS 2 does not know"),
    "a: {ros__parameters: {x: !!null null}}": (1, "the value has a tag that ROS 2 does not know"),
    "a: {ros__parameters: {x: !!int 1.5}}": (1, "the value is not a value of its tag !!int"),
    "a: {ros__parameters: {x: !!binary a}}": (1, "the value is not in base64"),
    "<ns>:\n  a: {ros__parameters: {x: 1}}": (2, "not a name of a node: only letters"),
    "1a: {ros__parameters: {x: 1}}": (1, "not a name of a node: '1a' starts with a digit"),
    "a//b: {ros__parameters: {x: 1}}": (1, "not a name of a node: it has two slashes in a row"),
    "/a/: {ros__parameters: {x: 1}}": (1, "not a name of a node: it ends with a slash"),
    "a*: {ros__parameters: {x: 1}}": (1, "not a name of a node: only letters"),
    "a: {ros__parameters: {x: {}, y: 1}}": (1, "a value stands outside of ros__parameters"),
    "a:\n\tros__parameters: {x: 1}": (2, "not valid YAML: found character '\\t'"),
    "a: {ros__parameters: {x: 1}": (1, "not valid YAML: "),
    "a: {ros__parameters: {x: " + "[" * 99 + "1": (1, "nested deeper"),
    "a: {ros__parameters: {x: \x07}}": (None, "not valid YAML: "),
    "": (None, "no parameters in it"),
    "# nothing\n": (None, "no parameters in it"),
    "hello": (None, "no parameters in it"),
}


@pytest.mark.parametrize("text", REFUSED)
def test_what_the_parser_refuses(read, text):
    line, rule = REFUSED[text]
    if text.startswith("a: {ros__parameters: {x: [1, [2], 3"):
        # after the inner list the parser takes 3 for a key, and 4 for its value
        (node,) = read(text).nodes
        assert [(name, one.value) for name, one in node.entries] == [("x", (2,)), ("3", 4)]
        return
    with pytest.raises(MalformedInputError) as caught:
        read(text)
    assert caught.value.rule.startswith(rule)
    assert caught.value.line == line
    assert caught.value.source.name == "0.yaml"
    assert "\n" not in str(caught.value)


def test_hints_say_what_to_write(read):
    def hint(text):
        with pytest.raises(MalformedInputError) as caught:
            read(text)
        return caught.value.hint

    assert "put a footprint in quotes" in hint(PAIR)
    assert "decimal point" in hint("a: {ros__parameters: {x: [1, 2.5]}}")
    assert "launch" in hint("<robot_namespace>: {a: {ros__parameters: {x: 1}}}")
    assert "NODE: ros__parameters:" in hint("robot_radius: 0.2")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("data", "rule"),
    [
        (b"a: \xff", "not UTF-8"),
        (b"a: \0", "not UTF-8 text: it holds a NUL byte"),
        (b"\x89PNG\r\n\x1a\n", "looks like an image"),
        (b"P5\n1 1\n255\n0", "looks like a P5 image"),
        (b"#" * (1 << 20) + b"\n", "must not be larger than 1048576 bytes"),
        (b"a: {ros__parameters: {x: [" + b"1," * 50_000 + b"]}}", "more than 50000 keys"),
        (b"a: {ros__parameters: " + b"\n- " * 3 + b"- " * 60 + b"1}", "not valid YAML"),
        (b"a:\n ros__parameters:\n  x:\n  " + b"- " * 60 + b"1", "nested deeper than 40"),
    ],
)
def test_bad_bytes_are_refused_in_one_line(read, data, rule):
    with pytest.raises(MalformedInputError) as caught:
        read(data)
    assert caught.value.rule.startswith(rule)
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_named():
    with pytest.raises(FileAccessError, match="nowhere"):
        read_ros2([Path("nowhere.yaml")])


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
def test_tabs_are_those_of_libyaml(of_a, read):
    values = read(TABS).for_node("/a")
    assert {name: one.value for name, one in values.items()} == {
        "x": 0.22, "y": 1, "z": "two\twords", "v": (1, 2, 3), "w": "several lines more",
    }  # fmt: skip


@pytest.mark.skipif(not yaml.__with_libyaml__, reason="PyYAML comes without libyaml here")
def test_a_byte_order_mark_within_a_file_is_as_wide_as_a_blank(read):
    text = "\ufeffa:\n  ros__parameters:\n    x: \ufeff1\n\ufeff   y: 2\n"
    values = read(text).for_node("/a")
    assert [one.value for one in values.values()] == ["\ufeff1", 2]
    with pytest.raises(MalformedInputError, match="line 3: not valid YAML"):
        read("a:\n  ros__parameters: {x: 1}\n\ufeffb:\n  ros__parameters: {x: 2}\n")


@pytest.mark.parametrize("every", [5, pytest.param(1, marks=pytest.mark.thorough)])
def test_real_files_are_read_whole(real_maps, every):
    for path in sorted((real_maps / "params").rglob("*.yaml"))[::every]:
        if "ros__parameters" not in path.read_text():
            continue
        for node in read_ros2([path]).nodes:
            for name, one in node.entries:
                assert one.kind != "not set", (path, name)
                line = path.read_text().splitlines()[one.line - 1]
                assert one.text.split()[0][:1] in line, (path, name)
