"""Where the large regions of a forest meet, on bare arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def joined(
    count: int,
    one: NDArray[np.integer],
    other: NDArray[np.integer],
    is_large: NDArray[np.bool_] | None = None,
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Join nodes over edges, but never two large ones.

    The edges are taken one after the other, as Kruskal does: each joins what it links, unless a
    large node is part of both already.

    Parameters
    ----------
    count : int
        Number of nodes.
    one, other : numpy.ndarray of int, shape (E,)
        The nodes that each edge links; together they must be a forest.
    is_large : numpy.ndarray of bool, shape (count,), optional
        Which nodes are large; none by default, which gives the connected components.

    Returns
    -------
    labels : numpy.ndarray of intp, shape (count,)
        A node that stands for all that each node is joined with: the large one if there is one.
    meetings : numpy.ndarray of intp, shape (M,)
        The edges that joined nothing, increasing: there two large nodes meet.

    Notes
    -----
    A node that is not large is alone until its first edge comes. That edge joins it whatever else
    has been joined by then, so all such nodes can be joined over their first edge at once; as in
    Boruvka's algorithm, a few such rounds are enough.
    """
    into = np.arange(count)
    edges = np.arange(len(one))
    ends = np.stack([one, other], axis=1).astype(np.intp, copy=False)
    may_move = np.ones(count, dtype=np.bool_) if is_large is None else ~is_large
    while len(edges):
        moving = ends[may_move[ends]]
        if not len(moving):
            break
        _join_over_first_edge(into, ends, moving, may_move)
        ends = into[ends]
        is_left = ends[:, 0] != ends[:, 1]
        edges, ends = edges[is_left], ends[is_left]
    _follow(into, np.arange(count))
    return into, edges


def _join_over_first_edge(
    into: NDArray[np.intp], ends: NDArray[np.intp], moving: NDArray[np.intp],
    may_move: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Let nodes point to what they become, in place.

    Of all nodes in `ends` those in `moving` may; both may name a node more than once.
    """
    backwards = ends[::-1]
    first, second = backwards[:, 1], backwards[:, 0]
    # Of several values for one place the last one stays: that of the first edge.
    into[backwards.ravel()] = np.stack([first, second], axis=1).ravel()
    staying = ends[~may_move[ends]]
    into[staying] = staying
    is_mutual = (into[into[moving]] == moving) & (moving < into[moving])
    into[moving[is_mutual]] = moving[is_mutual]
    _follow(into, moving)


def _follow(into: NDArray[np.intp], nodes: NDArray[np.intp]) -> None:
    """Let nodes point to where the ways from them end, in place."""
    nearer = into[nodes]
    while True:
        farther = into[nearer]
        if np.array_equal(farther, nearer):
            return
        into[nodes] = nearer = farther


def sums_behind(
    one: NDArray[np.intp], other: NDArray[np.intp], root: int, values: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.intp], NDArray[np.intp]]:  # fmt: skip
    """Return what lies behind each edge of a forest, seen from a node.

    Parameters
    ----------
    one, other : numpy.ndarray of int, shape (E,)
        The nodes that each edge links; together they must be a forest.
    root : int
        Where it is seen from.
    values : numpy.ndarray of float64, shape (N, ...)
        What each node adds.

    Returns
    -------
    sums : numpy.ndarray of float64, shape (E, ...)
        The sum of the values of all nodes behind each edge; nan where there is no way from the
        root.
    near, far : numpy.ndarray of int, shape (E,)
        The nodes before and behind the edge; -1 where there is no way.
    """
    edges_at: dict[int, list[int]] = {}
    for edge, pair in enumerate(zip(one.tolist(), other.tolist(), strict=True)):
        for node in pair:
            edges_at.setdefault(node, []).append(edge)
    near, far = np.full(len(one), -1), np.full(len(one), -1)
    order: list[int] = []
    waiting = [root]
    while waiting:
        node = waiting.pop()
        for edge in edges_at.get(node, ()):
            if near[edge] < 0:
                near[edge], far[edge] = node, one[edge] + other[edge] - node
                order.append(edge)
                waiting.append(int(far[edge]))
    sums = values.astype(np.float64, copy=True)
    for edge in reversed(order):
        sums[near[edge]] += sums[far[edge]]
    behind = sums[far]
    behind[far < 0] = np.nan
    return behind, near, far
