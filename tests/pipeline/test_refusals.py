"""What recipes, runs and lint do not take on the command line: the option, and what is said."""

import json

import pytest

import made_up_stages
from mapdeal import Footprint, ParameterError, load_recipe, write_map
from pipeline.reported import rooms_grid

LIKE = "must look like stage.parameter=value"


@pytest.mark.parametrize(("name", "setting", "told", "hint"), [
    ("default", "radius=0.3", LIKE, "did you mean inflate.radius?"),
    ("default", "inflate.radius", LIKE, None),
    ("default", "inflat.radius=1", "no such stage", "did you mean inflate?"),
    ("default", "active.margin=1", "no stage active", None),
    ("default", "inflate.radios=1", "--set: inflate.radios: no such parameter", None),
    ("default", "inflate.radius=-1", "--set: inflate.radius: must be", None),
    ("default", "inflate.inflate_unknown=maybe", "yes or no", None),
    ("default", "esdf.lethal_threshold=101", "between 1 and 100", None),
    ("default", "cost.inscribed_radis=1", "inscribed_radis: no such", "inscribed_radius"),
    ("default", "cost.values=1", "is a parameter of model rings, not of exponential", None),
    ("nav2", "inflation_radius=1", LIKE, "did you mean cost.inflation_radius?"),
    ("nav2", "inflation-radius = 1", LIKE, "did you mean cost.inflation_radius?"),
    ("nav2", "lethal_threshold=60", LIKE,
     "did you mean esdf.lethal_threshold or cost.lethal_threshold?"),
    ("nav2", "nothing=1", LIKE, ""),
])  # fmt: skip
def test_settings(command, tmp_path, name, setting, told, hint):
    write_map(tmp_path / "m.yaml", rooms_grid())
    words = ["-o", tmp_path / "out", "--recipe", name, "--set", setting]
    code, out, err = command("run", tmp_path / "m.yaml", *words)
    assert (code, out) == (2, "")
    assert told in err
    assert hint is None or hint in err
    assert hint != "" or "hint:" not in err


@pytest.mark.parametrize("words", [
    ("--golden", "nowhere", 4, "no golden run"),
    ("--golden", "bad", 3, "not the manifest"),
    ("--update-golden", 2, "--golden"),
])  # fmt: skip
def test_golden_runs_f18(command, tmp_path, monkeypatch, words):
    *options, code, told = words
    monkeypatch.chdir(tmp_path)
    write_map("m.yaml", rooms_grid())
    (tmp_path / "bad" / "m").mkdir(parents=True)
    (tmp_path / "bad" / "m" / "manifest.json").write_text(json.dumps([]))
    found, _, err = command("run", "m.yaml", "-o", "new", *options)
    assert (found, told in err) == (code, True)


def test_a_shape_that_nothing_takes(tmp_path, monkeypatch):
    made_up_stages.list_visit(monkeypatch)
    (tmp_path / "r.yaml").write_text("stages:\n  - esdf\n")
    with pytest.raises(ParameterError, match="no stage that uses a robot's shape"):
        load_recipe(str(tmp_path / "r.yaml"), footprint=Footprint.circle(0.2))


@pytest.mark.parametrize(("words", "told"), [
    (["--in-place"], "--in-place: needs --fix"),
    (["--fix"], "--fix: needs -o OUT or --in-place"),
    (["--fix", "--in-place", "-o", "x.yaml"], "--in-place: cannot be given together with -o"),
    (["-o", "x.yaml"], "--output: needs --fix"),
    (["m.yaml", "n.yaml", "--fix", "-o", "x.yaml"], "-o: takes one map, got 2"),
])  # fmt: skip
def test_repairs(command, tmp_path, monkeypatch, words, told):
    monkeypatch.chdir(tmp_path)
    write_map("m.yaml", rooms_grid())
    before = sorted(tmp_path.iterdir())
    code, _, err = command("lint", "m.yaml", *words)
    assert (code, err.splitlines()[0]) == (2, f"error: {told}")
    assert sorted(tmp_path.iterdir()) == before
