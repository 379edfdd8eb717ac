"""Stage ``clean``: a map without specks, pinholes and islands of free space."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, NamedTuple

import numpy as np

from mapdeal import command, errors, records
from mapdeal.grid.field import FieldView
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.grid.values import FREE, OCCUPIED, UNKNOWN, OneLineRepr, count_text
from mapdeal.kernels.arrays import Mask, SignedBytes
from mapdeal.kernels.components import labelled
from mapdeal.kernels.distance import beside, dilate_square

_ANY_SIZE = 1 << 62  # more cells than a map can have


class Patches(NamedTuple):
    components: int
    cells: int

    def __str__(self) -> str:
        return f"{self.components} ({count_text(self.cells, 'cell')})"


@records.dataclass(frozen=True)
class CleanCounts:
    """Changes made by each step of `clean`, in the order of the steps."""

    free_holes: Patches
    islands: Patches
    wall_holes: Patches
    specks: Patches
    changed: int

    def steps(self) -> dict[str, Patches]:
        return {name: value for name, value in vars(self).items() if name != "changed"}


@records.dataclass(frozen=True, eq=False, repr=False)
class Cleaned(OneLineRepr):
    """Result of `clean`: a map without its small components, and the changes made.

    Parameters
    ----------
    grid : OccupancyGrid
        Cleaned map, with the geometry of the original.
    counts : CleanCounts
        Changes made by each step.
    limits : dict of str to int
        Parameters of `clean` by name.
    """

    grid: OccupancyGrid
    counts: CleanCounts
    limits: Mapping[str, int] = records.field(default_factory=dict)

    def document(self) -> dict[str, object]:
        """Return limits and counts as values that JSON can represent."""
        steps = {name: patches._asdict() for name, patches in self.counts.steps().items()}
        return {"limits": dict(self.limits), **steps, "changed": self.counts.changed}

    def lines(self) -> Iterator[str]:
        """Yield what ``mapdeal clean`` prints of the changes."""
        counts = self.counts
        yield f"  pinholes          {counts.free_holes} are now free, {counts.wall_holes} occupied"
        yield f"  islands           {counts.islands} are now unknown"
        yield f"  small components  {counts.specks} are now free"
        yield f"  changed           {count_text(counts.changed, 'cell')}"

    def _repr_parts(self) -> Iterator[str]:
        yield f"{count_text(self.counts.changed, 'cell')} changed"
        for name, patches in self.counts.steps().items():
            yield f"{patches.components} {name}"


# In maps of real robots at 5 cm, most specks of noise have one or two cells, most holes between
# beams fewer than ten, and most islands behind walls and windows fewer than a hundred.
@command.stage(
    name="clean",
    group="Changing a map",
    example="""\
mapdeal clean examples/maps/office_cartographer.yaml -o out/clean.yaml \\
    --image out/clean.png""",
    product="cleaned",
    summary="Remove small components, pinholes and islands of free space.",
    details="No wall is opened: an obstacle is removed only if all cells around it are free, and a "
    "hole is filled only if all cells around it are free or all are occupied. Values 1..99 stay.",
    title=lambda _: "cleaned",
    memory=16.0,  # a label of 4, sizes of up to half as many components, and masks
    of_library=25_000_000,
    is_whole=lambda _: True,
    edits=True,
    shows_changes=True,
)
def clean(
    grid: OccupancyGrid,
    *,
    min_obstacle: Annotated[int, command.AT_LEAST_0, command.CELLS] = 3,
    min_hole: Annotated[int, command.AT_LEAST_0, command.CELLS] = 10,
    min_free: Annotated[int, command.AT_LEAST_0, command.CELLS] = 100,
) -> Cleaned:
    """Remove the small components of a map: specks, pinholes and islands of free space.

    Parameters
    ----------
    grid : OccupancyGrid
        Map to clean. Values 1..99 are neither free nor occupied: they stay, and so does any
        obstacle or hole that touches one.
    min_obstacle : int
        Remove obstacles with fewer cells (8-connected) from free space; 0 or 1 for none. All cells
        around them must be free.
    min_hole : int
        Fill unknown areas with fewer cells (8-connected) that only free cells, or only occupied
        cells, surround; 0 or 1 for none.
    min_free : int
        Make free areas with fewer cells unknown, except the largest; 0 or 1 for none. They are
        4-connected, because no robot passes between two obstacles that share a corner. Areas
        beside cells of value 1..99 stay, because they may continue there.

    Returns
    -------
    Cleaned
        Cleaned map and counts of the changes.

    Raises
    ------
    ParameterError
        If `grid` is not a map of free, occupied and unknown cells, or a number of cells is
        negative or not an integer.

    Warns
    -----
    MapdealWarning
        If nothing changes.

    Notes
    -----
    Cells beyond the edges of the map count as unknown. Holes in free space are filled first, which
    joins areas separated by gaps between beams; islands, holes in walls, and obstacles follow. In
    this order a second pass changes nothing. No wall is opened.

    Examples
    --------
    >>> grid = OccupancyGrid([[0, 0, 0, 0, 100, 0], [0, 100, 0, 0, 100, -1], [0, 0, 0, 0, 100, -1]],
    ...                      0.05, (1.0, 2.0, 0.0))
    >>> cleaned = clean(grid, min_obstacle=2, min_free=3)
    >>> cleaned.grid.occupancy.tolist()
    [[0, 0, 0, 0, 100, -1], [0, 0, 0, 0, 100, -1], [0, 0, 0, 0, 100, -1]]
    >>> cleaned.counts.specks, cleaned.counts.islands
    (Patches(components=1, cells=1), Patches(components=1, cells=1))
    """
    if not isinstance(grid, OccupancyGrid) or isinstance(grid, FieldView):
        rule = "takes a map with free, occupied and unknown cells"
        hint = "clean the map first, then compute costs or distances from it"
        raise errors.ParameterError(rule, place="clean", got=type(grid).__name__, hint=hint)
    limits = {"min_obstacle": min_obstacle, "min_hole": min_hole, "min_free": min_free}
    least_obstacle, least_hole, least_free = (min(limit, _ANY_SIZE) for limit in limits.values())
    before = np.asarray(grid.occupancy)
    values = before.copy()
    free_holes = _replace(values, UNKNOWN, least_hole, around=FREE, value=FREE)
    islands = _forget_islands(values, least_free)
    wall_holes = _replace(values, UNKNOWN, least_hole, around=OCCUPIED, value=OCCUPIED)
    specks = _replace(values, OCCUPIED, least_obstacle, around=FREE, value=FREE)
    changed = int(np.count_nonzero(values != before))
    if not changed:
        between = int(np.count_nonzero(_between(before)))
        note = f"; {count_text(between, 'cell')} of 1..99 stay as they are" if between else ""
        errors.emit_warning(f"clean: nothing has changed{note}")
    counts = CleanCounts(free_holes, islands, wall_holes, specks, changed)
    return Cleaned(grid.with_values(values), counts, limits)


def _forget_islands(values: SignedBytes, least: int) -> Patches:
    areas = labelled(values == FREE, corners=False) if least > 1 else None
    if areas is None or len(areas.sizes) == 1:
        return Patches(0, 0)
    sizes = areas.sizes
    sizes[areas.touched_by(beside(_between(values)))] = 0
    is_small = (sizes > 0) & (sizes < least)
    is_small[sizes.argmax()] = False
    return _set(values, areas.cells_of(is_small), UNKNOWN, is_small)


def _replace(values: SignedBytes, old: int, least: int, *, around: int, value: int) -> Patches:
    """Set small groups of old values, in place, if all cells around them equal `around`."""
    if least <= 1:
        return Patches(0, 0)
    marked = values == old
    groups = labelled(marked, corners=True)
    is_small = groups.sizes < least
    is_small[0] = False
    is_small &= ~groups.touched_by(_near(~marked & (values != around)) & marked)
    return _set(values, groups.cells_of(is_small), value, is_small)


def _set(values: SignedBytes, cells: Mask, value: int, chosen: Mask) -> Patches:
    values[cells] = value
    return Patches(int(np.count_nonzero(chosen)), int(np.count_nonzero(cells)))


def _near(stops: Mask) -> Mask:
    """Return the cells with a neighbour in a mask, and those at the edge of the map."""
    near = dilate_square(stops, 1)
    near[[0, -1]] = True
    near[:, [0, -1]] = True
    return near


def _between(values: SignedBytes) -> Mask:
    return (values > FREE) & (values < OCCUPIED)
