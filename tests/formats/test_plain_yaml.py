"""What is composed without PyYAML is what it composes."""

from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from mapdeal.formats.plain_yaml import compose_plain
from mapdeal.formats.yaml_text import OF_MAPS, _Composer

MAP = """\
# a map
image: map.pgm
resolution: 0.050000
origin: [-100.000000, -1.2e+01, 0.000000]
negate: 0   # as ever
occupied_thresh: 0.65

free_thresh: 0.196
mode: trinary"""
WORDS = [
    "map.pgm", "../maps/a-b_c.png", "0.05", "-1", "+1.5e3", "1e5", "0x1f", "012", "1_000", "yes",
    "no", "true", "null", "~", ".5", ".inf", "-.inf", ".nan", "1:30", "2001-01-01", "-", "--",
    "---", "...", ".", "a:", "a: b", "'q'", '"q"', "a#b", "#c", "a #c", "[1, 2]", "[ 1,2 ]",
    "[-1.5, +2, 3e4]", "[]", "[-]", "[- 1]", "[1, -, 2]", "[1,, 2]", "[a]", "[[1]]", "[1, 2",
    "{a: 1}", "&a 1", "*a", "!t 1", "| ", ">", "?", "", " ", "\t1", "1\t", "=", "<<", "\xfc",
    "[0.1 , 2 ] # c", "[1, 2]x", "[1 2]", "-a", "+a", "-.5", "1.", "[1.,-.5]", "[--1, ..]",
    "[e1, 2]",
]  # fmt: skip
KEYS = [
    "image", "a", "_b1", "yes", "null", "n", "A_b", "1a", "a-b", "a b", "", "a:", "- a", "?",
    "#", "<<",
]  # fmt: skip
SEPARATORS = [": ", ":  ", ":", " : ", ":\t"]
ENDS = [
    "\n", "\n\n", " \n", "\r\n", "\n# c\n", "\n \n", "\n  # c\n", "", " # c\n", "#c\n",
    "\n---\n", "\n...\n",
]  # fmt: skip


def tree(node):
    marks = [
        (m.name, m.index, m.line, m.column, m.buffer, m.pointer)
        for m in (node.start_mark, node.end_mark)
    ]
    value = node.value
    if isinstance(node, yaml.SequenceNode):
        value = [tree(one) for one in value]
    elif isinstance(node, yaml.MappingNode):
        value = [(tree(key), tree(one)) for key, one in value]
    style = getattr(node, "flow_style", None), getattr(node, "style", None)
    return type(node), node.tag, value, style, marks


def by_library(text):
    return _Composer(text, Path("m.yaml"), OF_MAPS).get_single_node()


@pytest.mark.parametrize("end", ["", "\n", "\n\n  \n# end", " "])
def test_the_file_of_a_map_is_composed_at_once(end):
    assert tree(compose_plain(MAP + end, 1000)) == tree(by_library(MAP + end))


@given(
    st.lists(
        st.tuples(*map(st.sampled_from, (["", "  ", "# x\n"], KEYS, SEPARATORS, WORDS, ENDS))),
        max_size=4,
    )
)
def test_whatever_is_composed_is_the_library_s(lines):
    text = "".join("".join(parts) for parts in lines)
    node = compose_plain(text, 1000)
    if node is not None:
        assert tree(node) == tree(by_library(text))


@given(st.text("ab:[] ,#-+.0e\n", max_size=30))
def test_so_is_any_text(text):
    node = compose_plain(text, 1000)
    if node is not None:
        assert tree(node) == tree(by_library(text))


@given(st.floats(), st.from_regex(r"[A-Za-z0-9_./+-]{1,9}", fullmatch=True))
def test_so_are_numbers_and_words(number, word):
    text = f"number: {number!r}\nword: {word}\nlist: [{number!r}, 1]\n"
    node = compose_plain(text, 1000)
    if node is not None:
        assert tree(node) == tree(by_library(text))


def test_what_holds_too_much_is_left_to_the_library():
    assert compose_plain("a: 1\nb: [1, 2]\n", 7) is not None
    assert compose_plain("a: 1\nb: [1, 2]\n", 6) is None
    assert compose_plain("a: 1\n" * 300, 10000) is None
