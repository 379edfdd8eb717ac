"""``mapdeal build``: maps from laser scans."""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated, Any

import typer

from mapdeal.cli import bag_options as bag_opt
from mapdeal.cli import options as opt
from mapdeal.cli import terminal
from mapdeal.cli.shared_options import shared_options
from mapdeal.cli.stage_command import say_written
from mapdeal.commands.build import BuildSettings, build_file
from mapdeal.errors import ParameterError
from mapdeal.inputs.kinds import is_bag
from mapdeal.mapping.beams import BeamLimits
from mapdeal.mapping.build import Method
from mapdeal.pipeline.settings import Settings
from mapdeal.sensors.scans import DEFAULT_MAX_BAD, ScanSource, ScanTexts, open_log

_DEFAULT_METHOD: Method = "log-odds"

app = typer.Typer(rich_markup_mode=None, add_completion=False)


@app.command()
@shared_options("image", "force", "threads", "max_memory")
def build(
    output: Annotated[
        Path,
        opt.output_argument(
            "OUT",
            "The result: .yaml or .pgm (a pgm pair), .png (a pair), or .npz; with --compare a "
            "folder.",
        ),
    ],
    log: Annotated[
        Path | None,
        typer.Argument(
            metavar="LOG",
            help="A CARMEN log (also .gz), an .npz of scans, or a bag of ROS 1 or ROS 2.",
        ),
    ] = None,
    poses: Path | None = None,
    angles: Path | None = None,
    ranges: Path | None = None,
    flip_y: bool = False,
    topics: bag_opt.Topics = None,
    fixed_frame: bag_opt.FixedFrame = None,
    base_frame: bag_opt.BaseFrame = None,
    odometry: bag_opt.Odometry = None,
    mount: bag_opt.Mount = None,
    deskew: bool = False,
    method: Annotated[
        Method | None,
        typer.Option(help=f"How evidence becomes a map.  [default: {_DEFAULT_METHOD}]"),
    ] = None,
    compare: bool = False,
    as_json: Annotated[bool, typer.Option("--json")] = False,
    resolution: Annotated[float, typer.Option(metavar="R", help="Side of a cell, metres.")] = 0.05,
    size: str | None = None,
    origin: str | None = None,
    range_min: float = 0.0,
    range_max: float = 30.0,
    clear_max: float = 0.0,
    log_free: float | None = None,
    log_occ: float | None = None,
    log_min: float | None = None,
    log_max: float | None = None,
    values: bool = False,
    ratio: float | None = None,
    truncation: float | None = None,
    truncation_behind: float | None = None,
    as_written: bool = False,
    layers: Path | None = None,
    max_bad: Annotated[int, typer.Option(min=0)] = DEFAULT_MAX_BAD,
    *,
    settings: Settings,
) -> None:
    """Make a map from laser scans with known poses.

    With a bag, the poses come from its transforms or its odometry.

    Cells that a beam passes become free, and cells where a beam ends become occupied; cells that
    no beam reaches stay unknown. --compare shows what each method makes of a log.

    Options
    -------
    --poses FILE: Text file with one x,y,yaw per scan. With a bag: the robot's poses, one t x y z
        qx qy qz qw per line, instead of transforms.
    --angles FILE: Text file with the angles of the beams, radians.
    --ranges FILE: Text file with the ranges of one scan per line, metres.
    --flip-y: With --poses: the y axis of the poses points to the right.
    --deskew: With a bag: use the pose at the time of each beam (time_increment).
    --compare: Run all methods on one grid and compare them: maps, figures, and pictures of the
        differences.
    --size WX,WY: Extent along x and y, metres.  [default: what contains all scans]
    --origin X,Y: With --size: the lower left corner, metres.
    --range-min M: Shorter readings are ignored, metres.
    --range-max M: Readings at or above this range have hit nothing, metres.
    --clear-max M: Range up to which beams without a hit clear cells, metres; 0 clears none.
    --log-free V: log-odds: added where a beam passes.  [default: -1]
    --log-occ V: log-odds: added where a beam ends.  [default: 2]
    --log-min V: log-odds: lower bound.  [default: 0]
    --log-max V: log-odds: upper bound.  [default: 100]
    --values: log-odds: write the values instead of free and occupied.
    --ratio R: counting: share of hits above which a cell is occupied.  [default: 0.3]
    --truncation CELLS: tsdf: truncation distance, cells.  [default: 2]
    --truncation-behind N: tsdf: how far beams continue behind a hit, in truncation distances.
        [default: 1]
    --as-written: tsdf: make the map of design document 004: only walls, where the distance changes
        its sign along y; beams continue 3 truncation distances behind a hit.
    --layers OUT.npz: Also write the map with its evidence.
    --json: With --compare: print the figures as JSON.
    --max-bad N: Malformed lines of a log to tolerate.
    """
    own: dict[Method, dict[str, Any]] = {
        "log-odds": opt.given(
            log_free=log_free, log_occ=log_occ, log_min=log_min, log_max=log_max,
            values=values or None
        ),
        "counting": opt.given(ratio=ratio),
        "tsdf": opt.given(
            truncation=truncation, truncation_behind=truncation_behind,
            as_written=as_written or None
        ),
    }  # fmt: skip
    if compare:
        alone = {"--method": method, "--values": values, "--layers": layers}
        _refuse({**alone, "--image": settings.image}, "cannot be given together with --compare")
    else:
        _refuse({"--json": as_json}, "needs --compare")
        own = _only(own, method or _DEFAULT_METHOD)
    how = BuildSettings(
        own,
        BeamLimits(range_min, range_max, clear_max),
        resolution,
        None if size is None else opt.pair(size, "--size"),
        None if origin is None else opt.pair(origin, "--origin"),
    )
    of_bag = bag_opt.BagWords(topics, fixed_frame, base_frame, odometry, mount, deskew=deskew)
    texts = {"--angles": angles, "--ranges": ranges, "--flip-y": flip_y}
    with ExitStack() as stack:
        if log is not None and is_bag(log):
            _refuse(texts, "does not apply to bags")
            source: ScanSource = stack.enter_context(of_bag.scans(log, poses))
        else:
            of_bag.refuse("needs a bag for LOG")
            source = _source_of(log, poses, angles, ranges, flip_y=flip_y, max_bad=max_bad)
        passes = 2 if how.sizes_itself else 1
        bar = stack.enter_context(terminal.Progress(source.preparation + passes * source.count))
        if compare:
            from mapdeal.commands.build import compare_methods  # not loaded for one map

            found = compare_methods(source, output, how, settings, advance=bar.advance)
        else:
            figures = build_file(source, output, how, settings, layers=layers, advance=bar.advance)
    if not compare:
        say_written(output, figures, with_origin=True)
        terminal.summary([_beams(figures)])
    elif as_json:
        terminal.result(json.dumps(found.timed_document(), indent=2))
    else:
        terminal.summary(_table(output, found.timed_document()))


def _refuse(given: Mapping[str, object], rule: str) -> None:
    for name, value in given.items():
        if value:
            raise ParameterError(rule, source=name)


def _only(own: dict[Method, dict[str, Any]], method: Method) -> dict[Method, dict[str, Any]]:
    """Return the parameters of one method; those of others must not be given."""
    for other, given in own.items():
        if other != method and given:
            option = f"--{next(iter(given)).replace('_', '-')}"
            raise ParameterError(f"does not apply to --method {method}", source=option)
    return {method: own[method]}


def _beams(figures: Mapping[str, Any]) -> str:
    text = f"  {figures['scans']} scans, {figures['beams']} beams: {figures['hits']} hits, "
    return text + f"{figures['no_return']} without return, {figures['bad']} bad"


def _table(folder: Path, figures: Mapping[str, Any]) -> list[str]:
    x, y, _ = figures["origin"]
    hit = f"  {figures['cells_hit_three_times']} cells hit three times and more, with "
    head = f"  {'method':<10}{'occupied':>10}{'free':>10}{'unknown':>10}{'one cell wide':>15}"
    lines = [
        f"{folder}: {figures['width']} x {figures['height']} cells at {x:.10g}, {y:.10g}",
        _beams(figures),
        f"{hit}{figures['groups_hit_three_times']} groups of three cells and more",
        f"{head}{'mean':>8}{'groups vanished':>17}{'bytes a cell':>14}{'seconds':>9}",
    ]
    for method, its in figures["methods"].items():
        share, mean = its["one_cell_wide_share"], its["mean_thickness_cells"]
        wide = "-" if share is None else f"{100 * share:.1f} %"
        thick = "-" if mean is None else f"{mean:.2f}"
        lines.append(
            f"  {method:<10}{its['occupied']:>10}{its['free']:>10}{its['unknown']:>10}{wide:>15}"
            f"{thick:>8}{its['vanished_groups']:>17}{its['bytes_per_cell']:>14}"
            f"{its['seconds']:>9.2f}"
        )
    for pair in figures["pairs"]:
        cells = pair["cells"]
        only = [cells["occupied"][s] for s in ("free", "unknown")]
        other = [cells[s]["occupied"] for s in ("free", "unknown")]
        lines.append(
            f"  {pair['first']}, {pair['second']}: {pair['differing']} cells differ, "
            f"{sum(only)} occupied only by {pair['first']}, {sum(other)} only by {pair['second']}"
        )
    return lines


def _source_of(
    log: Path | None,
    poses: Path | None,
    angles: Path | None,
    ranges: Path | None,
    *,
    flip_y: bool,
    max_bad: int,
) -> ScanSource:
    if log is not None:
        texts = {"--poses": poses, "--angles": angles, "--ranges": ranges, "--flip-y": flip_y}
        for name, value in texts.items():
            if value:
                raise ParameterError("cannot be given together with a LOG", source=name)
        return open_log(log, max_bad=max_bad)
    if poses is None or angles is None or ranges is None:
        rule = "must be given, or all of --poses, --angles and --ranges"
        raise ParameterError(rule, source="LOG")
    return ScanTexts(poses, angles, ranges, flip_y=flip_y)
