# cython: language_level=3, binding=False, embedsignature=False
# cython: boundscheck=False, wraparound=False, cdivision=True
"""Compiled reading of numbers in text, as Python's float() reads them, without the GIL.

The module numbers.py is their face to the rest; the algorithms are in numbers.h.
"""

from libc.stdint cimport int32_t, int64_t

cdef extern from "numbers.h" nogil:
    ctypedef struct Table:
        char delimiter
        int is_exact
        int64_t columns, longest_line
    ctypedef struct Taken:
        int64_t rows, lines, bytes
    int has_plain_locale()
    const char *read_numbers(const char *at, const char *end, int64_t count, double *values)
    int read_table(
        const Table *table, const char *text, int64_t length, const Taken *most, double *values,
        Taken *taken,
    )
    int64_t read_whole_numbers(const char *at, const char *end, int64_t most, int32_t *values)


def row(const unsigned char[::1] text, int64_t start, double[::1] values):
    """Read numbers with blanks between them; return the place behind the last, -1 if there are
    not so many, or one is not plainly a number.
    """
    cdef const char *found = NULL
    cdef const char *begin
    if not 0 <= start <= text.shape[0]:
        raise IndexError("no such place")
    if values.shape[0] == 0:
        return start
    if text.shape[0] == 0 or not has_plain_locale():
        return -1
    begin = <const char *>&text[0]
    with nogil:
        found = read_numbers(begin + start, begin + text.shape[0], values.shape[0], &values[0])
    return -1 if found == NULL else found - begin


def table(
    const unsigned char[::1] text, char delimiter, bint is_exact, int64_t longest_line,
    int64_t most_lines, int64_t most_bytes, double[:, ::1] values,
):
    """Read lines of numbers into rows; return rows, lines and bytes, or None at anything else."""
    cdef Table how
    cdef Taken most, taken
    cdef bint is_read
    if values.shape[1] == 0:
        raise ValueError("there must be a column")
    if not has_plain_locale():
        return None
    if text.shape[0] == 0 or values.shape[0] == 0:
        return 0, 0, 0
    how.delimiter, how.is_exact, how.longest_line = delimiter, is_exact, longest_line
    how.columns = values.shape[1]
    most.rows, most.lines, most.bytes = values.shape[0], most_lines, most_bytes
    with nogil:
        is_read = read_table(
            &how, <const char *>&text[0], text.shape[0], &most, &values[0, 0], &taken
        )
    return (taken.rows, taken.lines, taken.bytes) if is_read else None


def whole(const unsigned char[::1] text, int32_t[::1] values):
    """Read whole numbers of at most 9 digits; return how many, -1 at anything else."""
    cdef int64_t count = 0
    if text.shape[0] == 0:
        return 0
    if values.shape[0] == 0:
        return -1
    with nogil:
        count = read_whole_numbers(
            <const char *>&text[0], <const char *>&text[0] + text.shape[0], values.shape[0],
            &values[0],
        )
    return count
