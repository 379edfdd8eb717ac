"""``mapdeal convert``: a map, costmap or field in another format or on another scale."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mapdeal.cli import options as opt
from mapdeal.cli.shared_options import shared_options
from mapdeal.cli.stage_command import say_written
from mapdeal.cli.streams import TO_STDOUT
from mapdeal.errors import ParameterError
from mapdeal.formats.map_yaml import Mode
from mapdeal.pipeline.convert import Scale, convert_file
from mapdeal.pipeline.settings import Settings
from mapdeal.stages.parameters import is_plain

app = typer.Typer(rich_markup_mode=None, add_completion=False)


@app.command()
@shared_options("files")
def convert(
    source: opt.MapArgument,
    output: Annotated[
        Path,
        opt.output_argument(
            "OUT",
            f"The result: .yaml or .pgm (a pgm pair), .png (a png pair), or .npz. {opt.OR_STDOUT}",
        ),
        TO_STDOUT,
    ],
    encoding: Annotated[
        Scale | None,
        typer.Option(
            help="Scale of the values: what ROS publishes, costmap_2d's bytes, or the map that "
            "is left to amcl.  [default: an .npz keeps its own, pixels of costs are occupancy]",
        ),
    ] = None,
    mode: Annotated[
        Mode | None,
        typer.Option(
            help="How values become pixels.  [default: raw if a value lies in 1..99, else trinary]",
        ),
    ] = None,
    static_layer: Annotated[
        bool,
        typer.Option(
            "--static-layer",
            help="With --encoding costmap2d: costs as costmap_2d's static layer makes them of a "
            "map, not round(2.54 v).",
        ),
    ] = False,
    lethal_threshold: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="With --static-layer: lethal_cost_threshold, 0..100.  [default: 100]",
        ),
    ] = None,
    trinary_costmap: Annotated[
        bool | None,
        typer.Option(
            "--trinary-costmap/--no-trinary-costmap",
            help="With --static-layer: values below the threshold become 0.  [default: yes]",
            show_default=False,
        ),
    ] = None,
    track_unknown: Annotated[
        bool | None,
        typer.Option(
            "--track-unknown/--no-track-unknown",
            help="With --static-layer: unknown cells stay unknown.  [default: yes]",
            show_default=False,
        ),
    ] = None,
    inscribed_value: Annotated[
        str | None,
        typer.Option(
            metavar="N|none",
            help="With --static-layer: this value becomes 253, as in Nav2 lyrical and newer; none "
            "as before and in ROS 1.  [default: 99]",
        ),
    ] = None,
    *,
    settings: Settings,
) -> None:
    """Write a grid in another format or on another scale."""
    layer = opt.given(
        lethal_threshold=lethal_threshold, trinary=trinary_costmap, track_unknown=track_unknown
    )
    if inscribed_value is not None:
        layer["inscribed_value"] = _number_or_none(inscribed_value)
    if layer and not static_layer:
        words = {"trinary": "--trinary-costmap"}
        name = next(iter(layer))
        option = words.get(name, f"--{name.replace('_', '-')}")
        raise ParameterError("needs --static-layer", source=option)
    figures = convert_file(
        source,
        output,
        settings,
        encoding=encoding,
        mode=mode,
        static_layer=layer if static_layer else None,
    )
    say_written(output, figures)


def _number_or_none(text: str) -> int | None:
    if text == "none":
        return None
    try:
        if not is_plain(text):
            raise ValueError
        return int(text)
    except ValueError:
        rule = "must be a whole number from 0 to 100, or none"
        raise ParameterError(rule, source="--inscribed-value", got=text) from None
