"""The order of the layers, read off the imports."""

import ast
import subprocess
import sys

import pytest

from sources import MODULES, place_of, tree_of

pytestmark = pytest.mark.slow

FOUNDATION = {"errors", "version", "kernels", "grid", "command"}
ON_GRIDS = {"stages", "editing", "planning", "mapping", "compare", "files", "pictures"}
OF_FILES = {"files", "inputs", "maps", "sensors"}
MIDDLE = {*FOUNDATION, *ON_GRIDS, *OF_FILES, "bags", "ros", "checks", "report"}
ALLOWED = {
    "errors": set(),
    "version": set(),
    "kernels": {"errors", "version"},
    "grid": {"errors", "kernels"},
    "command": {"errors", "kernels", "grid"},
    **dict.fromkeys(ON_GRIDS, FOUNDATION),
    # what a file is, is asked by its readers, and answered by those of all formats
    **{key: {*FOUNDATION, *OF_FILES} for key in ["inputs", "maps", "sensors"]},
    "bags": {*FOUNDATION, "files", "inputs"},
    "ros": {*FOUNDATION, "files", "inputs"},
    "checks": {*FOUNDATION, *OF_FILES, "ros"},
    "report": {*FOUNDATION, "pictures"},
    "pipeline": MIDDLE - {"report", "checks"},
    "commands": {*MIDDLE, "pipeline"},
    "api": {*MIDDLE, "pipeline", "commands"},
    "cli": {*MIDDLE, "pipeline", "commands"},
}


def _layer(path):
    return place_of(path).partition("/")[0].removesuffix(".py")


def _imports(path):
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


def test_no_layer_imports_from_above():
    above = []
    for path in MODULES:
        layer = _layer(path)
        if layer in ("__init__", "__main__"):
            continue
        allowed = ALLOWED[layer] | {layer}
        for module in _imports(path):
            package, _, inside = module.partition(".")
            if package == "mapdeal" and inside and inside.split(".")[0] not in allowed:
                above.append(f"{place_of(path)} imports {module}")
    assert not above


BUSINESS = [
    ({"typer"}, {"cli"}),
    ({"PIL", "zipfile", "tempfile"}, {"files", "maps", "pictures"}),
    ({"multiprocessing", "distributed"}, {"pipeline"}),
]
"""Packages, and the layers that alone may import them."""


def test_files_terminal_and_other_processes_are_each_one_layers_business():
    strangers = [
        f"{place_of(path)} imports {module}"
        for path in MODULES
        for module in _imports(path)
        for packages, layers in BUSINESS
        if module.split(".")[0] in packages and _layer(path) not in layers
    ]
    assert not strangers


def test_modules_stay_short():
    lengths = {place_of(path): len(path.read_text().splitlines()) for path in MODULES}
    assert {name: length for name, length in lengths.items() if length > 1000} == {}


def test_starting_up_loads_no_numerical_library():
    code = (
        "import sys; from mapdeal.cli.main import main; main(['--version']); "
        "print([m for m in ('numpy', 'scipy', 'PIL', 'yaml', 'asyncio', 'multiprocessing') "
        "if m in sys.modules])"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.splitlines()[-1] == "[]"
