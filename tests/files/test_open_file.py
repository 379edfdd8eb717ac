"""Files that are read piece by piece: the first bytes are kept, and yet no change goes unseen."""

import os

import pytest

from mapdeal import FileAccessError
from mapdeal.maps.picture import HEAD, opened


@pytest.mark.parametrize("size", [0, 1, 1000, HEAD - 1, HEAD, HEAD + 1, 2 * HEAD + 5])
def test_any_bytes_are_those_of_the_file_once_its_head_is_known(tmp_path, size):
    data = os.urandom(size)
    (tmp_path / "a").write_bytes(data)
    with opened(tmp_path / "a") as file:
        for _ in range(2):
            for offset, count in [
                (0, HEAD), (0, size), (0, 3), (5, 7), (HEAD - 2, 4), (HEAD, 10), (size, 5),
                (size + 3, 5), (max(size - 4, 0), 100), (2, 1 << 22), (3, 0),
            ]:  # fmt: skip
                assert file.read(offset, count) == data[offset : offset + count]


@pytest.mark.parametrize("offset", [0, 10])
def test_a_change_is_seen_though_the_bytes_are_known(tmp_path, offset):
    path = tmp_path / "a"
    path.write_bytes(bytes(100))
    with opened(path) as file:
        file.read(0, HEAD)
        path.write_bytes(bytes(101))
        with pytest.raises(FileAccessError, match="changed while it was read"):
            file.read(offset, 5)
