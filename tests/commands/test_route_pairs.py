"""Routes of many pairs: the parts that stay in memory while they are planned."""

import io
from functools import partial

import numpy as np

from mapdeal import Costmap
from mapdeal.commands.route import PairedRoutes
from mapdeal.files.transaction import Transaction
from mapdeal.planning.routes import Terrain, route_over
from mapdeal.sensors.points import PairLine


def test_lines_go_to_the_disk_as_they_come(tmp_path):
    folder = tmp_path / "new"
    sizes = []

    def pairs():
        for line in range(1, 101):
            sizes.append(sum(file.stat().st_size for file in folder.iterdir()))
            yield PairLine(line, error="x" * 10_000)

    terrain = Terrain.of(Costmap(np.zeros((3, 5), np.uint8), 0.5, (1.0, -2.0, 0.4)))
    routes = PairedRoutes(pairs(), "pairs", {"plain": partial(route_over, terrain)})
    with Transaction([folder / "r.jsonl"]) as transaction:
        routes.write(transaction, folder / "r.jsonl")
    assert (routes.counts["pairs"], routes.counts["failed"]) == (100, 100)
    assert sizes == sorted(sizes)
    assert sizes[-1] > 985_000 - io.DEFAULT_BUFFER_SIZE  # which Python 3.14 has made larger
    assert [file.name for file in folder.iterdir()] == ["r.jsonl"]
    assert (folder / "r.jsonl").read_text().count('"line": ') == 100
