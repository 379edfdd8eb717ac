"""What the files of a bag that is written are called."""

from __future__ import annotations

from pathlib import Path

BAG_OUTPUTS = (".bag", ".mcap", ".db3")
"""What the names of bags end in."""


def bag_paths(output: Path) -> tuple[Path, ...]:
    """Return the files of a bag: one for ``.bag`` and ``.mcap``, a folder with two for ``.db3``."""
    if output.suffix == ".db3":
        return output / f"{output.stem}.db3", output / "metadata.yaml"
    return (output,)
