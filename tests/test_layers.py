"""Rules on the source of each layer; lint-imports checks the order of the layers."""

import re
import subprocess
import sys

import pytest

from sources import MODULES, place_of


@pytest.mark.parametrize(("packages", "layers"), [
    ("typer", "cli"),
    ("PIL|zipfile|tempfile", "files|maps|pictures"),
    ("multiprocessing|distributed", "pipeline"),
])  # fmt: skip
def test_files_terminal_and_other_processes_are_each_one_layers_business(packages, layers):
    imported = re.compile(rf"^ *(?:from|import) (?:{packages})\b", re.MULTILINE)
    users = {place_of(path) for path in MODULES if imported.search(path.read_text("utf-8"))}
    assert users
    assert not [place for place in users if not re.match(rf"(?:{layers})/", place)]


FILE_SYSTEM_CALLS = re.compile(
    r"(?<!os\.path)(?<!\bsource)(?<!\bsources)\.(?:absolute|cwd|exists|expanduser|is_dir|is_file|"
    r"is_mount|is_symlink|iterdir|lstat|readlink|resolve|rglob|samefile|stat)\("
    r"|\b(?:os|path)\.(?:access|getcwd|listdir|scandir|walk|abspath|getsize|getmtime|isdir|isfile|"
    r"islink|realpath)\("
)


def test_modules_stay_short_and_two_call_the_file_system_about_names():
    asking = filter(lambda path: FILE_SYSTEM_CALLS.search(path.read_text("utf-8")), MODULES)
    assert set(map(place_of, asking)) == {"files/source.py", "files/transaction.py"}
    assert all(len(path.read_text("utf-8").splitlines()) <= 1000 for path in MODULES)


def test_starting_up_loads_no_numerical_library():
    heavy = "numpy", "scipy", "PIL", "yaml", "asyncio", "multiprocessing"
    code = "import sys; from mapdeal.cli.main import main; main(['--version']); "
    code += f"assert not {set(heavy)} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)
