"""Runs beside stored ones."""

import json

import pytest

from drawn import grid_from_text
from mapdeal import write_map
from mapdeal.pipeline.folder import changes_between, differences_from_golden

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
    for output, words in (("out", []), ("other", ["--no-images"]), ("new", [])):
        stored = "out" if output == "new" else "gold"  # a whole run is golden, too
        code, out, _ = command("run", "m.yaml", "-o", output, *words, "--golden", stored)
        assert (code, out.splitlines()[-1]) == (0, f"{stored}: all stages as stored")


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
    code, out, err = command("run", "m.yaml", "-o", "new", "--golden", "gold")
    assert code == 1
    assert [line for line in out.splitlines() if line.startswith("m: ")] == [
        "m: cost: cost.npz differ"
    ]
    assert "1 stage differs from the golden run" in err


def test_stages_that_are_new_or_missing(command, golden):
    code, out, _ = command("run", "m.yaml", "-o", "new", "--golden", "gold", "--recipe", "nav2")
    assert code == 1
    assert "m: inflate: is missing" in out.splitlines()


def test_several_maps(command, golden):
    write_map("n.yaml", grid_from_text(ROOM + "\n" + "#" * 25, 0.1))
    words = ["run", "m.yaml", "n.yaml", "-o", "both", "--no-images", "--golden", "gold"]
    assert command(*words, "--update-golden")[0] == 0
    assert command(*words)[0] == 0
    write_map("n.yaml", grid_from_text(ROOM, 0.1), force=True)
    code, out, _ = command(*words, "--force")
    assert code == 1
    assert {line.split(":")[0] for line in out.splitlines() if "differ" in line} == {"n"}


FIGURES = {
    "width": 5, "height": 4, "reachable_m2": 80.5, "open_m2": 90.0, "share": 0.75,
    "goals": {"kitchen": True, "hall": True, "1.5,-2": False}, "passages": 3,
}  # fmt: skip


def compared(tmp_path, changed, parameters=None):
    """Return what differs if the stage visit has other figures than its golden run."""
    manifests = []
    for place, figures, given in (("gold", FIGURES, {"goals": {"hall": [1, 2]}, "margin": 0.1}),
                                  ("out", {**FIGURES, **changed}, parameters)):  # fmt: skip
        folder = tmp_path / place / "m"
        folder.mkdir(parents=True)
        manifests.append(given or manifests[0])
        outputs = {"visit.json": str(sorted(figures.items())), "visit.png": place}
        document = {"stages": [{"visit": manifests[-1]}], "figures": {"visit": figures},
                    "outputs": outputs}  # fmt: skip
        (folder / "manifest.json").write_text(json.dumps(document))
    return differences_from_golden(tmp_path / "out" / "m", tmp_path / "gold")


@pytest.mark.parametrize(("changed", "told"), [
    ({"goals": {"kitchen": False, "hall": False, "1.5,-2": True}},
     "kitchen, hall no longer reachable, 1.5,-2 reachable now"),
    # what CI has to see comes first, however much else has changed
    ({"goals": {"kitchen": False, "hall": True, "1.5,-2": False}, "reachable_m2": 1.0,
      "share": 0.5, "passages": 4, "open_m2": 2.0},
     "kitchen no longer reachable, reachable_m2 80.5 -> 1.0, open_m2 90.0 -> 2.0 and 2 more"),
    ({"goals": {"kitchen": True, "1.5,-2": False}}, "goals.hall True -> None"),
    ({"goals": None}, "goals {'kitchen': True, 'hall': True, '1.5,-2': False} -> None"),
    ({"most_common": {"cost": 0}}, "most_common None -> {'cost': 0}"),
])  # fmt: skip
def test_goals_that_are_lost_are_told_in_words_and_first(tmp_path, changed, told):
    assert compared(tmp_path, changed) == [f"m: visit: visit.json differ: {told}"]


def test_many_lost_goals_are_counted(tmp_path):
    goals = {f"room {k}": True for k in range(5)}
    old = {**FIGURES, "goals": goals}
    lost = dict.fromkeys(goals, False)
    (told, *_) = changes_between(old, {**old, "goals": lost})
    assert told == "room 0, room 1, room 2 and 2 more no longer reachable"
    assert compared(tmp_path, {}) == []


def test_what_differs_within_a_mapping_is_told_by_its_place(tmp_path):
    parameters = {"goals": {"hall": [1, 3], "lift": [0, 0]}, "margin": 0.1}
    assert compared(tmp_path, {"share": 0.5}, parameters) == [
        "m: visit: other parameters: goals.hall [1, 2] -> [1, 3], goals.lift None -> [0, 0]"
    ]
    deep = {"a": {"b": {"c": {"d": {"e": 1}}}}}
    other = {"a": {"b": {"c": {"d": {"e": 2}}}}}
    assert changes_between(deep, other) == ["a.b.c.d {'e': 1} -> {'e': 2}"]


def test_names_of_goals_stay_on_their_line(tmp_path):
    (line,) = compared(tmp_path, {"goals": {"a\nb": True}})
    assert "\n" not in line
