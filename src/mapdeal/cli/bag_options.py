"""Options of commands that read bags."""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mapdeal.cli import options as opt
from mapdeal.errors import ParameterError

if TYPE_CHECKING:
    from mapdeal.pipeline.bag_sensors import BagClouds, BagScans, FrameOptions


def index_option(condition: str) -> Any:
    return typer.Option(
        metavar="N",
        help=f"{condition}: index of the message, from 0, or from the end, -1.  "
        "[default: the last]",
    )


def _option(metavar: str, help_text: str, *names: str) -> Any:
    return typer.Option(*names, metavar=metavar, help=f"With a bag: {help_text}")


Topics = Annotated[
    list[str] | None,
    _option("TOPIC", "topic to read, if there are several. Can be repeated.", "--topic"),
]
FixedFrame = Annotated[
    str | None, _option("FRAME", "frame of the map.  [default: map, or else odom]")
]
BaseFrame = Annotated[
    str | None,
    _option("FRAME", "frame of the robot.  [default: base_link, or else base_footprint]"),
]
Odometry = Annotated[
    str | None, _option("TOPIC", "odometry topic, for bags without transforms to the robot.")
]
Mount = Annotated[
    str | None,
    _option("X,Y,YAW", "pose of the sensor on the robot, if no transform gives it."),
]


@dataclass(frozen=True)
class BagWords:
    """What was given of the options of bags."""

    topics: list[str] | None = None
    fixed_frame: str | None = None
    base_frame: str | None = None
    odometry: str | None = None
    mount: str | None = None
    deskew: bool = False

    def refuse(self, rule: str) -> None:
        named = {
            "--topic": self.topics,
            "--fixed-frame": self.fixed_frame,
            "--base-frame": self.base_frame,
            "--odometry": self.odometry,
            "--mount": self.mount,
            "--deskew": self.deskew,
        }
        for name, value in named.items():
            if value:
                raise ParameterError(rule, source=name)

    def frames(self, poses: Path | None) -> FrameOptions:
        from mapdeal.pipeline.bag_sensors import FrameOptions  # not loaded where there is no bag

        mount = None
        if self.mount is not None:
            x, y, yaw = opt.numbers(self.mount, 3, "X,Y,YAW", "--mount")
            mount = x, y, yaw
        return FrameOptions(self.fixed_frame, self.base_frame, poses, self.odometry, mount)

    def clouds(
        self, path: Path, poses: Path | None, *, has_poses: bool, is_raw: bool
    ) -> AbstractContextManager[BagClouds]:
        """Open the clouds of a bag."""
        from mapdeal.pipeline.bag_sensors import clouds_of_bag

        frames = self.frames(poses)
        return clouds_of_bag(path, self.topics or [], frames, has_poses=has_poses, is_raw=is_raw)

    def scans(self, path: Path, poses: Path | None) -> AbstractContextManager[BagScans]:
        from mapdeal.pipeline.bag_sensors import scans_of_bag

        return scans_of_bag(path, self.topics or [], self.frames(poses), deskew=self.deskew)
