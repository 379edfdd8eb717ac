"""Commands take no more memory than they were allowed, and refuse in time what would take more.

Processes of their own are measured, since a peak is never taken back.
"""

import json
import re
import struct
import zipfile

import numpy as np
import pytest
from PIL import Image

import mapdeal
import measuring
from mapdeal import BitMap, Costmap, OccupancyGrid, esdf, read_map, write_bit_map, write_map
from mapdeal.grid.canvas import on_canvas
from mapdeal.kernels.engine import engine_name
from mapdeal.maps.npz import write_npz

pytestmark = pytest.mark.thorough

IS_COMPILED = engine_name() == "compiled"
MOST = 100  # MB that bombs may take, the program's own included
SLACK = 1.05


def measured(folder, line, memory=None):
    """The same of a line that may take so much memory."""
    return measuring.measured(folder, *line.split(), *(["--max-memory", memory] if memory else []))


def sparse(path, head, size):
    """A file whose pixels are zeros that take no room on the disk."""
    with path.open("wb") as file:
        file.write(head)
        file.truncate(len(head) + size)


def tiff(path, tags, size):
    entries = b"".join(struct.pack("<HHII", tag, kind, 1, value) for tag, kind, value in tags)
    data = b"II*\0" + struct.pack("<IH", 8, len(tags)) + entries + struct.pack("<I", 0)
    path.write_bytes(data.ljust(size, b"\0"))


CLAIMED_ROWS = [
    (256, 4, 14_000), (257, 4, 14_000), (258, 3, 8), (259, 3, 1), (262, 3, 1), (273, 4, 134),
    (277, 3, 1), (278, 4, 14_000), (279, 4, 100),
]  # fmt: skip
LARGE_TILE = [
    (256, 4, 10), (257, 4, 10), (258, 3, 8), (259, 3, 5), (262, 3, 1), (277, 3, 1),
    (322, 4, 20_000), (323, 4, 20_000), (324, 4, 200), (325, 4, 1000),
]  # fmt: skip


def scans(path, poses):
    np.savez(path, poses=poses, angles=np.zeros(3), ranges=np.ones((len(poses), 3)))


@pytest.fixture(scope="module")
def bombs(tmp_path_factory):
    """Files that ask for much more memory than they are long.

    What readers of every kind ask for before they read is tested in tests/files/test_budget.py.
    """
    folder = tmp_path_factory.mktemp("bombs")
    many, cells = np.zeros((12_000_000, 3), np.int8), np.zeros((3000, 3000))
    np.savez_compressed(folder / "log.npz", angles=np.zeros(3), poses=many, ranges=many)
    np.savez_compressed(
        folder / "potential.npz", format=np.array("mapdeal/1"), resolution=0.05,
        origin=np.array([1.5, -2.0, 0.4]), goal=np.array([2.0, 2.0]), attractive_gain=1.0,
        repulsive_gain=1.0, repulsive_cap=1e5, occupancy=np.int8(cells), repulsive=cells,
    )  # fmt: skip
    write_map(folder / "map.npz", OccupancyGrid(np.zeros((9000, 9000), np.int8), 0.05))
    head = b"\x93NUMPY\2\0" + struct.pack("<I", 1 << 28)
    with zipfile.ZipFile(folder / "header.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("points.npy", head + b" " * (1 << 28))
    sparse(folder / "header.npy", head, 1 << 28)
    tiff(folder / "tile.tif", LARGE_TILE, 1200)
    tiff(folder / "tiny.tif", CLAIMED_ROWS, 320)
    Image.new("L", (9000, 9000)).save(folder / "blank.png", compress_level=9)
    sparse(folder / "bits8.pbm", b"P4\n16000 16000\n", 2000 * 16000)
    for image in ("tiny.tif", "tile.tif", "blank.png", "bits8.pbm"):
        text = f"image: {image}\nresolution: 0.05\norigin: [1.5, -2.0, 0.4]\nnegate: 0\n"
        text += "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
        (folder / image).with_suffix(".yaml").write_text(text)
    grid = OccupancyGrid(np.zeros((20, 30), np.int8), 0.05, (1.5, -2.0, 0.4))
    write_map(folder / "small.yaml", grid)
    write_map(folder / "far.yaml", OccupancyGrid(grid.occupancy, 0.05, (200.0, 200.0, 0.4)))
    scans(folder / "far-scans.npz", np.array([[0.0, 0, 0], [200, 200, 0]]))
    np.save(folder / "cloud.npy", np.ones((10, 3)))
    text = '{"type": "Feature", "properties": [' + "{}," * 9_000_000
    (folder / "shapes.geojson").write_text(text)
    return folder


OUT = "-o out.yaml -q"
BOMBS = {
    "scans": f"build log.npz {OUT}",
    "potential": "info potential.npz",
    "TIFF": "info tiny.yaml",
    "TIFF of a tile": "info tile.yaml",
    "PNG in a run": "run blank.yaml -o out",
    "edited bit map": "edit circle bits8.pbm --point 5,5 --radius 1 --value 100 -q -o out.pbm",
    "costs of a map": "query map.npz --at 1,1",
    "costs of obstacles": "query map.npz --robot-radius 1 --at 1,1,0",
    "window": f"window small.yaml --corner 0,0 --size 500,500 {OUT}",
    "rescale": f"rescale small.yaml --resolution 0.0001 {OUT}",
    "built map": f"build far-scans.npz {OUT}",
    "compared maps": "build far-scans.npz --compare -o out -q",
    "built map of a size": f"build far-scans.npz --size 99,99 --origin 0,0 {OUT}",
    "local map": "local --cloud cloud.npy --pose 0,0,0 --size 500,500 -o out",
    "difference": "diff small.yaml far.yaml",
    "merged maps": f"merge small.yaml far.yaml {OUT}",
    "mask": f"cost small.yaml --mask map.npz {OUT}",
    "shapes": f"edit circle small.yaml --file shapes.geojson {OUT}",
}


ENOUGH = (MOST + 50) * 1_000_000


@pytest.mark.parametrize("line", BOMBS.values(), ids=BOMBS)
def test_what_would_take_too_much_is_refused_before(bombs, line):
    before = sorted(path.name for path in bombs.iterdir())
    code, err, peak = measured(bombs, line, f"{MOST}MB")
    assert code == 3, err
    first, hint = err.splitlines()
    assert re.fullmatch(rf"error: .*needs? ([0-9.]+) [MG]B of memory, {MOST} MB may be used", first)
    assert "--max-memory" in hint
    assert peak < ENOUGH
    assert sorted(path.name for path in bombs.iterdir()) == before


@pytest.mark.parametrize("name", ["header.npz", "header.npy"])
def test_headers_of_arrays_are_not_read_at_any_length(bombs, name):
    code, output, peak = measured(bombs, f"local --cloud {name} --pose 0,0,0 -o out", "1GB")
    assert code == 3
    assert re.search(r"array header, expected \d+ bytes", output)
    assert peak < ENOUGH


def test_lint_reports_it_as_every_file_that_cannot_be_read(bombs):
    code, output, peak = measured(bombs, "lint map.npz", f"{MOST}MB")
    assert code == 1
    assert re.search(rf"error: file.malformed: needs .* of memory, {MOST} MB may be used", output)
    assert peak < ENOUGH


@pytest.mark.parametrize("name", ["scans", "potential", "TIFF"])
def test_what_expands_as_no_honest_file_does_is_refused_whatever_is_free(bombs, name):
    code, err, peak = measured(bombs, BOMBS[name])
    assert code == 3
    first, hint = err.splitlines()
    assert re.search(r"\d+ bytes would expand to \d+, more than 1[04]00 times as many", first)
    assert "--max-memory" in hint
    assert peak < ENOUGH


@pytest.mark.parametrize("ending", [".npz", ".png", ".yaml"])
def test_an_empty_map_of_mapdeals_own_is_no_bomb(tmp_path, ending):
    grid = OccupancyGrid(np.zeros((9000, 9000), np.int8), 0.05)
    path = tmp_path / f"empty{ending}"
    write_map(path, grid)
    source = path if ending == ".npz" else path.with_suffix(".yaml")
    assert read_map(source).occupancy.shape == grid.shape


def test_an_empty_png_is_no_bomb_and_a_chosen_memory_reads_what_expands(bombs):
    assert (bombs / "blank.png").stat().st_size * 1000 < 9000**2
    for words in (["info blank.yaml"], ["info potential.npz", "2GB"]):
        code, output, _ = measured(bombs, *words)
        assert code == 0, output


def site(folder, side):
    values = np.zeros((side, side + 100), np.int8)
    values[::50, 7::7] = 100
    values[:, -100:] = -1
    grid = OccupancyGrid(values, 0.05, (1.5, -2.0, 0.0))
    write_map(folder / "site.yaml", grid)
    write_map(folder / "site.npz", grid)
    turned = (folder / "site.yaml").read_text().replace("-2.0, 0.0]", "-2.0, 0.4]")
    (folder / "turned.yaml").write_text(turned)
    write_map(folder / "site-png.png", grid)
    with (folder / "odds.npz").open("wb") as file:
        write_npz(file, grid, more={"log_odds": np.where(values == 100, 60.0, 40.0)})
    shifted = np.roll(values, 3, axis=0)
    write_map(folder / "other.yaml", OccupancyGrid(shifted, 0.05, (2.5, -2.0, 0.0)))
    write_map(folder / "cost.npz", Costmap((values == 100).astype(np.uint8) * 254, 0.05))
    write_map(folder / "other_cost.npz", Costmap((shifted == 100).astype(np.uint8) * 254, 0.05))
    write_bit_map(folder / "bits.pbm", BitMap.from_occupancy(grid))
    write_map(folder / "esdf.npz", esdf(grid))
    around = grid.frame.window(-1, -2, side + 3, side + 105)
    write_map(folder / "canvas.npz", on_canvas(esdf(grid), around))
    repulsive = np.random.default_rng(4).random(values.shape)
    potential = mapdeal.PotentialField(repulsive, values, 0.05, goal=(1.0, 2.0))
    write_map(folder / "potential.npz", potential)
    scans(folder / "scans.npz", np.zeros((100, 3)))
    np.save(folder / "cloud.npy", np.ones((10, 3)))
    for name, radius in (("robot", 0.04), ("wide", 0.06)):
        parameters = {"robot_radius": radius, "footprint_padding": 0.0}
        nodes = {"global_costmap": {"global_costmap": {"ros__parameters": parameters}}}
        (folder / f"{name}.yaml").write_text(json.dumps(nodes))
    (folder / "pairs.csv").write_text("0.1,0.1,70.1,70.1\n")


@pytest.fixture(scope="module")
def ordinary(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    site(folder, 1600)
    return folder


ROUTE = "route cost.npz --from 0.1,0.1 --to 70.1,70.1"
CORNERS = "[[0.2,0.1],[0.2,-0.1],[-0.2,-0.1],[-0.2,0.1]]"
COMMANDS = [
    "info site.yaml", "info esdf.npz", "info canvas.npz", "info potential.npz", "lint site.yaml -q",
    "lint site.npz -q", "lint site.yaml -q --robot-radius 0.04", f"lint site.yaml --fix {OUT}",
    "convert site.yaml -o out.npz", f"convert esdf.npz {OUT}", f"convert canvas.npz {OUT}",
    "convert potential.npz -o out.npz -q",
    f"edit circle site.yaml --point 5,5 --radius 1 --value 100 {OUT}",
    "edit circle bits.pbm --point 5,5 --radius 1 --value 100 -q -o out.pbm",
    f"window site.yaml --corner 0,0 --size 100,100 {OUT}", f"rotate site.yaml --yaw 0.5 {OUT}",
    f"rotate turned.yaml --straighten {OUT}", f"rescale site.yaml --resolution 0.07 {OUT}",
    f"rescale site.yaml --resolution 0.02 {OUT}", f"rescale site.yaml --resolution 0.3 {OUT}",
    "window esdf.npz --corner -9,-9 --size 100,100 -q -o out.npz", "cost canvas.npz -q -o out.npz",
    "pack site.yaml -o out.pbm", "diff site.yaml other.yaml", "diff cost.npz other_cost.npz",
    "diff cost.npz other_cost.npz --image d.png --force",
    "diff site.yaml --params-file robot.yaml --against wide.yaml -q",
    f"merge site.yaml other.yaml {OUT}",
    f"merge site.yaml turned.yaml other.yaml {OUT} --image o.png",
    "merge odds.npz turned.yaml --rule evidence -q -o out.npz",
    f"clean site.yaml --min-obstacle 1 {OUT}", "align site.yaml other.yaml",
    "align site.yaml other.yaml --image o.png --force", "score site.yaml",
    "score site.yaml --truth other.yaml",
    "score site.yaml --truth other.yaml --image score.png --force", "query site.yaml --at 2,2",
    "query canvas.npz --at 2,2", "query esdf.npz --at 2,2",
    "query site.yaml --robot-radius 20 --at 30,30,0 --rule full",
    "query cost.npz --robot-radius 1 --at 2,2,0", ROUTE,
    f"{ROUTE} --heuristic field --field-weight 1", "route cost.npz --pairs pairs.csv -q",
    "reach site.yaml --robot-radius 0.04 -q -o out.json --layers out.npz",
    "reach cost.npz --from 0.1,0.1 -q -o out.json",
    f"reach site.yaml --footprint {CORNERS} -q -o out.json",
    "graph site.yaml --robot-radius 0.04 -q -o out.geojson",
    "scan site.yaml --tour --robot-radius 0.04 --range-max 9 --rate 1 -q -o out.npz",
    "route cost.npz --from 0.1,0.1 --to 9.1,9.1 --method descent",
    f"build scans.npz --size 100,100 --origin 0,0 {OUT}",
    f"build scans.npz --size 100,100 --origin 0,0 {OUT} --method tsdf",
    "build scans.npz --size 100,100 --origin 0,0 -o compared -q --compare",
    "local --cloud cloud.npy --pose 0,0,0 --size 100,100 -o out",
]  # fmt: skip


@pytest.mark.skipif(not IS_COMPILED, reason="the figures are of the compiled kernels")
@pytest.mark.parametrize("line", COMMANDS)
def test_the_memory_that_a_command_asks_for_is_enough_and_not_much_too_much(ordinary, line):
    line += " --force" if " -o " in line and "--force" not in line else ""
    allowed, needed = 0.0, 51.0
    while needed > allowed:  # reading may ask for less than what follows
        allowed = needed
        code, output, peak = measured(ordinary, line, f"{allowed}MB")
        more = re.search(r"needs? ([0-9.]+) MB of memory", output)
        needed = float(more[1]) if more else allowed
    assert code in (0, 1), output  # 1: they differ, no way leads there
    assert peak < SLACK * allowed * 1_000_000
    assert allowed < 3 * peak / 1_000_000


def test_a_repair_that_turns_a_large_map_is_refused_before_it_begins(ordinary):
    code, output, _ = measured(ordinary, f"lint turned.yaml --fix {OUT} --force", "80MB")
    assert (code, "turned.yaml: needs" in output) == (3, True), output


@pytest.mark.skipif(not IS_COMPILED, reason="takes minutes without compiled kernels")
@pytest.mark.parametrize(("command", "most"), [("cost -o cost.yaml", 120), ("run -o out", 161)])
def test_memory_stays_within_the_budget(tmp_path, command, most):
    values = np.zeros((5000, 6001), np.int8)
    values[::50, 7::70] = 100
    values[:, -500:] = -1
    write_map(tmp_path / "site.yaml", OccupancyGrid(values, 0.05, (1.5, -2.0, 0.4)))
    code, output, peak = measured(tmp_path, f"{command} site.yaml -q --threads 2", f"{most}MB")
    assert (code, output) == (0, "")
    assert peak < most * 1_000_000  # in memory: 170 and 440 MB
