"""Tables of numbers as text."""

import io
from pathlib import Path

import pytest

from mapdeal.formats.text_rows import read_rows

TEXT = b"# a b c\n1 2 3\n\n4 5 6\n# more\n7 8 9\n10 11 12\n"


@pytest.mark.parametrize(
    ("most", "rows", "rest"),
    [
        (None, [[3, 1], [6, 4], [9, 7], [12, 10]], b""),
        (2, [[3, 1], [6, 4]], b"# more\n7 8 9\n10 11 12\n"),
        (3, [[3, 1], [6, 4], [9, 7]], b"10 11 12\n"),
        (9, [[3, 1], [6, 4], [9, 7], [12, 10]], b""),
        (0, [], TEXT),
    ],
)
def test_so_many_rows_are_read_and_what_follows_is_not_touched(most, rows, rest):
    file = io.BytesIO(TEXT)
    found = read_rows(file, [2, 0], path=Path("t.txt"), first_line=1, most=most)
    assert [row for part in found for row in part.tolist()] == rows
    assert file.read() == rest
