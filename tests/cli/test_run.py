"""The command `run`: how many maps it runs at the same time."""

import pytest

from drawn import grid_from_text
from mapdeal import write_map
from mapdeal.cli import run


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
    monkeypatch.setattr(run, "available_threads", lambda: processors)
    assert run._jobs_at_once(wanted, maps) == size
    warning = f"warning: --jobs {wanted}: took {most}, as there are {processors} processors\n"
    assert capsys.readouterr().err == ("" if most is None else warning)


def test_a_map_that_is_named_twice_is_run_once_and_said(command, tmp_path):
    path = tmp_path / "m.yaml"
    write_map(path, grid_from_text("#..\n..."))
    code, _, err = command("run", path, path, "-o", tmp_path / "o", "--no-images")
    assert (code, err) == (0, f"warning: 1 map was named more than once, and is run once: {path}\n")
    assert (tmp_path / "o" / "m" / "manifest.json").exists()
