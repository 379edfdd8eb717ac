import errno
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import mapdeal
from mapdeal import FileAccessError, MalformedInputError
from mapdeal.checks.findings import Selections
from mapdeal.checks.lint import lint_file
from mapdeal.checks.map_checks import RUN_FOLDERS
from mapdeal.commands.lint import _Lint
from mapdeal.files.source import SHARE_OF_JOB, contents_of as real_contents_of
from mapdeal.maps.listing import list_maps
from mapdeal.pipeline.settings import Settings
from pipeline.here import HereWorkers, die_of
from pipeline.reported import write_cells

PLAIN, BROKEN, TURNED = "maps/a/plain.yaml", "maps/b/broken.yaml", "maps/b/turned.yaml"


def lint(paths, **options):
    """Lint by no rules of a file, unless one is named."""
    return mapdeal.lint(paths, **{"config": False, **options})


def make_map(path, yaw=0.0, side=12):
    cells = np.zeros((side, side + 3), np.int8)
    cells[0] = cells[-1] = cells[:, 0] = cells[:, -1] = 100
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    write_cells(path, cells, origin=(1.0, -2.0, yaw))


@pytest.fixture
def maps(here):
    """Three maps in two folders, of which one is turned and one broken, and other YAML files."""
    make_map(PLAIN)
    make_map(TURNED, yaw=0.4)
    Path(BROKEN).write_text("image: none.pgm\nresolution: 1\norigin: [0, 0, 0]\n")
    Path("maps/params.yaml").write_text("amcl:\n  x: 1\n")
    return Path("maps")


def listed(*names):
    found = list_maps(names, None, lambda: (), exempt=RUN_FOLDERS)
    return [str(entry.path) for entry in found.maps]


def checks_of(report):
    return {part.file: [found.check for found in part.findings] for part in report.maps}


def test_a_folder_stands_for_its_maps_and_runs_and_not_for_what_runs_have_written(maps):
    for name in ("r2", "r10", "r2/local", "r2/below"):
        (maps / "runs" / name).mkdir(parents=True)
        (maps / "runs" / name / "manifest.json").write_text('{"outputs": {"gone.pgm": "00"}}')
        (maps / "runs" / name / "inflated.yaml").write_text("image: a.pgm\n")
    (maps / "runs" / "summary.json").write_text("{}")
    of_runs = ["maps/runs/r2", "maps/runs/r2/below", "maps/runs/r10"]
    assert listed("maps") == [PLAIN, BROKEN, TURNED, *of_runs]
    assert listed("maps/runs") == listed("maps/runs/summary.json") == of_runs
    assert listed("maps/runs/r10") == listed("maps/runs/r10/manifest.json") == ["maps/runs/r10"]
    assert listed("maps/**/*.yaml", "maps/runs/r10")[:3] == [PLAIN, BROKEN, TURNED]
    assert checks_of(lint(maps / "runs/r10")) == {"maps/runs/r10": ["run.missing-file"]}


def test_a_manifest_of_another_program_hides_no_map(maps):
    for text in ('{"name": "a web page"}', "[]", "3"):
        (maps / "manifest.json").write_text(text)
        assert listed("maps") == [PLAIN, BROKEN, TURNED]
    (maps / "manifest.json").write_text("{damaged")
    assert "maps" in listed("maps")
    (finding,) = next(part for part in lint(maps).maps if part.file == "maps").findings
    assert finding.message == "its manifest.json is not that of a run"


def test_a_folder_without_maps_or_that_cannot_be_read_is_a_finding(maps, monkeypatch):
    def closed(folder):
        if folder.name == "b":
            raise FileAccessError("cannot be read: Permission denied", source=folder)
        return real_contents_of(folder)

    monkeypatch.setattr("mapdeal.files.source.contents_of", closed)
    assert (listed("maps"), listed("maps/b")) == ([PLAIN, "maps/b"], ["maps/b"])
    (maps / "empty").mkdir()
    report = lint(listed("maps/empty", "maps"))
    assert not report.passes
    messages = {(part.file, found.check): found.message for part in report.maps
                for found in part.findings}  # fmt: skip
    assert list(messages) == [("maps/empty", "run.no-manifest"), ("maps/b", "file.access")]
    assert "no map in it or below" in messages["maps/empty", "run.no-manifest"]
    assert messages["maps/b", "file.access"] == "cannot be read: Permission denied"


def test_a_map_has_the_rules_of_the_nearest_file(maps):
    (maps / "pyproject.toml").write_text("[tool.mapdeal.lint]\nstrict = true\n")
    (maps / "b" / "mapdeal.toml").write_text('[lint]\nignore = ["file"]\n')
    make_map("maps/a/turned.yaml", yaw=0.4)
    report = mapdeal.lint(listed("maps"))
    assert checks_of(report) == {
        PLAIN: [], "maps/a/turned.yaml": ["yaml.origin-yaw"],
        BROKEN: ["yaml.defaults"], TURNED: ["yaml.origin-yaw"],
    }  # fmt: skip
    assert [bool(part.failures) for part in report.maps] == [False, True, False, False]
    assert not report.passes
    assert mapdeal.lint(TURNED).passes


def test_comments_of_a_broken_map_count_too(maps):
    for path, text in (
        (BROKEN, "# mapdeal: ignore file.access, yaml.defaults\n"),
        (TURNED, "# mapdeal: ignore yaml, image.alpha the dock is turned\n"),
    ):
        Path(path).write_text(Path(path).read_text() + text)
    broken, turned = lint([BROKEN, TURNED]).maps
    assert (broken.findings, broken.suppressed, turned.suppressed) == ((), 2, 1)
    assert turned.findings == ()


@pytest.fixture
def many(maps, monkeypatch):
    for k in range(5):
        make_map(f"maps/many/{k}.yaml", yaw=k / 10, side=10 + k)
    monkeypatch.setattr("mapdeal.commands.lint._CELLS_WORTH_WORKERS", 0)
    return [Path(path) for path in listed("maps")]


@pytest.mark.slow
def test_the_report_is_the_same_with_any_number_of_processes(many):
    used, rules = [], Selections((), (), strict=False, config=True)
    alone, shared = (
        _Lint(rules, Settings(), None, jobs)(many, lambda *_, jobs=jobs: used.append(jobs))
        for jobs in (1, 2)
    )
    assert alone == shared  # and so are the messages about them
    assert [used.count(jobs) for jobs in (1, 2)] == [len(many)] * 2


@pytest.fixture
def workers(monkeypatch):
    """Workers in this process; return a dict that says by the name of a map what befalls them."""
    fates = {}
    fated = partial(HereWorkers, fates=fates)
    monkeypatch.setattr("mapdeal.pipeline.workers.ProcessWorkers", fated)
    return fates


def test_a_map_that_its_worker_dies_of_is_a_finding(many, workers):
    workers["3"] = die_of(BrokenProcessPool())
    report = lint(many, jobs=2)
    (found,) = next(part for part in report.maps if part.file == "maps/many/3.yaml").findings
    message = "the worker process died, and again with this map alone"
    assert (found.check, found.message) == ("lint.not-checked", message)
    alone = checks_of(lint(many))
    differ = [file for file, found in checks_of(report).items() if found != alone[file]]
    assert differ == ["maps/many/3.yaml"]
    assert not report.passes


@pytest.fixture
def met(monkeypatch):
    """Return a function that makes lint of some maps raise an error, and returns the calls."""

    def meet(name, problem):
        turns = []

        def lint_or_fail(path, **options):
            turns.append(path.name)
            if path.name == name and turns.count(name) == 1:
                raise problem
            return lint_file(path, **options)

        monkeypatch.setattr("mapdeal.checks.lint.lint_file", lint_or_fail)
        return turns

    return meet


def test_a_map_that_only_its_share_of_memory_refuses_is_checked_alone(many, workers, met):
    turns = met("2.yaml", MalformedInputError(f"needs too much{SHARE_OF_JOB}", source="2.yaml"))
    assert checks_of(lint(many, jobs=2))["maps/many/2.yaml"] == ["yaml.origin-yaw"]
    assert turns.count("2.yaml") == 2


@pytest.mark.parametrize(("problem", "message"), [
    (ZeroDivisionError("of mine"), "internal error: ZeroDivisionError: of mine; this is a bug"),
    (MemoryError(), "not enough memory for a map of this size"),
    (OSError(errno.ENOMEM, "Cannot"), "a system resource is exhausted: Cannot"),
])  # fmt: skip
def test_a_bug_met_by_one_map_is_a_finding_of_it(maps, met, problem, message):
    met("plain.yaml", problem)
    report = lint(listed("maps"))
    (found,) = report.maps[0].findings
    assert (found.check, found.severity) == ("lint.not-checked", "error")
    assert found.message.startswith(message)
    assert len(report.maps) == 3
