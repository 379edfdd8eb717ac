"""The command `run`: how many maps it runs at the same time."""

import json

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


def test_the_radius_of_a_footprint_is_told_everywhere(command, tmp_path):
    """0.5 m, by hand: the corner lies 0.3 and 0.4 m from the centre."""
    path = tmp_path / "m.yaml"
    write_map(path, grid_from_text("#......\n.......\n......."))
    shape = ["--footprint", "[[0.3,0.4],[0.3,-0.4],[-0.3,-0.4],[-0.3,0.4]]"]
    for words in (["run", path, "-o", tmp_path / "o", *shape, "--dry-run", "-v"],
                  ["run", path, "-o", tmp_path / "o", *shape, "-v"],
                  ["inflate", path, "-o", tmp_path / "i.npz", *shape, "-v"]):  # fmt: skip
        assert "inflate: radius=0.5, footprint=[[0.3, 0.4]," in command(*words)[2]
    folder = tmp_path / "o" / "m"
    manifest = json.loads((folder / "manifest.json").read_text())
    assert manifest["stages"][0]["inflate"]["radius"] == 0.5
    for name, stages in (("inflated.yaml", 1), ("esdf.npz", 2), ("cost.yaml", 3)):
        report = json.loads(command("info", folder / name, "--json")[1])
        assert report["made_by"] == manifest["stages"][:stages]
        assert "  made by     inflate: radius 0.5, " in command("info", folder / name)[1]
    for name in (folder, folder / "manifest.json"):
        report = json.loads(command("info", name, "--json")[1])
        assert (report["kind"], report["stages"]) == ("run", manifest["stages"])
        assert "  inflate     radius 0.5, footprint [[0.3, 0.4]," in command("info", name)[1]


def test_info_says_how_a_file_was_made_of_the_run_s_own_files_alone(command, tmp_path):
    path = tmp_path / "m.yaml"
    write_map(path, grid_from_text("#......\n.......\n......."))
    command("run", path, "-o", tmp_path / "o", "--no-images")
    folder = tmp_path / "o" / "m"
    write_map(folder / "esdf.npz", grid_from_text("#."), force=True)  # of somebody else
    write_map(folder / "own.npz", grid_from_text("#."))
    (folder / "inflated.pgm").write_bytes((tmp_path / "m.pgm").read_bytes())
    for name, is_of_run in (("cost.npz", True), ("esdf.npz", False), ("own.npz", False),
                            ("inflated.yaml", False)):  # fmt: skip
        code, out, _ = command("info", folder / name, "--json")
        assert (code, "made_by" in json.loads(out)) == (0, is_of_run)
    code, _, err = command("info", tmp_path)
    assert (code, err.splitlines()[0]) == (
        4, f"error: {tmp_path}: is a folder without a manifest.json of a run"
    )  # fmt: skip
