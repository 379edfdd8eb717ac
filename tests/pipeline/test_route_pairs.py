"""Routes of many pairs: what is kept of them while they are planned."""

import io

import numpy as np
import pytest

from mapdeal import Costmap, write_map
from mapdeal.commands.route import compare_pairs
from mapdeal.errors import MalformedInputError
from mapdeal.pipeline.settings import Settings
from mapdeal.sensors.points import PairLine


@pytest.fixture
def costs(tmp_path):
    write_map(tmp_path / "c.npz", Costmap(np.zeros((3, 5), np.uint8), 0.5, (1.0, -2.0, 0.4)))
    return tmp_path / "c.npz"


@pytest.mark.usefixtures("mapdeal_warnings")
def test_lines_go_to_the_disk_as_they_come(costs, tmp_path):
    folder = tmp_path / "new"
    sizes = []

    def asked():
        for line in range(1, 101):
            sizes.append(sum(one.stat().st_size for one in folder.iterdir()))
            yield PairLine(line, error="x" * 10_000)

    report = compare_pairs(costs, asked(), folder / "r.jsonl", Settings(), asked_from="pairs")
    assert (report.pairs, report.failed) == (100, 100)
    assert sizes == sorted(sizes)
    assert sizes[-1] > 985_000 - io.DEFAULT_BUFFER_SIZE  # which Python 3.14 has made larger
    assert [one.name for one in folder.iterdir()] == ["r.jsonl"]
    assert (folder / "r.jsonl").read_text().count('"line": ') == 100


@pytest.mark.usefixtures("mapdeal_warnings")
def test_what_goes_wrong_on_the_way_leaves_nothing(costs, tmp_path):
    def asked():
        yield PairLine(1, (1.5, -1.5), (1.5, -1.5))
        raise MalformedInputError("ends early", source="pairs")

    with pytest.raises(MalformedInputError, match="pairs: ends early"):
        compare_pairs(costs, asked(), tmp_path / "new/r.jsonl", Settings(), asked_from="pairs")
    assert sorted(one.name for one in tmp_path.iterdir()) == ["c.npz"]
