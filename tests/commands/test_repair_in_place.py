"""Repairs of maps in their own files, compared with copies, and the files that remain."""

import json
import os
import stat
from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image

from bad_maps import tree
from mapdeal import read_map, write_map
from mapdeal.checks.lint import lint_file
from mapdeal.commands import lint as repair

ROOM = np.full((12, 15), 205, np.uint8)
ROOM[1:-1, 1:-1] = 0
ROOM[2:-2, 2:-2] = 254
KEYS = {
    "image": "m.pgm", "mode": "trinary", "resolution": "0.05", "origin": "[-1.5, 2.0, 0.0]",
    "negate": "0", "occupied_thresh": "0.65", "free_thresh": "0.196",
}  # fmt: skip
PGM = b"P5\n15 12\n255\n" + ROOM.tobytes()
TURNED = {"origin": "[-1.5, 2.0, 0.3]"}


def yaml_text(without=(), **changes):
    keys = {**KEYS, **changes}
    return "".join(f"{key}: {text}\n" for key, text in keys.items() if key not in without)


def write(text, name="m.yaml"):
    Path(name).write_bytes(text if isinstance(text, bytes) else text.encode())


@pytest.fixture
def folder(here, mapdeal_warnings):
    write(PGM, "m.pgm")
    write(yaml_text())
    return here


@pytest.fixture
def fixed(command, folder):
    return lambda *words, name="m.yaml": command("lint", name, "--fix", "--in-place", *words)


def around(**keys):
    text = f"# mine\n{yaml_text(**keys)}# mapdeal: ignore map\nextra:   {{a: [1,  2]}}   # mine\n"
    return text.replace("\n", "\r\n")


def flow(text):
    return "{" + ", ".join(text.splitlines()) + "}\n"


NOISE = yaml_text(resolution="0.05000000074505806")
MISSING = yaml_text(without=("negate", "free_thresh"))
OLD_MODE = yaml_text(without=("mode",)) + "trinary: true\n"
BOM = "\ufeff"


@pytest.mark.parametrize(("before", "after", "count"), [
    *((around(**{key: text}), around(), 1) for key, text in (
        ("free_thresh", "0.25"), ("resolution", "0.05000000074505806"), ("resolution", "5e-2"),
        ("origin", "[-1.5, 2, -nan]"), ("origin", "[-1.5, 2, 1e-9]"), ("mode", "Trinary"),
        ("image", "/nowhere/m.pgm"), ("image", ">-\n  /nowhere/m.pgm"),
        ("image", "C:\\maps\\m.pgm"), ("negate", "false"),
    )),
    (around(origin="\n- -1.5\n- 2 # m\n- -nan"),
     around(origin="\n- -1.5\n- 2.0 # m\n- 0.0"), 1),
    (around(origin="[-1.5, 2, -nan]", free_thresh="2.5e-1"), around(), 2),
    (MISSING, MISSING + "negate: 0\nfree_thresh: 0.196\n", 2),
    (MISSING.removesuffix("\n"), MISSING + "negate: 0\nfree_thresh: 0.196\n", 2),
    (OLD_MODE, OLD_MODE + "mode: trinary\n", 1),
    (BOM + yaml_text(free_thresh="0.25"), BOM + yaml_text(), 1),
    (flow(yaml_text(free_thresh="0.25")), flow(yaml_text()), 1),
])  # fmt: skip
def test_values_are_replaced_where_they_stand(fixed, before, after, count):
    """All else stays: comments, order, line ends, other keys, and the image."""
    write(before)
    code, out, _ = fixed()
    assert code == 0
    assert Path("m.yaml").read_bytes() == after.encode()
    assert Path("m.pgm").read_bytes() == PGM
    assert {finding.check for finding in lint_file(Path("m.yaml"))} <= {"yaml.unknown-key"}
    assert sum(line.startswith("m.yaml: repaired: ") for line in out.splitlines()) == count
    assert out.endswith(", 1 repaired\n")


def test_a_name_like_a_date_gets_quotes(fixed):
    write(PGM, "2024-01-01")
    write(yaml_text(image="2024-01-01"))
    assert fixed()[0] == 0
    assert yaml.safe_load(Path("m.yaml").read_text())["image"] == "2024-01-01"


@pytest.mark.parametrize(("text", "words", "code", "message"), [
    (yaml_text(), [], 0, ""),
    (NOISE, ["--ignore", "yaml.resolution-noise"], 0, ""),
    (NOISE, ["--select", "image"], 0, ""),
    (NOISE + "# mapdeal: ignore yaml\n", [], 0, ""),
    (flow(MISSING), [], 3, "m.yaml: its YAML is written in a way that cannot be edited"),
], ids=["good", "ignored", "not selected", "a comment", "cannot be edited"])  # fmt: skip
def test_what_does_not_count_or_cannot_be_edited_is_left(fixed, folder, text, words, code, message):
    write(text)
    write_map("m.npz", read_map("m.yaml"))
    before = tree(folder)
    times = [path.stat().st_mtime_ns for path in folder.iterdir()]
    found, out, err = fixed(*words)
    assert (found, message in err, "repaired" in out) == (code, True, False)
    assert fixed(name="m.npz")[0] == 0
    assert tree(folder) == before
    assert [path.stat().st_mtime_ns for path in folder.iterdir()] == times


def test_what_cannot_be_repaired_is_left_and_decides_the_exit_code(fixed):
    write(b"P5\n15 12\n255\n" + bytes([205]) * ROOM.size, "m.pgm")
    write(NOISE)
    code, out, _ = fixed()
    assert (code, "map.all-unknown" in out) == (1, True)
    assert "m.yaml: repaired: resolution 0.05" in out


@pytest.mark.parametrize("kind", ["pgm", "png"])
@pytest.mark.parametrize("negate", ["0", "1"])
def test_a_turned_map_is_made_anew_as_its_copy_is(command, fixed, folder, kind, negate):
    pixels = 255 - ROOM if negate == "1" else ROOM
    Image.fromarray(pixels).save(f"m.{kind}")
    write("# mine\n" + yaml_text(image=f"m.{kind}", negate=negate, **TURNED))
    assert command("lint", "m.yaml", "--fix", "-o", "copy.yaml")[0] == 0
    code, out, _ = fixed()
    assert code == 0
    assert f"m.yaml: repaired: m_turned.pgm written beside m.{kind}" in out.splitlines()
    here, copy = read_map("m.yaml"), read_map("copy.yaml")
    assert here.origin == copy.origin
    assert here.origin[2] == 0
    assert np.array_equal(here.occupancy, copy.occupancy)
    assert Path("m.yaml").read_text().startswith("# mine\nimage: m_turned.pgm\nmode: trinary\n")
    assert {path.name for path in folder.glob("m_*")} == {"m_turned.pgm"}


def test_the_old_image_stays_for_other_maps_and_no_file_is_replaced_by_the_new_one(fixed):
    write(yaml_text(**TURNED), "turned.yaml")
    write(yaml_text(free_thresh="0.25"))
    code, out, _ = fixed(name=".")
    assert code == 0
    assert "m.yaml: repaired: free_thresh 0.196" in out
    assert Path("m.pgm").read_bytes() == PGM
    write(yaml_text(**TURNED), "turned.yaml")
    code, _, err = fixed(name=".")
    message = "turned.yaml: its turned image would be turned_turned.pgm, which exists"
    hint = "mapdeal lint MAP --fix -o OUT writes a repaired copy"
    assert (code, err.splitlines()) == (4, [f"error: {message}", f"hint: {hint}"])


def test_permissions_and_links_stay(fixed):
    Path("real").mkdir()
    for name, mode in (("m.yaml", 0o640), ("m.pgm", 0o600)):
        real = Path(name).rename(f"real/{name}")
        Path(name).symlink_to(real)
        if name == "m.yaml":
            write(yaml_text(**TURNED), real)
        real.chmod(mode)
    assert "beside a link" in fixed()[2]
    assert fixed(name="real/m.yaml")[0] == 0
    assert Path("m.yaml").is_symlink()
    assert read_map("real/m.yaml").origin[2] == 0
    assert stat.S_IMODE(Path("real/m.yaml").stat().st_mode) == 0o640


def test_a_failure_leaves_both_files_as_they_were(fixed, folder, monkeypatch):
    write(yaml_text(**TURNED))
    before, failed, replace = tree(folder), [], os.replace

    def fails_for_the_yaml(self, target):
        if Path(target).name == "m.yaml" and not failed:
            failed.append(target)  # fail once: the old file returns by the same call
            raise PermissionError(13, "Permission denied")
        return replace(self, target)

    monkeypatch.setattr(Path, "replace", fails_for_the_yaml)
    code, _, err = fixed()
    assert code == 4
    assert "m.yaml: cannot be replaced: Permission denied" in err
    assert tree(folder) == before


def test_other_forms_tell_repairs_too(fixed):
    write(yaml_text(free_thresh="0.25"))
    code, out, err = fixed("--format", "json")
    (entry,) = json.loads(out)["maps"]
    assert (code, entry["repairs"]) == (0, ["free_thresh 0.196"])
    assert err == "m.yaml: repaired: free_thresh 0.196\n"
    assert fixed("--format", "json")[2] == ""


@pytest.mark.parametrize("place", [(repair, "gather"), (repair.yaml_text, "with_values")])
def test_a_map_that_changes_while_it_is_repaired_is_left(fixed, folder, monkeypatch, place):
    write(yaml_text(free_thresh="0.25"))
    theirs = yaml_text(free_thresh="0.3") + "# a change by somebody else\n"
    real = getattr(*place)

    def meanwhile(*arguments, **words):
        found = real(*arguments, **words)
        write(theirs)
        return found

    monkeypatch.setattr(*place, meanwhile)
    code, _, err = fixed()
    assert (code, "m.yaml: changed while it was read" in err) == (4, True)
    assert Path("m.yaml").read_text() == theirs
    assert sorted(path.name for path in folder.iterdir()) == ["m.pgm", "m.yaml"]
