"""No text of a user's makes a regular expression take more than a few looks at each character."""

import ast
import re
import subprocess
import sys
from functools import partial
from itertools import product, takewhile

import pytest

from sources import MODULES, place_of, tree_of

pytestmark = pytest.mark.slow

FUNCTIONS = {"compile", "match", "fullmatch", "search", "sub", "subn", "split", "findall",
             "finditer"}  # fmt: skip
OURS = {
    r" +\[default: ", r".*?\.(?=\s+[A-Z`]|$)", r"(?m)^ {4}(?P<names>[a-z_0-9, ]+) : ",
    r"(?m)^ {4}(?P<name>\w+)\n {4}-+\n",
}  # fmt: skip
"""Matched against docstrings of the project alone."""

ASSEMBLED = {"pipeline/batch.py": r"(?<![\w./-])/some/folder/",
             "maps/images.py": r"(MM|II)(\0\*|\*\0)|MM\0\+|II\+\0"}  # fmt: skip
"""Examples of patterns that are put together or stored in attributes, by file."""

LENGTH = 100_000
LIMIT = 60  # seconds for all tries of a pattern, which take far less, or far more if quadratic


def text_of(pattern):
    """Return a pattern as the table has it: of bytes or text, \\x written out."""
    text = pattern.decode("latin-1") if isinstance(pattern, bytes) else pattern
    return "".join(c if c.isascii() else f"\\x{ord(c):02x}" for c in text)


def called(node):
    is_call = isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)
    is_ours = is_call and ast.unparse(node.func.value) == "re" and node.func.attr in FUNCTIONS
    return node.func.attr if is_ours else ""


def patterns_in_the_source():
    """Return the functions that each regular expression is used with, by pattern."""
    found = {}
    assert not [path for path in MODULES if re.search(r"(?m)^ *from re import", path.read_text())]
    for path in (path for path in MODULES if "import re\n" in path.read_text()):
        name, nodes = place_of(path), list(ast.walk(tree_of(path)))
        compiled, uses_of = {}, {}
        for node in filter(called, nodes):
            pattern = node.args[0]
            text = text_of(pattern.value) if isinstance(pattern, ast.Constant) else ASSEMBLED[name]
            uses = found.setdefault(text, set())
            if called(node) == "compile":
                compiled[node] = uses
            else:
                uses.add(called(node))
        for node in nodes:
            if isinstance(node, ast.Assign) and node.value in compiled:
                uses_of[node.targets[0].id] = compiled[node.value]
            elif isinstance(node, ast.Attribute) and node.value in compiled:
                compiled[node.value].add(node.attr)
        for node in nodes:
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
                uses_of.get(node.value.id, set()).add(node.attr)
    return found


@pytest.fixture(scope="module")
def from_users():
    """The functions that each pattern is used with that texts of users are matched against."""
    found = patterns_in_the_source()
    assert set(found) >= OURS
    assert found[r"([^/]+)/([^/]+)"] == {"fullmatch"}
    return {pattern: uses & FUNCTIONS for pattern, uses in found.items() if pattern not in OURS}


def unbounded_repeats(items, *, inside=False):
    """Yield whether each repeat without an upper bound stands within another."""
    for code, value in items:
        name, parts, endless = str(code), [], False
        if name in ("MAX_REPEAT", "MIN_REPEAT"):
            endless, parts = value[1] == re._parser.MAXREPEAT, [value[2]]
        elif name == "BRANCH":
            parts = value[1]
        elif name in ("SUBPATTERN", "ASSERT", "ASSERT_NOT"):
            parts = [value[-1]]
        if endless:
            yield inside
        for part in parts:
            yield from unbounded_repeats(part, inside=inside or endless)


def test_exponential_repeats_are_seen_and_there_are_none(from_users):
    assert any(unbounded_repeats(re._parser.parse(r"(?:\s|#[^\n]*)*x")))
    assert not any(unbounded_repeats(re._parser.parse(r"\d+(\.\d*)?")))
    assert len(from_users) > 40
    parsed = map(re._parser.parse, from_users)
    assert not [pattern for pattern in parsed if any(unbounded_repeats(pattern))]


CODE = """
import re, sys
pattern, uses = eval(sys.stdin.readline())
for line in sys.stdin:
    head, unit = eval(line)
    text = head + unit * (LENGTH // len(unit)) + "\x01"
    for use in uses.split():
        print(use, ascii((head, unit)), flush=True)
        if use == "sub":
            re.sub(pattern, "", text)
        else:
            getattr(re, use)(pattern, text)
""".replace("LENGTH", str(LENGTH))


@pytest.mark.thorough
def test_nothing_that_is_long_and_nearly_fits_takes_long(from_users):
    for pattern, uses in from_users.items():
        signs = list(dict.fromkeys(["1", " ", "a", *pattern.replace("\\", "")]))
        heads = ["", "".join(takewhile(str.isalpha, pattern)), "-1", "tcp://a"]
        units = [*signs, *map("".join, product(signs[:5], repeat=2))]
        tries = [f"{(head, unit)!a}\n" for head in dict.fromkeys(heads) for unit in units]
        text = "".join([f"{(pattern, ' '.join(uses) or 'search')!a}\n", *tries])
        run = partial(subprocess.run, capture_output=True, text=True, check=True, timeout=LIMIT)
        try:
            run([sys.executable, "-c", CODE], input=text)
        except subprocess.TimeoutExpired as stopped:
            last = (stopped.stdout or b"").decode().splitlines()[-1:]
            pytest.fail(f"takes long: {pattern} {last}")
