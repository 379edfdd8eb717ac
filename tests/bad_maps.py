"""Parts of bad inputs, and a check of the files that remain in a folder."""

import numpy as np
import pytest

GOOD_KEYS = {"image": "m.pgm", "mode": "trinary", "resolution": "0.05",
             "origin": "[1.5, -2.0, 0.4]", "negate": "0", "occupied_thresh": "0.65",
             "free_thresh": "0.196"}  # fmt: skip
PIXELS = bytes([0, 254, 205, 254, 254, 0])
PGM = b"P5\n3 2\n255\n" + PIXELS
DRAWING = "#.?\n..#"


def yaml_text(**changes):
    keys = {**GOOD_KEYS, **changes}
    return "".join(f"{key}: {text}\n" for key, text in keys.items() if text is not None)


def write_map(folder, text=None, image=PGM):
    folder.mkdir(exist_ok=True)
    text = yaml_text() if text is None else text
    (folder / "m.yaml").write_bytes(text if isinstance(text, bytes) else text.encode())
    (folder / "m.pgm").write_bytes(image)


def tree(folder):
    """Every path below a folder with its contents, for large files their size."""
    found = {}
    for path in sorted(folder.rglob("*")):
        found[path.relative_to(folder).as_posix()] = (
            path.stat().st_size if path.stat().st_size > 1 << 20 else path.read_bytes()
        ) if path.is_file() else path.is_symlink()  # fmt: skip
    return found


def named(rows):
    """Return parameters of tests: rows, each with its name in front."""
    return [pytest.param(*case, id=name) for name, *case in rows]


def cells_of(path, layer="occupancy"):
    with np.load(path) as entries:
        return entries[layer].tolist()


def check_failure(code, out, err, exit_code, named, hint):
    """Check the exit code of a failure and that one line of it names the faulty input."""
    lines = err.splitlines()
    errors = [line for line in lines if line.startswith("error: ")]
    hints = [line for line in lines if line.startswith("hint: ")]
    assert "Traceback" not in out + err
    assert code == exit_code, err
    assert len(errors) == 1, err
    assert len(hints) <= 1, err
    assert all(line.startswith(("error: ", "hint: ", "warning: ")) for line in lines), err
    assert out == ""
    for text in named:
        assert text in errors[0]
    assert hint in "".join(hints)
