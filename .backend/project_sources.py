"""Which files belong to the project."""

import os
import subprocess
from pathlib import Path

MADE = {"__pycache__", "build", "dist", "out", "node_modules"}
"""Folders whose contents are made from other files; so are hidden ones, except for these."""

HIDDEN = {".backend", ".ci", ".github"}

MADE_FILES = {"PKG-INFO", ".git", ".coverage"}


def project_files(root="."):
    """Return the paths of the files that belong to the project: those that git tracks.

    Without git, as in an unpacked source distribution, all but those that are made from others.
    """
    if (Path(root) / ".git").exists():
        try:
            words = ["git", "-C", str(root), "ls-files", "-z"]
            listed = subprocess.run(words, check=True, capture_output=True).stdout  # noqa: S603
        except (OSError, subprocess.CalledProcessError):  # no git, or not ours to read
            pass
        else:
            names = os.fsdecode(listed).split("\0")
            return [name for name in names if name and (Path(root) / name).is_file()]
    return sorted(_files_below(Path(root)))


def _files_below(root):
    for folder, folders, files in os.walk(root):
        place = Path(folder).relative_to(root)
        folders[:] = [name for name in folders if not _is_made(place / name)]
        for name in files:
            is_made = place == Path() and name in MADE_FILES
            if not (is_made or name.endswith((".so", ".pyd", ".c"))):
                yield (place / name).as_posix()


def _is_made(folder):
    if folder.name.startswith("."):
        return folder.as_posix() not in HIDDEN
    return folder.name in MADE or folder.name.endswith(".egg-info")
