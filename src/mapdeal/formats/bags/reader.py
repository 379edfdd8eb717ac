"""Opening bags of all kinds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path

from mapdeal.errors import MalformedInputError, ParameterError
from mapdeal.formats.bags.bag import CAN_BE_READ, Bag, Connection, normalised_topic
from mapdeal.formats.bags.folder import METADATA, FolderBag, plain_file
from mapdeal.formats.bags.mcap import MAGIC as MCAP_MAGIC
from mapdeal.formats.bags.mcap import McapBag
from mapdeal.formats.bags.ros1 import Ros1Bag
from mapdeal.formats.bags.sqlite import MAGIC as SQLITE_MAGIC
from mapdeal.formats.bags.sqlite import SqliteBag
from mapdeal.formats.source import head_of, is_folder


def needs_bags(source: Path | str, *modules: str) -> None:
    """Import rosbags' types, and other modules of it."""
    try:
        for module in ("rosbags.typesys", *modules):
            import_module(module)
    except ImportError as error:
        if error.path and not error.path.endswith(".py"):
            raise  # it is installed, and the system has no room for it
        missing = (error.name or "").partition(".")[0] in ("rosbags", "")
        why = "" if missing else f" ({error})"
        hint = "pip install 'mapdeal[bags]'"
        raise ParameterError(f"needs the extra 'bags'{why}", source=source, hint=hint) from None


_NAMED = 12


@contextmanager
def open_bag(path: Path) -> Iterator[Bag]:
    """Open a bag for reading within a ``with`` block."""
    needs_bags(path)
    if path.name == METADATA:
        path = path.parent
    if is_folder(path):
        with FolderBag(path) as bag:
            _check_serialization(bag)
            yield bag
        return
    with plain_file(path) as file, _opened(path, file) as bag:
        bag.path = path
        _check_serialization(bag)
        yield bag


def _opened(path: Path, file: Path) -> Bag:
    head = head_of(file, 16)
    if head.startswith(b"#ROSBAG V"):
        return Ros1Bag(file)
    if head.startswith(MCAP_MAGIC):
        return McapBag(file)
    if head.startswith(SQLITE_MAGIC):
        return SqliteBag(file)
    if not head:
        raise MalformedInputError("is empty", source=path)
    raise MalformedInputError("is not a bag of ROS 1 or ROS 2", source=path)


def _check_serialization(bag: Bag) -> None:
    """Refuse a bag of which nothing can be read."""
    names = sorted({one.serialization for one in bag.connections})
    if names and not any(one.encoding in CAN_BE_READ for one in bag.connections):
        raise bag.malformed(
            f"its messages are serialized as {', '.join(map(repr, names))}; cdr and ros1 are read"
        )


def chosen_connections(
    bag: Bag, topics: Sequence[str], types: Sequence[str], what: str
) -> list[Connection]:
    if not bag.connections:
        raise bag.malformed("holds no messages")
    fitting = bag.of_types(*types)
    if not topics:
        names = sorted({one.topic for one in fitting})
        if not names:
            raise _error(bag, f"has no topic of {what}", bag.connections, "its topics")
        if len(names) > 1:
            rule = f"has {len(names)} topics of {what}"
            raise _error(bag, rule, fitting, "--topic names one of")
        topics = names
    found = []
    for topic in map(normalised_topic, topics):
        ours = [one for one in bag.connections if one.topic == topic]
        if not ours:
            raise _error(bag, f"has no topic {topic}", fitting or bag.connections, "there are")
        fits = [one for one in ours if one.type in types]
        if not fits:
            rule = f"{topic} is of type {ours[0].spelled}; {what} are of {' or '.join(types)}"
            raise _error(bag, rule, fitting, "there are")
        if fits[0].encoding not in CAN_BE_READ:
            rule = f"{topic} is serialized as {fits[0].serialization!r}; cdr and ros1 are read"
            raise bag.malformed(rule)
        found += fits
    return found


def _error(bag: Bag, rule: str, connections: Sequence[Connection], before: str) -> Exception:
    named = sorted({f"{one.topic} ({one.spelled})" for one in connections})
    text = ", ".join(named[:_NAMED]) + (
        f" and {len(named) - _NAMED} more" if named[_NAMED:] else ""
    )
    return MalformedInputError(rule, source=bag.path, hint=f"{before} {text}" if named else None)
