"""Opening bags of all kinds."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from importlib import import_module
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import NamedTuple

import numpy as np

from mapdeal.bags.bag import (
    CAN_BE_READ,
    METADATA,
    Bag,
    Connection,
    MessageIndex,
    Place,
    Recorded,
    expanded,
    normalised_topic,
    zstd_module,
)
from mapdeal.bags.chunked import MCAP_MAGIC, McapBag, Ros1Bag
from mapdeal.bags.sqlite import SQLITE_MAGIC, SqliteBag
from mapdeal.errors import MalformedInputError, ParameterError
from mapdeal.files.source import (
    access_to,
    check_expansion,
    check_readable,
    contents_of,
    exists,
    head_of,
    is_folder,
    status_of,
)
from mapdeal.files.transaction import temporary_folder
from mapdeal.files.yaml_text import Entry, YamlLimits, read_mapping
from mapdeal.inputs.listing import natural_key

_TOP_KEY = "rosbag2_bagfile_information"
_ZSTD_SUFFIXES = (".zstd", ".zst")

_LIMITS = YamlLimits(bytes=1 << 22, nodes=100_000, aliases=1000)
_STORAGES: dict[str, Callable[[Path], Bag]] = {"sqlite3": SqliteBag, "mcap": McapBag}
_KINDS: dict[bytes, Callable[[Path], Bag]] = {
    b"#ROSBAG V": Ros1Bag, b"#ROSRECORD V": Ros1Bag, b"#ROSLOG V": Ros1Bag,  # old ones, too
    MCAP_MAGIC: McapBag, SQLITE_MAGIC: SqliteBag,
}  # fmt: skip
_SUFFIXES = {".db3": "sqlite3", ".mcap": "mcap"}
_PIECE = 1 << 20
_NAMED = 12
_TOPICS = "topics_with_message_count"


class _Metadata(NamedTuple):
    """What ``metadata.yaml`` says of files, of their compression, and of topics."""

    storage: str
    files: tuple[str, ...]
    compression: str
    serializations: Mapping[str, str]


class FolderBag(Bag):
    # Topics, counts and times are those of the files. A file that is compressed as a whole is
    # expanded into a temporary folder, which goes with the bag.
    def __init__(self, path: Path) -> None:
        super().__init__(path, "a folder with a ROS 2 bag")
        self._stack = ExitStack()
        try:
            metadata = self._metadata()
            self._compresses_messages = metadata.compression == "message"
            self._parts = [
                self._stack.enter_context(self._opened(path / name, metadata.storage))
                for name in metadata.files
            ]
        except BaseException:
            self._stack.close()
            raise
        self._found: list[Connection] = []
        self._homes: list[tuple[Bag, int]] = []
        for part in self._parts:
            for one in part.connections:
                self._homes.append((part, one.id))
                said = metadata.serializations.get(one.topic, one.serialization)
                encoding = one.encoding if said == one.serialization else ""
                number = len(self._found)
                self._found.append(replace(one, id=number, encoding=encoding, serialization=said))

    @property
    def files(self) -> tuple[Path, ...]:
        metadata = self.path / METADATA
        return (*((metadata,) if exists(metadata) else ()), *(part.path for part in self._parts))

    @property
    def connections(self) -> Sequence[Connection]:
        return self._found

    def close(self) -> None:
        self._stack.close()

    def pieces(self, connections: Collection[int]) -> Iterator[MessageIndex]:
        for part in self._parts:
            numbers = {
                self._homes[one][1]: one for one in connections if self._homes[one][0] is part
            }
            if numbers:
                own = np.array(sorted(numbers), np.int64)
                ids = np.array([numbers[one] for one in own.tolist()], np.int64)
                for piece in part.pieces(numbers):
                    at = np.searchsorted(own, piece.connections)
                    yield replace(piece, connections=ids[at])

    def summary(self) -> dict[int, Recorded]:
        of_parts = {id(part): part.summary() for part in self._parts}
        return {number: of_parts[id(part)][own] for number, (part, own) in enumerate(self._homes)}

    def data(self, place: Place) -> bytes:
        part, own = self._homes[place.connection]
        data = part.data(place._replace(connection=own))
        return expanded(data, "zstd", None, self.path) if self._compresses_messages else data

    def _metadata(self) -> _Metadata:
        path = self.path / METADATA
        if not exists(path):
            return self._guessed(f"has no {METADATA}, as left by a recorder that was killed")
        top = read_mapping(path, _LIMITS).get(_TOP_KEY)
        fields = {} if top is None else top.fields()
        for key in ("storage_identifier", "relative_file_paths"):
            if key not in fields:
                place = _TOP_KEY if top is None else key
                raise MalformedInputError("missing", source=path, place=place)
        storage = _text_of(fields, "storage_identifier")
        if not storage:
            return self._guessed(f"{METADATA} names no storage, as ros2 bag reindex leaves it")
        if storage not in _STORAGES:
            raise fields["storage_identifier"].error("must be sqlite3 or mcap: others are not read")
        mode = _text_of(fields, "compression_mode").lower() or "none"
        form = _text_of(fields, "compression_format").lower()
        if mode not in ("none", "file", "message", "storage"):
            raise fields["compression_mode"].error("must be none, file or message")
        if mode in ("file", "message") and form != "zstd":
            raise fields["compression_mode"].error("can be read with compression_format zstd alone")
        names = self._present(fields["relative_file_paths"])
        return _Metadata(storage, names, mode, _serializations(fields))

    def _present(self, entry: Entry) -> tuple[str, ...]:
        """Return the names of the files that are there; older bags name them with folders."""
        paths = [PurePosixPath(PureWindowsPath(one.text()).as_posix()) for one in entry.items()]
        names, there = dict.fromkeys(path.name for path in paths), set(contents_of(self.path)[1])
        missing = [name for name in names if name not in there]
        if names and len(missing) == len(names):
            check_readable(self.path / missing[0])  # which says why not
        if missing:
            more = f" and {len(missing) - 1} more are" if len(missing) > 1 else " is"
            self.remark(f"its file {missing[0]}{more} missing; the others are read")
        return tuple(name for name in names if name in there)

    def _guessed(self, remark: str) -> _Metadata:
        names = sorted(contents_of(self.path)[1], key=natural_key)
        for suffix, storage in _SUFFIXES.items():
            found = [name for name in names if _plain(name).endswith(suffix)]
            if found:
                self.remark(remark)
                return _Metadata(storage, tuple(found), "none", {})
        raise self.malformed("is a folder without .db3 and .mcap files")

    @contextmanager
    def _opened(self, path: Path, storage: str) -> Iterator[Bag]:
        with _plain_file(path) as file, _STORAGES[storage](file) as bag:
            bag.path = path  # that errors name, and not a temporary one
            yield bag


@contextmanager
def _plain_file(path: Path) -> Iterator[Path]:
    """Yield a file that is not compressed as a whole: the file itself, or a temporary one."""
    if path.suffix.lower() not in _ZSTD_SUFFIXES:
        yield path
        return
    zstd = zstd_module()
    stored = status_of(path).st_size
    with temporary_folder() as folder:
        file = folder / path.stem
        with access_to(path), path.open("rb") as raw, file.open("wb") as out:
            try:
                with zstd.open(raw, "rb") as source:
                    length = 0
                    while piece := source.read(_PIECE):
                        length += len(piece)
                        check_expansion(path, stored, length, on_disk=True)
                        out.write(piece)
            except (zstd.ZstdError, EOFError) as error:
                rule = f"its compressed data are damaged: {error}"
                raise MalformedInputError(rule, source=path) from None
        yield file


def _serializations(fields: Mapping[str, Entry]) -> dict[str, str]:
    found = {}
    for one in fields[_TOPICS].items() if _TOPICS in fields else ():
        topic = one.fields().get("topic_metadata")
        of_topic = topic.fields() if topic is not None else {}
        if {"name", "serialization_format"} <= of_topic.keys():
            name = normalised_topic(of_topic["name"].text())
            found[name] = of_topic["serialization_format"].text()
    return found


def _text_of(fields: Mapping[str, Entry], key: str) -> str:
    return fields[key].text() if key in fields and not fields[key].is_nothing() else ""


def _plain(name: str) -> str:
    suffix = Path(name).suffix.lower()
    return name[: -len(suffix)] if suffix in _ZSTD_SUFFIXES else name


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
        hint = "pip install 'rosbags>=0.11'"
        raise ParameterError(f"needs the extra 'bags'{why}", source=source, hint=hint) from None


@contextmanager
def open_bag(path: Path) -> Iterator[Bag]:
    needs_bags(path)
    if path.name == METADATA:
        path = path.parent
    with ExitStack() as stack:
        if is_folder(path):
            bag: Bag = stack.enter_context(FolderBag(path))
        else:
            bag = stack.enter_context(_opened(path, stack.enter_context(_plain_file(path))))
            bag.path = path
        names = sorted({one.serialization for one in bag.connections})
        if names and not any(one.encoding in CAN_BE_READ for one in bag.connections):
            are = ", ".join(map(repr, names))
            raise bag.malformed(f"its messages are serialized as {are}; cdr and ros1 are read")
        yield bag


def _opened(path: Path, file: Path) -> Bag:
    head = head_of(file, 16)
    for magic, kind in _KINDS.items():
        if head.startswith(magic):
            return kind(file)
    rule = "is not a bag of ROS 1 or ROS 2" if head else "is empty"
    raise MalformedInputError(rule, source=path)


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
    text = ", ".join(named[:_NAMED])
    text += f" and {len(named) - _NAMED} more" if named[_NAMED:] else ""
    return MalformedInputError(rule, source=bag.path, hint=f"{before} {text}" if named else None)
