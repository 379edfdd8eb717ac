"""Map files that are open, and what makes a format of maps."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, TypeVar

from mapdeal import errors, records
from mapdeal.files.source import FileState, check_state, head_of, sha256_of, state_of
from mapdeal.files.transaction import locked
from mapdeal.grid import costmap, reach
from mapdeal.grid.field import DistanceField, PotentialField
from mapdeal.grid.frame import Figures, Frame
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.kernels import arrays, blocks
from mapdeal.maps.dialects import Dialect, MapMetadata
from mapdeal.maps.picture import warn_of

Grid = OccupancyGrid | costmap.Costmap | DistanceField | PotentialField | reach.Reach
G = TypeVar("G", bound=Grid)
Painting = tuple[arrays.Bytes, str]
"""Grey pixels of an image, row 0 in the south, and its comment."""

_HALF_WAY = 50  # A cost that is low on either scale
NOTHING_KNOWN = "every cell is unknown; are the thresholds, mode and negate right?"


@records.dataclass(frozen=True)
class Source:
    grid: Grid
    files: tuple[Path, ...]
    metadata: MapMetadata | None = None
    sums: Mapping[str, str] = records.field(default_factory=dict)


class MapFile(ABC):
    metadata: MapMetadata | None = None  # the YAML of a pair
    shape_by_rows: tuple[int, int] | None = None  # if `by_rows` reads rows in any order
    has_lazy_rows = False  # whether `by_rows` reads them, but only in order

    def __init__(self, path: Path, states: Mapping[Path, FileState] | None = None) -> None:
        self.path = path
        self._states = states or {path: state_of(path)}
        self.files = tuple(self._states)

    @abstractmethod
    def frame(self) -> Frame:
        """Return the frame, from the header."""

    @abstractmethod
    def memory_to_read(self) -> int:
        """Return the peak memory of `cells` in bytes, estimated from the header."""

    @abstractmethod
    def cells(self) -> Grid: ...

    def rows(self, block_height: int, budget: blocks.CacheBudget | None) -> Grid:
        raise ValueError(f"{self.path} cannot be read by rows")

    def layers_of(self, kind: type[G]) -> G | None:
        """Return a grid with more layers than a map, if the file has them."""
        return None

    def painting(self) -> Painting | None:
        """Return the image that a pair of this map shall have, if it is another than usual."""
        return None

    def trajectories(self) -> Mapping[int, Any]:
        return {}

    def described(self) -> dict[str, Any]:
        """Return what `info` says besides the figures of the grid."""
        return {}

    def evidence(self) -> dict[str, arrays.Array]:
        return {}

    def remark(self, grid: Grid) -> None:
        if isinstance(grid, costmap.Costmap):
            warn_of_cost_figures(self.path, grid.figures())
        elif isinstance(grid, OccupancyGrid):
            warn_of_nothing_known(self.path, grid.occupancy)

    def shape(self) -> tuple[int, int]:
        return self.frame().shape

    def read(self) -> Source:
        with blocks.activity(f"reading {self.path.name}"):
            grid = self.cells()
            self.check_unchanged()
            self.remark(grid)
            return Source(grid, self.files, self.metadata)

    def by_rows(self, *, block_height: int, budget: blocks.CacheBudget | None = None) -> Source:
        self.check_unchanged()
        grid = self.rows(block_height, budget)
        self.remark(grid)
        return Source(grid, self.files, self.metadata)

    def sums_by_name(self, known_sums: Mapping[Path, str]) -> dict[str, str]:
        """Return the sha256 of each file by name: a known one, or that of the file as it is now."""
        sums = {path.name: known_sums.get(path) or sha256_of(path) for path in self.files}
        self.check_unchanged()
        return sums

    def check_unchanged(self) -> None:
        # Another process may have replaced the image and the YAML file between our two reads.
        with locked({path.parent for path in self.files}):
            pass  # wait until a concurrent writer has renamed both files
        for path, state in self._states.items():
            check_state(path, state)


@records.dataclass(frozen=True)
class MapFormat:
    """A format of map files; `formats.FORMATS` lists all of them."""

    name: str  # in errors, such as "an .npz written by mapdeal"
    endings: tuple[str, ...]
    open: Callable[[Path, ExitStack, Dialect, int | None], MapFile]
    magic: tuple[bytes, ...] = ()  # first bytes of every file; empty if there are none
    is_yaml: bool = False  # lint explains a header in YAML line by line, and repairs it
    in_folders: bool = True
    is_map: Callable[[Path], bool] = lambda _: True
    header: Callable[[Path], Path] = lambda path: path
    grids: tuple[type[Any], ...] = ()  # kinds of grids that can be written
    write: Callable[..., None] | None = None  # (transaction, path, grid, **options of write_grid)
    paths: Callable[[Path], tuple[Path, ...]] = lambda path: (path,)
    images: tuple[str, ...] = ()  # endings of images, whose pixels have one of several modes
    takes_resolution: bool = False
    yields_to_yaml: bool = False  # skipped in folders beside a map in YAML of the same name
    requests_rows: bool = False  # its writer requests rows, which other files then receive

    @property
    def sign(self) -> str:
        """Text for errors that no file of this format was found."""
        return f"{self.endings[0]} with the key image" if self.is_yaml else self.endings[0]

    def holds_map(self, path: Path) -> bool:
        """Return whether a file with one of the endings is a map, possibly a broken one."""
        with suppress(errors.FileAccessError):  # reading it as a map reports the error
            if self.magic and not head_of(path, max(map(len, self.magic))).startswith(self.magic):
                return False
        return self.is_map(path)

    def can_hold(self, kind: type[Any]) -> bool:
        return issubclass(kind, self.grids)


def warn_of_nothing_known(path: Path, occupancy: blocks.Layer, *, has_pixels: bool = True) -> None:
    """Warn of a map without any known cell; a lazy map is read up to its first known cell."""
    if blocks.holds_everywhere(occupancy, lambda values: values < 0):
        warn_of(path, NOTHING_KNOWN if has_pixels else "every cell is unknown", "map.all-unknown")


def warn_of_cost_figures(path: Path, figures: Figures) -> None:
    if (common := figures["most_common"]) is None:
        is_blocked = figures["lethal"] + figures.get("inscribed", 0) > 0
        finding = "known cell is lethal or inscribed" if is_blocked else "cell is unknown"
        warn_of(path, f"every {finding}", "run.uniform-cost")
    elif common["share"] > costmap.UNIFORM_SHARE:
        advice = "a higher cost_scaling_factor, or the metric view, grades more of them"
        if not figures["lethal"]:
            advice = "there is no obstacle"
        elif common["cost"] < _HALF_WAY:
            advice = "a larger inflation_radius, or lower up and down, grade more of them"
        finding = f"{100 * common['share']:.4g} % of the open cells cost {common['cost']}"
        warn_of(path, f"{finding}: {advice}", "run.uniform-cost")
