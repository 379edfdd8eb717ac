"""Routes of many pairs: what is kept of them while they are planned."""

import io

import numpy as np
import pytest

from mapdeal import Costmap
from mapdeal.commands.route import PairedRoutes
from mapdeal.errors import MalformedInputError
from mapdeal.files.transaction import Transaction
from mapdeal.planning.routes import Terrain
from mapdeal.sensors.points import PairLine


def written(pairs, output):
    terrain = Terrain.of(Costmap(np.zeros((3, 5), np.uint8), 0.5, (1.0, -2.0, 0.4)))
    routes = PairedRoutes(pairs, "pairs", terrain, {"plain": {}})
    with Transaction([output]) as transaction:
        routes.write(transaction, output)
    return routes


def test_lines_go_to_the_disk_as_they_come(tmp_path):
    folder = tmp_path / "new"
    sizes = []

    def asked():
        for line in range(1, 101):
            sizes.append(sum(one.stat().st_size for one in folder.iterdir()))
            yield PairLine(line, error="x" * 10_000)

    routes = written(asked(), folder / "r.jsonl")
    assert (routes.counts["pairs"], routes.counts["failed"]) == (100, 100)
    assert sizes == sorted(sizes)
    assert sizes[-1] > 985_000 - io.DEFAULT_BUFFER_SIZE  # which Python 3.14 has made larger
    assert [one.name for one in folder.iterdir()] == ["r.jsonl"]
    assert (folder / "r.jsonl").read_text().count('"line": ') == 100


def test_what_goes_wrong_on_the_way_leaves_nothing(tmp_path):
    def asked():
        yield PairLine(1, (1.5, -1.5), (1.5, -1.5))
        raise MalformedInputError("ends early", source="pairs")

    with pytest.raises(MalformedInputError, match="pairs: ends early"):
        written(asked(), tmp_path / "new/r.jsonl")
    assert not list(tmp_path.iterdir())
