"""A short fuzzing of the readers; fuzz_readers.py is the long one."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from fuzz_readers import LONGEST, fuzz


def test_damaged_files_are_read_or_refused():
    found, problems, slowest = fuzz(3000, 7)
    assert not problems
    assert slowest < LONGEST
    assert sum(found.values()) == 3000
    assert min(found[kind, "refused"] for kind, _ in found) > 0
