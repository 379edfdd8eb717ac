# cython: language_level=3, binding=False, embedsignature=False
# cython: boundscheck=False, wraparound=False, cdivision=True
"""Compiled shapes of small reach around marked cells, without the GIL, rows by rows.

The module distance.py is their face to the rest; the algorithms are in dilation.h.
"""

from libc.stdint cimport int8_t, int16_t, int64_t, uint8_t

cdef extern from "dilation.h" nogil:
    enum:
        MOST_REACH
    ctypedef struct Put:
        int8_t value, threshold, kept
    ctypedef struct Shape:
        const uint8_t *marked
        const int8_t *values
        int8_t threshold
        int64_t height, width
        int64_t reach
        const uint8_t *half_widths
    int cover_rows(
        const Shape *shape, int is_square, int64_t bottom, int64_t top, uint8_t *covered,
        const Put *how, int8_t *put,
    )
    int ring_rows(
        const Shape *shape, const int8_t *costs, const int8_t *values, int64_t bottom,
        int64_t top, int8_t *ringed,
    )

most_reach = MOST_REACH


cdef int _set_shape(
    Shape *shape, const uint8_t[::1] half_widths, Py_ssize_t height, Py_ssize_t width,
    Py_ssize_t rows, Py_ssize_t columns, int64_t bottom, int64_t top,
) except -1:
    cdef Py_ssize_t k
    if (rows, columns) != (height, width) or width == 0:
        raise ValueError("the arrays are not of one shape, or empty")
    if not 0 <= bottom <= top <= height:
        raise IndexError("no such rows")
    if not 1 <= half_widths.shape[0] <= MOST_REACH + 1:
        raise ValueError("the shape is too large")
    shape.reach = half_widths.shape[0] - 1
    for k in range(half_widths.shape[0]):
        if half_widths[k] > shape.reach:
            raise ValueError("the shape is wider than high")
    shape.marked, shape.values, shape.threshold = NULL, NULL, 0
    shape.height, shape.width = height, width
    shape.half_widths = &half_widths[0]
    return 0


def cover(
    const uint8_t[:, ::1] marked, const uint8_t[::1] half_widths, bint is_square,
    uint8_t[:, ::1] covered, int64_t bottom, int64_t top,
):
    """Fill rows of a mask: 1 where a marked cell has a cell within the shape around it."""
    cdef Shape shape
    cdef int is_done
    _set_shape(
        &shape, half_widths, marked.shape[0], marked.shape[1], covered.shape[0], covered.shape[1],
        bottom, top,
    )
    if bottom == top:
        return
    shape.marked = &marked[0, 0]
    with nogil:
        is_done = cover_rows(&shape, is_square, bottom, top, &covered[0, 0], NULL, NULL)
    if not is_done:
        raise MemoryError


def put(
    const int8_t[:, ::1] values, int8_t threshold, const uint8_t[::1] half_widths,
    bint is_square, int8_t value, int16_t kept, int8_t[:, ::1] found,
    int64_t bottom, int64_t top,
):
    """Fill rows of values: those given, but `value` within the shape around those from a
    threshold on; those of `kept` stay, unless they are from the threshold on themselves.
    """
    cdef Shape shape
    cdef Put how
    cdef int is_done
    if not -128 <= kept <= 127:
        raise ValueError("no such value")
    _set_shape(
        &shape, half_widths, values.shape[0], values.shape[1], found.shape[0], found.shape[1],
        bottom, top,
    )
    if bottom == top:
        return
    shape.values, shape.threshold = &values[0, 0], threshold
    how.value, how.threshold, how.kept = value, threshold, <int8_t>kept
    with nogil:
        is_done = cover_rows(
            &shape, is_square, bottom, top, NULL, &how, &found[0, 0]
        )
    if not is_done:
        raise MemoryError


def ring(
    const uint8_t[:, ::1] marked, const uint8_t[::1] half_widths, const int8_t[::1] costs,
    const int8_t[:, ::1] values, int8_t[:, ::1] ringed, int64_t bottom, int64_t top,
):
    """Fill rows of values: those given, but for cells in a ring around marked ones its cost."""
    cdef Shape shape
    cdef int is_done
    _set_shape(
        &shape, half_widths, marked.shape[0], marked.shape[1], ringed.shape[0], ringed.shape[1],
        bottom, top,
    )
    if (values.shape[0], values.shape[1]) != (ringed.shape[0], ringed.shape[1]):
        raise ValueError("the arrays are not of one shape")
    if costs.shape[0] != half_widths.shape[0]:
        raise ValueError("there must be a cost for each ring, and for the cells within")
    if bottom == top:
        return
    shape.marked = &marked[0, 0]
    with nogil:
        is_done = ring_rows(&shape, &costs[0], &values[0, 0], bottom, top, &ringed[0, 0])
    if not is_done:
        raise MemoryError
