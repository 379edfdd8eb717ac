"""Outputs that cannot be written, and batches with a bad map (rows F)."""

import json
import os

import pytest

from bad_maps import PGM, tree, write_map, yaml_text


@pytest.mark.parametrize("existing", ["o.yaml", "o.pgm", "o.npz"])
def test_an_output_that_exists_is_refused_unless_forced(folder, refused, accepted, existing):
    output = "o.npz" if existing == "o.npz" else "o.yaml"
    (folder / existing).write_text("precious\n")
    refused(["inflate", "m.yaml", "-o", output], 4, existing, hint="--force")
    accepted("inflate", "m.yaml", "-o", output, "--force")
    assert b"precious" not in (folder / existing).read_bytes()


def test_a_missing_output_folder_is_made(folder, accepted):
    accepted("inflate", "m.yaml", "-o", "new/deeper/o.npz")
    assert [path.name for path in (folder / "new" / "deeper").iterdir()] == ["o.npz"]


def test_a_run_that_is_up_to_date_is_skipped_f1(folder, accepted):
    accepted("run", "m.yaml", "-o", "out")
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*")}
    accepted("run", "m.yaml", "-o", "out")
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*")} == before


def test_a_run_into_the_outputs_of_another_is_refused_f1(accepted, refused):
    accepted("run", "m.yaml", "-o", "out")
    refused(["run", "m.yaml", "-o", "out", "--set", "inflate.radius=0.1"], 4, "out/m/",
            hint="--force")  # fmt: skip


@pytest.mark.parametrize("name", ["...yaml", "..yaml"], ids=["F11-three-dots", "F11-two-dots"])
def test_a_map_named_by_dots_writes_nothing_beside_its_own_folder(folder, command, name):
    (folder / name).write_text(yaml_text())
    before = tree(folder)
    code, _, err = command("run", name, "-o", "out")
    assert code in (0, 2)
    assert "Traceback" not in err
    outside = {path: data for path, data in tree(folder).items() if path.split("/")[0] != "out"}
    assert outside == before
    assert not (folder / "out" / "manifest.json").exists()


def test_a_map_whose_name_is_not_utf_8_is_run_f11(folder, command):
    (folder / "m.yaml").rename(folder / os.fsdecode(b"\xff.yaml"))
    code, _, err = command("run", os.fsdecode(b"\xff.yaml"), "-o", "out")
    assert "Traceback" not in err
    assert code == 0
    assert json.loads((folder / "out" / os.fsdecode(b"\xff") / "manifest.json").read_text())


OWN_INPUTS = [
    ("F3-itself", ["convert", "m.yaml", "-o", "m.yaml"], "m."),
    ("F3-its-image", ["convert", "m.yaml", "-o", "m.pgm"], "m."),
    ("F3-another-spelling", ["convert", "m.yaml", "-o", "sub/../m.yaml"], "m."),
    ("F3-symlink", ["convert", "m.yaml", "-o", "soft.yaml"], "soft.yaml"),
    ("F3-hard-link", ["convert", "m.yaml", "-o", "hard.yaml"], "hard.yaml"),
    ("F3-hard-link-of-the-image", ["convert", "m.yaml", "-o", "hard_image.pgm"], "hard_image"),
    ("F3-geometry-of-a-bare-array", ["esdf", "m.yaml", "-o", "m.npy"], "m.yaml"),
    ("F3-picture", ["esdf", "p.yaml", "-o", "o.npz", "--image", "p.png"], "p.png"),
    ("F3-run", ["run", "inflated/inflated.yaml", "-o", "."], "inflated.yaml"),
]


@pytest.mark.parametrize("force", [False, True], ids=["plain", "forced"])
@pytest.mark.parametrize(
    ("words", "place"), [pytest.param(*case, id=row) for row, *case in OWN_INPUTS]
)
def test_an_output_that_is_the_input_is_refused_always(folder, refused, words, place, force):
    write_map(folder / "inflated", yaml_text(image="m.pgm"))
    (folder / "inflated" / "m.yaml").rename(folder / "inflated" / "inflated.yaml")
    (folder / "sub").mkdir()
    (folder / "soft.yaml").symlink_to("m.yaml")
    (folder / "hard.yaml").hardlink_to(folder / "m.yaml")
    (folder / "hard_image.pgm").hardlink_to(folder / "m.pgm")
    (folder / "p.yaml").write_text(yaml_text(image="p.png"))
    (folder / "p.png").write_bytes(PGM)
    refused([*words, *["--force"] * force], 4, place)


@pytest.mark.parametrize(
    "manifest",
    ["{", "[]", '{"outputs": 3}', '{"figures": {}, "outputs": {"' + "n" * 300 + '": "0"}}'],
)
def test_a_manifest_that_is_none_counts_as_stale_f16(folder, accepted, manifest):
    accepted("run", "m.yaml", "-o", "out")
    (folder / "out" / "m" / "manifest.json").write_text(manifest)
    accepted("run", "m.yaml", "-o", "out", "--force")
    assert "outputs" in json.loads((folder / "out" / "m" / "manifest.json").read_text())


@pytest.mark.parametrize("option", [[], ["--force"], ["--dry-run"]], ids=lambda o: "".join(o))
@pytest.mark.parametrize("link", [False, True], ids=["file", "link"])
def test_a_run_of_a_map_in_its_own_folder_of_outputs_is_refused(folder, refused, option, link):
    (folder / "out").mkdir()
    write_map(folder / "out" / "m", yaml_text(image="m.pgm"))
    name = "out/m/m.yaml"
    if link:  # of the same name, so that its outputs go where it leads to
        (folder / "m.yaml").unlink()
        (folder / "m.yaml").symlink_to(name)
        name = "m.yaml"
    refused(["run", name, "-o", "out", *option], 4, "m.yaml", "where the outputs go",
            hint="another folder")  # fmt: skip


def test_left_overs_of_a_replaced_run_go_unless_they_are_changed_or_read(folder, accepted):
    accepted("run", "m.yaml", "-o", "out", "--sim")
    out = folder / "out" / "m"
    (out / "active.png").write_bytes(b"changed by hand")
    (folder / "m.yaml").unlink()
    (folder / "m.yaml").hardlink_to(out / "active.yaml")
    (folder / "active.pgm").write_bytes((out / "active.pgm").read_bytes())
    accepted("run", "m.yaml", "-o", "out", "--force")
    left = {path.name for path in out.iterdir() if path.stem == "active"}
    assert left == {"active.png", "active.yaml"}


def test_a_link_that_leads_nowhere_is_an_output_that_exists(folder, refused, accepted):
    for name, words in (("o.yaml", ["inflate"]), ("o.pbm", ["pack"])):
        (folder / name).symlink_to("nowhere/else.txt")
        refused([*words, "m.yaml", "-o", name], 4, name, hint="--force")
        accepted(*words, "m.yaml", "-o", name, "--force")
        assert (folder / name).is_file()
        assert not (folder / name).is_symlink()


@pytest.mark.parametrize("force", [[], ["--force"]], ids=["plain", "forced"])
def test_a_pipe_or_a_device_is_never_turned_into_a_file(folder, refused, force):
    os.mkfifo(folder / "o.npz")
    os.mkfifo(folder / "p.pgm")
    (folder / "d.npz").symlink_to("/dev/null")
    for name in ("o.npz", "p.yaml", "d.npz"):
        refused(["inflate", "m.yaml", "-o", name, *force], 4, name.replace("yaml", "pgm"))
    assert (folder / "o.npz").is_fifo()
