# cython: language_level=3, binding=False, embedsignature=False
# cython: boundscheck=False, wraparound=False, cdivision=True
"""Compiled rays, without the GIL: what beams leave in the rows `bottom` .. `top` - 1 of a grid.

The module sensing.py is their face to the rest; the algorithms are in rays.h.
"""

from libc.stdint cimport int32_t, int64_t, uint8_t

cdef extern from "rays.h" nogil:
    ctypedef struct Part:
        int64_t bottom, top, width
    ctypedef struct Odds:
        int32_t on_miss, on_hit, lowest, highest
    void count_in(
        const Part *part, const int64_t *starts, const int64_t *ends, const uint8_t *is_hit,
        int64_t beams, int32_t *hits, int32_t *misses,
    )
    void weigh_in(
        const Part *part, const int64_t *starts, const int64_t *ends, const uint8_t *is_hit,
        int64_t beams, const Odds *odds, int32_t *values, uint8_t *seen,
    )
    void measure_in(
        const Part *part, const int64_t *starts, const int64_t *ends, const double *sensors,
        const double *ranges, int64_t beams, double truncation, double behind, double cell,
        int64_t *sums, double *means, int32_t *weights,
    )
    ctypedef struct Lattice:
        double x, y, cosine, sine, resolution, rounding, tolerance, farthest
    int cells_of_points(
        const Lattice *lattice, const double *points, int64_t count, int64_t *cells
    )
    void cast_in(
        const uint8_t *room, int64_t height, int64_t width, const double *starts,
        const double *directions, int64_t scans, int64_t beams, double limit, double *distances,
    )


cdef int _check_beams(
    const int64_t[:, ::1] starts, const int64_t[:, ::1] ends, Py_ssize_t others
) except -1:
    if starts.shape[1] != 2 or ends.shape[1] != 2:
        raise ValueError("cells have two columns")
    if not starts.shape[0] == ends.shape[0] == others:
        raise ValueError("the arrays are not of one number of beams")
    return 0


cdef int _set_part(
    Part *part, int64_t bottom, int64_t top, const int32_t[:, ::1] cells, shape
) except -1:
    if not 0 <= bottom <= top <= cells.shape[0]:
        raise IndexError("no such rows")
    if shape != (cells.shape[0], cells.shape[1]) or cells.shape[1] == 0:
        raise ValueError("the layers are not of one shape, or empty")
    part.bottom, part.top, part.width = bottom, top, cells.shape[1]
    return 0


def count(
    const int64_t[:, ::1] starts, const int64_t[:, ::1] ends, const uint8_t[::1] is_hit,
    int32_t[:, ::1] hits, int32_t[:, ::1] misses, int64_t bottom, int64_t top,
):
    """Count in each cell the beams that end in it with a hit, and those that pass it."""
    cdef Part part
    _check_beams(starts, ends, is_hit.shape[0])
    _set_part(&part, bottom, top, hits, (misses.shape[0], misses.shape[1]))
    if starts.shape[0] == 0:
        return
    with nogil:
        count_in(
            &part, &starts[0, 0], &ends[0, 0], &is_hit[0], starts.shape[0], &hits[0, 0],
            &misses[0, 0],
        )


def weigh(
    const int64_t[:, ::1] starts, const int64_t[:, ::1] ends, const uint8_t[::1] is_hit,
    int32_t on_miss, int32_t on_hit, int32_t lowest, int32_t highest,
    int32_t[:, ::1] values, uint8_t[:, ::1] seen, int64_t bottom, int64_t top,
):
    """Add to each cell's value what each beam says of it, and clamp, beam by beam."""
    cdef Part part
    cdef Odds odds
    _check_beams(starts, ends, is_hit.shape[0])
    _set_part(&part, bottom, top, values, (seen.shape[0], seen.shape[1]))
    odds.on_miss, odds.on_hit, odds.lowest, odds.highest = on_miss, on_hit, lowest, highest
    if starts.shape[0] == 0:
        return
    with nogil:
        weigh_in(
            &part, &starts[0, 0], &ends[0, 0], &is_hit[0], starts.shape[0], &odds, &values[0, 0],
            &seen[0, 0],
        )


def measure(
    const int64_t[:, ::1] starts, const int64_t[:, ::1] ends, const double[:, ::1] sensors,
    const double[::1] ranges, double truncation, double behind, double cell, sums,
    int32_t[:, ::1] weights, int64_t bottom, int64_t top,
):
    """Add to each cell its signed distance along each beam, or take the mean; count the beams."""
    cdef Part part
    cdef int64_t[:, ::1] whole
    cdef double[:, ::1] means
    cdef int64_t *wholes = NULL
    cdef double *mean = NULL
    _check_beams(starts, ends, ranges.shape[0])
    if sensors.shape[0] != starts.shape[0] or sensors.shape[1] != 2:
        raise ValueError("there must be a sensor for each beam")
    _set_part(&part, bottom, top, weights, (sums.shape[0], sums.shape[1]))
    if starts.shape[0] == 0:
        return
    if sums.dtype == "float64":
        means = sums
        mean = &means[0, 0]
    else:
        whole = sums
        wholes = &whole[0, 0]
    with nogil:
        measure_in(
            &part, &starts[0, 0], &ends[0, 0], &sensors[0, 0], &ranges[0], starts.shape[0],
            truncation, behind, cell, wholes, mean, &weights[0, 0],
        )


def cells(
    const double[:, ::1] points, int64_t[:, ::1] found, double x, double y, double cosine,
    double sine, double resolution, double rounding, double tolerance, double farthest,
):
    """Find the cells of points; return whether all are finite, and not too far."""
    cdef Lattice lattice
    cdef bint is_near
    if points.shape[1] != 2 or found.shape[1] != 2 or points.shape[0] != found.shape[0]:
        raise ValueError("points and cells have two columns, and are as many")
    if points.shape[0] == 0:
        return True
    lattice.x, lattice.y, lattice.cosine, lattice.sine = x, y, cosine, sine
    lattice.resolution, lattice.rounding, lattice.tolerance = resolution, rounding, tolerance
    lattice.farthest = farthest
    with nogil:
        is_near = cells_of_points(&lattice, &points[0, 0], points.shape[0], &found[0, 0])
    return is_near


def cast(
    const uint8_t[:, ::1] room, const double[:, ::1] starts, const double[:, :, ::1] directions,
    double limit, double[:, ::1] distances,
):
    """Find the distance along each ray to the first obstacle, in cells, infinite without one."""
    cdef Py_ssize_t scans = distances.shape[0], beams = distances.shape[1]
    if (starts.shape[0], starts.shape[1]) != (scans, 2):
        raise ValueError("there must be a start for each scan")
    if (directions.shape[0], directions.shape[1], directions.shape[2]) != (scans, beams, 2):
        raise ValueError("there must be a direction for each beam")
    if room.shape[0] == 0 or room.shape[1] == 0 or scans == 0 or beams == 0:
        return
    with nogil:
        cast_in(
            &room[0, 0], room.shape[0], room.shape[1], &starts[0, 0], &directions[0, 0, 0], scans,
            beams, limit, &distances[0, 0],
        )
