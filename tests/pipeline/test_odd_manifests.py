"""Manifests that somebody has changed: not ours, or refused, and never the end of a command."""

import copy
import json

import pytest

from drawn import grid_from_text
from mapdeal import FileAccessError, MalformedInputError, write_map
from mapdeal.checks.lint import lint_file
from mapdeal.pipeline.folder import differences_from_golden
from mapdeal.pipeline.recipe import load_recipe
from mapdeal.pipeline.run import run_map
from mapdeal.pipeline.settings import Settings

ODD = [{}, [], 5, None, True, "x", "\ud800", [{}], {"x": {}}]
SETTINGS = Settings(images=False)

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("mapdeal_warnings")]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A map m.yaml, its run out/m, and a golden run gold/m."""
    monkeypatch.chdir(tmp_path)
    write_map("m.yaml", grid_from_text("\n".join(["#......."] * 8), 0.1))
    for name in ("out", "gold"):
        run_map(tmp_path / "m.yaml", tmp_path / name / "m", load_recipe("default"), SETTINGS)
    return tmp_path


def changed(document):
    """Yield copies of a JSON document with each part replaced by odd ones, or left out."""
    for number, path in enumerate(paths_in(document)):
        # nobody looks at single parameters and figures one by one: each gets two of the odd ones
        odds = ODD if len(path) < 3 else [ODD[number % len(ODD)], ODD[(number + 4) % len(ODD)]]
        for odd in odds:
            yield path, odd, with_part(document, path, odd)
        if path:
            yield path, "left out", with_part(document, path, leave_out=True)


def paths_in(value, path=()):
    yield path
    for key in (
        value if isinstance(value, dict) else range(len(value) if type(value) is list else 0)
    ):
        yield from paths_in(value[key], (*path, key))


def with_part(document, path, odd=None, *, leave_out=False):
    if not path:
        return odd
    result = copy.deepcopy(document)
    parent = result
    for key in path[:-1]:
        parent = parent[key]
    if leave_out:
        del parent[path[-1]]
    else:
        parent[path[-1]] = odd
    return result


@pytest.mark.thorough
def test_a_run_over_an_odd_manifest_is_done_already_or_not_ours(folder):
    path = folder / "out" / "m" / "manifest.json"
    document = json.loads(path.read_text())
    recipe = load_recipe("default")
    before = {one.name: one.read_bytes() for one in path.parent.iterdir()}
    for where, odd, manifest in changed(document):
        path.write_text(json.dumps(manifest))
        try:
            report = run_map(folder / "m.yaml", path.parent, recipe, SETTINGS)
        except FileAccessError as error:
            assert "exists" in str(error)
        else:
            assert report.status == "unchanged", (where, odd)
            assert manifest == document or where[0] in ("figures", "warnings")
            assert [*report.figures] == ["inflate", "esdf", "cost"]
            assert all(one["width"] > 0 < one["height"] for one in report.figures.values())
    path.write_bytes(before["manifest.json"])
    assert {one.name: one.read_bytes() for one in path.parent.iterdir()} == before


def test_lint_of_an_odd_manifest_has_findings_or_none(folder):
    path = folder / "out" / "m" / "manifest.json"
    document = json.loads(path.read_text())
    for where, odd, manifest in changed(document):
        path.write_text(json.dumps(manifest))
        findings = lint_file(path.parent)
        touches_outputs = where == () or where[0] == "outputs"
        is_less = odd == "left out" and len(where) == 2
        is_closed = where[-1:] == ("most_common",) and odd is None
        assert bool(findings) == (touches_outputs and not is_less) or is_closed, (where, odd)
        assert all(one.check.startswith("run.") for one in findings)


def test_an_odd_golden_manifest_is_refused_or_differs(folder):
    path = folder / "gold" / "m" / "manifest.json"
    document = json.loads(path.read_text())
    told = set()
    for where, odd, manifest in changed(document):
        path.write_text(json.dumps(manifest))
        try:
            lines = differences_from_golden(folder / "out" / "m", folder / "gold")
        except MalformedInputError as error:
            assert str(error) == f"{path}: is not the manifest of a run"
            told.add("refused")
        else:
            assert all(isinstance(line, str) for line in lines), (where, odd)
            told.add("differs" if lines else "equal")
    assert told == {"refused", "differs", "equal"}


@pytest.mark.thorough
def test_info_of_an_odd_manifest_tells_what_there_is_or_refuses(command, folder):
    path = folder / "out" / "m" / "manifest.json"
    document = json.loads(path.read_text())
    seen = set()
    for where, odd, manifest in changed(document):
        path.write_text(json.dumps(manifest))
        code, out, err = command("info", path.parent, path.parent / "cost.npz")
        assert code in (0, 3), (where, odd, err)
        if code == 3:
            assert err == f"error: {path}: is not the manifest of a run\n"
        seen.add((code, "made by" in out))
    assert seen == {(0, True), (0, False), (3, False)}


@pytest.mark.parametrize("text", [
    b'{"figures": {}, "outputs": {}, "stages": 5}',
    b"[" * 100_000,
    b"1" * 5000,
    b"NaN",
    b'{"x": 1e999}',
    b"\xff\xfe",
    b" " * (1 << 23),
], ids=['stages of 5', 'nested', 'a long number', 'nan', '1e999', 'no text', '8 MiB'])  # fmt: skip
def test_a_manifest_that_is_none_is_one_line_in_every_command(command, folder, text):
    for name in ("out", "gold"):
        (folder / name / "m" / "manifest.json").write_bytes(text)
    words = ["run", "m.yaml", "--no-images"]
    for more, expected in (
        (["-o", "new", "--golden", "gold"], 3),
        (["-o", "out"], 4),
        (["-o", "out", "--dry-run"], 4),
    ):
        code, _, err = command(*words, *more)
        assert code == expected, err
        assert len([line for line in err.splitlines() if line.startswith("error: ")]) == 1
        assert "internal" not in err
    told = "error: out/m/manifest.json: is not the manifest of a run\n"
    assert command("info", "out/m")[::2] == (3, told)
    code, out, err = command("lint", "out/m")
    assert (code, err) == (1, "")
    assert "run.no-manifest" in out


def test_figures_and_outputs_that_are_gone_are_not_taken_for_done(command, folder):
    path = folder / "out" / "m" / "manifest.json"
    document = json.loads(path.read_text())
    write_map("n.yaml", grid_from_text("#######\n#.....#\n#.....#\n#######", 0.5))
    for key in ("figures", "outputs"):
        path.write_text(json.dumps({**document, key: {}}))
        for words in (["m.yaml"], ["m.yaml", "n.yaml"]):
            code, out, err = command("run", *words, "-o", "out", "--no-images")
            assert code == (4 if len(words) == 1 else 5), err
            assert "exists" in err + out
        (folder / "out" / "summary.json").unlink()
