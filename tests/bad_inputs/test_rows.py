"""Each kind of bad input has a row, Y1 .. F20, and each row a test that has its name."""

import re
from pathlib import Path

TESTS = Path(__file__).parents[1]
ROWS = {"Y": 31, "I": 17, "G": 11, "P": 13, "S": 16, "F": 20}
"""YAML files, images, grids, parameters, sensors' data, files and processes."""

NOT_TESTED = {
    "Y29": "there is no --untrusted",
    "P11": "there is no rescaling",
    "S14": "bags are not read",
}


def test_every_row_has_a_test_or_a_reason():
    wanted = {f"{letter}{number}" for letter, last in ROWS.items() for number in range(1, last + 1)}
    found = set()
    for path in TESTS.rglob("test_*.py"):
        text = path.read_text()
        found |= set(re.findall(r"(?<![A-Za-z0-9])([YIGPSF][0-9]{1,2})(?=-)", text))
        for name in re.findall(r"def (test_\w+)", text):
            found |= {row.upper() for row in re.findall(r"_([yigpsf][0-9]{1,2})(?=_|$)", name)}
    assert wanted - found == set(NOT_TESTED)
