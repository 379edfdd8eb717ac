"""Alignment: the pose of one map in the frame of another.

Candidates are poses at which the walls of both maps coincide. Each is scored by how well walls and
free space agree.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import count
from typing import Any, NamedTuple

import numpy as np

from mapdeal.compare import walls as wall_maps
from mapdeal.compare.walls import Bend, Floats, Poses, Singles, WallMap, moved, moved_back, walls_of
from mapdeal.errors import ParameterError
from mapdeal.grid import frame, values
from mapdeal.grid.occupancy import OccupancyGrid
from mapdeal.kernels.arrays import Array, Integers, Mask
from mapdeal.kernels.rotations import hough_spectrum, inverse_matrices, main_direction
from mapdeal.kernels.threads import in_parallel
from mapdeal.records import dataclass, replace

_DIRECTIONS = 360  # of a Hough spectrum, over half a turn
_MOST_PEAKS, _WIDENED_PEAKS = 3, 2
"""Peaks of the correlation that are tried; the first two also with `_PEAK_ERROR` on both sides."""
_PEAK_ERROR = math.radians(1.2)  # of small overlaps; candidates one degree off cannot be refined
_LEAST_STRIP = 0.1  # metres: least width of the strips in which a Hough spectrum counts walls
_MOST_COUNTED = 4000  # faces


def yaws_by_walls(first: WallMap, second: WallMap) -> Floats:
    """Return the yaws at which the walls of both maps run in the same directions."""
    # S. Carpin, "Fast and accurate map merging for multi-robot systems", Autonomous Robots 25,
    # 2008: yaws are the peaks of the circular correlation of two Hough spectra.
    width = max(_LEAST_STRIP, first.resolution, second.resolution)
    angles = np.arange(_DIRECTIONS, dtype=np.float64) * (math.pi / _DIRECTIONS)
    faces = [walls.some_faces(_MOST_COUNTED)[0].astype(np.float64) for walls in (first, second)]
    spectra = [hough_spectrum(faces_xy, angles, width) for faces_xy in faces]
    above = [np.maximum(spectrum - np.median(spectrum), 0) for spectrum in spectra]
    transforms = [np.fft.rfft(spectrum - spectrum.mean()) for spectrum in above]
    correlation = np.fft.irfft(np.conj(transforms[0]) * transforms[1], _DIRECTIONS)
    before, after = np.roll(correlation, 1), np.roll(correlation, -1)
    smooth = (before + 2 * correlation + after) / 4
    peaks = np.flatnonzero((smooth >= np.roll(smooth, 1)) & (smooth > np.roll(smooth, -1)))
    peaks = peaks[np.argsort(-smooth[peaks], kind="stable")][:_MOST_PEAKS]
    # each place of a peak is that of the vertex of a parabola through its neighbours
    before, at, after = (smooth[(peaks + step) % _DIRECTIONS] for step in (-1, 0, 1))
    yaws = (peaks + (before - after) / (2 * (before - 2 * at + after))) * math.pi / _DIRECTIONS
    widened = yaws[:_WIDENED_PEAKS]
    yaws = np.concatenate([yaws, widened - _PEAK_ERROR, widened + _PEAK_ERROR])
    return np.stack([yaws, yaws + math.pi], axis=-1).ravel()


_SCORINGS = ((0.5, 0.12), (2.0, 0.05))
"""Penalty of a wall in free space, and reward of free space on free space; a wall on a wall scores
its length in cells. The first scoring suits bent or changed maps, the second small overlaps."""
_MOST_WALL = 1.2  # wall that counts in a cell, in cell sides: more is clutter
_BLOCK = 6  # cells: of each block of shifts with this side, only the best is a candidate


class SearchArea(NamedTuple):
    pose: Poses
    radius: float  # metres between the middles of the first map at both poses


def candidates_at(
    first: WallMap, second: WallMap, yaws: Floats, *, side: int, most_per_yaw: int, most: int,
    area: SearchArea | None = None,
) -> tuple[Poses, float]:  # fmt: skip
    """Return poses of a first map in a second, by scoring, best first, and their accuracy."""
    # A shift's score is a sum over cells: walls on walls raise it, walls of one map in free space
    # of the other lower it. So it is the correlation of the first map's walls, plus that of its
    # free space, with weighted sums of the second map's. Both use FFT.
    correlation = _Correlation(first, second, side)
    scored: list[list[Any]] = [[] for _ in yaws]

    def score(start: int, end: int) -> None:
        for k in range(start, end):
            scored[k] = correlation.best(float(yaws[k]), most_per_yaw, area)

    in_parallel(score, len(yaws))
    poses: list[Poses] = []
    for scoring in range(len(_SCORINGS)):
        rows = np.array([row for tables in scored for row in tables[scoring]]).reshape(-1, 4)
        candidates = rows[:, 1:]
        is_elsewhere = partial(_is_elsewhere, first, candidates, distance=2 * correlation.cell)
        poses.append(candidates[_best_places(rows[:, 0], most, is_elsewhere)])
    return np.concatenate(poses), correlation.cell


class _Correlation:
    """Scores of all shifts at a yaw; holds the sizes and spectra that all yaws share."""

    def __init__(self, first: WallMap, second: WallMap, side: int) -> None:
        self._diagonal = math.hypot(*first.frame.size_xy)
        self._size = np.array(second.frame.size_xy)
        finest = max(first.resolution, second.resolution)
        self.cell = max((self._diagonal + float(self._size.max())) / side, finest)
        sides = (self._diagonal + self._size) / self.cell + 4
        width, height = np.maximum(sides, _BLOCK).astype(int)
        self._shape = _next_5_smooth(int(height)), _next_5_smooth(int(width))
        self._middle = first.middle_xy
        walls, free = (self._splat(xy / self.cell, weights) for xy, weights in self._points(second))
        # single precision, and all x before all y: many points are turned many times
        self._turning = [
            (np.asfortranarray((points - self._middle) / self.cell, dtype=np.float32), weights)
            for points, weights in self._points(first)
        ]
        walls = np.minimum(walls, np.float32(_MOST_WALL))
        blurred = walls
        for axis in (0, 1):  # a wall one cell off counts half
            before, after = np.roll(blurred, 1, axis), np.roll(blurred, -1, axis)
            blurred = (before + 2 * blurred + after) / 4
        blurred = 2 * blurred
        clear = np.maximum(free - blurred, 0)
        self._spectra = [
            (_fft_of(blurred - penalty * clear), _fft_of(reward * free - penalty * walls))
            for penalty, reward in np.array(_SCORINGS, dtype=np.float32)
        ]

    def best(self, yaw: float, most: int, area: SearchArea | None) -> list[list[list[float]]]:
        """Return the best shifts at a yaw for each scoring, as rows of score, yaw, x, y."""
        half = self._diagonal / 2 + self.cell
        cells = half / self.cell
        walls, free = (self._splat(frame.turned(xy, yaw) + cells, w) for xy, w in self._turning)
        walls = np.minimum(walls, np.float32(_MOST_WALL))
        free = np.maximum(free - walls, 0)
        spectra = np.conj(_fft_of(walls)), np.conj(_fft_of(free))
        # shift of the first map at offset (0, 0) of the correlation
        base = half - frame.turned(self._middle[np.newaxis], yaw)[0]
        tables = []
        for for_walls, for_free in self._spectra:
            scores = np.fft.irfft2(spectra[0] * for_walls + spectra[1] * for_free, s=self._shape)
            if area is not None:
                scores = np.where(self._is_inside(yaw, base, area), scores, -np.inf)
            row, col, best = _best_of_blocks(scores, most)
            shifts = self._wrapped(row, col) * self.cell + base
            tables.append([[score, yaw, x, y] for score, (x, y) in zip(best, shifts, strict=True)])
        return tables

    def _wrapped(self, row: Integers, col: Integers) -> Floats:
        width, height = self._size / self.cell
        x = np.where(col <= width, col, col - self._shape[1])
        y = np.where(row <= height, row, row - self._shape[0])
        return np.stack([x, y], axis=-1).astype(np.float64)

    def _is_inside(self, yaw: float, base: Floats, area: SearchArea) -> Mask:
        """Return which shifts move the first map's middle into the search area."""
        expected = moved(area.pose[None], self._middle[None])[0, 0]
        unshifted = moved(np.array([[yaw, *base]]), self._middle[None])[0, 0]
        row, col = np.indices(self._shape).reshape(2, -1)
        offset = self._wrapped(row, col) * self.cell + (unshifted - expected)
        return np.asarray(np.hypot(*offset.T) <= area.radius + self.cell).reshape(self._shape)

    def _points(self, walls: WallMap) -> Iterator[tuple[Floats, Floats | float]]:
        """Yield the points of walls with their weights, then those of free space."""
        yield walls.faces_xy, walls.resolution / self.cell
        # blocks of at most half a cell leave no gaps when they are turned
        factor = max(1, int(self.cell / 2 / walls.resolution))
        counts = wall_maps.pooled(walls.free, factor)
        centres = (np.argwhere(counts)[:, ::-1] + 0.5) * (factor * walls.resolution)
        yield centres, counts[counts > 0] * (walls.resolution / self.cell) ** 2

    def _splat(self, places: Floats, weights: Floats | float) -> Floats:
        col, row = places.astype(np.int32).T
        of_points = np.broadcast_to(np.asarray(weights, dtype=np.float64), row.shape)
        height, width = self._shape
        cells = np.bincount(row * width + col, of_points, height * width)
        return cells.reshape(self._shape).astype(np.float32)


def _fft_of(cells: Floats) -> Array:
    # Without norm="ortho" numpy computes in double precision, which takes four times as long.
    return np.fft.rfft2(cells, norm="ortho")


def _best_of_blocks(scores: Floats, most: int) -> tuple[Integers, Integers, list[float]]:
    height, width = (side // _BLOCK for side in scores.shape)
    full = scores[: height * _BLOCK, : width * _BLOCK]
    blocks = full.reshape(height, _BLOCK, width, _BLOCK)
    best_in_rows = full.reshape(height, _BLOCK, -1).max(axis=1).ravel()
    best = np.maximum.reduce([best_in_rows[k::_BLOCK] for k in range(_BLOCK)])
    top = np.argpartition(best, -min(most, len(best)))[-most:]
    top = top[np.isfinite(best[top])]
    down, right = np.divmod(top, width)
    inside = blocks[down, :, right, :].reshape(len(top), _BLOCK * _BLOCK).argmax(axis=1)
    row, col = down * _BLOCK + inside // _BLOCK, right * _BLOCK + inside % _BLOCK
    return row, col, scores[row, col].tolist()


def _turns(angles: Floats) -> Floats:
    return np.asarray(np.abs(np.mod(angles + math.pi, 2 * math.pi) - math.pi))


def _shifts(first: WallMap, poses: Poses, pose: Poses) -> Floats:
    """Return how far the first map's middle at each pose is from that at another pose."""
    middle = first.middle_xy[None]
    return np.asarray(np.hypot(*(moved(poses, middle) - moved(pose[None], middle))[:, 0].T))


def _next_5_smooth(least: int) -> int:
    # 30**32 is a multiple of all 5-smooth numbers of up to 32 bits
    return next(size for size in count(least) if 30**32 % size == 0)


_DAMPING = 1e-3


def refined(
    first: WallMap, second: WallMap, poses: Poses, scales: Sequence[float], most: int
) -> Poses:
    """Return poses moved to where the walls of both maps are closest to each other."""
    # Gauss-Newton steps on the distances of each map's walls to the other's, in both directions.
    # Geman-McClure weights: walls that only one map has do not pull.
    poses = poses.copy()
    first_faces, second_faces = first.some_faces(most)[0], second.some_faces(most)[0]
    for scale in scales:
        normal, right = np.zeros((len(poses), 3, 3)), np.zeros((len(poses), 3))
        cos, sin = np.cos(poses[:, :1]), np.sin(poses[:, :1])
        points = moved(poses, first_faces)
        distance, x, y = wall_maps.slopes(second, points)
        arm = points - poses[:, None, 1:]
        _add(normal, right, (x, y, y * arm[..., 0] - x * arm[..., 1]), distance, scale)
        points = moved_back(poses, second_faces)
        distance, x, y = wall_maps.slopes(first, points)
        turn = x * points[..., 1] - y * points[..., 0]
        _add(normal, right, (y * sin - x * cos, -x * sin - y * cos, turn), distance, scale)
        diagonal = np.arange(3)
        normal[:, diagonal, diagonal] *= 1 + _DAMPING
        normal[:, diagonal, diagonal] += _DAMPING
        step = (inverse_matrices(normal) * right[:, np.newaxis]).sum(axis=-1)
        poses -= step[:, [2, 0, 1]]
    return poses


def _add(
    normal: Floats, right: Floats, columns: Sequence[Floats], distance: Floats, scale: float
) -> None:
    """Add the normal equations of distances; `columns` are their derivatives by x, y and yaw."""
    counts = distance < wall_maps.FAR * scale
    distance = distance * counts
    weight = counts / (1 + (distance / scale) ** 2) ** 2
    for i, column in enumerate(columns):
        weighted = weight * column
        right[:, i] += (weighted * distance).sum(axis=1)
        for j, earlier in enumerate(columns[: i + 1]):
            normal[:, i, j] += (weighted * earlier).sum(axis=1)
            if i != j:
                normal[:, j, i] = normal[:, i, j]


TOLERANCES = (0.06, 0.12, 0.25, 0.5)
"""Metres within which walls coincide, at least a cell: for exact maps, and for bent ones."""
_SMALL_MAP, _LARGE_MAP = 20.0, 60.0
"""Metres: tolerances shrink with a smaller diagonal, to 3/4, and grow with a larger, to double."""
_BY_CHANCE = (0.28, 0.36, 0.5, 0.66)
"""Share of walls that agree at the best pose of maps of different places, for each tolerance."""
_PIECE, _SHARE_OF_PIECE = 2.0, 0.015
"""Length of wall that counts as one piece of evidence: metres, or a share of all walls if that is
less, since small maps have fewer poses to choose from."""
_FULL_OVERLAP = 0.2  # evidence shrinks in proportion below this overlap
_LARGE = 0.25  # least common walls, of the most, at wrong poses that show the share by chance


@dataclass(frozen=True, eq=False)
class Agreement:
    """Agreement of two maps at K poses, at T tolerances: lengths of wall, metres; shape (K, T)."""

    agreeing: Floats
    contradicting: Floats
    overlap: Floats
    piece: float

    @property
    def shares(self) -> Floats:
        """The share of walls that agree, of those that agree or contradict; shape (K, T)."""
        seen = self.agreeing + self.contradicting
        return np.divide(self.agreeing, seen, out=np.zeros_like(seen), where=seen > 0)

    def by_chance(self, is_wrong: Mask | None = None) -> Floats:
        """Return the share of walls that agree by chance or at wrong poses, shape (T,)."""
        if is_wrong is None or not is_wrong.any():
            return np.array(_BY_CHANCE)
        seen = (self.agreeing + self.contradicting)[is_wrong]
        counted = np.where(seen >= _LARGE * seen.max(axis=0), seen, 0)
        total = counted.sum(axis=0)
        agreeing = (counted * self.shares[is_wrong]).sum(axis=0)
        mean = np.divide(agreeing, total, where=total > 0, out=total * 0)
        return np.asarray(np.maximum(mean, _BY_CHANCE))

    def evidence(self, chance: Floats) -> Floats:
        """Return the evidence against agreement by chance, shape (K,)."""
        # The Kullback-Leibler divergence of the agreeing share from a lower share by chance, times
        # the pieces of wall, averaged over tolerances; less in small overlaps, as few walls fit
        # anywhere.
        pieces = (self.agreeing + self.contradicting) / self.piece
        p, q = np.clip(self.shares, 1e-9, 1 - 1e-9), np.clip(chance, 0.02, 0.98)
        divergence = p * np.log(p / q) + (1 - p) * np.log((1 - p) / (1 - q))
        evidence = (pieces * np.where(self.shares > chance, divergence, 0.0)).mean(axis=1)
        return np.asarray(evidence * np.minimum(self.overlap / _FULL_OVERLAP, 1))


def agreement_at(
    first: WallMap, second: WallMap, poses: Poses, most: int, bend: Bend | None = None,
    weights: tuple[Singles, Singles] | None = None,
) -> Agreement:  # fmt: skip
    bend = bend or Bend.none(first, len(poses))
    agreeing, contradicting = np.zeros((2, len(poses), len(TOLERANCES)))
    known = np.zeros(len(poses))
    cell = max(first.resolution, second.resolution)
    size = min(math.hypot(*walls.frame.size_xy) for walls in (first, second))
    factor = min(max(size / _SMALL_MAP, 0.75), 1.0) * min(max(size / _LARGE_MAP, 1.0), 2.0)
    # 1 % more than a cell allows for rounding
    tolerances = [max(tolerance * factor, 1.01 * cell) for tolerance in TOLERANCES]
    both = (first, second, bend.moved), (second, first, bend.moved_back)
    for number, (own, target, move) in enumerate(both):
        faces, normals = own.some_faces(most)
        metres = np.full(len(faces), own.wall_length / len(faces) / 2)
        if weights is not None:
            metres *= wall_maps.some_of(weights[number], most)
        at = wall_maps.cells_at(target, move(poses, faces))
        distance, is_free = target.padded_distance.take(at), target.padded_free.take(at)
        is_thin = ~normals.any(axis=1)
        for k, tolerance in enumerate(tolerances):
            in_front = faces + normals * np.float32(tolerance + cell)
            at = wall_maps.cells_at(target, move(poses, in_front))
            faces_free = target.padded_free.take(at) | is_thin
            agreeing[:, k] += (((distance <= tolerance) & faces_free) * metres).sum(axis=1)
            contradicting[:, k] += (((distance > tolerance) & is_free) * metres).sum(axis=1)
        row, col = np.divmod(wall_maps.some_of(np.flatnonzero(own.free), most), own.frame.width)
        points = ((np.stack([col, row], axis=-1) + 0.5) * own.resolution).astype(np.float32)
        if len(points):
            at = wall_maps.cells_at(target, move(poses, points))
            known += target.padded_known.take(at).mean(axis=1) * own.free_area / 2
    longest = max(first.wall_length, second.wall_length)
    overlap = np.minimum(known / max(min(first.free_area, second.free_area), 1e-12), 1)
    return Agreement(agreeing, contradicting, overlap, min(_PIECE, _SHARE_OF_PIECE * longest))


_PER_CELL = 6  # bytes for each cell of the larger map while it is pooled
_PER_POOLED, _MOST_POOLED = 40, 2 * wall_maps.MOST_CELLS_A_SIDE**2
"""Bytes for each pooled cell, and the largest number of them in both maps."""


def bytes_to_align(cells: Sequence[int]) -> int:
    return _PER_CELL * max(cells) + _PER_POOLED * min(sum(cells), _MOST_POOLED)


LEAST_SCORE = 4.5
"""Least score, and least lead over the runner-up. In about 350 pairs of maps of different places,
half of them with corridors or rows of equal rooms, the largest lead without a rival was 3.2."""
LEAST_SCORE_IF_SHARED = 2.2
_SHARED_OVERLAP, _SHARED_AGREEMENT, _SHARED_WALLS, _SHARED_LENGTH = 0.66, 0.75, 0.45, 25.0
"""Least score and lead of maps that mostly show the same space, since drift lowers their scores;
and how such maps are recognised: least overlap, share of walls that agree, share of the smaller
map's walls that are compared, and their length, metres. Of 170 pairs of different places none met
these limits with a lead above 0.3; of 113 mirrored maps, with rooms of the same sizes, the largest
lead was 1.7."""
LEAST_OVERLAP = 0.1
MOST_RUNNER_UP = 0.62  # of the score: a pose that fits nearly as well may be the right one
LEAST_SCORE_NEAR_PRIOR, LEAST_AGREEMENT_NEAR_PRIOR = 5.8, 0.75
"""Least score, and least share of walls that agree, if the user gives an approximate pose."""
_MOST_JUDGED, _MOST_BENT = 5, 500
"""Candidates that are bent before the final score, and faces of walls that determine a bend."""
_SHIFTS, _MOST_SHIFTED = (1.0, 1.8, 3.0), 400
"""Shifts along the walls, metres, at which agreement by chance is measured, and faces used."""
_MOST_LINE, _LINE_WIDTH, _FACING = 4.0, 0.1, 0.9
"""Metres that a straight line of walls counts at most, its width, and the least cosine between its
normal and those of its faces."""
_SLIDE, _SLIDE_STEP, _MOST_SLID = 12.0, 0.2, 200
"""Metres along the walls within which rivals of the best pose are searched, step, and faces."""
_WIDEST, _SHARE_OF_DIAGONAL = 1.0, 0.012
"""Largest scale at which maps are bent: metres, and as a share of the smaller diagonal."""
_SHOWN = TOLERANCES.index(0.25)
_PRIOR_TURN = math.radians(30)
_PRIOR_SHIFT = 5.0
_PRIOR_DEVIATIONS = 2.5  # the radius of the search area in standard deviations
_ROTATION_ERROR = math.radians(3)  # tolerance of a rotation that the user gives
_TURNS_AROUND = 100  # yaws that are tried on coarse cells, whatever the directions of the walls
_COARSE, _FINE = 200, 500  # cells per side of a correlation: at all yaws, at those of the walls
_MOST_FACES, _MOST_CHECKED, _MOST_POLISHED = 400, 2000, 4000
"""Faces that refine each candidate, that score it, and that refine the best one at the end."""
_LEAST_SCALE = 1.5  # cells: the smallest scale at which the best candidate is refined
_SAME_TURN, _SAME_PLACE = math.radians(5), 1.2
"""Radians and metres within which two candidates are the same: drift bends maps by as much."""
_SAME_SHARE = 0.05  # the same as a share of a small map's diagonal
_REFINED_LIMIT = 1.2  # of a prior's limits: refinement may move candidates out of them slightly
_MOST_CANDIDATES = 3


class Candidate(NamedTuple):
    """One of the best poses of a first map in the frame of a second.

    `contradicting` is the length of walls in free space of the other map, metres; the other
    figures are those of `mapdeal.Alignment`.
    """

    transform: frame.Transform
    score: float
    overlap: float
    agreement: float
    contradicting: float


@dataclass(frozen=True, repr=False)
class Placement(values.OneLineRepr):
    """Placement of a first map in the frame of a second, see `mapdeal.Alignment`."""

    transform: frame.Transform
    reason: str | None
    score: float
    runner_up: float
    runner_up_transform: frame.Transform | None
    overlap: float
    agreement: float
    bend: float
    bend_xy: tuple[float, float] | None
    candidates: tuple[Candidate, ...]

    @property
    def same_place(self) -> bool:
        """Whether the maps certainly show the same place, placed as in `transform`."""
        return self.reason is None

    def _repr_parts(self) -> Iterator[str]:
        yield "the same place" if self.same_place else f"uncertain: {self.reason}"
        x, y, yaw = self.transform.pose
        yield f"x {x:.3f} m, y {y:.3f} m, yaw {yaw:.4f} rad"
        yield f"score {self.score:.2f}, runner-up {self.runner_up:.2f}"


def placed(
    first: OccupancyGrid, second: OccupancyGrid, *, prior: frame.Transform | None = None,
    rotations: Sequence[float] | None = None,
) -> Placement:  # fmt: skip
    if rotations is not None:
        if len(rotations) == 0:
            raise ParameterError("must have at least one turn", place="rotations", got=rotations)
        if not all(abs(value) <= frame.FARTHEST for value in rotations):  # refuses nan too
            raise ParameterError("must be finite numbers", place="rotations", got=rotations)
    first_walls, second_walls = walls_of(first), walls_of(second)
    if first_walls is None or second_walls is None:
        which = "first" if first_walls is None else "second"
        return _unplaced(f"the {which} map has no obstacle", prior)
    area = None
    if prior is not None:
        diagonals = [math.hypot(*walls.frame.size_xy) for walls in (first_walls, second_walls)]
        along = second_walls.map_from_cells().inverse().after(prior)
        along = along.after(first_walls.map_from_cells())
        pose = np.array([along.yaw, along.x, along.y])
        area = SearchArea(pose, max(_PRIOR_SHIFT, min(diagonals) / 10))
    poses = _candidates(first_walls, second_walls, area, rotations)
    if not len(poses):
        return _unplaced("no place within the given limits", prior)
    return _judged(first_walls, second_walls, poses, area)


def _unplaced(reason: str, prior: frame.Transform | None) -> Placement:
    return Placement(prior or frame.Transform(), reason, 0.0, 0.0, None, 0.0, 0.0, 0.0, None, ())


def _candidates(
    first: WallMap, second: WallMap, area: SearchArea | None, rotations: Sequence[float] | None
) -> Poses:
    around: Floats = np.arange(_TURNS_AROUND) * (2 * math.pi / _TURNS_AROUND)
    by_walls = yaws_by_walls(first, second)
    yaws = None
    if rotations is not None:
        lattices = second.frame.origin[2] - first.frame.origin[2]
        yaws = np.array(rotations, dtype=np.float64) - lattices
        around = by_walls = np.unique(np.mod(yaws, 2 * math.pi))
    if area is not None:
        around = around[_turns(around - area.pose[0]) <= _PRIOR_TURN]
        by_walls = by_walls[_turns(by_walls - area.pose[0]) <= _PRIOR_TURN]
        if yaws is None and not len(by_walls):
            by_walls = area.pose[:1]
    options: Any = {"most": 16, "area": area}
    fine, _ = candidates_at(first, second, by_walls, side=_FINE, most_per_yaw=8, **options)
    coarse, cell = candidates_at(first, second, around, side=_COARSE, most_per_yaw=4, **options)
    expected = np.zeros((0, 3)) if area is None else area.pose[None]
    poses = np.concatenate([fine, coarse, expected])
    if not len(poses):
        return poses
    wide = max(cell, 0.3)
    narrow = _narrow(first, second)
    poses = refined(first, second, poses, [wide] * 4 + [wide / 2] * 4 + [narrow] * 4, _MOST_FACES)
    # refinement may have moved poses out of the limits
    allowed: Mask = np.all(np.isfinite(poses), axis=1)
    if yaws is not None:
        allowed &= _turns(poses[:, :1] - yaws[None]).min(axis=1) <= _ROTATION_ERROR
    if area is not None:
        allowed &= _shifts(first, poses, area.pose) <= _REFINED_LIMIT * area.radius
        allowed &= _turns(poses[:, 0] - area.pose[0]) <= _REFINED_LIMIT * _PRIOR_TURN
    return poses[allowed]


def _judged(
    first: WallMap, second: WallMap, poses: Poses, area: SearchArea | None = None
) -> Placement:
    axes = _axes(second)
    weights = (_weights(first, _axes(first)), _weights(second, axes)) if area is None else None
    found = agreement_at(first, second, poses, _MOST_CHECKED, weights=weights)
    likeliest = int(found.evidence(found.by_chance()).argmax())
    evidence = found.evidence(found.by_chance(_is_elsewhere(first, poses, likeliest)))
    poses = poses[_best_places(evidence, _MOST_JUDGED, partial(_is_elsewhere, first, poses))]
    poses = np.concatenate([poses, _slid(first, second, poses[0], axes)])
    bend = _bends(first, second, poses, found.piece)
    found = agreement_at(first, second, poses, _MOST_CHECKED, bend, weights)
    chance = found.by_chance()
    if weights is not None:
        chance = np.maximum(chance, _shares_beside(first, second, poses, bend, axes, weights))
    costs = bend.costs
    if area is not None:  # the negative log-likelihood under a Gaussian prior
        deviations = _PRIOR_DEVIATIONS * _shifts(first, poses, area.pose) / area.radius
        costs = costs + deviations**2 / 2
    scores = np.maximum(found.evidence(chance) - costs, 0)
    best = int(scores.argmax())
    elsewhere = np.flatnonzero(_are_elsewhere(first, poses, bend, best))
    runner_up, runner_up_transform = 0.0, None
    if len(elsewhere):
        second_best = int(elsewhere[scores[elsewhere].argmax()])
        runner_up = float(scores[second_best])
        runner_up_transform = _transform_of(first, second, poses[second_best])
    score, overlap = float(scores[best]), float(found.overlap[best])
    shown = float(found.shares[best, _SHOWN])
    if area is not None:
        agrees = score >= LEAST_SCORE_NEAR_PRIOR and shown >= LEAST_AGREEMENT_NEAR_PRIOR
        figures = f"{shown:.0%} of those in common, score {_rounded_down(score)}"
        reason = None if agrees else f"the walls do not agree near the given place ({figures})"
    else:
        compared = float((found.agreeing + found.contradicting)[best, _SHOWN])
        walls = min(first.wall_length, second.wall_length)
        is_mostly_shared = overlap >= _SHARED_OVERLAP and shown >= _SHARED_AGREEMENT
        is_mostly_shared &= compared >= max(_SHARED_LENGTH, _SHARED_WALLS * walls)
        least_score = LEAST_SCORE_IF_SHARED if is_mostly_shared else LEAST_SCORE
        is_rival = runner_up > MOST_RUNNER_UP * score or score - runner_up < least_score
        rival = runner_up if len(elsewhere) and is_rival else None
        reason = _reason(score, rival, overlap, least_score)
    polished, bent, bent_xy = _polished(first, second, poses[best : best + 1], found.piece)
    transform = _transform_of(first, second, polished)
    candidates = []
    is_elsewhere = partial(_are_elsewhere, first, poses, bend)
    for k in [] if reason is None else _best_places(scores, _MOST_CANDIDATES, is_elsewhere):
        at = transform if k == best else _transform_of(first, second, poses[k])
        shares = (found.overlap[k], found.shares[k, _SHOWN], found.contradicting[k, _SHOWN])
        candidates.append(Candidate(at, float(scores[k]), *map(float, shares)))
    return Placement(
        transform, reason, score, runner_up, runner_up_transform, overlap, shown, bent, bent_xy,
        tuple(candidates),
    )  # fmt: skip


def _best_places(scores: Floats, most: int, elsewhere: Callable[[int], Mask]) -> list[int]:
    chosen: list[int] = []
    is_free = np.ones(len(scores), dtype=np.bool_)
    for k in np.argsort(-scores, kind="stable").tolist():
        if is_free[k] and len(chosen) < most:
            chosen.append(k)
            is_free &= elsewhere(k)
    return chosen


def _axes(second: WallMap) -> Floats:
    direction = main_direction(second.known & ~second.free) or 0.0
    along = np.array([math.cos(direction), math.sin(direction)])
    return np.stack([along, (-along[1], along[0])])


def _weights(walls: WallMap, axes: Floats) -> Singles:
    # Straight walls that coincide once do so all along: long ones count no more than `_MOST_LINE`.
    weights = np.ones(len(walls.faces_xy), dtype=np.float32)
    width = max(_LINE_WIDTH, walls.resolution)
    for across in axes:
        # sums: for matrix products OpenBLAS would allocate memory in each thread
        side = (walls.normals_xy * across.astype(np.float32)).sum(axis=1)
        for sign in (1, -1):
            faces = np.flatnonzero(sign * side > _FACING)
            if not len(faces):
                continue
            strips = np.floor((walls.faces_xy[faces] * across).sum(axis=1) / width).astype(np.int64)
            strips -= strips.min() - 1
            counts = np.bincount(strips, minlength=int(strips.max()) + 2)
            lengths = (counts[strips - 1] + counts[strips] + counts[strips + 1]) * walls.resolution
            weights[faces] = np.minimum(1, _MOST_LINE / lengths)
    return weights


def _slid(first: WallMap, second: WallMap, pose: Poses, axes: Floats) -> Poses:
    """Return the best poses shifted along the walls: in a row of equal rooms, other rooms."""
    step = max(_SLIDE_STEP, first.resolution, second.resolution)
    shifts = np.arange(_SAME_PLACE, _SLIDE, step)
    shifts = np.concatenate([-shifts[::-1], shifts])
    found = []
    for axis in axes:
        slid = np.repeat(pose[None], len(shifts), axis=0)
        slid[:, 1:] += shifts[:, None] * axis
        agreeing = np.zeros(len(shifts))
        for own, target, move in (first, second, moved), (second, first, moved_back):
            faces = own.some_faces(_MOST_SLID)[0]
            distance = target.padded_distance.take(wall_maps.cells_at(target, move(slid, faces)))
            agreeing += (distance <= step).mean(axis=1) * own.wall_length
        order = np.argsort(-agreeing, kind="stable")
        next_best = order[np.abs(shifts[order] - shifts[order[0]]) > _SAME_PLACE][:1]
        found += [slid[order[0]], *slid[next_best]]
    narrow = _narrow(first, second)
    return refined(first, second, np.array(found), [2 * narrow] * 2 + [narrow] * 3, _MOST_FACES)


def _bends(first: WallMap, second: WallMap, poses: Poses, piece: float) -> Bend:
    diagonal = min(math.hypot(*walls.frame.size_xy) for walls in (first, second))
    narrow = _narrow(first, second)
    wide = max(narrow, min(_WIDEST, _SHARE_OF_DIAGONAL * diagonal))
    scales = [wide] * 3 + [(wide + narrow) / 2] * 2 + [narrow] * 3
    return wall_maps.fitted(first, second, poses, scales=scales, piece=piece, most=_MOST_BENT)


def _shares_beside(
    first: WallMap, second: WallMap, poses: Poses, bend: Bend, axes: Floats,
    weights: tuple[Singles, Singles],
) -> Floats:  # fmt: skip
    """Return the share of walls that agree after a shift along the walls, shape (K, T)."""
    # A corridor agrees with every corridor of its width, so agreement that survives a shift is no
    # evidence. The direction in which more survives counts.
    along, across = axes
    steps = np.array([side * shift for shift in _SHIFTS for side in (1, -1)])
    shifts = np.stack([steps[:, None] * along, steps[:, None] * across]).reshape(-1, 2)
    shifted = np.repeat(poses, len(shifts), axis=0)
    shifted[:, 1:] += np.tile(shifts, (len(poses), 1))
    bends = replace(bend, coefficients=np.repeat(bend.coefficients, len(shifts), axis=0))
    shares = agreement_at(first, second, shifted, _MOST_SHIFTED, bends, weights).shares
    return np.asarray(shares.reshape(len(poses), 2, len(steps), -1).mean(axis=2).max(axis=1))


def _polished(
    first: WallMap, second: WallMap, poses: Poses, piece: float
) -> tuple[Poses, float, tuple[float, float] | None]:
    """Return the best pose after a last refinement, with the largest bend and its place."""
    # Faces of a wall lie up to a cell apart: at a smaller scale only some of them would pull.
    least = _LEAST_SCALE * max(first.resolution, second.resolution)
    # the scale grows with the bend, so that all walls pull
    bent = _most_bent(first, second, poses, _bends(first, second, poses, piece))[0]
    wide = max(_narrow(first, second), least, 2 * bent)
    poses = refined(first, second, poses, [wide] * 3 + [max(wide / 2, least)] * 5, _MOST_POLISHED)
    return poses[0], *_most_bent(first, second, poses, _bends(first, second, poses, piece))


class BendBetween(NamedTuple):
    """Bend of a map against another, metres, its place, and the agreement without and with it."""

    metres: float
    point_xy: tuple[float, float]
    share: float
    share_bent: float


def bend_between(first: OccupancyGrid, second: OccupancyGrid) -> BendBetween:
    """Return the bend between two maps in the same frame; shares are for `TOLERANCES[1]`."""
    first_walls, second_walls = walls_of(first), walls_of(second)
    if first_walls is None or second_walls is None:
        return BendBetween(0.0, (0.0, 0.0), 0.0, 0.0)
    along = second_walls.map_from_cells().inverse().after(first_walls.map_from_cells())
    poses = np.array([[along.yaw, along.x, along.y]])
    rigid = agreement_at(first_walls, second_walls, poses, _MOST_POLISHED)
    bend = _bends(first_walls, second_walls, poses, rigid.piece)
    bent = agreement_at(first_walls, second_walls, poses, _MOST_POLISHED, bend)
    largest, point = _most_bent(first_walls, second_walls, poses, bend)
    shares = (float(agreement.shares[0, 1]) for agreement in (rigid, bent))
    return BendBetween(largest, point or (0.0, 0.0), *shares)


def _most_bent(
    first: WallMap, second: WallMap, poses: Poses, bend: Bend
) -> tuple[float, tuple[float, float] | None]:
    """Return the 95th percentile of the displacement of walls that coincide, and its place."""
    faces = first.some_faces(_MOST_POLISHED)[0]
    points = bend.moved(poses, faces)[0]
    near = 2 * max(_narrow(first, second), _LEAST_SCALE * max(first.resolution, second.resolution))
    meets = second.padded_distance.take(wall_maps.cells_at(second, points)) <= near
    if not meets.any():
        return 0.0, None
    displacement = np.hypot(*bend.at(bend.terms(faces))[0].T)[meets]
    largest = float(np.percentile(displacement, 95))
    point = points[meets][displacement >= largest].mean(axis=0, dtype=np.float64)
    return largest, tuple(second.map_from_cells().points(point[None])[0].tolist())


def _reason(score: float, rival: float | None, overlap: float, least: float) -> str | None:
    if score < least:
        figures = f"score {_rounded_down(score)}, of {least:g} at least"
        return f"the walls agree hardly better than those of different places do ({figures})"
    if overlap < LEAST_OVERLAP:
        return f"the maps have too little in common there ({overlap:.0%} of their free space)"
    if rival is not None:
        return f"another place fits nearly as well (scores {score:.2f} and {rival:.2f})"
    return None


def _rounded_down(score: float) -> str:
    """Return a score rounded down: one that is too small never looks large enough."""
    return f"{math.floor(100 * score) / 100:g}"


def _is_elsewhere(first: WallMap, poses: Poses, best: int, distance: float = _SAME_PLACE) -> Mask:
    """Return which poses differ from the best one by more than drift, or by a distance."""
    is_turned = _turns(poses[:, 0] - poses[best, 0]) >= _SAME_TURN
    return (_shifts(first, poses, poses[best]) >= distance) | is_turned


def _are_elsewhere(first: WallMap, poses: Poses, bend: Bend, best: int) -> Mask:
    """Return which poses put the bent walls elsewhere than the best one."""
    points = bend.moved(poses, first.some_faces(_MOST_SLID)[0])
    offset = points - points[best]
    least = min(_SAME_PLACE / 2, _SAME_SHARE * math.hypot(*first.frame.size_xy))
    return np.asarray(np.median(np.hypot(*np.moveaxis(offset, -1, 0)), axis=1) > least)


def _narrow(first: WallMap, second: WallMap) -> float:
    return max(0.15, first.resolution, second.resolution)


def _transform_of(first: WallMap, second: WallMap, pose: Poses) -> frame.Transform:
    yaw, x, y = pose.tolist()
    along = frame.Transform(x, y, yaw)
    return second.map_from_cells().after(along).after(first.map_from_cells().inverse())
