"""Messages of bags from their bytes, by rosbags, with the types that the bag itself describes."""

from __future__ import annotations

import struct
from collections.abc import Callable
from functools import lru_cache
from typing import Any, TypeVar

from mapdeal.errors import MalformedInputError, ParameterError
from mapdeal.formats.bags.bag import Bag, Connection, Place
from mapdeal.formats.bags.messages import TF_TYPES
from mapdeal.formats.bags.reader import needs_bags
from mapdeal.formats.budget import claim

_T = TypeVar("_T")

_COSTMAP = """\
std_msgs/Header header
nav2_msgs/CostmapMetaData metadata
uint8[] data
"""
_COSTMAP_METADATA = """\
builtin_interfaces/Time map_load_time
builtin_interfaces/Time update_time
string layer
float32 resolution
uint32 size_x
uint32 size_y
geometry_msgs/Pose origin
"""

_SEPARATOR = "=" * 80
_LONGEST_DEFINITION = 100_000
"""Characters: those of the types that are read have some thousand."""
_LONGEST_ARRAYS = 10_000
_OF_ARRAYS, _OF_OBJECTS = 4, 30
"""Times the length of a message that it takes when it is decoded."""


class Decoder:
    """Makes messages of bytes."""

    # A type is what the bag says it is; where it says nothing, as before ROS 2 Iron, what the
    # latest ROS 2 has, which for the types that are asked for here has never changed.
    def __init__(self, bag: Bag) -> None:
        needs_bags(bag.path)
        self._bag = bag
        self._connections = {one.id: one for one in bag.connections}
        self._readers: dict[int, Callable[[bytes], Any]] = {}

    def message(self, place: Place) -> Any:
        reader = self._readers.get(place.connection)
        if reader is None:
            reader = self._reader_of(self._connections[place.connection])
            self._readers[place.connection] = reader
        data = self._bag.data(place)
        has_objects = self._connections[place.connection].type in TF_TYPES
        needed = (_OF_OBJECTS if has_objects else _OF_ARRAYS) * len(data)
        claim(self._bag.path, needed, what=f"the {len(data)} bytes of a message")
        try:
            return reader(data)
        except Exception as error:  # noqa: BLE001 - decoders of damaged bytes fail in many ways
            one = self._connections[place.connection]
            rule = f"a message at {place.time} ns is not a valid {one.type}"
            rule += f": {error or type(error).__name__}"
            raise self._bag.malformed(rule, one.topic) from None

    def read(self, place: Place, make: Callable[[Any], _T]) -> _T:
        message = self.message(place)
        topic = self._connections[place.connection].topic
        try:
            return make(message)
        except ParameterError as error:
            raise error.in_file(self._bag.path, topic) from None
        except MalformedInputError as error:
            if error.source is None:
                error.place = ": ".join(part for part in (topic, error.place) if part)
            raise error.found_in(self._bag.path) from None
        except (AttributeError, TypeError, ValueError, OverflowError) as error:
            name = self._connections[place.connection].type
            raise self._bag.malformed(f"the bag has another {name}: {error}", topic) from None

    def header(self, place: Place) -> tuple[int, str]:
        """Return time (nanoseconds) and frame of the header of the message at a place."""
        # The rest of the message is not decoded.
        data = self._bag.data(place)
        if self._connections[place.connection].encoding == "ros1":
            order, start = "<", 4  # behind the number
        else:
            order, start = ("<" if data[1:2] == b"\x01" else ">"), 4  # behind the byte order
        try:
            seconds, nanoseconds, length = struct.unpack_from(f"{order}III", data, start)
            frame = data[start + 12 : start + 12 + length]
            if len(frame) < length:
                raise ValueError
            text = frame.rstrip(b"\0").decode()
        except (struct.error, ValueError):
            topic = self._connections[place.connection].topic
            rule = f"a message at {place.time} ns has no header"
            raise self._bag.malformed(rule, topic) from None
        return seconds * 10**9 + nanoseconds, text.lstrip("/")

    def _reader_of(self, connection: Connection) -> Callable[[bytes], Any]:
        store, name = self._store_of(connection), connection.type
        if connection.encoding == "ros1":
            return lambda data: store.deserialize_ros1(data, name)
        return lambda data: store.deserialize_cdr(data, name)

    def _store_of(self, connection: Connection) -> Any:
        try:
            store = _store(connection.type, connection.definition, connection.is_idl)
            if connection.type not in store.fielddefs:
                rule = f"its type {connection.type} has no definition"
                raise self._bag.malformed(rule, connection.topic)
        except Exception as error:  # noqa: BLE001 - parsers of damaged texts fail in many ways
            rule = f"its type {connection.type} cannot be parsed: {error}"
            raise self._bag.malformed(rule, connection.topic) from None
        return store


@lru_cache(maxsize=32)  # of all bags: the readers that a store makes take longer than most messages
def _store(name: str, definition: str, is_idl: bool) -> Any:
    """Return the types of a definition, or those of the latest ROS 2 if there is none."""
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    if not definition:
        store = get_typestore(Stores.LATEST)
        store.register(costmap_types())
        return store
    if len(definition) > _LONGEST_DEFINITION:
        raise ValueError(f"{len(definition)} characters, the limit is {_LONGEST_DEFINITION}")
    store = get_typestore(Stores.EMPTY)
    if is_idl:
        found = [get_types_from_idl(text) for text in _idl_parts(definition)]
    else:
        found = [get_types_from_msg(definition, name)]
    for types in found:
        _check_arrays(types)
        store.register(types)
    return store


def _check_arrays(types: Any) -> None:
    """Refuse arrays of fixed lengths for which rosbags would write endless code, or none."""
    from rosbags.interfaces import Nodetype

    lengths = [
        inner[1]
        for _, fields in types.values()
        for _, (kind, inner) in fields
        if kind == Nodetype.ARRAY
    ]
    if min(lengths, default=1) < 1 or sum(lengths) > _LONGEST_ARRAYS:
        rule = f"fixed lengths of arrays must be 1 or more, and {_LONGEST_ARRAYS} together at most"
        raise ValueError(rule)


def costmap_types() -> Any:
    """Return the types of a costmap of Nav2, which rosbags does not have."""
    from rosbags.typesys import get_types_from_msg

    types = get_types_from_msg(_COSTMAP, "nav2_msgs/msg/Costmap")
    return types | get_types_from_msg(_COSTMAP_METADATA, "nav2_msgs/msg/CostmapMetaData")


def _idl_parts(text: str) -> list[str]:
    if not text.startswith(f"{_SEPARATOR}\nIDL: "):
        return [text]
    return [part.split("\n", 1)[1] for part in text.split(f"{_SEPARATOR}\n")[1:]]
