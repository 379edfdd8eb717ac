"""Commands that take many maps: how many they go through at the same time."""

import pytest

from mapdeal.cli import terminal
from mapdeal.pipeline import batch


@pytest.mark.parametrize(
    ("wanted", "maps", "processors", "size", "most"),
    [
        (None, 20, 3, 3, None),
        (None, 2, 3, 2, None),
        (1, 20, 3, 1, None),
        (12, 20, 3, 12, None),  # four a processor
        (13, 20, 3, 12, 12),
        (8, 20, 1, 8, None),  # but eight at least
        (9, 20, 1, 8, 8),
        (99, 2, 3, 2, 12),
    ],
)
def test_jobs_are_bounded_by_maps_and_processors(
    monkeypatch, capsys, wanted, maps, processors, size, most
):
    terminal.configure(quiet=False, verbose=False)
    monkeypatch.setattr(batch, "available_threads", lambda: processors)
    assert batch.jobs_at_once(wanted, maps, terminal) == size
    note = f"note: --jobs {wanted}: using {most}, as there are {processors} cores\n"
    assert capsys.readouterr().err == ("" if most is None else note)
