"""The command `run`: what it says of maps and stages."""

import json

import pytest

from drawn import grid_from_text
from mapdeal import read_map, write_map


def test_a_map_that_is_named_twice_is_run_once_and_said(command, tmp_path):
    path = tmp_path / "m.yaml"
    write_map(path, grid_from_text("#..\n..."))
    code, _, err = command("run", path, path, "-o", tmp_path / "o", "--no-images")
    assert (code, err) == (0, f"note: 1 map was named more than once, and is run once: {path}\n")
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
        4, f"error: {tmp_path}: is a directory without the manifest.json of a run"
    )  # fmt: skip


@pytest.mark.usefixtures("mapdeal_warnings")
def test_the_whole_canvas_through_the_command(command, tmp_path):
    """In a batch with worker processes, told beforehand, and not where nothing is cropped."""
    for name in ("a", "b"):
        write_map(tmp_path / f"{name}.yaml", grid_from_text("?????\n?#..?\n?..??\n?????", 0.3))
    paths = [tmp_path / "a.yaml", tmp_path / "b.yaml"]
    words = ["--sim", "--canvas", "full", "--no-images", "--jobs", 2]
    assert command("run", *paths, "-o", tmp_path / "o", *words, "--dry-run")[0] == 0
    assert command("run", *paths, "-o", tmp_path / "o", *words)[0] == 0
    whole = read_map(tmp_path / "a.yaml")
    for name in ("a", "b"):
        field = read_map(tmp_path / "o" / name / "esdf.npz")
        assert (field.frame, field.region) == (whole.frame, (1, 1, 2, 3))
        assert read_map(tmp_path / "o" / name / "cost.npz").shape == (4, 5)
        assert read_map(tmp_path / "o" / name / "inflated.yaml").origin == whole.origin
    assert "2 unchanged" in command("run", *paths, "-o", tmp_path / "o", *words, "-n")[1]
    for more in (["--recipe", "default"], ["--sim", "--set", "active.canvas=full"]):
        code, _, err = command(
            "run", paths[0], "-o", tmp_path / more[-1], *more, "--canvas", "full", "--no-images"
        )
        assert (code, err.splitlines()[0]) == (
            0, "warning: --canvas full: has no effect, no stage of the recipe crops the map"
        )  # fmt: skip
        manifest = json.loads((tmp_path / more[-1] / "a" / "manifest.json").read_text())
        assert manifest["options"]["canvas"] == "crop"


def test_what_a_run_has_cropped_is_put_back_by_window(command, tmp_path):
    path = tmp_path / "m.yaml"
    write_map(path, grid_from_text("?????\n?#..?\n?..??\n?????", 0.5, (1.0, 2.0, 0.0)))
    for name in ("crop", "full"):
        command("run", path, "-o", tmp_path / name, "--sim", "--canvas", name, "--no-images")
    for name in ("esdf.npz", "cost.npz", "cost.pgm", "esdf.pgm", "inflated.pgm"):
        full, crop = (tmp_path / one / "m" / name for one in ("full", "crop"))
        source = crop if crop.suffix == ".npz" else crop.with_suffix(".yaml")
        for index, where in enumerate(
            [["--like", path], ["--like", tmp_path / "full" / "m" / "esdf.npz"],
             ["--corner=1,2", "--size=2.5,2"]]
        ):  # fmt: skip
            output = tmp_path / f"{index}{source.name}"
            assert command("window", source, "-o", output, *where)[0] == 0
            assert output.with_suffix(full.suffix).read_bytes() == full.read_bytes()
    crop = tmp_path / "crop" / "m" / "esdf.npz"
    write_map(tmp_path / "other.yaml", grid_from_text("##\n##", 0.5, (1.2, 2.0, 0.0)))
    for words, code, said in (
        (["--like", tmp_path / "other.yaml"], 2, "edges of the cells"),
        (["--like", tmp_path / "none.yaml"], 4, "none.yaml"),
        (["--like", path, "--size=1,1"], 2, "together"),
        ([], 2, "--size, --like"),
        (["--corner=99,2", "--size=1,1"], 2, "no cell of it has a distance"),
        (["--like", path, "--default", "0"], 2, "takes none"),
    ):
        found, _, err = command("window", crop, "-o", tmp_path / "x.npz", *words)
        assert (found, said in err.splitlines()[0]) == (code, True)
        assert not (tmp_path / "x.npz").exists()
    code, _, err = command("window", crop, "-o", path, "--like", path, "--force")
    assert (code, "the output is the input" in err) == (4, True)


def test_a_field_on_the_whole_canvas_is_asked_and_converted(command, tmp_path):
    path = tmp_path / "m.yaml"
    write_map(path, grid_from_text("?????\n?#..?\n?..??\n?????", 0.5, (1.0, 2.0, 0.0)))
    command("run", path, "-o", tmp_path, "--sim", "--canvas", "full", "--no-images")
    field = tmp_path / "m" / "esdf.npz"
    code, out, _ = command("query", field, "--at", "2.25,2.75", "--at", "1.25,2.25")
    inner, outer = (json.loads(line) for line in out.splitlines())
    assert (code, inner["distance"], inner["state"]) == (0, 0.5, "free")
    assert outer == {
        "x": 1.25, "y": 2.25, "inside": True, "row": 0, "col": 0, "state": "unknown",
        "distance": None, "gradient": None, "cell_distance": None,
    }  # fmt: skip
    code, out, _ = command("convert", field, "-o", tmp_path / "again.npz")
    assert (code, (tmp_path / "again.npz").read_bytes() == field.read_bytes()) == (0, True)
    assert "70.00 % of the cells without a value" in out
    assert "70.00 % of the cells without a value" in command("info", field)[1]
    code, out, _ = command("diff", field, path, "--json")
    assert (code, json.loads(out)["geometry"]) == (0, {})
    for words in (["lint", field], ["cost", field, "-o", tmp_path / "c.npz"],
                  ["route", field, "--from", "2.25,2.75", "--to", "2.75,3.25"]):  # fmt: skip
        assert command(*words)[0] in (0, 1)
    assert (tmp_path / "c.npz").read_bytes() == (tmp_path / "m" / "cost.npz").read_bytes()
