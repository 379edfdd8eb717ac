"""Maps of logs from Python: those of the command."""

from pathlib import Path

import numpy as np
import pytest

import mapdeal

LOG = Path(__file__).parents[2] / "examples" / "logs" / "office.log"


@pytest.mark.parametrize(("words", "arguments"), [
    (["--method", "tsdf", "--truncation", "3", "--range-max", "6"],
     {"method": "tsdf", "truncation": 3, "range_max": 6}),
    (["--method", "counting", "--size", "4,3", "--origin=-2,-1.5"],
     {"method": "counting", "size": (4, 3), "origin": (-2, -1.5)}),
], ids=["tsdf", "counting"])  # fmt: skip
@pytest.mark.usefixtures("mapdeal_warnings")
def test_a_log_makes_the_map_and_evidence_of_the_command(tmp_path, command, words, arguments):
    out, layers = tmp_path / "map.npz", tmp_path / "layers.npz"
    code, _, err = command(
        "build", LOG, "-o", out, "--layers", layers, *words, "--resolution", "0.2"
    )
    assert code == 0, err
    built = mapdeal.build_map_from_log(str(LOG), **arguments, resolution=0.2)
    expected = mapdeal.read_map(out)
    assert np.array_equal(built.grid.occupancy, expected.occupancy)
    assert built.grid.origin == expected.origin
    with np.load(layers) as stored:
        for name, layer in built.layers.items():
            assert np.array_equal(stored[name], layer, equal_nan=True)


def test_lines_that_are_wrong_are_passed_over_up_to_a_number(tmp_path):
    log = tmp_path / "two.log"
    log.write_text("".join(
        f"FLASER 180 {'1.5 ' * 179}{last} {x} 2 0.3 {x} 2 0.3 {x} host {x}\n"
        for x, last in ((1, "1.0"), (2, "near"), (3, "2.0"))
    ))  # fmt: skip
    with pytest.warns(mapdeal.MapdealWarning, match="line 2"):
        built = mapdeal.build_map_from_log(log, resolution=0.5)
    assert built.counts.scans == 2
    with pytest.raises(mapdeal.MalformedInputError, match="line 2"):
        mapdeal.build_map_from_log(log, resolution=0.5, max_bad=0)
