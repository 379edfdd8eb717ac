"""The order of the layers, and what is one layer's business, read off the source."""

import re
import subprocess
import sys

from sources import MODULES, place_of

FOUNDATION = {"compatibility", "errors", "version", "kernels", "grid", "command"}
ON_GRIDS = {"stages", "editing", "planning", "mapping", "compare", "files", "pictures"}
OF_FILES = {"files", "inputs", "maps", "sensors"}
MIDDLE = {*FOUNDATION, *ON_GRIDS, *OF_FILES, "bags", "ros", "checks", "report"}
ALLOWED = {
    "compatibility": set(),
    "errors": {"compatibility"},
    "version": set(),
    "kernels": {"errors", "version"},
    "grid": {"compatibility", "errors", "kernels"},
    "command": {"errors", "kernels", "grid"},
    **dict.fromkeys(ON_GRIDS, FOUNDATION),
    # what a file is, is asked by its readers, and answered by those of all formats
    **{key: {*FOUNDATION, *OF_FILES} for key in ["inputs", "maps", "sensors"]},
    "bags": {*FOUNDATION, "files", "inputs"},
    "ros": {*FOUNDATION, "files", "inputs"},
    "checks": {*FOUNDATION, *OF_FILES, "ros"},
    "report": {*FOUNDATION, "compare", "pictures"},
    "pipeline": MIDDLE - {"report", "checks"},
    "commands": {*MIDDLE, "pipeline"},
    "api": {*MIDDLE, "pipeline", "commands"},
    "cli": {*MIDDLE, "pipeline", "commands"},
}
IMPORT = re.compile(r"^ *(?:from|import) ([\w.]+)", re.MULTILINE)
ONE_LAYERS = [
    ({"typer"}, {"cli"}),
    ({"PIL", "zipfile", "tempfile"}, {"files", "maps", "pictures"}),
    ({"multiprocessing", "distributed"}, {"pipeline"}),
]
"""Packages, and the layers that alone may import them."""


def imports():
    """Yield the place and the layer of a module with each name that it imports."""
    for path in MODULES:
        layer = place_of(path).partition("/")[0].removesuffix(".py")
        if layer not in ("__init__", "__main__"):
            yield from ((place_of(path), layer, one) for one in IMPORT.findall(path.read_text()))


def test_no_layer_imports_from_above():
    ours = [(place, layer, one.split(".")[1]) for place, layer, one in imports()
            if one.startswith("mapdeal.")]  # fmt: skip
    assert len(ours) > 500
    assert [one for one in ours if one[2] not in ALLOWED[one[1]] | {one[1]}] == []


def test_files_terminal_and_other_processes_are_each_one_layers_business():
    strangers = [
        f"{place} imports {module}"
        for place, layer, module in imports()
        for packages, layers in ONE_LAYERS
        if module.split(".")[0] in packages and layer not in layers
    ]
    assert not strangers


ASKED = re.compile(
    r"(?<!os\.path)\.(?:absolute|cwd|exists|expanduser|is_dir|is_file|is_mount|is_symlink|iterdir|lstat|"
    r"readlink|resolve|rglob|samefile|stat)\("
    r"|\b(?:os|path)\.(?:access|getcwd|listdir|scandir|walk|abspath|getsize|getmtime|isdir|isfile|"
    r"islink|realpath)\("
)


def test_the_system_is_asked_about_names_in_one_place():
    """What it raises depends on the name, on who asks, and on the version of Python."""
    asking = {place_of(path) for path in MODULES if ASKED.search(path.read_text("utf-8"))}
    assert asking == {"files/source.py", "files/transaction.py"}


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
