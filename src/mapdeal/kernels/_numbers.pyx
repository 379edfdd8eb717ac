# cython: language_level=3, binding=False, embedsignature=False
# cython: boundscheck=False, wraparound=False, cdivision=True
"""Compiled reading of numbers in text, as Python's float() reads them.

The module numbers.py is their face to the rest; the algorithms are in numbers.h.
"""

from libc.stdint cimport int64_t

cdef extern from "numbers.h" nogil:
    int has_plain_locale()
    const char *read_numbers(const char *at, const char *end, int64_t count, double *values)
    int64_t read_table(
        const char *text, int64_t length, char delimiter, int64_t columns, int is_exact,
        int64_t most, double *values, int64_t *stopped, int64_t *lines,
    )


def row(const unsigned char[::1] text, int64_t start, double[::1] values):
    """Read numbers with blanks between them; return the place behind the last, -1 if there are
    not so many, or one is not plainly a number.
    """
    cdef const char *found = NULL
    cdef const char *begin
    if not 0 <= start <= text.shape[0]:
        raise IndexError("no such place")
    if values.shape[0] == 0 or text.shape[0] == 0 or not has_plain_locale():
        return start if values.shape[0] == 0 else -1
    begin = <const char *>&text[0]
    with nogil:
        found = read_numbers(begin + start, begin + text.shape[0], values.shape[0], &values[0])
    return -1 if found == NULL else found - begin


def table(
    const unsigned char[::1] text, char delimiter, bint is_exact, double[:, ::1] values,
):
    """Read lines of numbers into rows; return rows, bytes and lines, or None at anything else."""
    cdef int64_t stopped = 0, lines = 0, rows
    if values.shape[1] == 0:
        raise ValueError("there must be a column")
    if text.shape[0] == 0 or values.shape[0] == 0 or not has_plain_locale():
        return None
    with nogil:
        rows = read_table(
            <const char *>&text[0], text.shape[0], delimiter, values.shape[1], is_exact,
            values.shape[0], &values[0, 0], &stopped, &lines,
        )
    return None if rows < 0 else (rows, stopped, lines)
