"""Documents of ours with parts that are empty, null or gone: read or refused in one line."""

import contextlib
import io
import json
import shutil
import warnings
from pathlib import Path

import pytest

from drawn import grid_from_text
from mapdeal import write_map
from mapdeal.cli.main import main
from pipeline.test_odd_manifests import paths_in, with_part

pytestmark = pytest.mark.slow

ROBOTS = Path("examples/robots").resolve()
LOG = Path("examples/logs/office.log").resolve()
ROOMS = """
    ##################
    #.......#........#
    #.......#........#
    #................#
    #.......#....??..#
    ##################
"""
AB, SHOWN = ("a.yaml", "b.yaml"), ("--force", "-o", "page.html")
MERGED = ("merge", *AB, "-o", "m.yaml", "--force", "--by")
MADE = {
    "lint.json": ("lint", *AB, "--format", "json"),
    "params.json": ("lint", "--params-file", ROBOTS / "nav2_params.yaml", "--format", "json"),
    "mistakes.json": (
        "lint", "a.yaml", "--params-file", ROBOTS / "five_mistakes.yaml", "--format", "json"
    ),
    "reach.json": (
        "reach", "a.yaml", "--from", "2,-1.5", "--to", "lab=4.125,-1.125", "--robot-radius", 0.3
    ),
    "route.json": ("route", "a.yaml", "--from", "2,-1.5", "--to", "4.2,-1"),
    "diff.json": ("diff", *AB, "--json"),
    "align.json": ("align", *AB, "--json"),
    "merge.json": ("merge", *AB, "-o", "m.yaml", "--force", "--json"),
    "score.json": ("score", "a.yaml", "--truth", "b.yaml", "--min", "coverage=0.5", "--json"),
    "clean.json": ("clean", "a.yaml", "-o", "m.yaml", "--force", "--json"),
    "info.json": ("info", "a.yaml", "--json"),
    "query.json": ("query", "a.yaml", "--at", "2,-1.5"),
    "batch/summary.json": ("run", *AB, "-o", "batch", "--no-images", "--jobs", 1),
    "batch/a/manifest.json": ("info", "batch/a"),
    "methods/comparison.json": ("build", LOG, "-o", "methods", "--compare", "--resolution", 0.4),
}  # fmt: skip
"""What writes each document, to a file or to standard output."""

READ = {
    "align.json": [MERGED, ("score", "a.yaml", "--truth", "b.yaml", "--transform")],
    "query.json": [("query", "a.yaml", "--points"), ("route", "a.yaml", "--pairs")],
    "batch/summary.json": [("lint", "batch"), ("report", "batch", *SHOWN)],
    "batch/a/manifest.json": [
        ("lint", "batch/a"), ("info", "batch/a/esdf.npz"), ("report", "batch", *SHOWN),
        ("run", "a.yaml", "-o", "batch", "--dry-run"),
        ("run", "b.yaml", "-o", "other", "--force", "--no-images", "--golden", "batch"),
    ],
    "methods/comparison.json": [("report", "methods", *SHOWN)],
}  # fmt: skip
"""What reads a document besides report and info."""

EMPTY = [None, {}, [], 0, "", [{}], [[]], {"": None}]


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A folder with all documents."""
    grid = grid_from_text(ROOMS, origin=(1.5, -2.0, 0.0))
    cells = grid.occupancy.copy()
    cells[2, 11:13] = 100
    with contextlib.chdir(tmp_path_factory.mktemp("documents")):
        write_map("a.yaml", grid)
        write_map("b.yaml", type(grid)(cells, grid.resolution, grid.origin))
        for name, words in MADE.items():
            with contextlib.redirect_stdout(io.StringIO()) as out, warnings.catch_warnings():
                main([str(word) for word in words])
            if not Path(name).exists():
                Path(name).write_text(out.getvalue())
        return Path.cwd()


@pytest.fixture
def documents(written, tmp_path, monkeypatch):
    shutil.copytree(written, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return {name: json.loads(Path(name).read_text()) for name in MADE}


def emptied(value, empty):
    """Return a document with each value that a function knows replaced."""
    value = empty(value)
    if isinstance(value, dict):
        return {key: emptied(one, empty) for key, one in value.items()}
    return [emptied(one, empty) for one in value] if isinstance(value, list) else value


WHOLE = {
    "lists": lambda value: [] if isinstance(value, list) else value,
    "numbers": lambda value: 0 if isinstance(value, int | float) else value,
    "texts": lambda value: "" if isinstance(value, str) else value,
    "nulls": lambda value: None if isinstance(value, int | float | str | bool) else value,
}


def without(document, places):
    """Yield a document with each of some parts empty in one way, and left out."""
    for number, path in enumerate(places):
        yield with_part(document, path, EMPTY[number % len(EMPTY)])
        if path:
            yield with_part(document, path, leave_out=True)


def check(command, name, document, *, info=True, thorough=False):
    """Give a document to all that reads it; each ends with a line, and never as a bug of ours."""
    before = Path(name).read_bytes()
    Path(name).write_text(json.dumps(document))
    words = [("report", "a.yaml", name, *SHOWN)]
    words += [("info", name)] * (info or thorough) + [("report", name, *SHOWN)] * thorough
    for one in (*words, *(one if "." in one[-1] else (*one, name) for one in READ.get(name, []))):
        code, _, err = command(*one)
        assert code in (0, 1, 2, 3, 4, 5), (one, document, err)
        assert "Traceback" not in err
        assert code == 5 or sum(line.startswith("error: ") for line in err.splitlines()) <= 1, err
    Path(name).write_bytes(before)


def test_documents_of_which_all_of_a_kind_is_empty(command, documents):
    for name, document in documents.items():
        check(command, name, document, thorough=True)
        for empty in WHOLE.values():
            check(command, name, emptied(document, empty))


def test_documents_without_a_part(command, documents):
    for name, document in documents.items():
        places = [path for path in paths_in(document) if len(path) < 2]
        for number, changed in enumerate(without(document, places)):
            check(command, name, changed, info=number % 3 == 0)


@pytest.mark.thorough
@pytest.mark.parametrize("name", MADE)
def test_documents_with_any_part_empty(command, documents, name):
    document = documents[name]
    for shift in (0, 3):
        places = list(paths_in(document))
        for changed in without(document, [()] * shift + places):
            check(command, name, changed, thorough=True)
