"""Words that readers of ROS's documentation would stumble over, in all that people read."""

import ast
import re
from pathlib import Path

import pytest

from sources import MODULES, tree_of

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
PAGES = [
    ROOT / "README.md",
    *(page for page in sorted((ROOT / "docs").rglob("*.md")) if not page.name.endswith(".zh.md")),
]

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
    return [one[0] for one in ANY.finditer(re.sub(r"`[^`\n]*`", "", text))]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_pages_use_the_words_of_the_field(page):
    prose = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.MULTILINE | re.DOTALL)
    assert found(prose) == []


@pytest.mark.thorough
def test_messages_and_docstrings_use_the_words_of_the_field():
    remarks = [
        f"{module.relative_to(ROOT)}:{node.lineno}: {word}"
        for module in MODULES
        if found(module.read_text("utf-8"))  # most have none even among their names
        for node in ast.walk(tree_of(module))
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value
        for word in found(node.value)
    ]
    assert not remarks, "\n".join(remarks)
