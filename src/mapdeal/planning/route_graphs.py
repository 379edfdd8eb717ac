"""Route graphs of the cells that a robot reaches: nodes and straight edges in free space.

Corridors and doors get the skeleton of the reached cells, wide halls a lattice along the walls.
Then edges connect separate parts and shorten detours, and nodes are added near uncovered cells.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from mapdeal.grid import reaching, values as codes
from mapdeal.grid.reach import Reach
from mapdeal.kernels import components, distance, rotations
from mapdeal.kernels.arrays import Array, Floats, Mask
from mapdeal.kernels.paths import cheapest_path
from mapdeal.kernels.skeleton import STRAIGHT, lengths_from, nearest_from, neighbouring, skeleton
from mapdeal.planning import graph_drafts
from mapdeal.planning.graph_drafts import Cells, Place, Tracing, lattices_in

MOST_EDGES = 8  # of a node, both directions counted once
AREA_PER_NODE = 1.5  # square metres of reachable area, at least
_NARROWEST_DOOR, _WIDEST_DOOR, _DOORS_APART = 0.6, 2.1, 1.0  # metres
_PROMINENCE = 1.3  # least ratio of the clearance and width on both sides of a door to those in it
_NEAR_JAMB = 1.3  # farthest jamb of a door, as a share of the distance of the nearest obstacle
_OPPOSITE = -0.7  # cosine between the directions of both jambs
_WALL = 2.0  # metres: least extent of an obstacle that is a wall by itself
_LINE, _TURNS = 4.0, np.radians([-10, -5, 0, 5, 10])
"""Metres beside a jamb in which pieces of a wall lie in line, and directions of that line."""
_PIECE, _PIECES = 0.8, 3.75
"""Metres of wall in line on each side and in total that make short obstacles a wall."""
# The space on each side of a door is measured from viewpoints in front of it; metres.
_AHEAD = 2.4  # distance of the last viewpoint
_EVERY = 0.1  # between viewpoints
_SIGHT = 3.0  # range to either side
_FINEST = 0.01  # least distance between the places that are tested
_STRETCH, _HIDDEN = 14, 2
"""Consecutive viewpoints that must see a width, more than see through a door on the side, and how
many of them furniture may hide."""
_STUB, _WIDER = 0.3, 2.0
"""Metres of wall in line with a door, and how many times as wide as the door a space must be. One
space must be so wide; with less wall beside a jamb, which may be the side of a passage, both."""
_WIDE_DOOR, _WIDE_RATIO, _WIDE_SPACE = 1.0, 3.0, 5.5
"""Doors wider than this, metres, need a space so many times as wide, or of this width."""
_LONGEST = 1.25  # of the spacing: longer lines get a node
_SHORT_CUT = 1.5  # largest ratio of the path on the graph to the shortest path between neighbours
_WITHIN_HALL = 0.75
"""Extent of a hall around its core, as a share of half the least hall width: far enough for
corners, but short of walls and doors."""
_BESIDE_HALL = 2  # most edges from the end of a corridor to nodes of a hall
_MERGED = 0.35  # of the spacing: nodes closer than this are merged
_THINNER = ((1.5, 0.85), (2.0, 0.7), (2.0, 0.5), (2.0, 0.0), (2.0, 0.0), (3.0, 0.0), (4.0, 0.0))
"""Steps to thin out crowded graphs: the longest detour, in spacings, that replaces an edge, and the
least clearance of a new straight edge as a share of that of the old edges."""
_SLIVER = 1.05  # largest ratio of the length of two edges to that of the edge that they replace


def route_graph_of(reach: Reach, options: graph_drafts.GraphOptions) -> graph_drafts.GraphResult:
    draft = _CompleteDraft(reach, options)
    draft.add_halls()
    draft.add_skeleton()
    for reached in reach.goals:
        draft.add_goal((reached.goal.x, reached.goal.y), reached.goal.label)
    draft.connect()
    draft.tidy()
    if draft.has_corners:
        draft.mend_blocked()  # before thinning out, which would otherwise keep blocked edges
    draft.cover_all()
    if draft.is_crowded:
        draft.thin_out()
    draft.limit_edges()
    if options.one_way is not None:
        draft.part_lanes()
        draft.cover_all()
    draft.mend_blocked()
    draft.limit_edges()
    return draft.result()


class _CompleteDraft(graph_drafts.Draft):
    def add_halls(self) -> None:
        """Add a lattice to each wide place, parallel to most walls."""
        half = self.options.hall / 2 / self.cell
        core = self.coarse >= half * half
        self.is_hall = np.zeros(core.shape, dtype=np.bool_)
        if not core.any():
            return
        reach = _WITHIN_HALL * half / self.step
        self.is_hall = (distance.squared_distance(core) <= reach * reach) & (self.coarse >= 0)
        margin = max(self.turning + 2, half / 2)
        labels = components.labelled(self.is_hall, corners=True).cells
        usable = np.argwhere(self.is_hall & (self.coarse >= margin * margin))
        places, pairs = lattices_in(
            np.asarray((usable + 0.5) * self.step, dtype=np.float64),
            labels[usable[:, 0], usable[:, 1]],
            rotations.main_direction(self.sweeps.closed > 0) or 0.0, self.spacing, float(self.step),
            lambda places: self._is_usable(places, margin),
        )  # fmt: skip
        for place in places:
            self.add_node(place, "hall")
        is_clear, least = self.sweeps.along(self.at(pairs[:, 0]), self.at(pairs[:, 1]))
        clear_pairs, clearances = pairs[is_clear].tolist(), least[is_clear].tolist()
        for (start, end), clearance in zip(clear_pairs, clearances, strict=True):
            self.add_edge(start, end, clearance)

    def _is_usable(self, places: Floats, margin: float) -> Mask:
        """Return which places lie in a hall with at least a margin of clearance."""
        cells = np.floor(places).astype(np.int64)
        is_usable = np.asarray(((cells >= 0) & (cells < self.is_open.shape)).all(axis=1))
        rows, cols = cells[is_usable].T
        is_in_hall = self.is_hall[rows // self.step, cols // self.step]
        is_usable[is_usable] = is_in_hall & (self.squares[rows, cols] >= margin * margin)
        return is_usable

    def add_skeleton(self) -> None:
        from scipy import ndimage

        levels = np.sqrt(np.maximum(self.coarse, 0)) / self.step
        levels = np.where(self.coarse >= 0, levels.astype(np.int32), -1)
        half = self.options.hall / 2 / self.cell
        is_peak = self.coarse == ndimage.maximum_filter(self.coarse, 3)
        lines = skeleton(levels, self.coarse >= half * half, is_peak)
        tracing = Tracing(self.squares, self.step, lines & ~self.is_hall, lines & self.is_hall)
        tracing.prune(0.6 * self.options.cover / self.cell, self.spacing)
        paths = []
        nodes: dict[int, int] = {}
        for number, chain in tracing.chains.items():
            cells = tracing.fine[np.array(chain)]
            ends, beyond = [], []
            for end in (chain[0], chain[-1]):
                is_mouth = end in tracing.mouths
                if end not in nodes:
                    degree = len(tracing.chains_of[end])
                    kind: graph_drafts.Kind = "crossing" if degree > 2 else "end"
                    kind = "way" if degree == 2 or is_mouth else kind
                    nodes[end] = self.add_node(tuple((tracing.fine[end] + 0.5).tolist()), kind)
                ends.append(nodes[end])
                width = math.inf if is_mouth else tracing.width_around(end, number, self.spacing)
                beyond.append(width)
            paths.append(_Path(cells + 0.5, *ends, *beyond))
        self.add_paths(paths, with_doors=True)
        self.join_to_halls([nodes[end] for end in sorted(tracing.mouths) if end in nodes])

    def join_to_halls(self, mouths: Sequence[int]) -> None:
        halls = [index for index, kind in enumerate(self.kinds) if kind == "hall"]
        if not halls or not mouths:
            return
        from scipy.spatial import cKDTree

        reach = 1.5 * self.spacing + self.options.hall / 2 / self.cell
        near_mouths = cKDTree(self.at(halls)).query_ball_point(self.at(mouths), reach)
        pairs = [
            (mouth, halls[k]) for mouth, near in zip(mouths, near_mouths, strict=True)
            for k in sorted(near, key=lambda k: self.length(mouth, halls[k]))[: 2 * _BESIDE_HALL]
        ]  # fmt: skip
        tried = np.array(pairs, dtype=np.int64).reshape(-1, 2)
        is_clear, least = self.sweeps.along(self.at(tried[:, 0]), self.at(tried[:, 1]))
        joins: defaultdict[int, list[int]] = defaultdict(list)
        for (mouth, node), fits, clearance in zip(pairs, is_clear, least, strict=True):
            has_room = fits and len(joins[mouth]) < _BESIDE_HALL
            if has_room and all(self._is_apart(mouth, node, joined) for joined in joins[mouth]):
                joins[mouth].append(node)
                self.add_edge(mouth, node, float(clearance))

    def _is_apart(self, node: int, far: int, near: int) -> bool:
        """Return whether two nodes lie in clearly different directions at similar distances."""
        row, col = self.places[node]
        first, second = (math.atan2(end[0] - row, end[1] - col)
                         for end in (self.places[far], self.places[near]))  # fmt: skip
        is_turned = abs(math.remainder(first - second, math.tau)) > math.pi / 4
        return is_turned and self.length(node, far) < 2 * self.length(node, near)

    def add_paths(self, paths: Sequence[_Path], *, with_doors: bool = False) -> None:
        """Add nodes and edges along paths of neighbouring cells that the robot can follow."""
        pieces: list[_Piece] = []
        bottlenecks: list[int] = []
        places = np.concatenate([np.zeros((0, 2)), *(path.places for path in paths)])
        of_cells = self.clearances_at(places)
        bounds = np.cumsum([0, *(len(path.places) for path in paths)]).tolist()
        for path, (first, stop) in zip(paths, pairwise(bounds), strict=True):
            clearances = of_cells[first:stop]
            marks = [(0, path.start), (len(clearances) - 1, path.end)]
            for door in self._doors(clearances, path) if with_doors else ():
                node = self.add_node(tuple(path.places[door].tolist()), "narrow")
                self.widths[node] = 2 * float(clearances[door]) * self.cell
                bottlenecks.append(node)
                marks.append((door, node))
            marks.sort()
            pieces += [_Piece(path.places, clearances, *a, *b) for a, b in pairwise(marks)]
        self._name_doors(bottlenecks)
        while pieces:
            pieces = self._add_lines_of(pieces)

    def _add_lines_of(self, pieces: Sequence[_Piece]) -> list[_Piece]:
        """Add edges for pieces that a robot can follow straight; return halves of the others."""
        starts = self.at(piece.start for piece in pieces)
        is_clear, least = self.sweeps.along(starts, self.at(piece.end for piece in pieces))
        lows = [float(piece.clearances[piece.first : piece.last + 1].min()) for piece in pieces]
        needed = graph_drafts.SHARE * np.array(lows)
        is_loop = np.array([piece.start == piece.end for piece in pieces])
        fits = is_clear & (least >= needed - 0.5) & ~is_loop
        halves, steps = list[_Piece](), list[_Piece]()
        for piece, is_fit, clearance in zip(pieces, fits.tolist(), least.tolist(), strict=True):
            if is_fit:
                self._add_line(piece.start, piece.end, clearance)
            elif piece.last - piece.first > 1:
                halves += self._halves(piece)
            elif piece.start != piece.end:
                steps.append(piece)
        # single steps: a round robot may pass although its outline touches an obstacle
        starts = self.at(piece.start for piece in steps)
        ends = self.at(piece.end for piece in steps)
        is_clear, least = self.sweeps.along(starts, ends, touches=False)
        for piece, is_fit, clearance in zip(steps, is_clear.tolist(), least.tolist(), strict=True):
            if is_fit or self.has_corners:
                self.add_edge(piece.start, piece.end, clearance)
        return halves

    def _add_line(self, start: int, end: int, clearance: float) -> None:
        count = max(1, math.ceil(self.length(start, end) / self.spacing - (_LONGEST - 1)))
        (row, col), (last_row, last_col) = self.places[start], self.places[end]
        shares = (k / count for k in range(1, count))
        places = [(row + s * (last_row - row), col + s * (last_col - col)) for s in shares]
        for ends in pairwise([start, *(self.add_node(place, "way") for place in places), end]):
            self.add_edge(*ends, clearance)

    def _halves(self, piece: _Piece) -> Iterator[_Piece]:
        """Yield both parts of a piece, divided at its farthest cell from the straight line."""
        places = piece.places[piece.first : piece.last + 1]
        start, end = self.at((piece.start, piece.end))
        along, away = end - start, places - start
        length = float(np.hypot(*along))
        off = np.hypot(*away.T)
        if length > 1:
            off = np.abs(away[:, 0] * along[1] - away[:, 1] * along[0]) / length
        cut = int(np.argmax(off[1:-1])) + 1
        if off[cut] < 1:
            cut = len(places) // 2
        middle = self.add_node(tuple(places[cut].tolist()), "way")
        cut += piece.first
        yield piece._replace(last=cut, end=middle)
        yield piece._replace(first=cut, start=middle)

    def _doors(self, clearances: Floats, path: _Path) -> Iterator[int]:
        """Yield the indices of narrow places of a path."""
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
            if (narrow := float(part[least])) > widest:
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

    def add_goal(self, point: Place, name: str) -> None:
        node = self.add_node(tuple(self.places_of([point])[0].tolist()), "goal")
        self.names[node] = name
        near = sorted(range(node), key=lambda near: (self.length(node, near), near))[:6]
        is_clear, least = self.sweeps.along(self.at([node] * len(near)), self.at(near))
        for k in np.flatnonzero(is_clear)[:2].tolist():
            self.add_edge(node, near[k], float(least[k]))

    def connect(self) -> None:
        """Add edges between separate parts, and between neighbours far apart on the graph."""
        if not self.places:
            row, col = np.unravel_index(np.argmax(self.squares), self.squares.shape)
            self.add_node((float(row) + 0.5, float(col) + 0.5), "end")
        cells = self.cells_of(self.nodes(), self.step)
        lengths, origin = nearest_from(self.coarse >= 0, cells)
        neighbours = neighbouring(lengths, origin, cells)
        if not len(neighbours.lengths):
            return
        order, parts = np.lexsort((neighbours.firsts, neighbours.lengths)), self.parts()
        lengths_in_cells = neighbours.lengths * (self.step / STRAIGHT)
        missing = []
        for k in order.tolist():
            start, end = int(neighbours.firsts[k]), int(neighbours.seconds[k])
            if parts[start] != parts[end]:
                parts = np.where(parts == parts[end], parts[start], parts)
            elif not self._is_detour(start, end, float(lengths_in_cells[k])):
                continue
            missing.append((start, end))
            self.add_edge(start, end, 0.0)  # later pairs may use it
        for pair in missing:
            self.drop_edge(*pair)
        self.add_shortest_paths(missing)

    def _is_detour(self, start: int, end: int, length: float) -> bool:
        limit = max(_SHORT_CUT * length, length + 2 * self.spacing)
        if end in self.beside[start] or self.has_short_detour(start, end, limit):
            return False
        return self.length_on_graph(start, end, limit) > limit

    def add_shortest_paths(
        self, pairs: Sequence[tuple[int, int]], shorts: Sequence[float] = ()
    ) -> None:
        """Connect pairs of nodes along free space, and move the second back by `shorts`."""
        starts, ends = (self.at(pair[k] for pair in pairs) for k in (0, 1))
        is_clear, least = self.sweeps.along(starts, ends)
        room = np.minimum(self.clearances_at(starts), self.clearances_at(ends))
        is_straight = is_clear & (least >= graph_drafts.SHARE * room - 0.5)
        paths = []
        for number, (start, end) in enumerate(pairs):
            short = shorts[number] if len(shorts) else 0.0
            if is_straight[number] and not short:  # the path would be straightened to this line
                paths.append(_Path(self.at((start, end)), start, end))
                continue
            cells = self._cells_between(start, end)
            if not len(cells):
                continue
            if short:
                lengths = np.hypot(*np.diff(cells, axis=0).T)[::-1].cumsum()
                back = int(np.searchsorted(lengths, min(short, lengths[-1] / 2)))
                cells = cells[: len(cells) - back]
                self.places[end] = tuple((cells[-1] + 0.5).tolist())
            paths.append(_Path(np.asarray(cells + 0.5), start, end))
        self.add_paths(paths, with_doors=bool(len(shorts)))

    def _cells_between(self, *nodes: int) -> Cells:
        start, end = np.floor(self.at(nodes)).astype(np.int64)
        away = max(self.spacing, 0.5 * math.dist(start.tolist(), end.tolist()))
        while True:
            low = np.maximum(np.minimum(start, end) - int(away), 0)
            high = np.maximum(start, end) + int(away) + 1
            squares = self.squares[low[0] : high[0], low[1] : high[1]].astype(np.float64)
            surcharges = 2 * self.spacing / (1 + np.maximum(squares, 0))  # near obstacles
            weights = np.where(squares >= 0, 1 + surcharges, 0.0)
            first, last = tuple((start - low).tolist()), tuple((end - low).tolist())
            if weights[first] and weights[last]:
                cells = cheapest_path(weights, first, last).cells
                if len(cells):
                    return self._beside_corners(cells + low)
            if away > max(self.is_open.shape):
                return np.zeros((0, 2), dtype=np.int64)
            away *= 3

    def _beside_corners(self, cells: Cells) -> Cells:
        """Return the cells of a path, with an open cell added where a step cuts a corner."""
        before, after = cells[:-1], cells[1:]
        sides = [np.stack([by_row[:, 0], by_col[:, 1]], axis=1)
                 for by_row, by_col in ((after, before), (before, after))]  # fmt: skip
        is_open = [self.is_open[side[:, 0], side[:, 1]] for side in sides]
        passes = (before != after).all(axis=1) & ~(is_open[0] & is_open[1])
        if not passes.any():
            return cells
        beside = np.where(is_open[0][:, np.newaxis], *sides)[passes]
        return np.insert(cells, np.flatnonzero(passes) + 1, beside, axis=0)

    def cover_all(self) -> None:
        """Add nodes until every reached cell is within `cover` of a node."""
        from scipy import ndimage

        self.missing = self.uncovered(self.nodes())
        for _ in range(_ROUNDS):
            if not self.missing.any():
                return
            labels, _ = ndimage.label(self.missing, np.ones((3, 3)))
            cells = np.argwhere(self.missing)
            group = labels[cells[:, 0], cells[:, 1]]
            order = np.lexsort((-self.squares[cells[:, 0], cells[:, 1]], group))
            best = cells[order[np.diff(group[order], prepend=0) != 0]].tolist()
            boxes = ndimage.find_objects(labels)
            nearest_to, first = self._nearest(best), len(self.places)
            pairs, shorts = [], []
            for (row, col), box, nearest in zip(best, boxes, nearest_to, strict=True):
                size = math.hypot(*(side.stop - side.start for side in box))
                node = self.add_node((row + 0.5, col + 0.5), "end")
                if nearest is not None:
                    pairs.append((nearest, node))
                    shorts.append(max(0.8 * self.options.cover / self.cell - size, 0.0))
            self.add_shortest_paths(pairs, shorts)
            new = self.cells_of(range(first, len(self.places)))
            self.missing &= lengths_from(self.is_open, new, limit=self.limit) < 0

    def _nearest(self, cells: Sequence[Sequence[int]]) -> list[int | None]:
        """Return the node with the shortest path to each cell, or None if unconnected."""
        nodes, is_open = self.nodes(), self.coarse >= 0
        node_cells = self.cells_of(nodes, self.step)
        nearest: dict[int, int] = {}
        limit = 2 * self.limit // self.step
        while len(nearest) < len(cells) and limit < 4 * STRAIGHT * is_open.size:
            remaining = [k for k in range(len(cells)) if k not in nearest]
            rows, cols = np.array([cells[k] for k in remaining]).T // self.step
            lengths, origin = nearest_from(is_open, rows * is_open.shape[1] + cols, limit=limit)
            lengths_to_nodes = lengths.reshape(-1)[node_cells]
            origin_of_nodes = origin.reshape(-1)[node_cells]
            for index in np.argsort(lengths_to_nodes, kind="stable").tolist():
                if lengths_to_nodes[index] >= 0:
                    nearest.setdefault(remaining[origin_of_nodes[index]], nodes[index])
            if len(nearest) == len(cells) - len(remaining):  # no progress: search farther
                limit *= 8
        return [nearest.get(k) for k in range(len(cells))]

    def tidy(self) -> None:
        self._merge(_MERGED * self.spacing, len(self.places))
        detour = 2.5 * self.spacing
        for node in self.nodes():
            if self.kinds[node] == "narrow" and len(self.beside[node]) == 2:
                start, end = self.beside[node]
                if self.length_on_graph(start, end, detour, avoided=node) <= detour:
                    self.kinds[node] = "way"
                    del self.widths[node]
        lengths = ((self.beside[start][end], start, end) for start, end in self.edges)
        for length, start, end in sorted(lengths, key=lambda edge: (-edge[0], *edge[1:])):
            if self.has_short_detour(start, end, _SLIVER * length):
                self.drop_edge(start, end)

    def _merge(self, near: float, most: int) -> None:
        """Merge at most `most` nodes into equivalent neighbours within a distance."""
        refused: set[tuple[int, int]] = set()
        lengths = ((self.beside[start][end], (start, end)) for start, end in self.edges)
        short = [entry for entry in lengths if entry[0] < near]
        while True:
            moves: list[tuple[int, int, list[int]]] = []
            busy: set[int] = set()
            short = sorted(entry for entry in short if entry[1] in self.edges)
            for _, pair in short:
                ranks = [(_RANKS.index(self.kinds[node]), node) for node in pair]
                (_, target), (rank, gone) = sorted(ranks)
                around = {target, gone, *self.beside[gone]}
                if {self.kinds[target], self.kinds[gone]} in _ON_WALLS:
                    continue  # the path along the wall would lead through the door
                if rank and (target, gone) not in refused and busy.isdisjoint(around):
                    busy |= around
                    beyond = self.beside[gone].keys() - {target} - self.beside[target].keys()
                    moves.append((gone, target, sorted(beyond)))
            if not moves or most <= 0:
                break
            del moves[most:]
            has_moved = self.move_all(moves)
            most -= sum(has_moved)
            for (gone, target, new_ends), is_moved in zip(moves, has_moved, strict=True):
                if not is_moved:
                    refused.add((target, gone))
                    continue
                new = ((self.beside[target][end], (min(target, end), max(target, end)))
                       for end in new_ends)  # fmt: skip
                short += [entry for entry in new if entry[0] < near]

    def thin_out(self) -> None:
        """Remove the least useful nodes and edges until the area has few enough nodes."""
        self._drop_dividing_nodes(("way",))
        for detour, self.share in _THINNER:
            self._drop_dead_ends()
            self._drop_dividing_nodes(("way", "crossing"))
            self._merge(0.4 * detour * self.spacing, self.excess)
            self._drop_edges(detour * self.spacing)
            self._drop_dividing_nodes(("way", "crossing"))
            self._drop_dividing_nodes(("narrow",))
            self.cover_all()
            if not self.is_crowded:
                return

    def _drop_edges(self, detour: float) -> None:
        for ends in sorted(self.edges, key=lambda ends: (self.edges[ends], ends)):
            if not self.is_crowded:
                return
            if ends not in self.edges:
                continue
            clearance = self.drop_edge(*ends)
            if self.length_on_graph(*ends, detour) > detour:
                self.add_edge(*ends, clearance)
                continue
            for node in ends:
                if self.kinds[node] not in ("door", "narrow"):
                    self._shrink(node)

    def _drop_dead_ends(self) -> None:
        """Drop dead ends whose cells all lie near other nodes."""
        # Tests blocks of cells, which are fewer; `cover_all` covers the cells that this misses.
        is_open = self.coarse >= 0
        while self.is_crowded:
            ends = [node for node, beside in self.beside.items()
                    if len(beside) == 1 and self.kinds[node] != "goal"]  # fmt: skip
            missing = self.uncovered(sorted(set(self.nodes()).difference(ends)), self.step)
            cells = self.cells_of(ends, self.step)
            _, nearest = nearest_from(is_open, cells, limit=self.limit // self.step)
            needed = set(nearest[missing].tolist())
            free = [node for k, node in enumerate(ends) if k not in needed]
            for node in free[: self.excess]:
                self.drop_node(node)
            if not free:
                return

    @property
    def excess(self) -> int:
        return len(self.places) - len(self.gone) - int(self.reachable / AREA_PER_NODE)

    @property
    def is_crowded(self) -> bool:
        return self.excess > 0

    def _shrink(self, node: int) -> None:
        """Drop a dead end with the nodes that lead to it, or straighten the line through a node."""
        while self.is_crowded and len(self.beside[node]) == 1:
            if self.kinds[node] not in ("way", "crossing"):
                return
            (before,) = self.beside[node]
            self.drop_node(node)
            node = before
        self._straighten(node)

    def _straighten(self, node: int) -> None:
        if len(self.beside[node]) != 2 or self.kinds[node] in ("goal", "end"):
            return
        start, end = sorted(self.beside[node])
        is_short = self.length(start, end) <= 1.6 * self.options.cover / self.cell
        if is_short and end not in self.beside[start]:
            self.move_all([(node, start, [end])])

    def _drop_dividing_nodes(self, kinds: Sequence[graph_drafts.Kind]) -> None:
        waiting = [node for node, beside in self.beside.items()
                   if len(beside) == 2 and self.kinds[node] in kinds]  # fmt: skip
        waiting.sort(key=lambda k: (-self.widths.get(k, 0.0), sum(self.beside[k].values()), k))
        for node in waiting:
            if not self.is_crowded:
                return
            self._straighten(node)

    def _name_doors(self, bottlenecks: Sequence[int]) -> None:
        """Change narrow places to doors if they are gaps in walls between wider spaces."""
        doors = [node for node in self.nodes() if self.kinds[node] == "door"]
        for node in sorted(bottlenecks, key=lambda node: (self.widths[node], node)):
            is_apart = all(self.length(door, node) * self.cell >= _DOORS_APART for door in doors)
            if is_apart and self.widths[node] >= _NARROWEST_DOOR and self._is_door(node):
                self.kinds[node] = "door"
                doors.append(node)

    def _is_door(self, node: int) -> bool:
        """Return whether walls, no furniture, stand on opposite sides of wider spaces."""
        place, width = np.array(self.places[node]), self.widths[node]
        jambs, is_beside_walls = self._jambs(place, width / self.cell)
        if not len(jambs):
            return False
        gap = math.dist(*jambs)
        across = (jambs[0] - jambs[1]) / gap
        runs = [self._wall_beside(place + jamb, side * across)
                for jamb, side in zip(jambs, (1, -1), strict=True)]  # fmt: skip
        if not is_beside_walls and (min(runs) < _PIECE or sum(runs) < _PIECES):
            return False
        widths = sorted(self._width_seen(place, across, turn) for turn in (1, -1))
        wider, widest = _PROMINENCE if min(runs) >= _STUB else _WIDER, _WIDER * gap
        if width > _WIDE_DOOR:
            widest = min(_WIDE_RATIO * gap, _WIDE_SPACE / self.cell)
        return widths[0] >= wider * gap and widths[1] >= widest

    def _jambs(self, place: Floats, width: float) -> tuple[Floats, bool]:
        """Return the nearest obstacles on opposite sides, and whether both are walls."""
        labels, extents = self._pieces
        reach = _NEAR_JAMB * width / 2 + 2
        low = np.maximum((place - reach).astype(int), 0)
        high = (place + reach).astype(int) + 1
        near = extents[labels[low[0] : high[0], low[1] : high[1]]]
        is_wall = near >= _WALL
        for is_jamb in (is_wall, near > 0) if is_wall.any() else ():
            arms = np.argwhere(is_jamb) + low + 0.5 - place
            lengths = np.hypot(*arms.T)
            order = np.argsort(lengths, kind="stable")[: np.count_nonzero(lengths <= reach)]
            degrees = np.degrees(np.arctan2(*arms[order].T)).astype(int)
            order = order[np.unique(degrees, return_index=True)[1]]  # the nearest each
            arms, lengths = arms[order], lengths[order]
            cosines = (arms[:, np.newaxis] * arms).sum(axis=-1) / np.outer(lengths, lengths)
            sums = np.where(cosines < _OPPOSITE, np.add.outer(lengths, lengths), np.inf)
            if np.isfinite(sums).any():
                return arms[[*np.unravel_index(sums.argmin(), sums.shape)]], is_jamb is is_wall
        return np.zeros((0, 2)), False

    @cached_property
    def _pieces(self) -> tuple[Array, Floats]:
        """Return labels of pieces of walls up to four cells apart, and their extents in metres."""
        from scipy import ndimage

        closed = self.sweeps.closed != codes.FREE_SPACE
        labels, _ = ndimage.label(distance.dilate_square(closed, 2), np.ones((3, 3)))
        labels[~closed] = 0
        boxes = ndimage.find_objects(labels)
        sides = [max(side.stop - side.start for side in box) for box in boxes]
        return labels, self.cell * np.array([0, *sides])

    def _wall_beside(self, jamb: Floats, along: Floats) -> float:
        """Return the length of the walls in line with a door on one side, in metres."""
        closed = self.sweeps.closed
        directions = complex(*along) * np.exp(1j * _TURNS)
        step = max(1.0, _FINEST / self.cell)
        steps = np.arange(0, _LINE / self.cell, step)[:, np.newaxis, np.newaxis]
        aside = 1j * np.arange(-1, 2)[:, np.newaxis]
        lines = complex(*jamb) + (steps + aside) * directions
        rows, cols = np.floor(lines.real).astype(int), np.floor(lines.imag).astype(int)
        height, width = closed.shape
        is_inside = (rows >= 0) & (rows < height) & (cols >= 0) & (cols < width)
        values = closed[np.where(is_inside, rows, 0), np.where(is_inside, cols, 0)]
        is_wall = ((values == codes.LETHAL_OBSTACLE) & is_inside).any(axis=1)
        return float(is_wall.sum(axis=0).max()) * step * self.cell

    def _width_seen(self, place: Floats, across: Floats, turn: int) -> float:
        """Return the free width across a path over some length within a short way, in cells."""
        labels, _ = self._pieces
        ahead = turn * np.array([across[1], -across[0]])
        step = max(_HALF_CELL, _FINEST / self.cell)
        steps = np.arange(0, _SIGHT / self.cell, step)[:, np.newaxis]
        starts = place + ahead * np.arange(0, _AHEAD, _EVERY)[:, np.newaxis] / self.cell
        rays = np.stack([starts[:, np.newaxis] + side * steps * across for side in (1, -1)])
        rows, cols = np.clip(rays.astype(int), 0, np.array(labels.shape) - 1).transpose(3, 0, 1, 2)
        free = np.logical_and.accumulate(labels[rows, cols] == 0, axis=2).sum(axis=(0, 2))
        free *= np.logical_and.accumulate(free > 0)
        stretches = np.sort(sliding_window_view(free, _STRETCH), axis=1)
        return float(stretches[:, _HIDDEN].max()) * step

    def limit_edges(self) -> None:
        for node in list(self.beside):
            lengths = self.beside[node].copy()
            for end in sorted(lengths, key=lambda end: (-lengths[end], end)):
                if len(self.beside[node]) <= MOST_EDGES:
                    break
                clearance = self.drop_edge(node, end)
                if self.length_on_graph(node, end, 4 * self.spacing) == math.inf:
                    self.add_edge(node, end, clearance)

    def mend_blocked(self) -> None:
        """Replace edges that hit an obstacle by paths, or drop them with the parts they connect."""
        # Edges are tested again, as rounded places and divided lines change the tested positions. A
        # robot with corners may pass a place only sideways or while turning: without an edge.
        for _ in range(_ROUNDS):
            self.places = [(row, col) for row, col in self.rounded(self.places).tolist()]
            self._move_off_closed_edges()
            ends = np.array(sorted(self.edges), dtype=np.int64).reshape(-1, 2)
            starts, stops = self.at(ends[:, 0]), self.at(ends[:, 1])
            step = _FINE_STEP if self.has_corners else _HALF_CELL
            is_clear, _ = self.sweeps.along(starts, stops, touches=self.has_corners, step=step)
            blocked = ends[~is_clear].tolist()
            if not blocked:
                return
            for pair in blocked:
                self.drop_edge(*pair)
            if self.has_corners:
                break
            self.add_shortest_paths(blocked)
        parts, nodes = self.parts(), self.nodes()
        largest = np.bincount(parts[nodes]).argmax()
        for node in nodes:
            if parts[node] != largest:
                self.drop_node(node)
        self.lanes = [ends for ends in self.lanes if self.gone.isdisjoint(ends)]
        self.missing = self.uncovered(self.nodes())

    def _move_off_closed_edges(self) -> None:
        nodes = [node for node in self.nodes() if self.kinds[node] != "goal"]
        is_clear, _ = self.sweeps.along(self.at(nodes), self.at(nodes), touches=False)
        for node in np.array(nodes)[~is_clear].tolist():
            row, col = map(int, self.places[node])
            if (cell := reaching.nearest_marked(self.is_open, (row, col))) is not None:
                self.places[node] = cell[0] + 0.5, cell[1] + 0.5

    def part_lanes(self) -> None:
        """Divide lines between crossings into two lanes, each on the right, if there is room."""
        is_inner = {node for node in self.nodes()
                    if len(self.beside[node]) == 2 and self.kinds[node] == "way"}  # fmt: skip
        chains, traced = [], set()
        for node in sorted(is_inner):
            if node not in traced:
                ends = [self._line_from(node, end, is_inner) for end in sorted(self.beside[node])]
                chain = [*ends[0][::-1], node, *ends[1]]
                traced.update(chain[1:-1])
                if chain[0] not in is_inner and chain[0] != chain[-1]:
                    chains.append(chain)
        apart = self.turning + _APART / 2 / self.cell
        for chain in chains:
            clearance = min(self.edges[min(ends), max(ends)] for ends in pairwise(chain))
            aside = min(clearance / 2, _ASIDE / self.cell)
            if aside >= apart and clearance - aside >= apart:
                self._add_lanes(chain, aside)

    def _line_from(self, node: int, following: int, is_inner: set[int]) -> list[int]:
        line = [node, following]
        while line[-1] in is_inner and line[-1] != node:
            (onward,) = self.beside[line[-1]].keys() - {line[-2]}
            line.append(onward)
        return line[1:]

    def _add_lanes(self, chain: Sequence[int], aside: float) -> None:
        places = self.at(chain)
        along = places[2:] - places[:-2]
        along /= np.maximum(np.hypot(*along.T), 1e-9)[:, np.newaxis]
        right = along[:, ::-1] * [-1.0, 1.0]  # rows lead north, columns east
        shift = np.pad(aside * right, [(1, 1), (0, 0)])
        lanes = [self.rounded(places + shift), self.rounded(places - shift)]
        starts, ends = (np.concatenate([lane[part] for lane in lanes])
                        for part in (slice(None, -1), slice(1, None)))  # fmt: skip
        is_clear, _ = self.sweeps.along(starts, ends, step=_FINE_STEP)
        if not is_clear.all():
            return
        for start, end in pairwise(chain):
            self.drop_edge(start, end)
        self.gone.update(chain[1:-1])
        for lane, is_back in zip(lanes, (False, True), strict=True):
            new = [self.add_node((row, col), "way") for row, col in lane[1:-1].tolist()]
            nodes = [chain[0], *new, chain[-1]]
            self.lanes += list(pairwise(nodes[::-1] if is_back else nodes))


_ROUNDS = 20
_HALF_CELL, _FINE_STEP = 0.5, 0.125
"""Steps of checked positions, in cells; the fine one leaves no other result at any position."""
_APART = 0.2  # metres between robots on adjacent lanes, and between robots and walls
_ASIDE = 1.0  # metres: largest distance of a lane from the middle
_ON_WALLS = {"door", "crossing"}, {"narrow", "crossing"}
_RANKS: tuple[graph_drafts.Kind, ...] = ("goal", "door", "narrow", "crossing", "hall", "end", "way")
"""Of two merged nodes the one of the earlier kind remains."""


class _Path(NamedTuple):
    """Neighbouring cells, by their centres, between two nodes."""

    places: Floats
    start: int
    end: int
    before: float = 0.0  # clearance beyond both ends
    after: float = 0.0


class _Piece(NamedTuple):
    places: Floats
    clearances: Floats
    first: int
    start: int
    last: int
    end: int
