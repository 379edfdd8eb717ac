import os
from contextlib import suppress
from glob import glob, has_magic
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import Mock

import pytest
from hypothesis import given, strategies as st

from mapdeal import FileAccessError, MapdealWarning, ParameterError
from mapdeal.files.source import contents_of, status_of
from mapdeal.maps import listing
from mapdeal.maps.listing import files_matching, list_files, numbered_folders, sorted_naturally
from odd_names import private
from strategies import examples

SUFFIXES = (".pcd", ".ply")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("s10.pcd", "s9.pcd", "s9.PLY", "notes.txt", "b/1.pcd", "b/c/2.pcd",
                 "b/c/depth2.pcd", "b/c/depth.pcd", "odd[1].pcd"):  # fmt: skip
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    (tmp_path / "d.pcd").mkdir()
    return tmp_path


@pytest.mark.parametrize(("names", "found"), [
    (["s10.pcd", "s9.pcd", "s10.pcd"], ["s10.pcd", "s9.pcd", "s10.pcd"]),
    (["."], ["odd[1].pcd", "s9.PLY", "s9.pcd", "s10.pcd"]),
    (["s*"], ["s9.PLY", "s9.pcd", "s10.pcd"]),
    (["**/[o12s]*.pcd"], ["b/1.pcd", "b/c/2.pcd", "odd[1].pcd", "s9.pcd", "s10.pcd"]),
    (["b", "s9.pcd"], ["b/1.pcd", "s9.pcd"]),
    (["odd[1].pcd"], ["odd[1].pcd"]),
    (["b/c"], ["b/c/2.pcd", "b/c/depth.pcd", "b/c/depth2.pcd"]),
    (["notes.txt", "b"], ["notes.txt", "b/1.pcd"]),
])  # fmt: skip
def test_files_folders_and_patterns(folder, names, found):
    assert [str(path) for path in list_files(names, SUFFIXES)] == found


@pytest.mark.parametrize(("name", "error", "message"), [
    ("*.txt", ParameterError, "no file"),
    ("q*", ParameterError, "no file"),
    ("d.pcd", FileAccessError, "no file"),
    ("missing.pcd", FileAccessError, "No such file"),
    ("missing", FileAccessError, "No such file"),
    ("no/such.pcd", FileAccessError, "No such file"),
])  # fmt: skip
def test_names_without_a_file_are_refused(folder, name, error, message):
    with pytest.raises(error, match=message):
        list_files([name], SUFFIXES)


def test_some_endings_are_not_searched_in_folders(folder):
    found = list_files([".", "s*.PLY"], (".pcd", ".ply", ".txt"), not_in_folders=(".ply", ".txt"))
    assert [str(path) for path in found] == ["odd[1].pcd", "s9.pcd", "s10.pcd", "s9.PLY"]


@pytest.mark.parametrize("pattern", ["**/" * 12 + "*.pcd", "*/../" * 12 + "*.pcd", "b/**/[12].pcd"])
def test_each_part_of_a_pattern_lists_each_folder_once(folder, monkeypatch, pattern):
    """Two links to their own folder make 2^40 paths."""
    for name in ("one", "other"):
        (folder / "b" / name).symlink_to(".", target_is_directory=True)
    for name in ("e/f/g/h", "i/j/k/l", "m", "n", "o"):
        (folder / name).mkdir(parents=True)
    listed = Mock(side_effect=contents_of)
    monkeypatch.setattr(listing.sources, "contents_of", listed)
    found = list_files([pattern], SUFFIXES)
    assert pattern[0] != "b" or list(map(str, found)) == ["b/1.pcd", "b/c/2.pcd"]
    folders = 1 + sum(path.is_dir() for path in folder.rglob("*"))
    assert listed.call_count <= (pattern.count("/") + 1) * folders


def test_a_file_is_listed_by_its_shortest_path(folder):
    (folder / "a").mkdir()
    (folder / "a" / "down").symlink_to(folder / "b" / "c", target_is_directory=True)
    (folder / "z").symlink_to(folder / "b" / "c", target_is_directory=True)
    assert [str(path) for path in list_files(["**/2.pcd"], SUFFIXES)] == ["z/2.pcd"]
    assert [str(path) for path in list_files(["[ab]/*/2.pcd"], SUFFIXES)] == ["a/down/2.pcd"]


def test_broken_and_circular_links_are_listed_for_their_reader(folder):
    (folder / "x.pcd").symlink_to("y.pcd")
    (folder / "y.pcd").symlink_to("x.pcd")
    (folder / "z.pcd").symlink_to("nothing")
    assert [path.name for path in list_files(["*"], SUFFIXES)] == [
        "odd[1].pcd", "s9.PLY", "s9.pcd", "s10.pcd", "x.pcd", "y.pcd", "z.pcd",
    ]  # fmt: skip
    assert [path.name for path in list_files(["**/z.pcd"], SUFFIXES)] == ["z.pcd"]
    for name in ("x.pcd", "z.pcd", "x.pcd/y"):
        with pytest.raises(FileAccessError, match="cannot be read"):
            list_files([name], SUFFIXES)
    with pytest.raises(FileAccessError, match="cannot be read: it is a link to nothing"):
        status_of(folder / "z.pcd")


def test_an_unreadable_folder_is_left_out_of_a_pattern_with_a_warning(folder, monkeypatch):
    private(folder / "b" / "c", monkeypatch)
    for pattern in ("*/*/*.pcd", "b/**/*.pcd", "b/**"):
        with pytest.warns(MapdealWarning, match="c: cannot be read: Permission denied; left out"):
            found = [str(path) for path in files_matching(pattern)]
        assert found == (["b/1.pcd"] if "**" in pattern else [])
    with pytest.raises(FileAccessError, match="c: cannot be read: Permission denied"):
        list_files(["b/c"], SUFFIXES)


NAMES = ["a", "b", "ab", "a.y", "b.y", "A.y", ".h", ".y", "a b", "[a]", "a[b", "1.y", "10.y", "x.z"]
PARTS = ["**", "*", "?", "*.y", "a*", "[ab]", "[!a]*", ".*", "[[]a]", "a", "ab", "*.[yz]", "?*",
         "**.y", ".h", "[.]y", "[]a]", "[b-"]  # fmt: skip


@pytest.mark.slow
@examples(100)
@given(
    st.lists(st.lists(st.sampled_from(NAMES), min_size=1, max_size=4), max_size=12),
    st.lists(st.sampled_from(PARTS), min_size=1, max_size=4),
    st.sampled_from(["", "/", "./"]),
)
def test_patterns_match_the_files_of_glob(files, parts, ending):
    with TemporaryDirectory() as name:
        folder = Path(name)
        for names in files:
            path = folder.joinpath(*names)
            with suppress(FileExistsError, NotADirectoryError):
                path.parent.mkdir(parents=True, exist_ok=True)
                path.touch()
        pattern = f"{folder}/{'/'.join(parts)}{ending if ending != './' else ''}"
        pattern = pattern.replace(f"{folder}/", f"{folder}/./") if ending == "./" else pattern
        matching = glob(pattern, recursive=True)  # noqa: PTH207
        # glob gives "a/" for "a/**" even if "a" is a file; Path would drop the slash
        expected = {Path(match) for match in matching if os.path.isfile(match)}  # noqa: PTH113
        found = files_matching(pattern)
        assert len(set(found)) == len(found)
        assert set(found) == expected
        if expected and has_magic(pattern):
            suffixes = {path.suffix.lower() for path in expected}
            assert list_files([pattern], tuple(suffixes)) == sorted_naturally(expected)


def test_numbered_folders_of_files_and_invalid_names(folder):
    for name in ("none", "n" * 300, "s9.pcd", "s9.pcd/x", "a\0b"):
        assert numbered_folders(Path(name)) == []
    for name in ("10", "9", "007", "x1"):
        (folder / "b" / name).mkdir()
    (folder / "b" / "5").touch()
    assert [path.name for path in numbered_folders(folder / "b")] == ["007", "9", "10"]
