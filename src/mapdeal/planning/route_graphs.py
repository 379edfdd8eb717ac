"""Route graphs of what a robot reaches: nodes and straight edges in the middle of free space.

Corridors and doors get the skeleton of the reached cells, wide halls a lattice along the walls.
Then what is missing is added: the ways between parts that are not connected, short cuts, and nodes
where cells are too far from any.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapdeal.grid.reach import Reach
from mapdeal.grid.reaching import nearest_marked
from mapdeal.kernels.distance import squared_distance
from mapdeal.kernels.paths import cheapest_path
from mapdeal.kernels.rotations import main_direction
from mapdeal.kernels.skeleton import (
    STRAIGHT,
    lengths_from,
    nearest_from,
    skeleton,
)
from mapdeal.planning.graph_drafts import SHARE, Area, Draft, Kind, Made, Place, Places, Wishes
from mapdeal.planning.hall_lattices import lattices_in
from mapdeal.planning.node_areas import neighbouring
from mapdeal.planning.skeleton_lines import Cells, Tracing

MOST_EDGES = 8  # of a node, each counted once though it leads both ways
AREA_PER_NODE = 1.5  # square metres of reachable area, at least
_WIDEST_DOOR = 1.6  # metres
_PROMINENCE = 1.3
"""How much wider it must be on both sides of a door than in it."""

_LONGEST = 1.25  # of the spacing: longer lines get a node
_SHORT_CUT = 1.5
"""How many times as long as the way between neighbours the way on the graph may be."""

_WITHIN_HALL = 0.75
"""How far a hall extends around where all of its width is free, of half this width: not to its
walls, nor into doors, in front of which there is more room, but into its corners."""

_BESIDE_HALL = 2  # edges from the end of a corridor to nodes of a hall
_NEAR = 0.35  # of the spacing: nodes that are nearer to each other become one
_THINNER = ((1.5, 0.85), (2.0, 0.7), (2.0, 0.5), (2.0, 0.0), (2.0, 0.0), (3.0, 0.0), (4.0, 0.0))
"""Step by step in crowded places: edges go if there is another way of so many spacings at most, and
straight lines instead of others must have such a share of their clearance."""
_SLIVER = 1.05
"""How many times as long two edges may be that make a third one superfluous."""


def route_graph_of(reach: Reach, wishes: Wishes) -> Made:
    """Make a graph of the cells that a robot reaches, and of the goals asked for."""
    making = _Making(Area.of(reach), wishes)
    making.add_halls()
    making.add_skeleton()
    for one in reach.goals:
        making.add_goal((one.goal.x, one.goal.y), one.goal.label)
    making.connect()
    making.tidy()
    if making.has_corners:
        making.mend_blocked()  # before others are taken out for being too many
    making.cover_all()
    if making.is_crowded:
        making.thin_out()
    making.limit_edges()
    if wishes.one_way is not None:
        making.part_lanes()
        making.cover_all()
    making.mend_blocked()
    making.limit_edges()
    return making.made()


@dataclass(eq=False)
class _Making(Draft):
    """A graph that is being made, part by part."""

    # halls

    def add_halls(self) -> None:
        """Put a lattice into each wide place, parallel to most walls."""
        half = self.wishes.hall / 2 / self.cell
        core = self.coarse >= half * half
        self.is_hall = np.zeros(core.shape, dtype=np.bool_)
        if not core.any():
            return
        from scipy import ndimage

        reach = _WITHIN_HALL * half / self.step
        self.is_hall = (squared_distance(core) <= reach * reach) & (self.coarse >= 0)
        margin = max(self.area.turning + 2, half / 2)
        labels, _ = ndimage.label(self.is_hall, np.ones((3, 3)))
        usable = np.argwhere(self.is_hall & (self.coarse >= margin * margin))
        places, pairs = lattices_in(
            np.asarray((usable + 0.5) * self.step, dtype=np.float64),
            labels[usable[:, 0], usable[:, 1]],
            main_direction(self.area.sweeps.closed > 0) or 0.0, self.spacing, float(self.step),
            lambda places: self._is_usable(places, margin),
        )  # fmt: skip
        for place in places:
            self.add_node(place, "hall")
        self.add_lines(pairs)

    def _is_usable(self, places: Places, margin: float) -> NDArray[np.bool_]:
        """Return which places lie in a hall, with as much room around them as a margin."""
        rows, cols = np.floor(places.T).astype(np.int64)
        height, width = self.is_open.shape
        chosen = np.flatnonzero((rows >= 0) & (rows < height) & (cols >= 0) & (cols < width))
        chosen = chosen[self.is_hall[rows[chosen] // self.step, cols[chosen] // self.step]]
        squares = self.squares[rows[chosen], cols[chosen]]
        found = np.zeros(len(places), dtype=np.bool_)
        found[chosen[squares >= margin * margin]] = True
        return found

    def add_lines(self, pairs: Cells) -> NDArray[np.bool_]:
        """Join pairs of nodes, shape (N, 2), by the lines that can be driven along."""
        if not len(pairs):
            return np.zeros(0, dtype=np.bool_)
        is_clear, least = self.area.sweeps.along(self.at(pairs[:, 0]), self.at(pairs[:, 1]))
        for (one, other), clearance in zip(
            pairs[is_clear].tolist(), least[is_clear].tolist(), strict=True
        ):
            self.add_edge(one, other, clearance)
        return is_clear

    # corridors

    def add_skeleton(self) -> None:
        """Follow the middle of all that is not a hall."""
        from scipy import ndimage

        levels = np.sqrt(np.maximum(self.coarse, 0)) / self.step
        levels = np.where(self.coarse >= 0, levels.astype(np.int32), -1)
        half = self.wishes.hall / 2 / self.cell
        is_peak = self.coarse == ndimage.maximum_filter(self.coarse, 3)
        lines = skeleton(levels, self.coarse >= half * half, is_peak)
        tracing = Tracing(self.squares, self.step, lines & ~self.is_hall, lines & self.is_hall)
        tracing.prune(0.6 * self.wishes.cover / self.cell, self.spacing)
        paths = []
        nodes: dict[int, int] = {}
        for number, chain in tracing.chains.items():
            cells = tracing.fine[np.array(chain.cells)]
            ends = []
            for end in (chain.one, chain.other):
                if end not in nodes:
                    degree = len(tracing.chains_of[end])
                    kind: Kind = "crossing" if degree > 2 else "end" if degree == 1 else "way"
                    if end in tracing.mouths:
                        kind = "way"
                    row, col = tracing.fine[end].tolist()
                    nodes[end] = self.add_node((row + 0.5, col + 0.5), kind)
                ends.append(nodes[end])
            beyond = [
                math.inf if end in tracing.mouths
                else tracing.width_around(end, number, self.spacing)
                for end in (chain.one, chain.other)
            ]  # fmt: skip
            paths.append(_Path(cells + 0.5, *ends, *beyond))
        self.add_paths(paths, with_doors=True)
        self.join_to_halls([nodes[end] for end in sorted(tracing.mouths) if end in nodes])

    def join_to_halls(self, mouths: Sequence[int]) -> None:
        """Join the ends of corridors to the nearest nodes of the halls that they lead into."""
        halls = [index for index, kind in enumerate(self.kinds) if kind == "hall"]
        if not halls or not mouths:
            return
        from scipy.spatial import cKDTree

        tree = cKDTree(self.at(halls))
        reach = 1.5 * self.spacing + self.wishes.hall / 2 / self.cell
        pairs = [
            (mouth, halls[k])
            for mouth, near in zip(
                mouths, tree.query_ball_point(self.at(mouths), reach), strict=True
            )
            for k in sorted(near, key=lambda k: self.length(mouth, halls[k]))[: 2 * _BESIDE_HALL]
        ]  # fmt: skip
        tried = np.array(pairs, dtype=np.int64).reshape(-1, 2)
        is_clear, least = self.area.sweeps.along(self.at(tried[:, 0]), self.at(tried[:, 1]))
        joins: defaultdict[int, list[int]] = defaultdict(list)
        for (mouth, node), fits, clearance in zip(pairs, is_clear, least, strict=True):
            others = joins[mouth]
            if not fits or len(others) >= _BESIDE_HALL:
                continue
            if all(self._is_apart(mouth, node, other) for other in others):
                others.append(node)
                self.add_edge(mouth, node, float(clearance))

    def _is_apart(self, node: int, one: int, other: int) -> bool:
        """Return whether two nodes are seen in clearly different directions, and about as near."""
        row, col = self.places[node]
        first, second = (math.atan2(end[0] - row, end[1] - col)
                         for end in (self.places[one], self.places[other]))  # fmt: skip
        lengths = self.length(node, one), self.length(node, other)
        return (
            abs(math.remainder(first - second, math.tau)) > math.pi / 4
            and lengths[0] < 2 * lengths[1]
        )

    def add_paths(self, paths: Sequence[_Path], *, with_doors: bool = False) -> None:
        """Put nodes onto paths of neighbouring cells so that lines between them can be driven."""
        pieces: list[_Piece] = []
        places = np.concatenate([np.zeros((0, 2)), *(path.places for path in paths)])
        of_cells = self.clearance_at(np.floor(places).astype(np.int64))
        bounds = np.cumsum([0, *(len(path.places) for path in paths)]).tolist()
        for path, (first, stop) in zip(paths, pairwise(bounds), strict=True):
            clearances = of_cells[first:stop]
            marks = [(0, path.one), (len(clearances) - 1, path.other)]
            for door in self._doors(clearances, path) if with_doors else ():
                row, col = path.places[door].tolist()
                node = self.add_node((row, col), "door")
                self.widths[node] = 2 * float(clearances[door]) * self.cell
                marks.append((door, node))
            marks.sort()
            pieces += [
                _Piece(path.places, clearances, begin, one, end, other)
                for (begin, one), (end, other) in pairwise(marks)
            ]
        while pieces:
            pieces = self._laid(pieces)

    def _laid(self, pieces: Sequence[_Piece]) -> list[_Piece]:
        """Lay a line over each piece of a path where that can be driven; return the other parts."""
        starts, ends = self.at([one.one for one in pieces]), self.at([one.other for one in pieces])
        is_clear, least = self.area.sweeps.along(starts, ends)
        needed = np.array([SHARE * float(one.clearances[one.first : one.last + 1].min())
                           for one in pieces])  # fmt: skip
        is_loop = np.array([one.one == one.other for one in pieces])
        fits = is_clear & (least >= needed - 0.5) & ~is_loop
        parts: list[_Piece] = []
        steps: list[_Piece] = []
        for piece, is_fit, clearance in zip(pieces, fits.tolist(), least.tolist(), strict=True):
            if is_fit:
                self._lay(piece.one, piece.other, clearance)
            elif piece.last - piece.first > 1:
                parts += self._halves(piece)
            elif piece.one != piece.other:
                steps.append(piece)
        # single steps: a round robot may pass where its outline touches something
        starts, ends = (self.at(getattr(one, end) for one in steps) for end in ("one", "other"))
        is_clear, least = self.area.sweeps.along(starts, ends, touches=False)
        for piece, is_fit, clearance in zip(steps, is_clear.tolist(), least.tolist(), strict=True):
            if is_fit or self.has_corners:
                self.add_edge(piece.one, piece.other, clearance)
        return parts

    def _lay(self, one: int, other: int, clearance: float) -> None:
        start, end = self.places[one], self.places[other]
        count = max(1, math.ceil(math.dist(start, end) / self.spacing - (_LONGEST - 1)))
        nodes = [one]
        for k in range(1, count):
            share = k / count
            row, col = (a + share * (b - a) for a, b in zip(start, end, strict=True))
            nodes.append(self.add_node((row, col), "way"))
        for first, second in pairwise([*nodes, other]):
            self.add_edge(first, second, clearance)

    def _halves(self, piece: _Piece) -> Iterator[_Piece]:
        """Yield both parts of a piece, cut where it is farthest from its line."""
        places = piece.places[piece.first : piece.last + 1]
        start, end = np.array(self.places[piece.one]), np.array(self.places[piece.other])
        way = end - start
        length = float(np.hypot(*way))
        away = places - start
        if length > 1:
            off = np.abs(away[:, 0] * way[1] - away[:, 1] * way[0]) / length
        else:
            off = np.hypot(*away.T)
        cut = int(np.argmax(off[1:-1])) + 1
        if off[cut] < 1:
            cut = len(places) // 2
        row, col = places[cut].tolist()
        middle = self.add_node((row, col), "way")
        cut += piece.first
        yield piece._replace(last=cut, other=middle)
        yield piece._replace(first=cut, one=middle)

    def _doors(self, clearances: NDArray[np.float64], path: _Path) -> Iterator[int]:
        """Yield where a path is narrow, and wider on both sides."""
        widest = _WIDEST_DOOR / 2 / self.cell
        waiting = [(0, len(clearances))]
        while waiting:
            first, stop = waiting.pop()
            is_whole = first == 0 and stop == len(clearances)
            is_between_halls = is_whole and path.before == path.after == math.inf
            if stop - first < (1 if is_between_halls else 3):
                continue
            part = clearances[first:stop]
            least = int(part.argmin())
            narrow = float(part[least])
            if narrow > widest:
                continue
            wide = _PROMINENCE * narrow
            before, after = (float(side.max(initial=0)) for side in (part[:least], part[least:]))
            if first == 0 and (least or path.before == math.inf):
                before = max(before, path.before)
            if stop == len(clearances) and (least < len(part) - 1 or path.after == math.inf):
                after = max(after, path.after)
            if before >= wide and after >= wide:
                is_beyond = part[least:] > 1.02 * narrow
                count = int(is_beyond.argmax()) if is_beyond.any() else 1
                middle = first + least + (count - 1) // 2
                yield middle
                waiting += [(first, first + least), (middle + 1, stop)]
            elif before < wide:
                waiting.append((first + least + 1, stop))
                if after < wide and before >= after:
                    waiting[-1] = (first, first + least)
            else:
                waiting.append((first, first + least))

    # what is missing

    def add_goal(self, point: Place, name: str) -> None:
        """Add a node exactly at a goal."""
        row, col = self.places_of([point])[0].tolist()
        node = self.add_node((row, col), "goal")
        self.names[node] = name
        near = sorted(range(node), key=lambda other: (self.length(node, other), other))[:6]
        is_clear, least = self.area.sweeps.along(self.at([node] * len(near)), self.at(near))
        for other, _, clearance in [
            one for one in zip(near, is_clear, least, strict=True) if one[1]
        ][:2]:
            self.add_edge(node, other, float(clearance))

    def connect(self) -> None:
        """Join parts that belong together, and neighbours that are far apart on the graph."""
        if not self.places:
            where = np.unravel_index(np.argmax(self.squares), self.squares.shape)
            self.add_node((float(where[0]) + 0.5, float(where[1]) + 0.5), "end")
        is_open = self.coarse >= 0
        cells = self.cells_of(self.nodes(), self.step)
        lengths, origin = nearest_from(is_open, cells)
        neighbours = neighbouring(lengths, origin, cells)
        if not len(neighbours.lengths):
            return
        order = np.lexsort((neighbours.one, neighbours.lengths))
        parts = self.parts()
        scale = self.step / STRAIGHT
        wanted = []
        for one, other, length in zip(
            neighbours.one[order].tolist(), neighbours.other[order].tolist(),
            (neighbours.lengths[order] * scale).tolist(), strict=True,
        ):  # fmt: skip
            if parts[one] != parts[other]:
                parts = np.where(parts == parts[other], parts[one], parts)
            elif not self._is_detour(one, other, length):
                continue
            wanted.append((one, other))
            self.add_edge(one, other, 0.0)  # so that it is no detour for others
        for one, other in wanted:
            self.drop_edge(one, other)
        self.add_ways(wanted)

    def _is_detour(self, one: int, other: int, length: float) -> bool:
        if other in self.beside[one]:
            return False
        limit = max(_SHORT_CUT * length, length + 2 * self.spacing)
        if self.is_near_by(one, other, limit):
            return False
        return self.length_on_graph(one, other, limit) > limit

    def add_ways(self, pairs: Sequence[tuple[int, int]], shorts: Sequence[float] = ()) -> None:
        """Join pairs of nodes by ways that keep to the middle where there is room.

        The second node of each is moved back along its way by a length, but not to the first.
        """
        starts, ends = (self.at(pair[k] for pair in pairs) for k in (0, 1))
        is_clear, least = self.area.sweeps.along(starts, ends)
        rooms = (self.clearance_at(np.floor(one).astype(np.int64)) for one in (starts, ends))
        is_straight = is_clear & (least >= SHARE * np.minimum(*rooms) - 0.5)
        paths = []
        for number, (one, other) in enumerate(pairs):
            short = shorts[number] if len(shorts) else 0.0
            if is_straight[number] and not short:  # a way would be straightened to this line
                paths.append(_Path(self.at((one, other)), one, other))
                continue
            cells = self._way_between(one, other)
            if not len(cells):
                continue
            if short:
                lengths = np.hypot(*np.diff(cells, axis=0).T)[::-1].cumsum()
                back = int(np.searchsorted(lengths, min(short, lengths[-1] / 2)))
                cells = cells[: len(cells) - back]
                row, col = cells[-1].tolist()
                self.places[other] = (row + 0.5, col + 0.5)
            paths.append(_Path(np.asarray(cells + 0.5), one, other))
        self.add_paths(paths)

    def _way_between(self, one: int, other: int) -> Cells:
        """Return the cells of a way, shape (N, 2); none if there is no way."""
        start, end = (np.floor(self.places[index]).astype(np.int64) for index in (one, other))
        away = max(self.spacing, 0.5 * math.dist(start.tolist(), end.tolist()))
        while True:
            low = np.maximum(np.minimum(start, end) - int(away), 0)
            high = np.maximum(start, end) + int(away) + 1
            part = slice(low[0], high[0]), slice(low[1], high[1])
            squares = self.squares[part].astype(np.float64)
            least = np.maximum(squares, 0)
            weights = np.where(squares >= 0, 1 + 2 * self.spacing / (1 + least), 0.0)
            first, last = tuple((start - low).tolist()), tuple((end - low).tolist())
            if weights[first] and weights[last]:
                found = cheapest_path(weights, first, last).cells
                if len(found):
                    return self._beside_corners(found + low)
            if away > max(self.is_open.shape):
                return np.zeros((0, 2), dtype=np.int64)
            away *= 3

    def _beside_corners(self, cells: Cells) -> Cells:
        """Return the cells of a way, with one more where a diagonal step passes a closed one."""
        before, after = cells[:-1], cells[1:]
        sides = [np.stack([one[:, 0], other[:, 1]], axis=1)
                 for one, other in ((after, before), (before, after))]  # fmt: skip
        is_open = [self.is_open[side[:, 0], side[:, 1]] for side in sides]
        passes = (before != after).all(axis=1) & ~(is_open[0] & is_open[1])
        if not passes.any():
            return cells
        beside = np.where(is_open[0][:, np.newaxis], *sides)[passes]
        return np.insert(cells, np.flatnonzero(passes) + 1, beside, axis=0)

    def cover_all(self) -> None:
        """Add nodes until none of the reached cells is farther than `cover` from one."""
        from scipy import ndimage

        self.missing = self.uncovered(self.nodes())
        for _ in range(_ROUNDS):
            if not self.missing.any():
                return
            labels, _ = ndimage.label(self.missing, np.ones((3, 3)))
            cells = np.argwhere(self.missing)
            own = labels[cells[:, 0], cells[:, 1]]
            order = np.lexsort((-self.squares[cells[:, 0], cells[:, 1]], own))
            best = cells[order[np.diff(own[order], prepend=0) != 0]].tolist()
            boxes = ndimage.find_objects(labels)
            nearest_to, first = self._nearest(best), len(self.places)
            pairs, shorts = [], []
            for (row, col), box, nearest in zip(best, boxes, nearest_to, strict=True):
                size = math.hypot(*(one.stop - one.start for one in box))
                node = self.add_node((row + 0.5, col + 0.5), "end")
                if nearest is not None:
                    pairs.append((nearest, node))
                    shorts.append(max(0.8 * self.wishes.cover / self.cell - size, 0.0))
            self.add_ways(pairs, shorts)
            new = self.cells_of(range(first, len(self.places)))
            lengths = lengths_from(self.is_open, new, limit=self.limit)
            self.missing &= lengths < 0

    def _nearest(self, cells: Sequence[Sequence[int]]) -> list[int | None]:
        """Return for each of some cells a node to which the way is short."""
        nodes = self.nodes()
        is_open = self.coarse >= 0
        at = self.cells_of(nodes, self.step)
        found: dict[int, int] = {}
        limit = 2 * self.limit // self.step
        while len(found) < len(cells) and limit < 4 * STRAIGHT * is_open.size:
            left = [k for k in range(len(cells)) if k not in found]
            rows, cols = np.array([cells[k] for k in left]).T // self.step
            lengths, origin = nearest_from(is_open, rows * is_open.shape[1] + cols, limit=limit)
            to_nodes, of_nodes = lengths.reshape(-1)[at], origin.reshape(-1)[at]
            for index in np.argsort(to_nodes, kind="stable").tolist():
                if to_nodes[index] >= 0:
                    found.setdefault(left[of_nodes[index]], nodes[index])
            if len(found) == len(cells) - len(left):  # nothing new: look farther
                limit *= 8
        return [found.get(k) for k in range(len(cells))]

    # what is too much

    def tidy(self) -> None:
        """Make nodes one that are near each other, and drop edges beside which two others lead."""
        self._merge(_NEAR * self.spacing, len(self.places))
        for node in self.nodes():
            if self.kinds[node] == "door" and self._is_gap(node):
                self.kinds[node] = "way"
                del self.widths[node]
        lengths = ((self.beside[one][other], one, other) for one, other in self.edges)
        for length, one, other in sorted(lengths, key=lambda edge: (-edge[0], *edge[1:])):
            if self.is_near_by(one, other, _SLIVER * length):
                self.drop_edge(one, other)

    def _merge(self, near: float, most: int) -> None:
        """Take out nodes, but not too many, of which others are near that serve as well."""
        refused: set[tuple[int, int]] = set()
        lengths = ((self.beside[one][other], (one, other)) for one, other in self.edges)
        short = [entry for entry in lengths if entry[0] < near]
        while True:
            moves: list[tuple[int, int, list[int]]] = []
            busy: set[int] = set()
            short = sorted(entry for entry in short if entry[1] in self.edges)
            for _, (one, other) in short:
                ranks = [(_RANKS.index(self.kinds[node]), node) for node in (one, other)]
                (_, kept), (rank, gone) = sorted(ranks)
                around = {kept, gone, *self.beside[gone]}
                if {self.kinds[kept], self.kinds[gone]} == {"door", "crossing"}:
                    continue  # the way along the wall would lead through the door
                if rank and (kept, gone) not in refused and busy.isdisjoint(around):
                    busy |= around
                    others = self.beside[gone].keys() - {kept} - self.beside[kept].keys()
                    moves.append((gone, kept, sorted(others)))
            if not moves or most <= 0:
                break
            del moves[most:]
            done = self.move_all(moves)
            most -= sum(done)
            for (gone, kept, beyond), is_done in zip(moves, done, strict=True):
                if not is_done:
                    refused.add((kept, gone))
                    continue
                new = ((self.beside[kept][other], (min(kept, other), max(kept, other)))
                       for other in beyond)  # fmt: skip
                short += [entry for entry in new if entry[0] < near]

    def thin_out(self) -> None:
        """Take out what is needed least, as long as there are too many nodes for the area."""
        self._shorten(("way",))
        for long_way, self.share in _THINNER:
            self._drop_dead_ends()
            self._shorten(("way", "crossing"))
            self._merge(0.4 * long_way * self.spacing, self.excess)
            self._drop_edges(long_way * self.spacing)
            self._shorten(("way", "crossing"))
            self._shorten(("door",))
            self.cover_all()
            if not self.is_crowded:
                return

    def _drop_edges(self, long_way: float) -> None:
        """Drop the narrowest edges where there is another way that is not longer."""
        for one, other in sorted(self.edges, key=lambda ends: (self.edges[ends], ends)):
            if not self.is_crowded:
                return
            if (one, other) not in self.edges:
                continue
            clearance = self.drop_edge(one, other)
            if self.length_on_graph(one, other, long_way) > long_way:
                self.add_edge(one, other, clearance)
                continue
            for node in (one, other):
                if self.kinds[node] != "door":
                    self._shrink(node)

    def _drop_dead_ends(self) -> None:
        """Drop dead ends all of which is near other nodes."""
        while self.is_crowded:
            ends = [node for node, beside in self.beside.items()
                    if len(beside) == 1 and self.kinds[node] != "goal"]  # fmt: skip
            missing = self.uncovered(sorted(set(self.nodes()).difference(ends)))
            _, nearest = nearest_from(self.is_open, self.cells_of(ends), limit=self.limit)
            needed = set(nearest[missing].tolist())
            free = [node for k, node in enumerate(ends) if k not in needed]
            for node in free[: self.excess]:
                for before in list(self.beside[node]):
                    self.drop_edge(node, before)
                self.gone.add(node)
            if not free:
                return

    @property
    def excess(self) -> int:
        """How many nodes more there are than the area is to have."""
        return len(self.places) - len(self.gone) - int(self.area.reachable / AREA_PER_NODE)

    @property
    def is_crowded(self) -> bool:
        return self.excess > 0

    def _shrink(self, node: int) -> None:
        """Drop a node that leads nowhere any more, and those behind it; or that is on a line."""
        while self.is_crowded and len(self.beside[node]) == 1:
            if self.kinds[node] not in ("way", "crossing"):
                return
            (before,) = self.beside[node]
            self.drop_edge(node, before)
            self.gone.add(node)
            node = before
        self._straighten(node)

    def _straighten(self, node: int) -> None:
        if len(self.beside[node]) != 2 or self.kinds[node] in ("goal", "end"):
            return
        one, other = sorted(self.beside[node])
        is_short = self.length(one, other) <= 1.6 * self.wishes.cover / self.cell
        if is_short and other not in self.beside[one]:
            self.move_all([(node, one, [other])])

    def _shorten(self, kinds: Sequence[Kind]) -> None:
        """Take out nodes of some kinds that only divide lines."""
        waiting = [node for node, beside in self.beside.items()
                   if len(beside) == 2 and self.kinds[node] in kinds]  # fmt: skip
        waiting.sort(key=lambda node: (
            -self.widths.get(node, 0.0), sum(self.beside[node].values()), node
        ))  # fmt: skip
        for node in waiting:
            if not self.is_crowded:
                return
            self._straighten(node)

    def _is_gap(self, node: int) -> bool:
        """Return whether there is a way around a door, so that it does not lead into a room."""
        if len(self.beside[node]) != 2:
            return False
        one, other = self.beside[node]
        around = 2.5 * self.spacing
        return self.length_on_graph(one, other, around, without=node) <= around

    def limit_edges(self) -> None:
        """Leave no node with too many edges: its longest ones go, if there is another way."""
        for node in list(self.beside):
            lengths = self.beside[node].copy()
            for other in sorted(lengths, key=lambda other: (-lengths[other], other)):
                if len(self.beside[node]) <= MOST_EDGES:
                    break
                clearance = self.drop_edge(node, other)
                if self.length_on_graph(node, other, 4 * self.spacing) == math.inf:
                    self.add_edge(node, other, clearance)

    def mend_blocked(self) -> None:
        """Lead edges around what is hit, or drop them and all that only they join."""
        # Places are rounded, and edges are parts of the lines that were tried: other positions are
        # tried on them. Where a robot with corners passes sideways alone, or turning as it goes, no
        # straight edge leads.
        for _ in range(_ROUNDS):
            self.places = [(row, col) for row, col in self.rounded(self.places).tolist()]
            self._leave_edges()
            ends = np.array(sorted(self.edges), dtype=np.int64).reshape(-1, 2)
            is_clear, _ = self.area.sweeps.along(
                self.at(ends[:, 0]), self.at(ends[:, 1]), touches=self.has_corners,
                step=_FINE_STEP if self.has_corners else _HALF_CELL,
            )  # fmt: skip
            blocked = ends[~is_clear].tolist()
            if not blocked:
                return
            for one, other in blocked:
                self.drop_edge(one, other)
            if self.has_corners:
                break
            self.add_ways(blocked)
        parts, nodes = self.parts(), self.nodes()
        largest = np.bincount(parts[nodes]).argmax()
        for node in nodes:
            if parts[node] != largest:
                for other in list(self.beside[node]):
                    self.drop_edge(node, other)
                self.gone.add(node)
        self.lanes = [ends for ends in self.lanes if self.gone.isdisjoint(ends)]
        self.missing = self.uncovered(self.nodes())

    def _leave_edges(self) -> None:
        """Move nodes off the edges of closed cells, on which places along a line may fall."""
        nodes = [node for node in self.nodes() if self.kinds[node] != "goal"]
        is_clear, _ = self.area.sweeps.along(self.at(nodes), self.at(nodes), touches=False)
        for node in np.array(nodes)[~is_clear].tolist():
            row, col = (int(one) for one in self.places[node])
            if (cell := nearest_marked(self.is_open, (row, col))) is not None:
                self.places[node] = cell[0] + 0.5, cell[1] + 0.5

    def part_lanes(self) -> None:
        """Make two lanes of lines between crossings, each on the right, where there is room."""
        is_inner = {node for node in self.nodes()
                    if len(self.beside[node]) == 2 and self.kinds[node] == "way"}  # fmt: skip
        chains, seen = [], set()
        for node in sorted(is_inner):
            if node not in seen:
                ends = [self._run_on(node, other, is_inner) for other in sorted(self.beside[node])]
                chain = [*ends[0][::-1], node, *ends[1]]
                seen.update(chain[1:-1])
                if chain[0] not in is_inner and chain[0] != chain[-1]:
                    chains.append(chain)
        apart = self.area.turning + _APART / 2 / self.cell
        for chain in chains:
            clearance = min(self.edges[min(ends), max(ends)] for ends in pairwise(chain))
            aside = min(clearance / 2, _ASIDE / self.cell)
            if aside >= apart and clearance - aside >= apart:
                self._part(chain, aside)

    def _run_on(self, node: int, following: int, is_inner: set[int]) -> list[int]:
        """Return the nodes that follow on a line, up to the first that is not within it."""
        found = [following]
        before = node
        while found[-1] in is_inner and found[-1] != node:
            (onward,) = self.beside[found[-1]].keys() - {before}
            before = found[-1]
            found.append(onward)
        return found

    def _part(self, chain: Sequence[int], aside: float) -> None:
        places = self.at(chain)
        along = places[2:] - places[:-2]
        along /= np.maximum(np.hypot(*along.T), 1e-9)[:, np.newaxis]
        right = along[:, ::-1] * [-1.0, 1.0]  # rows lead north, columns east
        lanes = [
            self.rounded(np.concatenate([places[:1], places[1:-1] + side * right, places[-1:]]))
            for side in (aside, -aside)
        ]
        starts, ends = (np.concatenate([lane[part] for lane in lanes])
                        for part in (slice(None, -1), slice(1, None)))  # fmt: skip
        is_clear, _ = self.area.sweeps.along(starts, ends, step=_FINE_STEP)
        if not is_clear.all():
            return
        for one, other in pairwise(chain):
            self.drop_edge(one, other)
        self.gone.update(chain[1:-1])
        for lane, is_back in zip(lanes, (False, True), strict=True):
            new = [self.add_node((row, col), "way") for row, col in lane[1:-1].tolist()]
            nodes = [chain[0], *new, chain[-1]]
            self.lanes += list(pairwise(nodes[::-1] if is_back else nodes))


_ROUNDS = 20
_HALF_CELL, _FINE_STEP = 0.5, 0.125
"""Steps of positions, in cells: by the fine one, whoever tries other places finds the same."""
_APART = 0.2  # metres between two robots on lanes side by side, and from each to walls
_ASIDE = 1.0  # metres that a lane lies beside the middle, at most
_RANKS: tuple[Kind, ...] = ("goal", "door", "crossing", "hall", "end", "way")
"""Of two nodes that become one the first is kept."""


class _Path(NamedTuple):
    """Neighbouring cells, by their middles, from one node to another."""

    places: Places
    one: int
    other: int
    before: float = 0.0  # how wide it is beyond its ends, as a clearance
    after: float = 0.0


class _Piece(NamedTuple):
    """A part of a path between two nodes."""

    places: Places
    clearances: NDArray[np.float64]
    first: int
    one: int
    last: int
    other: int
