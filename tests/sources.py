import ast
import functools
from pathlib import Path

import mapdeal

PACKAGE = Path(mapdeal.__file__).parent
MODULES = sorted(PACKAGE.rglob("*.py"))


@functools.cache
def tree_of(path):
    """Return the syntax tree of a module, which is parsed once: nobody may change it."""
    return ast.parse(path.read_text("utf-8"))


def place_of(path):
    """Return the path of a module within the package."""
    return path.relative_to(PACKAGE).as_posix()
