# cython: language_level=3, binding=False, embedsignature=False
# cython: boundscheck=False, wraparound=False, cdivision=True
"""Compiled marking of the cells in which the points of a cloud lie, and reading of decimals.

The module sensing.py is its face to the rest; the algorithm of marking is in clouds.h.
"""

from libc.math cimport NAN
from libc.stdint cimport int64_t, uint8_t

cdef extern from *:  # of Python.h
    double PyOS_string_to_double(const char *text, char **end, void *overflow) except? -1.0

cdef double[23] POWERS = [10.0 ** k for k in range(23)]


cdef extern from "clouds.h" nogil:
    ctypedef struct CloudRule:
        int is_placed
        double x, y, cos, sin
        double offset_x, offset_y
        double least_height, most_height, least_range, most_range
        double corner_x, corner_y, frame_cos, frame_sin, resolution
        int64_t height, width
        double farthest, rounding, tolerance, corner_size

    int64_t mark_cloud(
        const double *points, int64_t count, int64_t width, const CloudRule *rule,
        uint8_t *hit, double *seen, int64_t *counts,
    )
    void cover_angles(
        const double *angles, int64_t count, double turn, double half, int64_t bins,
        double *first, double *last,
    )


def mark(
    const double[:, ::1] points, numbers, bint is_placed, uint8_t[:, ::1] hit,
    double[:, ::1] seen, int64_t[::1] counts,
):
    """Mark the cells of points, and count them; return how many rows of `seen` were filled."""
    if seen.shape[0] < points.shape[0] or seen.shape[1] != 2 or counts.shape[0] != 6:
        raise ValueError("the arrays do not fit")
    if points.shape[1] < 2:
        raise ValueError("points need two coordinates")
    if points.shape[0] == 0 or hit.shape[0] == 0 or hit.shape[1] == 0:
        raise ValueError("there must be points and cells")
    cdef CloudRule rule
    (
        rule.x, rule.y, rule.cos, rule.sin, rule.offset_x, rule.offset_y,
        rule.least_height, rule.most_height, rule.least_range, rule.most_range,
        rule.corner_x, rule.corner_y, rule.frame_cos, rule.frame_sin, rule.resolution,
        rule.farthest, rule.rounding, rule.tolerance,
    ) = numbers
    rule.is_placed = is_placed
    rule.height, rule.width = hit.shape[0], hit.shape[1]
    rule.corner_size = max(abs(rule.corner_x), abs(rule.corner_y))
    cdef int64_t count = points.shape[0], width = points.shape[1], found
    with nogil:
        found = mark_cloud(
            &points[0, 0], count, width, &rule, &hit[0, 0], &seen[0, 0], &counts[0]
        )
    return found


def cover(
    const double[::1] angles, double turn, double half, double[::1] first, double[::1] last
):
    """Put angles into the bins of a turn."""
    if first.shape[0] != last.shape[0] or first.shape[0] == 0:
        raise ValueError("the arrays do not fit")
    cdef int64_t count = angles.shape[0], bins = first.shape[0]
    if count:
        with nogil:
            cover_angles(&angles[0], count, turn, half, bins, &first[0], &last[0])


cdef inline bint is_space(char code) noexcept:
    return code == 32 or 9 <= code <= 13


def parse(bytes text, bint with_slashes, double[::1] numbers):
    """Fill numbers with the decimals between spaces, a v as nan, and return their count."""
    cdef const char *at = text
    cdef const char *end = at + len(text)
    cdef const char *first
    cdef char *last
    cdef int64_t count = 0, mantissa, digits, power, exponent
    cdef bint has_point, is_negative
    if numbers.shape[0] <= len(text) // 2:
        raise ValueError("the arrays do not fit")
    while True:
        while is_space(at[0]):
            at += 1
        if at == end:
            return count
        first = at
        is_negative = at[0] == c"-"
        at += is_negative or at[0] == c"+"
        mantissa = digits = power = exponent = has_point = 0
        while digits < 18 and (48 <= at[0] <= 57 or at[0] == c"." and not has_point):
            if at[0] == c".":
                has_point = True
            else:
                mantissa, digits, power = 10 * mantissa + at[0] - 48, digits + 1, power - has_point
            at += 1
        if digits and at[0] | 32 == c"e" and (at[1] == c"-" or at[1] == c"+"):
            if 48 <= at[2] <= 57 and 48 <= at[3] <= 57:
                exponent = 10 * at[2] + at[3] - 528
                power += -exponent if at[1] == c"-" else exponent
                at += 4
        if digits and mantissa >> 53 == 0 and -22 <= power <= 22 and (
            is_space(at[0]) or at == end or with_slashes and at[0] == c"/"
        ):  # both factors are exact, so the result is rounded once
            numbers[count] = mantissa / POWERS[-power] if power < 0 else mantissa * POWERS[power]
            numbers[count] = -numbers[count] if is_negative else numbers[count]
        elif first[0] == c"v":
            numbers[count], at = NAN, first + 1
        else:
            numbers[count] = PyOS_string_to_double(first, &last, NULL)
            at = last
        if with_slashes and at[0] == c"/":
            while at != end and not is_space(at[0]):
                at += 1
        count += 1
        if at != end and not is_space(at[0]):
            raise ValueError("no number")
