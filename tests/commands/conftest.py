"""Command lines as they are typed, and a map of two rooms with its run."""

import shutil

import pytest

import mapdeal
from cli.conftest import _shown_on_terminal, here, room, sh
from pipeline.reported import rooms_grid

__all__ = ["_shown_on_terminal", "here", "room", "sh"]


@pytest.fixture
def rooms(tmp_path):
    mapdeal.write_map(tmp_path / "rooms.yaml", rooms_grid())
    return tmp_path / "rooms.yaml"


@pytest.fixture(scope="session")
def finished_run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    mapdeal.write_map(folder / "rooms.yaml", rooms_grid())
    changes = {"inflate.radius": 0.25, "cost.inflation_radius": 0.8, "cost.cost_scaling_factor": 1}
    return mapdeal.run(folder / "rooms.yaml", folder / "out", changes=changes).folder


@pytest.fixture
def run(rooms, finished_run, tmp_path):
    """The folder of a run of the map, which was made once and copied."""
    return shutil.copytree(finished_run, tmp_path / "out" / "rooms")


@pytest.fixture
def save_output(command, tmp_path):
    """Return a function that writes the standard output of a command to a file."""

    def write(name, *words):
        path = tmp_path / name
        path.write_text(command(*words)[1])
        return path

    return write
