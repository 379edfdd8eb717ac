"""``mapdeal align``: where one map lies in the frame of another."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Annotated, Any

import numpy as np

from mapdeal import errors, records
from mapdeal.command import Output, Result, Words, command
from mapdeal.compare import difference, score
from mapdeal.compare.align import Placement, bytes_to_align, placed
from mapdeal.compatibility import Unpack
from mapdeal.files.json_values import ALIGNMENT_FORMAT
from mapdeal.grid.canvas import obstacles_in, sampled
from mapdeal.grid.frame import Transform, warn_of_degrees
from mapdeal.pictures import canvas, comparisons, styles
from mapdeal.pipeline import inputs
from mapdeal.sensors.points import transform_document

_PER_CELL_OF_PICTURE = 16  # bytes for each cell of both maps
_LEAST_BEND = 0.05  # metres: smaller bends are not printed
_UNKNOWN, _FREE = 1, 2  # in a picture; 3 is a wall of the first map, 4 of the second, 5 of both


@records.dataclass(frozen=True, repr=False)
class Alignment(Placement, Result):
    """Placement of a first map in the frame of a second.

    Parameters
    ----------
    transform : Transform
        From the first map's frame to the second's: p_second = R(yaw) p_first + (x, y).
    reason : str or None
        Why the placement is uncertain; None if it is certain.
    score : float
        Evidence that the walls agree better than by chance, at least 0.
    runner_up : float
        Score of the best placement elsewhere; 0 if there is none.
    runner_up_transform : Transform or None
        Transform of the runner-up, if there is one.
    overlap : float
        Free space of one map that the other knows (the mean of both), as a share of the free
        space of the map that has less.
    agreement : float
        Share of the walls that lie within 0.25 m of a wall of the other map, among those that
        lie there or in its free space.
    bend : float
        Largest distance between corresponding walls because one map is bent, metres.
    bend_xy : tuple of float or None
        Place of the largest bend in the second map's frame, if any walls agree.
    candidates : tuple of Candidate
        If uncertain, the best three placements with their figures, `transform` first.
    maps : tuple of MapInput
        The two maps.
    chosen : int or None
        Number of the candidate that the user chose as `transform`, from 1.
    """

    maps: tuple[inputs.MapInput, inputs.MapInput]
    chosen: int | None = None

    @property
    def passes(self) -> bool:  # type: ignore[override]
        """Whether the placement is certain."""
        return self.same_place

    def document(self) -> dict[str, Any]:
        place, runner_up = transform_document(self.transform), self.runner_up_transform
        return {
            "format": ALIGNMENT_FORMAT, "first": self.maps[0].document(),
            "second": self.maps[1].document(), "same_place": self.same_place, "reason": self.reason,
            **place,  # also at the top level, as in files written by hand
            "transform": place, "score": self.score, "runner_up": self.runner_up,
            "runner_up_transform": None if runner_up is None else transform_document(runner_up),
            "overlap": self.overlap, "agreement": self.agreement, "bend": self.bend,
            "bend_xy": None if self.bend_xy is None else list(self.bend_xy),
            "chosen_by": "score" if self.chosen is None else "user",
            "candidates": [
                {**transform_document(candidate.transform), "score": candidate.score,
                 "overlap": candidate.overlap, "agreement": candidate.agreement,
                 "contradicting_m": candidate.contradicting}
                for candidate in self.candidates
            ],
        }  # fmt: skip

    def lines(self) -> Iterator[str]:
        verdict = "the same place" if self.same_place else f"uncertain: {self.reason}"
        yield f"{self.maps[0].name}, {self.maps[1].name}: {verdict}"
        if self.score == 0 and not self.same_place and self.overlap == 0:
            return
        yield f"  transform  {_text(self.transform)}"
        runner_up = "and no other place was found"
        if self.runner_up_transform is not None:
            place = _text(self.runner_up_transform)
            runner_up = f"the best place elsewhere {self.runner_up:.2f}: {place}"
        yield f"  score      {self.score:.2f}, {runner_up}"
        yield f"  overlap    {100 * self.overlap:.0f} % of the free space of the smaller map"
        yield f"  walls      {100 * self.agreement:.0f} % of those in common agree within 0.25 m"
        if self.bend_xy is not None and self.bend >= _LEAST_BEND:
            where = score.place_text(self.maps[1].occupancy, self.bend_xy)
            yield f"  bend       walls disagree by up to {self.bend:.2g} m, {where}"
        for number, candidate in enumerate(self.candidates, start=1):
            mark = " (chosen)" if number == self.chosen else ""
            yield f"  candidate {number}{mark}: {_text(candidate.transform)}"
            text = f"score {candidate.score:.2f}, {100 * candidate.overlap:.0f} % of the free space"
            text += f" in common, {100 * candidate.agreement:.0f} % of the walls agree"
            yield f"    {text}, {candidate.contradicting:.1f} m do not"
        if self.candidates and self.chosen is None:
            yield "  --image draws the candidates; --candidate 1 selects the first"

    def drawn(self, *, title: str | None = None, **look: Any) -> canvas.Image:
        """Return the first map over the second, or both at each candidate beside each other."""
        if self.chosen is None and len(self.candidates) > 1:
            return canvas.beside_each_other([
                self._drawn_at(candidate.transform, f"{k}: score {candidate.score:.2f}", **look)
                for k, candidate in enumerate(self.candidates, start=1)
            ])  # fmt: skip
        return self._drawn_at(self.transform, title, **look)

    def _drawn_at(self, transform: Transform, title: str | None, **look: Any) -> canvas.Image:
        first, second = (source.occupancy for source in self.maps)
        moved = transform.frame(first.frame)
        lattice = difference.frame_around(second.frame, moved)
        kinds = np.full(lattice.shape, _UNKNOWN, dtype=np.uint8)
        walls = np.zeros(lattice.shape, dtype=np.uint8)
        for k, (grid, frame) in enumerate(((first, moved), (second, second.frame))):
            values, is_inside = sampled(lattice, grid.occupancy, frame)
            kinds[is_inside & (values >= 0)] = _FREE
            walls += obstacles_in(lattice, grid.occupied(), frame) * np.uint8(k + 1)
        np.add(walls, _FREE, out=kinds, where=walls > 0)
        named = self.maps[0].title, self.maps[1].title
        shown = named if named[0] != named[1] else ("the first map", "the second map")
        verdict = "the same place" if self.same_place else "uncertain"
        look["title"] = title or f"{shown[0]} on {shown[1]}: {verdict}"
        look["style"] = styles.alignment_style(shown)
        return comparisons.difference_image(kinds, lattice, **look)


def _text(transform: Transform) -> str:
    x, y, yaw = (round(value, 4) + 0.0 for value in transform.pose)  # there is no -0
    degrees = round(math.degrees(transform.yaw), 2) + 0.0
    return f"x {x:.3f} m, y {y:.3f} m, yaw {yaw:.4f} rad ({degrees:.2f} degrees)"


def _rotations(text: str) -> list[float]:
    try:
        turns = [math.radians(float(part)) for part in text.split(",")]
    except ValueError:
        raise errors.ParameterError("must be degrees such as 0,90,180,270", got=text) from None
    if not all(map(math.isfinite, turns)):
        raise errors.ParameterError("must be finite", got=text)
    return turns


@command(
    group="Two maps of one place",
    output=Output("OUT.json", "Write the transform and the figures as JSON.", is_required=False,
                  ending=".json"),
    texts={"image": "Write a picture of the first map, placed on the second."},
    example="""\
mapdeal align examples/maps/office_cartographer.yaml examples/maps/office.yaml \\
    -o out/transform.json""",
)  # fmt: skip
def align(
    first: Annotated[inputs.Map, Words("A")], second: Annotated[inputs.Map, Words("B")], *,
    prior: Annotated[
        Transform | Sequence[float] | None, Words("X,Y,YAW", inputs.transform_of)
    ] = None,
    rotations: Annotated[Sequence[float] | None, Words("DEG,...", _rotations, "rotation")] = None,
    candidate: int | None = None, **reading: Unpack[inputs.Reading],
) -> Alignment:  # fmt: skip
    """Find where a map lies in the frame of another map of the same place.

    The transform brings points of A into the frame of B: p_b = R(yaw) p_a + (x, y). Their sizes,
    resolutions, origins and yaws may differ, they may overlap only in part, and things may have
    moved. Exit code 0 if the match is certain; 1 if the walls agree too little, or also elsewhere.

    Parameters
    ----------
    first : path, str or grid
        The map to place: .yaml, .pbm or .npz. In Python, a grid serves as well.
    second : path, str or grid
        The map to place it on.
    prior : Transform or sequence of float, optional
        Approximate transform, metres and radians: only places within 30 degrees and 5 m of it (in
        large maps a tenth of the diagonal) are searched.
    rotations : sequence of float, optional
        Rotations to search, such as 0,90,180,270, each with a tolerance of 3 degrees. In Python
        they are radians. By default all are searched.
    candidate : int, optional
        Number of a candidate to use as the transform, from 1. Candidates are listed if the match is
        uncertain, which it remains, with exit code 1.
    **reading
        As for `read_map`; dialect, max_cells and max_memory apply to files.

    Returns
    -------
    Alignment
        Best alignment found, whether or not it is certain; see `Alignment.same_place`.

    Raises
    ------
    FileAccessError, MalformedInputError
        If a file cannot be read.
    ParameterError
        If a number is infinite or NaN, `rotations` is empty, or the candidate does not exist.

    Notes
    -----
    Candidates are peaks of correlations over all shifts, at the rotations that make the walls
    parallel and, on coarser cells, at all others. Each is refined by minimising the distances
    between walls, and the best are bent, stiffly, to where walls lie on walls. A wall face agrees
    if it lies on a wall of the other map with free space on the same side, and contradicts if it
    lies in the other map's free space. The score is the Kullback-Leibler divergence of the share
    that agrees from that where the map is shifted along its walls, for each 2 m of wall, less what
    the bend costs: the length of a corridor is no evidence, its doors and cross walls are. An
    alignment is certain if its score is at least 4.5 and 4.5 above all others, the maps overlap by
    a tenth, and no other one reaches 0.62 of the score; where two thirds of the space and 25 m of
    walls are compared and three quarters agree, 2.2 suffices. With a prior, only three quarters of
    the walls in common must agree.

    References
    ----------
    S. Carpin, "Fast and accurate map merging for multi-robot systems", Autonomous Robots 25, 2008.

    Examples
    --------
    >>> import numpy as np
    >>> from mapdeal import OccupancyGrid
    >>> walls = np.zeros((40, 60), dtype=np.int8)
    >>> walls[[0, -1]] = walls[:, [0, -1]] = walls[12, :35] = walls[12:30, 22] = 100
    >>> room = OccupancyGrid(walls, 0.1, (1.0, 2.0, 0.0))
    >>> found = align(room, OccupancyGrid(walls[::-1, ::-1], 0.1))
    >>> found.same_place, round(abs(found.transform.yaw), 3)
    (True, 3.142)
    """
    approximate = inputs.transform_of(prior, place="prior")
    warn_of_degrees(max([0.0] if rotations is None else rotations, key=abs, default=0), "rotations")
    a, b = inputs.open_inputs(first, second, names=("map A", "map B"), **reading)
    sizes = [math.prod(source.occupancy.shape) for source in (a, b)]
    text, of_picture = f"maps of {sizes[0]} and {sizes[1]} cells", _PER_CELL_OF_PICTURE * sum(sizes)
    inputs.claim_for([a, b], bytes_to_align(sizes), text, of_picture=of_picture)
    with inputs.errors_named(b.name):
        found = placed(a.occupancy, b.occupancy, prior=approximate, rotations=rotations)
    if candidate is None:
        return Alignment(**vars(found), maps=(a, b))
    if not 1 <= candidate <= len(found.candidates):
        rule = f"must be from 1 to {len(found.candidates)}"
        if not found.candidates:
            rule = f"does not apply: {'the match is certain' if found.same_place else found.reason}"
        raise errors.ParameterError(rule, place="candidate", got=candidate)
    figures = vars(found) | found.candidates[candidate - 1]._asdict()
    del figures["contradicting"]
    figures |= {"bend": 0.0, "bend_xy": None} if candidate > 1 else {}
    return Alignment(**figures, maps=(a, b), chosen=candidate)
