# cython: language_level=3, binding=False, embedsignature=False
# cython: boundscheck=False, wraparound=False, cdivision=True
"""Compiled updates of a robot's costmap, in cells; the algorithms are in updates.h."""

from libc.stdint cimport int32_t, int64_t, uint8_t, uint32_t

cdef extern from "updates.h" nogil:
    ctypedef struct Sensed:
        int64_t height, width
        uint8_t *costs
        uint32_t *columns
        int mark_threshold, unknown_threshold
    ctypedef struct Queue:
        int64_t width, most
        int32_t *squares
        int32_t *queue
        int32_t *firsts
        int32_t *lasts
        int32_t count
    int clear_along(
        const Sensed *grid, const int64_t *starts, const int64_t *deltas, const int64_t *steps,
        int64_t axes, int64_t rays,
    )
    void spread_queue(Queue *queue, const uint8_t *seeds, int64_t cells)


def clear(
    const int64_t[:, ::1] starts, const int64_t[:, ::1] deltas, const int64_t[::1] steps,
    uint8_t[:, ::1] costs, uint32_t[:, ::1] columns, int mark_threshold, int unknown_threshold,
):
    """Clear the cells of rays with two axes, or the voxels of rays with three."""
    cdef Sensed grid
    cdef Py_ssize_t axes = starts.shape[0], rays = steps.shape[0]
    if axes not in (2, 3) or (deltas.shape[0], starts.shape[1], deltas.shape[1]) != (axes, rays, rays):
        raise ValueError("the arrays are not of one number of rays")
    if axes == 3 and (columns.shape[0], columns.shape[1]) != (costs.shape[0], costs.shape[1]):
        raise ValueError("the grids are not of one shape")
    if rays == 0:
        return
    grid.height, grid.width = costs.shape[0], costs.shape[1]
    grid.costs, grid.columns = &costs[0, 0], &columns[0, 0] if axes == 3 else NULL
    grid.mark_threshold, grid.unknown_threshold = mark_threshold, unknown_threshold
    if not clear_along(&grid, &starts[0, 0], &deltas[0, 0], &steps[0], axes, rays):
        raise IndexError("a ray leaves the grid")


def spread(
    const uint8_t[:, ::1] seeds, int32_t[:, ::1] squares, int32_t[:, ::1] queue,
    int32_t[:, ::1] ends, int64_t most,
):
    """Set the squared distance to the seed from which the queue reaches each cell."""
    cdef Queue entries
    cdef Py_ssize_t cells = seeds.shape[0] * seeds.shape[1]
    if not 0 < cells < 2**31 // 5 or (squares.shape[0], squares.shape[1]) != (seeds.shape[0], seeds.shape[1]):
        raise ValueError("the grids are not of one shape, empty or too large")
    if (queue.shape[0], queue.shape[1], ends.shape[0], ends.shape[1]) != (5 * cells, 3, 2, most + 1):
        raise ValueError("the queue has another size")
    entries.width, entries.most, entries.count = seeds.shape[1], most, 0
    entries.squares, entries.queue = &squares[0, 0], &queue[0, 0]
    entries.firsts, entries.lasts = &ends[0, 0], &ends[1, 0]
    spread_queue(&entries, &seeds[0, 0], cells)
