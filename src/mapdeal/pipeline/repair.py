"""A repaired copy of the map in a file."""

from __future__ import annotations

from pathlib import Path

from mapdeal.checks.facts import gather
from mapdeal.checks.finding import Finding
from mapdeal.checks.repair import repaired
from mapdeal.errors import MalformedInputError
from mapdeal.formats.maps import output_paths, write_grid
from mapdeal.pipeline.files import errors_named, outputs_of
from mapdeal.pipeline.settings import Settings


def repair_file(path: Path, output: Path, options: Settings) -> list[str]:
    """Write a map without the traps that can be taken out of it; return what was changed."""
    outputs = output_paths(output)
    pair, cells, findings = gather(path, max_cells=options.max_cells)
    if cells is None:
        raise MalformedInputError(_why(findings), source=path)
    inputs = [path, *([pair.path, pair.image_path] if pair is not None else [])]
    with outputs_of(outputs, inputs, options) as transaction:
        with errors_named(path):
            grid, done = repaired(path, pair, max_cells=options.max_cells)
        write_grid(transaction, output, grid)
    if pair is not None:
        done += [found.message for found in findings if found.check == "yaml.nan-yaw"]
        done.append(f"image {outputs[0].name}, usual thresholds")
    return done


def _why(findings: list[Finding]) -> str:
    return next(
        (found.message for found in findings if found.severity == "error"),
        "holds costs, which are not repaired",
    )
