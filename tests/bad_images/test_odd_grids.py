"""Maps that are good but odd (rows G)."""

import numpy as np
import pytest
from PIL import Image

from bad_maps import DRAWING, PGM, cells_of, tree
from drawn import cells


def drawn_pgm(drawing):
    rows = drawing.split()
    pixels = bytes({"#": 0, ".": 254, "?": 205}[c] for c in "".join(rows))
    return f"P5\n{len(rows[0])} {len(rows)}\n255\n".encode() + pixels


@pytest.mark.parametrize(
    ("drawing", "unknown", "distance"),
    [
        pytest.param("...\n...", "free", np.inf, id="G1-all-free"),
        pytest.param("###\n###", "free", -np.inf, id="G2-all-occupied"),
        pytest.param("???\n???", "free", np.inf, id="G2-all-unknown-as-free"),
        pytest.param("???\n???", "occupied", -np.inf, id="G2-all-unknown-as-occupied"),
    ],
)
def test_a_field_without_a_border_is_infinite(write_map, accepted, drawing, unknown, distance):
    write_map(drawn_pgm(drawing))
    accepted("esdf", "m.yaml", "-o", "o.npz", "--unknown", unknown, "--image", "p.png")
    assert cells_of("o.npz", "distance") == [[distance] * 3] * 2
    with Image.open("p.png") as picture:
        assert picture.width >= 3


@pytest.mark.parametrize(
    ("drawing", "cost"),
    [
        pytest.param("...\n...", 0, id="G1-all-free"),
        pytest.param("###\n###", 254, id="G2-all-occupied"),
        pytest.param("???\n???", 255, id="G2-all-unknown"),
    ],
)
def test_a_run_over_a_map_of_one_kind_of_cell_is_complete(
    write_map, folder, accepted, drawing, cost
):
    write_map(drawn_pgm(drawing))
    accepted("run", "m.yaml", "-o", "out")
    assert cells_of("out/m/cost.npz", "cost") == [[cost] * 3] * 2
    written = sorted(path.name for path in (folder / "out" / "m").iterdir())
    assert written == [
        "cost.npz", "cost.pgm", "cost.png", "cost.yaml",
        "esdf.npz", "esdf.pgm", "esdf.png", "esdf.yaml",
        "inflated.pgm", "inflated.png", "inflated.yaml", "input.png", "manifest.json",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("drawing", "distances"),
    [
        pytest.param("#", [[-np.inf]], id="G3-1x1-occupied"),
        pytest.param(".", [[np.inf]], id="G3-1x1-free"),
        pytest.param("#..", [[0, 0.05, 0.1]], id="G3-1x3"),
        pytest.param("#\n.\n.", [[0.1], [0.05], [0]], id="G3-3x1"),
        pytest.param("#.\n..", [[0.05, 0.05 * 2**0.5], [0, 0.05]], id="G3-2x2"),
        pytest.param("##\n##", [[-np.inf] * 2] * 2, id="G3-2x2-occupied"),
    ],
)
def test_the_smallest_maps_have_exact_distances(write_map, accepted, drawing, distances):
    write_map(drawn_pgm(drawing))
    accepted("esdf", "m.yaml", "-o", "o.npz")
    assert cells_of("o.npz", "distance") == np.array(distances, np.float32).tolist()
    accepted("run", "m.yaml", "-o", "out")
    assert np.shape(cells_of("out/m/cost.npz", "cost")) == np.shape(distances)


@pytest.mark.parametrize(
    "words",
    [
        pytest.param(["active", "m.yaml", "-o", "o.npz"], id="G4-active"),
        pytest.param(["active", "m.yaml", "-o", "new/o.yaml", "--image", "p.png"], id="G4-pair"),
        pytest.param(["run", "m.yaml", "-o", "out", "--sim"], id="G4-run"),
        pytest.param(["run", "m.yaml", "-o", "new/out", "--recipe", "design-sim"], id="G4-recipe"),
    ],
)
def test_a_map_without_a_known_cell_has_no_active_region(write_map, folder, command, words):
    write_map(drawn_pgm("???\n???"))
    before = tree(folder)
    code, out, err = command(*words)
    assert code == 3
    assert out == ""
    errors = [line for line in err.splitlines() if line.startswith("error: ")]
    assert len(errors) == 1
    assert "no active cells" in errors[0]
    assert "m.yaml" in errors[0]
    assert tree(folder) == before


def test_a_margin_is_clipped_at_the_border_g5(write_map, accepted):
    write_map(drawn_pgm("????\n?.??\n.#??"))
    accepted("active", "m.yaml", "-o", "o.npz", "--margin", "0.05")
    assert cells_of("o.npz", "occupancy") == cells("???\n?.?\n.#?").tolist()
    assert cells_of("o.npz", "origin") == [1.5, -2.0, 0.4]


def test_bit_rows_that_fill_no_byte_keep_their_columns_g6(write_map, read_cells):
    rows = bytes([0b00000000, 0b00100000, 0b10000000, 0b01000000])
    write_map(b"P4\n11 2\n" + rows)
    assert read_cells()[0] == cells("..........#\n#........#.").tolist()


def test_inflation_does_not_wrap_around_the_border_g7(write_map, accepted):
    write_map(drawn_pgm("....#\n.....\n.....\n....."))
    accepted("inflate", "m.yaml", "-o", "o.npz", "--radius", "0.05")
    assert cells_of("o.npz", "occupancy") == cells("...##\n....#\n.....\n.....").tolist()


def test_raw_values_above_100_are_unknown_and_counted_g8(write_map, read_cells):
    write_map(b"P5\n3 2\n255\n" + bytes([0, 100, 101, 254, 255, 42]), mode="raw")
    occupancy, warned = read_cells()
    assert occupancy == [[-1, -1, 42], [0, 100, -1]]
    assert any("m.pgm" in line and " 2 " in line for line in warned)


@pytest.mark.parametrize("ending", ["yaml", "png", "npz"])
def test_a_trinary_map_comes_back_as_it_was_g9(write_map, accepted, ending):
    write_map(PGM)
    accepted("convert", "m.yaml", "-o", f"o.{ending}")
    accepted("convert", "o.npz" if ending == "npz" else "o.yaml", "-o", "back.npz")
    assert cells_of("back.npz", "occupancy") == cells(DRAWING).tolist()


def test_values_lost_in_mode_trinary_are_reported_g9(write_map, accepted):
    write_map(b"P5\n3 2\n255\n" + bytes([0, 100, 255, 42, 50, 60]), mode="raw")
    warned = accepted("convert", "m.yaml", "-o", "o.yaml", "--mode", "trinary")
    assert any("3 values" in line for line in warned)


def test_grey_levels_of_a_drawing_program_are_read_by_the_thresholds_g10(write_map, read_cells):
    # Darkness 0.647, 0.651, 0.2, 0.196 (one grey level each side of both thresholds).
    write_map(b"P5\n4 1\n255\n" + bytes([90, 89, 204, 206]))
    assert read_cells()[0] == [[-1, 100, -1, 0]]
