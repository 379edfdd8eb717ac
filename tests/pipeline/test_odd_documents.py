"""Documents of ours that anybody may have changed: read, or refused in one line."""

import contextlib
import copy
import io
import json
import shutil
import warnings
from pathlib import Path

import pytest

import mapdeal
from drawn import grid_from_text
from mapdeal import FileAccessError, MapdealError, exponential_cost, read_map, write_map
from mapdeal.checks.lint import lint_file
from mapdeal.cli.main import main
from mapdeal.commands.report import gathered
from mapdeal.commands.report_entries import Grids
from mapdeal.pipeline.folder import differences_from_golden
from mapdeal.pipeline.recipe import load_recipe
from mapdeal.pipeline.run import run_map
from mapdeal.pipeline.settings import DEFAULT_SETTINGS, Settings
from mapdeal.report.page import page_of

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("mapdeal_warnings")]

ROBOTS = Path("examples/robots").resolve()
ROOMS = """
    ##################
    #.......#........#
    #.......#........#
    #................#
    #.......#....??..#
    ##################
"""
COMMANDS = {
    "lint.json": "lint a.yaml b.yaml --format json",
    "params.json": "lint --params-file ROBOTS/nav2_params.yaml --format json",
    "mistakes.json": "lint a.yaml --params-file ROBOTS/five_mistakes.yaml --format json",
    "reach.json": "reach a.yaml --from 2,-1.5 --to lab=4.125,-1.125 --robot-radius 0.3",
    "route.json": "route a.yaml --from 2,-1.5 --to 4.2,-1",
    "plan.json": ("plan a.yaml --params-file ROBOTS/nav2_narrow_door.yaml --from 2,-1.5 "
                  "--to near=2.3,-1.2 5.2,-1.4"),
    "diff.json": "diff a.yaml b.yaml --json",
    "cost_diff.json": "diff a.npz b.npz --json",
    "robot_diff.json": ("diff a.yaml --params-file ROBOTS/nav2_params.yaml "
                        "--against ROBOTS/nav2_params.yaml --to 4,-1 --json"),
    "align.json": "align a.yaml b.yaml --json",
    "merge.json": "merge a.yaml b.yaml -o m.yaml --force --json",
    "score.json": "score a.yaml --truth b.yaml --min coverage=0.5 --json",
    "clean.json": "clean a.yaml -o m.yaml --force --json",
    "info.json": "info a.yaml --json",
    "query.json": "query a.yaml --at 2,-1.5",
    "batch/summary.json": "run a.yaml b.yaml -o batch --no-images --jobs 1",
    "batch/a/manifest.json": "info batch/a",
    "methods/comparison.json": "build ROBOTS/../logs/office.log -o methods --compare "
                               "--resolution 0.4",
}  # fmt: skip
"""What writes each document, to a file or to standard output."""

READ = {
    "align.json": ["merge a.yaml b.yaml -o m.yaml --force --by align.json",
                   "score a.yaml --truth b.yaml --transform align.json"],
    "query.json": ["query a.yaml --points query.json", "route a.yaml --pairs query.json"],
    "batch/summary.json": ["lint batch"],
    "batch/a/manifest.json": ["info batch/a/esdf.npz", "run a.yaml -o batch --dry-run"],
}  # fmt: skip
"""What reads a document besides report and info; tests below have lint, run and --golden."""

EMPTY = [None, {}, [], 0, "", [{}], [[]], {"": None}]
ODD = [{}, [], 5, None, True, "x", "\ud800", [{}], {"x": {}}]
SETTINGS = Settings(images=False)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    grid = grid_from_text(ROOMS, origin=(1.5, -2.0, 0.0))
    cells = grid.occupancy.copy()
    cells[2, 11:13] = 100
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("documents"))
        write_map("a.yaml", grid)
        write_map("b.yaml", type(grid)(cells, grid.resolution, grid.origin))
        for name in ("a", "b"):
            write_map(f"{name}.npz", exponential_cost(read_map(f"{name}.yaml")))
        for name, words in COMMANDS.items():
            with contextlib.redirect_stdout(io.StringIO()) as out, warnings.catch_warnings():
                main([word.replace("ROBOTS", str(ROBOTS)) for word in words.split()])
            if not Path(name).exists():
                Path(name).write_text(out.getvalue())
        return Path.cwd()


@pytest.fixture
def documents(written, tmp_path, monkeypatch):
    shutil.copytree(written, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return {name: json.loads(Path(name).read_text()) for name in COMMANDS}


def paths_in(value, path=()):
    yield path
    if isinstance(value, dict | list):
        for key in value if isinstance(value, dict) else range(len(value)):
            yield from paths_in(value[key], (*path, key))


def with_part(document, path, odd=None, *, leave_out=False):
    if not path:
        return odd
    parent = result = copy.deepcopy(document)
    for key in path[:-1]:
        parent = parent[key]
    parent[path[-1]] = odd
    if leave_out:
        del parent[path[-1]]
    return result


def emptied(value, empty):
    """Return a document with each value that a function knows replaced."""
    value = empty(value)
    if isinstance(value, dict):
        return {key: emptied(part, empty) for key, part in value.items()}
    return [emptied(part, empty) for part in value] if isinstance(value, list) else value


CLEARED = [
    lambda value: [] if isinstance(value, list) else value,
    lambda value: 0 if isinstance(value, int | float) else value,
    lambda value: "" if isinstance(value, str) else value,
    lambda value: None if isinstance(value, int | float | str | bool) else value,
]


def without(document, places):
    for number, path in enumerate(places):
        yield with_part(document, path, EMPTY[number % len(EMPTY)])
        if path:
            yield with_part(document, path, leave_out=True)


@pytest.fixture
def check(command):
    """Return a function that gives a document to all its readers; none may fail as a bug."""

    def read(name, document, grids, *, info=True, alone=False):
        before = Path(name).read_bytes()
        Path(name).write_text(json.dumps(document))
        folder = [[name.split("/")[0]]] * ("/" in name)
        for sources in (["a.yaml", name], *[[name]] * alone, *folder):
            with contextlib.suppress(MapdealError):  # every other is a bug
                b"".join(page_of(gathered([*map(Path, sources)], grids), size=1 << 20))
        for words in (*[f"info {name}"] * info, *READ.get(name, [])):
            code, _, err = command(*words.split())
            assert code in (0, 1, 2, 3, 4, 5), (words, document, err)
            assert "Traceback" not in err
            errors = [line for line in err.splitlines() if line.startswith("error: ")]
            assert code == 5 or len(errors) <= 1, err
        Path(name).write_bytes(before)

    return read


def test_documents_of_which_all_of_a_kind_is_empty(check, documents):
    for name, document in documents.items():
        with Grids(DEFAULT_SETTINGS) as grids:
            check(name, document, grids, alone=True)
            for empty in CLEARED:
                check(name, emptied(document, empty), grids)


def test_documents_without_a_part(check, documents):
    for name, document in documents.items():
        places = [path for path in paths_in(document) if len(path) < 2][::6]
        with Grids(DEFAULT_SETTINGS) as grids:
            for number, changed in enumerate(without(document, places)):
                check(name, changed, grids, info=number % 3 == 0)


@pytest.mark.thorough
@pytest.mark.parametrize("name", COMMANDS)
def test_documents_with_any_part_empty(check, documents, name):
    document = documents[name]
    with Grids(DEFAULT_SETTINGS) as grids:
        for shift in (0, 3):
            for changed in without(document, [()] * shift + [*paths_in(document)]):
                check(name, changed, grids, alone=True)


every = pytest.mark.parametrize("every", [4, pytest.param(1, marks=pytest.mark.thorough)])


@pytest.fixture
def runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_map("m.yaml", grid_from_text("\n".join(["#......."] * 8), 0.1))
    for name in ("out", "gold"):
        run_map(tmp_path / "m.yaml", tmp_path / name / "m", load_recipe("default"), SETTINGS)
    return tmp_path


def odd_ones(path, every):
    document = json.loads(path.read_text())
    for number, where in enumerate([*paths_in(document)][::every]):
        # nobody looks at single parameters and figures one by one: each gets two of the odd ones
        odds = ODD if len(where) < 3 else [ODD[number % len(ODD)], ODD[(number + 4) % len(ODD)]]
        changed = [(odd, with_part(document, where, odd)) for odd in odds]
        if where:
            changed.append(("left out", with_part(document, where, leave_out=True)))
        for odd, manifest in changed:
            path.write_text(json.dumps(manifest))
            yield where, odd, manifest == document
    path.write_text(json.dumps(document))


def others(path):
    return {file.name: file.read_bytes() for file in path.parent.iterdir() if file != path}


@every
def test_a_run_over_an_odd_manifest_is_done_already_or_not_ours(runs, every):
    path, recipe = runs / "out/m/manifest.json", load_recipe("default")
    before = others(path)
    for where, odd, is_same in odd_ones(path, every):
        try:
            report = run_map(runs / "m.yaml", path.parent, recipe, SETTINGS)
        except FileAccessError as error:
            assert "exists" in str(error)
        else:
            assert report.status == "unchanged", (where, odd)
            assert is_same or where[0] in ("figures", "warnings")
            assert [*report.figures] == ["inflate", "esdf", "cost"]
            assert all(found["width"] > 0 < found["height"] for found in report.figures.values())
    assert others(path) == before


@every
def test_lint_of_an_odd_manifest_has_findings_or_none(runs, every):
    path = runs / "out/m/manifest.json"
    for where, odd, _ in odd_ones(path, every):
        findings = lint_file(path.parent)
        touches_outputs = where == () or where[0] == "outputs"
        is_less = odd == "left out" and len(where) == 2
        is_closed = where[-1:] == ("most_common",) and odd is None
        assert bool(findings) == (touches_outputs and not is_less) or is_closed, (where, odd)
        assert all(finding.check.startswith("run.") for finding in findings)


@every
def test_an_odd_golden_manifest_is_refused_or_differs(runs, every):
    path, outcomes = runs / "gold/m/manifest.json", set()
    for where, odd, _ in odd_ones(path, every):
        try:
            lines = differences_from_golden(runs / "out/m", runs / "gold")
        except mapdeal.MalformedInputError as error:
            assert str(error) == f"{path}: is not the manifest of a run"
            outcomes.add("refused")
        else:
            assert all(isinstance(line, str) for line in lines), (where, odd)
            outcomes.add("differs" if lines else "equal")
    assert outcomes == {"refused", "differs", "equal"}


@pytest.mark.parametrize("text", [
    b'{"figures": {}, "outputs": {}, "stages": 5}', b"[" * 100_000, b"1" * 5000, b"NaN",
    b'{"x": 1e999}', b"\xff\xfe", b" " * (1 << 23),
], ids=["stages of 5", "nested", "a long number", "nan", "1e999", "no text", "8 MiB"])  # fmt: skip
def test_a_malformed_manifest_is_one_line_in_every_command(command, runs, text):
    for name in ("out", "gold"):
        (runs / name / "m" / "manifest.json").write_bytes(text)
    for more, expected in (("new --golden gold", 3), ("out", 4), ("out --dry-run", 4)):
        code, _, err = command("run", "m.yaml", "--no-images", "-o", *more.split())
        assert code == expected, err
        assert len([line for line in err.splitlines() if line.startswith("error: ")]) == 1
        assert "internal" not in err
    line = "error: out/m/manifest.json: is not the manifest of a run\n"
    assert command("info", "out/m")[::2] == (3, line)
    code, out, err = command("lint", "out/m")
    assert (code, err, "run.no-manifest" in out) == (1, "", True)
