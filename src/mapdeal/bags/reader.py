"""Open bags of all formats: ROS 1, MCAP, SQLite, and folders of ROS 2."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path, PurePosixPath, PureWindowsPath

import numpy as np

from mapdeal import errors, records
from mapdeal.bags import bag as bags, chunked, sqlite
from mapdeal.files import source as sources, transaction, yaml_text
from mapdeal.grid.values import few_text
from mapdeal.maps.listing import natural_key

_TOP_KEY = "rosbag2_bagfile_information"
_ZSTD_SUFFIXES = (".zstd", ".zst")

_LIMITS = yaml_text.YamlLimits(bytes=1 << 22, nodes=100_000, aliases=1000)
_Opener = Callable[[Path], bags.Bag]
_STORAGES: dict[str, _Opener] = {"sqlite3": sqlite.SqliteBag, "mcap": chunked.McapBag}
_KINDS: dict[bytes, _Opener] = {
    b"#ROSBAG V": chunked.Ros1Bag, b"#ROSRECORD V": chunked.Ros1Bag, b"#ROSLOG V": chunked.Ros1Bag,
    chunked.MCAP_MAGIC: chunked.McapBag, sqlite.SQLITE_MAGIC: sqlite.SqliteBag,
}  # fmt: skip
_PIECE = 1 << 20
_MOST_NAMED = 12
_TOPICS = "topics_with_message_count"

_Metadata = tuple[str, tuple[str, ...], str, Mapping[str, str]]
"""Storage, files, compression, and serializations by topic, of ``metadata.yaml``."""


class FolderBag(bags.Bag):
    # Topics, counts and times are read from the files, not from the metadata. A compressed file is
    # decompressed into a temporary folder, which is deleted when the bag is closed.
    def __init__(self, path: Path) -> None:
        super().__init__(path, "a folder with a ROS 2 bag")
        self._stack = ExitStack()
        self._parts: list[bags.Bag] = []
        try:
            storage, names, compression, serializations = self._metadata()
            self._compresses_messages = compression == "message"
            for name in names:
                file = self._stack.enter_context(_plain_file(path / name))
                part = self._stack.enter_context(closing(_STORAGES[storage](file)))
                part.path = path / name  # errors name this file, not the temporary one
                self._parts.append(part)
        except BaseException:
            self._stack.close()
            raise
        metadata, paths = path / bags.METADATA, tuple(part.path for part in self._parts)
        self.files = (metadata, *paths) if sources.exists(metadata) else paths
        self.connections: list[bags.Connection] = []
        self._origins: list[tuple[bags.Bag, int]] = []
        for part in self._parts:
            for c in part.connections:
                self._origins.append((part, c.id))
                declared = serializations.get(c.topic, c.serialization)
                encoding = c.encoding if declared == c.serialization else ""
                number = len(self.connections)
                copy = records.replace(c, id=number, encoding=encoding, serialization=declared)
                self.connections.append(copy)

    def close(self) -> None:
        self._stack.close()

    def pieces(self, connections: Collection[int]) -> Iterator[bags.MessageIndex]:
        for part in self._parts:
            numbers = {self._origins[n][1]: n for n in connections if self._origins[n][0] is part}
            if numbers:
                part_ids = np.array(sorted(numbers), np.int64)
                ids = np.array([numbers[number] for number in part_ids.tolist()], np.int64)
                for piece in part.pieces(numbers):
                    indices = np.searchsorted(part_ids, piece.connections)
                    yield records.replace(piece, connections=ids[indices])

    def summary(self) -> dict[int, bags.MessageSpan]:
        summaries = {id(part): part.summary() for part in self._parts}
        return {n: summaries[id(part)][i] for n, (part, i) in enumerate(self._origins)}

    def read_message(self, place: bags.Place) -> bytes:
        part, part_id = self._origins[place.connection]
        data = part.read_message(place._replace(connection=part_id))
        return bags.decompress(data, "zstd", None, self.path) if self._compresses_messages else data

    def _metadata(self) -> _Metadata:
        path = self.path / bags.METADATA
        if not sources.exists(path):
            reason = f"has no {bags.METADATA}, as left by a recorder that was killed"
            return self._metadata_from_files(reason)
        top = yaml_text.read_mapping(path, _LIMITS).get(_TOP_KEY)
        fields = {} if top is None else top.fields()
        for key in ("storage_identifier", "relative_file_paths"):
            if key not in fields:
                place = _TOP_KEY if top is None else key
                raise errors.MalformedInputError("missing", source=path, place=place)
        if not (storage := _text_of(fields, "storage_identifier")):
            reason = f"{bags.METADATA} names no storage, as ros2 bag reindex leaves it"
            return self._metadata_from_files(reason)
        if storage not in _STORAGES:
            raise fields["storage_identifier"].error("must be sqlite3 or mcap")
        mode = _text_of(fields, "compression_mode").lower() or "none"
        compression = _text_of(fields, "compression_format").lower()
        if mode not in ("none", "file", "message", "storage"):
            raise fields["compression_mode"].error("must be none, file or message")
        if mode in ("file", "message") and compression != "zstd":
            raise fields["compression_mode"].error("requires compression_format zstd")
        names = self._present_files(fields["relative_file_paths"])
        return storage, names, mode, _serializations(fields)

    def _present_files(self, entry: yaml_text.Entry) -> tuple[str, ...]:
        paths = [PurePosixPath(PureWindowsPath(item.text()).as_posix()) for item in entry.items()]
        names = dict.fromkeys(path.name for path in paths)
        present = sources.contents_of(self.path)[1]
        missing = [name for name in names if name not in present]
        if names and len(missing) == len(names):
            sources.check_readable(self.path / missing[0])  # raises the error
        if missing:
            further = f" and {len(missing) - 1} more are" if len(missing) > 1 else " is"
            self.warn_once(f"its file {missing[0]}{further} missing; the others are read")
        return tuple(name for name in names if name in present)

    def _metadata_from_files(self, reason: str) -> _Metadata:
        names = sorted(sources.contents_of(self.path)[1], key=natural_key)
        for suffix, storage in {".db3": "sqlite3", ".mcap": "mcap"}.items():
            if files := [name for name in names if _plain(name).endswith(suffix)]:
                self.warn_once(reason)
                return storage, tuple(files), "none", {}
        raise self.malformed("is a folder without .db3 and .mcap files")


@contextmanager
def _plain_file(path: Path) -> Iterator[Path]:
    """Yield the file itself, or a temporary decompressed one if its suffix is zstd's."""
    if path.suffix.lower() not in _ZSTD_SUFFIXES:
        yield path
        return
    zstd = bags.zstd_module(path)
    stored = sources.status_of(path).st_size
    with transaction.temporary_folder() as folder:
        file = folder / path.stem
        with sources.access_to(path), path.open("rb") as raw, file.open("wb") as out:
            try:
                with zstd.open(raw, "rb") as source:
                    length = 0
                    while piece := source.read(_PIECE):
                        length += len(piece)
                        sources.check_expansion(path, stored, length, on_disk=True)
                        out.write(piece)
            except (zstd.ZstdError, EOFError) as error:
                rule = f"its compressed data are damaged: {error}"
                raise errors.MalformedInputError(rule, source=path) from None
        yield file


def _serializations(fields: Mapping[str, yaml_text.Entry]) -> dict[str, str]:
    serializations = {}
    for entry in fields[_TOPICS].items() if _TOPICS in fields else ():
        topic = entry.fields().get("topic_metadata")
        topic_fields = topic.fields() if topic is not None else {}
        if {"name", "serialization_format"} <= topic_fields.keys():
            name = bags.normalised_topic(topic_fields["name"].text())
            serializations[name] = topic_fields["serialization_format"].text()
    return serializations


def _text_of(fields: Mapping[str, yaml_text.Entry], key: str) -> str:
    return fields[key].text() if key in fields and not fields[key].is_nothing() else ""


def _plain(name: str) -> str:
    suffix = Path(name).suffix.lower()
    return name[: -len(suffix)] if suffix in _ZSTD_SUFFIXES else name


@contextmanager
def open_bag(path: Path) -> Iterator[bags.Bag]:
    if path.name == bags.METADATA:
        path = path.parent
    with ExitStack() as stack:
        if sources.is_folder(path):
            bag: bags.Bag = FolderBag(path)
        else:
            file = stack.enter_context(_plain_file(path))
            head = sources.head_of(file, 16)
            kind = next((kind for magic, kind in _KINDS.items() if head.startswith(magic)), None)
            if kind is None:
                rule = "is not a bag of ROS 1 or ROS 2" if head else "is empty"
                raise errors.MalformedInputError(rule, source=path)
            bag = kind(file)
            bag.path, bag.files = path, (path,)
        stack.enter_context(closing(bag))
        names = sorted({connection.serialization for connection in bag.connections})
        if names and not any(connection.encoding for connection in bag.connections):
            formats = ", ".join(map(repr, names))
            raise bag.malformed(f"its messages are serialized as {formats}; cdr and ros1 are read")
        yield bag


def select_connections(
    bag: bags.Bag, topics: Sequence[str], types: Sequence[str], kind: str
) -> list[bags.Connection]:
    if not bag.connections:
        raise bag.malformed("holds no messages")
    candidates = bag.of_types(*types)
    if not topics:
        if not (names := sorted({connection.topic for connection in candidates})):
            raise _error(bag, f"has no topic of {kind}", bag.connections, "its topics")
        if len(names) > 1:
            rule = f"has {len(names)} topics of {kind}"
            raise _error(bag, rule, candidates, "--topic names one of")
        topics = names
    chosen = []
    for topic in map(bags.normalised_topic, topics):
        same_topic = [connection for connection in bag.connections if connection.topic == topic]
        if not same_topic:
            raise _error(bag, f"has no topic {topic}", candidates or bag.connections, "there are")
        same_type = [connection for connection in same_topic if connection.type in types]
        if not same_type:
            rule = f"{topic} is of type {same_topic[0].spelled}; {kind} are of {' or '.join(types)}"
            raise _error(bag, rule, candidates, "there are")
        if not same_type[0].encoding:
            rule = f"{topic} is serialized as {same_type[0].serialization!r}; cdr and ros1 are read"
            raise bag.malformed(rule)
        chosen += same_type
    return chosen


def _error(bag: bags.Bag, rule: str, choices: Sequence[bags.Connection], label: str) -> Exception:
    topics = sorted({f"{connection.topic} ({connection.spelled})" for connection in choices})
    hint = f"{label} {few_text(topics, _MOST_NAMED)}" if topics else None
    return errors.MalformedInputError(rule, source=bag.path, hint=hint)
