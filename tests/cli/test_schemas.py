"""The schemas of the documents that commands print; the fixture `command` checks each of them."""

import json
import shutil
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

import schemas
from conftest import ROOT, documents_in
from drawn import grid_from_text
from mapdeal import write_map
from mapdeal.stages.catalogue import STAGE_NAMES

NAV2 = "--params-file examples/robots/nav2_params.yaml"
LINES = f"""
edit circle room.yaml -o other.yaml --point 1,3.5 --radius 0.4 --value 100
run room.yaml -o out {NAV2} --from 1,1 --to a=5,2 --report
run room.yaml other.yaml -o two --jobs 1
run room.yaml -o dry --dry-run
active room.yaml -o a.yaml
inflate room.yaml -o i.yaml --footprint [[0.1,0.1],[0.1,-0.1],[-0.1,-0.1],[-0.1,0.1]]
esdf room.yaml -o e.npz
cost room.yaml -o c.npz {NAV2}
cost room.yaml -o layers.npz --model layers
cost room.yaml -o rings.npz --model rings
graph room.yaml -o g.geojson --from 1,1
info room.yaml gone.yaml {NAV2.split()[1]} examples/bags/office.mcap examples/logs/office.log
info e.npz c.npz p.npz out/room
plan room.yaml {NAV2} --from 1,1 --to a=5,2 99,9
plan room.yaml {NAV2} --pairs pairs.csv
query room.yaml --at 1,1 100,1
query room.yaml --at 1,1,1 --robot-radius 0.1
reach room.yaml --from 1,1 --to a=5,2 99,9 {NAV2}
route room.yaml --from 1,1 --to 5,2 --method descent
route room.yaml --pairs pairs.csv
view room.yaml --no-browser
potential room.yaml -o p.npz --goal 5,2
mask room.yaml -o masks --file zones.geojson
clean room.yaml -o clean.yaml
window room.yaml -o w.yaml --at 2,1 --size 1,1
shift room.yaml -o s.yaml --origin 0.1,0.1
rotate room.yaml -o r.yaml --yaw 0.3
rescale room.yaml -o coarse.yaml --resolution 1
align room.yaml other.yaml
diff room.yaml other.yaml --max-shift 0.1
diff c.npz c.npz
diff room.yaml {NAV2} --against {NAV2.split()[1]} --against examples/robots/nav2_wider.yaml
merge room.yaml other.yaml -o m.yaml
score room.yaml --truth other.yaml --min coverage=0.9
build examples/logs/office.log -o built.yaml
build examples/logs/office.log -o methods --compare --resolution 0.2
build --cloud examples/clouds/ramp.pcd -o ramp.yaml
build --world examples/worlds/storage.sdf -o world.yaml --height 0.2 --resolution 0.2
local --cloud examples/clouds/corridor2.pcd --pose -1,0.35,0.3 --size 4,4 -o local
scan room.yaml --poses poses.txt -o scans.npz
convert room.yaml -o copy.npz
convert room.yaml -o room.geojson
convert room.yaml -o room.sdf
pack room.yaml -o bits.pbm
unpack bits.pbm -o unpacked.yaml
lint room.yaml {NAV2}
lint room.yaml --statistics
lint --explain map.islands
report out/room room.yaml -o r.html
"""
"""All commands; later lines read what earlier ones have written."""


@pytest.fixture
def printed(sh, here):
    """Documents of all lines, with the names of the commands."""
    shutil.copytree(ROOT / "examples", here / "examples")
    drawing = "\n".join(["............", "............", ".....#......"] + 5 * ["............"])
    write_map("room.yaml", grid_from_text(drawing, 0.5, (0.0, 0.0, 0.0)))
    Path("pairs.csv").write_text("1,1,0,5,2,0\n1,1,0,99,9,0\n")
    Path("poses.txt").write_text("1 1 0\n2 1 0\n")
    corners = [[1, 1], [3, 1], [3, 3], [1, 1]]
    zone = {"type": "Feature", "properties": {"kind": "speed", "speed": 50},
            "geometry": {"type": "Polygon", "coordinates": [corners]}}  # fmt: skip
    Path("zones.geojson").write_text(json.dumps(zone))
    documents = []
    for line in LINES.strip().splitlines():
        code, out, err = sh(f"{line} --json")
        assert code in (0, 1, 5), (line, err)
        documents += [(line.split()[0], document) for document in documents_in(out)]
    documents += [("manifest", json.loads(Path("out/room/manifest.json").read_text()))]
    return documents


WRONG = {
    "reach": ("goals.0.reachable", "yes"), "plan": ("goals.1.reason", "Lost"),
    "lint": ("maps.0.findings.0.severity", "fatal"), "report": ("entries.0.claims.0.state", "fine"),
    "run": ("maps.0.figures.cost.width", 1.5), "esdf": ("parameters.convention", "inside"),
    "align": ("transform.yaw", None), "diff": ("walls.first_to_second.meanest", 0.1),
    "route": ("start", [1.0, 1.0]), "manifest": ("outputs.esdf~npz", "ab12"),
}  # fmt: skip
"""By command, a place in its first document, and a value that must not be there."""


def is_valid(name, document):
    return Draft202012Validator(schemas.DOCUMENTS[name]).is_valid(document)


def test_every_document_follows_its_schema_and_no_key_may_change(printed):
    assert {name for name, _ in printed} >= {*schemas.DOCUMENTS} - {*STAGE_NAMES, "routes"}
    for name, document in printed:
        assert is_valid(name, document), (name, document)
        for key, value in document.items():
            rest = {k: v for k, v in document.items() if k != key}
            is_optional = name == "info" and is_valid(name, rest)  # keys of formats of maps
            assert is_optional or not is_valid(name, {**rest, f"{key}_": value}), (name, key)
    first = dict(reversed(printed))
    for name, (place, value) in WRONG.items():
        *above, last = (part.replace("~", ".") for part in place.split("."))
        part = first[name]
        for key in above:
            part = part[int(key) if key.isdigit() else key]
        part[last] = value
        assert not is_valid(name, first[name]), (name, place)
