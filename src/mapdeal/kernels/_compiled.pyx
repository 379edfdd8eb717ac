# cython: language_level=3, binding=False, embedsignature=False
# cython: boundscheck=False, wraparound=False, cdivision=True
"""Compiled kernels, without the GIL: distance transforms in bands of rows, table look-ups,
interpolation, footprints, lines, the search for paths, floods, and LZF.

The modules compiled.py, lookup.py, outlines.py, polygons.py, paths.py, skeleton.py and sensing.py
are their face to the rest; the algorithms are in the headers.
"""

from cpython.exc cimport PyErr_CheckSignals
from libc.math cimport INFINITY, M_PI, asin, atan2, remainder, sqrt
from libc.stdint cimport int8_t, int32_t, int64_t, uint8_t, uint32_t, uint64_t
from libc.stdlib cimport calloc, free, malloc
from libc.string cimport memset

cdef extern from "distance_rows.h" nogil:
    const int NEAR_REACH, NEAR_SQUARE, NEAR_MOST
    const int64_t UNREACHABLE
    enum: LONGEST_SIDE
    ctypedef enum Form:
        SQUARES_32, SQUARES_64, METRES, BYTES
    ctypedef struct Task:
        const uint8_t *marked
        int64_t height, width, whole_height, band_rows, bands
        const uint8_t *row_before, *row_after
        const uint32_t *down_before, *up_after
        Form form
        int both_kinds
        int64_t limit
        int near_reach, near_most, has_far
        double scale, outside_shift, inside_shift, clip, gain
        const float *near_metres
        const uint8_t *bytes
        void *cells
    void fill_squares_16()
    float metres_of(const Task *task, double square)
    void scan_band(const Task *task, int64_t band, uint32_t *down, uint32_t *up)
    void join_bands(const Task *task, uint32_t *down, uint32_t *up)
    int solve_band(const Task *task, const uint32_t *down, const uint32_t *up, int64_t band)

cdef extern from "lookup.h" nogil:
    ctypedef struct Measure:
        double scale, shift, gain, clip
        int64_t last
    void bytes_of_row(
        const Measure *measure,
        const float *distance,
        const uint8_t *obstacles,
        const uint8_t *table,
        uint8_t *bytes,
        int64_t width,
    )
    ctypedef struct Runs:
        int count
    bint runs_of_table(const uint8_t *table, Runs *runs)
    void look_up_runs(const Runs *runs, const uint8_t *source, uint8_t *target, int64_t count)
    void look_up_bytes(
        const uint8_t *table, const uint8_t *source, uint8_t *target, int64_t count
    )
    void count_all(const uint8_t *cells, int64_t count, int64_t *counts)
    void raise_bytes(uint8_t *costs, const uint8_t *asked, uint8_t least, int64_t count)
    ctypedef struct LevelScale:
        float low, factor, last
        uint8_t first, below, faded_by
    void levels_of(
        const LevelScale *scale, const float *distance, const uint8_t *obstacles,
        const uint8_t *unknown, uint8_t *levels, int64_t count,
    )

cdef extern from "bilinear.h" nogil:
    void interpolate_places(
        const float *values, int64_t height, int64_t width,
        const double *places, int64_t count, double *between, double *slopes,
    )

cdef extern from "footprints.h" nogil:
    enum:
        MOST_CORNERS
    ctypedef struct FootprintTask:
        const uint8_t *costs
        int64_t height, width
        double resolution, x, y, cos, sin
        const double *corners
        int64_t count
        int filled
    void costs_of_footprint(
        const FootprintTask *task, const double *poses, int64_t count, uint8_t *costs,
        uint8_t *inside,
    )

cdef extern from "lzf.h" nogil:
    int lzf_expanded(const uint8_t *data, int64_t length, uint8_t *expanded, int64_t size)

cdef extern from "search.h" nogil:
    enum:
        SEARCH_GOES_ON, SEARCH_FOUND, SEARCH_IN_VAIN, SEARCH_OUT_OF_MEMORY
    ctypedef struct Candidate:
        pass
    ctypedef struct Search:
        const double *weights
        int64_t height, width, start, goal
        double least, least_diagonal
        const double *surcharges
        double *costs
        int8_t *steps
        Candidate *heap
        int64_t expanded
    double diagonal_of(double weight)
    int begin_search(Search *search)
    int search_on(Search *search, int64_t most)
    int64_t cell_before(const Search *search, int64_t cell)

cdef extern from "flood.h" nogil:
    enum:
        LISTS
    ctypedef struct CellList:
        int64_t *cells
    ctypedef struct Flood:
        const uint8_t *is_open
        int64_t width
        const int64_t *sources
        const int64_t *starts
        int64_t count, limit
        uint32_t *lengths
        int32_t *origin
        uint8_t *steps
        int64_t waiting
        CellList *lists
    int flood_on(Flood *flood)

cdef extern from "eikonal.h" nogil:
    ctypedef struct Front:
        const uint8_t *classes
        const double *weights
        int64_t width
        double *costs
        double lists_per_cost
        CellList *lists
        int64_t list_count, waiting
    int lower_cost(Front *front, int64_t cell, double cost)
    int advance_front(Front *front)

cdef extern from "sweep.h" nogil:
    ctypedef struct Plane:
        const int32_t *values
        const uint8_t *is_open
        int64_t height, width
        double near
    void look_along(
        const Plane *plane, const double *start, const double *end, int64_t count,
        int64_t *least, uint8_t *is_open
    )

fill_squares_16()

longest_side = LONGEST_SIDE
unlimited = UNREACHABLE

cdef int64_t _BAND_CELLS = 131072  # counts of a band, 4 bytes each, stay in the cache
cdef int64_t _BAND_ROWS_LEAST = 16
cdef int64_t _BAND_ROWS_MOST = 64


cdef class Transform:
    """One distance transform, to be run band by band: scan all, join, then solve all.

    Every method works without the GIL. Different bands may be scanned, and solved, at the same
    time.
    """

    cdef Task task
    cdef const uint8_t[:, ::1] marked
    cdef const uint8_t[::1] table
    cdef const uint8_t[::1] row_before, row_after
    cdef const uint32_t[::1] down_before, up_after
    cdef uint8_t[:, ::1] cells
    cdef float *metres
    cdef uint32_t *down
    cdef uint32_t *up

    def __cinit__(self, const uint8_t[:, ::1] marked, uint8_t[:, ::1] cells, int64_t limit):
        """Take a mask of 0 and 1, the bytes of the result, and the largest square of interest."""
        cdef int64_t height = marked.shape[0], width = marked.shape[1]
        if min(height, width) < 1:
            raise ValueError("the grid has no cells")
        if max(height, width) > LONGEST_SIDE:
            raise OverflowError("a side of the grid is too long for 64 bits")
        self.marked, self.cells = marked, cells
        self.task.marked = &marked[0, 0]
        self.task.cells = &cells[0, 0]
        self.task.height, self.task.width = height, width
        self.task.whole_height = height
        self.task.band_rows = min(max(_BAND_CELLS // width, _BAND_ROWS_LEAST), _BAND_ROWS_MOST)
        self.task.bands = (height + self.task.band_rows - 1) // self.task.band_rows
        self.task.limit = limit
        self.down = <uint32_t *>malloc(self.task.bands * width * sizeof(uint32_t))
        self.up = <uint32_t *>malloc(self.task.bands * width * sizeof(uint32_t))
        self.metres = NULL
        if self.down == NULL or self.up == NULL:
            raise MemoryError

    def __dealloc__(self):
        free(self.down)
        free(self.up)
        free(self.metres)

    def place(self, int64_t whole_height, before, after):
        """Make the rows a part of a grid of this height.

        `before` and `after` are the row next to them, of 0 and 1, and the lengths of the runs of
        equal cells that end in it; None where there is none.
        """
        if not self.task.height <= whole_height <= LONGEST_SIDE:
            raise ValueError("the whole grid must be as high as its part, and not too high")
        self.task.whole_height = whole_height
        if before is not None:
            self.row_before, self.down_before = before
            self._check_row(self.row_before.shape[0], self.down_before.shape[0])
            self.task.row_before = &self.row_before[0]
            self.task.down_before = &self.down_before[0]
        if after is not None:
            self.row_after, self.up_after = after
            self._check_row(self.row_after.shape[0], self.up_after.shape[0])
            self.task.row_after = &self.row_after[0]
            self.task.up_after = &self.up_after[0]

    @property
    def bands(self):
        """Number of bands."""
        return self.task.bands

    def to_squares(self, bint both_kinds):
        """Make the result squares, of 4 or 8 bytes a cell; without both kinds marked cells are 0."""
        cdef Py_ssize_t size = self.cells.shape[1] // self.marked.shape[1]
        self._check_size(size)
        if size not in (4, 8):
            raise ValueError("squares take 4 or 8 bytes a cell")
        self.task.form = SQUARES_32 if size == 4 else SQUARES_64
        self.task.both_kinds = both_kinds
        self._divide(NEAR_MOST * NEAR_MOST)

    def to_bytes(self, const uint8_t[::1] table):
        """Make the result `table[square]`, of unmarked cells' squares; one more entry for others."""
        self._check_size(1)
        if self.task.limit < 0 or table.shape[0] != self.task.limit + 2:
            raise ValueError("the table must have one entry for each square, and one more")
        self.table = table
        self.task.form = BYTES
        self.task.bytes = &table[0]
        self.task.both_kinds = False
        self._divide(NEAR_MOST * NEAR_MOST)

    def to_metres(
        self, double scale, double outside_shift, double inside_shift, double clip, double gain
    ):
        """Make the result signed metres, of 4 bytes a cell."""
        cdef int square
        cdef double number
        self._check_size(4)
        self.task.form = METRES
        self.task.both_kinds = True
        self.task.scale = scale
        self.task.outside_shift, self.task.inside_shift = outside_shift, inside_shift
        self.task.clip, self.task.gain = clip, gain
        free(self.metres)
        self.metres = <float *>malloc((2 * NEAR_SQUARE + 1) * sizeof(float))
        if self.metres == NULL:
            raise MemoryError
        for square in range(-NEAR_SQUARE, NEAR_SQUARE + 1):
            number = square
            if abs(square) > self.task.limit:
                number = -INFINITY if square < 0 else INFINITY
            self.metres[square + NEAR_SQUARE] = metres_of(&self.task, number)
        self.task.near_metres = self.metres + NEAR_SQUARE
        self._divide(NEAR_SQUARE - 1)

    def scan(self, int64_t first, int64_t end):
        """Scan the bands first..end."""
        cdef int64_t band
        self._check_bands(first, end)
        with nogil:
            for band in range(first, end):
                scan_band(&self.task, band, self.down, self.up)

    def join(self):
        """Join what scan has found, once all bands are scanned."""
        with nogil:
            join_bands(&self.task, self.down, self.up)

    def solve(self, int64_t first, int64_t end):
        """Solve the bands first..end, after join."""
        cdef int64_t band
        cdef int done = 1
        self._check_bands(first, end)
        with nogil:
            for band in range(first, end):
                done = done and solve_band(&self.task, self.down, self.up, band)
        if not done:
            raise MemoryError

    cdef _check_size(self, Py_ssize_t size):
        if (
            self.cells.shape[0] != self.task.height
            or self.cells.shape[1] != self.task.width * size
        ):
            raise ValueError("the result has not the size of its cells")

    cdef _check_row(self, Py_ssize_t cells, Py_ssize_t runs):
        if cells != self.task.width or runs != self.task.width:
            raise ValueError("the row beside has not the width of the grid")

    cdef _check_bands(self, int64_t first, int64_t end):
        if not 0 <= first <= end <= self.task.bands:
            raise IndexError("no such bands")

    cdef _divide(self, int64_t most):
        """Settle whether trials alone, whose squares go up to `most`, reach the limit."""
        self.task.has_far = self.task.limit > most
        self.task.near_reach, self.task.near_most = NEAR_REACH, NEAR_SQUARE
        if not self.task.has_far:
            self.task.near_most = self.task.limit
            self.task.near_reach = 0
            while (self.task.near_reach + 1) * (self.task.near_reach + 1) <= self.task.limit:
                self.task.near_reach += 1


def look_up(const uint8_t[:, :] values, const uint8_t[::1] table, uint8_t[:, ::1] result):
    """Set `result` to the table's entries for the values."""
    cdef Py_ssize_t y, width = values.shape[1]
    cdef Runs runs
    if table.shape[0] != 256:
        raise ValueError("the table must have 256 entries")
    if values.shape[0] != result.shape[0] or width != result.shape[1]:
        raise ValueError("the result has not the size of the values")
    if width == 0 or (width > 1 and values.strides[1] != 1):
        raise ValueError("the values of a row must lie side by side")
    with nogil:
        if runs_of_table(&table[0], &runs):
            for y in range(values.shape[0]):
                look_up_runs(&runs, &values[y, 0], &result[y, 0], width)
        else:
            for y in range(values.shape[0]):
                look_up_bytes(&table[0], &values[y, 0], &result[y, 0], width)


def count_bytes(const uint8_t[:, ::1] values, int64_t[::1] counts):
    """Add to `counts` how often each value occurs."""
    cdef Py_ssize_t cells = values.shape[0] * values.shape[1]
    if counts.shape[0] != 256:
        raise ValueError("there must be 256 counts")
    if cells:
        with nogil:
            count_all(&values[0, 0], cells, &counts[0])


def raise_costs(uint8_t[:, ::1] costs, const uint8_t[:, ::1] asked, uint8_t least):
    """Raise costs, in place, to those asked for; unknown ones only from `least` on."""
    cdef Py_ssize_t cells = costs.shape[0] * costs.shape[1]
    if (asked.shape[0], asked.shape[1]) != (costs.shape[0], costs.shape[1]):
        raise ValueError("the arrays are not of one shape")
    if cells:
        with nogil:
            raise_bytes(&costs[0, 0], &asked[0, 0], least, cells)


def levels(
    const float[:, ::1] distance, const uint8_t[:, ::1] obstacles, const uint8_t[:, ::1] unknown,
    uint8_t[:, ::1] result, float low, float factor, float last, uint8_t first, uint8_t below,
    uint8_t faded_by,
):
    """Set `result` to the levels of distances on a scale."""
    cdef Py_ssize_t cells = distance.shape[0] * distance.shape[1]
    cdef LevelScale scale
    if not (
        obstacles.shape[0] == unknown.shape[0] == result.shape[0] == distance.shape[0]
        and obstacles.shape[1] == unknown.shape[1] == result.shape[1] == distance.shape[1]
    ):
        raise ValueError("the arrays are not of one shape")
    scale.low, scale.factor, scale.last = low, factor, last
    scale.first, scale.below, scale.faded_by = first, below, faded_by
    if cells:
        with nogil:
            levels_of(
                &scale, &distance[0, 0], &obstacles[0, 0], &unknown[0, 0], &result[0, 0], cells
            )


def bytes_of_distances(
    const float[:, ::1] distance,
    const uint8_t[:, ::1] obstacles,
    const uint8_t[::1] table,
    uint8_t[:, ::1] result,
    double scale,
    double shift,
    double gain,
    double clip,
):
    """Set `result` to the table's entries for the whole squares that distances stand for.

    The steps are those of `squares_of_distances` in lookup.py.
    """
    cdef Py_ssize_t y
    cdef Measure measure
    measure.scale, measure.shift, measure.gain, measure.clip = scale, shift, gain, clip
    measure.last = table.shape[0] - 1
    if not 0 <= measure.last < 1 << 31:
        raise ValueError("the table must have at least one entry, and fewer than 2^31")
    for axis in range(2):
        if not distance.shape[axis] == obstacles.shape[axis] == result.shape[axis]:
            raise ValueError("the arrays must be of one shape")
    if distance.shape[1] == 0:
        return
    with nogil:
        for y in range(distance.shape[0]):
            bytes_of_row(
                &measure, &distance[y, 0], &obstacles[y, 0], &table[0], &result[y, 0],
                distance.shape[1],
            )


def interpolate(
    const float[:, ::1] values,
    const double[:, ::1] places,
    double[::1] between,
    double[:, ::1] slopes,
):
    """Set `between` and `slopes` to those of the values at places (row, column)."""
    cdef int64_t count = places.shape[0]
    if places.shape[1] != 2 or slopes.shape[1] != 2:
        raise ValueError("places and slopes have two columns")
    if between.shape[0] != count or slopes.shape[0] != count:
        raise ValueError("the results have not the number of the places")
    if values.shape[0] == 0 or values.shape[1] == 0:
        raise ValueError("the grid has no cells")
    if count == 0:
        return
    with nogil:
        interpolate_places(
            &values[0, 0], values.shape[0], values.shape[1], &places[0, 0], count,
            &between[0], &slopes[0, 0],
        )


def costs_of_footprints(
    const uint8_t[:, ::1] costs,
    double resolution,
    double x,
    double y,
    double cos,
    double sin,
    const double[:, ::1] corners,
    const double[:, ::1] poses,
    bint filled,
    uint8_t[::1] results,
    uint8_t[::1] inside,
):
    """Set `results` to the costs of a footprint at poses, and `inside` to whether the grid holds it.

    The grid has its first corner at `x`, `y`, and is turned by the angle of `cos` and `sin`.
    """
    cdef int64_t count = poses.shape[0]
    cdef FootprintTask task
    if poses.shape[1] != 3 or corners.shape[1] != 2:
        raise ValueError("poses have three columns, corners two")
    if not 1 <= corners.shape[0] <= MOST_CORNERS:
        raise ValueError("a footprint has corners, but not too many")
    if results.shape[0] != count or inside.shape[0] != count:
        raise ValueError("the results have not the number of the poses")
    if costs.shape[0] == 0 or costs.shape[1] == 0:
        raise ValueError("the grid has no cells")
    if count == 0:
        return
    task.costs = &costs[0, 0]
    task.height, task.width = costs.shape[0], costs.shape[1]
    task.resolution, task.x, task.y, task.cos, task.sin = resolution, x, y, cos, sin
    task.corners, task.count, task.filled = &corners[0, 0], corners.shape[0], filled
    with nogil:
        costs_of_footprint(&task, &poses[0, 0], count, &results[0], &inside[0])


def lzf_expand(const uint8_t[::1] data, uint8_t[::1] expanded):
    """Fill `expanded` with what LZF data expand to; return whether they do, exactly."""
    cdef int done
    cdef const uint8_t *start = &data[0] if data.shape[0] else NULL
    cdef uint8_t *target = &expanded[0] if expanded.shape[0] else NULL
    with nogil:
        done = lzf_expanded(start, data.shape[0], target, expanded.shape[0])
    return bool(done)


def cheapest_path(
    const double[:, ::1] weights, start, goal, double least, const double[:, ::1] surcharges=None
):
    """Return the cells of the path, as indices, its cost, and how many cells were expanded.

    Without a path there are no cells, and the cost is infinite.
    """
    import numpy as np  # which telling the version must not wait for

    cdef int64_t width = weights.shape[1]
    cdef int64_t cell
    cdef int state = SEARCH_GOES_ON
    cdef double[:, ::1] costs = np.full((weights.shape[0], width), INFINITY)
    cdef int8_t[:, ::1] steps = np.zeros((weights.shape[0], width), dtype=np.int8)
    cdef Search search
    for row, col in (start, goal):
        if not (0 <= row < weights.shape[0] and 0 <= col < width):
            raise IndexError("no such cell")
    memset(&search, 0, sizeof(search))
    search.weights, search.costs, search.steps = &weights[0, 0], &costs[0, 0], &steps[0, 0]
    search.height, search.width = weights.shape[0], width
    search.start = start[0] * width + start[1]
    search.goal = goal[0] * width + goal[1]
    search.least, search.least_diagonal = least, diagonal_of(least)
    if surcharges is not None:
        if surcharges.shape[0] != weights.shape[0] or surcharges.shape[1] != width:
            raise IndexError("no such cell")
        search.surcharges = &surcharges[0, 0]
    try:
        if not begin_search(&search):
            raise MemoryError
        while state == SEARCH_GOES_ON:
            with nogil:
                state = search_on(&search, 1 << 18)
            PyErr_CheckSignals()
    finally:
        free(search.heap)
    if state == SEARCH_OUT_OF_MEMORY:
        raise MemoryError
    if state == SEARCH_IN_VAIN:
        return np.empty(0, dtype=np.int64), INFINITY, search.expanded
    cell = search.goal
    cells = [cell]
    while cell != search.start:
        cell = cell_before(&search, cell)
        cells.append(cell)
    return np.array(cells[::-1], dtype=np.int64), (&costs[0, 0])[search.goal], search.expanded


def flood(
    const uint8_t[::1] is_open,
    int64_t width,
    const int64_t[::1] sources,
    const int64_t[::1] starts,
    int64_t limit,
    uint32_t[::1] lengths,
    int32_t[::1] origin,  # or empty
):
    """Set `lengths` and `origin` of all cells to which ways lead that are within the limit.

    Cells along the border are closed. Those of the sources, which are sorted by what they start
    with, have their lengths and origins already; all other lengths are the largest number.
    """
    cdef Flood task
    cdef int has_memory = True
    if lengths.shape[0] != is_open.shape[0] or origin.shape[0] not in (0, is_open.shape[0]):
        raise ValueError("the arrays have not the same size")
    if sources.shape[0] != starts.shape[0]:
        raise ValueError("each source has one length")
    if sources.shape[0] == 0:
        return
    memset(&task, 0, sizeof(task))
    task.is_open, task.width, task.limit = &is_open[0], width, limit
    task.sources, task.starts, task.count = &sources[0], &starts[0], sources.shape[0]
    task.lengths = &lengths[0]
    if origin.shape[0]:
        task.origin = &origin[0]
    task.steps = <uint8_t *>calloc(lengths.shape[0], 1)
    try:
        if task.steps == NULL:
            raise MemoryError
        while has_memory and (task.count or task.waiting):
            with nogil:
                has_memory = flood_on(&task)
            PyErr_CheckSignals()
    finally:
        for k in range(LISTS):
            free(task.lists[k].cells)
        free(task.steps)
    if not has_memory:
        raise MemoryError


def costs_to_go(
    const uint8_t[:, ::1] classes,
    const double[::1] weights,
    const int64_t[::1] sources,
    const double[::1] starts,
    double lists_per_cost,
    int64_t list_count,
    double[:, ::1] costs,
):
    """Lower `costs` to those of the cheapest ways to sources, cells with costs of their own.

    Cells along the border are closed. All of the ring of lists must hold the dearest step.
    """
    cdef Front task
    cdef Py_ssize_t k
    cdef int has_memory = True
    if classes.shape[0] != costs.shape[0] or classes.shape[1] != costs.shape[1]:
        raise ValueError("the arrays have not the same size")
    if weights.shape[0] != 256 or sources.shape[0] != starts.shape[0] or list_count < 1:
        raise ValueError("there must be 256 weights, a cost for each source, and a list")
    memset(&task, 0, sizeof(task))
    task.classes, task.weights, task.width = &classes[0, 0], &weights[0], classes.shape[1]
    task.costs, task.lists_per_cost, task.list_count = &costs[0, 0], lists_per_cost, list_count
    task.lists = <CellList *>calloc(list_count, sizeof(CellList))
    try:
        if task.lists == NULL:
            raise MemoryError
        for k in range(sources.shape[0]):
            has_memory = has_memory and lower_cost(&task, sources[k], starts[k])
        while has_memory and task.waiting:
            with nogil:
                has_memory = advance_front(&task)
            PyErr_CheckSignals()
    finally:
        if task.lists != NULL:
            for k in range(list_count):
                free(task.lists[k].cells)
            free(task.lists)
    if not has_memory:
        raise MemoryError


def look_along_lines(
    const int32_t[:, ::1] values,
    const uint8_t[:, ::1] is_open,
    const double[:, ::1] starts,
    const double[:, ::1] ends,
    const int64_t[::1] counts,
    double near,
    int64_t[::1] least,
    uint8_t[::1] are_open,
):
    """Set the least value and whether all is open, for each line; its places lie in the grid."""
    cdef Plane plane
    cdef int64_t line, lines = counts.shape[0]
    if not (starts.shape[0] == ends.shape[0] == least.shape[0] == are_open.shape[0] == lines):
        raise ValueError("the arrays have not the same size")
    if starts.shape[1] != 2 or ends.shape[1] != 2:
        raise ValueError("places have a row and a column")
    if is_open.shape[0] != values.shape[0] or is_open.shape[1] != values.shape[1]:
        raise ValueError("the grids have not the same shape")
    if lines == 0:
        return
    plane.values, plane.is_open, plane.near = &values[0, 0], &is_open[0, 0], near
    plane.height, plane.width = values.shape[0], values.shape[1]
    with nogil:
        for line in range(lines):
            look_along(
                &plane, &starts[line, 0], &ends[line, 0], counts[line], &least[line],
                &are_open[line],
            )


def trace_rings(
    const int64_t[::1] follows, const int64_t[::1] partner, int64_t[::1] stack,
    int64_t[::1] places, int64_t[::1] order, int64_t[::1] ends,
):
    """Write the turns of rings in a row, and where each ends; return how many rings there are.

    `places` are those in the stack: -1 behind it, -2 for all that is ahead.
    """
    cdef int64_t count = follows.shape[0], rings = 0, size = 0
    cdef int64_t first, node, start, depth, k
    if not (
        partner.shape[0] == stack.shape[0] == places.shape[0] == order.shape[0] == ends.shape[0]
        == count
    ):
        raise ValueError("the arrays have not the same size")
    with nogil:
        for first in range(count):
            node, depth = first, 0
            while places[node] == -2:
                start = -1 if partner[node] < 0 else places[partner[node]]
                places[node] = -1
                if start < 0:
                    places[node] = depth
                    stack[depth] = node
                    depth += 1
                else:  # the ring is at this point again
                    for k in range(start, depth):
                        order[size] = stack[k]
                        places[stack[k]] = start if k == start else -1
                        size += 1
                    ends[rings] = size
                    rings += 1
                    depth = start + 1
                node = follows[node]
            for k in range(depth):
                order[size] = stack[k]
                places[stack[k]] = -1
                size += 1
            if depth:
                ends[rings] = size
                rings += 1
    return rings


def straighten(
    const double[:, ::1] corners, const int64_t[:, ::1] chains, const double[::1] tolerances,
    uint8_t[::1] is_kept,
):
    """Mark the places of chains of corners that stay, as outlines.py says."""
    cdef int64_t chain, at, end, best, place
    cdef double up, right, far, angle, base, low, high, spread, tolerance
    cdef bint has_base
    if chains.shape[1] != tolerances.shape[0] or is_kept.shape[0] != 2 * corners.shape[0]:
        raise ValueError("the arrays have not the same size")
    with nogil:
        for chain in range(tolerances.shape[0]):
            at, end, tolerance = 2 * chains[0, chain], 2 * chains[1, chain], tolerances[chain]
            while at < end:
                best, low, high, base, has_base = at + 1, -INFINITY, INFINITY, 0.0, False
                for place in range(at + 1, end + 1):
                    up, right = _ahead(corners, at, place, 0), _ahead(corners, at, place, 1)
                    far = sqrt(up * up + right * right)
                    if far <= tolerance:
                        continue
                    angle = atan2(up, right)
                    if not has_base:
                        base, has_base = angle, True
                    angle = remainder(angle - base, 2 * M_PI)
                    if low <= angle <= high and (place % 2 or place == end):
                        best = place
                    if place % 2 == 0:
                        spread = asin(tolerance / far)
                        low, high = max(low, angle - spread), min(high, angle + spread)
                        if low > high:
                            break
                is_kept[best] = True
                at = best


cdef inline double _ahead(const double[:, ::1] corners, int64_t at, int64_t to, int axis) nogil:
    return (
        (corners[to // 2, axis] + corners[(to + 1) // 2, axis])
        - (corners[at // 2, axis] + corners[(at + 1) // 2, axis])
    ) / 2
