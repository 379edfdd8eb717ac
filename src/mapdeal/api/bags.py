"""Maps out of bags, and maps of the scans in them."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Any, Literal

from mapdeal.commands.build import BuildSettings, build
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.frame import Point
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.kernels.threads import use_threads
from mapdeal.mapping.beams import BeamLimits
from mapdeal.mapping.build import BuiltMap, Method
from mapdeal.mapping.transforms import Pose, check_pose
from mapdeal.pipeline.settings import Settings


def read_map_from_bag(
    path: str | PathLike[str],
    topic: str | None = None,
    *,
    index: int = -1,
    read_as: Literal["map", "costs"] | None = None,
    max_memory: int | None = None,
) -> OccupancyGrid | Costmap:
    """Read a map or costmap from a bag, like ``mapdeal convert BAG``.

    Parameters
    ----------
    path : path or str
        A ROS 1 ``.bag``, a folder with a ROS 2 bag, or a ``.db3`` or ``.mcap`` file.
    topic : str, optional
        Topic of type nav_msgs/OccupancyGrid or nav2_msgs/Costmap. It can be omitted if the bag
        has only one.
    index : int
        Index of the message in recording order; negative values count from the last.
    read_as : {'map', 'costs'}, optional
        Meaning of the values of an OccupancyGrid. By default they are costs if the topic name
        contains ``costmap``, otherwise a map.
    max_memory : int, optional
        Memory limit, bytes; by default half of the free memory.

    Returns
    -------
    OccupancyGrid or Costmap
        The map, or the costs on the scale of the message.

    Raises
    ------
    ParameterError
        If the extra ``bags`` is not installed, or `index` is out of range.
    FileAccessError, MalformedInputError
        If the bag cannot be read, or has no such topic.

    Warns
    -----
    MapdealWarning
        If the bag is damaged; the intact part is read.
    """
    from mapdeal.pipeline.bag_maps import grid_topic

    settings = Settings(max_memory=max_memory)
    with settings.memory(), grid_topic(Path(path), topic, read_as=read_as) as found:
        return found.read(index).grid


def build_map_from_bag(
    path: str | PathLike[str],
    topics: Sequence[str] = (),
    *,
    method: Method = "log-odds",
    resolution: float = 0.05,
    size: Point | None = None,
    origin: Point | None = None,
    range_min: float = 0.0,
    range_max: float = 30.0,
    clear_max: float = 0.0,
    fixed_frame: str | None = None,
    base_frame: str | None = None,
    odometry: str | None = None,
    poses: str | PathLike[str] | None = None,
    mount: Pose | None = None,
    deskew: bool = False,
    max_memory: int | None = None,
    threads: int | None = None,
    **parameters: Any,
) -> BuiltMap:
    """Build a map from the laser scans in a bag, like ``mapdeal build BAG``.

    Parameters
    ----------
    path : path or str
        A ROS 1 ``.bag``, a folder with a ROS 2 bag, or a ``.db3`` or ``.mcap`` file.
    topics : sequence of str
        Topics of type sensor_msgs/LaserScan. They can be omitted if the bag has only one.
    method, resolution, size, origin, range_min, range_max, clear_max, **parameters
        As for `build_map`.
    fixed_frame : str, optional
        Frame of the map. By default ``map`` if the transforms include it, otherwise ``odom``.
    base_frame : str, optional
        Frame of the robot. By default ``base_link``, or else ``base_footprint``.
    odometry : str, optional
        Odometry topic to use if no transforms lead to the robot.
    poses : path or str, optional
        File of robot poses that replaces the transforms: ``t x y z qx qy qz qw`` on each line.
    mount : tuple of float, optional
        x, y (metres) and yaw (radians) of the sensor on the robot, if no transform defines it.
    deskew : bool
        Whether to use the pose at the time of each beam rather than of each scan.
    max_memory : int, optional
        Memory limit, bytes; by default half of the free memory.
    threads : int, optional
        Number of threads; by default one per core.

    Returns
    -------
    BuiltMap
        The map, its evidence and the beam counts.

    Raises
    ------
    ParameterError
        If the extra ``bags`` is not installed, or a parameter is invalid.
    FileAccessError, MalformedInputError
        If the bag cannot be read or has no scans, or no transforms lead to the sensor.

    Warns
    -----
    MapdealWarning
        If scans were skipped or a choice had to be made, and as for `build_map_from_log`.
    """
    from mapdeal.pipeline.bag_sensors import FrameOptions, scans_of_bag

    settings = Settings(max_memory=max_memory, threads=threads)
    limits = BeamLimits(range_min, range_max, clear_max)
    how = BuildSettings({method: parameters}, limits, resolution, size, origin)
    frames = FrameOptions(
        fixed_frame,
        base_frame,
        None if poses is None else Path(poses),
        odometry,
        None if mount is None else check_pose(mount, "mount"),
    )
    with (
        settings.memory(),
        use_threads(settings.threads),
        scans_of_bag(Path(path), topics, frames, deskew=deskew) as scans,
    ):
        return build(scans, how, settings)
