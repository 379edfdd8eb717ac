import json

import pytest

from mapdeal import Footprint, ParameterError, load_recipe, write_map
from mapdeal.stages.catalogue import STAGES
from pipeline.reported import rooms_grid

MARK = "# here"
"""The line at fault ends with it; it is a comment to YAML."""

WRONG = [
    ("# a recipe\nsteps: # here\n  - esdf\n", "no such key"),
    *[(f"{text} # here\n", "a list of stages") for text in ("# a\n\nstages: esdf", "stages: []")],
    ("stages:\n  - esdf\n  - inflat: # here\n", "no such stage"),
    ("stages:\n  - esdf\n  - esdf: # here\n", "esdf: a stage can run once"),
    ("stages:\n  - cost\n  - esdf # here\n", "esdf: cannot follow cost"),
    *[(f"stages:\n  - esdf\n  - {text}# here\n", "must look like") for text in ("inflate: 3 ", "")],
    *[(f"stages:\n{text} # here\n", "not valid YAML")
      for text in ("  - inflate: {radius: 1]}", "\t- inflate")],
    ("stages:\n  - inflate: &a\n      radius: 0.3 # here\n  - esdf:\n      <<: *a\n",
     "esdf.radius: no such parameter"),
    *[(f"stages:\n  - active\n  - {stage}:\n      {line} # here\n", rule) for stage, line, rule in [
        ("inflate", "kernel: disc\n      radios: 1", "inflate.radios: no such parameter"),
        ("cost", "model: rings\n      down: 4", "cost.down: is a parameter of model"),
        ("cost", "model: rings\n      values: [80, -5]", "cost.values: "),
        ("cost", "model: threshold\n      down_distance: 1.0\n      down: 3",
         "cannot be given together"),
        ("inflate", "radius: wide", "inflate.radius: must be a finite number"),
        ("inflate", "radius: -1", "inflate.radius: must be a finite number, at least 0, got -1"),
        ("inflate", "kernel: round", "inflate.kernel: must be one of"),
        ("cost", "model: ring", "cost.model: no such cost model"),
        ("inflate", "inflate_unknown: maybe", "must be yes or no"),
        ("inflate", "footprint: {radius: 0}", "inflate.footprint.radius: must be"),
        ("inflate", "footprint: {width: 1}", "look like"),
        ("inflate", "footprint: {radius: 0.3}\n      radius: 0.4",
         "inflate.radius: cannot be given together"),
        ("inflate", "radius: !!python/none 1", "tag not allowed"),
        ("inflate", "radius: 010", "must be a decimal number"),
        ("esdf", "strength: 1_0", "must be a decimal number"),
    ]],
    # each parameter of each stage has its line
    *[(f"stages:\n\n  - {stage.name}:\n" + f"      model: {stage.model}\n" * bool(stage.model)
       + f"      {name}: [[a, b], {{}}] # here\n", f"{stage.name}.{name}")
      for stage in STAGES for name in stage.parameters],
]  # fmt: skip


@pytest.mark.parametrize(("text", "rule"), WRONG)
def test_the_line_of_a_recipe_that_is_wrong_is_named(tmp_path, text, rule):
    (line,) = [k for k, row in enumerate(text.splitlines(), 1) if row.endswith(MARK)]
    path = tmp_path / "r.yaml"
    path.write_text(text)
    with pytest.raises(ParameterError) as caught:
        load_recipe(str(path))
    assert str(caught.value).startswith(f"{path}:{line}: ")
    assert rule in str(caught.value)


LIKE = "must look like stage.parameter=value"


@pytest.mark.parametrize(("name", "setting", "message", "hint"), [
    ("default", "radius=0.3", LIKE, "did you mean inflate.radius?"),
    ("default", "inflate.radius", LIKE, None), ("nav2", "nothing=1", LIKE, ""),
    ("default", "inflat.radius=1", "no such stage", "did you mean inflate?"),
    ("default", "esdf.lethal_threshold=101", "between 1 and 100", None),
    ("default", "cost.inscribed_radis=1", "inscribed_radis: no such", "inscribed_radius"),
    ("default", "cost.values=1", "is a parameter of model rings, not of exponential", None),
    ("r.yaml", "inflate.radius=-1", "error: --set: inflate.radius: must be", None),
    *[("nav2", setting, LIKE, "did you mean cost.inflation_radius?")
      for setting in ("inflation_radius=1", "inflation-radius = 1")],
    ("nav2", "lethal_threshold=60", LIKE,
     "did you mean esdf.lethal_threshold or cost.lethal_threshold?"),
])  # fmt: skip
def test_settings(command, here, name, setting, message, hint):
    code, out, err = command("run", "m.yaml", "-o", "out", "--recipe", name, "--set", setting)
    assert (code, out, message in err) == (2, "", True), err
    assert hint is None or hint in err
    assert hint != "" or "hint:" not in err


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A folder with a map, a recipe, and a folder that is not of a run."""
    monkeypatch.chdir(tmp_path)
    write_map("m.yaml", rooms_grid())
    (tmp_path / "r.yaml").write_text("stages:\n  - inflate:\n      radius: 0.3\n  - esdf\n")
    (tmp_path / "bad" / "m").mkdir(parents=True)
    (tmp_path / "bad" / "m" / "manifest.json").write_text(json.dumps([]))
    return tmp_path


@pytest.mark.parametrize(("words", "code", "message"), [
    ("run m.yaml -o new --golden nowhere", 4, "no golden run"),
    ("run m.yaml -o new --golden bad", 3, "not the manifest"),
    ("run m.yaml -o new --update-golden", 2, "--golden"),
    ("lint m.yaml --in-place", 2, "--in-place: needs --fix"),
    ("lint m.yaml --fix", 2, "--fix: needs -o OUT or --in-place"),
    ("lint m.yaml --fix --in-place -o x.yaml", 2, "--in-place: cannot be given together with -o"),
    ("lint m.yaml -o x.yaml", 2, "--output: needs --fix"),
    ("lint m.yaml n.yaml --fix -o x.yaml", 2, "-o: takes one map, got 2"),
])  # fmt: skip
def test_options(command, here, words, code, message):
    before = sorted(here.iterdir())
    found, _, err = command(*words.split())
    assert (found, message in err.splitlines()[0], err[:7]) == (code, True, "error: "), err
    assert "lint" not in words or sorted(here.iterdir()) == before


def test_a_shape_that_nothing_takes(here):
    (here / "r.yaml").write_text("stages:\n  - esdf\n")
    with pytest.raises(ParameterError, match="no stage that uses a robot's shape"):
        load_recipe("r.yaml", footprint=Footprint.circle(0.2))
