"""The order of the layers, read off the imports."""

import ast
import functools
import subprocess
import sys
from pathlib import Path

import pytest

import mapdeal

PACKAGE = Path(mapdeal.__file__).parent

MIDDLE = {"stages", "editing", "planning", "mapping", "alignment", "scoring", "formats", "render"}
UPPER = {"robot", "checks", "report"}
ALLOWED = {
    "errors": set(),
    "version": set(),
    "records": set(),
    "resources": set(),
    "spelling": set(),
    "kernels": {"errors", "spelling", "version"},
    "grid": {"errors", "spelling", "kernels"},
    "stages": {"errors", "spelling", "grid", "kernels"},
    "editing": {"errors", "spelling", "grid", "kernels"},
    "planning": {"errors", "spelling", "grid", "kernels"},
    "mapping": {"errors", "spelling", "grid", "kernels"},
    "alignment": {"errors", "spelling", "grid", "kernels"},
    "scoring": {"errors", "spelling", "grid", "kernels"},
    "formats": {"errors", "spelling", "grid", "kernels"},
    "render": {"errors", "spelling", "grid", "kernels"},
    "robot": {"errors", "spelling", "grid", "kernels", "formats"},
    "checks": {"errors", "spelling", "grid", "kernels", "formats", "robot"},
    "report": {"errors", "spelling", "grid", "kernels", "render"},
    "pipeline": {"errors", "spelling", "version", "grid", "kernels", *MIDDLE, *UPPER},
    "api": {"errors", "spelling", "version", "grid", "kernels", *MIDDLE, *UPPER, "pipeline"},
    "cli": {"errors", "spelling", "version", "grid", "kernels", *MIDDLE, *UPPER, "pipeline"},
}


def _layer(path):
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


@functools.cache
def _imports(path):
    return tuple(_found_imports(path))


def _found_imports(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


@pytest.mark.slow
@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.py")), ids=lambda p: p.stem)
def test_no_layer_imports_from_above(path):
    layer = _layer(path)
    if layer in ("__init__", "__main__"):
        return
    for module in _imports(path):
        parts = module.split(".")
        if parts[0] == "mapdeal" and len(parts) > 1:
            assert parts[1] in ALLOWED[layer] | {layer, "records", "resources"}, (
                f"{path.name} imports {module}"
            )


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.py")), ids=lambda p: p.stem)
def test_files_terminal_and_other_processes_are_each_one_layers_business(path):
    modules = set(_imports(path))
    if _layer(path) != "cli":
        assert "typer" not in modules
    if _layer(path) not in ("formats", "render"):
        assert not {m for m in modules if m.split(".")[0] in ("PIL", "zipfile", "tempfile")}
    if _layer(path) != "pipeline":
        assert not {m for m in modules if m.split(".")[0] in ("multiprocessing", "distributed")}


def test_modules_stay_short():
    too_long = {
        p.name: n for p in PACKAGE.rglob("*.py") if (n := len(p.read_text().splitlines())) > 600
    }
    assert not too_long


def test_starting_up_loads_no_numerical_library():
    code = (
        "import sys; from mapdeal.cli.main import main; main(['--version']); "
        "print([m for m in ('numpy', 'scipy', 'PIL', 'yaml', 'asyncio', 'multiprocessing') "
        "if m in sys.modules])"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.splitlines()[-1] == "[]"
