"""Maps out of bags, and maps of the scans in them."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Any, Literal

from mapdeal.grid.coordinates import Point
from mapdeal.grid.costmap import Costmap
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.kernels.threads import use_threads
from mapdeal.mapping.beams import BeamLimits
from mapdeal.mapping.build import BuiltMap, Method
from mapdeal.mapping.poses import Pose, check_pose
from mapdeal.pipeline.build import BuildSettings, build
from mapdeal.pipeline.settings import Settings


def read_map_from_bag(
    path: str | PathLike[str],
    topic: str | None = None,
    *,
    index: int = -1,
    read_as: Literal["map", "costs"] | None = None,
    max_memory: int | None = None,
) -> OccupancyGrid | Costmap:
    """Read a map or costmap of a bag, as ``mapdeal convert BAG`` does.

    Parameters
    ----------
    path : path or str
        A ROS 1 ``.bag``, a folder with a ROS 2 bag, or a ``.db3`` or ``.mcap`` file.
    topic : str, optional
        Of nav_msgs/OccupancyGrid or nav2_msgs/Costmap; not needed where only one fits.
    index : int
        Which message, in the order of their recording: from 0 on, or from the last back.
    read_as : {'map', 'costs'}, optional
        What the values of an OccupancyGrid are; by default costs if the topic's name holds
        ``costmap``, else a map.
    max_memory : int, optional
        Bytes of memory that may be used; half of what is free if not given.

    Returns
    -------
    OccupancyGrid or Costmap
        Costs on the scale of the message.

    Raises
    ------
    ParameterError
        If the extra ``bags`` is not installed, or there are not so many messages.
    FileAccessError, MalformedInputError
        If the bag cannot be read, or has no such topic.

    Warns
    -----
    MapdealWarning
        If the bag is damaged; the intact part is read.
    """
    from mapdeal.pipeline.bags.grids import grid_topic

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
    """Make a map of the laser scans in a bag, as ``mapdeal build BAG`` does.

    Parameters
    ----------
    path : path or str
        A ROS 1 ``.bag``, a folder with a ROS 2 bag, or a ``.db3`` or ``.mcap`` file.
    topics : sequence of str
        Of sensor_msgs/LaserScan; not needed where there is only one.
    method, resolution, size, origin, range_min, range_max, clear_max, **parameters
        As of `build_map`.
    fixed_frame : str, optional
        The frame of the map; map if transforms lead there, else odom.
    base_frame : str, optional
        The frame of the robot; base_link, or else base_footprint.
    odometry : str, optional
        The topic of odometry to take where no transforms lead to the robot.
    poses : path or str, optional
        The robot's poses in the place of transforms: ``t x y z qx qy qz qw`` a line.
    mount : tuple of float, optional
        x, y (metres) and yaw (radians) of the sensor on the robot, where no transform gives it.
    deskew : bool
        Whether each beam has the pose of its own time.
    max_memory : int, optional
        Bytes of memory that may be used; half of what is free if not given.
    threads : int, optional
        Threads to compute with; all processors if not given.

    Returns
    -------
    BuiltMap
        The map, the evidence, and the counts of the beams.

    Raises
    ------
    ParameterError
        If the extra ``bags`` is not installed, or a parameter is not allowed.
    FileAccessError, MalformedInputError
        If the bag cannot be read, has no scans, or no transforms lead to their sensor.

    Warns
    -----
    MapdealWarning
        Of scans that were left out, of what had to be chosen, and as `build_map_from_log`.
    """
    from mapdeal.pipeline.bags.frames import FrameOptions
    from mapdeal.pipeline.bags.scans import scans_of_bag

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
