"""Names that the system refuses, and folders that are closed whoever runs the tests."""

import io
import os
from pathlib import Path


def private(folder, monkeypatch):
    """Close a folder to everybody, also to root, for whom no permission is missing.

    It cannot be listed, and its files can be neither examined nor opened, by any link.
    """
    closed = Path(os.path.realpath(folder))

    def refusing(original, is_listing):
        def call(path=".", *more, **keywords):
            if isinstance(path, (str, os.PathLike)):
                place = Path(os.path.realpath(path))
                if closed in place.parents or (is_listing and place == closed):
                    raise PermissionError(13, "Permission denied", str(path))
            return original(path, *more, **keywords)

        return call

    monkeypatch.setattr(io, "open", refusing(io.open, is_listing=False))
    for name in ("stat", "open", "mkdir", "scandir", "listdir"):
        is_listing = name in ("scandir", "listdir")
        monkeypatch.setattr(os, name, refusing(getattr(os, name), is_listing))
