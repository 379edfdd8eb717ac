"""Intact and damaged bags of every format, against the messages written to them."""

import contextlib
import sqlite3
import struct

import numpy as np
import pytest

from bags.making import FORMATS, IN_MCAP, ROS1, ROS2, START, Maker, costmap, occupancy, scan, words
from mapdeal import FileAccessError, MalformedInputError, MapdealWarning
from mapdeal.bags.bag import MessageIndex, Place, name_inside, normalised_topic
from mapdeal.bags.messages import Decoder, laser_scan_of
from mapdeal.bags.reader import open_bag, select_connections

pytestmark = pytest.mark.slow

CELLS = np.array([[-1, 0, 100, 7], [0, 50, -1, 100]], np.int8)
RANGES = np.arange(30, dtype=np.float32) / 4 + 0.5
LASER = "sensor_msgs/msg/LaserScan"
COMPRESSED_AS_A_WHOLE = ("ros1-bz2", "sqlite3-file", "mcap-file", "mcap-chunk")
"""Formats with all messages in one compressed block, which is read completely or not at all."""


@pytest.fixture
def maker():
    """Return messages of several topics, not sorted by time, which fill several small chunks."""
    maker = Maker()
    maker.add("/map", "nav_msgs/msg/OccupancyGrid", START,
             occupancy(START, CELLS, 0.1, (1.5, -2.25, 0.5)))  # fmt: skip
    for k in range(40):
        maker.add("/scan", LASER, START + (k ^ 1) * 1000, scan(START + k, RANGES + k))
        maker.add("/talk", "std_msgs/msg/String", START + k, words(f"word {k}" * 9))
    return maker


def scans_of(bag):
    connections = select_connections(bag, [], [LASER], "laser scans")
    decoder, index = Decoder(bag), bag.index([connection.id for connection in connections])
    return [(place.time, decoder.message(place)) for place in index]


@pytest.mark.parametrize("form", FORMATS)
def test_messages_come_as_they_were_written_in_the_order_of_time(maker, tmp_path, form):
    with open_bag(maker.write(tmp_path, form)) as bag:
        found = scans_of(bag)
        summary = {c.topic: bag.summary()[c.id] for c in bag.connections}
        (place,) = bag.index([c.id for c in bag.connections if c.topic == "/map"])
        assert Decoder(bag).header(place) == (START, "map")
    assert [time for time, _ in found] == [START + k * 1000 for k in range(40)]
    for k, (_, message) in enumerate(found):
        assert message.header.frame_id == "laser"
        np.testing.assert_array_equal(message.ranges, RANGES + (k ^ 1))
    counts = {topic: recorded.count for topic, recorded in summary.items()}
    assert counts == {"/map": 1, "/scan": 40, "/talk": 40}
    assert (summary["/scan"].first, summary["/scan"].last) == (START, START + 39_000)


@pytest.mark.parametrize("form", [form for form in ROS2 if form.endswith("file")])
def test_a_file_that_is_compressed_can_be_named_itself(maker, tmp_path, form):
    (file,) = (path for path in maker.write(tmp_path, form).iterdir() if path.suffix != ".yaml")
    with open_bag(file) as bag:
        assert len(scans_of(bag)) == 40
        assert bag.path == file


@pytest.mark.parametrize("form", ["sqlite3", "mcap"])
def test_a_folder_without_metadata_is_read_with_a_warning(maker, tmp_path, form):
    folder = maker.write(tmp_path, form)
    with open_bag(folder / "metadata.yaml") as bag:  # the same as its folder
        assert len(scans_of(bag)) == 40
    (folder / "metadata.yaml").unlink()
    with pytest.warns(MapdealWarning, match=r"has no metadata\.yaml"), open_bag(folder) as bag:
        assert len(scans_of(bag)) == 40


def edit(path, old, new, count=1):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, count))


def test_several_files_of_a_folder_are_one_bag(maker, tmp_path):
    folder, later = maker.write(tmp_path, "mcap"), Maker()
    later.messages = [(time + 10**9, *fields) for time, *fields in maker.messages]
    (tmp_path / "new").mkdir()
    (later.write(tmp_path / "new", "mcap") / "bag.mcap").rename(folder / "bag_1.mcap")
    edit(folder / "metadata.yaml", "- bag.mcap", "- bag.mcap\n  - old/bag_1.mcap")
    with open_bag(folder) as bag:
        times = [START + second * 10**9 + k * 1000 for second in (0, 1) for k in range(40)]
        assert [time for time, _ in scans_of(bag)] == times
        assert len(bag.files) == 3


@pytest.mark.parametrize("form", ["mcap", "sqlite3"])
def test_metadata_without_a_storage_are_as_none(maker, tmp_path, form):
    folder = maker.write(tmp_path, form)
    edit(folder / "metadata.yaml", f"storage_identifier: {form}", "storage_identifier: ''")
    warning = pytest.warns(MapdealWarning, match="names no storage, as ros2 bag reindex leaves it")
    with warning, open_bag(folder) as bag:
        assert len(scans_of(bag)) == 40


def test_a_missing_file_of_several_is_warned_of(maker, tmp_path):
    folder = maker.write(tmp_path, "mcap")
    edit(folder / "metadata.yaml", "- bag.mcap", "- bag.mcap\n  - b.mcap")
    warning = pytest.warns(MapdealWarning, match=r"its file b\.mcap is missing")
    with warning, open_bag(folder) as bag:
        assert len(scans_of(bag)) == 40
    (folder / "bag.mcap").unlink()
    with pytest.raises(FileAccessError, match=r"bag\.mcap"), open_bag(folder):
        pass


@pytest.mark.parametrize(("old", "new", "rule"), [
    ("storage_identifier: mcap", "storage_identifier: other", "must be sqlite3 or mcap"),
    ("relative_file_paths", "absolute_file_paths", "relative_file_paths: missing"),
    ("rosbag2_bagfile_information", "information", "rosbag2_bagfile_information: missing"),
    ("serialization_format: cdr", "serialization_format: odd", "serialized as 'odd'"),
    ("compression_mode: ''", "compression_mode: upside_down", "must be none, file or message"),
])  # fmt: skip
def test_invalid_metadata_are_refused(maker, tmp_path, old, new, rule):
    folder = maker.write(tmp_path, "mcap")
    edit(folder / "metadata.yaml", old, new, -1)
    with pytest.raises(MalformedInputError, match=rule), open_bag(folder):
        pass


def ros1_records(data):
    """Yield fields, start, start of data, and end of each record of an intact bag."""
    position = data.index(b"\n") + 1
    while position < len(data):
        (length,) = struct.unpack_from("<I", data, position)
        fields, at, end = {}, position + 4, position + 4 + length
        while at < end:
            (size,) = struct.unpack_from("<I", data, at)
            name, _, value = data[at + 4 : at + 4 + size].partition(b"=")
            fields[name] = value
            at += 4 + size
        (size,) = struct.unpack_from("<I", data, end)
        yield fields, position, end + 4, end + 4 + size
        position = end + 4 + size


@pytest.mark.parametrize("form", ROS1)
def test_the_length_of_an_index_record_follows_from_its_count(maker, tmp_path, form):
    """Some writers declare a wrong length, at which rosbags stops."""
    path = maker.write(tmp_path, form)
    data = bytearray(path.read_bytes())
    heads = [start for fields, _, start, _ in ros1_records(bytes(data)) if fields[b"op"] == b"\x04"]
    assert len(heads) == 3
    for start in heads:
        struct.pack_into("<I", data, start - 4, 7)
    path.write_bytes(data)
    with open_bag(path) as bag:
        assert len(scans_of(bag)) == 40


@pytest.mark.parametrize(("form", "is_killed"), [*((f, False) for f in ROS1), ("ros1", True)])
def test_a_bag_without_an_index_is_read_completely(maker, tmp_path, form, is_killed):
    """A killed recorder leaves a chunk without its length, followed by its records."""
    path = maker.write(tmp_path, form)
    data = path.read_bytes()
    unindexed = data[: data.index(b"\n") + 1]
    for fields, start, data_start, end in ros1_records(data):
        if fields[b"op"] == b"\x05" and is_killed:
            unindexed = data[: data_start - 4] + bytes(4) + data[data_start:end]
        elif fields[b"op"] in (b"\x03", b"\x05"):
            unindexed += data[start:end]
    path.write_bytes(unindexed)
    with pytest.warns(MapdealWarning, match="has no index"), open_bag(path) as bag:
        topics = {connection.topic for connection in bag.connections if len(scans_of(bag)) == 40}
    assert topics == {"/map", "/scan", "/talk"}


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.usefixtures("mapdeal_warnings")
def test_the_intact_part_of_a_truncated_bag_is_read(maker, tmp_path, form):
    """A file truncated anywhere gives a warning and fewer messages, or one error."""
    path = maker.write(tmp_path, form)
    file = path if path.is_file() else max(path.iterdir(), key=lambda path: path.stat().st_size)
    data, counts = file.read_bytes(), []
    for length in np.linspace(1, len(data) - 1, 12).astype(int):
        file.write_bytes(data[:length])
        try:
            with open_bag(path) as bag:
                found = scans_of(bag)
        except MalformedInputError as error:
            assert "\n" not in str(error)
            continue
        for _, message in found:
            np.testing.assert_array_equal(message.ranges, RANGES + message.header.stamp.nanosec)
        counts.append(len(found))
    assert counts == sorted(counts)
    if form not in COMPRESSED_AS_A_WHOLE:
        assert max(counts) > 20


FIELDS = b"op=\x03", b"encryptor=rosbag/AesCbcEncryptor", b"index_pos=" + bytes(8)
HEADER = b"".join(struct.pack("<I", len(field)) + field for field in FIELDS)
ENCRYPTED = struct.pack("<I", len(HEADER)) + HEADER + struct.pack("<I", 0)


@pytest.mark.parametrize(("name", "data", "rule"), [
    ("a.bag", b"#ROSRECORD V1.2\n" + b"\0" * 9, r"is a bag of version 1\.2; 2\.0 is read"),
    ("a.bag", b"#ROSLOG V1.1\n" + b"\0" * 9, r"is a bag of version 1\.1; 2\.0 is read"),
    ("a.bag", b"#ROSBAG Vx.y\n" + b"\0" * 9, "must begin with #ROSBAG"),
    ("a.bag", b"#ROSBAG V2.0\n" + ENCRYPTED, "is encrypted"),
    ("a.mcap", b"nothing that is known", r"a\.mcap: "),
])  # fmt: skip
def test_files_that_are_not_bags_are_refused(tmp_path, name, data, rule):
    (tmp_path / name).write_bytes(data)
    with pytest.raises(MalformedInputError, match=rule), open_bag(tmp_path / name):
        pass


@pytest.mark.parametrize(
    ("name", "data"), [("a.bag", b"#ROSBAG V2.0\n" + b"\0" * 9), ("a.mcap", b"\x89MCAP0\r\n")]
)
def test_a_bag_that_ends_at_once_is_empty(tmp_path, name, data):
    (tmp_path / name).write_bytes(data)
    with pytest.warns(MapdealWarning, match="ends too early"), open_bag(tmp_path / name) as bag:
        assert list(bag.connections) == []


def with_size_99(data):
    start = data.index(b"size=") + 5
    return data[:start] + struct.pack("<I", 99) + data[start + 4 :]


@pytest.mark.parametrize(("form", "change", "rule"), [
    ("ros1-bz2", lambda data: data.replace(b"compression=bz2", b"compression=abc"), "got 'abc'"),
    ("ros1-lz4", with_size_99, "must expand to 99 bytes"),
    ("mcap-plain", lambda data: data.replace(b"word 20", b"Word 20", 1), "checksum differs"),
])  # fmt: skip
def test_a_damaged_chunk_is_an_error(maker, tmp_path, form, change, rule):
    path = maker.write(tmp_path, form)
    path.write_bytes(change(path.read_bytes()))
    with open_bag(path) as bag, pytest.raises(MalformedInputError, match=rule):
        scans_of(bag)


def test_the_messages_before_a_damaged_page_of_sqlite_are_read(maker, tmp_path):
    folder = maker.write(tmp_path, "sqlite3")
    with (folder / "bag.db3").open("r+b") as file:
        file.seek(-4096, 2)
        file.write(b"\xff" * 4096)
    warned = pytest.warns(MapdealWarning, match="is damaged, or cut; the messages before that")
    with warned, open_bag(folder) as bag:
        assert 20 < len(scans_of(bag)) < 40


@pytest.mark.parametrize("compression", IN_MCAP.values())
@pytest.mark.parametrize("options", [
    {"use_summary_offsets": False, "use_statistics": False, "repeat_channels": False,
     "repeat_schemas": False},
    {"use_chunking": False},
], ids=["no summary", "messages between chunks"])  # fmt: skip
def test_a_summary_and_chunks_are_not_needed(maker, tmp_path, compression, options):
    with open_bag(maker._write_mcap(tmp_path / "bag.mcap", compression, **options)) as bag:
        assert [time for time, _ in scans_of(bag)] == [START + k * 1000 for k in range(40)]


def test_sqlite_files_of_other_programs_are_refused(tmp_path):
    path = tmp_path / "a.db3"
    change(path, "CREATE TABLE people (name TEXT)")
    rule = "without the tables topics and messages"
    with pytest.raises(MalformedInputError, match=rule), open_bag(path):
        pass


def change(path, statement):
    with contextlib.closing(sqlite3.connect(path)) as db, db:
        db.execute(statement)


def test_the_only_matching_topic_is_chosen_and_others_are_named(maker, tmp_path):
    maker.add("/other", LASER, START, scan(START, RANGES))
    with open_bag(maker.write(tmp_path, "mcap")) as bag:
        (connection,) = select_connections(bag, [], ["nav_msgs/msg/OccupancyGrid"], "maps")
        assert connection.topic == "/map"
        (connection,) = select_connections(bag, ["scan"], [LASER], "laser scans")
        assert connection.topic == "/scan"
        for topics, types, rule, hint in [
            ([], [LASER], "has 2 topics of things", "--topic names one of /other"),
            ([], ["tf"], "has no topic of things", "its topics /map"),
            (["/nothing"], [LASER], "has no topic /nothing", "there are /other"),
            (["/map"], [LASER], "/map is of type nav_msgs/msg/OccupancyGrid", "there are /other"),
        ]:
            with pytest.raises(MalformedInputError, match=rule) as caught:
                select_connections(bag, topics, types, "things")
            assert hint in caught.value.hint


def test_names_are_those_that_readers_accept_and_the_first_among_equals_stays_first(tmp_path):
    assert normalised_topic("//a//b/") == normalised_topic("a/b") == "/a/b"
    assert [name_inside(tmp_path / name) for name in ("a b.db3", "a%41.db3")] == ["a b", "bag"]
    index = MessageIndex.of([Place(1, 5, 0, 0), Place(2, 3, 0, 7), Place(3, 5, 1, 2)])
    assert [place.connection for place in index.sorted_by_time()] == [2, 1, 3]


def test_costmaps_are_decoded_without_a_definition(tmp_path):
    maker = Maker()
    maker.add("/local_costmap/costmap_raw", "nav2_msgs/msg/Costmap", START,
             costmap(START, [[0, 253, 255]], 0.25, (1.0, 2.0, 0.0)))  # fmt: skip
    folder = maker.write(tmp_path, "sqlite3")
    change(folder / "bag.db3", "DELETE FROM message_definitions")
    with open_bag(folder) as bag:
        (connection,) = bag.connections
        assert connection.definition == ""
        message = Decoder(bag).message(bag.index([connection.id])[0])
    assert message.data.tolist() == [0, 253, 255]
    assert message.metadata.layer == "master"


def test_a_message_that_breaks_its_type_is_an_error(maker, tmp_path):
    folder = maker.write(tmp_path, "sqlite3")
    change(folder / "bag.db3", "UPDATE messages SET data = x'00010000FFFFFF7F'")
    error = pytest.raises(MalformedInputError, match=r"a message at .* is not a valid sensor_msgs")
    with open_bag(folder) as bag, error:
        scans_of(bag)


def test_wrong_values_of_a_message_are_refused_with_its_bag_and_topic(tmp_path):
    maker = Maker()
    maker.add("/scan", LASER, START, scan(START, [1.0, 1.0], step=0.0))
    with open_bag(maker.write(tmp_path, "mcap")) as bag:
        (place,) = bag.index([bag.connections[0].id])
        with pytest.raises(MalformedInputError, match="/scan: angle_increment must not") as caught:
            Decoder(bag).read(place, laser_scan_of)
    assert caught.value.source == bag.path
