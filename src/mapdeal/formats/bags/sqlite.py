"""Bags of ROS 2 in SQLite files (``.db3``), also cut ones.

References
----------
rosbag2_storage_sqlite3: tables ``topics`` and ``messages``, from its schema 4 on also
``message_definitions``.
"""

from __future__ import annotations

import sqlite3
import tempfile
from collections.abc import Collection, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

from mapdeal.formats.bags.bag import (
    Bag,
    Connection,
    MessageIndex,
    Place,
    Recorded,
    normalised_topic,
    normalised_type,
)
from mapdeal.formats.source import (
    absolute_path,
    access_to,
    check_readable,
    chunks_of,
    exists,
    head_of,
    status_of,
)

MAGIC = b"SQLite format 3\0"

_ROWS_TOGETHER = 1 << 14
_SMALLEST_PAGE = 512
_SMALL_CACHE = "PRAGMA cache_size = -16384"
_WORDS = {"not a database": "is not an SQLite file", "malformed": "is damaged, or cut"}


class SqliteBag(Bag):
    """A ROS 2 bag in one SQLite file.

    Parameters
    ----------
    path : Path
        The file; it is opened for reading only, and nothing is written beside it.

    Raises
    ------
    FileAccessError
        If it cannot be read.
    MalformedInputError
        If it is no bag, or too damaged to know its topics.

    Warns
    -----
    MapdealWarning
        If messages behind a damaged place cannot be read.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, "a ROS 2 bag (SQLite)")
        check_readable(path)
        self._is_cut = False
        self._stack = ExitStack()
        with self._damage():
            self._db = self._connected(path)
        try:
            with self._damage():
                self._found = tuple(self._read_all_connections())
                self._db.execute(_SMALL_CACHE)
        except BaseException:
            self.close()
            raise

    @property
    def connections(self) -> Sequence[Connection]:
        """All connections; see `Bag`."""
        return self._found

    def close(self) -> None:
        """Close the file."""
        self._db.close()
        self._stack.close()

    def pieces(self, connections: Collection[int]) -> Iterator[MessageIndex]:
        """Yield the places of all messages of some connections; see `Bag`."""
        wanted = ",".join(str(int(one)) for one in connections)
        # what of a cut file has a place in its tables need not have its data
        data = "LENGTH(data || '')" if self._is_cut else "0"
        query = f"SELECT topic_id, timestamp, id, {data} FROM messages"  # noqa: S608
        try:
            cursor = self._db.execute(f"{query} WHERE topic_id IN ({wanted})")
            while rows := list(_until_damage(cursor, self._is_cut)):
                topics, times, ids, _ = np.array(rows, dtype=np.int64).T
                yield MessageIndex(topics, times, ids, np.zeros(len(ids), np.int64))
        except sqlite3.DatabaseError as error:
            self.remark(f"{_told(error)}; the messages before that place are read")
        except (TypeError, ValueError, OverflowError):
            raise self.malformed("a time or topic of a message is not a whole number") from None

    def summary(self) -> dict[int, Recorded]:
        """Return how many messages each connection has, and when; see `Bag`."""
        if self._is_cut:
            return super().summary()
        query = "SELECT topic_id, COUNT(*), MIN(timestamp), MAX(timestamp) FROM messages"
        try:
            rows = self._db.execute(f"{query} GROUP BY topic_id").fetchall()
            found = {number: Recorded(*map(int, told)) for number, *told in rows}
        except (sqlite3.DatabaseError, TypeError, ValueError):
            return super().summary()  # up to the damaged place
        return {one.id: found.get(one.id, Recorded()) for one in self._found}

    def data(self, place: Place) -> bytes:
        """Return a message as it was serialized; see `Bag`."""
        with self._damage():
            row = self._db.execute("SELECT data FROM messages WHERE id = ?", (place.block,))
            (found,) = row.fetchone() or (None,)
        if not isinstance(found, bytes):
            raise self.malformed("a message has no data")
        return found

    def _connected(self, path: Path) -> sqlite3.Connection:
        # Immutable: no lock, no journal, and files of others are not looked for. Recordings that
        # still run have some of their messages in such a file.
        how = "mode=ro" if exists(path.with_name(path.name + "-wal")) else "immutable=1"
        address = f"file:{quote(str(absolute_path(path)))}?{how}"
        db = sqlite3.connect(address, uri=True, check_same_thread=False)
        db.text_factory = lambda text: text.decode("utf-8", "replace")
        return db

    def _read_all_connections(self) -> Iterator[Connection]:
        try:
            if _rest_of_pages(self.path):
                raise sqlite3.DatabaseError
            yield from list(self._read_connections())
        except sqlite3.DatabaseError:
            self._db.close()
            self._db = self._connected(self._stack.enter_context(_whole_pages(self.path)))
            # SQLite then takes the pages that a cut file has, and not those that its head counts
            self._db.execute("PRAGMA writable_schema = ON")
            self._is_cut = True
            found = list(self._read_connections())
            self.remark("is damaged, or cut; the intact part is read")
            yield from found

    def _read_connections(self) -> Iterator[Connection]:
        names = {row[0] for row in self._db.execute("SELECT name FROM sqlite_master")}
        if not {"topics", "messages"} <= names:
            rule = "is an SQLite file without the tables topics and messages of a ROS 2 bag"
            raise self.malformed(rule)
        texts: dict[str, tuple[str, bool]] = {}
        if "message_definitions" in names:
            query = "SELECT topic_type, encoding, encoded_message_definition"
            with suppress(sqlite3.OperationalError):  # a table of other columns
                for name, encoding, text in self._db.execute(f"{query} FROM message_definitions"):
                    if encoding in ("ros2msg", "ros2idl"):
                        texts[name] = (str(text), encoding == "ros2idl")
        rows: list[tuple[Any, ...]] = self._db.execute(
            "SELECT id, name, type, serialization_format FROM topics ORDER BY id"
        ).fetchall()
        for number, topic, name, serialization in rows:
            text, is_idl = texts.get(name, ("", False))
            yield Connection(
                int(number),
                normalised_topic(str(topic)),
                normalised_type(str(name)),
                "cdr" if serialization == "cdr" else "",
                text,
                is_idl,
                str(serialization),
                str(name),
            )

    @contextmanager
    def _damage(self) -> Iterator[None]:
        """Turn what SQLite raises into one error that names the file."""
        try:
            yield
        except sqlite3.Error as error:
            raise self.malformed(_told(error)) from None
        except (TypeError, ValueError, OverflowError):
            raise self.malformed("is damaged: a table holds what it must not") from None


@contextmanager
def _whole_pages(path: Path) -> Iterator[Path]:
    """Yield a file without an incomplete last page, which SQLite would fill with zeros."""
    rest = _rest_of_pages(path)
    if not rest:
        yield path
        return
    with tempfile.TemporaryDirectory(prefix="mapdeal-") as folder:
        file, left = Path(folder) / "whole.db3", status_of(path).st_size - rest
        with access_to(path), file.open("wb") as out:
            for chunk in chunks_of(path):
                out.write(chunk[:left])
                left = max(0, left - len(chunk))
        yield file


def _rest_of_pages(path: Path) -> int:
    """Return how many bytes of a file come behind its last whole page: none, if it is whole."""
    size = int.from_bytes(head_of(path, 18)[16:18], "big")
    size = 1 << 16 if size == 1 else size
    return status_of(path).st_size % size if size >= _SMALLEST_PAGE else 0


def _until_damage(cursor: sqlite3.Cursor, is_cut: bool) -> Iterator[tuple[Any, ...]]:
    """Yield some rows; of a cut file those before the damage."""
    try:
        for _ in range(_ROWS_TOGETHER):
            row = cursor.fetchone()
            if row is None:
                return
            yield row
    except sqlite3.DatabaseError:
        if not is_cut:
            raise


def _told(error: sqlite3.Error) -> str:
    text = str(error)
    return next((told for words, told in _WORDS.items() if words in text), f"is damaged: {text}")
