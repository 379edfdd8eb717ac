"""What may be put into damaged files: words that mean something in a format."""

import ast
from pathlib import Path

FOLDER = Path(__file__).with_name("words")


def words_of(*formats):
    """Return the words of some formats: each is a line of its file, written as in Python."""
    lists = [(FOLDER / f"{name}.dict").read_text().splitlines() for name in formats]
    return tuple(ast.literal_eval(f"b{line}") for lines in lists for line in lines)
