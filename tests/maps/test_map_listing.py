import itertools
import os
from pathlib import Path

import pytest

from mapdeal import FileAccessError, MalformedInputError, ParameterError
from mapdeal.maps.listing import ListedFolders, list_maps
from odd_names import private

MAP = "image: m.pgm\nresolution: 0.05\norigin: [0, 0, 0]\n"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("maps/a.yaml", "maps/b10.yaml", "maps/b9.yml", "maps/deep/er/c.yaml"):
        write(tmp_path / name, MAP)
    write(tmp_path / "maps/params.yaml", "amcl:\n  ros__parameters:\n    image: none\n")
    write(tmp_path / "maps/recipe.yaml", "stages: [inflate]\n")
    write(tmp_path / "maps/.hidden/h.yaml", MAP)
    write(tmp_path / "maps/n.npz", "")
    write(tmp_path / "other/d.yaml", MAP)
    return tmp_path


GOOD = {"maps/a.yaml", "maps/b10.yaml", "maps/b9.yml", "maps/deep/er/c.yaml"}


def write(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def listed(*names, output="out", stdin=b""):
    return list_maps(names, Path(output), lambda: [stdin])


def places(*names, **more):
    return {entry.path.as_posix(): entry.place.as_posix() for entry in listed(*names, **more).maps}


@pytest.mark.parametrize(("names", "expected"), [
    (["maps/a.yaml", "other/d.yaml"], {"maps/a.yaml": "a", "other/d.yaml": "d"}),
    (["maps"], {"maps/a.yaml": "a", "maps/b9.yml": "b9", "maps/b10.yaml": "b10",
                "maps/deep/er/c.yaml": "deep/er/c"}),
    (["maps/deep", "other"], {"maps/deep/er/c.yaml": "maps/deep/er/c", "other/d.yaml": "other/d"}),
    (["maps/gone.yaml", "gone.yaml"], {"maps/gone.yaml": "gone", "gone.yaml": "gone"}),
    (["maps/deep", "other/d.yaml"], {"maps/deep/er/c.yaml": "er/c", "other/d.yaml": "d"}),
    (["maps/*.yml"], {"maps/b9.yml": "b9"}),
    (["maps/n*"], {"maps/n.npz": "n"}),
    (["**/[cd].yaml"], {"maps/deep/er/c.yaml": "maps/deep/er/c", "other/d.yaml": "other/d"}),
    (["maps/d*/*/c.yaml"], {"maps/deep/er/c.yaml": "deep/er/c"}),
    (["maps/../other"], {"maps/../other/d.yaml": "d"}),
    (["maps/d*/../a.yaml"], {"maps/deep/../a.yaml": "a"}),
])  # fmt: skip
def test_maps_and_their_places(folder, names, expected):
    assert list(places(*names).items()) == list(expected.items())


def test_the_parents_of_listed_files_count_for_the_common_root(folder):
    write(folder / "list.txt", "# of today\r\n\r\nmaps/deep/er/c.yaml\r\nother/*.yaml  \r\n")
    expected = {"maps/deep/er/c.yaml": "maps/deep/er/c", "other/d.yaml": "other/d"}
    assert places("@list.txt") == expected
    assert places("@-", stdin=(folder / "list.txt").read_bytes()) == expected
    write(folder / "one.txt", "\ufeffmaps/a.yaml\nmaps/deep")
    assert places("@one.txt") == {"maps/a.yaml": "a", "maps/deep/er/c.yaml": "deep/er/c"}


@pytest.mark.parametrize(("content", "message"), [
    (b"", "names no map"),
    (b"# nothing\n\n", "names no map"),
    (b"a.yaml\nb\xe9.yaml\n", "line 2: a list of maps must be UTF-8"),
    ("maps\n".encode("utf-16"), "must be UTF-8"),
    (None, "cannot be read"),
])  # fmt: skip
def test_malformed_lists_are_refused(folder, content, message):
    if content is not None:
        (folder / "list.txt").write_bytes(content)
    with pytest.raises((ParameterError, FileAccessError), match=message):
        listed("@list.txt")


@pytest.mark.parametrize(("text", "is_map"), [
    (MAP, True),
    ("\ufeff" + MAP, True),
    ("resolution: 1\n'image': m.pgm\n", True),
    ("{resolution: 1, image: m.pgm}", True),
    ("  image: m.pgm\n  resolution: 1\n", True),
    ("image: m.pgm\n\t- broken: [\n", True),
    ("imagery: m.pgm\n", False),
    ("map:\n  image: m.pgm\n", False),
    ("broken: [\n", False),
])  # fmt: skip
def test_what_makes_a_yaml_file_a_map(folder, text, is_map):
    write(folder / "some" / "x.yaml", text)
    write(folder / "some" / "y.yaml", MAP)
    assert [entry.path.stem for entry in listed("some").maps] == ["x", "y"][not is_map :]


@pytest.mark.parametrize("names", [["."], ["**/*.y*ml"]])
def test_nothing_in_the_output_folder_is_an_input(folder, names):
    write(folder / "out" / "a" / "inflated.yaml", MAP)
    write(folder / "out.yaml", MAP)
    (folder / "link").symlink_to("out", target_is_directory=True)
    assert set(places(*names)) == GOOD | {"other/d.yaml", "out.yaml"}
    assert places("out/a/inflated.yaml") == {"out/a/inflated.yaml": "inflated"}  # named itself


def test_what_is_named_twice_is_one_map_at_its_first_place_and_other_yaml_is_left_out(folder):
    found = listed("maps/deep/er/c.yaml", "maps", "maps/../maps/a.yaml", "maps/a*", "maps/*.yaml")
    assert [entry.place.as_posix() for entry in found.maps] == ["c", "a", "b9", "b10"]
    assert [path.name for path in found.repeated] == ["c.yaml", "a.yaml", "b10.yaml"]
    assert [path.name for path in found.left_out] == ["params.yaml", "recipe.yaml"]


def test_folders_of_runs_and_unreadable_ones_are_listed_themselves_on_request(folder, monkeypatch):
    for name in ("run/mark", "run/part/p.yaml", "run/other/o.yaml", "batch/sum", "batch/q.yaml"):
        write(folder / "maps" / name, MAP)
    private(folder / "maps" / "deep", monkeypatch)
    exempt = ListedFolders("mark", lambda _: True, "sum", lambda _: True, ("part",))
    found = list_maps(["maps", "maps/run/mark"], None, list, exempt=exempt).maps
    names = " ".join(entry.path.relative_to("maps").as_posix() for entry in found)
    assert names == "a.yaml b9.yml b10.yaml batch/q.yaml run/other/o.yaml batch deep run"


def test_links_in_circles_end_and_give_each_map_once(folder):
    (folder / "maps" / "deep" / "up").symlink_to(folder / "maps", target_is_directory=True)
    (folder / "maps" / "self").symlink_to("self")
    (folder / "linked").symlink_to(folder / "maps" / "deep", target_is_directory=True)
    assert len(listed("maps").maps) == 5
    assert "linked/er/c.yaml" in places(".")
    assert len(listed(".").maps) == 6


def test_what_cannot_be_followed_may_be_a_map_or_a_folder_of_maps(folder):
    for name in ("gone.yaml", "site", "deep/gone.yml", "notes.txt", "lost.pgm", ".hidden2"):
        (folder / "maps" / name).symlink_to("nothing")
    (folder / "maps" / "a-folder").symlink_to(folder / "other", target_is_directory=True)
    os.mkfifo(folder / "maps" / "pipe.yaml")
    os.mkfifo(folder / "maps" / "pipe")
    broken = {"maps/gone.yaml", "maps/site", "maps/deep/gone.yml", "maps/pipe.yaml"}
    assert set(places("maps")) == GOOD | broken | {"maps/a-folder/d.yaml"}
    in_maps = {file_name for file_name in GOOD | broken if file_name.count("/") == 1}
    assert set(places("maps/*.y*ml")) == in_maps - {"maps/site"}


@pytest.mark.parametrize(("names", "error", "message"), [
    (["*.png"], ParameterError, "matches no"),
    (["maps/p*.yaml"], ParameterError, "matches no"),
    (["q[1]"], ParameterError, "matches no"),
    (["maps/deep/er/*.yaml", "oth*"], ParameterError, "matches no"),
    ([""], ParameterError, "must not be empty"),
    (["empty"], FileAccessError, "empty: is a directory without a map"),
    (["empty", "out"], FileAccessError, "outside of the folder of outputs"),
])  # fmt: skip
def test_names_that_stand_for_no_map(folder, names, error, message):
    (folder / "empty").mkdir()
    write(folder / "out" / "a" / "inflated.yaml", MAP)
    with pytest.raises(error, match=message):
        listed(*names)


def test_a_list_that_never_ends_is_refused(folder):
    endless = itertools.repeat(b"maps/a.yaml\n" * 1_000_000)
    with pytest.raises(MalformedInputError, match="standard input: must not be larger than"):
        list_maps(["@-"], Path("out"), lambda: endless)


def test_a_bit_map_and_its_yaml_are_one_map(folder):
    write(folder / "maps/x.yaml", MAP.replace("m.pgm", "x.pbm"))
    write(folder / "maps/x.pbm", "")
    write(folder / "maps/image_of_another.pbm", "")
    assert "maps/x.yaml" in places("maps")
    for pattern in ("maps/*", "maps/[xi]*", "maps/**"):
        found = listed(pattern)
        assert [p for p in places(pattern) if "x" in p or "image" in p] == ["maps/x.yaml"]
        assert found.repeated == ()
    assert places("maps/x.pbm") == {"maps/x.pbm": "x"}
    # a pattern with their ending lists all; reading one reports its missing YAML file
    assert set(places("maps/*.pbm")) == {"maps/image_of_another.pbm", "maps/x.pbm"}
    for names, found, repeated in (
        (["maps/x.pbm", "maps/x.yaml"], ["x.pbm"], "x.yaml"),
        (["maps/x.yaml", "maps/*.pbm"], ["x.yaml", "image_of_another.pbm"], "x.pbm"),
    ):
        both = listed(*names)
        assert [entry.path.name for entry in both.maps] == found
        assert [path.name for path in both.repeated] == [repeated]
