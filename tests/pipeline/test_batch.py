import json
import threading
from concurrent.futures import BrokenExecutor
from pathlib import Path

import numpy as np
import pytest

import batch_work
from compare.buildings import OTHER_WALLS, WALLS, between, cut, drawn, errors
from mapdeal import FileAccessError, FindingError, ParameterError, Transform, merge
from mapdeal.maps.listing import ListedMap
from mapdeal.pipeline import batch as jobs_module
from mapdeal.pipeline.batch import Batch, Job, jobs_of, run_all, text_of
from mapdeal.pipeline.workers import ProcessWorkers
from pipeline.here import HereWorkers, die_of

pytestmark = pytest.mark.slow


def jobs(names, output, read=()):
    return jobs_of([ListedMap(Path("maps") / name, name) for name in names], output, read)


def run(names, output, size=2, work=batch_work.do, workers=None, report=lambda *_: None):
    """Return the outcome of each job, and fill the summary."""
    listed = jobs([f"{name}.yaml" for name in names], output)
    workers = workers or (ProcessWorkers(size) if size else None)
    reported = []

    def collect(job, outcome):
        reported.append(job.path.stem)
        report(job, outcome)

    outcomes = run_all(listed, output, work, collect, Batch, workers=workers).outcomes
    assert sorted(reported) == sorted(names)
    return outcomes


def summary_of(output):
    return json.loads((output / "summary.json").read_text())["maps"]


@pytest.mark.parametrize("size", [None, 2])
def test_every_job_has_its_outcome_in_order(tmp_path, size):
    names = ["slow", "bad", "a", "warn", "bug", "memory", "two"]
    outcomes = run(names, tmp_path / "o", size)
    summary = summary_of(tmp_path / "o")
    statuses = [outcome.status for outcome in outcomes]
    assert statuses == ["done", "failed", "done", "done", *["failed"] * 3]
    assert [entry["map"] for entry in summary] == [f"{name}.yaml" for name in names]
    bad = outcomes[1].result
    assert isinstance(bad, FileAccessError)
    assert (str(bad), bad.hint) == ("maps/bad.yaml: key: is bad, got [1]", "mend it")
    assert outcomes[3].warnings == ("maps/warn.yaml: beware\\nof this",)
    assert [entry["status"] for entry in summary] == statuses
    assert summary[3]["warnings"] == ["warn.yaml: beware\\nof this"]
    assert "internal error: RuntimeError: a bug" in str(outcomes[4].result)
    assert outcomes[5].result.exit_code == 3
    assert summary[1] == {
        "map": "bad.yaml", "folder": "bad", "status": "failed", "exit_code": 4,
        "error": "bad.yaml: key: is bad, got [1]",
    }  # fmt: skip


@pytest.mark.parametrize(("names", "failed", "message"), [
    ("a once b killer c slow d killer2 e", "killer killer2", "maps/killer.yaml: the worker"),
    ("a term b", "term", "the worker process died"),  # it ends itself with SIGTERM
    ("a odd b", "odd", "internal error"),  # its result cannot be sent
])  # fmt: skip
def test_a_map_that_kills_its_workers_fails_and_the_others_go_on(tmp_path, names, failed, message):
    outcomes = run(names.split(), tmp_path / "o")
    found = dict(zip(names.split(), outcomes, strict=True))
    assert [name for name, outcome in found.items() if outcome.status == "failed"] == failed.split()
    error = found[failed.split()[0]].result
    assert message in str(error)
    assert "odd" in names or "memory" in error.hint
    statuses = [entry["status"] for entry in summary_of(tmp_path / "o")]
    assert statuses == [outcome.status for outcome in outcomes]


@pytest.mark.parametrize("size", [None, 2])
def test_ctrl_c_leaves_a_summary_of_what_was_done(tmp_path, size):
    def press(job, _):
        if job.path.stem == "a":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt, match="maps are done") as caught:
        run(["a", *[f"slow{k}" for k in range(60)]], tmp_path, size, report=press)
    statuses = [entry["status"] for entry in summary_of(tmp_path)]
    assert (statuses[0], statuses[-1]) == ("done", "interrupted")
    assert caught.value.args[0].startswith(f"{statuses.count('done')} of 61")


def test_workers_serve_where_this_is_not_the_main_thread(tmp_path):
    found = []
    thread = threading.Thread(target=lambda: found.extend(run(["a", "b"], tmp_path / "o")))
    thread.start()
    thread.join(120)
    assert [outcome.status for outcome in found] == ["done", "done"]


def test_a_job_may_replace_what_its_own_batch_has_left_alone(tmp_path):
    are_new = []

    def work(job):
        are_new.append(job.is_new)
        return batch_work.do(job)

    (tmp_path / "there").mkdir()
    run(["a", "there"], tmp_path, None, work)
    assert are_new == [True, False]


@pytest.mark.parametrize(("names", "message"), [
    (["a/m.yaml", "m.yaml", "a/m.yml"], "a/m.yml: would write into out/a/m, as maps/a/m.yaml"),
    (["summary.json.yaml", "m.yaml"], "into the place of summary.json"),
    *[(["m.yaml", f"m/cost.png{end}.yaml"], "into the place of a file of maps/m.yaml")
      for end in ("", "/x")],
])  # fmt: skip
def test_places_that_would_collide_are_refused(names, message):
    with pytest.raises(ParameterError) as caught:
        jobs(names, Path("out"), ["cost.png", "manifest.json"])
    assert message in str(caught.value)


def test_places_below_each_other_and_names_that_differ_in_case(monkeypatch):
    names = ["a/Map.yaml", "a/map.yaml", "a/map/x.yaml"]
    monkeypatch.setattr(jobs_module, "ignores_case", lambda _: False)
    places = [job.place for job in jobs(names, Path("o"), ["cost.png"])]
    assert places == ["a/Map", "a/map", "a/map/x"]
    monkeypatch.setattr(jobs_module, "ignores_case", lambda _: True)
    with pytest.raises(ParameterError, match="ignores case"):
        jobs(names, Path("o"), ["cost.png"])


def test_messages_in_a_summary_name_files_as_it_does():
    job = Job(Path("/d/in/a/m.yaml"), Path("/d/out/a/m"), "a/m.yaml", "a/m")
    for text, message in (
        ("/d/in/a/m.yaml: bad", "a/m.yaml: bad"),
        ("/d/in/a/m.pgm: bad, took /d/in/a/n.pgm", "a/m.pgm: bad, took a/n.pgm"),
        ("/d/out/a/m/cost.png: exists", "a/m/cost.png: exists"),
        ("/else/d/in/a/m.yaml: bad", "/else/d/in/a/m.yaml: bad"),
    ):
        assert text_of(text, job) == message


def test_the_summary_lists_what_was_done_before_no_more_workers_could_be_started(tmp_path):
    workers = HereWorkers(fates={"dies": die_of(BrokenExecutor())}, starts=1)
    with pytest.raises(FileAccessError, match="cannot be started"):
        run(["a", "dies", "b"], tmp_path, workers=workers)
    statuses = [entry["status"] for entry in summary_of(tmp_path)]
    assert statuses == ["done", "interrupted", "interrupted"]


PLACES = [Transform(-3.2, 11.7, 0.3), Transform(5.0, 2.0, 2.2), Transform(-8.0, 3.0, 1.1)]


def part(place, keep=np.isfinite):
    return cut(drawn(WALLS, 0.2, place), place, keep)


def test_a_map_that_only_overlaps_another_one_is_placed_by_that():
    west, middle, east = PLACES
    parts = [part(west, lambda x: x < 11), part(east, lambda x: x > 13), part(middle)]
    found = merge(parts, transforms="align").transforms
    for transform, place in zip(found[1:], (east, middle), strict=True):
        off, turn = errors(transform, between(west, place), parts[0])
        assert off < 0.15
        assert turn < 0.5


def test_a_map_of_another_place_is_named():
    grids = [part(PLACES[0]), part(PLACES[1]), drawn(OTHER_WALLS, 0.2)]
    with pytest.raises(FindingError, match=r"^map 3: its placement on map 1 or on another"):
        merge(grids, transforms="align")
