"""The command line as a process: how it starts, ends, and what it says at its end."""

import gc
import os
import subprocess
import sys
from pathlib import Path

import pytest

from mapdeal.cli.process import collect_from_here
from mapdeal.kernels import engine

EXAMPLE = Path(__file__).parents[2] / "examples" / "maps" / "office.yaml"


def process(*words, **environment):
    return subprocess.run(
        [sys.executable, "-m", "mapdeal", *map(str, words)],
        capture_output=True,
        text=True,
        env={**os.environ, **environment},
    )


def test_a_process_ends_with_the_exit_code_and_all_of_its_output(tmp_path):
    told = process("info", *[EXAMPLE] * 40, "--json")
    assert told.returncode == 0
    assert len(told.stdout.splitlines()) == 40
    missing = process("inflate", tmp_path / "missing.yaml", "-o", tmp_path / "a.yaml")
    assert missing.returncode == 4
    assert missing.stderr.startswith("error: ")
    assert len(missing.stderr.splitlines()) == 1


def test_the_version_says_which_kernels_are_in_use():
    usual = "scipy" if engine.compiled_module() is None else "compiled"
    assert f"(kernels: {usual})" in process("--version", MAPDEAL_KERNELS="").stdout
    assert "(kernels: scipy)" in process("--version", MAPDEAL_KERNELS="scipy").stdout


def test_an_engine_that_there_is_not_is_an_error_on_one_line(tmp_path):
    for words in (["--version"], ["inflate", EXAMPLE, "-o", tmp_path / "out.yaml"]):
        told = process(*words, MAPDEAL_KERNELS="opencv")
        assert told.returncode == 2
        assert told.stderr == "error: MAPDEAL_KERNELS: must be compiled or scipy, got 'opencv'\n"
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(engine.compiled_module() is None, reason="the kernels were not compiled")
def test_both_engines_write_the_same_files(tmp_path):
    for name in ("compiled", "scipy"):
        told = process("run", EXAMPLE, "-o", tmp_path / name, MAPDEAL_KERNELS=name)
        assert told.returncode == 0, told.stderr
    files = [p for p in (tmp_path / "compiled").rglob("*") if p.is_file()]
    assert len(files) == 12
    for file in files:
        twin = tmp_path / "scipy" / file.relative_to(tmp_path / "compiled")
        assert file.read_bytes() == twin.read_bytes(), file.name


def test_garbage_is_collected_again_once_a_command_is_loaded():
    gc.disable()
    try:
        collect_from_here()
        assert gc.isenabled()
    finally:
        gc.enable()
        gc.unfreeze()
