"""Make the example log.

Run it as ``python examples/logs/make_log.py``.

A robot with a laser scanner of 180 beams drives along the corridor of the example office; the
log is CARMEN's. Seeded: the file comes out the same every time.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import mapdeal

HERE = Path(__file__).parent
ANGLES = np.radians(np.arange(-90, 90))
RANGE_MAX, STEP, NOISE = 9.9, 0.01, 0.01  # metres
NOTHING = 81.83  # what a SICK LMS reports where it sees nothing


def main() -> None:
    """Write the log."""
    office = mapdeal.read_map(HERE.parent / "maps" / "office.yaml")
    rng = np.random.default_rng(7)
    lines = ["# a drive along the corridor of the example office"]
    along = np.arange(STEP, RANGE_MAX, STEP)
    for k, x in enumerate(np.arange(-7.0, 8.0, 0.25).tolist()):
        pose = (x, 0.8 + 0.15 * np.sin(0.9 * x), 0.6 * np.sin(1.7 * x))
        angle = pose[2] + ANGLES
        rays = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        points = np.array(pose[:2]) + along[:, np.newaxis, np.newaxis] * rays
        cells, inside = office.frame.bounded_rowcol_from_xy(points.reshape(-1, 2))
        solid = (inside & office.occupied()[cells[:, 0], cells[:, 1]]).reshape(points.shape[:2])
        ranges = along[solid.argmax(axis=0)] + rng.normal(0, NOISE, len(ANGLES))
        ranges = np.where(solid.any(axis=0), ranges, NOTHING)
        words = [f"FLASER {len(ANGLES)}", *(f"{r:.2f}" for r in ranges)]
        words += [f"{value:.4f}" for value in (*pose, *pose)]
        lines.append(" ".join([*words, f"{0.5 * k:.1f} office {0.5 * k:.1f}"]))
    (HERE / "office.log").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
