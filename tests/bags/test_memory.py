"""Peak memory of commands on large bags depends on the requested messages only."""

import pytest
from benchmarks.big_bags import SCANS, WRITERS

from cli.test_memory_of_commands import measured

pytestmark = pytest.mark.thorough

MESSAGES = 200_000
MOST = 120_000_000
"""Bytes of a process that makes a map of 2,000 scans; the bags have 100 MB."""


@pytest.mark.parametrize("name", WRITERS)
def test_a_big_bag_is_never_in_memory(name, tmp_path):
    WRITERS[name](tmp_path / name, MESSAGES)
    assert (tmp_path / name).stat().st_size > 60_000_000
    code, output, peak = measured(tmp_path, f"build {name} -o m.yaml")
    assert code == 0, output
    assert f"{SCANS} scans" in output
    assert peak < MOST
    code, output, peak = measured(tmp_path, f"info {name}")
    assert code == 0, output
    assert f"messages    {MESSAGES} in" in output
    assert peak < MOST
