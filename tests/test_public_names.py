import pickle
import pydoc
import re
import traceback
import warnings

import numpy as np
import pytest

import mapdeal

NAMES = [name for name in dir(mapdeal) if name != "__version__"]


def test_help_fits_on_two_screens_and_names_exist_and_have_docstrings():
    assert pydoc.render_doc(mapdeal, renderer=pydoc.plaintext).count("\n") < 70
    named = re.findall(r"`(\w+)`", mapdeal.__doc__)
    assert len(named) > 30
    assert set(named) <= set(dir(mapdeal))
    docs = {name: getattr(mapdeal, name).__doc__ for name in NAMES}
    assert [name for name, doc in docs.items() if not doc] == []
    types = [name for name in NAMES if isinstance(getattr(mapdeal, name), type)]
    assert [name for name in types if not docs[name].splitlines()[0].strip().endswith(".")] == []


@pytest.mark.parametrize("words", [{"mode": "ternary"}, {"encoding": "costmap"}])
def test_invalid_choices_are_refused(tmp_path, words):
    grid = mapdeal.OccupancyGrid(np.zeros((2, 3), np.int8), 0.5, (1, 2, 0.3))
    path = tmp_path / "a.yaml"
    with pytest.raises(mapdeal.ParameterError, match=rf"^{next(iter(words))}: must be one of "):
        mapdeal.write_map(path, grid, **words)
    assert not path.exists()
    mapdeal.write_map(path, grid)
    with pytest.raises(mapdeal.FileAccessError, match=r"hint: force=True replaces it$"):
        mapdeal.write_map(path, grid)
    with pytest.raises(mapdeal.ParameterError, match=r"^dialect: must be one of nav2,"):
        mapdeal.read_map(path, dialect="jazzy")


def test_pythons_traceback_shows_the_hint_of_an_error():
    with pytest.raises(mapdeal.ParameterError) as caught:
        mapdeal.load_recipe("nav")
    error = caught.value
    hint_text = error.hint
    for raised in (error, pickle.loads(pickle.dumps(error))):  # noqa: S301 - as from a worker
        *_, last, hint = "".join(traceback.format_exception(raised)).splitlines()
        assert last == "mapdeal.errors.ParameterError: no such recipe, got 'nav'"
        assert hint == f"hint: {hint_text}" == "hint: did you mean nav2?"
        assert raised.hint == hint_text
        raised.hint = "other"
        assert raised.__notes__ == ["hint: other"]
        raised.hint = None
        assert not raised.__notes__


def test_warnings_of_degrees_and_by_names_of_parameters():
    grid = mapdeal.OccupancyGrid(np.zeros((20, 30), np.int8), 0.5, (1, 2, 0.3))
    for call in (
        lambda: mapdeal.reach(grid, start=(2, 5, 90)), lambda: mapdeal.rotate(grid, 90),
        lambda: mapdeal.align(grid, grid, rotations=[90]), lambda: mapdeal.graph(grid),
        lambda: mapdeal.Costmap([[0]], 1, (0, 0, 9)),
    ):  # fmt: skip
        with pytest.warns(mapdeal.MapdealWarning, match="is it in degrees|by footprint or robot:"):
            call()
    with warnings.catch_warnings(record=True) as caught:  # once, where the grid is made
        warnings.simplefilter("always")
        grid = mapdeal.OccupancyGrid(np.zeros((20, 30), np.int8), 0.5, (1, 2, 9))
        mapdeal.merge([grid, grid])
    assert sum("degrees" in str(warning.message) for warning in caught) == 1
