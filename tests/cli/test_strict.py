import json
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import mapdeal
from bad_maps import tree, yaml_text
from mapdeal.cli.main import command_names
from mapdeal.command import Output, commands_named
from robots import write_robot

FREED = (
    "m.yaml: 300 cells (12.5 %) of grey 205, which map_saver writes for unknown, are read as free;"
    " lower free_thresh from 0.25 to 0.196"
)
OUT = "-o new/deep/o"
IMAGE = "--image new/deep/o.png"
CIRCLE = "--radius 0.2 --value 100"
# Lines that warn, of every command that can; others are added below.
LINES = [
    "info m.yaml", "view m.yaml --no-browser", "query m.yaml --at 3,0",
    f"inflate m.yaml {OUT}.yaml", f"cost m.yaml {OUT}.npz {IMAGE} --curve new/deep/curve.png",
    f"shift m.yaml --origin 2,-1.5 {OUT}.yaml {IMAGE}",
    f"window m.yaml --corner 3,0 --size 1,1 {OUT}.yaml {IMAGE}",
    f"rescale m.yaml --resolution 0.2 {OUT}.yaml {IMAGE}",
    f"rotate m.yaml --yaw 0.3 {OUT}.yaml {IMAGE}", f"clean m.yaml {OUT}.yaml {IMAGE}",
    f"merge m.yaml m.yaml {OUT}.yaml {IMAGE}",
    f"edit circle m.yaml {OUT}.yaml {IMAGE} --point 3,0 {CIRCLE}",
    f"edit polygon m.yaml {OUT}.yaml --point 3,0 4,0 4,1 --value 100",
    f"edit line m.yaml {OUT}.yaml --point 3,0 4,0 --value 100",
    f"edit reset m.yaml {OUT}.yaml --at 3,0 --size 0.5,0.5", f"convert m.yaml {OUT}.png",
    f"pack m.yaml {OUT}.pbm {IMAGE}", f"unpack bits.pbm {OUT}.yaml", f"build log.clf {OUT}.yaml",
    f"report m.yaml {OUT}.html", f"graph m.yaml {OUT}.geojson",
    f"mask m.yaml --file zone.geojson --kind binary {OUT}",
    f"reach m.yaml --from 3,0 --to 3.3,0 {OUT}.json {IMAGE}",
    f"route m.yaml --from 3,0 --to 3.3,0 {OUT}.json {IMAGE}",
    f"plan m.yaml --params-file r.yaml --from 3,0 --to 3.3,0 {OUT}.json {IMAGE}",
    *(f"{name} m.yaml m.yaml {IMAGE}" for name in ("diff", "align")),
    f"score m.yaml --truth m.yaml {IMAGE}", f"local --map m.yaml --pose 3,0,0.2 {OUT}",
    f"scan m.yaml --tour {OUT}.npz", f"run m.yaml {OUT} --no-images",
    "run m.yaml -o new --no-images --report",
    "run m.yaml good.yaml -j 1 -o new --set cost.inscribed_radius=0.1",
]  # fmt: skip
# Of lint the findings that are warnings count; nothing is warned of in a script.
STRICT_ALONE = {"lint", "completion"}


def plain_line(name):
    """Return a line of a command that has none above."""
    output = Output("OUT.npz", "")
    if find_spec(f"mapdeal.commands.{name}"):
        import_module(f"mapdeal.commands.{name}")
        output = commands_named(name)[""].output
    return f"{name} m.yaml" + (f" {OUT}{Path(output.metavar).suffix}" if output else "")


HAVE_LINES = {line.split()[0] for line in LINES} | STRICT_ALONE
LINES += [plain_line(name) for name in command_names() if name not in HAVE_LINES]


def usual_code(line):
    # align is not sure of so few cells; lint finds an error, which the page of a run shows
    return int(line.startswith("align") or (line.startswith("run m.yaml") and "--report" in line))


def warned(err):
    return [line for line in err.splitlines() if line.startswith("warning: ")]


@pytest.fixture(autouse=True)
def maps(here):
    """A map of which 12.5 % are freed, one of which nothing is known, and a good one."""
    greys = np.full((40, 60), 254, dtype=np.uint8)
    greys[5, :] = 0
    greys[10:20, 30:60] = 205
    unknown = np.full((3, 5), 205, np.uint8)
    for name, cells, free in (("m", greys, 0.25), ("u", unknown, 0.196), ("good", greys, 0.196)):
        head = b"P5\n%d %d\n255\n" % cells.shape[::-1]
        Path(f"{name}.pgm").write_bytes(head + cells.tobytes())
        text = yaml_text(image=f"{name}.pgm", resolution=0.1, free_thresh=free)
        Path(f"{name}.yaml").write_text(text)
    write_robot("r.yaml", 0.1)
    point = {"type": "Point", "coordinates": [3, 0]}
    zone = {"type": "Feature", "properties": {"radius": 0.2}, "geometry": point}
    Path("zone.geojson").write_text(json.dumps(zone))
    return here


@pytest.fixture
def bits_and_log(maps):
    Path("bits.pbm").write_bytes(b"P4\n8 2\n\xff\x0f")
    Path("bits.yaml").write_text("image: bits.pbm\nresolution: 0.1\norigin: [0, 0, 0]\n")
    scan = f"FLASER 180 {'2.0 ' * 180}0.5 0 0 0.5 0 0 {{0}} robot {{0}}\n"
    Path("log.clf").write_text("".join(scan.format(time) for time in (2.0, 1.0, 3.0)))


@pytest.mark.parametrize("line", [*LINES, "inflate m.yaml -o -"])
def test_a_strict_command_that_warns_ends_with_1_and_writes_nothing(sh, maps, bits_and_log, line):
    before = tree(maps)
    code, out, err = sh(f"{line} --strict -q")
    warnings = warned(err)
    count = "1 warning" if len(warnings) == 1 else f"{len(warnings)} warnings"
    assert (code, tree(maps), bool(warnings)) == (1, before, True)
    assert err.splitlines()[-1].split(";")[0].endswith(f"{count}, and --strict allows none")
    if line.endswith("-o -"):
        assert out == ""
        return
    # without the option the same words write, and warn of the same
    code, _, err = sh(line)
    assert code == usual_code(line)
    assert warned(err)[: len(warnings)] == warnings
    assert err.count(FREED) == ("m.yaml" in line)  # once, however often it is read
    assert Path("new").is_dir() == ("new/" in line or "-o new" in line)
    assert IMAGE not in line or Path("new/deep/o.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.usefixtures("bits_and_log")
@pytest.mark.parametrize("line", LINES)
def test_strictness_alone_is_no_reason(sh, line):
    line = line.replace("m.yaml", "good.yaml")
    code, _, err = sh(f"{line} --strict")
    assert code == (1 if warned(err) else usual_code(line))


def test_a_sequence_is_strict_cloud_by_cloud(sh, maps):
    Path("0.csv").write_text("x,y\n0.45,0.4\n")
    Path("1.csv").write_text("x,y\n")  # no point marks a cell
    Path("poses.txt").write_text("0 0 0\n1 0 0\n")
    line = "local --cloud 0.csv --cloud 1.csv --poses poses.txt --no-images --size 1,1"
    assert sh(f"{line} -o new")[0] == 0
    for keep in ("", "--keep 2"):
        err = sh.err(f"{line} {keep} -o strict --strict --force", 5)
        assert "error: 1.csv: 2 warnings, and --strict allows none; nothing was written" in err
        assert sorted(path.name for path in Path("strict").iterdir()) == ["0000", "summary.json"]
    Path("new/0007").mkdir()
    before = tree(maps)
    warning = "warning: 1 folders are not of this sequence"
    assert warning in sh.err(f"{line} -o new --strict --force", 1)
    assert tree(maps) == before


@pytest.mark.parametrize(("line", "warning"), [
    ("reach good.yaml --robot-radius 0.05 -o new/o.json", "no start is given"),
    ("diff good.yaml part.yaml --max-differing 100 --image new/o.png", "does not cover"),
    ("run good.yaml -o old --force", "holds the local map of an earlier run"),
])  # fmt: skip
def test_what_is_known_last_of_all_is_warned_of_before_anything_is_written(sh, maps, line, warning):
    assert sh("window good.yaml --corner 3,0 --size 1,1 -o part.yaml")[0] == 0
    assert sh("run good.yaml -o old --pose 3,0,0.2 --no-images")[0] == 0
    before = tree(maps)
    err = sh.err(f"{line} --strict", 1)
    assert warning in err
    assert "1 warning, and --strict allows none; nothing was written" in err
    assert tree(maps) == before
    assert sh(line)[0] == 0
    assert tree(maps) != before


def test_manifests_and_summaries_record_warnings_with_any_workers(sh):
    for more in ("-j 1", "--max-memory 120M -j 2"):
        line = f"run m.yaml good.yaml -o o{more[-1]} --no-images {more}"
        assert sh.err(line) == f"warning: {FREED}\n"
    assert json.loads(Path("o1/m/manifest.json").read_text())["warnings"] == [FREED]
    assert json.loads(Path("o1/good/manifest.json").read_text())["warnings"] == []
    m, good = json.loads(Path("o1/summary.json").read_text())["maps"]
    assert (m["warnings"], good.get("warnings")) == ([FREED], None)


def test_manifests_name_files_as_they_would_anywhere(sh, maps):
    sh("run m.yaml -o a --no-images")
    sh(f"run {maps}/m.yaml -o b --no-images")
    assert Path("a/m/manifest.json").read_bytes() == Path("b/m/manifest.json").read_bytes()
    _, out, err = sh(f"run {maps}/m.yaml -o b --no-images")
    assert out.endswith("unchanged\n")
    assert err == f"warning: {maps}/{FREED}\n"


@pytest.mark.parametrize(("words", "count", "message"), [
    ("m.yaml", 1, FREED),
    ("u.yaml", 2, "cost: every cell is unknown"),
    ("good.yaml --set inflate.radius=0.05 --set cost.inflation_radius=0.06", 1,
     "radius 0.05 m is below a cell"),
    ("good.yaml --set cost.inscribed_radius=0.1", 1, "so the robot's radius counts twice"),
])  # fmt: skip
def test_a_strict_run_leaves_what_an_earlier_one_has_written(sh, maps, words, count, message):
    for _ in range(2):  # done, and unchanged
        lines = warned(sh.err(f"run {words} -o o --no-images"))
        assert (len(lines), message in lines[-1]) == (count, True)
    assert json.loads(next(Path("o").rglob("manifest.json")).read_text())["warnings"]
    before = tree(maps)
    for folder in ("s", "o"):
        code, out, err = sh(f"run {words} -o {folder} --no-images --strict")
        assert (code, out, tree(maps)) == (1, "", before)
        ending = "; nothing was written" if folder == "s" else ""
        assert err.endswith(f"and --strict allows none{ending}\n")


@pytest.mark.usefixtures("mapdeal_warnings")
def test_python_is_as_strict():
    with pytest.raises(mapdeal.FindingError, match="1 warning"):
        mapdeal.run("good.yaml", "s", changes={"cost.inscribed_radius": 0.1}, strict=True)
    assert not Path("s").exists()


def test_a_strict_batch_goes_on_with_other_maps(sh):
    message = "m.yaml: 1 warning, and --strict allows none"
    assert message in sh.err("run m.yaml good.yaml -o o --no-images --strict -j 1", 5)
    m, good = json.loads(Path("o/summary.json").read_text())["maps"]
    assert (m["status"], m["exit_code"], m["warnings"]) == ("failed", 1, [FREED])
    assert good["status"] == "done"
    assert not Path("o/m").exists()
