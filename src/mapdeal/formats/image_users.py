"""Maps that share an image."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from mapdeal.errors import FileAccessError, MapdealError
from mapdeal.formats.map_server import image_places
from mapdeal.formats.source import contents_of, identity_of, is_same_file
from mapdeal.formats.yaml_text import read_mapping

Identity = tuple[int, int]


class ImageUsers:
    """The YAML files that name an image, of the folders that are asked about.

    Each folder is looked into once, so that asking for all of its maps takes linear time.
    """

    def __init__(self) -> None:
        self._named: dict[Path, list[tuple[Identity, Path]]] = {}

    def others(self, image: Path, yaml_path: Path) -> list[Path]:
        """Return the maps beside an image, or beside a map, that use the image, too."""
        identity = identity_of(image)
        folders = dict.fromkeys((image.parent, yaml_path.parent))
        users = [
            path
            for folder in folders
            for named, path in self._named_in(folder)
            if named == identity and not is_same_file(path, yaml_path)
        ]
        return list(dict.fromkeys(users))

    def _named_in(self, folder: Path) -> list[tuple[Identity, Path]]:
        if folder not in self._named:
            self._named[folder] = list(_images_of(folder))
        return self._named[folder]


def _images_of(folder: Path) -> Iterator[tuple[Identity, Path]]:
    """Yield what images the YAML files in a folder name; who cannot be read names none."""
    try:
        _, names = contents_of(folder)
    except FileAccessError:
        return
    for name in names:
        path = folder / name
        if path.suffix.lower() not in (".yaml", ".yml"):
            continue
        try:
            entries = read_mapping(path)
            places = image_places(folder, entries["image"].text()) if "image" in entries else []
            identities = map(identity_of, places)
            identity = next(filter(None, identities), None)
        except MapdealError:
            continue
        if identity is not None:
            yield identity, path
