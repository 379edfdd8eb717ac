"""The extra ``bags``: the package rosbags, imported when a bag is opened or written."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

from mapdeal.errors import ParameterError


def needs_bags(source: Path | str, *modules: str) -> None:
    """Import rosbags' types, and other modules of it."""
    try:
        for module in ("rosbags.typesys", *modules):
            import_module(module)
    except ImportError as error:
        if error.path and not error.path.endswith(".py"):
            raise  # it is installed, and the system has no room for it
        missing = (error.name or "").partition(".")[0] in ("rosbags", "")
        why = "" if missing else f" ({error})"
        hint = "pip install 'mapdeal[bags]'"
        raise ParameterError(f"needs the extra 'bags'{why}", source=source, hint=hint) from None
