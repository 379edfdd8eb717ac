# cython: language_level=3, binding=False, embedsignature=False
# cython: boundscheck=False, wraparound=False, cdivision=True
"""Compiled clearance trees, without the GIL, in bands of rows.

The module compiled.py is their face to the rest; the algorithms are in clearance_tree.h.
"""

from cpython.exc cimport PyErr_CheckSignals
from libc.stdint cimport INT32_MAX, int32_t, int64_t, uint8_t, uint64_t
from libc.stdlib cimport calloc, free

cdef extern from "clearance_tree.h" nogil:
    const int64_t MOST_TREE_CELLS
    enum:
        DIGIT_BITS
    ctypedef struct Band:
        int32_t *peaks
        uint64_t *saddles
        int64_t peak_count, saddle_count, first_number, first_saddle
    ctypedef struct Forest:
        const int32_t *squared
        const uint8_t *traversable
        int64_t height, width, band_rows, bands
        int32_t *basins
        Band *found
    ctypedef struct Spanning:
        const int32_t *basins
        int64_t width
        const uint64_t *keys
        int32_t *sets
        int32_t *one
        int32_t *other
        int64_t *squares
        int64_t *cells
        int64_t kept
    ctypedef struct Rooted:
        const int32_t *one
        const int32_t *other
        const int64_t *squares
        int64_t basins, edges
        int32_t *begins
        int32_t *ends
        int32_t *order
        int32_t *parent_edges
        int64_t *bottlenecks
        int64_t found, done
    void fill_connected_straights()
    int point_band(const Forest *forest, int64_t number)
    void number_band(
        const Forest *forest, int64_t number, int64_t *peaks, int64_t *peak_cells
    )
    void join_band(const Forest *forest, int64_t number)
    int label_band(const Forest *forest, int64_t number)
    void take_saddles(const Forest *forest, int64_t number, uint64_t *keys)
    void sort_by_digit(
        const uint64_t *keys, uint64_t *sorted, int64_t count, int shift, int is_first
    )
    void span(Spanning *spanning, int64_t first, int64_t end)
    void list_edges_of_basins(Rooted *rooted)
    void root_on(Rooted *rooted, int64_t most)
    void paint_metres(
        const int32_t *squared, const int32_t *basins, const float *limits, double resolution,
        char *painted, int64_t count,
    )
    void limit_squares(
        const int32_t *squared, const int32_t *basins, const int32_t *limits, int32_t *widest,
        int64_t count,
    )
    void count_cells_above(
        const int32_t *squared, const int32_t *basins, int32_t above, int64_t count,
        int32_t *counts,
    )

fill_connected_straights()

most_cells = MOST_TREE_CELLS

cdef int64_t _BAND_CELLS = 131072  # 4 bytes each of squares and of pointers stay in the cache
cdef int64_t _BAND_ROWS_LEAST = 16
cdef int64_t _SOME = 1 << 18  # what is done between two looks at signals


cdef class Basins:
    """The basins of one grid, to be run band by band: point all, number, join, then label all.

    Every method works without the GIL. Different bands may be pointed, and labelled, at the same
    time.
    """

    cdef Forest forest
    cdef const int32_t[:, ::1] squared
    cdef const uint8_t[:, ::1] traversable
    cdef int32_t[:, ::1] basins

    def __cinit__(
        self,
        const int32_t[:, ::1] squared,
        const uint8_t[:, ::1] traversable,
        int32_t[:, ::1] basins,
    ):
        """Take squares, a mask of 0 and 1, and the result."""
        cdef int64_t height = squared.shape[0], width = squared.shape[1]
        if min(height, width) < 1:
            raise ValueError("the grid has no cells")
        if height * width > MOST_TREE_CELLS:
            raise OverflowError("the grid has too many cells")
        for axis in range(2):
            if not squared.shape[axis] == traversable.shape[axis] == basins.shape[axis]:
                raise ValueError("the arrays must be of one shape")
        self.squared, self.traversable, self.basins = squared, traversable, basins
        self.forest.squared, self.forest.traversable = &squared[0, 0], &traversable[0, 0]
        self.forest.basins = &basins[0, 0]
        self.forest.height, self.forest.width = height, width
        self.forest.band_rows = max(_BAND_CELLS // width, _BAND_ROWS_LEAST)
        self.forest.bands = (height + self.forest.band_rows - 1) // self.forest.band_rows
        self.forest.found = <Band *>calloc(self.forest.bands, sizeof(Band))
        if self.forest.found == NULL:
            raise MemoryError

    def __dealloc__(self):
        cdef int64_t band
        if self.forest.found != NULL:
            for band in range(self.forest.bands):
                free(self.forest.found[band].peaks)
                free(self.forest.found[band].saddles)
        free(self.forest.found)

    @property
    def bands(self):
        """Number of bands."""
        return self.forest.bands

    def point(self, int64_t first, int64_t end):
        """Point the cells of the bands first..end, and find their peaks and saddles."""
        cdef int64_t band
        cdef int done
        self._check_bands(first, end)
        for band in range(first, end):
            with nogil:
                done = point_band(&self.forest, band)
            if not done:
                raise MemoryError
            PyErr_CheckSignals()

    def counts(self):
        """Count the peaks and the edges at saddles, once all bands are pointed."""
        cdef int64_t band, peaks = 0, saddles = 0
        for band in range(self.forest.bands):
            self.forest.found[band].first_number = peaks
            self.forest.found[band].first_saddle = saddles
            peaks += self.forest.found[band].peak_count
            saddles += self.forest.found[band].saddle_count
        return peaks, saddles

    def number(self, int64_t[::1] peaks, int64_t[::1] peak_cells):
        """Number the peaks, and fill in their squares and cells, after counts."""
        cdef int64_t band
        cdef Band *last = self.forest.found + (self.forest.bands - 1)
        cdef int64_t count = last.first_number + last.peak_count
        if peaks.shape[0] != count or peak_cells.shape[0] != count:
            raise ValueError("the arrays must have an entry for each peak")
        if count == 0:
            return
        with nogil:
            for band in range(self.forest.bands):
                number_band(&self.forest, band, &peaks[0], &peak_cells[0])

    def join(self):
        """Join the bands, after number."""
        cdef int64_t band
        for band in range(self.forest.bands):
            with nogil:
                join_band(&self.forest, band)
            PyErr_CheckSignals()

    def label(self, int64_t first, int64_t end):
        """Label the cells of the bands first..end, after join."""
        cdef int64_t band
        cdef int done
        self._check_bands(first, end)
        for band in range(first, end):
            with nogil:
                done = label_band(&self.forest, band)
            if not done:
                raise MemoryError
            PyErr_CheckSignals()

    def take_edges(self, uint64_t[::1] keys):
        """Move the edges at saddles, by rising cell, from the bands to an array, after counts."""
        cdef int64_t band
        cdef Band *last = self.forest.found + (self.forest.bands - 1)
        if keys.shape[0] != last.first_saddle + last.saddle_count:
            raise ValueError("the array must have an entry for each edge")
        if keys.shape[0] == 0:
            return
        with nogil:
            for band in range(self.forest.bands):
                take_saddles(&self.forest, band, &keys[0])

    cdef _check_bands(self, int64_t first, int64_t end):
        if not 0 <= first <= end <= self.forest.bands:
            raise IndexError("no such bands")


def sort_edges(uint64_t[::1] keys, uint64_t[::1] spare):
    """Sort edges that rise by cell: by falling square, then falling cell.

    Return whether they then are in `spare`, which holds as many.
    """
    cdef int64_t k, count = keys.shape[0]
    cdef uint64_t most = 0
    cdef int shift = 32, turn = 0
    cdef uint64_t *source
    cdef uint64_t *target
    if spare.shape[0] != count:
        raise ValueError("the arrays must be of one length")
    if count == 0:
        return False
    source, target = &keys[0], &spare[0]
    with nogil:
        for k in range(count):
            most = max(most, source[k])
    while True:
        with nogil:
            sort_by_digit(source, target, count, shift, turn == 0)
        PyErr_CheckSignals()
        source, target = target, source
        turn += 1
        shift += DIGIT_BITS
        if shift >= 64 or most >> shift == 0:
            return turn % 2 == 1


def span_basins(
    const int32_t[:, ::1] basins,
    const uint64_t[::1] keys,
    int32_t[::1] sets,
    int32_t[::1] one,
    int32_t[::1] other,
    int64_t[::1] squares,
    int64_t[::1] cells,
):
    """Fill in the edges of the spanning forest that prefers the first ones; return their number.

    `sets` is 0, 1, ... for the basins, and in the end of no use. The arrays of edges have a place
    for each basin.
    """
    cdef Spanning spanning
    cdef int64_t first = 0, count = keys.shape[0], room = sets.shape[0]
    if not room == one.shape[0] == other.shape[0] == squares.shape[0] == cells.shape[0]:
        raise ValueError("the arrays must have a place for each basin")
    if count == 0 or room == 0:
        return 0
    spanning.basins, spanning.width, spanning.keys = &basins[0, 0], basins.shape[1], &keys[0]
    spanning.sets, spanning.one, spanning.other = &sets[0], &one[0], &other[0]
    spanning.squares, spanning.cells, spanning.kept = &squares[0], &cells[0], 0
    while first < count:
        with nogil:
            span(&spanning, first, min(first + _SOME, count))
        first += _SOME
        PyErr_CheckSignals()
    return spanning.kept


def root_tree(
    const int32_t[::1] one,
    const int32_t[::1] other,
    const int64_t[::1] squares,
    int32_t[::1] begins,
    int32_t[::1] ends,
    int32_t[::1] order,
    int32_t[::1] parent_edges,
    int64_t[::1] bottlenecks,
):
    """Fill in a tree seen from `order[0]`, whose bottleneck is given; return how many are found.

    There is a place in `begins` for each basin and one more, in `ends` for both ends of each edge.
    """
    cdef Rooted rooted
    cdef int64_t count = order.shape[0], edges = one.shape[0]
    if other.shape[0] != edges or squares.shape[0] != edges or ends.shape[0] != 2 * edges:
        raise ValueError("the arrays must have a place for each edge")
    if begins.shape[0] != count + 1 or not count == parent_edges.shape[0] == bottlenecks.shape[0]:
        raise ValueError("the arrays must have a place for each basin")
    if edges == 0:
        return 1
    rooted.one, rooted.other, rooted.squares = &one[0], &other[0], &squares[0]
    rooted.basins, rooted.edges = count, edges
    rooted.begins, rooted.ends, rooted.order = &begins[0], &ends[0], &order[0]
    rooted.parent_edges, rooted.bottlenecks = &parent_edges[0], &bottlenecks[0]
    rooted.found, rooted.done = 1, 0
    with nogil:
        list_edges_of_basins(&rooted)
    while rooted.done < rooted.found:
        with nogil:
            root_on(&rooted, _SOME)
        PyErr_CheckSignals()
    return rooted.found


def paint(
    const int32_t[:, ::1] squared,
    const int32_t[:, ::1] basins,
    const float[::1] limits,
    double resolution,
    uint8_t[:, ::1] painted,
):
    """Set the bytes of `painted` to metres: the lesser of each cell's and the limit of its basin.

    Limits begin with that of -1. Without basins there is no limit.
    """
    cdef int64_t count = squared.shape[0] * squared.shape[1]
    if painted.shape[0] != squared.shape[0] or painted.shape[1] != 4 * squared.shape[1]:
        raise ValueError("the result has not the size of its cells")
    if count == 0:
        return
    if basins is None:
        with nogil:
            paint_metres(
                &squared[0, 0], NULL, NULL, resolution, <char *>&painted[0, 0], count
            )
        return
    if basins.shape[0] != squared.shape[0] or basins.shape[1] != squared.shape[1]:
        raise ValueError("the arrays must be of one shape")
    if limits is None or limits.shape[0] == 0:
        raise ValueError("there must be a limit for each basin")
    with nogil:
        paint_metres(
            &squared[0, 0], &basins[0, 0], &limits[0], resolution, <char *>&painted[0, 0], count
        )


def limit(
    const int32_t[:, ::1] squared,
    const int32_t[:, ::1] basins,
    const int32_t[::1] limits,
    int32_t[:, ::1] widest,
):
    """Set `widest` to the lesser of each cell's square and the limit of its basin, as in paint."""
    for axis in range(2):
        if not squared.shape[axis] == basins.shape[axis] == widest.shape[axis]:
            raise ValueError("the arrays must be of one shape")
    if squared.shape[0] * squared.shape[1] == 0:
        return
    if limits.shape[0] == 0:
        raise ValueError("there must be a limit for each basin")
    with nogil:
        limit_squares(
            &squared[0, 0], &basins[0, 0], &limits[0], &widest[0, 0],
            squared.shape[0] * squared.shape[1],
        )


def count_above(
    const int32_t[:, ::1] squared,
    const int32_t[:, ::1] basins,
    int64_t above,
    int32_t[::1] counts,
):
    """Add to `counts`, the first of which is of -1, each basin's cells with a square above."""
    if basins.shape[0] != squared.shape[0] or basins.shape[1] != squared.shape[1]:
        raise ValueError("the arrays must be of one shape")
    if counts.shape[0] == 0:
        raise ValueError("there must be a count for each basin")
    if squared.shape[0] * squared.shape[1] == 0:
        return
    with nogil:
        count_cells_above(
            &squared[0, 0], &basins[0, 0], <int32_t>min(max(above, -1), INT32_MAX),
            squared.shape[0] * squared.shape[1], &counts[0],
        )
