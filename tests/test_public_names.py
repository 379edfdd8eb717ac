"""What `import mapdeal` gives, and how it is told."""

import pydoc
import re

import numpy as np
import pytest

import mapdeal

NAMES = [name for name in dir(mapdeal) if name != "__version__"]


def test_the_packages_docstring_names_all_there_is():
    told = set(re.findall(r"`([A-Za-z_]+)", mapdeal.__doc__))
    assert set(NAMES) <= told


def test_help_has_every_public_name():
    text = pydoc.plain(pydoc.render_doc(mapdeal))
    missing = [name for name in NAMES if not re.search(rf"\b{name}\b", text)]
    assert not missing
    for function in ("lint", "diff", "run", "draw_picture"):
        assert f"    {function}(" in text


@pytest.mark.parametrize("name", NAMES)
def test_every_public_name_has_a_docstring(name):
    value = getattr(mapdeal, name)
    assert value.__doc__
    if not isinstance(value, type):  # a union's own is Python's
        return
    assert value.__doc__.splitlines()[0].strip().endswith(".")


def test_words_that_are_no_choice_are_refused(tmp_path):
    grid = mapdeal.OccupancyGrid(np.zeros((2, 3), np.int8), 0.5, (1, 2, 0.3))
    path = tmp_path / "a.yaml"
    for words in ({"mode": "ternary"}, {"encoding": "costmap"}):
        (name,) = words
        with pytest.raises(mapdeal.ParameterError, match=f"^{name}: must be one of "):
            mapdeal.write_map(path, grid, **words)
        assert not path.exists()
    mapdeal.write_map(path, grid)
    with pytest.raises(
        mapdeal.ParameterError, match=r"^dialect: must be one of nav2, humble, ros1"
    ):
        mapdeal.read_map(path, dialect="jazzy")


def test_names_of_files_may_be_text(tmp_path):
    path = tmp_path / "poses.txt"
    path.write_text("1 2 0.5\n")
    assert mapdeal.read_poses(str(path)).tolist() == [[1, 2, 0.5]]
