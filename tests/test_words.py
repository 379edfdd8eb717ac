"""Words that readers of ROS's documentation would stumble over, in all that people read."""

import ast
import re

import pytest

from sources import MODULES, tree_of
from test_documentation import PAGES

pytestmark = pytest.mark.slow

WORDS = {
    r"\b(?:tells?|told)\b(?! (?:\w+ ){0,3}(?:apart|from))": "report, print, show, explain",
    r"\bis no (?:key|line|name|option|part) of\b": "unknown, invalid, not in",
    r"\bdear(?:er)?\b": "high-cost, expensive",
    r"\bbe it\b": "whether",
    r"\bwhose like\b": "a matching",
    r"\bcompiled on the way\b": "during installation",
    r"\bon upwards\b": "at or above",
    r"\b(?:is|are) not at hand\b": "is missing",
    r"\b(?:free|occupied|unknown) any ?more\b": "now",
    r"\bbrings? (?:\w+ )?to (?:its|their) end\b": "finish",
    r"\bcan be had\b": "is available",
    r"\brear heading\b": "direction of the robot's back",
    r"\bdown; B\b": "rows, columns",
    r"\bof its own accord\b": "automatically",
}
"""Patterns, and what to write instead."""
ANY = re.compile("|".join(WORDS), re.IGNORECASE)


def found(text):
    """Return such words outside of code."""
    return [match[0] for match in ANY.finditer(re.sub(r"`[^`\n]*`", "", text))]


def prose(path):
    """Return the text of a page without blocks of code, or the texts of a module."""
    if path.suffix == ".md":
        return re.sub(r"^```.*?^```", "", path.read_text(), flags=re.MULTILINE | re.DOTALL)
    values = [node.value for node in ast.walk(tree_of(path)) if isinstance(node, ast.Constant)]
    return "\n".join(value for value in values if isinstance(value, str) and " " in value)


@pytest.mark.parametrize("path", [*PAGES, *MODULES], ids=lambda path: path.name)
def test_pages_and_messages_use_the_words_of_the_field(path):
    assert found(prose(path)) == []
