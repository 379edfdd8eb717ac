"""A run beside a stored one, to see whether anything has changed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mapdeal.errors import FileAccessError, one_line
from mapdeal.formats.json_text import json_of
from mapdeal.formats.source import status_of
from mapdeal.formats.transaction import Transaction
from mapdeal.grid.framed import Figures
from mapdeal.pipeline.figures import changes_between
from mapdeal.pipeline.folder import MANIFEST
from mapdeal.pipeline.manifest import manifest_in, product_of

_SHOWN = 3
_PICTURE = ".png"


def store_golden(folder: Path, golden: Path, place: str | None = None) -> Path:
    """Copy the manifest of a run into a folder of golden runs."""
    manifest = manifest_in(folder)
    target = golden / (place or folder.name) / MANIFEST
    with Transaction([target], force=True) as transaction:
        transaction.write_bytes(target, json_of(manifest))
    return target


def differences_from_golden(folder: Path, golden: Path, place: str | None = None) -> list[str]:
    """Return what differs between a run and its golden run, a line each stage."""
    stored = golden / (place or folder.name) / MANIFEST
    try:
        status_of(stored)
    except FileAccessError as error:
        rule, hint = f"no golden run: {error.rule}", "--update-golden stores it"
        raise FileAccessError(rule, source=stored, hint=hint) from None
    new, old = manifest_in(folder), manifest_in(stored.parent)
    lines = []
    for stage in dict.fromkeys([*old["figures"], *new["figures"]]):
        told = _difference(stage, old, new)
        if told is not None:
            lines.append(f"{place or folder.name}: {stage}: {told}")
    return lines


def _difference(stage: str, old: dict[str, Any], new: dict[str, Any]) -> str | None:
    for one, other in ((old, "is new"), (new, "is missing")):
        if stage not in one["figures"]:
            return other
    parameters = [_parameters(manifest, stage) for manifest in (old, new)]
    changed = _changes(*parameters)
    if changed:
        return f"other parameters: {changed}"
    files = [_files(manifest, stage) for manifest in (old, new)]
    differing = [name for name in sorted({*files[0], *files[1]}) if _differs(name, *files)]
    if not differing:
        return None
    told = _changes(old["figures"][stage], new["figures"][stage])
    return f"{', '.join(differing)} differ" + (f": {told}" if told else "")


def _parameters(manifest: dict[str, Any], stage: str) -> dict[str, Any]:
    found: dict[str, Any] = next((s[stage] for s in manifest["stages"] if stage in s), {})
    return found


def _files(manifest: dict[str, Any], stage: str) -> dict[str, str]:
    stem = product_of(stage)
    return {
        name: str(digest)
        for name, digest in manifest["outputs"].items()
        if Path(name).stem == stem and Path(name).suffix != _PICTURE
    }


def _differs(name: str, old: dict[str, str], new: dict[str, str]) -> bool:
    return old.get(name) != new.get(name)


def _changes(old: Figures, new: Figures) -> str:
    """Return the figures that differ, the first of them."""
    texts = changes_between(old, new)
    shown = one_line(", ".join(texts[:_SHOWN]))
    return shown + (f" and {len(texts) - _SHOWN} more" if len(texts) > _SHOWN else "")
