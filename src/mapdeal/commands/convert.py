"""A grid from one format or scale to another, file to file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from mapdeal.bags.bag import BAG_OUTPUTS, bag_paths
from mapdeal.errors import ParameterError
from mapdeal.files.transaction import Transaction
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.field import DistanceField, FieldView
from mapdeal.grid.framed import Figures
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.potential import PotentialField
from mapdeal.inputs.kinds import is_bag
from mapdeal.maps.map_server import in_trinary
from mapdeal.maps.map_yaml import Mode
from mapdeal.maps.npz import Grid
from mapdeal.maps.reading import Source, output_paths, write_grid
from mapdeal.maps.remarks import warn_of_nothing_known, warn_of_one_cost
from mapdeal.pipeline.inputs import add_picture, claim_work, errors_named, outputs_of, read_input
from mapdeal.pipeline.settings import ProgressCallback, Settings, report_nothing
from mapdeal.stages.esdf import field_view

Scale = Literal["occupancy", "costmap2d", "amcl"]


@dataclass(frozen=True)
class BagTopic:
    """Which topic of a bag is read or written."""

    topic: str | None = None
    index: int | None = None
    read_as: Literal["map", "costs"] | None = None
    frame: str | None = None


ANY_TOPIC = BagTopic()
"""The only topic that fits, and its last message."""


def convert_file(
    path: Path,
    output: Path,
    options: Settings,
    *,
    encoding: Scale | None = None,
    mode: Mode | None = None,
    static_layer: Mapping[str, Any] | None = None,
    of_bag: BagTopic = ANY_TOPIC,
) -> Figures:
    """Read a grid and write it in another format; return its figures."""
    writes_bag = output.suffix in BAG_OUTPUTS
    outputs = bag_paths(output) if writes_bag else output_paths(output)
    reads_bag = is_bag(path)
    _check_words(of_bag, reads_bag=reads_bag, writes_bag=writes_bag)
    if writes_bag and mode is not None:
        raise ParameterError("applies to pixels, not to bags", source="--mode", got=mode)
    if static_layer is not None and encoding != "costmap2d":
        raise ParameterError("needs --encoding costmap2d", place="--static-layer")
    source = _read_bag(path, of_bag, options) if reads_bag else read_input(path, options)
    with options.memory():
        claim_work(path, source.grid, _per_cell(source.grid, mode, drawn=options.image is not None))
    with outputs_of(outputs, source.files, options) as transaction:
        with errors_named(path):
            grid = _converted(source.grid, encoding, static_layer)
        if writes_bag:
            _write_bag(transaction, output, grid, of_bag)
            add_picture(transaction, options, grid, path.stem)
            return grid.figures()
        if isinstance(grid, DistanceField) and output.suffix != ".npz":
            grid, mode = field_view(grid), mode or "raw"
        if isinstance(grid, FieldView) and mode not in (None, "raw"):
            grid = grid.as_map()
        if isinstance(grid, OccupancyGrid) and mode == "trinary":
            grid = in_trinary(grid)
        extra = dict(source.metadata.extra) if source.metadata else {}
        pixels: Literal["occupancy", "costmap2d"] = (
            "costmap2d" if encoding == "costmap2d" else "occupancy"
        )
        more = None
        if encoding == "amcl" and isinstance(grid, OccupancyGrid):
            more = {"amcl": grid.amcl_states()}
        write_grid(transaction, output, grid, mode=mode, encoding=pixels, extra=extra, more=more)
        add_picture(transaction, options, grid, path.stem)
    return grid.figures()


def convert_all(
    path: Path,
    folder: Path,
    options: Settings,
    *,
    encoding: Literal["occupancy", "costmap2d"] | None = None,
    of_bag: BagTopic = ANY_TOPIC,
    progress: ProgressCallback = report_nothing,
) -> int:
    """Write all maps or costmaps of a topic into a folder: 0000.yaml, 0001.yaml and so on."""
    from mapdeal.pipeline.bag_maps import grid_topic  # not loaded for maps

    _check_words(of_bag, reads_bag=is_bag(path), writes_bag=False)
    if of_bag.index is not None:
        raise ParameterError("cannot be given together with --all", source="--index")
    with options.memory(), grid_topic(path, of_bag.topic, read_as=of_bag.read_as) as topic:
        digits = max(4, len(str(len(topic) - 1)))
        names = [folder / f"{number:0{digits}}.yaml" for number in range(len(topic))]
        outputs = [one for name in names for one in output_paths(name)]
        with (
            outputs_of(outputs, topic.files, options) as transaction,
            progress(len(topic)) as advance,
        ):
            for number, name in enumerate(names):
                grid = _converted(topic.read(number).grid, encoding, None)
                write_grid(transaction, name, grid, encoding=encoding or "occupancy")
                transaction.wait()
                advance(1)
        return len(topic)


def _check_words(given: BagTopic, *, reads_bag: bool, writes_bag: bool) -> None:
    if not reads_bag:
        for name, value in (("--index", given.index), ("--read-as", given.read_as)):
            if value is not None:
                raise ParameterError("applies to reading bags", source=name)
    if given.frame is not None and not writes_bag:
        raise ParameterError("applies to writing bags", source="--frame-id")
    if given.topic is not None and not (reads_bag or writes_bag):
        raise ParameterError("applies to bags", source="--topic")


def _read_bag(path: Path, given: BagTopic, options: Settings) -> Source:
    from mapdeal.pipeline.bag_maps import grid_topic  # not loaded for maps

    with options.memory(), grid_topic(path, given.topic, read_as=given.read_as) as topic:
        grid = topic.read(-1 if given.index is None else given.index).grid
        files = topic.files
    if isinstance(grid, Costmap):
        warn_of_one_cost(path, grid)
    else:
        warn_of_nothing_known(path, grid.occupancy, has_pixels=False)
    return Source(grid, files)


def _write_bag(transaction: Transaction, output: Path, grid: Grid, given: BagTopic) -> None:
    from mapdeal.bags.write import FRAME, write_bag

    if isinstance(grid, FieldView):
        grid = grid.as_map()
    if not isinstance(grid, (OccupancyGrid, Costmap)):
        rule = f"ROS has no message for a {grid.kind}"
        hint = "mapdeal cost makes costs of it, which ROS has"
        raise ParameterError(rule, source=output, hint=hint)
    write_bag(
        transaction,
        output,
        grid,
        topic=given.topic,
        frame=FRAME if given.frame is None else given.frame,
    )


def _per_cell(grid: Grid, mode: Mode | None, *, drawn: bool) -> float:
    """Return the bytes for each cell that writing takes besides the grid."""
    if isinstance(grid, PotentialField):  # most of its layers are made when they are written
        return 130.0 if drawn else 76.0
    return 12.0 if mode == "scale" else 5.0


def _converted(
    grid: Grid, encoding: Scale | None, static_layer: Mapping[str, Any] | None
) -> Grid:  # fmt: skip
    if encoding is None or (encoding == "occupancy" and not isinstance(grid, Costmap)):
        return grid
    if not isinstance(grid, (OccupancyGrid, Costmap)):
        rule = f"a field has no values of {encoding}"
        raise ParameterError(rule, place="encoding", hint="mapdeal cost makes costs of a map")
    if encoding == "amcl":
        occupancy = grid.to_occupancy() if isinstance(grid, Costmap) else grid
        return occupancy.as_amcl_sees_it()
    if encoding == "occupancy" and isinstance(grid, Costmap):  # as ROS would publish them
        if grid.scale == "occupancy":
            return grid
        values = grid.to_occupancy().occupancy
        return Costmap(values, grid.resolution, grid.origin, "occupancy")
    if isinstance(grid, Costmap) and grid.scale == "costmap2d":
        if static_layer is not None:
            rule = "applies to maps, and these are already costs on its own scale"
            raise ParameterError(rule, place="--static-layer")
        return grid
    occupancy = grid.to_occupancy() if isinstance(grid, Costmap) else grid
    if static_layer is not None:
        return Costmap.from_static_layer(occupancy, **static_layer)
    return Costmap.from_occupancy(occupancy)
