"""Examples at the end of each ``--help``, on the files of ``examples/``."""

from __future__ import annotations

from typing import Final

EXAMPLES: Final = {
    "run": """\
mapdeal run examples/maps/office.yaml -o out
mapdeal run examples/maps -o out/all --recipe nav2 --report
mapdeal run examples/maps/office.yaml -o out/robot \\
    --params-file examples/robots/nav2_params.yaml""",
    "active": "mapdeal active examples/maps/arena.yaml -o out/active.yaml --margin 0.5",
    "inflate": """\
mapdeal inflate examples/maps/office.yaml -o out/inflated.yaml --radius 0.25
mapdeal inflate examples/maps/office.yaml -o out/shape.yaml \\
    --footprint '[[0.3,0.2],[0.3,-0.2],[-0.3,-0.2],[-0.3,0.2]]'""",
    "esdf": """\
mapdeal esdf examples/maps/office.yaml -o out/esdf.npz --image out/esdf.png
mapdeal esdf examples/maps/office.yaml -o out/view.yaml --view-range 1.0""",
    "cost": """\
mapdeal cost examples/maps/office.yaml -o out/cost.yaml --robot-radius 0.22
mapdeal cost examples/maps/office.yaml -o out/robot.npz \\
    --params-file examples/robots/nav2_params.yaml --curve out/curve.png
mapdeal cost examples/maps/office.yaml -o out/rings.npz --model rings""",
    "reach": """\
mapdeal reach examples/maps/office.yaml --from -8,0 --to kitchen=3,-4 lab=9,4 \\
    --robot-radius 0.28 -o out/reach.json --image out/reach.png""",
    "query": """\
mapdeal query examples/maps/office.yaml --at 0.5,0.3 -5,0.3
mapdeal query examples/maps/office.yaml --points examples/points/office.csv
mapdeal query examples/maps/office.yaml --at 0.5,-0.5,1.57 \\
    --params-file examples/robots/nav2_params.yaml""",
    "route": """\
mapdeal route examples/maps/office.yaml --from -7.5,2.5 --to 9,5 \\
    -o out/route.json --image out/route.png
mapdeal route examples/maps/office.yaml \\
    --pairs examples/points/office_pairs.csv -o out/pairs.jsonl""",
    "potential": """\
mapdeal potential examples/maps/office.yaml -o out/potential.npz --goal 9,5 \\
    --attractive-gain 50 --image out/potential.png""",
    "info": """\
mapdeal info examples/maps/office.yaml
mapdeal info examples/robots/nav2_params.yaml --map examples/maps/office.yaml
mapdeal info examples/bags/office.mcap""",
    "align": """\
mapdeal align examples/maps/office_cartographer.yaml examples/maps/office.yaml \\
    -o out/transform.json""",
    "merge": """\
mapdeal merge examples/maps/office.yaml examples/maps/office_cartographer.yaml \\
    --by align -o out/merged.yaml --image out/merged.png""",
    "diff": """\
mapdeal edit line examples/maps/office.yaml -o out/new.yaml \\
    --point 1,-0.8 1.5,-0.8 --value 100
mapdeal diff examples/maps/office.yaml out/new.yaml --tolerance 1""",
    "score": """\
mapdeal score examples/maps/office_cartographer.yaml \\
    --truth examples/maps/office.yaml --align --min coverage=0.9""",
    "rotate": """\
mapdeal rotate examples/maps/office.yaml -o out/turned.yaml --yaw 0.3
mapdeal rotate out/turned.yaml -o out/straight.yaml --straighten""",
    "rescale": "mapdeal rescale examples/maps/office.yaml -o out/coarse.yaml --resolution 0.1",
    "clean": """\
mapdeal clean examples/maps/office_cartographer.yaml -o out/clean.yaml \\
    --image out/clean.png""",
    "build": """\
mapdeal build examples/logs/office.log -o out/scanned.yaml --method counting
mapdeal build examples/logs/office.log --compare -o out/methods
mapdeal build examples/bags/office.mcap -o out/corridor.yaml""",
    "local": """\
mapdeal local --cloud examples/clouds/corridor2.pcd --pose -1,0.35,0.3 \\
    --map examples/maps/office.yaml --size 12,8 -o out/local
mapdeal local --cloud 'examples/clouds/corridor*.pcd' \\
    --poses examples/clouds/corridor_poses.txt -o out/corridor""",
    "convert": """\
mapdeal convert examples/maps/office.yaml -o out/office.png
mapdeal convert examples/maps/office.yaml -o out/office.mcap --topic /map
mapdeal convert examples/bags/office.mcap -o out/from_bag.yaml""",
    "lint": """\
mapdeal lint examples/maps --strict
mapdeal lint examples/maps --format sarif > lint.sarif
mapdeal lint --params-file examples/robots/nav2_params.yaml""",
    "report": """\
mapdeal run examples/maps/office.yaml -o out
mapdeal report out/office examples/maps/office.yaml -o out/report.html""",
    "completion": "mapdeal completion bash > mapdeal.bash",
    "edit": """\
mapdeal edit line examples/maps/office.yaml -o out/door.yaml \\
    --point -7.0,1.4 -5.9,1.4 --thickness 0.1 --value 100""",
    "edit polygon": """\
mapdeal edit polygon examples/maps/office.yaml -o out/shelf.yaml \\
    --point 9,-5 10.2,-5 10.2,-3 9,-3 --value 100
mapdeal edit polygon examples/maps/office.yaml -o out/mask.yaml --blank \\
    --file examples/shapes/office_zones.yaml""",
    "edit line": """\
mapdeal edit line examples/maps/office.yaml -o out/door.yaml \\
    --point -7.0,1.4 -5.9,1.4 --thickness 0.1 --value 100""",
    "edit circle": """\
mapdeal edit circle examples/maps/office.yaml -o out/ghost.yaml \\
    --point 5.0,0.3 --radius 0.5 --value 0""",
    "edit reset": """\
mapdeal edit reset examples/maps/office.yaml -o out/forgotten.yaml \\
    --corner -9.4,-5.7 --size 3.9,4.8""",
    "window": "mapdeal window examples/maps/office.yaml -o out/w.yaml --at 0.5,0.3 --size 8,8",
    "shift": "mapdeal shift examples/maps/office.yaml -o out/shifted.yaml --origin -10,-6.5",
    "pack": "mapdeal pack examples/maps/office.yaml -o out/office.pbm",
    "unpack": """\
mapdeal pack examples/maps/office.yaml -o out/office.pbm
mapdeal unpack out/office.pbm -o out/unpacked.yaml""",
}
"""Commands by name. They run from the project's folder; each name has its own in an empty one."""
