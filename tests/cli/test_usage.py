"""What the command line says of words that it does not know."""

import shutil

import pytest

from drawn import grid_from_text
from mapdeal import write_map
from mapdeal.cli.main import command_names


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_map("m.yaml", grid_from_text("..#\n.?."))
    return tmp_path


@pytest.mark.parametrize(
    ("words", "error", "meant"),
    [
        ("rnu m.yaml", "no such command 'rnu'", "run"),
        ("esfd m.yaml", "no such command 'esfd'", "esdf"),
        ("infalte m.yaml", "no such command 'infalte'", "inflate"),
        ("edit polygn m.yaml", "no such command 'polygn'", "polygon"),
        ("inflate m.yaml --radis 1 -o o.npz", "no such option: --radis", "--radius"),
        ("inflate m.yaml --lethal_threshold 9 -o o.npz", "no such option: --lethal_threshold",
         "--lethal-threshold"),
        ("edit reset m.yaml --szie 1,1 -o o.npz", "no such option: --szie", "--size"),
        ("info m.yaml --jsno", "no such option: --jsno", "--json"),
        ("info m.yaml --dialect nva2", "'nva2' is not one of", "nav2"),
        ("lint m.yaml --format jsno", "got 'jsno'", "json"),
        ("inflate m.yaml --kernel sqare -o o.npz", "--kernel: must be one of disc, square",
         "square"),
        ("cost m.yaml --model ring -o o.npz", "no such cost model", "rings"),
        ("run m.yaml -o out --recipe nva2", "no such recipe", "nav2"),
        ("run m.yaml -o out --set inflaet.radius=1", "no such stage", "inflate"),
        ("run m.yaml -o out --set inflate.radios=1", "no such parameter", "radius"),
        ("run m.yaml -o out --set inflate.kernel=sqare", "must be one of", "square"),
    ],
)  # fmt: skip
def test_a_mistyped_word_gets_what_was_meant(command, here, words, error, meant):
    code, out, err = command(*words.split())
    first, second = err.splitlines()
    assert (code, out) == (2, "")
    assert error in first
    assert second == f"hint: did you mean {meant}?"
    assert not (here / "out").exists()


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        ("reach m.yaml --recipe nav2", "run mapdeal reach --help for usage"),  # no --force
        ("run m.yaml -o out --tolerance 0.1", "run mapdeal run --help for usage"),
        ("run m.yaml -o out --resolution 0.1", "--set rescale.resolution=VALUE sets it"),
        ("run m.yaml -o out --inflation-radius 0.3", "--set cost.inflation_radius=VALUE sets it"),
        ("cost m.yaml -o o.npz --margin 0.3", "run mapdeal cost --help for usage"),
    ],
)
def test_an_option_of_something_else_gets_no_other_option(command, here, words, hint):
    code, _, err = command(*words.split())
    assert (code, err.splitlines()[1]) == (2, f"hint: {hint}")


@pytest.mark.parametrize(
    ("words", "near"),
    [
        ("info mm.yaml", "m.yaml"),
        ("run m -o out", "m.yaml"),
        ("run M.yaml -o out", "m.yaml"),
        ("esdf sub/mapp.yaml -o out.npz", "sub/map.yaml"),
        ("run m.yaml -o out --recipe recpe.yaml", "recipe.yaml"),
        ("run other.yaml -o out", None),
        ("run nowhere/m.yaml -o out", None),
    ],
)
def test_a_mistyped_file_gets_the_one_that_was_meant(command, here, words, near):
    (here / "sub").mkdir()
    for name in ("sub/map.yaml", "recipe.yaml"):
        shutil.copy(here / "m.yaml", here / name)
    code, out, err = command(*words.split())
    error, *hints = err.splitlines()
    assert (code, out) == (4, "")
    assert error.endswith("cannot be read: No such file or directory")
    assert hints == ([f"hint: did you mean {near}?"] if near else [])
    assert not (here / "out").exists()


def test_every_command_is_found_with_two_letters_swapped(command):
    for name in command_names():
        mistyped = name[:-2] + name[-1] + name[-2]
        if mistyped in command_names():
            continue
        code, _, err = command(mistyped)
        assert code == 2
        assert err.splitlines()[-1] == f"hint: did you mean {name}?"


def test_what_is_like_nothing_gets_the_way_to_the_list(command):
    code, _, err = command("qqqq")
    assert (code, err.splitlines()) == (
        2, ["error: no such command 'qqqq'", "hint: run mapdeal --help for usage"]
    )  # fmt: skip


@pytest.mark.parametrize(
    ("words", "one", "other"),
    [
        ("esdf m.yaml -o {}.npz --convention", "center", "centre"),
        ("inflate m.yaml --radius 0.4 -o {}.npz --kernel", "disc", "disk"),
        ("convert m.yaml -o {}.npz --encoding", "costmap2d", "costmap2d"),
    ],
)
def test_either_spelling_of_a_choice_is_taken(command, here, words, one, other):
    for spelling, name in ((one, "one"), (other, "other")):
        assert command(*words.format(name).split(), spelling)[0] == 0
    assert (here / "one.npz").read_bytes() == (here / "other.npz").read_bytes()


def test_a_method_may_have_an_underscore(command, here):
    (here / "c.csv").write_text("1,2,0.1\n")
    (here / "a.txt").write_text("0 0.1\n")
    (here / "r.txt").write_text("1 1\n")
    code, _, err = command("build", "--poses", "c.csv", "--angles", "a.txt", "--ranges", "r.txt",
                           "--method", "log_odds", "-o", "o.npz")  # fmt: skip
    assert (code, err) == (0, "")


@pytest.mark.parametrize("number", ["1_0", "1_000", "\u0663", "1_0.5", "_1"])
@pytest.mark.parametrize(
    "words",
    [
        "inflate m.yaml -o o.npz --radius",
        "inflate m.yaml -o o.npz --threads",
        "inflate m.yaml -o o.npz --lethal-threshold",
        "cost m.yaml --model rings -o o.npz --values",
        "run m.yaml -o out --set inflate.radius=",
        "query m.yaml --at 1,",
        "convert m.yaml -o o.npz --static-layer --encoding costmap2d --inscribed-value",
        "info m.yaml --max-memory",
    ],
)
def test_a_number_that_only_python_reads_is_refused(command, here, words, number):
    *first, last = words.split()
    tried = [f"{last}{number}"] if last.endswith(("=", ",")) else [last, number]
    code, out, err = command(*first, *tried)
    assert (code, out) == (2, "")
    assert len(err.splitlines()) <= 2
    assert "must be" in err or "is not a number" in err
    assert not (here / "o.npz").exists()
