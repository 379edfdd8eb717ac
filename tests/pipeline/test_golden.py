"""Runs beside stored ones."""

import json

import pytest

from drawn import grid_from_text
from mapdeal import write_map
from mapdeal.pipeline.folder import changes_between, differences_from_golden
from pipeline.reported import changed

EMPTY, POST = "#" + "." * 23 + "#", "#" + "." * 11 + "#" + "." * 11 + "#"
ROOM = "\n".join(["#" * 25, *[EMPTY] * 6, POST, *[EMPTY] * 6, "#" * 25])


@pytest.fixture
def golden(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_map("m.yaml", grid_from_text(ROOM, 0.1))
    code, out, err = command("run", "m.yaml", "-o", "out", "--golden", "gold", "--update-golden")
    assert (code, err) == (0, "")
    assert "gold/m/manifest.json: stored" in out
    assert [p.name for p in (tmp_path / "gold" / "m").iterdir()] == ["manifest.json"]

    def run(*words, output="new", stored="gold"):
        code, out, err = command("run", "m.yaml", "-o", output, "--golden", stored, *words)
        lines = out.splitlines()
        return code, [line for line in lines if line.startswith("m: ")], lines[-1], err

    return run


def test_an_equal_run_passes_with_or_without_pictures(golden):
    for output, words, stored in (
        ("out", [], "gold"), ("other", ["--no-images"], "gold"), ("new", [], "out"),
    ):  # fmt: skip
        code, _, last, _ = golden(
            *words, output=output, stored=stored
        )  # a whole run is golden, too
        assert (code, last) == (0, f"{stored}: all stages as stored")


def test_another_map_differs_in_the_stages_that_it_changes(golden):
    code, lines, *_ = golden("--recipe", "nav2")
    assert (code, "m: inflate: is missing" in lines) == (1, True)
    write_map("m.yaml", grid_from_text(ROOM.replace(POST, EMPTY), 0.1), force=True)
    code, lines, _, err = golden("--set", "inflate.radius=0", output="other")
    assert (code, lines[0]) == (1, "m: inflate: other parameters: radius 0.3 -> 0.0")
    assert lines[1].startswith("m: esdf: esdf.npz, esdf.pgm differ: obstacles")
    assert "stages differ from the golden run" in err
    assert "--update-golden" in err


def test_bytes_that_differ_count_even_if_no_figure_does(golden, tmp_path):
    changed(tmp_path / "gold/m/manifest.json",
            lambda manifest: manifest["outputs"].update({"cost.npz": "0" * 64}))  # fmt: skip
    code, lines, _, err = golden()
    assert (code, lines) == (1, ["m: cost: cost.npz differ"])
    assert "1 stage differs from the golden run" in err


def test_several_maps(command, golden):
    write_map("n.yaml", grid_from_text(ROOM + "\n" + "#" * 25, 0.1))
    words = ["run", "m.yaml", "n.yaml", "-o", "both", "-j", 1, "--no-images", "--golden", "gold"]
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
HALL = {"goals": {"hall": [1, 2]}, "margin": 0.1}


@pytest.mark.parametrize(("figures", "parameters", "message"), [
    ({}, HALL, None),
    ({"goals": {"kitchen": False, "hall": False, "1.5,-2": True}}, HALL,
     "visit.json differ: kitchen, hall no longer reachable, 1.5,-2 reachable now"),
    # what CI has to see comes first, however much else has changed
    ({"goals": {"kitchen": False, "hall": True, "1.5,-2": False}, "reachable_m2": 1.0,
      "share": 0.5, "passages": 4, "open_m2": 2.0}, HALL,
     ("visit.json differ: kitchen no longer reachable, reachable_m2 80.5 -> 1.0, "
      "open_m2 90.0 -> 2.0 and 2 more")),
    ({"goals": {"kitchen": True, "1.5,-2": False}}, HALL,
     "visit.json differ: goals.hall True -> None"),
    ({"goals": None}, HALL,
     "visit.json differ: goals {'kitchen': True, 'hall': True, '1.5,-2': False} -> None"),
    ({"most_common": {"cost": 0}}, HALL, "visit.json differ: most_common None -> {'cost': 0}"),
    ({"share": 0.5}, {"goals": {"hall": [1, 3], "lift": [0, 0]}, "margin": 0.1},
     "other parameters: goals.hall [1, 2] -> [1, 3], goals.lift None -> [0, 0]"),
    ({"goals": {**FIGURES["goals"], "a\nb": True}}, HALL,
     "visit.json differ: goals.a\\nb None -> True"),
])  # fmt: skip
def test_differences_of_a_stage_are_given_in_words(tmp_path, figures, parameters, message):
    for place, found, values in (("gold", FIGURES, HALL), ("out", FIGURES | figures, parameters)):
        folder = tmp_path / place / "m"
        folder.mkdir(parents=True)
        outputs = {"visit.json": str(sorted(found.items())), "visit.png": place}
        document = {"stages": [{"visit": values}], "figures": {"visit": found}, "outputs": outputs}
        (folder / "manifest.json").write_text(json.dumps(document))
    lines = differences_from_golden(tmp_path / "out" / "m", tmp_path / "gold")
    assert lines == ([] if message is None else [f"m: visit: {message}"])


def test_changes_are_counted_and_named_by_their_place():
    goals = {f"room {k}": True for k in range(5)}
    (change, *_) = changes_between({"goals": goals}, {"goals": dict.fromkeys(goals, False)})
    assert change == "room 0, room 1, room 2 and 2 more no longer reachable"
    deep, later = ({"a": {"b": {"c": {"d": {"e": k}}}}} for k in (1, 2))
    assert changes_between(deep, later) == ["a.b.c.d {'e': 1} -> {'e': 2}"]
