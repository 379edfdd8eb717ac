"""Manifests read again: what a run was, and how one of its files was made."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mapdeal.errors import MalformedInputError
from mapdeal.formats.json_text import read_json
from mapdeal.pipeline.folder import MANIFEST
from mapdeal.stages.catalogue import models_of


def manifest_in(folder: Path) -> dict[str, Any]:
    """Return the manifest of the run in a folder."""
    manifest = _manifest_or_none(folder)
    if manifest is None:
        raise MalformedInputError("is not the manifest of a run", source=folder / MANIFEST)
    return manifest


def stages_behind(name: str, folder: Path, sums: Mapping[str, str]) -> list[dict[str, Any]] | None:
    """Return the stages that have made a file, with their parameters, from its manifest."""
    manifest = _manifest_or_none(folder)
    if manifest is None or any(manifest["outputs"].get(key) != sums[key] for key in sums):
        return None
    stages: list[dict[str, Any]] = manifest["stages"]
    products = [product_of(next(iter(one))) for one in stages]
    stem = Path(name).stem
    return stages[: products.index(stem) + 1] if stem in products else None


def product_of(stage: str) -> str:
    """Return what the files of a stage are called; of one that is no recipe's, its name."""
    return next((one.product for one in models_of(stage).values()), stage)


def _manifest_or_none(folder: Path) -> dict[str, Any] | None:
    value = read_json(folder / MANIFEST)
    return value if _is_manifest(value) else None


def _is_manifest(value: object) -> bool:
    """Return whether figures, outputs and stages are there in the shape that a run gives them.

    No stage runs twice, see `Recipe`.
    """
    if not isinstance(value, dict):
        return False
    figures, outputs, stages = (value.get(key) for key in ("figures", "outputs", "stages"))
    return (
        isinstance(figures, dict)
        and all(isinstance(one, dict) for one in figures.values())
        and isinstance(outputs, dict)
        and all(isinstance(digest, str) for digest in outputs.values())
        and isinstance(stages, list)
        and all(isinstance(stage, dict) and len(stage) == 1 for stage in stages)
        and all(isinstance(one, dict) for stage in stages for one in stage.values())
        and len({name for stage in stages for name in stage}) == len(stages)
    )
