import pytest

from mapdeal import FileAccessError, ParameterError
from mapdeal.formats.listing import list_files

SUFFIXES = (".pcd", ".ply")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("s10.pcd", "s9.pcd", "s9.PLY", "notes.txt", "b/1.pcd", "b/c/2.pcd", "odd[1].pcd"):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    (tmp_path / "d.pcd").mkdir()
    return tmp_path


@pytest.mark.parametrize(
    ("names", "found"),
    [
        (["s10.pcd", "s9.pcd", "s10.pcd"], ["s10.pcd", "s9.pcd", "s10.pcd"]),
        (["."], ["odd[1].pcd", "s9.PLY", "s9.pcd", "s10.pcd"]),
        (["s*"], ["s9.PLY", "s9.pcd", "s10.pcd"]),
        (["**/*.pcd"], ["b/1.pcd", "b/c/2.pcd", "odd[1].pcd", "s9.pcd", "s10.pcd"]),
        (["b", "s9.pcd"], ["b/1.pcd", "s9.pcd"]),
        (["odd[1].pcd"], ["odd[1].pcd"]),
        (["notes.txt", "b"], ["notes.txt", "b/1.pcd"]),
    ],
)
def test_files_folders_and_patterns(folder, names, found):
    assert [str(path) for path in list_files(names, SUFFIXES)] == found


@pytest.mark.parametrize("name", ["*.txt", "q*"])
def test_a_pattern_that_matches_nothing_f7(folder, name):
    with pytest.raises(ParameterError, match="no file"):
        list_files([name], SUFFIXES)


def test_a_folder_without_such_files(folder):
    with pytest.raises(FileAccessError, match="no file"):
        list_files(["d.pcd"], SUFFIXES)


def test_a_folder_in_itself_does_not_go_on_for_ever_f17(folder):
    (folder / "b" / "loop").symlink_to(folder / "b", target_is_directory=True)
    found = list_files(["b/**/*.pcd"], SUFFIXES)
    assert {path.name for path in found} == {"1.pcd", "2.pcd"}
    assert len({path.resolve() for path in found}) == len(found) == 2


def test_endings_that_a_folder_does_not_stand_for(folder):
    found = list_files([".", "s*.PLY"], (".pcd", ".ply", ".txt"), not_in_folders=(".ply", ".txt"))
    assert [str(path) for path in found] == ["odd[1].pcd", "s9.pcd", "s10.pcd", "s9.PLY"]


@pytest.mark.parametrize("name", ["missing.pcd", "missing", "no/such.pcd"])
def test_what_is_not_there(folder, name):
    with pytest.raises(FileAccessError, match=r"no such file"):
        list_files([name], SUFFIXES)


def test_a_name_sorts_before_longer_ones(folder):
    for name in ("depth.pcd", "depth2.pcd"):
        (folder / "b" / "c" / name).touch()
    found = [path.name for path in list_files(["b/c"], SUFFIXES)]
    assert found == ["2.pcd", "depth.pcd", "depth2.pcd"]


def test_an_absolute_pattern(folder):
    assert list_files([f"{folder}/b/?.pcd"], SUFFIXES) == [folder / "b" / "1.pcd"]
