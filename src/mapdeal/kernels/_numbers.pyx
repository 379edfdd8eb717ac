# cython: language_level=3, binding=False, embedsignature=False
# cython: boundscheck=False, wraparound=False, cdivision=True
"""Compiled reading of numbers in text, as Python's float() reads them, and writing of them.

The modules numbers.py and number_texts.py are their face to the rest; the algorithms are in
numbers.h and number_texts.h.
"""

from cpython.bytearray cimport PyByteArray_AS_STRING
from cpython.bytes cimport PyBytes_AS_STRING, PyBytes_GET_SIZE
from cpython.mem cimport PyMem_RawFree, PyMem_RawMalloc
from cpython.unicode cimport PyUnicode_DecodeASCII
from libc.math cimport fabs, isfinite
from libc.stdint cimport int32_t, int64_t, uint8_t, uint64_t
from libc.string cimport memcpy

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


cdef extern from "number_texts.h" nogil:
    enum: LONGEST_TEXT
    char *double_written(double value, char *to)
    char *single_written(double value, char *to)
    char *nine_written(double value, char *to)
    char *digits_written(uint64_t digits, char *to)

cdef enum Kind:
    EXACT, SINGLE, WHOLE

cdef double _NOISE = 1e-12
cdef double _LARGEST_WHOLE = 1e15


cdef struct Piece:
    const char *text
    Py_ssize_t size
    int column  # whose number comes behind the text; -1 at the end of a form


cdef char *_spelt(double value, int kind, object spell, char *to) except NULL:
    """Write one of those few numbers that are not written here."""
    text = spell(value, kind)
    if PyBytes_GET_SIZE(text) > LONGEST_TEXT:
        raise ValueError("the text of a number is too long")
    memcpy(to, PyBytes_AS_STRING(text), PyBytes_GET_SIZE(text))
    return to + PyBytes_GET_SIZE(text)


cdef inline char *_written(double value, int kind, char *to) noexcept nogil:
    """Write a number; return the end of its text, or NULL if it is not written here."""
    if not isfinite(value):
        memcpy(to, b"null", 4)
        return to + 4
    if kind == EXACT:
        return double_written(value, to)
    if kind == WHOLE:
        if not fabs(value) < _LARGEST_WHOLE:
            return NULL
        if value < 0:
            to[0] = b"-"
            to += 1
        return digits_written(<uint64_t>fabs(value), to)
    if fabs(value) < _NOISE:
        value = 0.0
    if <double><float>value == value:
        return single_written(value, to)
    return nine_written(value, to)


cdef char *_rows_written(
    const double[:, ::1] values, const uint8_t[::1] kinds, const uint8_t[::1] chosen,
    const Piece *pieces, const Py_ssize_t *first, object spell, char *to,
) except NULL:
    """Write rows, each in the form whose pieces begin at `first`; return the end of the text."""
    cdef Py_ssize_t row
    cdef int column
    cdef const Piece *piece
    cdef char *end
    with nogil:
        for row in range(values.shape[0]):
            piece = &pieces[first[chosen[row]]]
            while True:
                memcpy(to, piece.text, piece.size)
                to += piece.size
                column = piece.column
                if column < 0:
                    break
                end = _written(values[row, column], kinds[column], to)
                if end == NULL:
                    with gil:
                        end = _spelt(values[row, column], kinds[column], spell, to)
                to = end
                piece += 1
    return to


def rows(
    const double[:, ::1] values, const uint8_t[::1] kinds, const uint8_t[::1] chosen,
    list forms, object spell,
):
    """Return the texts of rows, each made by one of several forms: texts, and columns behind."""
    cdef Py_ssize_t longest = 0, count = 0, row, size
    cdef char *made
    cdef char *to
    cdef int column = 0
    cdef Py_ssize_t[256] first
    cdef Piece *pieces
    cdef bytes text
    cdef bytearray all_pieces
    if kinds.shape[0] != values.shape[1] or chosen.shape[0] != values.shape[0]:
        raise ValueError("the arrays are not of one shape")
    if not 0 < len(forms) <= 256:
        raise ValueError("there must be 1 to 256 forms")
    all_pieces = bytearray(sum(len(form) for form in forms) * sizeof(Piece))
    pieces = <Piece *>PyByteArray_AS_STRING(all_pieces)
    for row in range(len(forms)):
        first[row] = count
        size = 0
        for text, column in forms[row]:
            if column >= kinds.shape[0]:
                raise IndexError("no such column")
            pieces[count].text, pieces[count].size = PyBytes_AS_STRING(text), len(text)
            pieces[count].column = column
            size += len(text) + LONGEST_TEXT
            count += 1
        if size == 0 or column >= 0:
            raise ValueError("a form must end in a text")
        longest = max(longest, size)
    for row in range(chosen.shape[0]):
        if chosen[row] >= len(forms):
            raise IndexError("no such form")
    made = <char *>PyMem_RawMalloc(longest * values.shape[0] + 1)
    if made == NULL:
        raise MemoryError
    try:
        to = _rows_written(values, kinds, chosen, pieces, first, spell, made)
        return PyUnicode_DecodeASCII(made, to - made, NULL)
    finally:
        PyMem_RawFree(made)
