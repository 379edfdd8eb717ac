"""``mapdeal convert``: a map, costmap or field in another format or on another scale."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from mapdeal.cli import bag_options as bag_opt
from mapdeal.cli import options as opt
from mapdeal.cli import terminal
from mapdeal.cli.shared_options import shared_options
from mapdeal.cli.stage_command import say_written
from mapdeal.cli.streams import TO_STDOUT
from mapdeal.commands.convert import BagTopic, Scale, convert_all, convert_file
from mapdeal.errors import ParameterError
from mapdeal.maps.map_yaml import Mode
from mapdeal.pipeline.settings import Settings
from mapdeal.stages.definition import is_plain

app = typer.Typer(rich_markup_mode=None, add_completion=False)


@app.command()
@shared_options("files")
def convert(
    source: opt.MapArgument,
    output: Annotated[
        Path,
        opt.output_argument(
            "OUT",
            "The result: .yaml or .pgm (a pgm pair), .png (a png pair), or .npz; for a bag to "
            "replay .mcap, .db3 (a folder of ROS 2) or .bag (ROS 1); with --all a folder. "
            + opt.OR_STDOUT,
        ),
        TO_STDOUT,
    ],
    topic: str | None = None,
    index: Annotated[int | None, bag_opt.index_option("Reading a bag")] = None,
    takes_all: Annotated[bool, typer.Option("--all")] = False,
    read_as: Literal["map", "costs"] | None = None,
    frame_id: str | None = None,
    encoding: Scale | None = None,
    mode: Mode | None = None,
    static_layer: bool = False,
    lethal_threshold: int | None = None,
    trinary_costmap: bool | None = None,
    track_unknown: bool | None = None,
    inscribed_value: str | None = None,
    *,
    settings: Settings,
) -> None:
    """Convert a map to another format or scale, or from or to a bag.

    Options
    -------
    --topic TOPIC: With a bag: topic to read, if there are several, or to write.  [default: /map,
        or /costmap for costs]
    --read-as: Reading a bag: what an OccupancyGrid contains.  [default: costs if the topic's name
        contains costmap, else a map]
    --frame-id FRAME: Writing a bag: frame_id of the header.  [default: map]
    --encoding: Scale of the values: what ROS publishes, costmap_2d's bytes, or the map as amcl
        sees it.  [default: an .npz keeps its own, pixels of costs are occupancy]
    --mode: How values become pixels.  [default: raw if there are values 1..99, else trinary]
    --static-layer: With --encoding costmap2d: compute costs as costmap_2d's static layer does,
        instead of round(2.54 v).
    --lethal-threshold N: With --static-layer: lethal_cost_threshold, 0..100.  [default: 100]
    --trinary-costmap/--no-trinary-costmap: With --static-layer: values below the threshold become
        0.  [default: yes]
    --track-unknown/--no-track-unknown: With --static-layer: unknown cells stay unknown.  [default:
        yes]
    --inscribed-value N|none: With --static-layer: this value becomes 253, as in Nav2 lyrical and
        newer; none as in older releases and ROS 1.  [default: 99]
    --all: Reading a bag: write all messages into a folder.
    """
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
    of_bag = BagTopic(topic, index, read_as, frame_id)
    if takes_all:
        given = {"--mode": mode, "--static-layer": static_layer, "--image": settings.image}
        for name, value in {**given, "--encoding": encoding == "amcl"}.items():
            if value:
                raise ParameterError("cannot be given together with --all", source=name)
        scale = None if encoding == "amcl" else encoding
        count = convert_all(
            source, output, settings, encoding=scale, of_bag=of_bag, progress=terminal.counted
        )
        terminal.summary([f"{output}: {count} of {source}"])
        return
    figures = convert_file(
        source,
        output,
        settings,
        encoding=encoding,
        mode=mode,
        static_layer=layer if static_layer else None,
        of_bag=of_bag,
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
