"""What commands refuse: a line and an exit code each, and nothing is written."""

import json

import numpy as np
import pytest

from drawn import grid_from_text
from mapdeal import OccupancyGrid, esdf, exponential_cost, potential, ring_cost, threshold_cost
from mapdeal import write_map as write

ROBOT = "--footprint [[0.12,0.06],[0.12,-0.06],[-0.12,-0.06],[-0.12,0.06]]"
POSES = f"query m.yaml {ROBOT}"
WEIGHTS = "route m.yaml --from 1,1 --to 5,1"
AROUND = "run m.yaml -o out --pose 0,0,0"
SCORE = "score none.yaml --truth none.yaml"
COMPARED = "build none.npz --compare -o out"

ROWS = [
    # one map
    ("inflate", "missing argument"),
    ("inflate m.yaml", "missing option"),
    ("inflate m.yaml -o o.yaml --radius wide", "'--radius': 'wide' is not a valid float"),
    ("inflate m.yaml -o o.yaml --radius nan", "radius: must be"),
    ("inflate m.yaml -o o.yaml --nothing", "no such option"),
    ("inflate m.yaml -o o.txt", "must end in"),
    ("inflate m.yaml -o o.yaml --radius 1 --robot-radius 1", "--radius: cannot be given together"),
    ("inflate m.yaml -o o.yaml --footprint-padding 0.1", "--footprint-padding"),
    ("inflate m.yaml -o o.yaml -q -v", "--verbose: cannot be given together"),
    ("cost m.yaml -o o.yaml --model rings --down 3", "down"),
    ("cost m.yaml -o o.yaml --model rings --encoding costmap2d", "costmap2d"),
    ("cost m.yaml -o o.npz --circumscribed-radius 0.3", "no such option"),
    ("cost m.yaml -o o.npz --robot-16-gon", "--robot-radius"),
    ("cost m.yaml -o o.npz --costmap local", "error: --costmap: needs --params-file\n"),
    ("cost m.yaml -o o.npz --namespace robot1", "error: --namespace: needs --params-file\n"),
    ("cost m.yaml -o o.npz --curve -", "--curve: a picture must end in .png, got '-'"),
    ("cost m.yaml -o o.npz --image a.png --curve a.png", "--curve: is an output already"),
    ("cost m.yaml -o - --json", "--json: cannot be given together with -o -"),
    ("edit circle m.yaml -o o.npz --point 1,2 --radius 1", "error: --value: is needed to draw"),
    ("edit circle m.yaml -o o.npz --background -1 --point 1,2 --radius 1 --value 9", "--blank"),
    ("rotate field.npz -o o.npz --yaw 1", "hint: edit the map, then run esdf or potential"),
    ("rotate field.npz -o o.npz --straighten", "grid: must be a map or a costmap"),
    ("rescale field.npz -o o.npz --resolution=1", "must be a map or a costmap, got 'DistanceF"),
    ("clean cost.npz -o o.npz", "cost.npz: clean: takes a map with free, occupied and unknown"),
    ("clean m.yaml -o - --json", "--json: cannot be given together with -o -"),
    ("clean m.yaml -o o.npz --min-hole -1", "--min-hole: must be a whole number, at least 0"),
    ("build none.log -o o.npz --method counting --as-written", "does not apply to method counting"),
    # many
    ("run m.yaml -o out --set inflate.radius", "--set"),
    ("run m.yaml -o out --image-max -1", "--image-max"),
    ("run nothing/*.yaml -o out", "matches no"),
    ("run m.yaml sub/m.yaml -o out", "would write into out/m, as m.yaml does"),
    ("run sub m.yaml -o out", "would write into out/m"),
    (4, "run @none.txt -o out", "cannot be read"),
    ("run . -o out --jobs 0", "--jobs"),
    ("run . -o out --jobs auto", "--jobs"),
    ("run . -o out --scheduler localhost", "must be tcp://HOST:PORT"),
    # around a robot
    ("run m.yaml -o out --cloud c.csv", "--cloud: needs --pose"),
    ("run m.yaml -o out --cloud=", "--cloud: needs --pose"),
    ("run m.yaml -o out --frame map", "--frame: needs --pose"),
    ("run m.yaml -o out --local-recipe local", "--local-recipe: needs --pose"),
    ("run m.yaml -o out --local-set inflate.radius=1", "--local-set: needs --pose"),
    ("run m.yaml -o out --pose 0,0", "--pose: must be 3 numbers"),
    ("run m2.yaml m.yaml -o out --pose 0,0,0", "--pose: takes one map, there are 2"),
    (f"{AROUND} --frame map", "--frame: needs --cloud"),
    (f"{AROUND} --local-set local.min_range=1", "--local-set: needs --cloud"),
    (f"{AROUND} --local-set local.sise=1,1", "no such option, got 'sise'"),
    (f"{AROUND} --local-set local.size=1", "--local-set local.size: must be 2"),
    (f"{AROUND} --local-set local.size", "must look like stage.parameter=value"),
    (f"{AROUND} --local-set local.resolution=x", "local.resolution: must be a finite number"),
    (f"{AROUND} --local-set local.unknown=all", "unknown: must be one of keep, free"),
    (f"{AROUND} --local-set inflate.radios=1", "radios"),
    (f"{AROUND} --local-set size=3,2", "error: --local-set: must look like stage.parameter"),
    (f"{AROUND} --local-set activ.margin=1", "error: --local-set: no such stage"),
    (f"{AROUND} --local-set active.margin=1", "--local-set: recipe local has no stage"),
    (f"{AROUND} --set local.size=3,2", "hint: with --pose, --local-set takes what the"),
    (f"{AROUND} --local-recipe=", "--local-recipe: must not be empty"),
    (f"{AROUND} --local-recipe nowhere", "nowhere"),
    (f"{AROUND} --scheduler tcp://h:1", "--pose: cannot be given together with --scheduler"),
    ("local --pose 0,0,0 -o out", "--cloud: a cloud or --map is required"),
    *(
        (f"local --map m.yaml --pose 0,0,0 -o out {option}", f"{option.split()[0]}: applies to c")
        for option in ("--min-height 0.1", "--frame map", "--require-points")
    ),
    ("local --cloud c.csv --pose 0,0,0 -o out --keep 3", "--keep: applies to a sequence: it needs"),
    *(
        (f"local --cloud c.csv --poses p.txt -o out --keep={n}", "must be a number of clouds, at l")
        for n in ("0", "-1", "some", "1.5", "", "99999999999", "٣")
    ),
    # what holds no values of cells
    ("edit circle --point 1,2 --radius 1 --value 1 potential.npz -o o.npz", "field"),
    ("window --at 1,2 --size 0.1,0.1 potential.npz -o o.npz", "field"),
    ("convert --encoding amcl potential.npz -o o.npz", "field"),
    ("shift --origin 1,2 potential.npz -o o.npz", "must be a map or a costmap"),
    # distances and costs at points
    ("query m.yaml --at 1.6 -1.9", "X,Y, without a space"),
    (f"{POSES} --at 1,2", "--at: must be three numbers X,Y,YAW, got '1,2'"),
    (POSES, "--at, --poses: one of the two is required"),
    (f"{POSES} --points p.csv", "--points: has no yaws; poses of a footprint are given by --poses"),
    (f"{POSES} --at 1,2,3 --convention border", "--convention: applies to distances"),
    (f"{POSES} --at 1,2,3 --robot-radius 1", "cannot be given together with --robot-radius"),
    (f"{POSES} --at 1,2,3 --unknown maybe", "unknown: must be one of free, occupied, got 'maybe'"),
    (f"{POSES} --at 1,2,3 --lethal-threshold 0", "--lethal-threshold: must be a whole number"),
    (f"{POSES} --at 1,2,3 --rule inside", "--rule: must be one of outline, full"),
    ("query m.yaml --footprint [[0,0],[1,1]] --at 1,2,3", "needs at least three vertices, got 2"),
    ("query m.yaml --footprint [[-1,0],[1,1],[1,0],[0,1]] --at 1,2,3", "the edge crosses"),
    ("query m.yaml --footprint 5 --at 1,2,3", "must look like [[x1, y1], [x2, y2], ...]"),
    ("query m.yaml --robot-radius 0 --at 1,2,3", "robot radius must be"),
    ("query m.yaml --at 1,2,3", "--at: must be two numbers X,Y, got '1,2,3'"),
    ("query m.yaml --at 1,2,3", "--footprint or --robot-radius"),
    ("query m.yaml --poses p.txt", "--poses: needs --footprint, --robot-radius or --params-file"),
    ("query m.yaml --at 1,2 --rule full", "--rule: needs --footprint, --robot-radius or --params"),
    ("query m.yaml --at 1,2 --footprint-padding 1", "--footprint-padding: needs --footprint"),
    (f"query cost.npz {ROBOT} --at 1,2,0 --unknown free", "--unknown: applies to maps: these cos"),
    (f"query cost.npz {ROBOT} --at 1,2,0 --lethal-threshold 50", "old: applies to maps: these cos"),
    (f"query field.npz {ROBOT} --at 1,2,0", "field.npz: is a distance field"),
    (f"query field.npz {ROBOT} --at 1,2,0", "mapdeal cost"),
    (f"query rings.npz {ROBOT} --at 1,2,0", "--model exponential"),
    (f"query steps.npz {ROBOT} --at 1,2,0", "costs on the occupancy scale"),
    # routes
    ("route m.yaml --from 1 2 --to 3,4", "X,Y, without a space"),
    ("route m.yaml --from 1,1", "--from, --to: both are required, unless pairs are given"),
    ("route m.yaml --pairs p.csv --from 1,1", "--from: applies to one route"),
    ("route m.yaml --pairs p.csv --heuristic field", "--heuristic: applies to one route"),
    ("route m.yaml --pairs p.csv --repulsive-gain 2", "--repulsive-gain: applies to one route"),
    ("route m.yaml --pairs p.csv --method descent", "--pairs: compares routes of method astar"),
    ("route m.yaml --pairs p.csv --image o.png", "--image: applies to one route"),
    ("route m.yaml --pairs p.csv --compare plain,fast", "must be some of plain, cost, heuristic"),
    ("route m.yaml --pairs p.csv --compare=", "--compare: must be some of"),
    ("route m.yaml --pairs p.csv -o o.json", "--output: must end in .jsonl"),
    ("route m.yaml --pairs p.csv --heuristic-weight -1", "heuristic_weight: must lie between"),
    ("route m.yaml --pairs p.csv --field-weight nan", "--field-weight: must be a finite number"),
    ("route m.yaml --pairs p.csv --compare plain --field-weight 1", "--field-weight: needs cost"),
    ("route m.yaml --pairs p.csv --compare cost --heuristic-weight 1", "needs heuristic among"),
    (f"{WEIGHTS} --compare plain", "--compare: applies to pairs alone"),
    (f"{WEIGHTS} --heuristic-weight 1", "--heuristic-weight: applies to heuristic field alone"),
    (f"{WEIGHTS} --heuristic octile --heuristic-weight 1", "to heuristic field alone"),
    (f"{WEIGHTS} --heuristic field --heuristic-weight inf", "must be a finite number"),
    (f"{WEIGHTS} --method descent --heuristic field", "does not apply to method descent"),
    (f"{WEIGHTS} --method descent --heuristic-weight 1", "does not apply to method desce"),
    # what can be reached
    ("reach m.yaml --from 50,50", "start: lies outside of the map"),
    ("reach m.yaml --headings 3", "headings"),
    ("reach m.yaml --from 1", "--from: must be two numbers X,Y, got '1'"),
    ("reach m.yaml --from 1,2,", "--from: must be three numbers X,Y,YAW, got '1,2,'"),
    ("reach m.yaml --from 1,2,3,4", "--from: must be three numbers X,Y,YAW, got '1,2,3,4'"),
    ("reach m.yaml --to kitchen=1", "--to"),
    ("reach m.yaml --to kitchen=1,2,lab=3,4", "--to: must be [NAME=]X,Y"),  # one goal
    ("reach m.yaml -o out.txt", "must end in .json"),
    ("reach m.yaml --layers out.json", "must end in .npz"),
    ("reach m.yaml --robot-radius -1", "radius"),
    ("reach m.yaml --robot-radius 1001", "radius must be a finite number of metres above 0, 1000"),
    (4, "reach m.yaml --points none.csv", "none.csv"),
    # two maps
    (f"{SCORE} --min coverge=1", "--min: is not a figure of a score, got 'coverge'\nhint: did"),
    (f"{SCORE} --min coverage", "--min: must be NAME=VALUE, with a number, got 'coverage'"),
    (f"{SCORE} --max coverage=x", "--max: must be NAME=VALUE, with a number, got 'coverage=x'"),
    (f"{SCORE} --max coverage=nan", "must be a"),
    (f"{SCORE} --max coverage=1 --max coverage=2", "error: --max: coverage is given twice"),
    (f"{SCORE} --min corners=1", "leave --truth out"),
    (f"{SCORE} --align --transform move.json", "error: --align: cannot be given together"),
    ("score m.yaml --align", "error: --align: needs --truth"),
    ("score m.yaml --transform move.json", "error: --transform: needs --truth"),
    ("score m.yaml --image a.png", "error: --image: needs --truth"),
    ("align m.yaml m2.yaml --prior 1,2", "--prior: must be a transform, or three numbers"),
    ("align m.yaml m2.yaml --prior 1,nan,2", "--prior"),
    ("align m.yaml m2.yaml --rotation north", "--rotation: must be degrees such as 0,90,180,270"),
    ("align m.yaml m2.yaml --rotation=", "--rotation"),
    ("align m.yaml m2.yaml --rotation 0,inf", "--rotation: must be finite"),
    # methods compared
    (f"{COMPARED} --method tsdf", "--method: cannot be given together with --compare"),
    (f"{COMPARED} --values", "--values: cannot be given together with --compare"),
    (f"{COMPARED} --layers l.npz", "--layers: cannot be given together with --compare"),
    (f"{COMPARED} --image l.png", "--image: cannot be given together with --compare"),
    (f"{COMPARED} --ratio 1", "--ratio: must be a finite number, at least 0, below 1"),
    (f"{COMPARED} --truncation-behind 0.1", "--truncation-behind: must be 0.5 to 500 truncations"),
]


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with a map that holds 1,1 to 5,1, costs and fields of it, and other inputs."""
    folder = tmp_path_factory.mktemp("refused")
    room = OccupancyGrid(np.zeros((50, 70), np.int8), 0.1, (0.0, -2.5, 0.0))
    for name in ("m.yaml", "m2.yaml", "sub/m.yaml"):
        write(folder / name, room)
    small = grid_from_text("..#..\n.....", 0.1)
    field = esdf(small)
    made = {"field": field, "rings": ring_cost(small), "steps": threshold_cost(field),
            "potential": potential(field)}  # fmt: skip
    for name, product in {**made, "cost": exponential_cost(small)}.items():
        write(folder / f"{name}.npz", product)
    (folder / "p.csv").write_text("1,1,5,1\n")
    (folder / "p.txt").write_text("0 0 0\n")
    (folder / "c.csv").write_text("1,1\n")
    (folder / "move.json").write_text(json.dumps({"x": 10, "y": -4, "yaw": 0}))
    return folder


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[-2])
def test_it_is_told_and_nothing_is_written(command, place, monkeypatch, row):
    code, line, told = row if len(row) == 3 else (2, *row)
    monkeypatch.chdir(place)
    before = sorted(place.rglob("*"))
    found, out, err = command(*line.split())
    assert (found, out) == (code, "")
    assert told in err
    lines = [one for one in err.splitlines() if not one.startswith("warning: ")]
    assert [one.split(": ")[0] for one in lines] in (["error"], ["error", "hint"])
    assert sorted(place.rglob("*")) == before
