"""The memory that a stage's record promises is enough: the peak of its command, measured.

Too little, and a map that was said to fit would not. Processes of their own are measured, since a
peak is never taken back.
"""

import numpy as np
import pytest

from mapdeal import OccupancyGrid, write_map
from mapdeal.kernels.engine import engine_name
from mapdeal.pipeline.inputs import bytes_in_memory
from mapdeal.pipeline.step import make_step
from mapdeal.stages.catalogue import STAGES
from measuring import measured

pytestmark = [
    pytest.mark.thorough,
    pytest.mark.skipif(engine_name() != "compiled", reason="the records are of that engine"),
]
SIDES = (1500, 1800)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    values = np.zeros(SIDES, np.int8)
    values[::50, 7::70] = 100
    values[:, -300:] = -1
    path = tmp_path_factory.mktemp("maps") / "site.yaml"
    write_map(path, OccupancyGrid(values, 0.05, (1.5, -2.0, 0.4)))
    return path


def peak(*words):
    code, output, peak_bytes = measured(None, *words, "-q", "--threads", "2")
    assert (code, output) == (0, "")
    return peak_bytes


@pytest.mark.parametrize(
    "stage",
    [stage for stage in STAGES if stage.cells is None],  # others: test_memory_of_commands.py
    ids=lambda stage: f"{stage.name} {stage.model or ''}",
)
def test_a_command_takes_no_more_memory_than_its_stage_estimates(site, tmp_path, stage):
    model = {"model": stage.model} if stage.model else {}
    if stage.name == "shift":
        model["origin"] = "20,30"
    options = [word for name, value in model.items() for word in (f"--{name}", value)]
    outputs = ["-o", str(tmp_path / "out.npz")]
    if stage.name == "reach":
        outputs = ["-o", str(tmp_path / "out.json"), "--layers", str(tmp_path / "out.npz")]
    promised = bytes_in_memory(SIDES, [make_step(stage.name, model)], None)
    over = peak(stage.name, str(site), *outputs, *options) - promised
    needed = stage.memory + over / (SIDES[0] * SIDES[1])
    assert over < 0, f"{stage.name}: memory= must be at least {needed:.1f} bytes a cell"


def test_many_headings_take_no_more_memory_than_estimated(site, tmp_path):
    corners = [[0.45, 0.2], [0.45, -0.2], [-0.45, -0.2], [-0.45, 0.2]]
    robot = ["--footprint", str(corners), "--headings", "255"]
    used = peak("reach", str(site), "-o", str(tmp_path / "out.json"), *robot)
    few, many = (
        bytes_in_memory(SIDES, [make_step("reach", {"footprint": corners, **more})], None)
        for more in ({}, {"headings": 255})
    )
    assert few < used < many
