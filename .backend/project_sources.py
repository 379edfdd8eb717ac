"""Which files belong to the project, and README as it is shown outside of it."""

import os
import re
import subprocess
from pathlib import Path

MADE = {"__pycache__", "build", "dist", "out", "node_modules"}
"""Folders whose contents are made from other files; so are hidden ones, save those below."""

HIDDEN = {".backend", ".ci", ".github", ".gitignore", ".pre-commit-hooks.yaml"}


def absolute(text, source, version):
    """Return a page of Markdown whose relative links lead to a release at the project's address."""
    raw = source.replace("https://github.com/", "https://raw.githubusercontent.com/")
    text = re.sub(r"(!\[[^\]]*\]\()(?!\w+:|#)", rf"\g<1>{raw}/v{version}/", text)
    return re.sub(r"((?<!!)\[[^\]]*\]\()(?!\w+:|#)", rf"\g<1>{source}/blob/v{version}/", text)


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
            if not (_is_made(place / name) or name.endswith((".so", ".pyd"))):
                yield (place / name).as_posix()


def _is_made(path):
    if path.parent == Path() and path.name == "PKG-INFO":
        return True
    if path.name.startswith("."):
        return path.as_posix() not in HIDDEN
    return path.name in MADE or path.name.endswith(".egg-info")
