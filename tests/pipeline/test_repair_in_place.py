"""Repairs of maps in their own files, against copies of them and by what is left."""

import io
import json
import os
import shutil
import stat
from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image

from bad_maps import tree
from mapdeal import read_map
from mapdeal.checks.lint import lint_file
from mapdeal.commands import lint as repair

ROOM = np.full((12, 15), 205, np.uint8)
ROOM[1:-1, 1:-1] = 0
ROOM[2:-2, 2:-2] = 254
KEYS = {
    "image": "m.pgm", "mode": "trinary", "resolution": "0.05", "origin": "[-1.5, 2.0, 0.0]",
    "negate": "0", "occupied_thresh": "0.65", "free_thresh": "0.196",
}  # fmt: skip


def pgm(pixels=ROOM):
    return b"P5\n15 12\n255\n" + pixels.tobytes()


def yaml_text(without=(), **changes):
    keys = {**KEYS, **changes}
    return "".join(f"{key}: {text}\n" for key, text in keys.items() if key not in without)


@pytest.fixture
def folder(tmp_path, monkeypatch, mapdeal_warnings):
    monkeypatch.chdir(tmp_path)
    Path("m.pgm").write_bytes(pgm())
    Path("m.yaml").write_text(yaml_text())
    return tmp_path


def write(text, name="m.yaml"):
    Path(name).write_bytes(text if isinstance(text, bytes) else text.encode())


def fixed(command, *words):
    return command("lint", "m.yaml", "--fix", "--in-place", *words)


@pytest.mark.parametrize(("before", "after"), [
    ({"free_thresh": "0.25"}, {"free_thresh": "0.196"}),
    ({"resolution": "0.05000000074505806"}, {"resolution": "0.05"}),
    ({"resolution": "5e-2"}, {"resolution": "0.05"}),
    ({"origin": "[-1.5, 2, -nan]"}, {"origin": "[-1.5, 2.0, 0.0]"}),
    ({"origin": "\n- -1.5000000000000009\n- 2 # m\n- 0"},
     {"origin": "\n- -1.5\n- 2.0 # m\n- 0.0"}),
    ({"origin": "[-1.5, 2, 1e-9]"}, {"origin": "[-1.5, 2.0, 0.0]"}),
    ({"mode": "Trinary"}, {"mode": "trinary"}),
    ({"image": "/nowhere/m.pgm"}, {"image": "m.pgm"}),
    ({"image": ">-\n  /nowhere/m.pgm"}, {"image": "m.pgm"}),
    ({"image": "C:\\maps\\m.pgm"}, {"image": "m.pgm"}),
    ({"origin": "[-1.5000000000000009, 2, .0]", "free_thresh": "2.5e-1"},
     {"origin": "[-1.5, 2.0, 0.0]", "free_thresh": "0.196"}),
])  # fmt: skip
def test_values_are_replaced_where_they_stand(command, folder, before, after):
    """All else stays: comments, order, line ends, other keys, and the image."""
    around = "# the dock\n{}# mapdeal: ignore map\nextra:   {{a: [1,  2]}}   # mine\n"
    write(around.format(yaml_text(**before)).replace("\n", "\r\n"))
    names = {one.check for one in lint_file(Path("m.yaml"))}
    assert names - {"yaml.unknown-key"}
    code, out, _ = fixed(command)
    assert code == 0
    assert (
        Path("m.yaml").read_bytes()
        == around.format(yaml_text(**after)).replace("\n", "\r\n").encode()
    )
    assert Path("m.pgm").read_bytes() == pgm()
    assert {one.check for one in lint_file(Path("m.yaml"))} <= {"yaml.unknown-key"}
    told = [line for line in out.splitlines() if line.startswith("m.yaml: repaired: ")]
    assert len(told) == len(after)
    assert out.splitlines()[-1].startswith("1 map: 0 errors, 1 warning")
    assert out.splitlines()[-1].endswith(", 1 repaired")


@pytest.mark.parametrize("end", ["\n", ""])
def test_keys_that_are_missing_come_behind_the_others(command, folder, end):
    text = yaml_text(without=("negate", "free_thresh"))
    write(text.removesuffix("\n") + end)
    assert fixed(command)[0] == 0
    assert Path("m.yaml").read_text() == text + "negate: 0\nfree_thresh: 0.196\n"
    assert lint_file(Path("m.yaml")) == []
    # an old mode gets the key of today
    text = yaml_text(without=("mode",)) + "trinary: true\n"
    write(text)
    assert fixed(command)[0] == 0
    assert Path("m.yaml").read_text() == f"{text}mode: trinary\n"
    assert "yaml.legacy-mode" not in {one.check for one in lint_file(Path("m.yaml"))}


def test_a_name_like_a_date_gets_quotes(command, folder):
    Path("2024-01-01").write_bytes(pgm())
    write(yaml_text(image="2024-01-01"))
    assert fixed(command)[0] == 0
    assert yaml.safe_load(Path("m.yaml").read_text())["image"] == "2024-01-01"


def test_a_good_map_is_left_alone(command, folder):
    before = tree(folder)
    times = [path.stat().st_mtime_ns for path in folder.iterdir()]
    assert fixed(command) == (0, "1 map: 0 errors, 0 warnings, 0 notes\n", "")
    assert tree(folder) == before
    assert [path.stat().st_mtime_ns for path in folder.iterdir()] == times


def test_what_cannot_be_repaired_is_left_and_decides_the_exit_code(command, folder):
    pixels = np.full_like(ROOM, 205)
    Path("m.pgm").write_bytes(pgm(pixels))
    write(yaml_text(resolution="0.05000000074505806"))
    code, out, _ = fixed(command)
    assert code == 1
    assert "m.yaml: repaired: resolution 0.05" in out
    assert "map.all-unknown" in out


@pytest.mark.parametrize(("words", "text"), [
    (["--ignore", "yaml.resolution-noise"], ""),
    (["--select", "image"], ""),
    ([], "# mapdeal: ignore yaml\n"),
])  # fmt: skip
def test_what_does_not_count_is_not_repaired(command, folder, words, text):
    write(yaml_text(resolution="0.05000000074505806") + text)
    before = tree(folder)
    assert fixed(command, *words)[0] == 0
    assert tree(folder) == before


@pytest.mark.parametrize("kind", ["pgm", "png"])
@pytest.mark.parametrize("negate", ["0", "1"])
def test_a_turned_map_is_made_anew_as_its_copy_is(command, folder, kind, negate):
    pixels = 255 - ROOM if negate == "1" else ROOM
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "PNG")
    Path(f"m.{kind}").write_bytes(pgm(pixels) if kind == "pgm" else file.getvalue())
    write("# mine\n" + yaml_text(image=f"m.{kind}", origin="[-1.5, 2.0, 0.3]", negate=negate))
    assert command("lint", "m.yaml", "--fix", "-o", "copy.yaml")[0] == 0
    code, out, _ = fixed(command)
    assert code == 0
    assert f"m.yaml: repaired: m.{kind} written anew" in out.splitlines()
    here, copy = read_map("m.yaml"), read_map("copy.yaml")
    assert here.origin == copy.origin
    assert here.origin[2] == 0
    assert np.array_equal(here.occupancy, copy.occupancy)
    assert Path("m.yaml").read_text().startswith(f"# mine\nimage: m.{kind}\nmode: trinary\n")
    assert sorted(path.name for path in folder.iterdir() if path.name[0] == "m") == sorted(
        {"m.pgm", f"m.{kind}", "m.yaml"}
    )


def test_an_image_of_a_format_that_is_only_read_gets_one_beside_it(command, folder):
    file = io.BytesIO()
    Image.fromarray(ROOM).save(file, "BMP")
    Path("n.bmp").write_bytes(file.getvalue())
    write(yaml_text(image="n.bmp", origin="[-1.5, 2.0, 0.3]"), "n.yaml")
    code, out, _ = command("lint", "n.yaml", "--fix", "--in-place")
    assert code == 0
    assert "n.yaml: repaired: n.pgm written beside n.bmp, whose format is only read" in out
    assert Path("n.bmp").read_bytes() == file.getvalue()
    assert "image: n.pgm\n" in Path("n.yaml").read_text()
    assert read_map("n.yaml").origin[2] == 0


def test_a_file_in_the_place_of_a_new_image_is_not_replaced_and_the_others_go_on(command, folder):
    write(yaml_text(origin="[-1.5, 2.0, 0.3]"), "turned.yaml")
    write(yaml_text(free_thresh="0.25"))
    Path("turned.pgm").write_text("mine")
    text = Path("turned.yaml").read_bytes()
    code, out, err = command("lint", ".", "--fix", "--in-place")
    assert code == 4
    told = "its image m.pgm, which m.yaml also uses, would become turned.pgm, which exists"
    hint = "mapdeal lint MAP --fix -o OUT writes a repaired copy"
    assert err.splitlines() == [f"error: turned.yaml: {told}", f"hint: {hint}"]
    assert (Path("turned.yaml").read_bytes(), Path("turned.pgm").read_text()) == (text, "mine")
    assert "m.yaml: repaired: free_thresh 0.196" in out


def test_a_yaml_that_cannot_be_edited_is_left(command, folder):
    write("{" + ", ".join(yaml_text(without=("negate",)).splitlines()) + "}\n")
    before = tree(folder)
    code, _, err = fixed(command)
    assert code == 3
    assert "m.yaml: its YAML is written in a way that cannot be edited" in err
    assert tree(folder) == before


def test_permissions_and_links_stay(command, folder):
    Path("real").mkdir()
    Path("m.pgm").rename("real/m.pgm")
    Path("m.yaml").unlink()
    write(yaml_text(origin="[-1.5, 2.0, 0.3]"), "real/m.yaml")
    Path("real/m.yaml").chmod(0o640)
    Path("real/m.pgm").chmod(0o600)
    Path("m.yaml").symlink_to("real/m.yaml")
    Path("m.pgm").symlink_to("real/m.pgm")
    assert fixed(command)[0] == 0
    assert Path("m.yaml").is_symlink()
    assert Path("m.pgm").is_symlink()
    assert read_map("real/m.yaml").origin[2] == 0
    modes = [stat.S_IMODE(Path(f"real/m.{end}").stat().st_mode) for end in ("yaml", "pgm")]
    assert modes == [0o640, 0o600]


def test_a_failure_leaves_both_files_as_they_were(command, folder, monkeypatch):
    write(yaml_text(origin="[-1.5, 2.0, 0.3]"))
    before = tree(folder)
    replace = os.replace
    failed = []

    def fails_for_the_yaml(self, target):
        if Path(target).name == "m.yaml" and not failed:
            failed.append(target)  # once: what is undone goes the same way
            raise PermissionError(13, "Permission denied")
        return replace(self, target)

    monkeypatch.setattr(Path, "replace", fails_for_the_yaml)
    code, _, err = fixed(command)
    assert code == 4
    assert "m.yaml: cannot be replaced: Permission denied" in err
    assert tree(folder) == before


def test_other_forms_tell_repairs_too(command, folder):
    write(yaml_text(free_thresh="0.25"))
    code, out, err = fixed(command, "--format", "json")
    (entry,) = json.loads(out)["maps"]
    assert (code, entry["repairs"]) == (0, ["free_thresh 0.196"])
    assert err == "m.yaml: repaired: free_thresh 0.196\n"
    assert fixed(command, "--format", "json")[2] == ""


def test_maps_that_are_no_pairs_are_left(command, folder):
    assert command("convert", "m.yaml", "-o", "m.npz")[0] == 0
    before = tree(folder)
    assert command("lint", "m.npz", "--fix", "--in-place")[0] == 0
    assert tree(folder) == before


def test_real_maps_are_repaired_as_their_copies_are(command, real_maps, tmp_path):
    """Every map of which something is repaired: its cells are those of ``--fix -o``."""
    sources = [*real_maps.rglob("testmap*.yaml"), *real_maps.rglob("depot.yaml")]
    assert len(sources) >= 3
    for number, source in enumerate(sources):
        folder = tmp_path / str(number)
        shutil.copytree(source.parent, folder)
        path = folder / source.name
        command("lint", path, "--fix", "-o", folder / "copy" / "c.yaml")
        _, out, _ = command("lint", path, "--fix", "--in-place")
        if "repaired" not in out:
            continue
        here, copy = read_map(path), read_map(folder / "copy" / "c.yaml")
        assert here.origin == copy.origin
        assert np.array_equal(here.occupancy, copy.occupancy), source


@pytest.mark.parametrize("written", [
    lambda text: b"\xef\xbb\xbf" + text.encode(),
    lambda text: ("{" + ", ".join(text.splitlines()) + "}\n").encode(),
], ids=["byte order mark", "flow mapping"])  # fmt: skip
def test_other_ways_of_writing_stay(command, folder, written):
    write(written(yaml_text(free_thresh="0.25")))
    assert fixed(command)[0] == 0
    assert Path("m.yaml").read_bytes() == written(yaml_text())


@pytest.mark.parametrize("when", ["gather", "edited"])
def test_a_map_that_changes_while_it_is_repaired_is_left(command, folder, monkeypatch, when):
    write(yaml_text(free_thresh="0.25"))
    theirs = yaml_text(free_thresh="0.3") + "# a change by somebody else\n"
    real = getattr(repair, when)

    def meanwhile(*given, **words):
        found = real(*given, **words)
        write(theirs)
        return found

    monkeypatch.setattr(repair, when, meanwhile)
    code, _, err = fixed(command)
    assert (code, "m.yaml: changed while it was read" in err) == (4, True)
    assert Path("m.yaml").read_text() == theirs
    assert sorted(path.name for path in folder.iterdir()) == ["m.pgm", "m.yaml"]


@pytest.mark.parametrize(
    "name", ["m.pgm", "link.pgm", "/home/robot/maps/m.pgm", "C:\\maps\\m.pgm", ".\\m.pgm"]
)
def test_an_image_that_another_map_uses_is_left_to_it(command, folder, name):
    """Names of other systems are read as that of the image here."""
    Path("link.pgm").symlink_to("m.pgm")
    write(yaml_text(image=name), "user.yaml")
    write(yaml_text(origin="[-1.5, 2.0, 0.3]"))
    before = read_map("user.yaml")
    assert fixed(command)[0] == 4  # m.pgm is in the place of the new image
    assert Path("m.pgm").read_bytes() == pgm()
    Path("m.yaml").rename("turned.yaml")
    code, out, _ = command("lint", "turned.yaml", "--fix", "--in-place")
    assert code == 0
    told = "turned.yaml: repaired: turned.pgm written beside m.pgm, which user.yaml also uses"
    assert told in out
    assert Path("m.pgm").read_bytes() == pgm()
    assert np.array_equal(read_map("user.yaml").occupancy, before.occupancy)
    assert read_map("turned.yaml").origin[2] == 0
