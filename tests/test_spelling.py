"""Words that are spelled in another way than they are known."""

import json
from pathlib import Path

import numpy as np
import pytest

from drawn import grid_from_text
from mapdeal import (
    DistanceField,
    OccupancyGrid,
    esdf,
    field_view,
    read_map,
    threshold_cost,
    write_map,
)
from mapdeal.spelling import BRITISH_AND_AMERICAN, as_known, meant, nearest
from mapdeal.stages.catalogue import STAGES


@pytest.mark.parametrize(("british", "american"), BRITISH_AND_AMERICAN)
def test_either_spelling_stands_for_the_one_that_is_known(british, american):
    assert as_known(british, ["other", american]) == american
    assert as_known(american, ["other", british]) == british
    assert as_known(f"--to-{british}s", [f"--to-{american}s"]) == f"--to-{american}s"


@pytest.mark.parametrize(
    ("word", "known", "expected"),
    [
        ("rnu", ["run", "route", "lint"], "run"),
        ("esfd", ["esdf", "edit"], "esdf"),
        ("NAV2", ["nav2", "ros1"], "nav2"),
        ("lethal_treshold", ["--lethal-threshold", "--image"], "--lethal-threshold"),
        ("centr", ["fast-planner", "center", "border"], "center"),
        ("zzzz", ["run", "route"], None),
        ("real", ["default", "nav2", "design-real", "arena"], None),
        ("nflate", ["esdf", "inflate"], "inflate"),
        ("exp", ["exponential", "threshold", "rings"], "exponential"),
        ("seed", ["design-real-map", "design-sim-world"], None),
        ("ex", ["exponential", "threshold"], None),
        ("", ["run"], None),
        ("run", [], None),
    ],
)
def test_the_nearest_known_word(word, known, expected):
    assert nearest(word, known) == expected
    assert meant(word, known) == (f"did you mean {expected}?" if expected else None)


@pytest.mark.parametrize("name", ["convention", "view"])
def test_former_names_of_choices_are_accepted_everywhere(name, command, tmp_path, monkeypatch):
    new = {"convention": "fast-planner", "view": "per-map"}[name]
    monkeypatch.chdir(tmp_path)
    write_map("m.yaml", OccupancyGrid([[0, 0, 100], [0, -1, 0]], 0.25, (1.5, -2.0, 0.4)))
    Path("r.yaml").write_text(f"stages: [esdf: {{{name}: seed}}]\n")
    for words in (["esdf", "m.yaml", "-o", "a.npz", f"--{name}", "seed"],
                  ["esdf", "m.yaml", "-o", "b.npz", f"--{name}", new],
                  ["esdf", "m.yaml", "-o", "a.yaml", f"--{name}", "seed"],
                  ["esdf", "m.yaml", "-o", "b.yaml", f"--{name}", new],
                  ["run", "m.yaml", "-o", "set", "--set", f"esdf.{name}=seed"],
                  ["run", "m.yaml", "-o", "recipe", "--recipe", "r.yaml"]):  # fmt: skip
        assert command(*words)[0] == 0
    assert Path("a.npz").read_bytes() == Path("b.npz").read_bytes()
    assert Path("a.pgm").read_bytes() == Path("b.pgm").read_bytes()
    for folder in ("set", "recipe"):
        manifest = json.loads(Path(folder, "m", "manifest.json").read_text())
        (step,) = (one["esdf"] for one in manifest["stages"] if "esdf" in one)
        assert step[name] == new


def test_former_names_are_accepted_in_python():
    grid = grid_from_text("..#\n...")
    field = esdf(grid, convention="seed")
    assert field.convention == "fast-planner"
    assert DistanceField(field.distance, field.occupancy, 1.0, convention="seed").convention == (
        "fast-planner"
    )
    views = [field_view(field, view=name) for name in ("seed", "per-map")]
    assert (views[0].occupancy == views[1].occupancy).all()
    assert views[0].scale == views[1].scale
    costs = [threshold_cost(field, view=name, down=5, up=9) for name in ("seed", "per-map")]
    assert (costs[0].cost == costs[1].cost).all()


@pytest.mark.parametrize("kind", ["real", "sim", "local"])
def test_former_names_of_recipes_are_accepted(kind, command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_map("m.yaml", OccupancyGrid([[0, 0, 100], [0, -1, 0]], 0.25, (1.5, -2.0, 0.4)))
    manifests = []
    for name in (f"seed-{kind}", f"design-{kind}"):
        assert command("run", "m.yaml", "-o", name, "--recipe", name)[0] == 0
        manifests.append(Path(name, "m", "manifest.json").read_bytes())
    assert manifests[0] == manifests[1]


def test_files_have_the_names_of_today_and_are_read_with_former_ones(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    field = esdf(grid_from_text("..#\n..."))
    view = field_view(field, view="per-map")
    for grid, key, name in ((field, "convention", "fast-planner"), (view, "view", "per-map")):
        write_map("new.npz", grid, force=True)
        with np.load("new.npz") as file:
            arrays = dict(file)
        assert str(arrays[key]) == name
        np.savez("old.npz", **(arrays | {key: "seed"}))
        for file_name in ("new.npz", "old.npz"):
            back = read_map(file_name)
            assert getattr(getattr(back, "scale", back), key) == name


def test_a_word_that_is_known_or_like_none_stays():
    assert as_known("center", ["centre", "center"]) == "center"
    assert as_known("cent", ["center"]) == "cent"


def test_every_choice_of_every_stage_is_known_by_its_other_spelling():
    tried = set()
    for stage in STAGES:
        for parameter in stage.parameters.values():
            for choice in parameter.choices:
                for british, american in BRITISH_AND_AMERICAN:
                    for one, other in ((british, american), (american, british)):
                        if one in choice:
                            tried.add(choice)
                            assert parameter.accept(choice.replace(one, other)) == choice
    assert {"center", "disc"} <= tried  # else the test has gone blind


def test_python_callers_may_spell_as_they_like():
    grid = grid_from_text("..#\n...")
    made, known = esdf(grid, convention="centre"), esdf(grid, convention="center")
    assert isinstance(made, DistanceField)
    assert made.convention == known.convention == "center"
    assert (made.distance == known.distance).all()
