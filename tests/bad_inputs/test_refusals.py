"""Words and files that cannot be: an exit code, one line that says why, and nothing written."""

import os
import shlex
from pathlib import Path

import numpy as np
import pytest

from bad_maps import PGM, write_map as write_pair, yaml_text
from mapdeal import Costmap, esdf, read_map, write_map

LOG = f"FLASER 180 {'2.0 ' * 180}1 2 0.5 0 0 0 7 host 7\n"
SHAPE = "shapes:\n- {{type: circle, center: [1.5, -2], {}}}\n"
FILES = {
    **dict.fromkeys(["c.xyz", "d.xyz", "out.d/0001/e.xyz"], "1 0 0\n0 1 0\n"),
    "flat.xyz": "1 2\n", "nan.xyz": "nan 1 2\n1 inf 2\n",
    "one.txt": "0 0 0\n", "three.txt": "0 0 0\n" * 3,
    **dict.fromkeys(["two.txt", "out.d/summary.json"], "0 0 0\n0 0 0\n"),
    "a.log": LOG, "nan.log": LOG.replace("2.0", "nan"),
    "z.yaml": SHAPE.format("radius: 1"),
    "z254.yaml": SHAPE.format("radius: 1, value: 254"),
    "zout.yaml": SHAPE.format("radius: 1, value: 1").replace("1.5", "99"),
    "p.yaml": yaml_text(image="p.png"), "summary.json.yaml": yaml_text(),
    "wrong.yaml": "stages: [{inflat: {radius: 0.3}}]\n",
    "broken.yaml": yaml_text(image="broken.pgm"),
}  # fmt: skip

LOCAL = "local -o out --no-images --size 4,4 --cloud c.xyz "
POSE = LOCAL + "--pose 0,0,0 "
NEEDED = "local -o out --no-images --size 4,4 --pose 0,0,0 --require-points --cloud "
POSES = LOCAL + "--cloud d.xyz --poses "
BUILD = "build a.log -o out.yaml "
INFLATE = "inflate m.yaml -o o.npz "
RUN = "run m.yaml -o out "
CONVERT = "convert m.yaml -o o.npz "
ENCODE = CONVERT + "--encoding costmap2d --static-layer "
TRIANGLE = " m.yaml -o o.npz --point 1.5,-2.0 --point 1.6,-2.0 --point 1.5,-1.9 "
POLYGON = "edit polygon" + TRIANGLE
CIRCLE = "edit circle" + TRIANGLE
OF_FILE = "edit circle m.yaml -o o.npz --file "
WINDOW = "window m.yaml -o o.npz "
ROTATE = "rotate m.yaml -o o.npz "
RESCALE = "rescale m.yaml -o o.npz "
ROUTE = "route c.npz --from 1.51,-1.98 --to 1.51,-1.98 "

REFUSED = [
    # clouds and poses
    (NEEDED + "nan.xyz", 3, "2 are not finite"),
    (POSE.replace("c.xyz", "flat.xyz") + "--max-height 1", 2, "flat.xyz"),
    (POSE.replace("c.xyz", "pipe"), 4, "regular"),
    (LOCAL, 2, "--pose"),
    (POSE + "--poses two.txt", 2, "--pose"),
    (POSE + "--cloud d.xyz", 2, "--pose", "--poses"),
    (POSES + "one.txt", 3, "for each of 2"),
    (POSES + "out.d/summary.json -o out.d --force", 4, "out.d/summary.json"),
    (POSES + "three.txt --cloud out.d/0001/e.xyz -o out.d --force", 4, "out.d/0001/e.xyz"),
    (POSE + "--min-range 2 --max-range 1", 2, "--min-range"),
    (POSE + "--offset 1", 2, "--offset"),
    (POSE + "d.xyz", 2, "--cloud"),
    (POSE + "-o m.yaml", 4, "m.yaml"),
    # laser scans
    ("build -o out.yaml", 2, "LOG"),
    (BUILD + "--poses a.log", 2, "--poses"),
    (BUILD + "--flip-y", 2, "--flip-y"),
    ("build --poses a.log -o out.yaml", 2, "--angles"),
    ("build nan.log -o out.yaml", 3, "no beam hits"),
    (BUILD + "--log-min 80 --log-max 20", 2, "--log-min"),
    (BUILD + "--method tsdf --values", 2, "--values"),
    (BUILD + "--origin 5,5", 2, "--origin"),
    (BUILD + "--layers l.yaml", 2, "l.yaml"),
    ("build a.log -o out.txt", 2, "out.txt"),
    ("build a.log -o m.yaml", 4, "m.pgm"),
    ("build a.log -o o.npz --layers o.npz", 2, "o.npz"),
    # parameters
    (INFLATE + f"--footprint '{[[1.0, 2.0]] * 501}'", 2, "500 vertices"),
    ("cost m.yaml -o m.npz --mask m.pgm", 3, "m.pgm"),
    (RUN + "--recipe wrong.yaml", 2, "wrong.yaml:1: "),
    # edits
    ("edit polygon m.yaml -o o.npz --point 1,2,3 --value 1", 2, "--point"),
    ("edit polygon m.yaml -o o.npz --value 100", 2, "--point"),
    (POLYGON + "--value 1.5", 2, "--value"),
    (CIRCLE + "--value 1", 2, "--radius"),
    ("edit line m.yaml -o o.npz --file z.yaml --thickness 1", 2, "--point"),
    (OF_FILE + "z.yaml --radius 1", 2, "--point"),
    (OF_FILE + "z254.yaml", 3, "z254.yaml: shape 1 (line 2)"),
    (OF_FILE + "z.yaml", 2, "--value", "z.yaml: shape 1 (line 2)"),
    (OF_FILE + "zout.yaml --strict", 1, "nothing was written"),
    ("edit circle e.npz -o o.npz --point 1.5,-2 --radius 1 --value 1", 2, "e.npz", "esdf"),
    # windows and encodings
    (WINDOW + "--at 1.5,-2", 2, "--size"),
    (ROTATE, 2, "--straighten"),
    (ROTATE + "--yaw 1 --straighten", 2, "--yaw"),
    (RESCALE, 2, "--resolution"),
    ("pack m.yaml -o o.pgm", 2, ""),
    ("pack m.yaml -o m.pbm --force", 4, ""),
    ("pack e.npz -o o.pbm --lethal-threshold 50", 2, "threshold"),
    ("unpack m.yaml -o o.yaml", 2, ""),
    ("unpack m.pgm -o o.yaml", 2, ""),
    (CONVERT + "--static-layer", 2, ""),
    (CONVERT + "--lethal-threshold 65", 2, ""),
    (ENCODE + "--inscribed-value many", 2, ""),
    # questions
    ("query m.yaml", 2, "--points"),
    ("potential m.yaml -o o.yaml", 2, "o.yaml"),
    ("route m.yaml --to 9,9 --from {wall}", 2, "m.yaml: start"),
    (ROUTE + "--attractive-gain 2", 2, "--attractive-gain"),
    (ROUTE + "--method descent --field-weight 2", 2, "--field-weight"),
    (ROUTE + "-o o.txt", 2, "o.txt"),
    # outputs
    ("esdf m.yaml -o o.npz --image p.png", 4, "p.png", "--force"),
    ("run broken.yaml -o new/deeper", 3, "broken.pgm"),
    ("run summary.json.yaml m.yaml -o out", 2, "summary.json"),
    ("convert m.yaml -o o.png --image sub.npz/../o.png", 2, "two outputs"),
    # empty names are not the working folder
    ("inflate m.yaml --output=", 2, "must not be empty"),
    ("inflate m.yaml -o o.yaml --image ''", 2, "must not be empty"),
]  # fmt: skip


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    """Contents of all files that rows name, and the middle of an occupied cell."""
    folder = tmp_path_factory.mktemp("made")
    write_pair(folder)
    grid = read_map(folder / "m.yaml")
    write_map(folder / "e.npz", esdf(grid))
    write_map(folder / "c.npz", Costmap([[0, 0, 254]], 0.05, grid.origin))
    ((x, y), *_) = grid.frame.xy_from_rowcol(np.argwhere(grid.occupancy == 100))
    found = {name: text.encode() for name, text in FILES.items()}
    found |= {name: (folder / name).read_bytes() for name in ("e.npz", "c.npz")}
    return {**found, "p.png": PGM, "broken.pgm": PGM[:-1]}, f"{x},{y}"


@pytest.mark.parametrize("row", REFUSED, ids=lambda row: row[0][:90])
def test_what_cannot_be_is_refused(folder, inputs, refused, row):
    words, code, message, *hint = row
    files, wall = inputs
    for name, data in files.items():
        if Path(name).stem in words:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(data)
    (folder / "sub.npz").mkdir()
    os.mkfifo(folder / "pipe")
    refused(shlex.split(words.replace("{wall}", wall)), code, message, hint="".join(hint))
