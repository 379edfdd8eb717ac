"""Maps and costmaps out of bags."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

from mapdeal.errors import ParameterError
from mapdeal.formats.bags.bag import Bag, Connection, MessageIndex
from mapdeal.formats.bags.decoding import Decoder
from mapdeal.formats.bags.messages import GRID_TYPES, frame_of, grid_of, time_of
from mapdeal.formats.bags.reader import chosen_connections, open_bag
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.records import dataclass

ReadAs = Literal["map", "costs"]

_OF_COSTS = "costmap"
"""Word in the names of topics on which Nav2 and move_base publish costs."""


@dataclass(frozen=True)
class RecordedGrid:
    """A map or costmap of a bag."""

    grid: OccupancyGrid | Costmap
    number: int
    time: int
    frame: str


class GridTopic:
    """The maps and costmaps of one topic."""

    def __init__(self, bag: Bag, topic: str | None, read_as: ReadAs | None = None) -> None:
        named = [] if topic is None else [topic]
        connections = chosen_connections(bag, named, GRID_TYPES, "maps and costmaps")
        self._types = {one.id: one.type for one in connections}
        self._index: MessageIndex = bag.index(self._types)
        self._decoder = Decoder(bag)
        self.files = bag.files
        self.topic = connections[0].topic
        self.is_costs = _is_of_costs(connections[0]) if read_as is None else read_as == "costs"
        if not len(self._index):
            raise bag.malformed("holds no messages", self.topic)

    def __len__(self) -> int:
        return len(self._index)

    def read(self, number: int) -> RecordedGrid:
        """Return one of them, counted from 0 on, or from the last, -1, back."""
        count = len(self)
        if not -count <= number < count:
            rule = f"{self.topic} has {count} messages: 0 to {count - 1}, or -1 to {-count}"
            raise ParameterError(rule, source="--index", got=number)
        place = self._index[number % count]
        name = self._types[place.connection]

        def recorded(message: Any) -> RecordedGrid:
            grid = grid_of(message, name, is_costs=self.is_costs)
            stamp = time_of(message.header.stamp)
            return RecordedGrid(grid, number % count, stamp, frame_of(message.header))

        return self._decoder.read(place, recorded)


@contextmanager
def grid_topic(
    path: Path, topic: str | None = None, *, read_as: ReadAs | None = None
) -> Iterator[GridTopic]:
    """Open a bag at a topic of maps or costmaps within a ``with`` block; see `GridTopic`."""
    with open_bag(path) as bag:
        yield GridTopic(bag, topic, read_as)


def _is_of_costs(connection: Connection) -> bool:
    return _OF_COSTS in connection.topic.lower()
