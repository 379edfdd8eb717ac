"""Words that readers of ROS's documentation would stumble over, in all that people read."""

import ast
import re

import pytest

from sources import MODULES, tree_of
from test_documentation import PAGES

pytestmark = pytest.mark.slow

WORDS = {
    r"(?:tells?|told)\b(?! (?:\w+ ){0,3}(?:apart|from))": "report, print, show, explain",
    r"is no (?:key|line|name|option|part) of\b": "unknown, invalid, not in",
    r"dear(?:er)?\b": "high-cost, expensive", r"be it\b": "whether", r"whose like\b": "a matching",
    r"compiled on the way\b": "during installation", r"on upwards\b": "at or above",
    r"(?:is|are) not at hand\b": "is missing", r"(?:free|occupied|unknown) any ?more\b": "now",
    r"brings? (?:\w+ )?to (?:its|their) end\b": "finish", r"can be had\b": "is available",
    r"rear heading\b": "direction of the robot's back", r"down; B\b": "rows, columns",
    r"of its own accord\b": "automatically",
}  # fmt: skip
"""Patterns, and what to write instead."""
ANY = re.compile(rf"\b(?:{'|'.join(WORDS)})", re.IGNORECASE)


def prose(path):
    """Return the text of a page without blocks of code, or the texts of a module."""
    if path.suffix == ".md":
        return re.sub(r"^```.*?^```", "", path.read_text(), flags=re.MULTILINE | re.DOTALL)
    values = [node.value for node in ast.walk(tree_of(path)) if isinstance(node, ast.Constant)]
    return "\n".join(value for value in values if isinstance(value, str) and " " in value)


@pytest.mark.parametrize("path", [*PAGES, *MODULES], ids=lambda path: path.name)
def test_pages_and_messages_use_the_words_of_the_field(path):
    assert ANY.findall(re.sub(r"`[^`\n]*`", "", prose(path))) == []  # outside of code
