"""Local maps of a sequence of clouds, as a script would that somebody writes for the purpose.

Run it as ``python local_maps_by_hand.py CLOUDS POSES.txt OUT``: numpy, OpenCV's approximate
distances, and files that have reached the disk.
"""

import hashlib
import json
import math
import os
import sys
from pathlib import Path

import cv2
import numpy as np

SIZE, RESOLUTION, RADIUS = 8.0, 0.05, 0.3  # metres


def main(clouds: Path, poses: Path, out: Path) -> None:
    cells, reach = round(SIZE / RESOLUTION), math.ceil(RADIUS / RESOLUTION)
    rows, cols = np.indices((2 * reach + 1, 2 * reach + 1)) - reach
    disc = (np.hypot(rows, cols) * RESOLUTION <= RADIUS + 1e-9).astype(np.uint8)
    for k, (x, y, yaw) in enumerate(np.loadtxt(poses, ndmin=2)):
        data = (clouds / f"{k}.pcd").read_bytes()
        start = data.index(b"DATA binary\n") + 12
        points = np.frombuffer(data, "<f4", offset=start).reshape(-1, 4)[:, :2]
        turn = np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])
        origin = np.floor(np.array([x - SIZE / 2, y - SIZE / 2]) / RESOLUTION) * RESOLUTION
        at = np.floor((points @ turn + (x, y) - origin) / RESOLUTION).astype(int)
        at = at[(at >= 0).all(axis=1) & (at < cells).all(axis=1)]
        local = np.zeros((cells, cells), np.uint8)
        local[at[:, 1], at[:, 0]] = 100
        folder = out / f"{k:04}"
        folder.mkdir(parents=True)
        for name, layer in layers_of(local, disc).items():
            if name in ("esdf", "cost"):
                np.savez_compressed(folder / f"{name}.npz", **{name: layer})
            view = np.trunc(100 * (1 - np.clip(layer, 0, 2) / 2)) if name == "esdf" else layer
            cv2.imwrite(str(folder / f"{name}.pgm"), view[::-1].astype(np.uint8))
            where = f"resolution: {RESOLUTION}\norigin: {[*origin.tolist(), 0.0]}\n"
            (folder / f"{name}.yaml").write_text(f"image: {name}.pgm\n{where}")
        outputs = sorted(path.name for path in folder.iterdir())
        inputs = {f"{k}.pcd": hashlib.sha256(data).hexdigest()}
        manifest = {"inputs": inputs, "pose": [x, y, yaw], "outputs": outputs}
        (folder / "manifest.json").write_text(json.dumps(manifest, indent=2))
        for path in (*folder.iterdir(), folder):
            descriptor = os.open(path, os.O_RDONLY)
            os.fsync(descriptor)
            os.close(descriptor)


def layers_of(local: np.ndarray, disc: np.ndarray) -> dict[str, np.ndarray]:
    inflated = cv2.dilate(local, disc)
    outside = cv2.distanceTransform((inflated == 0).astype(np.uint8), cv2.DIST_L2, 5)
    inside = cv2.distanceTransform((inflated > 0).astype(np.uint8), cv2.DIST_L2, 5)
    field = (outside - np.maximum(inside - 1, 0)) * RESOLUTION
    cost, grown = inflated.copy(), inflated
    for value in (90, 70, 50):
        wider = cv2.dilate(grown, np.ones((3, 3), np.uint8))
        cost[(wider > 0) & (grown == 0)] = value
        grown = wider
    return {"local": local, "inflated": inflated, "esdf": field, "cost": cost}


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
