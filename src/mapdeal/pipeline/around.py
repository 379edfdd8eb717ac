"""A robot on the map of a run: the local map that the run makes, too."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from mapdeal.formats.maps import Source, as_occupancy
from mapdeal.formats.source import sha256_of
from mapdeal.mapping.local_options import LocalOptions
from mapdeal.mapping.poses import Pose
from mapdeal.pipeline.applied import around_in
from mapdeal.pipeline.clouds import FileCloud
from mapdeal.pipeline.folder import Filling, OutputFolder
from mapdeal.pipeline.local import (
    GlobalMap,
    LocalCommon,
    LocalJob,
    check_window,
    holding_map,
    local_filling,
    local_folder,
)
from mapdeal.pipeline.recipe import Recipe
from mapdeal.pipeline.settings import Settings
from mapdeal.records import dataclass


@dataclass(frozen=True)
class Around:
    """Where a robot stands on the map of a run, and how its local map is made."""

    pose: Pose
    recipe: Recipe
    options: LocalOptions
    cloud: Path | None = None
    takes_cells: bool = False

    @property
    def files(self) -> tuple[Path, ...]:
        """What is read beside the map."""
        return () if self.cloud is None else (self.cloud,)

    def filling(
        self, folder: Path, source: Source, settings: Settings, heard: Sequence[str]
    ) -> Filling:
        """Return what goes into the local map's folder, given that of the run and its map.

        `heard` is what reading the map has warned of.
        """
        grid = as_occupancy(source.grid, source.files[0])
        known = GlobalMap(grid, source.files, dict(source.sums), heard)
        common = self._common(settings, known.grid.resolution, known)
        cloud = None if self.cloud is None else FileCloud(self.cloud)
        with holding_map(None if known.grid.is_lazy else known):
            return local_filling(LocalJob(cloud, self.pose, around_in(folder)), common)

    def folder(
        self, folder: Path, sums: Mapping[str, str], resolution: float, settings: Settings
    ) -> OutputFolder:
        """Return the local map's folder, given the run's, and sums and cells of its map."""
        cloud = {} if self.cloud is None else {self.cloud.name: sha256_of(self.cloud)}
        common = self._common(settings, resolution)
        check_window(self.cloud or folder, common)
        return local_folder(around_in(folder), self.pose, {**cloud, **sums}, common, has_map=True)

    def _common(
        self, settings: Settings, resolution: float, known: GlobalMap | None = None
    ) -> LocalCommon:
        options = replace(self.options, resolution=resolution) if self.takes_cells else self.options
        return LocalCommon(options, self.recipe, settings, known)
