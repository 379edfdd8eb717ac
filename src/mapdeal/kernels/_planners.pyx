# cython: language_level=3, binding=False, embedsignature=False
# cython: boundscheck=False, wraparound=False, cdivision=True
"""Compiled search and trace of NavFn, without the GIL.

The module searches.py is its face to the rest; the algorithm is in navfn.h.
"""

from libc.stdint cimport int64_t, uint8_t
from libc.stdlib cimport free, malloc


cdef extern from "navfn.h" nogil:
    int NAVFN_ROOM
    void navfn_search(
        const uint8_t *costmap, const uint8_t *table, int64_t width, int64_t height, int64_t start,
        int64_t start_x, int64_t start_y, int64_t target_x, int64_t target_y, int is_astar,
        float *potential, uint8_t *work, int64_t *buffers,
    )
    int64_t navfn_trace(
        const float *potential, int64_t width, int64_t height, int64_t start_x, int64_t start_y,
        int64_t cell, int64_t turns, float *path, int *outcome,
    )


def search(
    const uint8_t[:, ::1] costmap, const uint8_t[::1] table, (int64_t, int64_t) start,
    (int64_t, int64_t) target, bint is_astar, float[:, ::1] potential,
):
    """Fill the potentials of a costmap; cells are x and y."""
    cdef int64_t height = costmap.shape[0], width = costmap.shape[1], cell
    cell = start[1] * width + start[0]
    if table.shape[0] != 256 or potential.shape[0] != height or potential.shape[1] != width:
        raise ValueError("the arrays do not fit")
    if not (0 <= cell < height * width and target[0] >= 0 and target[1] >= 0):
        raise ValueError("the cells are not in the costmap")
    cdef uint8_t *work = <uint8_t *>malloc(2 * height * width)
    cdef int64_t *buffers = <int64_t *>malloc(3 * NAVFN_ROOM * sizeof(int64_t))
    if work == NULL or buffers == NULL:
        free(work)
        free(buffers)
        raise MemoryError
    with nogil:
        navfn_search(
            &costmap[0, 0], &table[0], width, height, cell, start[0], start[1], target[0],
            target[1], is_astar, &potential[0, 0], work, buffers,
        )
        free(work)
        free(buffers)


def trace(
    const float[:, ::1] potential, (int64_t, int64_t) start, (int64_t, int64_t) goal,
    float[:, ::1] path,
):
    """Fill the path from the goal to the start; return the number of its points, and an outcome."""
    cdef int64_t height = potential.shape[0], width = potential.shape[1], turns = path.shape[0]
    cdef int64_t cell = goal[1] * width + goal[0], count
    cdef int outcome
    if path.shape[1] != 2 or turns < 1 or not 0 <= cell < height * width:
        raise ValueError("the arrays do not fit")
    with nogil:
        count = navfn_trace(
            &potential[0, 0], width, height, start[0], start[1], cell, turns, &path[0, 0], &outcome
        )
    return count, outcome
