from pathlib import Path

import pytest
import yaml
from hypothesis import given, strategies as st

from mapdeal.errors import MalformedInputError
from mapdeal.files import yaml_text
from mapdeal.files.yaml_text import OF_MAPS, OF_RECIPES, compose_documents, parse_mapping

NAME = Path("m.yaml")
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
    "---", "...", ".", "a:", "a: b", "'q'", '"q"', '"\\u00e9\\n"', "a#b", "#c", "a #c", "[1, 2]",
    "[ 1,2 ]", "[]", "[-]", "[- 1]", "[1,, 2]", "[a]", "[[1]]", "[1, 2", "{a: 1}", "{a, b: [c]}",
    "&a 1", "*a", "!t 1", "!!str 1", "! 1", "| ", "|\n  x\n  y", ">-\n  x\n  y", "\n  - 1\n  - b",
    "\n  b: 1\n  c:\n    - d", "?", "", " ", "=", "<<", "\xfc\U0001f600", "[1 2]", "-a", "+a", "e1",
]  # fmt: skip
LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # libyaml and PyYAML differ, as in "!,"
STARTS = ["", "  ", "# x\n"]
KEYS = ["image", "a", "_b1", "yes", "null", "n", "1a", "a b", "", "a:", "- a", "?", "#", "<<",
        "\xe9"]  # fmt: skip
ENDS = ["\n", "\n\n", " \n", "\r\n", "\n# c\n", "\n \n", "\n  # c\n", "", " # c\n", "#c\n",
        "\n---\n", "\n...\n"]  # fmt: skip


def tree(node, text):
    """Return what a node holds, and where: of collections not where they end."""
    start, value = node.start_mark, node.value
    if isinstance(node, yaml.SequenceNode):
        value = [tree(child, text) for child in value]
    elif isinstance(node, yaml.MappingNode):
        value = [(tree(key, text), tree(child, text)) for key, child in value]
    else:
        value = value, text[start.index : node.end_mark.index], node.style or None
    return type(node), node.tag, value, start.index, start.line, start.column


def check(text):
    try:
        entries = parse_mapping(NAME, text.encode(), OF_RECIPES)
    except MalformedInputError as error:
        if "not valid YAML" in str(error):
            with pytest.raises(yaml.YAMLError):
                yaml.compose(text, Loader=LOADER)
        return
    node = yaml.compose(text, Loader=LOADER)
    assert [(tree(entry.node, text), entry.line) for entry in entries.values()] == [
        (tree(value, text), key.start_mark.line + 1) for key, value in node.value
    ]
    assert list(entries) == [key.value for key, _ in node.value]


@pytest.mark.parametrize("end", ["", "\n", "\n\n  \n# end", " "])
def test_the_file_of_a_map(end):
    check(MAP + end)
    check((MAP + end).replace("\n", "\r\n"))
    assert parse_mapping(NAME, (MAP + end).encode())["origin"].line == 4


PARTS = STARTS, KEYS, [": ", ":  ", ":"], WORDS, ENDS


@given(st.lists(st.tuples(*map(st.sampled_from, PARTS)), max_size=4))
def test_nodes_are_those_of_pyyaml(lines):
    check("".join("".join(parts) for parts in lines))


@given(st.text("ab:[]{} ,#-+.0e\n'\"!*&", max_size=30))
def test_so_are_those_of_any_text(text):
    if not any(flow in text for flow in "{["):  # within which libyaml takes fewer keys
        check(text)


def test_real_files(real_maps):
    files = sorted(real_maps.rglob("*.yaml"))
    assert len(files) > 100
    for path in files[::11]:
        text = path.read_text()
        ours = compose_documents(path, text.encode(), OF_RECIPES)
        theirs = list(yaml.compose_all(text, Loader=LOADER))
        assert [tree(our, text) for our in ours] == [tree(their, text) for their in theirs]
        if len(ours) == 1:
            check(text)


@pytest.mark.parametrize(("text", "place"), [
    ("a: 1\nb: [1, 2", "line 2, column 9"),
    ("a: 1\nb: [1, 2\n", "line 3, column 1"),
    ("a: 1\nb: c: d\n", "line 2, column 5"),
    ("a: 1\n---\nb: 2\n", "line 2, column 1: not valid YAML: but found another document"),
    ("a: 1\nb: 2\na: 3\n", "a: key appears twice, on lines 1 and 3"),
    ("a: 1\n? [b]\n: 2\n", "line 2: a key must be a single word"),
    ("a: &a 1\nb: &a 2\nc: *a\n", "line 2, column 4: not valid YAML: second occurrence"),
])  # fmt: skip
def test_invalid_yaml_is_refused_with_its_place(text, place):
    with pytest.raises(MalformedInputError) as caught:
        parse_mapping(NAME, text.encode(), OF_RECIPES)
    assert f"m.yaml: {place}" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("data", "kind"), [
    (b"P5\n", "a P5 image"), (b"Pf ", "a Pf image"), (b"\x89PNG", "an image"), (b"BM", "an image"),
])  # fmt: skip
def test_images_are_named(data, kind):
    with pytest.raises(MalformedInputError, match=f"looks like {kind}"):
        yaml_text.refuse_image(NAME, data)


def test_an_anchor_is_known_in_its_own_document_alone():
    with pytest.raises(MalformedInputError, match="undefined alias"):
        compose_documents(NAME, b"a: &a 1\n---\nb: *a\n", OF_RECIPES)
    first, second = compose_documents(NAME, b"a: &a 1\nb: *a\n---\na: &a 2\n", OF_RECIPES)
    assert first.value[0][1] is first.value[1][1]
    assert second.value[0][1].value == "2"
    with pytest.raises(MalformedInputError, match="line 3: an alias within its own anchor"):
        compose_documents(NAME, b"a: &a 1\n---\na: &a [*a]\n", OF_RECIPES)


def test_fields_are_those_of_a_mapping():
    entries = parse_mapping(NAME, b"a: {b: 1}\nc:\n- 1\n")
    assert entries["a"].fields()["b"].number() == 1
    with pytest.raises(MalformedInputError, match="must be a mapping of keys"):
        entries["c"].fields()


def test_a_value_of_the_command_line_that_is_not_unicode_is_refused():
    with pytest.raises(MalformedInputError, match="not valid YAML"):
        yaml_text.parse_value("a\udcff", "--set")


@pytest.mark.skipif(not yaml.__with_libyaml__, reason="PyYAML comes without libyaml here")
def test_tabs_stand_where_libyaml_takes_them():
    entries = parse_mapping(NAME, b"a:\t1\nb:\t[1,\t2]\t# c\n", OF_MAPS)
    assert entries["a"].number() == 1
    assert [item.number() for item in entries["b"].items()] == [1, 2]


def test_without_libyaml_pyyaml_serves(monkeypatch):
    monkeypatch.setattr("mapdeal.files.yaml_text._LIBYAML", yaml_text._PYYAML)
    check(MAP)
    with pytest.raises(MalformedInputError, match="line 2, column 9: not valid YAML"):
        parse_mapping(NAME, b"a: 1\nb: [1, 2")
