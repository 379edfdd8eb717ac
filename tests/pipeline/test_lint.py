"""Lint of many maps: what names stand for, which rules hold, and who does the work."""

import contextlib
import errno
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import numpy as np
import pytest

import mapdeal
from mapdeal import FileAccessError, MalformedInputError, OccupancyGrid, write_map
from mapdeal.checks.findings import Selections
from mapdeal.checks.lint import REPORTS, LintReport, lint_file
from mapdeal.checks.map_checks import RUN_FOLDERS
from mapdeal.commands.lint import _Lint
from mapdeal.files.source import SHARE_OF_JOB
from mapdeal.files.source import contents_of as real_contents_of
from mapdeal.inputs.listing import list_maps
from mapdeal.pipeline.settings import Settings

LINT_FILE = "mapdeal.checks.lint.lint_file"


def lint(paths, **options):
    """Lint by no rules of a file, unless one is named."""
    return mapdeal.lint(paths, **{"config": False, **options})


def make_map(path, yaw=0.0, side=12):
    cells = np.zeros((side, side + 3), np.int8)
    cells[0] = cells[-1] = cells[:, 0] = cells[:, -1] = 100
    path.parent.mkdir(parents=True, exist_ok=True)
    write_map(path, OccupancyGrid(cells, 0.25, (1.0, -2.0, yaw)), force=True)


@pytest.fixture
def maps(tmp_path, monkeypatch):
    """Three maps in two folders, of which one is turned and one broken, and other YAML files."""
    monkeypatch.chdir(tmp_path)
    make_map(Path("maps/a/plain.yaml"))
    make_map(Path("maps/b/turned.yaml"), yaw=0.4)
    Path("maps/b/broken.yaml").write_text("image: none.pgm\nresolution: 1\norigin: [0, 0, 0]\n")
    Path("maps/params.yaml").write_text("amcl:\n  x: 1\n")
    return tmp_path / "maps"


def listed(*names):
    found = list_maps(names, None, lambda: (), whole_folders=RUN_FOLDERS)
    return [str(one.path) for one in found.maps]


def checks_of(report):
    return {one.file: [found.check for found in one.findings] for one in report.maps}


def make_run(folder):
    folder.mkdir(parents=True)
    (folder / "manifest.json").write_text('{"outputs": {"gone.pgm": "00"}}')
    (folder / "inflated.yaml").write_text("image: a.pgm\n")


def test_a_folder_stands_for_its_maps_and_runs_and_not_for_what_runs_have_written(maps):
    make_run(maps / "runs" / "r2")
    make_run(maps / "runs" / "r10")
    make_run(maps / "runs" / "r2" / "local")
    make_run(maps / "runs" / "r2" / "below")
    (maps / "runs" / "summary.json").write_text("{}")
    of_maps = ["maps/a/plain.yaml", "maps/b/broken.yaml", "maps/b/turned.yaml"]
    of_runs = ["maps/runs/r2", "maps/runs/r2/below", "maps/runs/r10"]
    assert listed("maps") == of_maps + of_runs
    assert listed("maps/runs") == listed("maps/runs/summary.json") == of_runs
    assert listed("maps/runs/r10") == listed("maps/runs/r10/manifest.json") == ["maps/runs/r10"]
    assert listed("maps/**/*.yaml", "maps/runs/r10")[:3] == of_maps
    found = checks_of(lint([Path("maps/runs/r10")]))
    assert found == {"maps/runs/r10": ["run.missing-file"]}


def test_a_manifest_of_another_program_hides_no_map(maps):
    for text in ('{"name": "a web page"}', "[]", "3"):
        (maps / "manifest.json").write_text(text)
        assert listed("maps") == ["maps/a/plain.yaml", "maps/b/broken.yaml", "maps/b/turned.yaml"]
    (maps / "manifest.json").write_text("{damaged")
    assert "maps" in listed("maps")
    report = next(one for one in lint(maps).maps if one.file == str(maps))
    assert [one.message for one in report.findings] == ["its manifest.json is not that of a run"]


def test_a_folder_with_neither_is_a_finding_and_the_others_go_on(maps):
    (maps / "empty").mkdir()
    paths = listed("maps/empty", "maps/a")
    assert paths == ["maps/empty", "maps/a/plain.yaml"]
    report = lint(paths)
    assert checks_of(report) == {"maps/empty": ["run.no-manifest"], "maps/a/plain.yaml": []}
    assert not report.passes
    assert "no map in it or below" in report.maps[0].findings[0].message


def test_a_folder_that_cannot_be_read_is_a_finding_and_the_others_go_on(maps, monkeypatch):
    def closed(folder):
        if folder.name == "b":
            raise FileAccessError("cannot be read: Permission denied", source=folder)
        return real_contents_of(folder)

    monkeypatch.setattr("mapdeal.inputs.listing.contents_of", closed)
    monkeypatch.setattr("mapdeal.checks.map_checks.contents_of", closed)
    for name in ("maps", "maps/b"):
        paths = listed(name)
        assert paths == (["maps/a/plain.yaml"] if name == "maps" else []) + ["maps/b"]
        report = lint([Path("maps/b")])
        (found,) = report.maps[0].findings
        assert (found.check, found.message) == ("file.access", "cannot be read: Permission denied")


def test_a_map_has_the_rules_of_the_nearest_file(maps):
    (maps / "pyproject.toml").write_text("[tool.mapdeal.lint]\nstrict = true\n")
    (maps / "b" / "mapdeal.toml").write_text('[lint]\nignore = ["file"]\n')
    make_map(maps / "a" / "turned.yaml", yaw=0.4)
    report = mapdeal.lint(listed("maps"))
    assert checks_of(report) == {
        "maps/a/plain.yaml": [], "maps/a/turned.yaml": ["yaml.origin-yaw"],
        "maps/b/broken.yaml": ["yaml.defaults"], "maps/b/turned.yaml": ["yaml.origin-yaw"],
    }  # fmt: skip
    assert [bool(one.failures) for one in report.maps] == [False, True, False, False]
    assert not report.passes
    report = lint([maps / "b" / "broken.yaml"])
    assert "file.access" in [one.check for one in report.findings]


def test_one_file_can_hold_for_all(maps):
    Path("strict.toml").write_text("[lint]\nstrict = true\n")
    (maps / "mapdeal.toml").write_text("[lint]\nselect = []\n")
    turned = maps / "b" / "turned.yaml"
    assert not mapdeal.lint(turned, config="strict.toml").passes
    assert mapdeal.lint(turned).passes
    assert not mapdeal.lint(turned, strict=True, select="yaml").passes


def test_comments_of_a_broken_map_count_too(maps):
    path = maps / "b" / "broken.yaml"
    path.write_text(path.read_text() + "# mapdeal: ignore file.access, yaml.defaults\n")
    (report,) = lint([path]).maps
    assert (report.findings, report.suppressed) == ((), 2)
    path = maps / "b" / "turned.yaml"
    path.write_text(path.read_text() + "# mapdeal: ignore yaml, image.alpha the dock is turned\n")
    (report,) = lint([path]).maps
    assert [(one.check, one.line) for one in report.findings] == [("lint.unused-ignore", 8)]
    assert report.suppressed == 1


@pytest.fixture
def many(maps, monkeypatch):
    for k in range(5):
        make_map(maps / "many" / f"{k}.yaml", yaw=k / 10, side=10 + k)
    monkeypatch.setattr("mapdeal.commands.lint._CELLS_WORTH_WORKERS", 0)
    return [Path(one) for one in listed("maps")]


@pytest.mark.slow
def test_the_report_is_the_same_with_any_number_of_processes(many):
    done = []
    rules = Selections((), (), strict=False, config=True)
    reports = [
        _Lint(rules, Settings(), None, jobs)(many, lambda _, jobs=jobs: done.append(jobs))
        for jobs in (1, 2, 3)
    ]
    assert reports[0] == reports[1] == reports[2]
    for form in REPORTS:
        one, other = (LintReport(tuple(found), "1", form) for found in reports[::2])
        assert list(one.lines()) == list(other.lines())
    assert [done.count(jobs) for jobs in (1, 2, 3)] == [len(many)] * 3


@pytest.fixture
def workers(monkeypatch):
    """Workers in this process; return a dict that says by the name of a map what befalls them."""
    fates = {}

    class Workers:
        def __init__(self, size):
            self.size = size

        @contextlib.contextmanager
        def started(self, size, work):  # noqa: ARG002 - as the protocol has it
            def submit(job):
                future = Future()
                fate = fates.get(job.path.name, lambda: work(job))
                try:
                    future.set_result(fate())
                except Exception as error:  # noqa: BLE001 - as a pool does
                    future.set_exception(error)
                return future

            yield submit

    monkeypatch.setattr("mapdeal.pipeline.workers.ProcessWorkers", Workers)
    return fates


def test_a_map_that_its_worker_dies_of_is_a_finding(many, workers):
    def die():
        raise BrokenProcessPool

    workers["3.yaml"] = die
    report = lint(many, jobs=2)
    found = checks_of(report)
    assert found["maps/many/3.yaml"] == ["lint.not-checked"]
    message = next(one for one in report.findings if one.check == "lint.not-checked").message
    assert message == "the worker process died, and again with this map alone"
    alone = checks_of(lint(many))
    assert {file for file in found if found[file] != alone[file]} == {"maps/many/3.yaml"}
    assert not report.passes


def test_a_map_that_only_its_share_of_memory_refuses_is_checked_alone(many, workers, monkeypatch):
    before = []

    def refused(path, *, max_cells=None, radius=None):
        before.append(path.name)
        if before.count(path.name) == 1 and path.name == "2.yaml":
            raise MalformedInputError(f"needs too much{SHARE_OF_JOB}", source=path)
        return lint_file(path, max_cells=max_cells, radius=radius)

    monkeypatch.setattr(LINT_FILE, refused)
    report = lint(many, jobs=2)
    assert checks_of(report)["maps/many/2.yaml"] == ["yaml.origin-yaw"]
    assert before.count("2.yaml") == 2


@pytest.mark.parametrize(("problem", "told"), [
    (ZeroDivisionError("of mine"), "internal error: ZeroDivisionError: of mine; this is a bug"),
    (MemoryError(), "not enough memory for a map of this size"),
    (OSError(errno.ENOMEM, "Cannot"), "the system has no more to give: Cannot"),
])  # fmt: skip
def test_a_bug_met_by_one_map_is_a_finding_of_it(maps, monkeypatch, problem, told):
    def fails(path, *, max_cells=None, radius=None):
        if path.name == "plain.yaml":
            raise problem
        return lint_file(path, max_cells=max_cells, radius=radius)

    monkeypatch.setattr(LINT_FILE, fails)
    report = lint(listed("maps"))
    (found,) = report.maps[0].findings
    assert (found.check, found.severity) == ("lint.not-checked", "error")
    assert found.message.startswith(told)
    assert len(report.maps) == 3
