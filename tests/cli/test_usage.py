import shutil
from pathlib import Path

import pytest

from drawn import grid_from_text
from mapdeal import OccupancyGrid, PotentialField, write_map
from mapdeal.cli.main import command_names
from mapdeal.grid.values import join_words
from mapdeal.maps.formats import FORMATS


@pytest.fixture(autouse=True)
def small(here):
    write_map("m.yaml", grid_from_text("..#\n.?.", 0.25, (1.5, -2.0, 0.0)))
    Path("sub").mkdir()
    for name in ("sub/map.yaml", "recipe.yaml"):
        shutil.copy("m.yaml", name)


@pytest.mark.parametrize(("line", "error", "hint"), [
    ("edit polygn m.yaml", "no such command 'polygn'", "did you mean polygon?"),
    ("qqqq", "no such command 'qqqq'", "run mapdeal --help for usage"),
    ("m.yaml", "no such command 'm.yaml'", "run mapdeal --help for usage"),
    ("inflate m.yaml --lethal_threshold 9", "no such option: --lethal_threshold",
     "did you mean --lethal-threshold?"),
    ("edit reset m.yaml --szie 1,1", "no such option: --szie", "did you mean --size?"),
    ("info m.yaml --dialect nva2", "'nva2' is not one of", "did you mean nav2?"),
    ("inflate m.yaml --kernel sqare -o o.npz", "--kernel: must be one of disc, square",
     "did you mean square?"),
    ("run m.yaml -o out --set inflate.kernel=sqare", "must be one of", "did you mean square?"),
    # options of something else; there is no --force
    ("reach m.yaml --recipe nav2", "--recipe", "run mapdeal reach --help for usage"),
    ("run m.yaml -o out --inflation-radius 0.3", "--inflation-radius",
     "--set cost.inflation_radius=VALUE sets it"),
    ("reach m.yaml --start 0,0", "no such option: --start", "did you mean --from?"),
    ("route m.yaml --from 0,0 --goal 5,5", "no such option: --goal", "did you mean --to?"),
    ("run m.yaml -o out --goals 5,5", "no such option: --goals", "did you mean --to?"),
    ("query m.yaml --pose 0,0,0", "no such option: --pose", "did you mean --at?"),
    ("query m.yaml 0,0 1,1", "extra argument", "did you mean --at 0,0 --at 1,1?"),
    ("reach m.yaml 0,0 a=5,5 b=1,2", "extra argument",
     "did you mean --from 0,0 --to a=5,5 --to b=1,2?"),
    ("inflate m.yaml --inflation-radius 0.3", "no such option", "did you mean --radius?"),
    ("cost m.yaml --radius 0.3", "no such option: --radius", "did you mean --robot-radius?"),
    *[(f"{line} -o o/x.yaml", "--output: must be a folder, not a file", "such as o/x") for line in (
        "run m.yaml", "local --map m.yaml --pose 2,-2,0", "convert m.yaml --all",
        "mask m.yaml --kind keepout --file z.geojson", "scan m.yaml sub/map.yaml --tour")],
    ("score m.yaml t.yaml", "extra argument", "did you mean --truth t.yaml?"),
    ("inflate m.yaml 0.3", "missing option '--output'", "did you mean --radius 0.3?"),
    ("inflate m.yaml 0.3 o.npz", "missing option", "did you mean --radius 0.3 -o o.npz?"),
    ("inflate m.yaml 0.3 -o o.npz", "extra argument", "did you mean --radius 0.3?"),
    ("esdf m.yaml o.npz", "missing option '--output'", "did you mean -o o.npz?"),
    ("run m.yaml out", "missing option '--output'", "did you mean -o out?"),
    ("merge m.yaml m.yaml o.npz", "missing option", "did you mean -o o.npz?"),
    ("mask m.yaml z.geojson out", "missing", "did you mean --file z.geojson -o out?"),
    ("rescale m.yaml 0.1 -o o.npz", "missing option", "did you mean --resolution 0.1?"),
    ("window m.yaml 1,1 3,3 --size 2,2 -o o.npz", "extra", "run mapdeal window --help for usage"),
    ("window m.yaml --at 1 1 --size 2,2 -o o.npz", "extra",
     "points and sizes are written X,Y, without a space"),
    ("esdf m.yaml nothing", "missing option", "run mapdeal esdf --help for usage"),
    ("report m.yaml --params-file p.yaml", "no such option: --params-file",
     "mapdeal run MAP --params-file ... --report -o DIR makes the page of a robot"),
    ("cost m.yaml -o o.npz --margin 0.3", "--margin", "run mapdeal cost --help for usage"),
])  # fmt: skip
def test_a_mistyped_word_gets_what_was_meant(sh, line, error, hint):
    code, out, err = sh(line)
    first, second = err.splitlines()
    assert (code, out, second) == (2, "", f"hint: {hint}")
    assert error in first
    assert not Path("out").exists()


@pytest.mark.parametrize(("line", "near"), [
    ("info mm.yaml", "m.yaml"), ("run m -o out", "m.yaml"), ("run M.yaml -o out", "m.yaml"),
    ("esdf sub/mapp.yaml -o out.npz", "sub/map.yaml"),
    ("run m.yaml -o out --recipe recpe.yaml", "recipe.yaml"),
    ("run other.yaml -o out", None), ("run nowhere/m.yaml -o out", None),
])  # fmt: skip
def test_a_mistyped_file_gets_the_one_that_was_meant(sh, line, near):
    error, *hints = sh.err(line, 4).splitlines()
    assert error.endswith("cannot be read: No such file or directory")
    assert hints == ([f"hint: did you mean {near}?"] if near else [])
    assert not Path("out").exists()


@pytest.mark.parametrize(("line", "hint"), [
    ("query m.yaml --points 0,0", "did you mean --at 0,0?"),
    ("reach m.yaml --robot-radius 0.2 --points a=0,0", "did you mean --to a=0,0?"),
])  # fmt: skip
def test_a_point_in_the_place_of_a_file_gets_its_option(sh, line, hint):
    assert sh.err(line, 4).splitlines()[-1] == f"hint: {hint}"


def endings_of(kind):
    return [entry.endings[0] for entry in FORMATS if entry.can_hold(kind)]


MAPS = endings_of(OccupancyGrid)
EDITED = [*MAPS, *(ending for entry in FORMATS for ending in entry.images)]
OTHERS = [".geojson", ".svg", ".sdf", ".stl", ".obj", ".bag", ".mcap", ".db3"]


@pytest.mark.parametrize(("line", "endings"), [
    ("convert m.yaml", EDITED + OTHERS), ("clean m.yaml", EDITED), ("inflate m.yaml", MAPS),
    ("edit reset m.yaml --size 1,1 --at 0,0", [*EDITED, ".pbm"]), ("esdf m.yaml", [*MAPS, ".npy"]),
    ("potential m.yaml --goal 0,0", endings_of(PotentialField)),
])  # fmt: skip
def test_an_unknown_ending_gets_those_that_the_command_writes(sh, line, endings):
    err = sh.err(f"{line} -o o.foo", 2)
    assert err.splitlines()[0].endswith(f" output must end in {join_words(endings)}")
    for ending in endings:
        is_bag = ending in (".bag", ".mcap", ".db3")
        assert is_bag or sh(f"{line} -o o{ending} --force")[0] == 0 or ending == ".pbm"


@pytest.mark.parametrize("name", [name for name in command_names() if name[-1] != name[-2]])
def test_every_command_is_found_with_two_letters_swapped(sh, name):
    lines = sh.err(name[:-2] + name[-1] + name[-2], 2).splitlines()
    assert lines[-1] == f"hint: did you mean {name}?"


@pytest.mark.parametrize("line", [
    "esdf m.yaml --convention center", "inflate m.yaml --radius 0.4 --kernel disc",
])  # fmt: skip
def test_either_spelling_of_a_choice_is_taken(sh, line):
    assert sh(f"{line} -o one.npz")[0] == 0
    assert sh(f"{line.replace('center', 'centre').replace('disc', 'disk')} -o other.npz")[0] == 0
    assert Path("one.npz").read_bytes() == Path("other.npz").read_bytes()


def test_a_method_may_have_an_underscore(sh):
    for name, text in (("c.csv", "1,2,0.1\n"), ("a.txt", "0 0.1\n"), ("r.txt", "1 1\n")):
        Path(name).write_text(text)
    files = "--poses c.csv --angles a.txt --ranges r.txt"
    assert sh.err(f"build {files} --method log_odds -o o.npz") == ""


@pytest.mark.parametrize("number", ["1_0", "\u0663", "1_0.5", "_1"])
@pytest.mark.parametrize("line", [
    "inflate m.yaml -o o.npz --radius ", "inflate m.yaml -o o.npz --threads ",
    "cost m.yaml --model rings -o o.npz --values ", "run m.yaml -o o.npz --set inflate.radius=",
    "query m.yaml --at 1,",
    "convert m.yaml -o o.npz --static-layer --encoding costmap2d --inscribed-value ",
    "info m.yaml --max-memory ",
])  # fmt: skip
def test_a_number_that_only_python_reads_is_refused(sh, line, number):
    code, out, err = sh(f"{line}{number}")
    assert (code, out, len(err.splitlines()) <= 2) == (2, "", True)
    assert "must be" in err or "is not a number" in err
    assert not Path("o.npz").exists()
