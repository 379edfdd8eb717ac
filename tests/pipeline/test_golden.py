"""Runs beside stored ones."""

import json

import pytest

from drawn import grid_from_text
from mapdeal import write_map
from mapdeal.pipeline.golden import differences_from_golden, store_golden

EMPTY, POST = "#" + "." * 23 + "#", "#" + "." * 11 + "#" + "." * 11 + "#"
ROOM = "\n".join(["#" * 25, *[EMPTY] * 6, POST, *[EMPTY] * 6, "#" * 25])


@pytest.fixture
def golden(command, tmp_path, monkeypatch):
    """A map m.yaml, and its golden run."""
    monkeypatch.chdir(tmp_path)
    write_map("m.yaml", grid_from_text(ROOM, 0.1))
    code, out, err = command("run", "m.yaml", "-o", "out", "--golden", "gold", "--update-golden")
    assert (code, err) == (0, "")
    assert "gold/m/manifest.json: stored" in out
    assert [p.name for p in (tmp_path / "gold" / "m").iterdir()] == ["manifest.json"]
    return tmp_path


def test_an_equal_run_passes_with_or_without_pictures(command, golden):
    for words in (["-o", "out"], ["-o", "other", "--no-images"]):
        code, out, _ = command("run", "m.yaml", *words, "--golden", "gold")
        assert code == 0
        assert out.splitlines()[-1] == "gold: all stages as stored"


def test_a_whole_run_is_golden_too(command, golden):
    assert command("run", "m.yaml", "-o", "new", "--golden", "out")[0] == 0


def test_another_map_differs_in_the_stages_that_it_changes_f18(command, golden):
    text = ROOM.replace(POST, EMPTY)
    write_map("m.yaml", grid_from_text(text, 0.1), force=True)
    code, out, err = command("run", "m.yaml", "-o", "new", "--golden", "gold", "--set",
                             "inflate.radius=0")  # fmt: skip
    assert code == 1
    lines = [line for line in out.splitlines() if line.startswith("m: ")]
    assert lines[0] == "m: inflate: other parameters: radius 0.3 -> 0.0"
    assert lines[1].startswith("m: esdf: esdf.npz, esdf.pgm differ: obstacles")
    assert "stages differ from the golden run" in err
    assert "--update-golden" in err


def test_bytes_that_differ_count_even_if_no_figure_does(command, golden):
    path = golden / "gold" / "m" / "manifest.json"
    manifest = json.loads(path.read_text())
    manifest["outputs"]["cost.npz"] = "0" * 64
    path.write_text(json.dumps(manifest))
    code, out, _ = command("run", "m.yaml", "-o", "new", "--golden", "gold")
    assert code == 1
    assert [line for line in out.splitlines() if line.startswith("m: ")] == [
        "m: cost: cost.npz differ"
    ]


def test_stages_that_are_new_or_missing(command, golden):
    code, out, _ = command("run", "m.yaml", "-o", "new", "--golden", "gold", "--recipe", "nav2")
    assert code == 1
    assert "m: inflate: is missing" in out.splitlines()


@pytest.mark.parametrize(
    ("words", "code", "told"),
    [
        (["--update-golden"], 2, "--golden"),
        (["--golden", "nowhere"], 4, "no golden run"),
        (["--golden", "bad"], 3, "no manifest"),
    ],
)
def test_golden_runs_that_are_not_there_f18(command, golden, words, code, told):
    (golden / "bad" / "m").mkdir(parents=True)
    (golden / "bad" / "m" / "manifest.json").write_text("[]")
    found, _, err = command("run", "m.yaml", "-o", "new", *words)
    assert found == code
    assert told in err


def test_several_maps(command, golden):
    write_map("n.yaml", grid_from_text(ROOM + "\n" + "#" * 25, 0.1))
    words = ["run", "m.yaml", "n.yaml", "-o", "both", "--no-images", "--golden", "gold"]
    assert command(*words, "--update-golden")[0] == 0
    assert command(*words)[0] == 0
    write_map("n.yaml", grid_from_text(ROOM, 0.1), force=True)
    code, out, _ = command(*words, "--force")
    assert code == 1
    assert {line.split(":")[0] for line in out.splitlines() if "differ" in line} == {"n"}


def test_a_golden_run_is_called_as_its_folder_unless_it_has_a_place(command, tmp_path):
    write_map(tmp_path / "m.yaml", grid_from_text("#..\n..."))
    assert command("run", tmp_path / "m.yaml", "-o", tmp_path / "o", "--no-images")[0] == 0
    for place, name in ((None, "m"), ("a/b", "a/b")):
        store_golden(tmp_path / "o" / "m", tmp_path / "golden", place)
        assert (tmp_path / "golden" / name / "manifest.json").exists()
        assert differences_from_golden(tmp_path / "o" / "m", tmp_path / "golden", place) == []
