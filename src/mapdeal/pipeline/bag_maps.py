"""Contents of a bag, and the commands that accept it."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any, Literal

from mapdeal.bags.bag import CAN_BE_READ, Bag, Connection, MessageIndex, Recorded, normalised_type
from mapdeal.bags.messages import (
    GRID_TYPES,
    LASER_SCAN,
    ODOMETRY,
    POINT_CLOUD,
    TF_TYPES,
    Decoder,
    Stamped,
    frame_of,
    grid_of,
    odometry_of,
    time_of,
    transforms_of,
)
from mapdeal.bags.reader import chosen_connections, open_bag
from mapdeal.errors import MalformedInputError, ParameterError
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.pipeline.settings import ProgressCallback, Settings, report_nothing

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
            raise ParameterError(rule, place="index", got=number)
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


def read_map_from_bag(
    path: str | PathLike[str],
    topic: str | None = None,
    *,
    index: int = -1,
    read_as: ReadAs | None = None,
    max_memory: int | None = None,
) -> OccupancyGrid | Costmap:
    """Read a map or costmap from a bag, like ``mapdeal convert BAG``.

    Parameters
    ----------
    path : path or str
        A ROS 1 ``.bag``, a folder with a ROS 2 bag, or a ``.db3`` or ``.mcap`` file.
    topic : str, optional
        Topic of type nav_msgs/OccupancyGrid or nav2_msgs/Costmap. It can be omitted if the bag
        has only one.
    index : int
        Index of the message in recording order; negative values count from the last.
    read_as : {'map', 'costs'}, optional
        Meaning of the values of an OccupancyGrid. By default they are costs if the topic name
        contains ``costmap``, otherwise a map.
    max_memory : int, optional
        Memory limit, bytes; by default half of the free memory.

    Returns
    -------
    OccupancyGrid or Costmap
        The map, or the costs on the scale of the message.

    Raises
    ------
    ParameterError
        If the extra ``bags`` is not installed, or `index` is out of range.
    FileAccessError, MalformedInputError
        If the bag cannot be read, or has no such topic.

    Warns
    -----
    MapdealWarning
        If the bag is damaged; the intact part is read.
    """
    settings = Settings(max_memory=max_memory)
    with settings.memory(), grid_topic(Path(path), topic, read_as=read_as) as found:
        return found.read(index).grid


def _is_of_costs(connection: Connection) -> bool:
    return _OF_COSTS in connection.topic.lower()


_SECONDS = 1e-9
_COMMANDS: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(GRID_TYPES, ("convert",)),
    LASER_SCAN: ("build", "local"),
    POINT_CLOUD: ("local",),
    ODOMETRY: ("build",),
    **dict.fromkeys(TF_TYPES, ("build", "local")),
}
"""Commands that accept the messages of a type."""


def describe_bag(path: Path, *, progress: ProgressCallback | None = None) -> dict[str, Any]:
    """Return what there is to know of a bag, as JSON can hold it."""
    # ``topics`` has a mapping for each topic: its type, the number of its messages, the times of
    # the first and the last (when they were recorded, nanoseconds), the frame of the first, and the
    # commands that take it. ``transforms`` has those between frames in /tf, with counts; ``use``
    # the command lines for what can be used.
    with open_bag(path) as bag:
        told = bag.summary()
        decoder = Decoder(bag)
        topics = list(_topics(bag, told, decoder))
        edges = _edges(bag, decoder, progress or report_nothing)
        whole = Recorded()
        for one in told.values():
            whole = whole.joined(one)
        if not whole.count:
            bag.remark("holds no messages")
        return {
            "file": str(path),
            "kind": "bag",
            "is": bag.form,
            "messages": whole.count,
            "start_ns": whole.first if whole.count else None,
            "end_ns": whole.last if whole.count else None,
            "duration_s": (whole.last - whole.first) * _SECONDS if whole.count else None,
            "topics": topics,
            "transforms": edges,
            "use": list(_uses(path, topics)),
        }


def _topics(bag: Bag, told: dict[int, Recorded], decoder: Decoder) -> Iterator[dict[str, Any]]:
    groups: dict[tuple[str, str], list[Connection]] = {}
    for one in bag.connections:
        groups.setdefault((one.topic, one.type), []).append(one)
    for (topic, name), ours in sorted(groups.items()):
        recorded = Recorded()
        for one in ours:
            recorded = recorded.joined(told[one.id])
        can_be_read = ours[0].encoding in CAN_BE_READ
        commands = list(_COMMANDS.get(name, ())) if can_be_read and recorded.count else []
        yield {
            "topic": topic,
            "type": ours[0].spelled,
            "count": recorded.count,
            "first_ns": recorded.first if recorded.count else None,
            "last_ns": recorded.last if recorded.count else None,
            "frame": _frame(bag, ours, decoder) if commands and name not in TF_TYPES else None,
            "commands": commands,
        }


def _frame(bag: Bag, connections: list[Connection], decoder: Decoder) -> str | None:
    """Return the frame of a topic's first message."""
    for one in connections:
        for piece in bag.pieces([one.id]):
            if len(piece):
                with suppress(MalformedInputError):
                    return decoder.header(piece[0])[1]
    return None


def _edges(bag: Bag, decoder: Decoder, progress: ProgressCallback) -> list[dict[str, Any]]:
    """Return how often each transform comes, those of odometry included."""
    ours = [one for one in bag.of_types(*TF_TYPES, ODOMETRY) if one.encoding in CAN_BE_READ]
    by_id = {one.id: one for one in ours}
    index = bag.index(by_id) if ours else ()
    found: Counter[tuple[str, str, str]] = Counter()
    with progress(len(index)) as advance:
        for place in index:
            one = by_id[place.connection]
            make = _odometry if one.type == ODOMETRY else transforms_of
            stamped = decoder.read(place, make)
            found.update((one.topic, of.parent, of.child) for of in stamped)
            advance(1)
    return [
        {"topic": topic, "parent": parent, "child": child, "count": count}
        for (topic, parent, child), count in sorted(found.items())
    ]


def _odometry(message: Any) -> list[Stamped]:
    return [odometry_of(message)]


def _uses(path: Path, topics: list[dict[str, Any]]) -> Iterator[str]:
    """Yield a command line for each kind of topic that there is."""
    name = shlex.quote(str(path))
    lines = {
        "convert": f"mapdeal convert {name} --topic {{}} -o OUT.yaml",
        "build": f"mapdeal build {name} --topic {{}} -o OUT.yaml",
        "local": f"mapdeal local --cloud {name} --topic {{}} -o DIR",
    }
    types = {"convert": GRID_TYPES, "build": (LASER_SCAN,), "local": (POINT_CLOUD,)}
    for command, line in lines.items():
        names = types[command]
        fitting = [
            one["topic"] for one in topics if one["count"] and normalised_type(one["type"]) in names
        ]
        if fitting:
            yield line.format(shlex.quote(fitting[0]))
