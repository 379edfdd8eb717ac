# ruff: noqa: S608 - all statements are those of the tests
"""Bags that compute, expand or refer elsewhere: an error soon, and no memory beyond the limit."""

import bz2
import contextlib
import os
import shutil
import sqlite3
import struct
from pathlib import Path

import lz4.frame
import numpy as np
import pytest

from bags.making import START, Maker, occupancy, ros2_store, scan, tf
from cli.test_memory_of_commands import measured
from mapdeal import FileAccessError, MalformedInputError, MapdealWarning
from mapdeal.bags.bag import zstd_module
from mapdeal.bags.chunked import ChunkCache
from mapdeal.bags.messages import Decoder
from mapdeal.bags.reader import open_bag
from mapdeal.bags.sqlite import SqliteBag
from mapdeal.files.source import use_memory

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("mapdeal_warnings")]

LIMIT = 90_000_000
MAGIC = b"\x89MCAP0\r\n"
COUNT = "WITH RECURSIVE c(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM c)"
NO_VIEWS = "contains a view, a trigger or a virtual table"


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    maker = Maker()
    for k in range(30):
        grid = occupancy(START, np.zeros((20, 30)), 0.05, (1.5, -2.25, 0.5))
        maker.add("/map", "nav_msgs/msg/OccupancyGrid", START + k, grid)
        moved = tf(START + k, ("odom", "laser", (k, 0, 0), (0, 0, 0, 1)))
        maker.add("/tf", "tf2_msgs/msg/TFMessage", START + k, moved)
    return maker.write(tmp_path_factory.mktemp("bag"), "sqlite3") / "bag.db3"


@pytest.fixture
def changed(written, tmp_path):
    """Return a function that copies that bag and changes it by SQL statements."""

    def change(*statements):
        path = shutil.copy(written, tmp_path / "a.db3")
        db = sqlite3.connect(path, isolation_level=None)
        for statement in statements:
            db.execute(statement)
        db.close()
        return path

    return change


def read_all(path, limit=LIMIT):
    """Decode all messages of a bag, as commands do, and return their number."""
    with use_memory(limit), open_bag(path) as bag:
        summary = bag.summary()
        decoder, index = Decoder(bag), bag.index(summary)
        for place in index:
            decoder.message(place)
        assert sum(recorded.count for recorded in summary.values()) == len(index)
        return len(index)


def refused(path, rule, limit=LIMIT):
    with pytest.raises(MalformedInputError, match=rule):
        read_all(path, limit)


MESSAGES = "id, topic_id, timestamp, data"
DEFINED = "topic_type, encoding, encoded_message_definition"
ENDLESS = f"CREATE VIEW messages({MESSAGES}) AS {COUNT} SELECT n, 1, n, 0 FROM c"
LONG = "CAST(zeroblob(40000000) AS TEXT)"
LONG_TEXTS = "'a/msg/T' || n, 'ros2msg', hex(zeroblob(1000000))"
OTHER_TABLE = "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp, data)"
ROWS = f"INSERT INTO messages SELECT n, 1, hex(zeroblob(999)), 0 FROM ({COUNT} SELECT n FROM c"
GENERATED = {
    "messages": "topic_id INTEGER, timestamp INTEGER, data BLOB",
    "message_definitions": "topic_type TEXT, encoding TEXT, encoded_message_definition TEXT",
}


def generated(table, storage):
    columns = f"id INTEGER PRIMARY KEY, {GENERATED[table]} AS (zeroblob(900000000)) {storage}"
    return f"DROP TABLE IF EXISTS {table}", f"CREATE TABLE {table}({columns})"


OF_VIEWS = {
    "messages without end": ("ALTER TABLE messages RENAME TO other", ENDLESS),
    "definitions without end":
        ("DROP TABLE IF EXISTS message_definitions",
         f"CREATE VIEW message_definitions({DEFINED}) AS {COUNT} SELECT {LONG_TEXTS} FROM c"),
    "a virtual table": ("CREATE VIRTUAL TABLE other USING fts5(a)",),
    "a trigger": ("CREATE TRIGGER t AFTER INSERT ON topics BEGIN SELECT 1; END",),
}  # fmt: skip
CHANGES = {
    **{name: (statements, NO_VIEWS) for name, statements in OF_VIEWS.items()},
    **{
        f"{storage} columns of {table}": (generated(table, storage), f"table {table} has generated")
        for storage, table in [("VIRTUAL", "messages"), ("STORED", "message_definitions")]
    },
    # SQLite uses the SQL text of a definition and ignores the name and type stored beside it.
    "another schema": (
        ("DROP INDEX IF EXISTS timestamp_idx", "PRAGMA writable_schema = ON",
         f"UPDATE sqlite_master SET sql = '{ENDLESS}' WHERE name = 'messages'"),
        f"{NO_VIEWS}|is damaged",
    ),
    # Each lookup of a message would search the whole table.
    "no key": (
        ("ALTER TABLE messages RENAME TO other", f"CREATE TABLE messages({MESSAGES})",
         "INSERT INTO messages SELECT * FROM other"), "table messages has no primary key id",
    ),
    "a long message": (
        ("UPDATE messages SET data = zeroblob(90000000) WHERE id = 1",),
        "90000000 bytes of a message need|a row needs more memory",
    ),
    "a long name": ((f"UPDATE topics SET name = {LONG}",), "a row needs more memory"),
    "texts as times": (
        ("DROP TABLE messages", OTHER_TABLE, f"{ROWS} LIMIT 99)"), "not a whole number",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("statements", "rule"), CHANGES.values(), ids=CHANGES)
def test_tables_that_compute_or_hold_too_much_are_refused(changed, statements, rule):
    refused(changed(*statements), rule)


def test_damaged_files_are_checked_for_views_too(changed):
    path = changed(*OF_VIEWS["messages without end"])
    path.write_bytes(path.read_bytes()[:-100])
    refused(path, f"{NO_VIEWS}|is damaged")


@pytest.mark.parametrize("make", [os.mkfifo, Path.mkdir, lambda log: log.symlink_to("/dev/zero")])
def test_a_log_that_is_not_a_file_is_ignored(changed, make, tmp_path):
    path = changed()
    make(tmp_path / "a.db3-wal")
    assert read_all(path) == 60


def test_messages_that_expand_to_more_than_the_memory_are_refused(written, tmp_path):
    folder = tmp_path / "bag"
    shutil.copytree(written.parent, folder)
    text = (folder / "metadata.yaml").read_text()
    for key, value in ("mode", "message"), ("format", "zstd"):
        assert f"compression_{key}: ''" in text
        text = text.replace(f"compression_{key}: ''", f"compression_{key}: {value}")
    (folder / "metadata.yaml").write_text(text)
    with sqlite3.connect(folder / "bag.db3") as db:
        db.execute("UPDATE messages SET data = ?", (bomb(100),))
    db.close()
    refused(folder, "bytes of a message would expand to more than")


def bomb(size):
    """Return `size` MB of zeros as a zstd stream without its size in the header."""
    compressor, zeros = zstd_module(Path("a")).ZstdCompressor(), bytes(1_000_000)
    return b"".join(compressor.compress(zeros) for _ in range(size)) + compressor.flush()


def test_a_file_that_would_fill_the_disk_is_refused(tmp_path):
    path = tmp_path / "a.db3.zstd"
    path.write_bytes(bomb(200))
    refused(path, "more than 1000 times as many")
    assert not list(tmp_path.glob("mapdeal-*"))


def metadata_of(folder, names):
    text = f"storage_identifier: sqlite3\n  relative_file_paths: [{names}]"
    (folder / "metadata.yaml").write_text(f"rosbag2_bagfile_information:\n  {text}\n")


@pytest.mark.parametrize("name", ["metadata.yaml", "/etc/passwd", "../other/bag.db3", "pipe.db3"])
def test_metadata_cannot_name_files_outside_the_folder(written, tmp_path, name):
    (tmp_path / "other").mkdir()
    shutil.copy(written, tmp_path / "other")
    folder = tmp_path / "bag"
    folder.mkdir()
    os.mkfifo(folder / "pipe.db3")
    metadata_of(folder, name)
    with pytest.raises((FileAccessError, MalformedInputError)) as caught:
        read_all(folder)
    assert str(caught.value).startswith(f"{folder}/{Path(name).name}: ")


def test_a_file_that_is_named_many_times_is_read_once(written, tmp_path):
    shutil.copy(written, tmp_path)
    names = ", ".join(["bag.db3", "./bag.db3", *(f"gone{k}.db3" for k in range(5_000))] * 2)
    metadata_of(tmp_path, names)
    assert read_all(tmp_path) == 60


def record(opcode, content):
    return struct.pack("<BQ", opcode, len(content)) + content


def word(text):
    data = text if isinstance(text, bytes) else text.encode()
    return struct.pack("<I", len(data)) + data


START_OF_MCAP = MAGIC + record(1, word("ros2") + word(""))
END = record(15, bytes(4)) + record(2, bytes(20)) + MAGIC


def mcap(path, *records):
    path.write_bytes(START_OF_MCAP + b"".join(records) + END)
    return path


def chunk(data, compression, size, lacking=0):
    head = struct.pack("<QQQI", 0, 1, size, 0) + word(compression)
    return record(6, head + struct.pack("<Q", len(data) + lacking) + data)


def schema(number, name, text):
    return record(3, struct.pack("<H", number) + word(name) + word("ros2msg") + word(text))


def channel(number, topic):
    return record(4, struct.pack("<HH", number, number) + word(topic) + word("cdr") + bytes(4))


def message(number, data):
    return record(5, struct.pack("<HIQQ", number, 0, START, START) + data)


def sparse(path, data, size):
    """Write a file followed by a hole of zeros, which occupies no disk space."""
    path.write_bytes(data)
    os.truncate(path, len(data) + size)
    with path.open("ab") as file:
        file.write(END)
    return path


PACKED = {
    "zstd": bomb,
    "lz4": lambda size: lz4.frame.compress(bytes(size * 1_000_000)),
    "bz2": lambda size: bz2.compress(bytes(size * 1_000_000)),
}


@pytest.mark.parametrize("compression", PACKED)
def test_a_chunk_that_expands_to_too_much_is_refused(tmp_path, compression):
    data = PACKED[compression](20)
    for size, rule in (100_000_000, "bytes of a chunk need"), (1000, "must expand to 1000 bytes"):
        refused(mcap(tmp_path / "a.mcap", chunk(data, compression, size)), rule)
    short = chunk(data, compression, 20_000_000, lacking=1)
    refused(mcap(tmp_path / "a.mcap", short), "the head of a chunk is damaged")


def test_zeros_are_not_read_as_records(tmp_path):
    """A few kB would expand to two million records of zeros."""
    assert read_all(mcap(tmp_path / "a.mcap", chunk(bomb(18), "zstd", 18_000_000))) == 0


@pytest.mark.parametrize("records", [
    [chunk(b"", "", 0)] * 30_000,
    [chunk(b"", "", 0), *[record(7, struct.pack("<HI", 1, 0))] * 120_000],
    [
        chunk(zstd_module(Path("a")).compress(text), "zstd", len(text))
        for text in (schema(k, "a/msg/T", " " * 4_000_000) for k in range(4))
    ],
], ids=["chunks", "index records", "definitions"])  # fmt: skip
def test_memory_of_the_index_is_limited(tmp_path, records):
    rule = "its connections and chunks need"
    refused(mcap(tmp_path / "a.mcap", *records), rule, limit=62_000_000)


def test_a_type_of_many_megabytes_is_refused(tmp_path):
    long_schema = schema(1, "a/msg/T", " " * 17_000_000)
    rule = "a schema or channel is too long"
    refused(mcap(tmp_path / "a.mcap", long_schema), rule)
    refused(mcap(tmp_path / "a.mcap", chunk(long_schema, "", len(long_schema))), rule)


def test_records_are_not_read_at_once(tmp_path):
    length = 100_000_000
    start = START_OF_MCAP + schema(1, "sensor_msgs/msg/LaserScan", "") + channel(1, "/scan")
    head = start + struct.pack("<BQHIQQ", 5, length, 1, 0, 0, 0)
    with use_memory(LIMIT), open_bag(sparse(tmp_path / "a.mcap", head, length)) as bag:
        (place,) = bag.index([1])
        with pytest.raises(MalformedInputError, match="bytes of a record need"):
            bag.read_message(place)
    indexed = start + chunk(b"", "", 0) + struct.pack("<BQHI", 7, length + 6, 1, length)
    refused(sparse(tmp_path / "b.mcap", indexed, length), "the places of .* messages need")


def test_types_that_code_is_made_of_are_short(tmp_path):
    """rosbags writes a line for each element of an array of a fixed length."""
    name = "tf2_msgs/msg/TFMessage"
    data = b"\0\1\0\0" + struct.pack("<I", 4_000_000_000)
    text = schema(1, name, "string[400000000] a")
    path = mcap(tmp_path / "a.mcap", text, channel(1, "/tf"), message(1, data))
    refused(path, "fixed lengths of arrays")


def test_only_one_large_chunk_is_in_the_cache():
    alive = []

    def read(number):
        alive.append(sum(len(chunk) for chunk in cache._chunks.values()))
        return bytes(30_000_000)

    cache = ChunkCache(read)
    for number in (0, 1, 0, 1, 2, 0):
        assert len(cache[number]) == 30_000_000
    assert alive == [0, 30_000_000, 30_000_000, 30_000_000]


MEMORY = 200_000_000


@pytest.mark.thorough
def test_hostile_bags_take_no_more_than_the_limit(changed, tmp_path):
    store, name = ros2_store(), "sensor_msgs/msg/LaserScan"
    text = store.generate_msgdef(name, ros_version=2)[0]
    message_object = scan(START, np.full(8_000_000, 2, np.float32), step=1e-7)(store)
    scans = message(1, bytes(store.serialize_cdr(message_object, name)))
    paths = [
        mcap(tmp_path / "scan.mcap", schema(1, name, text), channel(1, "/scan"), scans),
        mcap(tmp_path / "zeros.mcap", chunk(bomb(140), "zstd", 140_000_000)),
        mcap(tmp_path / "chunks.mcap", *[chunk(b"", "", 0)] * 400_000),
        changed("UPDATE messages SET data = zeroblob(150000000)"),
    ]
    for path in paths:
        for command in ("info", "build", "convert"):
            out = "" if command == "info" else "-o m.npz --force"
            code, output, peak = measured(tmp_path, f"{command} {path} {out}", str(MEMORY))
            assert code in (0, 3), output
            assert peak < MEMORY + 20_000_000, (command, path.name, peak)


def cut_bag(path, *sizes):
    with contextlib.closing(sqlite3.connect(path)) as db:
        db.execute("CREATE TABLE topics (id INTEGER PRIMARY KEY, name, type, serialization_format)")
        db.execute("CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id, timestamp, data BLOB)")
        db.execute("INSERT INTO topics VALUES (1, '/scan', 'sensor_msgs/msg/LaserScan', 'cdr')")
        db.executemany("INSERT INTO messages VALUES (?, 1, 0, zeroblob(?))", enumerate(sizes))
        db.commit()
    os.truncate(path, path.stat().st_size - 2048)
    return contextlib.closing(SqliteBag(path))


@pytest.mark.parametrize("sizes", [(6_000_000,), (1000, 6_000_000)])
def test_a_row_that_is_too_long_is_refused_in_a_cut_file_as_well(tmp_path, sizes):
    with (
        pytest.warns(MapdealWarning, match="cut"), use_memory(60_000_000, is_chosen=True),
        cut_bag(tmp_path / "a.db", *sizes) as bag, pytest.raises(MalformedInputError, match="more"),
    ):  # fmt: skip
        list(bag.pieces([1]))


def test_a_cut_file_is_warned_of_once(tmp_path):
    warned = pytest.warns(MapdealWarning, match="the intact part is read")
    with warned as found, cut_bag(tmp_path / "cut.db3", 60_000) as bag:
        assert not list(bag.pieces([1]))
    assert len(found) == 1
