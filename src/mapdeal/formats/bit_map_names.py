"""The two files of a bit map: a ``.pbm``, and the YAML beside it with its place."""

from __future__ import annotations

from pathlib import Path

from mapdeal.errors import FileAccessError, MalformedInputError
from mapdeal.formats.map_server import find_image
from mapdeal.formats.map_yaml import MapMetadata
from mapdeal.formats.source import exists, is_same_file, status_of

BIT_MAP = ".pbm"


def yaml_beside(path: Path) -> Path:
    """Return the YAML file beside a ``.pbm``."""
    found = next((p for p in map(path.with_suffix, (".yaml", ".yml")) if exists(p)), None)
    if found is None:
        status_of(path)
        rule = f"has no {path.with_suffix('.yaml').name} beside it, which gives its place"
        hint = "a bit map is two files, as mapdeal pack writes them"
        raise FileAccessError(rule, source=path, hint=hint)
    return found


def find_bits(path: Path, yaml_path: Path, metadata: MapMetadata) -> Path:
    """Return the image that the YAML file beside a ``.pbm`` names, which must be that one."""
    status_of(path)
    image = find_image(yaml_path, metadata.image)
    if not is_same_file(image, path):
        rule = f"names another image than {path.name}"
        raise MalformedInputError(rule, source=yaml_path, place="image", got=metadata.image)
    return image
