"""Batches: what comes of each job, whoever does it, and whatever happens to them."""

import json
import threading
from concurrent.futures import BrokenExecutor, Future
from contextlib import contextmanager
from pathlib import Path

import pytest

import batch_work
from mapdeal import FileAccessError, ParameterError
from mapdeal.inputs.listing import ListedMap
from mapdeal.pipeline import batch as jobs_module
from mapdeal.pipeline.batch import Batch, Job, jobs_of, run_all, text_of
from mapdeal.pipeline.workers import ProcessWorkers

pytestmark = pytest.mark.slow


def jobs(names, output):
    return jobs_of(
        [ListedMap(Path(f"maps/{name}.yaml"), f"{name}.yaml") for name in names], output, []
    )


def run(names, output, size=2, work=batch_work.do):
    """Return the status of each job, and the summary."""
    told = []
    workers = ProcessWorkers(size) if size else None
    tell = lambda job, _: told.append(job.path.stem)  # noqa: E731
    batch = run_all(jobs(names, output), output, work, tell, Batch, workers=workers)
    assert sorted(told) == sorted(names)
    return batch.outcomes, json.loads((output / "summary.json").read_text())["maps"]


@pytest.mark.parametrize("size", [None, 1, 2])
def test_every_job_has_its_outcome_in_order_f9(tmp_path, size):
    names = ["slow", "bad", "a", "warn", "bug", "memory", "two"]
    outcomes, summary = run(names, tmp_path / "o", size)
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


def test_a_map_that_kills_its_workers_fails_and_the_others_go_on_f10(tmp_path):
    names = ["a", "b", "killer", "c", "slow", "d", "killer2", "e"]
    outcomes, summary = run(names, tmp_path / "o")
    failed = [name for name, one in zip(names, outcomes, strict=True) if one.status == "failed"]
    assert failed == ["killer", "killer2"]
    error = outcomes[2].result
    assert str(error).startswith("maps/killer.yaml: the worker process died")
    assert "memory" in error.hint
    assert summary[2]["status"] == "failed"


def test_a_worker_that_is_told_to_stop_counts_as_dead(tmp_path):
    outcomes, _ = run(["a", "term", "b"], tmp_path / "o")
    assert [one.status for one in outcomes] == ["done", "failed", "done"]


def test_a_result_that_cannot_be_sent_is_a_failure(tmp_path):
    outcomes, _ = run(["a", "odd", "b"], tmp_path / "o")
    assert [one.status for one in outcomes] == ["done", "failed", "done"]
    assert "internal error" in str(outcomes[1].result)


@pytest.mark.parametrize("size", [None, 2])
def test_ctrl_c_leaves_a_summary_of_what_was_done(tmp_path, size):
    def press(job, outcome):
        if job.path.stem == "a":
            raise KeyboardInterrupt

    output = tmp_path / "o"
    workers = ProcessWorkers(size) if size else None
    with pytest.raises(KeyboardInterrupt, match="maps are done") as caught:
        run_all(jobs(["a", *[f"slow{k}" for k in range(60)]], output), output, batch_work.do, press,
                Batch, workers=workers)  # fmt: skip
    summary = json.loads((output / "summary.json").read_text())["maps"]
    statuses = [one["status"] for one in summary]
    assert statuses[0] == "done"
    assert statuses[-1] == "interrupted"
    assert caught.value.args[0].startswith(f"{statuses.count('done')} of 61")


def test_workers_serve_where_this_is_not_the_main_thread(tmp_path):
    found = []
    thread = threading.Thread(target=lambda: found.extend(run(["a", "b"], tmp_path / "o")[0]))
    thread.start()
    thread.join(120)
    assert [one.status for one in found] == ["done", "done"]


def test_a_job_may_replace_what_its_own_batch_has_left_alone(tmp_path):
    seen = []

    def work(job):
        seen.append(job.is_new)
        return batch_work.do(job)

    (tmp_path / "o" / "there").mkdir(parents=True)
    run(["a", "there"], tmp_path / "o", None, work)
    assert seen == [True, False]


@pytest.mark.parametrize(("names", "told"), [
    (["a/m.yaml", "m.yaml", "a/m.yml"], "a/m.yml: would write into out/a/m, as in/a/m.yaml"),
    (["summary.json.yaml", "m.yaml"], "into the place of summary.json"),
    (["m.yaml", "m/cost.png.yaml"], "into the place of a file of in/m.yaml"),
    (["m.yaml", "m/cost.png/x.yaml"], "into the place of a file of in/m.yaml"),
])  # fmt: skip
def test_places_that_would_collide_are_refused_f8(names, told):
    maps = [ListedMap(Path("in") / name, name) for name in names]
    with pytest.raises(ParameterError) as caught:
        jobs_of(maps, Path("out"), ["cost.png", "manifest.json"])
    assert told in str(caught.value)


@pytest.mark.parametrize("ignores_case", [False, True])
def test_places_below_each_other_and_names_that_differ_in_case(monkeypatch, ignores_case):
    monkeypatch.setattr(jobs_module, "ignores_case", lambda _: ignores_case)
    names = ["a/Map.yaml", "a/map.yaml", "a/map/x.yaml"]
    maps = [ListedMap(Path(name), name) for name in names]
    if ignores_case:
        with pytest.raises(ParameterError, match="ignores case"):
            jobs_of(maps, Path("o"), ["cost.png"])
    else:
        places = [job.place for job in jobs_of(maps, Path("o"), ["cost.png"])]
        assert places == ["a/Map", "a/map", "a/map/x"]


@pytest.mark.parametrize(("text", "told"), [
    ("/d/in/a/m.yaml: bad", "a/m.yaml: bad"),
    ("/d/in/a/m.pgm: bad, took /d/in/a/n.pgm", "a/m.pgm: bad, took a/n.pgm"),
    ("/d/out/a/m/cost.png: exists", "a/m/cost.png: exists"),
    ("/else/d/in/a/m.yaml: bad", "/else/d/in/a/m.yaml: bad"),
])  # fmt: skip
def test_messages_in_a_summary_name_files_as_it_does(text, told):
    job = Job(Path("/d/in/a/m.yaml"), Path("/d/out/a/m"), "a/m.yaml", "a/m")
    assert text_of(text, job) == told


class OnceWorkers:
    """Workers in this process, of which the first dies of its job and no other can be started."""

    size = 1

    def __init__(self):
        self.starts = 0

    @contextmanager
    def started(self, _size, work):
        self.starts += 1
        if self.starts > 1:
            raise FileAccessError("cannot be started", source="worker processes")

        def submit(job):
            if job.path.stem == "dies":
                raise BrokenExecutor
            sent = Future()
            sent.set_result(work(job))
            return sent

        yield submit


def test_the_summary_tells_what_was_done_before_no_more_workers_could_be_started(tmp_path):
    made = jobs(["a", "dies", "b"], tmp_path)
    with pytest.raises(FileAccessError, match="cannot be started"):
        run_all(made, tmp_path, batch_work.do, lambda *_: None, Batch, workers=OnceWorkers())
    summary = json.loads((tmp_path / "summary.json").read_text())["maps"]
    assert [one["status"] for one in summary] == ["done", "interrupted", "interrupted"]
