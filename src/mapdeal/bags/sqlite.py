"""Bags of ROS 2 in SQLite files (``.db3``), also truncated ones.

References
----------
rosbag2_storage_sqlite3: tables ``topics`` and ``messages``, from its schema 4 on also
``message_definitions``.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Collection, Iterator
from contextlib import ExitStack, contextmanager
from itertools import islice
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

from mapdeal.bags.bag import Bag, Connection, MessageIndex, MessageSpan, Place
from mapdeal.errors import MalformedInputError
from mapdeal.files import source as sources, transaction

SQLITE_MAGIC = b"SQLite format 3\0"

_ROWS_TOGETHER = 1 << 14
_TOPIC_BYTES = 1000  # approximate memory of a topic besides its texts
_SMALLEST_PAGE = 512
_TOO_LONG, _TOO_BIG = "interrupted", "too big"  # in SQLite's messages when a limit is reached
_DESCRIPTIONS = {
    "not a database": "is not an SQLite file",
    "malformed": "is damaged, or cut",
    _TOO_LONG: "is damaged: its tables have more rows than fit into the file",
    _TOO_BIG: "a row needs more memory than may be used",
}
_LONGEST_ROW = 10**9  # bytes; SQLite's default
_STEPS = 1 << 14  # steps of SQLite between two calls of the progress handler
_STEPS_PER_BYTE = 8  # more than queries need: a row has about 20 bytes and needs about 50 steps
_ALLOWED = ("TABLE ", "INDEX ", "UNIQUE INDEX ")
_INTEGER = "CASE typeof({0}) WHEN 'integer' THEN {0} END"


class SqliteBag(Bag):
    def __init__(self, path: Path) -> None:
        super().__init__(path, "a ROS 2 bag (SQLite)")
        sources.check_readable(path)
        self._is_cut = False
        size = sources.status_of(path).st_size
        self._calls = self._most_calls = 64 + _STEPS_PER_BYTE * size // _STEPS
        self._stack = ExitStack()
        if sources.head_of(path, len(SQLITE_MAGIC)) != SQLITE_MAGIC:
            raise self.malformed("is not an SQLite file")
        with self._sqlite_errors():
            self._db = self._connect(path)
        try:
            with self._sqlite_errors():
                self.connections = self._read_all_connections()
                self._db.execute("PRAGMA cache_size = -16384")
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        self._db.close()
        self._stack.close()

    def pieces(self, connections: Collection[int]) -> Iterator[MessageIndex]:
        selected = ",".join(str(int(number)) for number in connections)
        # in a truncated file, listed rows may lack their data
        length = "LENGTH(data || '')" if self._is_cut else "0"
        time, row_id = _INTEGER.format("timestamp"), _INTEGER.format("id")
        query = f"SELECT topic_id, {time}, {row_id}, {length} FROM messages"  # noqa: S608
        try:
            cursor = self._select(f"{query} WHERE topic_id IN ({selected})")
            for rows in _batches(cursor):
                topics, times, ids, _ = np.array(rows, dtype=np.int64).T
                yield MessageIndex(topics, times, ids, np.zeros(len(ids), np.int64))
        except sqlite3.DatabaseError as error:
            if _TOO_LONG in str(error) or _TOO_BIG in str(error):
                raise self._error(error) from None
            if not self._is_cut:  # else `_read_all_connections` has warned
                self.warn_once(f"{_describe(error)}; the messages before that place are read")
        except (TypeError, ValueError, OverflowError):
            raise self.malformed("a time or topic of a message is not a whole number") from None

    def summary(self) -> dict[int, MessageSpan]:
        if self._is_cut:
            return super().summary()
        spans = {connection.id: MessageSpan() for connection in self.connections}
        ids = ",".join(map(str, spans))
        time = _INTEGER.format("timestamp")
        query = f"SELECT topic_id, COUNT(*), MIN({time}), MAX({time}) FROM messages"  # noqa: S608
        try:
            rows = self._select(f"{query} WHERE topic_id IN ({ids}) GROUP BY topic_id")
            spans |= {number: MessageSpan(*map(int, values)) for number, *values in rows}
        except (sqlite3.DatabaseError, TypeError, ValueError):
            return super().summary()  # reads up to the damage
        return spans

    def read_message(self, place: Place) -> bytes:
        source = "FROM messages WHERE id = ? AND typeof(data) = 'blob'"
        with self._sqlite_errors():
            row = self._select(f"SELECT length(data) {source}", place.block).fetchone()
        if row is None:
            raise self.malformed("a message has no data")
        sources.claim(self.path, 2 * row[0], what=f"{row[0]} bytes of a message")
        with self._sqlite_errors():
            (data,) = self._select(f"SELECT data {source}", place.block).fetchone()
        return bytes(data)

    def _select(self, query: str, *values: int) -> sqlite3.Cursor:
        """Start a query; limit its steps to what a file of this size can need."""
        self._calls = self._most_calls
        return self._db.execute(query, values)

    def _exceeds_steps(self) -> bool:
        self._calls -= 1
        return self._calls < 0

    def _connect(self, path: Path) -> sqlite3.Connection:
        # Immutable means that SQLite ignores locks, journals and write-ahead logs. While a recorder
        # runs, the log contains the latest messages, so a file with a log is opened read-only.
        has_log = sources.is_regular(path.with_name(path.name + "-wal"))
        mode = "mode=ro" if has_log else "immutable=1"
        address = f"file:{quote(str(sources.absolute_path(path)))}?{mode}"
        db = sqlite3.connect(address, uri=True, check_same_thread=False)
        db.text_factory = lambda text: text.decode("utf-8", "replace")
        db.set_progress_handler(self._exceeds_steps, _STEPS)
        if (most := sources.room()) is not None:
            db.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, min(most // 2, _LONGEST_ROW))
        db.execute("PRAGMA trusted_schema = OFF")
        return db

    def _read_all_connections(self) -> list[Connection]:
        try:
            if _bytes_after_last_page(self.path):
                raise sqlite3.DatabaseError
            return list(self._read_connections())
        except sqlite3.DatabaseError:
            self._db.close()
            self._db = self._connect(self._stack.enter_context(_whole_pages(self.path)))
            # SQLite then accepts fewer pages than the file's header declares
            self._db.execute("PRAGMA writable_schema = ON")
            self._is_cut = True
            found = list(self._read_connections())
            self.warn_once("is damaged, or cut; the intact part is read")
            return found

    def _read_connections(self) -> Iterator[Connection]:
        columns = self._columns()
        if not columns["topics"] or not columns["messages"]:
            rule = "is an SQLite file without the tables topics and messages of a ROS 2 bag"
            raise self.malformed(rule)
        if not columns["messages"].get("id"):  # each lookup would search the whole table
            raise self.malformed("table messages has no primary key id")
        texts: dict[str, str] = {}
        needed = {"topic_type", "encoding", "encoded_message_definition"}
        if columns["message_definitions"].keys() >= needed:
            query = "SELECT topic_type, encoding, encoded_message_definition"
            for name, encoding, text in self._rows(f"{query} FROM message_definitions"):
                if encoding == "ros2msg":
                    texts[name] = str(text)
        query = "SELECT id, name, type, serialization_format FROM topics ORDER BY id"
        known: set[int] = set()
        for number, topic, name, serialization in self._rows(query):
            if number in known:
                raise self.malformed(f"is damaged: topic {number} appears twice")
            known.add(int(number))
            yield Connection(
                int(number), str(topic), str(name), "cdr" if serialization == "cdr" else "",
                texts.get(name, ""), str(serialization),
            )  # fmt: skip

    def _columns(self) -> dict[str, dict[str, int]]:
        """Return each table's columns and their numbers in its key; refuse computed columns."""
        condition = " AND ".join(f"sql NOT LIKE 'CREATE {kind}%'" for kind in _ALLOWED)
        # checks the SQL texts, which SQLite uses: a hostile file's names and types may differ
        if self._select(f"SELECT 1 FROM sqlite_master WHERE {condition}").fetchone():  # noqa: S608
            raise self.malformed("contains a view, a trigger or a virtual table; a bag has none")
        columns = {}
        for table in ("topics", "messages", "message_definitions"):
            rows = self._select(f"PRAGMA table_xinfo({table})").fetchall()
            if any(hidden for *_, hidden in rows):
                raise self.malformed(f"table {table} has generated columns; that of a bag has none")
            columns[table] = {name: key for _, name, *_, key, _ in rows}
        return columns

    def _rows(self, query: str) -> Iterator[tuple[Any, ...]]:
        total = 0
        for row in self._select(query):
            texts = [value for value in row if isinstance(value, str | bytes)]
            total += _TOPIC_BYTES + 2 * sum(map(len, texts))
            sources.claim(self.path, total, what="the topics and types")
            yield row

    def _error(self, error: sqlite3.Error) -> MalformedInputError:
        malformed = self.malformed(_describe(error))
        if _TOO_BIG in str(error):
            malformed.hint = "--max-memory SIZE allows more, if that much is available"
        return malformed

    @contextmanager
    def _sqlite_errors(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.Error as error:
            raise self._error(error) from None
        except (TypeError, ValueError, OverflowError):
            raise self.malformed("is damaged: a table contains values of a wrong type") from None


@contextmanager
def _whole_pages(path: Path) -> Iterator[Path]:
    """Yield a file without an incomplete last page, which SQLite would fill with zeros."""
    if not (surplus := _bytes_after_last_page(path)):
        yield path
        return
    with transaction.temporary_folder() as folder:
        file, remaining = folder / "whole.db3", sources.status_of(path).st_size - surplus
        with sources.access_to(path), file.open("wb") as out:
            for chunk in sources.chunks_of(path):
                out.write(chunk[:remaining])
                remaining = max(0, remaining - len(chunk))
        yield file


def _bytes_after_last_page(path: Path) -> int:
    size = int.from_bytes(sources.head_of(path, 18)[16:18], "big")
    size = 1 << 16 if size == 1 else size
    return sources.status_of(path).st_size % size if size >= _SMALLEST_PAGE else 0


def _batches(cursor: sqlite3.Cursor) -> Iterator[list[tuple[Any, ...]]]:
    """Yield rows some at a time; before an error is raised, those that precede the damage."""
    while True:
        rows: list[tuple[Any, ...]] = []
        try:
            rows.extend(islice(cursor, _ROWS_TOGETHER))
        except sqlite3.DatabaseError:
            if rows:
                yield rows
            raise
        if not rows:
            return
        yield rows


def _describe(error: sqlite3.Error) -> str:
    text = str(error)
    known = (rule for phrase, rule in _DESCRIPTIONS.items() if phrase in text)
    return next(known, f"is damaged: {text}")
