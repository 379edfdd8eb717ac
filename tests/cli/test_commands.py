import json
import subprocess
import sys

import numpy as np
import pytest
import yaml

from drawn import cells, grid_from_text
from mapdeal import OccupancyGrid, read_map, write_map
from mapdeal.cli.main import command_names
from mapdeal.version import __version__

ROOM = "........\n.#......\n......?.\n...##..."


@pytest.fixture
def room(tmp_path):
    write_map(tmp_path / "room.yaml", grid_from_text(ROOM, 0.1, (1.5, -2.0, 0.4)))
    return tmp_path / "room.yaml"


def test_the_version_on_one_line(command):
    code, out, err = command("--version")
    assert (code, err) == (0, "")
    assert out.startswith(f"mapdeal {__version__} (")
    assert out.count("\n") == 1


def test_the_package_runs_as_a_module():
    words = [sys.executable, "-m", "mapdeal", "--version"]
    assert subprocess.run(words, capture_output=True, text=True, check=True).stdout.startswith(
        "mapdeal"
    )


@pytest.mark.parametrize("name", command_names())
def test_every_command_has_help(command, name):
    code, out, err = command(name, "--help")
    assert (code, err) == (0, "")
    assert f"Usage: mapdeal {name}" in out


@pytest.mark.parametrize("kind", ["polygon", "line", "circle", "reset"])
def test_every_kind_of_edit_has_help(command, kind):
    code, out, err = command("edit", kind, "--help")
    assert (code, err) == (0, "")
    assert f"Usage: mapdeal edit {kind}" in out
    assert "--blank" in out


def test_no_line_of_the_command_list_is_cut_off(command):
    for words in (["--help"], ["edit", "--help"]):
        assert "..." not in command(*words)[1].split("Show this message and exit.")[1]


def test_no_words_show_the_help(command):
    code, out, _ = command()
    assert code == 0
    assert "\nQuestions about a map:\n" in out


def test_a_chain_through_files_gives_the_costs_of_a_run(command, room, tmp_path):
    inflated, field, cost = tmp_path / "i.yaml", tmp_path / "e.npz", tmp_path / "c.yaml"
    assert command("inflate", room, "-o", inflated, "--radius", 0.3)[0] == 0
    assert command("esdf", inflated, "-o", field)[0] == 0
    assert command("cost", field, "-o", cost)[0] == 0
    assert command("run", room, "-o", tmp_path / "out")[0] == 0
    of_run = read_map(tmp_path / "out" / "room" / "cost.yaml")
    assert np.array_equal(read_map(cost).occupancy, of_run.occupancy)
    assert (tmp_path / "c.pgm").read_bytes() == (
        tmp_path / "out" / "room" / "cost.pgm"
    ).read_bytes()


def test_parameters_reach_their_stage(command, room, tmp_path):
    command("inflate", room, "-o", tmp_path / "a.npz", "--radius", 0.1, "--kernel", "square",
            "--lethal-threshold", 50, "--no-inflate-unknown")  # fmt: skip
    from mapdeal import inflate

    expected = inflate(
        read_map(room), radius=0.1, kernel="square", lethal_threshold=50, inflate_unknown=False
    )
    assert np.array_equal(read_map(tmp_path / "a.npz").occupancy, expected.occupancy)


@pytest.mark.parametrize(
    ("words", "covered"),
    [
        (["--inflate-unknown"], True),
        (["--inflate-unknown", "yes"], True),
        (["--inflate-unknown=true"], True),
        (["--no-inflate-unknown"], False),
        (["--inflate-unknown", "no"], False),
        (["--inflate-unknown=no"], False),
    ],
)
def test_flags_can_be_written_as_parameters_are(command, tmp_path, words, covered):
    write_map(tmp_path / "map.yaml", grid_from_text("#?.."))
    code, _, err = command("inflate", tmp_path / "map.yaml", "-o", tmp_path / "o.yaml", *words)
    assert (code, err) == (0, "")
    expected = cells("##.." if covered else "#?..")
    assert np.array_equal(read_map(tmp_path / "o.yaml").occupancy, expected)


def test_the_field_as_npz_view_and_bare_array(command, room, tmp_path):
    for name in ("e.npz", "v.yaml", "b.npy"):
        assert command("esdf", room, "-o", tmp_path / name, "--convention", "border")[0] == 0
    field = read_map(tmp_path / "e.npz")
    assert np.array_equal(np.load(tmp_path / "b.npy"), field.distance)
    about = yaml.safe_load((tmp_path / "b.yaml").read_text())
    assert about["resolution"] == 0.1
    assert about["origin"] == [1.5, -2.0, 0.4]
    assert about["convention"] == "border"
    assert yaml.safe_load((tmp_path / "v.yaml").read_text())["mode"] == "raw"
    view = read_map(tmp_path / "v.yaml").occupancy
    assert (view.max(), view[0, 3], view[1, 6]) == (100, 100, -1)


def test_costs_in_both_encodings_and_models(command, room, tmp_path):
    command("cost", room, "-o", tmp_path / "o.yaml")
    _, _, err = command("cost", room, "-o", tmp_path / "b.yaml", "--encoding", "costmap2d")
    assert "warning: " in err
    costs = read_map(tmp_path / "b.yaml")
    assert costs.scale == "costmap2d"
    assert np.array_equal(read_map(tmp_path / "o.yaml").occupancy, costs.to_occupancy().occupancy)
    command("cost", room, "-o", tmp_path / "r.npz", "--model", "rings", "--values", "80,40")
    rings = read_map(tmp_path / "r.npz")
    assert rings.scale == "occupancy"
    assert set(np.unique(rings.cost).tolist()) == {0, 40, 80, 100}


def test_a_robot_s_shape_sets_the_radii_and_reports_the_circumscribed_cost(command, room, tmp_path):
    shape = "[[0.3,0.4],[0.3,-0.4],[-0.3,-0.4],[-0.3,0.4]]"
    code, out, _ = command(
        "cost", room, "-o", tmp_path / "c.npz", "--footprint", shape, "--inflation-radius", 1
    )
    # trunc(252 exp(-10 (0.5 - 0.3))) is 34
    assert (code, "circumscribed_cost 34" in out) == (0, True)
    assert int(np.load(tmp_path / "c.npz")["circumscribed_cost"]) == 34
    command("inflate", room, "-o", tmp_path / "s.npz", "--footprint", shape)
    command("inflate", room, "-o", tmp_path / "r.npz", "--radius", 0.5)
    both = [read_map(tmp_path / name).occupancy for name in ("s.npz", "r.npz")]
    assert np.array_equal(*both)
    command("inflate", room, "-o", tmp_path / "p.npz", "--robot-radius", 0.45,
            "--footprint-padding", 0.05)  # fmt: skip
    assert np.array_equal(read_map(tmp_path / "p.npz").occupancy, both[0])


def test_convert_between_all_formats_keeps_cells_and_unknown_keys(command, tmp_path):
    grid = grid_from_text(ROOM)
    write_map(tmp_path / "a.yaml", grid)
    with (tmp_path / "a.yaml").open("a") as file:
        file.write("height: 0.5\n")
    for source, target in [("a.yaml", "b.png"), ("b.yaml", "c.npz"), ("c.npz", "d.yaml")]:
        assert command("convert", tmp_path / source, "-o", tmp_path / target)[0] == 0
        target = tmp_path / target
        read = read_map(target.with_suffix(".yaml") if target.suffix == ".png" else target)
        assert np.array_equal(read.occupancy, grid.occupancy)
        assert read.origin == grid.origin
    assert yaml.safe_load((tmp_path / "b.yaml").read_text())["height"] == 0.5


def test_info_as_text_and_as_json(command, room, tmp_path):
    code, out, _ = command("info", room, "--json")
    report = json.loads(out)
    assert code == 0
    assert (report["width"], report["height"], report["resolution"]) == (8, 4, 0.1)
    assert (report["occupied"], report["unknown"], report["free"]) == (3, 1, 28)
    assert report["origin"] == [1.5, -2.0, 0.4]
    assert report["known_box"] == [0, 0, 4, 8]
    code, out, _ = command("info", room, room)
    assert out.count("sha256") == 2
    command("esdf", room, "-o", tmp_path / "e.npz")
    assert json.loads(command("info", tmp_path / "e.npz", "--json")[1])["kind"] == "distance field"


def test_the_picture_of_a_stage(command, room, tmp_path):
    for name in ("active", "inflate", "esdf", "cost"):
        picture = tmp_path / f"{name}.png"
        assert command(name, room, "-o", tmp_path / f"{name}.npz", "--image", picture)[0] == 0
        assert picture.read_bytes().startswith(b"\x89PNG")


def test_quiet_says_nothing_and_verbose_more(command, room, tmp_path):
    assert command("inflate", room, "-o", tmp_path / "a.yaml", "-q") == (0, "", "")
    code, out, err = command("inflate", room, "-o", tmp_path / "b.yaml", "-v")
    assert code == 0
    assert "b.yaml" in out
    assert "radius" in err


def test_several_maps_one_of_them_bad(command, room, tmp_path):
    write_map(tmp_path / "hall.yaml", OccupancyGrid(np.zeros((3, 5), np.int8), 0.1))
    bad = tmp_path / "bad.yaml"
    bad.write_text("image: none.pgm\n")
    code, out, err = command("run", room, bad, tmp_path / "hall.yaml", "-o", tmp_path / "out")
    assert code == 5
    assert "missing keys resolution, origin" in err
    assert "2 done, 0 unchanged, 1 failed" in out
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert [m["status"] for m in summary["maps"]] == ["done", "failed", "done"]
    assert (tmp_path / "out" / "hall" / "cost.npz").exists()


def test_two_maps_of_one_name_are_refused_before_any_work(command, room, tmp_path):
    other = tmp_path / "other" / "room.yaml"
    write_map(other, grid_from_text(ROOM))
    code, _, err = command("run", room, other, "-o", tmp_path / "out")
    assert (code, err.count("error: ")) == (2, 1)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "words",
    [
        ["fly"],
        ["inflate"],
        ["inflate", "room.yaml"],
        ["inflate", "room.yaml", "-o", "o.yaml", "--radius", "wide"],
        ["inflate", "room.yaml", "-o", "o.yaml", "--radius", "nan"],
        ["inflate", "room.yaml", "-o", "o.yaml", "--nothing"],
        ["inflate", "room.yaml", "-o", "o.yaml", "--inflate-unknown=maybe"],
        ["inflate", "room.yaml", "-o", "o.txt"],
        ["inflate", "room.yaml", "-o", "o.png"],
        ["inflate", "room.yaml", "-o", "o.yaml", "--radius", "1", "--robot-radius", "1"],
        ["inflate", "room.yaml", "-o", "o.yaml", "--footprint-padding", "0.1"],
        ["inflate", "room.yaml", "-o", "o.yaml", "--dialect", "ros3"],
        ["inflate", "room.yaml", "-o", "o.yaml", "-q", "-v"],
        ["cost", "room.yaml", "-o", "o.yaml", "--model", "rings", "--down", "3"],
        ["cost", "room.yaml", "-o", "o.yaml", "--model", "linear"],
        ["cost", "room.yaml", "-o", "o.yaml", "--model", "rings", "--encoding", "costmap2d"],
        ["run", "room.yaml", "-o", "out", "--recipe", "nav3"],
        ["run", "room.yaml", "-o", "out", "--set", "inflate.radius"],
        ["run", "room.yaml", "-o", "out", "--image-max", "-1"],
    ],
    ids=" ".join,
)
def test_wrong_usage_is_one_line_and_exit_code_2(command, room, tmp_path, monkeypatch, words):
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.iterdir())
    code, out, err = command(*words)
    assert (code, out) == (2, "")
    lines = [line for line in err.splitlines() if not line.startswith("warning: ")]
    assert lines[0].startswith("error: ")
    assert len(lines) <= 2
    assert all(line.startswith("hint: ") for line in lines[1:])
    assert sorted(tmp_path.iterdir()) == before


def test_a_reader_that_goes_away_is_no_error(room):
    words = f"{sys.executable} -m mapdeal info " + f"{room} " * 50 + "| true; exit ${PIPESTATUS[0]}"
    done = subprocess.run(["bash", "-c", words], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_an_error_of_the_program_is_told_from_one_of_the_input(
    command, room, tmp_path, monkeypatch
):
    def broken(*_args, **_options):
        raise ZeroDivisionError

    monkeypatch.setattr(OccupancyGrid, "figures", broken)
    code, _, err = command("info", room)
    assert code == 70
    assert "internal error" in err


def test_costs_that_are_passed_as_a_map_are_warned_of(command, room, tmp_path):
    command("cost", room, "-o", tmp_path / "c.npz")
    code, _, err = command("inflate", tmp_path / "c.npz", "-o", tmp_path / "i.npz")
    assert code == 0
    assert "contains costs" in err


def test_convert_tells_what_it_wrote_not_what_it_read(command, tmp_path):
    write_map(tmp_path / "raw.yaml", OccupancyGrid([[0, 20, 50, 80]], 0.25))
    words = ["convert", tmp_path / "raw.yaml", "-o", tmp_path / "t.yaml", "--mode", "trinary"]
    _, out, err = command(*words)
    assert "3 values" in err
    assert "occupied 25.00 %, free 50.00 %, unknown 25.00 %" in out
    assert read_map(tmp_path / "t.yaml").occupancy.tolist() == [[0, 0, -1, 100]]


def test_a_field_s_info_tells_how_it_was_made(command, room, tmp_path):
    command("esdf", room, "-o", tmp_path / "e.npz", "--max-distance", 0.5, "--unknown", "occupied")
    report = json.loads(command("info", tmp_path / "e.npz", "--json")[1])
    assert (report["max_distance"], report["unknown"]) == (0.5, "occupied")
    assert "max_distance 0.5 m" in command("info", tmp_path / "e.npz")[1]


def test_the_short_form_of_help(command):
    assert command("-h")[1] == command("--help")[1]
    assert "Usage: mapdeal esdf" in command("esdf", "-h")[1]


@pytest.mark.parametrize(
    ("drawing", "box"),
    [("?????\n?.???\n???#?\n?????\n?????", [2, 1, 2, 3]), ("??\n??", None), ("?+", [0, 1, 1, 1])],
)
def test_info_gives_row_column_height_and_width_of_what_is_known(command, tmp_path, drawing, box):
    write_map(tmp_path / "m.npz", grid_from_text(drawing))
    report = json.loads(command("info", tmp_path / "m.npz", "--json")[1])
    assert report["known_box"] == box


def test_what_only_a_robot_s_shape_sets_is_no_option(command, room, tmp_path):
    words = ["cost", room, "-o", tmp_path / "c.npz"]
    code, _, err = command(*words, "--circumscribed-radius", "0.3")
    assert (code, "no such option" in err) == (2, True)
    assert command(*words, "--robot-radius", "0.3")[0] == 0
    assert read_map(tmp_path / "c.npz").circumscribed_cost == 253


def test_a_shape_without_a_value_is_named(command, room, tmp_path):
    (tmp_path / "s.yaml").write_text("- {type: circle, center: [1.6, -1.9], radius: 0.2}\n")
    words = ["edit", "circle", room, "-o", tmp_path / "o.npz", "--point", "1.6,-1.9"]
    code, _, err = command(*words, "--radius", "0.2")
    assert (code, err.splitlines()[0]) == (2, "error: --value: is needed to draw with")
    assert not (tmp_path / "o.npz").exists()
