"""The rows S7 to S16 of laser scans, through the command."""

import numpy as np

HALF = " ".join(["2.0"] * 180)
GOOD = f"FLASER 180 {HALF} 1 2 0.5 0 0 0 7 host 7\n"
BUILD = ["build", "a.log", "-o", "out.yaml"]


def test_skipped_lines_are_reported_also_if_there_is_no_map(folder, command):
    (folder / "a.log").write_text(GOOD.replace("2.0", "50") + GOOD[:300])
    code, _, err = command(*BUILD)
    assert code == 3
    assert "1 malformed lines ignored: line 2" in err
    assert "no beam hits anything: of 180 readings 180 are without return" in err


def test_angles_in_degrees_are_warned_of(folder, accepted):
    np.savez("a.npz", poses=np.zeros((2, 3)), angles=[-90.0, 0, 90, 180], ranges=np.ones((2, 4)))
    for more in ([], ["--size", "5,5", "--origin", "-2,-2"]):
        _, warned = accepted("build", "a.npz", "-o", "m.npz", "--force", *more)
        assert len(warned) == 1
        assert "degrees" in warned[0]
