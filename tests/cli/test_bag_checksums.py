"""Checksums of the MCAP files that convert writes, checked by the format's own library."""

import numpy as np
import pytest
from mcap.stream_reader import StreamReader

from mapdeal import OccupancyGrid, write_map


@pytest.fixture
def bag(here, sh):
    values = np.random.default_rng(1).choice(np.array([-1, 0, 100], np.int8), (300, 400))
    write_map("a.yaml", OccupancyGrid(values, 0.05))
    sh.ok("convert a.yaml -o a.mcap --topic /map")
    return here / "a.mcap"


def test_chunks_data_and_summary_have_checksums(bag):
    with bag.open("rb") as file:
        records = list(StreamReader(file, emit_chunks=True, validate_crcs=True).records)
    told = {type(one).__name__: one for one in records}
    assert told["Chunk"].uncompressed_crc
    assert told["DataEnd"].data_section_crc
    assert told["Footer"].summary_crc
    with bag.open("rb") as file:  # of the chunks' records, which raises where they are not right
        assert len(list(StreamReader(file, validate_crcs=True).records)) > len(told)


def test_four_kib_that_are_zeroed_are_refused(bag, sh):
    sh.ok("convert a.mcap -o whole.yaml")
    data = bytearray(bag.read_bytes())
    middle = len(data) // 2
    data[middle : middle + 4096] = bytes(4096)
    bag.write_bytes(data)
    code, _, err = sh("convert a.mcap -o b.yaml")
    assert code == 3
    assert "checksum" in err
    assert not (bag.parent / "b.yaml").exists()


@pytest.mark.parametrize("words", ["info", "build -o o.yaml", "local -o o --cloud"])
def test_a_bag_of_version_1_is_named(here, sh, words):
    (here / "old.bag").write_bytes(b"#ROSRECORD V1.2\n" + bytes(30))
    code, _, err = sh(f"{words} old.bag")
    assert code == 3
    assert "is a bag of version 1.2; 2.0 is read" in err
