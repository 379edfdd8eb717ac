"""Batches: what comes of each job, whoever does it, and whatever happens to them."""

import json
import threading
from concurrent.futures import BrokenExecutor
from pathlib import Path

import pytest

import batch_work
from mapdeal import FileAccessError, ParameterError
from mapdeal.inputs.listing import ListedMap
from mapdeal.pipeline import batch as jobs_module
from mapdeal.pipeline.batch import Batch, Job, jobs_of, run_all, text_of
from mapdeal.pipeline.workers import ProcessWorkers
from pipeline.here import HereWorkers, die_of

pytestmark = pytest.mark.slow


def jobs(names, output, others=()):
    return jobs_of([ListedMap(Path("maps") / name, name) for name in names], output, others)


def run(names, output, size=2, work=batch_work.do, workers=None, tell=lambda *_: None):
    """Return the outcome of each job, and fill the summary."""
    made = jobs([f"{name}.yaml" for name in names], output)
    workers = workers or (ProcessWorkers(size) if size else None)
    told = []

    def heard(job, outcome):
        told.append(job.path.stem)
        tell(job, outcome)

    outcomes = run_all(made, output, work, heard, Batch, workers=workers).outcomes
    assert sorted(told) == sorted(names)
    return outcomes


def summary_of(output):
    return json.loads((output / "summary.json").read_text())["maps"]


@pytest.mark.parametrize("size", [None, 1, 2])
def test_every_job_has_its_outcome_in_order_f9(tmp_path, size):
    names = ["slow", "bad", "a", "warn", "bug", "memory", "two"]
    outcomes = run(names, tmp_path / "o", size)
    summary = summary_of(tmp_path / "o")
    assert [one.status for one in outcomes] == ["done", "failed", "done", "done", *["failed"] * 3]
    assert [one["map"] for one in summary] == [f"{name}.yaml" for name in names]
    bad = outcomes[1].result
    assert isinstance(bad, FileAccessError)
    assert (str(bad), bad.hint) == ("maps/bad.yaml: key: is bad, got [1]", "mend it")
    assert outcomes[3].warnings == ("maps/warn.yaml: beware\\nof this",)
    assert [one["status"] for one in summary] == [one.status for one in outcomes]
    assert summary[3]["warnings"] == ["warn.yaml: beware\\nof this"]
    assert "internal error: RuntimeError: a bug" in str(outcomes[4].result)
    assert outcomes[5].result.exit_code == 3
    assert summary[1] == {
        "map": "bad.yaml", "folder": "bad", "status": "failed", "exit_code": 4,
        "error": "bad.yaml: key: is bad, got [1]",
    }  # fmt: skip


@pytest.mark.parametrize(("names", "failed", "told"), [
    ("a b killer c slow d killer2 e", "killer killer2", "maps/killer.yaml: the worker process"),
    ("a term b", "term", "the worker process died"),  # told to stop
    ("a odd b", "odd", "internal error"),  # its result cannot be sent
])  # fmt: skip
def test_a_map_that_kills_its_workers_fails_and_the_others_go_on_f10(tmp_path, names, failed, told):
    outcomes = run(names.split(), tmp_path / "o")
    found = dict(zip(names.split(), outcomes, strict=True))
    assert [name for name, one in found.items() if one.status == "failed"] == failed.split()
    error = found[failed.split()[0]].result
    assert told in str(error)
    assert "odd" in names or "memory" in error.hint
    assert [one["status"] for one in summary_of(tmp_path / "o")] == [one.status for one in outcomes]


@pytest.mark.parametrize("size", [None, 2])
def test_ctrl_c_leaves_a_summary_of_what_was_done(tmp_path, size):
    def press(job, _):
        if job.path.stem == "a":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt, match="maps are done") as caught:
        run(["a", *[f"slow{k}" for k in range(60)]], tmp_path, size, tell=press)
    statuses = [one["status"] for one in summary_of(tmp_path)]
    assert (statuses[0], statuses[-1]) == ("done", "interrupted")
    assert caught.value.args[0].startswith(f"{statuses.count('done')} of 61")


def test_workers_serve_where_this_is_not_the_main_thread(tmp_path):
    found = []
    thread = threading.Thread(target=lambda: found.extend(run(["a", "b"], tmp_path / "o")))
    thread.start()
    thread.join(120)
    assert [one.status for one in found] == ["done", "done"]


def test_a_job_may_replace_what_its_own_batch_has_left_alone(tmp_path):
    seen = []

    def work(job):
        seen.append(job.is_new)
        return batch_work.do(job)

    (tmp_path / "there").mkdir()
    run(["a", "there"], tmp_path, None, work)
    assert seen == [True, False]


@pytest.mark.parametrize(("names", "told"), [
    (["a/m.yaml", "m.yaml", "a/m.yml"], "a/m.yml: would write into out/a/m, as maps/a/m.yaml"),
    (["summary.json.yaml", "m.yaml"], "into the place of summary.json"),
    (["m.yaml", "m/cost.png.yaml"], "into the place of a file of maps/m.yaml"),
    (["m.yaml", "m/cost.png/x.yaml"], "into the place of a file of maps/m.yaml"),
])  # fmt: skip
def test_places_that_would_collide_are_refused_f8(names, told):
    with pytest.raises(ParameterError) as caught:
        jobs(names, Path("out"), ["cost.png", "manifest.json"])
    assert told in str(caught.value)


def test_places_below_each_other_and_names_that_differ_in_case(monkeypatch):
    names = ["a/Map.yaml", "a/map.yaml", "a/map/x.yaml"]
    monkeypatch.setattr(jobs_module, "ignores_case", lambda _: False)
    places = [job.place for job in jobs(names, Path("o"), ["cost.png"])]
    assert places == ["a/Map", "a/map", "a/map/x"]
    monkeypatch.setattr(jobs_module, "ignores_case", lambda _: True)
    with pytest.raises(ParameterError, match="ignores case"):
        jobs(names, Path("o"), ["cost.png"])


@pytest.mark.parametrize(("text", "told"), [
    ("/d/in/a/m.yaml: bad", "a/m.yaml: bad"),
    ("/d/in/a/m.pgm: bad, took /d/in/a/n.pgm", "a/m.pgm: bad, took a/n.pgm"),
    ("/d/out/a/m/cost.png: exists", "a/m/cost.png: exists"),
    ("/else/d/in/a/m.yaml: bad", "/else/d/in/a/m.yaml: bad"),
])  # fmt: skip
def test_messages_in_a_summary_name_files_as_it_does(text, told):
    job = Job(Path("/d/in/a/m.yaml"), Path("/d/out/a/m"), "a/m.yaml", "a/m")
    assert text_of(text, job) == told


def test_the_summary_tells_what_was_done_before_no_more_workers_could_be_started(tmp_path):
    workers = HereWorkers(fates={"dies": die_of(BrokenExecutor())}, starts=1)
    with pytest.raises(FileAccessError, match="cannot be started"):
        run(["a", "dies", "b"], tmp_path, workers=workers)
    statuses = [one["status"] for one in summary_of(tmp_path)]
    assert statuses == ["done", "interrupted", "interrupted"]
