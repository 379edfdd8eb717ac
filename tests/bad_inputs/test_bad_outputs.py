"""Outputs that cannot be written, and batches with a bad map (rows F)."""

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


@pytest.mark.parametrize("name", ["...yaml", "..yaml"])
def test_a_map_named_by_dots_writes_nothing_beside_its_own_folder(folder, command, name):
    (folder / name).write_text(yaml_text())
    before = tree(folder)
    code, _, err = command("run", name, "-o", "out")
    assert (code in (0, 2), "Traceback" in err) == (True, False)
    assert {path: data for path, data in tree(folder).items() if path[:3] != "out"} == before
    assert not (folder / "out" / "manifest.json").exists()


@pytest.mark.parametrize("line", ["convert m.yaml -o N.yaml", "convert m.yaml -o N.png",
                                  "pack m.yaml -o N.pbm"])  # fmt: skip
def test_a_yaml_never_names_an_image_that_is_not_utf_8(refused, line):
    refused(line.replace("N", os.fsdecode(b"n\xff")).split(), 2, "not UTF-8", hint=".npz")


@pytest.mark.parametrize("force", [[], ["--force"]], ids=["plain", "forced"])
@pytest.mark.parametrize(("words", "place"), [
    ("convert m.yaml -o m.yaml", "m."),
    ("convert m.yaml -o m.pgm", "m."),
    ("convert m.yaml -o sub/../m.yaml", "m."),
    ("convert m.yaml -o soft.yaml", "soft.yaml"),
    ("convert m.yaml -o hard.yaml", "hard.yaml"),
    ("convert m.yaml -o hard_image.pgm", "hard_image"),
    ("esdf m.yaml -o m.npy", "m.yaml"),  # a bare array has its geometry beside it
    ("esdf p.yaml -o o.npz --image p.png", "p.png"),
    ("run inflated/inflated.yaml -o .", "inflated.yaml"),
])  # fmt: skip
def test_an_output_that_is_the_input_is_refused_always(folder, refused, words, place, force):
    write_map(folder / "inflated", yaml_text(image="m.pgm"))
    (folder / "inflated" / "m.yaml").rename(folder / "inflated" / "inflated.yaml")
    (folder / "sub").mkdir()
    (folder / "soft.yaml").symlink_to("m.yaml")
    (folder / "hard.yaml").hardlink_to(folder / "m.yaml")
    (folder / "hard_image.pgm").hardlink_to(folder / "m.pgm")
    (folder / "p.yaml").write_text(yaml_text(image="p.png"))
    (folder / "p.png").write_bytes(PGM)
    refused([*words.split(), *force], 4, place)


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
    names = {path.name for path in out.iterdir() if path.stem == "active"}
    assert names == {"active.png", "active.yaml"}


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
