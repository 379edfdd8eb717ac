"""``mapdeal lint``: what is wrong with maps."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Literal

import typer

from mapdeal.checks.finding import SEVERITIES, Finding
from mapdeal.checks.lint import lint_file
from mapdeal.cli import terminal
from mapdeal.cli.shared_options import shared_options
from mapdeal.errors import ParameterError, one_line
from mapdeal.pipeline.repair import repair_file
from mapdeal.pipeline.settings import Settings

app = typer.Typer(rich_markup_mode=None, add_completion=False)

_COMMANDS = {"error": "error", "warning": "warning", "note": "notice"}


@app.command()
@shared_options("max_cells", "force", "max_memory")
def lint(
    sources: Annotated[
        list[Path],
        typer.Argument(
            metavar="MAP...", help="map_server .yaml files, .pbm or .npz maps, or folders of runs."
        ),
    ],
    strict: Annotated[
        bool, typer.Option("--strict", help="Warnings, too, make the exit code 1.")
    ] = False,
    form: Annotated[
        Literal["text", "json", "github"],
        typer.Option("--format", help="Text, one JSON document, or annotations of a workflow."),
    ] = "text",
    fix: Annotated[
        bool, typer.Option("--fix", help="Write a map without the traps that can be taken out.")
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="OUT", help="With --fix: .yaml, .pgm, .png, .npz."),
    ] = None,
    *,
    settings: Settings,
) -> None:
    """Say what is wrong with maps, by named checks.

    Errors make the exit code 1: they make a map wrong or unsafe for some reader. Warnings are
    traps, notes are good to know. A file that cannot be read is a finding; the others go on.
    """
    if fix or output is not None:
        _fix(sources, output, settings, wanted=fix)
        return
    found = {path: lint_file(path, max_cells=settings.max_cells) for path in sources}
    findings = [finding for path in sources for finding in found[path]]
    counts = Counter(finding.severity for finding in findings)
    if form == "json":
        maps = [
            {"file": str(path), "findings": [_listed(f) for f in found[path]]} for path in found
        ]
        summary = {f"{name}s": counts[name] for name in SEVERITIES}
        terminal.result(json.dumps({"maps": maps, **summary}, indent=2))
    else:
        for finding in findings:
            terminal.result(_text(finding) if form == "text" else _annotation(finding))
        told = ", ".join(f"{counts[name]} {name}{'s' * (counts[name] != 1)}" for name in SEVERITIES)
        if form == "text":
            terminal.summary([f"{len(found)} map{'s' * (len(found) != 1)}: {told}"])
    if counts["error"] or (strict and counts["warning"]):
        raise typer.Exit(1)


def _fix(
    sources: list[Path], output: Path | None, options: Settings, *, wanted: bool
) -> None:  # fmt: skip
    if not wanted or output is None:
        missing, given = ("--fix", "-o") if not wanted else ("-o OUT", "--fix")
        raise ParameterError(f"needs {missing}", source=given)
    if len(sources) != 1:
        raise ParameterError("is for one map", source="--fix", got=len(sources))
    done = repair_file(sources[0], output, options)
    terminal.summary([f"{sources[0]} -> {output}", *(f"  {line}" for line in done)])


def _listed(finding: Finding) -> dict[str, object]:
    listed = asdict(finding)
    del listed["file"]
    return listed


def _text(finding: Finding) -> str:
    place = finding.file if finding.line is None else f"{finding.file}:{finding.line}"
    return one_line(f"{place}: {finding.severity}: {finding.check}: {finding.message}")


def _annotation(finding: Finding) -> str:
    """Return a workflow command; GitHub shows it beside the file."""
    place = f"file={_escaped(finding.file, more=True)}"
    if finding.line is not None:
        place += f",line={finding.line}"
    title = _escaped(finding.check, more=True)
    return f"::{_COMMANDS[finding.severity]} {place},title={title}::{_escaped(finding.message)}"


def _escaped(text: str, *, more: bool = False) -> str:
    for mark, code in (("%", "%25"), ("\r", "%0D"), ("\n", "%0A")):
        text = text.replace(mark, code)
    return text.replace(":", "%3A").replace(",", "%2C") if more else text
