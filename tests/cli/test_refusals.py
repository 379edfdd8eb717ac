import shutil
from pathlib import Path

import numpy as np
import pytest

import mapdeal
from bad_maps import tree
from drawn import grid_from_text
from mapdeal import OccupancyGrid, write_map as write
from mapdeal.maps.npz import write_npz

ROBOT = "--footprint [[0.12,0.06],[0.12,-0.06],[-0.12,-0.06],[-0.12,0.06]]"
POSES = f"query m.yaml {ROBOT}"
WEIGHTS = "route m.yaml --from 1,1 --to 5,1"
EXAMPLES = Path(__file__).parents[2] / "examples"
NAV2 = """\
global_costmap: {global_costmap: {ros__parameters: {
  robot_radius: 0.2, plugins: [s], s: {plugin: "nav2_costmap_2d::StaticLayer"}}}}
"""
ZONES = EXAMPLES / "shapes" / "office_filters.geojson"
MASK = f"mask m.yaml -o f --file {ZONES}"
AROUND = "run m.yaml -o out --pose 0,0,0"
SCORE = "score none.yaml --truth none.yaml"
COMPARED = "build none.npz --compare -o out"

MERGES = [
    (2, "cost.npz", "cost.npz: is not a map; merge the maps, and compute costs"),
    (2, "far.yaml", "the maps lie too far apart: "),
    (3, "m2.yaml --by only.yaml", "only.yaml: "),
    (4, "m2.yaml --by none.json", "none.json: "),
    (3, "m2.yaml --by bad.json", "bad.json: the document: must have a key y"),
    (2, "m2.yaml --by move.json --by align", "--by: align cannot be given"),
    (2, "m2.yaml --by move.json --by move.json", "--by: must be 1, one for each map except"),
    (3, "odd.npz --rule evidence", "odd.npz: log_odds: "),
    (2, "m2.yaml --image o.jpg", "--image: "),
]
REPLACED = [
    "edit circle m.yaml --file shapes.yaml -o shapes.yaml",
    "edit circle m.yaml --file shapes.yaml -o shapes.pgm",
    "edit circle m.yaml --file shapes.yaml -o link.yaml", "cost m.yaml --mask m2.yaml -o m2.yaml",
    "cost pair.yaml -o c.npz --curve pair.png",
    "cost m.yaml --params-file made/nav2.yaml -o made/nav2.yaml", "merge m.yaml m2.yaml -o m.yaml",
    "merge m.yaml m2.yaml -o m2.pgm", "route m.yaml --pairs p.jsonl -o p.jsonl",
]  # fmt: skip
TWICE = (
    "diff - -", "info - -", "query - --points -", "route - --pairs -", "cost - --mask - -o o.npz",
)  # fmt: skip
ROWS = [
    # one map
    ("inflate", "missing argument"), ("inflate m.yaml", "missing option"),
    ("inflate m.yaml -o o.yaml --radius wide", "'--radius': 'wide' is not a valid float"),
    ("inflate m.yaml -o o.yaml --nothing", "no such option"),
    ("inflate m.yaml -o o.txt", "must end in"),
    ("inflate m.yaml -o o.yaml --radius 1 --robot-radius 1", "--radius: cannot be given together"),
    ("inflate m.yaml -o o.yaml --footprint-padding 0.1", "--footprint-padding"),
    ("inflate m.yaml -o o.yaml -q -v", "--verbose: cannot be given together"),
    ("cost m.yaml -o o.yaml --model rings --encoding costmap2d", "costmap2d"),
    ("cost m.yaml -o o.npz --circumscribed-radius 0.3", "no such option"),
    ("cost m.yaml -o o.npz --robot-16-gon", "--robot-radius"),
    ("cost m.yaml -o o.npz --costmap local", "error: --costmap: needs --params-file\n"),
    ("cost m.yaml -o o.npz --namespace robot1", "error: --namespace: needs --params-file\n"),
    ("cost m.yaml -o o.npz --curve -", "--curve: a picture must end in .png, got '-'"),
    ("cost m.yaml -o o.npz --image a.png --curve a.png", "--curve: is an output already"),
    (4, "cost m.yaml -o o.npz --curve pair.png", "pair.png: the output exists"),
    ("cost m.yaml -o - --json", "--json: cannot be given together with -o -"),
    ("edit circle m.yaml -o o.npz --point 1,2 --radius 1", "error: --value: is needed to draw"),
    ("edit circle m.yaml -o o.npz --background -1 --point 1,2 --radius 1 --value 9", "--blank"),
    ("rotate field.npz -o o.npz --yaw 1", "hint: edit the map, then run esdf or potential"),
    ("rotate field.npz -o o.npz --straighten", "grid: must be a map or a costmap"),
    ("rescale field.npz -o o.npz --resolution=1", "must be a map or a costmap, got 'DistanceF"),
    ("clean cost.npz -o o.npz", "cost.npz: clean: takes a map with free, occupied and unknown"),
    ("clean m.yaml -o - --json", "--json: cannot be given together with -o -"),
    ("build none.log -o o.npz --method counting --as-written", "does not apply to method counting"),
    ("cost m.yaml -o c.npz --recipe only.yaml", "has no stage cost"),
    ("cost m.yaml -o c.npz --recipe nav2 --inflation-radius -1", "--inflation-radius: must be"),
    ("info bare.pgm --origin 1,2,3", "--origin: needs --resolution"),
    ("lint bare.pgm --fix --in-place --resolution 0.25", "an image alone"),
    ("window m.yaml -o x.npz", "--size"),
    ("window m.yaml -o x.npz --size 1,1", "--at, --corner"),
    ("run m.yaml -o out --recipe only.yaml --mask m2.yaml", "makes no costs"),
    ("query m.yaml --at 1,1 --mask m2.yaml", "applies to costs of a robot"),
    (4, "route m.yaml --from 1,1 --to 2,2 --mask none.npz", "cannot be read"),
    # many
    ("run m.yaml -o out --image-max -1", "--image-max"),
    ("run nothing/*.yaml -o out", "matches no"),
    ("run m.yaml sub/m.yaml -o out", "would write into out/m, as m.yaml does"),
    ("run sub m.yaml -o out", "would write into out/m"),
    (4, "run @none.txt -o out", "cannot be read"), ("run . -o out --jobs 0", "--jobs"),
    ("run m.yaml -o out --scheduler localhost", "must be tcp://HOST:PORT"),
    (4, "report sub/empty -o ok.html", "contains no run"),
    (4, "report none -o ok.html", "No such file or directory"),
    (4, "report m.yaml -o page.html", "exists"),
    ("report m.yaml -o move.json --force", "must end in .html"),
    (3, "report cloud.pcd -o ok.html", "a point cloud"),
    (3, "report m.pgm -o ok.html", "an image"), ("report -o ok.html", "missing argument"),
    # lint of parameters
    ("lint", "needs a MAP, or --params-file"),
    ("lint m.yaml --costmap local", "--costmap: needs --params-file"),
    ("lint m.yaml --namespace a", "--namespace: needs --params-file"),
    ("lint --params-file only.yaml --fix --in-place", "together with --fix"),
    # around a robot
    ("run m.yaml -o out --cloud c.csv", "--cloud: needs --pose"),
    ("run m.yaml -o out --cloud=", "--cloud: needs --pose"),
    ("run m.yaml -o out --frame map", "--frame: needs --pose"),
    ("run m.yaml -o out --local-recipe local", "--local-recipe: needs --pose"),
    ("run m.yaml -o out --pose 0,0", "--pose: must be 3 numbers"),
    ("run m2.yaml m.yaml -o out --pose 0,0,0", "--pose: takes one map, there are 2"),
    (f"{AROUND} --frame map", "--frame: needs --cloud"),
    (f"{AROUND} --local-recipe=", "--local-recipe: must not be empty"),
    (f"{AROUND} --scheduler tcp://h:1", "--pose: cannot be given together with --scheduler"),
    ("local --pose 0,0,0 -o out", "--cloud: a cloud or --map is required"),
    *((f"local --map m.yaml --pose 0,0,0 -o out {option}", f"{option.split()[0]}: applies to c")
      for option in ("--min-height 0.1", "--frame map", "--require-points")),
    ("local --cloud c.csv --pose 0,0,0 -o out --keep 3", "--keep: applies to a sequence: it needs"),
    *((f"local --cloud c.csv --poses p.txt -o out --keep={n}", "must be a number of clouds, at l")
      for n in ("0", "-1", "some", "1.5", "", "99999999999", "٣")),
    # what holds no values of cells
    ("edit circle --point 1,2 --radius 1 --value 1 potential.npz -o o.npz", "field"),
    ("window --at 1,2 --size 0.1,0.1 potential.npz -o o.npz", "field"),
    ("convert --encoding amcl potential.npz -o o.npz", "field"),
    ("shift --origin 1,2 potential.npz -o o.npz", "must be a map or a costmap"),
    # distances and costs at points
    ("query m.yaml --at 1.6 -1.9", "X,Y, without a space"),
    (f"{POSES} --at 1,2", "--at: must be three numbers X,Y,YAW, got '1,2'"),
    (POSES, "--at, --poses: one of the two is required"),
    (f"{POSES} --points p.csv", "--points: is for points; poses of a footprint are given by --p"),
    (f"{POSES} --at 1,2,3 --robot-radius 1", "cannot be given together with --robot-radius"),
    (f"{POSES} --at 1,2,3 --rule inside", "--rule: must be one of outline, full"),
    ("query m.yaml --footprint 5 --at 1,2,3", "must look like [[x1, y1], [x2, y2], ...]"),
    ("query m.yaml --at 1,2,3", "--at: must be two numbers X,Y, got '1,2,3'"),
    ("query m.yaml --at 1,2,3", "--footprint or --robot-radius"),
    ("query m.yaml --poses p.txt", "--poses: needs --footprint, --robot-radius or --params-file"),
    ("query m.yaml --at 1,2 --rule full", "--rule: needs --footprint, --robot-radius or --params"),
    ("query m.yaml --at 1,2 --footprint-padding 1", "--footprint-padding: needs --footprint"),
    (f"query field.npz {ROBOT} --at 1,2,0", "field.npz: is a distance field"),
    (f"query field.npz {ROBOT} --at 1,2,0", "mapdeal cost"),
    (f"query rings.npz {ROBOT} --at 1,2,0", "--model exponential"),
    (f"query steps.npz {ROBOT} --at 1,2,0", "costs on the occupancy scale"),
    # routes
    ("route m.yaml --from 1 2 --to 3,4", "X,Y, without a space"),
    ("route m.yaml --from 1,1", "--from, --to: both are required, unless pairs are given"),
    ("route m.yaml --pairs p.csv --from 1,1", "--from: applies to one route"),
    ("route m.yaml --pairs p.csv --heuristic field", "--heuristic: applies to one route"),
    ("route m.yaml --pairs p.csv --image o.png", "--image: applies to one route"),
    ("route m.yaml --pairs p.csv --compare plain,fast", "must be some of plain, cost, heuristic"),
    ("route m.yaml --pairs p.csv -o o.json", "--output: must end in .jsonl"),
    ("route m.yaml --pairs p.csv --compare plain --field-weight 1", "--field-weight: needs cost"),
    ("route m.yaml --pairs p.csv --compare cost --heuristic-weight 1", "needs heuristic among"),
    (f"{WEIGHTS} --compare plain", "--compare: applies to pairs alone"),
    (f"{WEIGHTS} --heuristic-weight 1", "--heuristic-weight: applies to heuristic field alone"),
    (f"{WEIGHTS} --method descent --heuristic field", "does not apply to method descent"),
    *((f"route m.yaml --from 1,1 --to {xy}", f"--to: must be finite, got '{xy}'")
      for xy in ("nan,1", "1,inf", "1e400,1")),
    ("run m.yaml -o o --from 1,1 --to a=1,-inf", "--to: must be finite, got '1,-inf'"),
    # what can be reached
    ("reach m.yaml --from 1", "--from: must be two numbers X,Y, got '1'"),
    ("reach m.yaml --from 1,2,3,4", "--from: must be three numbers X,Y,YAW, got '1,2,3,4'"),
    ("reach m.yaml --to kitchen=1", "--to"),
    ("reach m.yaml --to kitchen=1,2,lab=3,4", "--to: must be [NAME=]X,Y"),  # one goal
    ("reach m.yaml -o out.txt", "must end in .json"),
    ("reach m.yaml --layers out.json", "must end in .npz"),
    ("reach m.yaml --robot-radius 1001", "radius must be a finite number of metres above 0, 1000"),
    (4, "reach m.yaml --points none.csv", "none.csv"),
    ("graph m.yaml --robot-radius 0.2 -o g.json", "must end in .geojson"),
    ("graph m.yaml --spacing 0.3 -o g.geojson", "spacing: must be at least four cells, 0.4 m"),
    (3, "graph m.yaml --robot-radius 9 -o g.geojson", "no cell is open"),
    # masks of filters
    ("mask m.yaml -o f", "missing option '--file'"),
    (f"{MASK} --kind other", "must be one of keepout, speed, binary"),
    (f"{MASK} --kind binary --base 1", "--base: applies to speed zones"),
    (f"{MASK} --kind speed --to 1,2", "--to: applies to keepout zones"),
    (f"{MASK} --multiplier 0", "other than 0"), (f"{MASK} --from 99,99", "start"),
    (3, "mask m.yaml -o f --file m2.yaml", "not a file of zones"),
    (4, "mask m.yaml -o f --file none.geojson", "none.geojson"),
    # two maps
    (f"{SCORE} --min coverge=1", "--min: is not a figure of a score, got 'coverge'\nhint: did"),
    (f"{SCORE} --min coverage", "--min: must be NAME=VALUE, with a number, got 'coverage'"),
    (f"{SCORE} --max coverage=1 --max coverage=2", "error: --max: coverage is given twice"),
    (f"{SCORE} --min corners=1", "omit --truth"),
    (f"{SCORE} --align --transform move.json", "error: --align: cannot be given together"),
    ("score m.yaml --align", "error: --align: needs --truth"),
    ("score m.yaml --transform move.json", "error: --transform: needs --truth"),
    ("score m.yaml --image a.png", "error: --image: needs --truth"),
    ("align m.yaml m2.yaml --prior 1,2", "--prior: must be a transform, or three numbers"),
    ("align m.yaml m2.yaml --rotation north", "--rotation: must be degrees such as 0,90,180,270"),
    ("merge m.yaml -o o.yaml", "maps: takes two maps or more, got 1"),
    *((code, f"merge m.yaml {words} -o o.npz", message) for code, words, message in MERGES),
    # outputs that are inputs
    *((4, f"{line} --force", "the output is the input") for line in REPLACED),
    (4, "run m.yaml -o made --params-file made/m/nav2.yaml", "where the outputs go"),
    (4, "run m.yaml -o made --pose 0,0,0 --cloud made/m/local/c.csv", "lies in made/m/local"),
    # standard input and output
    *((line, "-: can be used for one input only: standard input is one file") for line in TWICE),
    ("run - -o out", "-: standard input has no name for a folder of outputs"),
    ("lint - --fix --in-place", "-: is standard input, which cannot be repaired in place"),
    ("pack m.yaml -o -", "-: a bit map must end in .pbm, got ''"),  # two files
    # methods compared
    (f"{COMPARED} --method tsdf", "--method: cannot be given together with --compare"),
    (f"{COMPARED} --values", "--values: cannot be given together with --compare"),
    (f"{COMPARED} --layers l.npz", "--layers: cannot be given together with --compare"),
    (f"{COMPARED} --image l.png", "--image: cannot be given together with --compare"),
]  # fmt: skip


TEXTS = {
    "p.csv": "1,1,5,1\n", "p.txt": "0 0 0\n", "c.csv": "1,1\n",
    "move.json": '{"x": 10, "y": -4, "yaw": 0}', "bad.json": '{"x": 1}',
    "only.yaml": "stages: [{inflate: {radius: 0.1}}]",
    "page.html": "mine", "p.jsonl": "1,1,5,1\n",
    "shapes.yaml": "shapes:\n- {type: circle, center: [2, 1], radius: 0.1, value: 100}\n",
    "made/m/local/c.csv": "1,1\n", "made/nav2.yaml": NAV2, "made/m/nav2.yaml": NAV2,
    "cloud.pcd": "VERSION .7\nFIELDS x y z\n",
}  # fmt: skip


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with a map that holds 1,1 to 5,1, costs and fields of it, and other inputs."""
    folder = tmp_path_factory.mktemp("refused")
    room = OccupancyGrid(np.zeros((50, 70), np.int8), 0.1, (0.0, -2.5, 0.0))
    for name in ("m.yaml", "m2.yaml", "sub/m.yaml", "pair.png"):
        write(folder / name, room)
    small = grid_from_text("..#..\n.....", 0.1)
    field = mapdeal.esdf(small)
    write(folder / "field.npz", field)
    write(folder / "rings.npz", mapdeal.ring_cost(small))
    write(folder / "steps.npz", mapdeal.threshold_cost(field))
    write(folder / "potential.npz", mapdeal.potential(field))
    write(folder / "cost.npz", mapdeal.exponential_cost(small))
    write(folder / "far.yaml", grid_from_text("..#", 0.1, (1e7, 0.0, 0.0)))
    with (folder / "odd.npz").open("wb") as file:
        write_npz(file, room, more={"log_odds": np.zeros((2, 2))})
    shutil.copy(folder / "m.pgm", folder / "bare.pgm")
    (folder / "link.yaml").symlink_to("shapes.yaml")
    for name in ("sub/empty", "made/m/local"):
        (folder / name).mkdir(parents=True)
    for name, text in TEXTS.items():
        (folder / name).write_text(text)
    return folder, tree(folder)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[-2])
def test_it_is_refused_by_name_and_nothing_is_written(command, place, monkeypatch, row):
    code, line, message = row if len(row) == 3 else (2, *row)
    folder, before = place
    monkeypatch.chdir(folder)
    found, out, err = command(*line.split())
    assert (found, out) == (code, "")
    assert message in err
    lines = [text for text in err.splitlines() if not text.startswith("warning: ")]
    assert [text.split(": ")[0] for text in lines] in (["error"], ["error", "hint"])
    assert tree(folder) == before
