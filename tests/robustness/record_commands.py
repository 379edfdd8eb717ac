"""Record what commands do, and compare two checkouts.

``python tests/robustness/record_commands.py FOLDER... > a.txt`` runs the commands that take each
map, cloud, log, bag and parameter file below some folders, with the mapdeal of this interpreter:
exit codes, output, and the files: arrays of npz and npy, the bytes of images of maps,
texts, of pictures the size alone. Do so before a redesign and after it; then ``diff a.txt b.txt``
shows what differs. Files that commands take from the project's examples must be the same in both:
name the folders by absolute paths.
"""

import argparse
import hashlib
import io
import json
import multiprocessing
import os
import re
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image

OF_MAPS = """
info {} --json
lint {} --format text --no-config
lint {} --format sarif --no-config --strict --robot-radius 0.3
convert {} -o o.yaml
convert {} -o o.npz --dialect ros1
convert {} -o - --encoding costmap2d
convert {} -o o.mcap
active {} -o o.yaml --margin 0.5
inflate {} -o o.yaml --radius 0.2 --kernel square
inflate {} -o o.npz --max-memory 60M
esdf {} -o o.npz --convention center --max-distance 2
esdf {} -o o.yaml --unknown occupied --view per-map --strict
cost {} -o o.npz --robot-radius 0.22
cost {} -o o.yaml --model threshold --down-distance 1.2
cost {} -o o.npz --model rings --max-memory 60M
cost {} -o o.npz --model layers
potential {} -o o.npz --goal 1,1
reach {} --from 0,0 --to 1,1 --robot-radius 0.2 -o r.json
query {} --at 0.5,0.3 1,-1 100,100
query {} --at 0.5,0.3,1 --robot-radius 0.2 --rule full
route {} --from 0,0 --to 1,1 --through-unknown
clean {} -o o.yaml --json
score {} --json
rescale {} -o o.yaml --resolution 0.11
rotate {} -o o.npz --yaw 0.3
shift {} -o o.yaml --origin 1,-2
window {} -o o.npz --at 0.5,0.3 --size 8,6
edit circle {} -o o.yaml --point 0.2,0.2 --radius 0.5 --value 100
pack {} -o o.pbm
run {} -o out
run {} -o out --recipe nav2 --no-images
run {} -o out --recipe design-sim --no-images
report {} -o r.html
diff {} {} --json
score {} --truth {} --json
align {} {} --json
merge {} {} -o o.yaml
"""
OF_BAGS = """
info {} --json
convert {} -o o.yaml
convert {} -o o --all
build {} -o o.yaml
local --cloud {} -o out --no-images --size 8,8
"""
OF_CLOUDS = """
info {} --json
local --cloud {} --pose 0.5,0.3,0.4 -o out --no-images
local --cloud {} --pose 0.5,0.3,0.4 -o out --no-images --min-height 0.1 --recipe nav2
"""
OF_LOGS = """
info {} --json
build {} -o o.yaml
build {} -o o.yaml --method counting
build {} -o o.npz --method tsdf --resolution 0.2
"""
OF_PARAMETERS = """
info {} --json
lint --params-file {}
"""
ENDINGS = {
    ".bag": OF_BAGS, ".mcap": OF_BAGS, ".db3": OF_BAGS, ".pcd": OF_CLOUDS, ".ply": OF_CLOUDS,
    ".log": OF_LOGS, ".yaml": OF_MAPS,
}  # fmt: skip
ENTRY = "import sys; from mapdeal.cli.main import main; sys.exit(main())"
LONGEST, LONGEST_TEXT = 60, 20_000
CHANGING = [(r"\d[\d.]* m?s\b", "<seconds>"), (r'"\w*seconds": [^,}\n]+', '"seconds"')]
"""What differs from run to run."""


def commands(folders: list[Path]) -> Iterator[str]:
    """Yield the commands that take the files below some folders, and what each says of itself."""
    from mapdeal.cli.main import command_names

    for name in command_names():
        yield from (f"{name} --help", name, f"{name} none.yaml -o o.yaml")
    for path in sorted(path for folder in folders for path in folder.rglob("*")):
        of_it = ENDINGS.get(path.suffix, "")
        if path.suffix == ".yaml" and "image:" not in path.read_text("utf-8", "replace"):
            of_it = OF_PARAMETERS
        quoted = shlex.quote(str(path))
        yield from (line.replace("{}", quoted) for line in of_it.split("\n") if line)


def recorded(command: str) -> dict[str, object]:
    """Run a command in a folder of its own; return its exit code, output and files."""
    surroundings = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "COLUMNS": "100"}
    with tempfile.TemporaryDirectory() as name:
        try:
            completed = subprocess.run(
                [sys.executable, "-c", ENTRY, *shlex.split(command)],
                cwd=name, env=surroundings, capture_output=True, timeout=LONGEST, check=False,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            return {"command": command, "code": "timeout"}
        files = {
            str(path.relative_to(name)): contents(path.suffix, path.read_bytes(), name)
            for path in sorted(Path(name).rglob("*"))
            if path.is_file()
        }
        out, err = (contents("", data, name) for data in (completed.stdout, completed.stderr))
    streams = {"out": out, "err": err}
    return {"command": command, "code": completed.returncode, **streams, "files": files}


def contents(ending: str, data: bytes, folder: str) -> object:
    """Return what must be the same in both checkouts."""
    if data.startswith((b"PK", b"\x93NUMPY")):
        found = np.load(io.BytesIO(data))
        return {
            name: [str(array.dtype), array.shape, hashlib.sha256(array.tobytes()).hexdigest()]
            for name, array in ({"": found} if isinstance(found, np.ndarray) else found).items()
        }
    if ending == ".png":
        return Image.open(io.BytesIO(data)).size
    if ending == ".html":
        return "a page"
    try:
        text = data.decode().replace(folder, "<folder>")
    except UnicodeDecodeError:
        return hashlib.sha256(data).hexdigest()
    for pattern, word in CHANGING:
        text = re.sub(pattern, word, text)
    return text if len(text) < LONGEST_TEXT else hashlib.sha256(text.encode()).hexdigest()


def main() -> None:
    """Print what each command does, or those of some names."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="+", type=Path, metavar="FOLDER")
    parser.add_argument("--only", nargs="*", default=[], metavar="COMMAND")
    options = parser.parse_args()
    every = commands([path.absolute() for path in options.folders])
    names = options.only
    chosen = (command for command in every if not names or command.split()[0] in names)
    with multiprocessing.Pool() as pool:
        for record in pool.imap(recorded, chosen, 4):
            print(json.dumps(record, indent=1), flush=True)


if __name__ == "__main__":
    main()
