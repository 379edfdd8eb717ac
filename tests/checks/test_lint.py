"""Each check of lint on a map that it is about, and none on a good map."""

import io
import json
import re
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mapdeal import Costmap, OccupancyGrid, esdf, field_view, read_map, write_map
from mapdeal.checks import lint as lint
from mapdeal.checks.facts import GridFacts, PairFacts, check
from mapdeal.checks.findings import CHECKS
from mapdeal.checks.lint import lint_file

GOOD_YAML = {
    "image": "m.pgm", "mode": "trinary", "resolution": "0.05", "origin": "[-1.5, 2.0, 0.0]",
    "negate": "0", "occupied_thresh": "0.65", "free_thresh": "0.196",
}  # fmt: skip
ROOM = np.full((12, 15), 205, np.uint8)
ROOM[1:-1, 1:-1] = 0
ROOM[2:-2, 2:-2] = 254


def pgm(pixels, *, comment="", maxval=255, newline=b"\n"):
    height, width = pixels.shape
    note = f"# {comment}".encode() + newline if comment else b""
    sizes = b"%d %d" % (width, height) + newline + b"%d" % maxval + newline
    return b"P5" + newline + note + sizes + pixels.tobytes()


def png(pixels, mode=None, **options):
    file = io.BytesIO()
    image = pixels if isinstance(pixels, Image.Image) else Image.fromarray(pixels, mode)
    image.save(file, "PNG", **options)
    return file.getvalue()


def painted(**changes):
    """The room with some of its pixels changed: `at` rows and columns, to a value."""
    pixels = ROOM.copy()
    for name, value in changes.items():
        pixels[tuple(int(part) for part in name[1:].split("_"))] = value
    return pixels


@pytest.fixture
def checks(tmp_path):
    """Lint a map; return the names of the checks that find something, and the findings."""

    def run(image=None, name="m.pgm", without=(), text=None, **changes):
        entries = {**GOOD_YAML, "image": name, **changes}
        lines = [f"{key}: {value}" for key, value in entries.items() if key not in without]
        (tmp_path / "m.yaml").write_text("\n".join(lines) + "\n" if text is None else text)
        (tmp_path / name).write_bytes(pgm(ROOM) if image is None else image)
        findings = lint_file(tmp_path / "m.yaml")
        return [finding.check for finding in findings], findings

    return run


def test_a_good_map_has_no_finding(checks):
    assert checks() == ([], [])


LOSSY = io.BytesIO()
Image.fromarray(ROOM).save(LOSSY, "JPEG", quality=100)
TURNED = Image.fromarray(ROOM)
EXIF = Image.Exif()
EXIF[0x0112] = 3
SEEN_THROUGH = np.stack([ROOM, ROOM, ROOM, np.where(ROOM == 205, 99, 255)], axis=-1).astype("u1")
TINTED = np.stack([ROOM, ROOM, ROOM], axis=-1)
TINTED[5, 5] = (250, 120, 0)
PALETTE = Image.fromarray(ROOM).convert("P")
CARTOGRAPHER = np.where(ROOM == 205, 128, ROOM).astype("u1")
CARTOGRAPHER[0] = 128
TWO_ROOMS = np.full((60, 130), 0, np.uint8)
TWO_ROOMS[1:-1, 1:60] = TWO_ROOMS[1:-1, 70:-1] = 254
LARGE = np.full((60, 60), 205, np.uint8)
LARGE[20:32, 20:35] = ROOM
ISLET = painted()
ISLET[0, 0] = 254


def with_chunk(image, name, body):
    """A PNG with one more chunk behind its header, which ends at byte 33."""
    chunk = struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
    return image[:33] + chunk + image[33:]


SEE_THROUGH_COLOUR = png(TINTED, transparency=(254, 254, 254))
BARE = """resolution: 0.05
origin: [0, 0, 0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""

CASES = [
    ("file.access", {"text": "image: gone.pgm\n" + BARE}),
    ("file.malformed", {"resolution": "none"}),
    ("yaml.defaults", {"without": ("negate",)}),
    ("yaml.number-as-text", {"resolution": "5e-2"}),
    ("yaml.nan-yaw", {"origin": "[-1.5, 2.0, -nan]"}),
    ("yaml.legacy-mode", {"without": ("mode",), "trinary": "true"}),
    ("yaml.unknown-key", {"ocupied_thresh": "0.5"}),
    ("yaml.mode-case", {"mode": "Trinary"}),
    ("yaml.image-unquoted", {"name": "2024-01-01"}),
    ("yaml.resolution-noise", {"resolution": "0.05000000074505806"}),
    ("yaml.resolution-unusual", {"resolution": "0.0005", "origin": "[0, 0, 0]"}),
    ("yaml.origin-noise", {"origin": "[-1.5000000000000009, 2, 0]"}),
    ("yaml.origin-yaw", {"origin": "[-1.5, 2, 0.1]"}),
    ("yaml.origin-off-lattice", {"origin": "[-1.51, 2, 0]"}),
    ("yaml.origin-far", {"origin": "[431200, 5411200, 0]"}),
    ("thresholds.equal", {"free_thresh": "0.65"}),
    ("thresholds.unknown-becomes-free", {"free_thresh": "0.25"}),
    ("thresholds.on-grey", {"free_thresh": repr(50 / 255)}),
    ("readers.differ", {"image": pgm(painted(_5_5=102)), "occupied_thresh": "0.6"}),
    ("image.absolute-path", {"text": "image: /nowhere/m.pgm\n" + BARE}),
    ("image.foreign-path", {"text": "image: /nowhere/m.pgm\n" + BARE}),
    ("image.lossy", {"image": LOSSY.getvalue(), "name": "m.jpg"}),
    ("image.orientation", {"image": png(TURNED, exif=EXIF), "name": "m.png"}),
    ("image.transparent-colour", {"image": SEE_THROUGH_COLOUR, "name": "m.png"}),
    ("image.dos-header", {"image": pgm(ROOM, newline=b"\r\n")}),
    ("image.trailing-bytes", {"image": pgm(ROOM) + b"xyz"}),
    ("image.raw-values", {"image": pgm(painted(_5_5=130) % 255), "mode": "raw"}),
    ("image.ending", {"image": png(ROOM)}),
    ("image.maxval", {"image": pgm(ROOM // 2, maxval=127)}),
    ("image.alpha", {"image": png(SEEN_THROUGH), "name": "m.png"}),
    ("image.gamma", {"image": with_chunk(png(ROOM), b"gAMA", bytes(4)), "name": "m.png"}),
    ("image.colour", {"image": png(TINTED), "name": "m.png"}),
    ("image.palette", {"image": png(PALETTE), "name": "m.png"}),
    ("image.greys", {"image": pgm(painted(_5_5=240))}),
    ("image.cartographer", {"image": pgm(CARTOGRAPHER)}),
    ("image.comment-resolution", {"image": pgm(ROOM, comment="Saver 0.100 m/pix")}),
    ("map.no-obstacle", {"image": pgm(np.where(ROOM == 0, 254, ROOM).astype("u1"))}),
    ("map.no-free", {"image": pgm(np.where(ROOM == 254, 0, ROOM).astype("u1"))}),
    ("map.all-unknown", {"image": pgm(np.full((4, 5), 205, np.uint8))}),
    ("map.mostly-unknown", {"image": pgm(LARGE)}),
    ("map.inside-out", {"negate": "1"}),
    ("map.islands", {"image": pgm(TWO_ROOMS)}),
    ("map.specks", {"image": pgm(ISLET)}),
    ("map.open-border", {"image": pgm(painted(_0_5=254))}),
]  # fmt: skip


@pytest.mark.parametrize(("name", "map_"), [pytest.param(n, m, id=n) for n, m in CASES])
def test_a_check_finds_what_it_is_about(checks, name, map_):
    names, findings = checks(**map_)
    assert name in names
    (found, *_) = [finding for finding in findings if finding.check == name]
    assert found.severity == CHECKS[name].severity
    assert found.message
    assert "\n" not in found.message
    order = ["error", "warning", "note"]
    ranks = [order.index(finding.severity) for finding in findings]
    assert ranks == sorted(ranks)


@pytest.mark.parametrize("name", ["v.yaml", "v.npz"])
@pytest.mark.parametrize("view", ["metric", "per-map"])
def test_a_view_of_a_field_is_named_and_not_taken_for_a_map(tmp_path, name, view):
    grid = OccupancyGrid([[100, 0, 0, -1], [100, 0, 0, 0]], 0.25, (1.0, 2.0, 0.3))
    write_map(tmp_path / name, field_view(esdf(grid), view=view))
    (found,) = [one for one in lint_file(tmp_path / name, radius=0.1) if "yaw" not in one.check]
    assert (found.check, found.severity) == ("map.view", "warning")
    end = {"metric": "2", "per-map": "0.75"}[view]
    told = f"is the 0..100 view of a distance field ({view}, 0 at {end} m), not a map"
    assert found.message == told


def test_every_check_has_a_case():
    covered = {name for name, _ in CASES} | {"image.depth", "image.outside-folder", "map.view"}
    covered |= {"run.no-manifest", "run.missing-file", "run.other-file", "run.uniform-cost"}
    covered |= {"map.disconnected", "lint.left-out"}  # test_room_checks.py
    covered |= {"lint.not-checked", "lint.unused-ignore"}  # tests/commands/test_lint.py
    covered |= {name for name in CHECKS if name.startswith("params.")}  # test_lint_parameters.py
    assert covered == set(CHECKS)
    assert len(CHECKS) >= 30
    assert all(re.fullmatch(r"[a-z]+\.[a-z-]+", name) for name in CHECKS)


def test_an_image_of_another_folder(tmp_path):
    (tmp_path / "maps").mkdir()
    (tmp_path / "m.pgm").write_bytes(pgm(ROOM))
    lines = [f"{key}: {value}" for key, value in {**GOOD_YAML, "image": "../m.pgm"}.items()]
    (tmp_path / "maps" / "m.yaml").write_text("\n".join(lines))
    (found,) = lint_file(tmp_path / "maps" / "m.yaml")
    assert (found.check, found.line) == ("image.outside-folder", 1)


def test_counts_of_the_readers_are_told(checks):
    _, findings = checks(pgm(painted(_5_5=102)), occupied_thresh="0.6")
    first, second = (f.message for f in findings if f.check == "readers.differ")
    counts = "(nav2: occupied 43, free 87"
    assert first.startswith(f"1 cells (0.556 %) differ between nav2 and humble {counts}")
    assert second.endswith("ros1: occupied 42, free 87, unknown 51)")


def test_an_npz_has_its_cells_checked(tmp_path):
    write_map(tmp_path / "m.npz", OccupancyGrid(np.zeros((3, 4), np.int8), 0.1))
    found = [finding.check for finding in lint_file(tmp_path / "m.npz")]
    assert found == ["map.no-obstacle", "map.open-border"]
    (tmp_path / "bad.npz").write_bytes(b"no zip")
    assert [f.check for f in lint_file(tmp_path / "bad.npz")] == ["file.malformed"]


def test_a_folder_of_a_run_is_what_its_manifest_says(command, folder):
    words = ["--no-images", "--set", "inflate.radius=0.01"]
    assert command("run", "good.yaml", "-o", "out", *words)[0] == 0
    assert lint_file(folder / "out" / "good") == []
    (folder / "out" / "good" / "cost.npz").write_bytes(b"of another run")
    (folder / "out" / "good" / "esdf.pgm").unlink()
    found = lint_file(folder / "out" / "good")
    assert [(f.check, f.message.split()[0]) for f in found] == [
        ("run.missing-file", "esdf.pgm"), ("run.other-file", "cost.npz"),
    ]  # fmt: skip
    assert command("lint", "out/good")[0] == 1
    assert [f.check for f in lint_file(folder)] == ["run.no-manifest"]


def test_a_run_whose_costs_say_nothing_has_a_finding(command, folder):
    words = ["--recipe", "design-real", "--set", "inflate.radius=0"]
    words += ["--set", "cost.down=100", "--set", "cost.up=100"]
    code, _, err = command("run", "good.yaml", "-o", "out", "--no-images", *words)
    told = "% of the open cells (below 99) cost 0: lower up (100) and down (100)"
    assert (code, err.count(told)) == (0, 1)
    (found,) = lint_file(folder / "out" / "good")
    assert (found.check, found.severity) == ("run.uniform-cost", "warning")
    assert found.message == "cost: 100 % of the open cells cost 0"
    assert command("lint", "out/good")[0] == 0
    assert command("lint", "out/good", "--strict")[0] == 1


@pytest.mark.parametrize("name", ["cost.npz", "cost.yaml"])
@pytest.mark.parametrize(("cost", "told"), [
    ([[0, 0, 0, 254], [0, 0, 0, 255]], "100 % of the open cells cost 0: a larger"),
    ([[254, 253, 254]], "every known cell is lethal or inscribed"),
    ([[0, 1, 120], [3, 130, 254]], None),
])  # fmt: skip
@pytest.mark.filterwarnings("ignore:.*which map_server would misread")
def test_costs_that_say_nothing_are_found_in_their_own_files_too(tmp_path, name, cost, told):
    costmap = Costmap(np.array(cost, np.uint8), 0.25, (1.5, -2.0, 0.0))
    write_map(tmp_path / name, costmap, encoding="costmap2d")
    found = [f for f in lint_file(tmp_path / name) if f.check != "yaml.unknown-key"]
    assert [(f.check, f.severity) for f in found] == [("run.uniform-cost", "warning")] * bool(told)
    assert all(f.message.startswith(told) for f in found)


@pytest.mark.filterwarnings("ignore:.*which map_server would misread")
def test_costs_that_cannot_be_read_are_a_finding(tmp_path):
    write_map(tmp_path / "m.yaml", Costmap(np.ones((2, 3), np.uint8), 0.25), encoding="costmap2d")
    Image.fromarray(TINTED).save(tmp_path / "m.pgm", "PPM")
    (found,) = lint_file(tmp_path / "m.yaml")
    assert found.check == "file.malformed"
    assert "must have one 8-bit grey channel" in found.message


def test_a_map_of_which_nothing_is_known_is_told_once(checks):
    _, findings = checks(pgm(np.full((4, 5), 205, np.uint8)))
    errors = [(f.check, f.message) for f in findings if f.severity == "error"]
    assert errors == [
        ("map.all-unknown", "every cell is unknown; are the thresholds, mode and negate right?")
    ]


def test_fix_puts_a_yaw_into_the_cells_and_loses_no_obstacle(command, folder):
    code, out, _ = command("lint", "turned.yaml", "--fix", "-o", "fixed.yaml")
    assert code == 0
    assert "yaw 1 rad is in the cells now" in out
    turned, fixed = read_map("turned.yaml"), read_map("fixed.yaml")
    assert fixed.origin[2] == 0
    rng = np.random.default_rng(1)
    for value in (100, 0, -1):
        cells = np.argwhere(turned.occupancy == value)[:, np.newaxis]
        inner = (0.5, 0.5) if value != 100 else rng.random((1, 20, 2))
        points = turned.frame.xy_from_continuous_rowcol((cells + inner).reshape(-1, 2))
        hit, inside = fixed.frame.bounded_rowcol_from_xy(points)
        assert inside.all()
        found = fixed.occupancy[tuple(hit.T)]
        assert np.all(found == 100) if value == 100 else np.isin(found, (value, 100)).mean() > 0.9
    assert not {f.check for f in lint_file(folder / "fixed.yaml")} & {
        "yaml.origin-yaw", "yaml.origin-off-lattice", "image.absolute-path",
    }  # fmt: skip


@pytest.mark.parametrize(("words", "code"), [
    (["bad.yaml", "--fix", "-o", "x.yaml"], 3),
    (["good.yaml", "--fix", "-o", "good.yaml"], 4),
    (["good.yaml", "--fix", "-o", "turned.yaml"], 4),
])  # fmt: skip
def test_fixes_that_cannot_be(command, folder, words, code):
    before = sorted(path.name for path in folder.iterdir())
    assert command("lint", *words)[0] == code
    assert sorted(path.name for path in folder.iterdir()) == before


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A good map, one with a warning, one with an error, one that is malformed."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "m.pgm").write_bytes(pgm(ROOM))
    for name, change in (("good", {}), ("turned", {"origin": "[0, 0, 1]"}),
                         ("free", {"free_thresh": "0.25"}), ("bad", {"negate": "2"})):  # fmt: skip
        lines = [f"{key}: {value}" for key, value in {**GOOD_YAML, **change}.items()]
        (tmp_path / f"{name}.yaml").write_text("\n".join(lines))
    return tmp_path


def test_text_has_a_line_a_finding_and_a_sum(command, folder):
    code, out, err = command("lint", "bad.yaml", "turned.yaml", "good.yaml", "free.yaml")
    lines = out.splitlines()
    assert (code, err) == (1, "")
    assert lines[0].startswith("bad.yaml:5: error: file.malformed: negate: must be 0 or 1")
    assert lines[1].startswith("turned.yaml:4: warning: yaml.origin-yaw: yaw 1 rad")
    assert lines[2].startswith("free.yaml:7: error: thresholds.unknown-becomes-free: ")
    assert lines[-1].startswith("4 maps: 2 errors, 1 warning, ")
    assert command("lint", "good.yaml", "-q")[1] == ""
    # notes are no failure, however strict
    Path("noted.yaml").write_text(Path("good.yaml").read_text().replace("-1.5", "-1.51"))
    assert command("lint", "noted.yaml", "--strict")[0] == 0
    assert command("lint", "noted.yaml", "turned.yaml", "--strict")[0] == 1


@pytest.mark.parametrize(("before", "after", "expected"), [
    ("resolution: 0.1", "resolution: 1e-1", "2: warning: yaml.number-as-text: resolution: '1e"),
    ("negate: 0", "negate: 7", "4: error: file.malformed: negate: must be 0 or 1"),
    ("negate: 0", "negate: {0", "m.yaml:5: error: file.malformed: column "),
    ("image: m.pgm", "image: gone.pgm", "1: error: file.access: image: the image does not"),
    ("image: m.pgm", "image: /gone/m.pgm", "1: warning: image.foreign-path: image: /gone/m"),
    ("image: m.pgm", "", "m.yaml: error: file.malformed: missing key image"),
])  # fmt: skip
def test_what_readers_find_stands_at_its_line(
    command, tmp_path, monkeypatch, before, after, expected
):
    monkeypatch.chdir(tmp_path)
    Path("m.pgm").write_bytes(b"P5 3 2 255\n" + bytes([0, 254, 205, 254, 0, 254]))
    text = (
        "image: m.pgm\nresolution: 0.1\norigin: [1.0, -2.0, 0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    assert before in text
    Path("m.yaml").write_text(text.replace(before, after))
    _, out, _ = command("lint", "m.yaml")
    assert any(expected in line for line in out.splitlines()), out
    assert "(line " not in out


def test_annotations_of_a_workflow(command, folder):
    (folder / "a,b.yaml").write_text((folder / "turned.yaml").read_text() + "\nx%y: 1\n")
    _, out, _ = command("lint", "a,b.yaml", "--format", "github")
    assert (
        "::warning file=a%2Cb.yaml,line=4,title=yaml.origin-yaw::yaw 1 rad is ignored by "
        "costmap_2d and AMCL"
    ) in out.splitlines()
    assert "::unknown key 'x%25y'" in out
    assert all(line.startswith("::") for line in out.splitlines())


def test_real_maps_are_all_linted(command, real_maps):
    others = {"expected", "params"}
    maps = sorted(path for path in real_maps.rglob("*.yaml") if not others & {*path.parts})
    assert len(maps) > 35
    code, out, _ = command("lint", *maps, "--format", "json")
    assert code == 1
    found = {
        (entry["file"].rsplit("/", 1)[1], finding["check"])
        for entry in json.loads(out)["maps"]
        for finding in entry["findings"]
    }
    for name, expected in [
        ("stata_basement.yaml", "yaml.origin-yaw"),
        ("depot.yaml", "thresholds.unknown-becomes-free"),
        ("frieburg.yaml", "readers.differ"),
        ("mymap.yaml", "image.absolute-path"),
        ("map.yaml", "map.mostly-unknown"),
        ("skirk.yaml", "map.inside-out"),
        ("invalid_image.yaml", "file.access"),
    ]:
        assert (name, expected) in found


@pytest.mark.parametrize(("comment", "is_found"), [
    ("saver 0.100 m/pix", True), ("saver .1 m/pix", True), ("saver 1. m/pix", True),
    ("1" * 60_000, False), ("." * 60_000, False), ("0.050" + " " * 60_000 + "m/pix", False),
    ("version 1.2.3 m/pix", False), (". m/pix", False),
], ids=lambda value: str(value)[:20])  # fmt: skip
def test_a_resolution_in_a_comment_is_found_however_it_is_written(checks, comment, is_found):
    names, _ = checks(pgm(ROOM, comment=comment))
    assert ("image.comment-resolution" in names) == is_found


@pytest.mark.parametrize(("name", "told"), [
    ("gAMA", "a gamma of 1: viewers"), ("iCCP", "a colour profile: viewers"),
])  # fmt: skip
def test_a_gamma_is_told_and_changes_no_cell(checks, tmp_path, name, told):
    body = {"gAMA": (100_000).to_bytes(4), "iCCP": b"profile\0\0" + zlib.compress(bytes(128))}
    _, (found,) = checks(with_chunk(png(ROOM), name.encode(), body[name]), "m.png")
    assert (found.check, found.message.startswith(told)) == ("image.gamma", True)
    seen = read_map(tmp_path / "m.yaml").occupancy
    assert np.array_equal(seen[::-1] == 100, ROOM == 0)
    assert np.array_equal(seen[::-1] == 0, ROOM == 254)


@pytest.mark.parametrize(("name", "changes", "told"), [
    ("free.yaml", [], f"{(ROOM == 205).sum()} cells are now unknown instead of free: map_saver's"),
    ("good.yaml", [("0.0]", "-nan]")], "yaw -nan, a fault of some map savers: must be 0"),
    ("good.yaml", [("0.05", "0.05000000074505806"), ("-1.5", "-1.5000000000000009")], ""),
])  # fmt: skip
def test_fix_takes_the_traps_out(command, folder, name, changes, told):
    text = (folder / name).read_text()
    for before, after in changes:
        text = text.replace(before, after)
    (folder / "odd.yaml").write_text(text)
    code, out, err = command("lint", "odd.yaml", "--fix", "-o", "new/fixed.yaml")
    assert (code, err, told in out) == (0, "", True)
    assert lint_file(folder / "new" / "fixed.yaml") == []
    fixed, good = read_map("new/fixed.yaml"), read_map("good.yaml")
    assert (fixed.resolution, fixed.origin) == (0.05, (-1.5, 2.0, 0.0))
    assert np.array_equal(fixed.occupancy, good.occupancy)


def test_checks_that_cannot_be_added():
    def of_both(pair: PairFacts, cells: GridFacts):
        yield "both"

    def of_grid(facts: GridFacts):
        yield "a grid"

    rule = "check test.odd must have one parameter, annotated PairFacts or GridFacts or .*, got "
    with pytest.raises(TypeError, match=rule):
        check("test.odd", "note", "anything")(of_both)
    assert "test.odd" not in CHECKS
    with pytest.raises(ValueError, match=r"two checks are called map\.specks"):
        check("map.specks", "note", "small patches")(of_grid)
