"""Names of the files, topic and frame of a bag to write."""

from __future__ import annotations

import re
from pathlib import Path

from mapdeal.errors import FileAccessError, ParameterError
from mapdeal.formats.source import contents_of, is_folder
from mapdeal.formats.temporary import PREFIX

BAG_OUTPUTS = (".bag", ".mcap", ".db3")
"""Suffixes of bags."""

_PART = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_LONGEST_TOPIC = 247
_PLAIN = re.compile(r"[A-Za-z0-9_. +-]+")
_METADATA = "metadata.yaml"


def bag_paths(output: Path) -> tuple[Path, ...]:
    """Return the files of a bag: one for ``.bag`` and ``.mcap``, a folder with two for ``.db3``."""
    if output.suffix != ".db3":
        return (output,)
    paths = output / f"{name_inside(output)}.db3", output / _METADATA
    if is_folder(output):
        folders, files = contents_of(output)
        own = {path.name for path in paths}
        others = [*folders, *(f for f in files if f not in own and not f.startswith(PREFIX))]
        if others:
            rule = f"is a folder with more than the bag of a map in it: {others[0]}"
            raise FileAccessError(rule, source=output, hint="choose another name")
    return paths


def name_inside(output: Path) -> str:
    """Return what a bag calls its file, without the ending.

    Names that a URI or YAML would have to escape are no names for all readers.
    """
    return output.stem if _PLAIN.fullmatch(output.stem) else "bag"


def check_topic(topic: str) -> str:
    """Return the name of a topic, with its leading slash.

    References
    ----------
    ROS wiki, "Names"; rmw's ``validate_full_topic_name``.

    Examples
    --------
    >>> check_topic("robot_1/map")
    '/robot_1/map'
    """
    name = topic if topic.startswith("/") else f"/{topic}"
    if not all(map(_PART.fullmatch, name[1:].split("/"))) or len(name) > _LONGEST_TOPIC:
        rule = "must be the name of a topic: letters, digits and _, with single slashes between"
        raise ParameterError(rule, source="--topic", got=topic)
    return name


def check_frame(frame: str) -> str:
    """Return the name of a frame."""
    if not frame or not frame.isprintable() or frame.startswith("/"):
        rule = "must be the name of a frame, without a slash in front"
        raise ParameterError(rule, source="--frame-id", got=frame)
    return frame
