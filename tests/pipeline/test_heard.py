"""Warnings on their way: whoever runs maps hears of all of them, and of no others."""

import json
import threading
import warnings
from pathlib import Path

import pytest

from mapdeal.errors import MalformedInputError, MapdealWarning, capture_warnings, emit_warning
from mapdeal.pipeline.recipe import load_recipe
from mapdeal.pipeline.run import run_map
from mapdeal.pipeline.settings import Settings, adding_warnings

KEYS = "resolution: 0.25\norigin: [1.5, -2, 0.3]\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
NO_NEGATE = "missing: negate (ROS requires it); assuming 0"


def make_map(folder, name, more=""):
    pixels = bytes([254] * 9 + [0] + [205] * 2)
    (folder / f"{name}.pgm").write_bytes(b"P5\n4 3\n255\n" + pixels)
    (folder / f"{name}.yaml").write_text(f"image: {name}.pgm\n{KEYS}{more}")
    return folder / f"{name}.yaml"


def test_runs_in_threads_hear_their_own_warnings_and_leave_the_filters_alone(tmp_path):
    recipe, settings = load_recipe("default"), Settings(images=False, threads=1)
    names = [f"{kind}{index}" for index in range(3) for kind in ("odd", "good")]
    paths = {name: make_map(tmp_path, name, "negate: 0\n" * ("good" in name)) for name in names}
    start = threading.Barrier(len(names))

    def work(name):
        start.wait()
        for turn in range(2):
            run_map(paths[name], tmp_path / "out" / f"{name}-{turn}", recipe, settings)

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", MapdealWarning)
        filters, show = list(warnings.filters), warnings.showwarning
        threads = [threading.Thread(target=work, args=(name,)) for name in names]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert (list(warnings.filters), warnings.showwarning) == (filters, show)
        messages = [str(warning.message) for warning in caught if NO_NEGATE in str(warning.message)]
    assert sorted(messages) == sorted(
        f"{paths[name]}: {NO_NEGATE}" for name in names if "odd" in name for _ in range(2)
    )
    for path in (tmp_path / "out").rglob("manifest.json"):
        name = path.parent.name.partition("-")[0]
        mine = [text for text in json.loads(path.read_text())["warnings"] if NO_NEGATE in text]
        assert mine == ([f"{name}.yaml: {NO_NEGATE}"] if "odd" in name else [])


def test_warnings_before_an_error_are_printed(tmp_path):
    path = make_map(tmp_path, "short")
    path.with_suffix(".pgm").write_bytes(b"P5\n4 3\n255\n123")
    with (
        pytest.warns(MapdealWarning, match="assuming 0"),
        pytest.raises(MalformedInputError, match="end early"),
    ):
        run_map(path, tmp_path / "out", load_recipe("default"))


@pytest.mark.parametrize("action", ["ignore", "error", "once"])
def test_filters_of_who_calls_decide_what_becomes_of_warnings(action):
    texts = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter(action, MapdealWarning)
        try:
            for _ in range(2):
                with adding_warnings(texts):
                    emit_warning("odd")
        except MapdealWarning as error:
            assert (action, str(error)) == ("error", "odd")
    assert texts == ["odd"] * (1 if action == "error" else 2)
    assert len(caught) == (action == "once")


def test_a_warning_is_about_the_code_that_its_level_names(recwarn):
    def work():
        emit_warning("odd", stacklevel=2)

    work()
    with adding_warnings([]):
        work()
    lines = Path(__file__).read_text().splitlines()
    assert [lines[warning.lineno - 1].strip() for warning in recwarn] == ["work()"] * 2


def test_warnings_that_are_captured_twice_keep_their_place():
    with capture_warnings() as captured, adding_warnings(texts := []):
        emit_warning(MapdealWarning("odd", "image.lossy"))
    assert (texts, [warning.check for warning in captured]) == (["odd"], ["image.lossy"])
