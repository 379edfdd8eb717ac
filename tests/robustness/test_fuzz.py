"""Every reader on hundreds of damaged files; fuzz_readers.py feeds any number of them."""

import inspect
import os
import re
import time
import warnings
from pathlib import Path

import numpy as np
import pytest

import mapdeal
from mapdeal import Costmap, DistanceField, OccupancyGrid, PotentialField
from mapdeal.errors import MalformedInputError
from mapdeal.maps.images import IMAGE_FORMATS
from mapdeal.sensors.clouds import CLOUD_SUFFIXES
from robustness import reading
from robustness.fuzz_readers import fuzz, read_seeds
from robustness.readers import READERS, Reader, Seed

pytestmark = pytest.mark.slow

FEW, MUTANTS = 120, 2000
LONGEST = 60.0
"""Seconds: a thousand times what a mutant takes, on however slow a machine."""

TELLING = ("lint", "lines")
"""First words of messages about damage in the results of readers."""


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
@pytest.mark.parametrize("most", [FEW, pytest.param(MUTANTS, marks=pytest.mark.thorough)])
def test_mutants_are_read_or_refused(reader, most, tmp_path, capfd):
    descriptors = len(os.listdir("/dev/fd"))  # noqa: PTH208 - they are no files
    mutants = max(1, round(most * reader.share))
    found = fuzz(reader, mutants, tmp_path, 7, LONGEST)
    assert not found.problems, "\n".join(found.problems[:5])
    assert found.read + found.refused == mutants
    assert found.read > 0
    assert found.refused > 0 or reader.name.startswith(TELLING)
    assert capfd.readouterr() == ("", "")
    assert len(os.listdir("/dev/fd")) == descriptors  # noqa: PTH208


def test_every_public_reader_is_fuzzed():
    text = inspect.getsource(reading)
    public = [name for name in dir(mapdeal) if re.match(r"(read|load|lint)(_|$)", name)]
    assert len(public) >= 9
    assert [name for name in public if f"mapdeal.{name}(" not in text] == []


def test_all_kinds_of_a_format_are_among_the_good_files(tmp_path):
    by_name = {reader.name: reader for reader in READERS}
    grids = read_seeds(by_name["grid npz"], tmp_path)
    assert {type(grid) for grid in grids} == {Costmap, DistanceField, OccupancyGrid, PotentialField}
    assert {f"{name} image" for name in IMAGE_FORMATS} <= set(by_name)
    clouds = {Path(good.name).suffix for reader in READERS for good in reader.seeds}
    assert set(CLOUD_SUFFIXES) - clouds == {".xyz", ".asc"}  # read as .csv and .txt are
    depths = {good.data[24:26] for good in by_name["PNG image"].seeds}
    assert len(depths) == 15  # pairs of bit depth and colour type that PNG has
    magics = {good.data[:2] for good in by_name["PNM image"].seeds}
    assert magics == {b"P%d" % k for k in range(1, 7)}


# What finds problems must find them.


def _refuses(*arguments, **options):
    def read(path, data):
        raise MalformedInputError(*arguments, **options)

    return read


@pytest.mark.parametrize(("read", "refusals", "named"), [
    (lambda *_: warnings.warn("deprecated", DeprecationWarning, stacklevel=2), (),
     "warned by DeprecationWarning: deprecated"),
    (lambda *_: np.ones(1 << 29, dtype=np.uint8), (), "MemoryError"),
    (lambda *_: time.sleep(LONGEST), (), "took more than 0.05 s"),
    (lambda _, data: data.index(b"nowhere"), (), "ValueError: subsection not found"),
    (_refuses("is damaged"), (MalformedInputError,), "names no file: is damaged"),
    (_refuses("is damaged"), (), "refused as MalformedInputError"),
])  # fmt: skip
def test_the_fuzzer_sees(tmp_path, monkeypatch, read, refusals, named):
    monkeypatch.setattr("robustness.fuzz_readers.read_seeds", print)
    reader = Reader("some", [Seed("s.txt", b"1 2 3")], read, (), refusals)
    (problem,) = fuzz(reader, 1, tmp_path, 1, 0.05).problems
    assert problem.startswith("some 0: ")
    assert named in problem
