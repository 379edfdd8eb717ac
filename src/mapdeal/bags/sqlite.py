"""Bags of ROS 2 in SQLite files (``.db3``), also cut ones.

References
----------
rosbag2_storage_sqlite3: tables ``topics`` and ``messages``, from its schema 4 on also
``message_definitions``.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Collection, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from itertools import islice
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

from mapdeal.bags.bag import Bag, Connection, MessageIndex, Place, Recorded
from mapdeal.errors import MalformedInputError
from mapdeal.files.source import (
    absolute_path,
    access_to,
    check_readable,
    chunks_of,
    claim,
    head_of,
    is_regular,
    room,
    status_of,
)
from mapdeal.files.transaction import temporary_folder

SQLITE_MAGIC = b"SQLite format 3\0"

_ROWS_TOGETHER = 1 << 14
_ROW = 1000  # bytes of a topic besides its texts, about
_SMALLEST_PAGE = 512
_SMALL_CACHE = "PRAGMA cache_size = -16384"
_ENDLESS, _TOO_BIG = "interrupted", "too big"  # what SQLite says when a limit is reached
_WORDS = {
    "not a database": "is not an SQLite file",
    "malformed": "is damaged, or cut",
    _ENDLESS: "is damaged: its tables have more rows than fit into the file",
    _TOO_BIG: "a row needs more memory than may be used",
}
_LONGEST = 10**9  # bytes of a row, as SQLite has it by itself
_LOOK = 1 << 14  # steps of SQLite between two looks at how many it has taken
_STEPS_PER_BYTE = 8  # more than a query takes: a row has some 20 bytes, and takes some 50 steps
_PLAIN = ("TABLE ", "INDEX ", "UNIQUE INDEX ")
_WHOLE = "CASE typeof({0}) WHEN 'integer' THEN {0} END"


class SqliteBag(Bag):
    def __init__(self, path: Path) -> None:
        super().__init__(path, "a ROS 2 bag (SQLite)")
        check_readable(path)
        self._is_cut = False
        self._looks = self._most_looks = 64 + _STEPS_PER_BYTE * status_of(path).st_size // _LOOK
        self._stack = ExitStack()
        if head_of(path, len(SQLITE_MAGIC)) != SQLITE_MAGIC:
            raise self.malformed("is not an SQLite file")
        with self._damage():
            self._db = self._connected(path)
        try:
            with self._damage():
                self._found = self._read_all_connections()
                self._db.execute(_SMALL_CACHE)
        except BaseException:
            self.close()
            raise

    @property
    def connections(self) -> Sequence[Connection]:
        return self._found

    def close(self) -> None:
        self._db.close()
        self._stack.close()

    def pieces(self, connections: Collection[int]) -> Iterator[MessageIndex]:
        wanted = ",".join(str(int(one)) for one in connections)
        # what of a cut file has a place in its tables need not have its data
        data = "LENGTH(data || '')" if self._is_cut else "0"
        time, number = _WHOLE.format("timestamp"), _WHOLE.format("id")
        query = f"SELECT topic_id, {time}, {number}, {data} FROM messages"  # noqa: S608
        try:
            cursor = self._select(f"{query} WHERE topic_id IN ({wanted})")
            while rows := list(_until_damage(cursor, self._is_cut)):
                topics, times, ids, _ = np.array(rows, dtype=np.int64).T
                yield MessageIndex(topics, times, ids, np.zeros(len(ids), np.int64))
        except sqlite3.DatabaseError as error:
            if _ENDLESS in str(error) or _TOO_BIG in str(error):
                raise self._error(error) from None
            self.remark(f"{_told(error)}; the messages before that place are read")
        except (TypeError, ValueError, OverflowError):
            raise self.malformed("a time or topic of a message is not a whole number") from None

    def summary(self) -> dict[int, Recorded]:
        if self._is_cut:
            return super().summary()
        found = {one.id: Recorded() for one in self._found}
        wanted = ",".join(map(str, found))
        time = _WHOLE.format("timestamp")
        query = f"SELECT topic_id, COUNT(*), MIN({time}), MAX({time}) FROM messages"  # noqa: S608
        try:
            rows = self._select(f"{query} WHERE topic_id IN ({wanted}) GROUP BY topic_id")
            found |= {number: Recorded(*map(int, told)) for number, *told in rows}
        except (sqlite3.DatabaseError, TypeError, ValueError):
            return super().summary()  # up to the damaged place
        return found

    def data(self, place: Place) -> bytes:
        of_place = "FROM messages WHERE id = ? AND typeof(data) = 'blob'"
        with self._damage():
            told = self._select(f"SELECT length(data) {of_place}", place.block).fetchone()
        if told is None:
            raise self.malformed("a message has no data")
        claim(self.path, 2 * told[0], what=f"{told[0]} bytes of a message")
        with self._damage():
            (found,) = self._select(f"SELECT data {of_place}", place.block).fetchone()
        return bytes(found)

    def _select(self, query: str, *values: int) -> sqlite3.Cursor:
        """Start a query, which gets as many steps as a file of this size can need."""
        self._looks = self._most_looks
        return self._db.execute(query, values)

    def _stops(self) -> bool:
        """Return whether a query goes on for too long: pages may lead back to each other."""
        self._looks -= 1
        return self._looks < 0

    def _connected(self, path: Path) -> sqlite3.Connection:
        # Immutable: no lock, no journal, and files of others are not looked for. Recordings that
        # still run have some of their messages in such a file.
        how = "mode=ro" if is_regular(path.with_name(path.name + "-wal")) else "immutable=1"
        address = f"file:{quote(str(absolute_path(path)))}?{how}"
        db = sqlite3.connect(address, uri=True, check_same_thread=False)
        db.text_factory = lambda text: text.decode("utf-8", "replace")
        db.set_progress_handler(self._stops, _LOOK)
        most = room()
        if most is not None:
            db.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, min(most // 2, _LONGEST))
        db.execute("PRAGMA trusted_schema = OFF")
        return db

    def _read_all_connections(self) -> list[Connection]:
        try:
            if _rest_of_pages(self.path):
                raise sqlite3.DatabaseError
            return list(self._read_connections())
        except sqlite3.DatabaseError:
            self._db.close()
            self._db = self._connected(self._stack.enter_context(_whole_pages(self.path)))
            # SQLite then takes the pages that a cut file has, and not those that its head counts
            self._db.execute("PRAGMA writable_schema = ON")
            self._is_cut = True
            found = list(self._read_connections())
            self.remark("is damaged, or cut; the intact part is read")
            return found

    def _read_connections(self) -> Iterator[Connection]:
        columns = self._columns()
        if not columns["topics"] or not columns["messages"]:
            rule = "is an SQLite file without the tables topics and messages of a ROS 2 bag"
            raise self.malformed(rule)
        if not columns["messages"].get("id"):  # each would be searched for among all others
            raise self.malformed("table messages has no primary key id")
        texts: dict[str, tuple[str, bool]] = {}
        needed = {"topic_type", "encoding", "encoded_message_definition"}
        if columns["message_definitions"].keys() >= needed:
            query = "SELECT topic_type, encoding, encoded_message_definition"
            for name, encoding, text in self._rows(f"{query} FROM message_definitions"):
                if encoding in ("ros2msg", "ros2idl"):
                    texts[name] = (str(text), encoding == "ros2idl")
        query = "SELECT id, name, type, serialization_format FROM topics ORDER BY id"
        seen: set[int] = set()
        for number, topic, name, serialization in self._rows(query):
            if number in seen:
                raise self.malformed(f"is damaged: topic {number} is there twice")
            seen.add(int(number))
            text, is_idl = texts.get(name, ("", False))
            yield Connection(
                int(number), str(topic), str(name), "cdr" if serialization == "cdr" else "",
                text, is_idl, str(serialization),
            )  # fmt: skip

    def _columns(self) -> dict[str, dict[str, int]]:
        """Return the columns of each table, by their numbers in its key; none are computed."""
        others = " AND ".join(f"sql NOT LIKE 'CREATE {one}%'" for one in _PLAIN)
        # by their texts, which SQLite goes by: names and types beside them may be lies
        if self._select(f"SELECT 1 FROM sqlite_master WHERE {others}").fetchone():  # noqa: S608
            raise self.malformed("contains a view, a trigger or a virtual table; a bag has none")
        found = {}
        for table in ("topics", "messages", "message_definitions"):
            rows = self._select(f"PRAGMA table_xinfo({table})").fetchall()
            if any(hidden for *_, hidden in rows):
                raise self.malformed(f"table {table} has generated columns; that of a bag has none")
            found[table] = {name: key for _, name, *_, key, _ in rows}
        return found

    def _rows(self, query: str) -> Iterator[tuple[Any, ...]]:
        """Yield rows that are kept, as long as there is memory for them."""
        taken = 0
        for row in self._select(query):
            taken += _ROW + 2 * sum(len(value) for value in row if isinstance(value, str | bytes))
            claim(self.path, taken, what="the topics and types")
            yield row

    def _error(self, error: sqlite3.Error) -> MalformedInputError:
        found = self.malformed(_told(error))
        if _TOO_BIG in str(error):
            found.hint = "--max-memory SIZE allows more, if that much is available"
        return found

    @contextmanager
    def _damage(self) -> Iterator[None]:
        """Turn what SQLite raises into one error that names the file."""
        try:
            yield
        except sqlite3.Error as error:
            raise self._error(error) from None
        except (TypeError, ValueError, OverflowError):
            raise self.malformed("is damaged: a table holds what it must not") from None


@contextmanager
def _whole_pages(path: Path) -> Iterator[Path]:
    """Yield a file without an incomplete last page, which SQLite would fill with zeros."""
    rest = _rest_of_pages(path)
    if not rest:
        yield path
        return
    with temporary_folder() as folder:
        file, left = folder / "whole.db3", status_of(path).st_size - rest
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
        yield from islice(cursor, _ROWS_TOGETHER)
    except sqlite3.DatabaseError as error:
        if not is_cut or _ENDLESS in str(error):
            raise


def _told(error: sqlite3.Error) -> str:
    text = str(error)
    return next((told for words, told in _WORDS.items() if words in text), f"is damaged: {text}")
