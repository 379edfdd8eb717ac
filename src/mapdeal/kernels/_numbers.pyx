# cython: language_level=3, binding=False, embedsignature=False
# cython: boundscheck=False, wraparound=False, cdivision=True
"""Compiled writing of numbers as text; number_texts.py is its face, number_texts.h does it."""

from cpython.bytearray cimport PyByteArray_AS_STRING
from cpython.bytes cimport PyBytes_AS_STRING, PyBytes_GET_SIZE
from cpython.mem cimport PyMem_RawFree, PyMem_RawMalloc
from cpython.unicode cimport PyUnicode_DecodeASCII
from libc.math cimport fabs, isfinite
from libc.stdint cimport uint8_t, uint64_t
from libc.string cimport memcpy

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
