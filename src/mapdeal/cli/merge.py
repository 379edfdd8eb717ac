"""``mapdeal merge``: several maps in one."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mapdeal.cli import options as opt
from mapdeal.cli import terminal
from mapdeal.cli.shared_options import shared_options
from mapdeal.cli.stage_command import say_written
from mapdeal.cli.streams import FROM_STDIN
from mapdeal.commands.merge import By, Known, MergeReport, merge_files
from mapdeal.editing.merge import MapCounts, Rule
from mapdeal.errors import ParameterError
from mapdeal.pipeline.settings import Settings

_WORDS: tuple[By, ...] = ("frames", "align")

app = typer.Typer(rich_markup_mode=None, add_completion=False)


@app.command()
@shared_options("files")
def merge(
    maps: Annotated[
        list[Path],
        typer.Argument(
            metavar="MAP...", help=f"Two maps or more: .yaml, .pbm or .npz. {opt.OR_STDIN}"
        ),
        FROM_STDIN,
    ],
    output: opt.GridOutput,
    by: list[str] | None = None,
    rule: Rule = "occupied",
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON document.")] = False,
    *,
    settings: Settings,
) -> None:
    """Merge maps of one place into one.

    The result has the lattice of the first map, extended to all others. The others may have any
    resolution, origin and yaw: they are resampled so that no obstacle is lost.

    Rule occupied: occupied wins over free, and free over unknown. Rule newest: the last map on the
    command line that knows a cell wins. Rule evidence: the evidence for and against an obstacle is
    summed, from the layers of mapdeal build --layers; a map without them has one vote per cell,
    and a tie is decided by rule occupied.

    Cells that are occupied in one map and free in another are conflicts: they are counted, and
    coloured in the picture. With --by align the exit code is 1, and nothing is written, if the
    placement of a map is uncertain.

    Options
    -------
    --by frames|align|FILE.json: How the maps are placed: by their frames, by their walls (align),
        or by files of mapdeal align, one for each map but the first.  [default: frames]
    --rule: Which value wins where maps differ: the largest, that of the last map that knows the
        cell, or the sum of the evidence.
    """
    if as_json:
        terminal.need_stdout("--json")
    report = merge_files(maps, output, settings, by=_placed_by(by or ["frames"]), rule=rule)
    if as_json:
        terminal.document(report, None)
        return
    say_written(output, report.figures, with_origin=True)
    terminal.summary(_lines(report))


def _placed_by(words: list[str]) -> By | list[Path]:
    for word in _WORDS:
        if word in words:
            if len(words) > 1:
                rule = f"{word} cannot be given together with others"
                raise ParameterError(rule, source="--by", got=words)
            return word
    return [Path(word) for word in words]


def _lines(report: MergeReport) -> list[str]:
    merged = report.merged
    told = f"  {merged.common} cells are known in several maps"
    if merged.common:
        share = 100 * merged.conflict_count / merged.common
        told += f"; {merged.conflict_count} of them ({share:.2f} %) are occupied in one and free"
        told += " in another"
    return [told, *map(_line, range(len(merged.maps)), report.maps, merged.maps)]


def _line(number: int, one: Known, counts: MapCounts) -> str:
    text = f"  {one.path}: {counts.known} cells known"
    if number:
        text += f", {counts.added} added"
    if not counts.common:
        return text
    text += f"; of {counts.common} that others know, {counts.occupied_here} are occupied here and"
    text += f" free there, {counts.free_here} vice versa"
    if counts.walls:
        text += f"; {100 * counts.met / counts.walls:.0f} % of its walls there are also in others"
    return text
