# cython: language_level=3, binding=False, embedsignature=False
# cython: boundscheck=False, wraparound=False, cdivision=True
"""Compiled poses, without the GIL: which are open, and which can be reached.

The module compiled.py is their face to the rest; the algorithms are in
configuration_space.h.
"""

from cpython.exc cimport PyErr_CheckSignals
from libc.stdint cimport int32_t, int64_t, uint8_t, uint64_t
from libc.stdlib cimport calloc, free, malloc
from libc.string cimport memset

cdef extern from "configuration_space.h" nogil:
    enum: SHIFTS, WIDE
    ctypedef struct Poses:
        const uint8_t *blocked
        int64_t height, width, stride, words, count
        const int64_t *firsts
        const int64_t *offsets
        int64_t first_row, first_byte, halo, levels, level_words, band_rows
    ctypedef struct Flood:
        int64_t height, words, count
        uint64_t *left
        uint64_t *reached
        int32_t *slots
        uint64_t *seeds
        int32_t *free_slots
        int64_t *line
        int64_t most, waiting, next
        uint8_t *spilled
        int64_t spills
        uint64_t *work
    int64_t area_words(const Poses *poses)
    void open_rows(
        const Poses *poses, int64_t first, int64_t end, uint64_t *area, uint64_t *opened,
        uint8_t *numbers,
    )
    int wait_with(Flood *flood, int64_t tile, const uint64_t *seeds)
    void flood_on(Flood *flood, int64_t most)
    void hand_on_again(Flood *flood, int64_t row, const uint64_t *opened)


cdef class PoseMaker:
    """Makes the open poses of rows of a map.

    Parameters
    ----------
    blocked : memory of uint8, shape (H, ceil(W / 8))
        A bit a cell, the lowest first; those behind the last are set.
    width : int
        W.
    firsts : memory of int64, shape (8 K + 1,)
        Of each heading and each shift where its runs begin in `offsets`.
    offsets : memory of int64
        Of each run where it begins in a work area, from the pose, bytes.
    area : tuple of int
        The area's first row and byte, its rows beyond those of the poses, levels, words of a
        level, and the rows of poses that it is made for.
    """

    cdef Poses _poses
    cdef object _kept

    def __init__(
        self, const uint8_t[:, ::1] blocked, int64_t width, const int64_t[::1] firsts,
        const int64_t[::1] offsets, area,
    ):
        cdef Poses *poses = &self._poses
        if width < 1 or blocked.shape[0] < 1 or blocked.shape[1] != (width + 7) // 8:
            raise ValueError("no such grid")
        if firsts.shape[0] < SHIFTS + 1 or (firsts.shape[0] - 1) % SHIFTS:
            raise ValueError("no such headings")
        if firsts[firsts.shape[0] - 1] != offsets.shape[0]:
            raise ValueError("no such runs")
        self._kept = blocked, firsts, offsets
        poses.blocked = &blocked[0, 0]
        poses.height, poses.width, poses.stride = blocked.shape[0], width, blocked.shape[1]
        poses.words, poses.count = (width + 63) // 64, (firsts.shape[0] - 1) // SHIFTS
        poses.firsts = &firsts[0]
        poses.offsets = &offsets[0] if offsets.shape[0] else NULL
        poses.first_row, poses.first_byte, poses.halo = area[0], area[1], area[2]
        poses.levels, poses.level_words, poses.band_rows = area[3], area[4], area[5]
        if min(poses.halo, poses.levels - 1, poses.level_words - WIDE, poses.band_rows - 1) < 0:
            raise ValueError("no such area")
        cdef int64_t highest = 8 * ((poses.halo + 1) * poses.levels * poses.level_words - WIDE)
        cdef int64_t k
        for k in range(offsets.shape[0]):
            if not 0 <= offsets[k] <= highest:
                raise IndexError("no such runs")
        for k in range(firsts.shape[0] - 1):
            if not 0 <= firsts[k] <= firsts[k + 1]:
                raise IndexError("no such runs")

    def make(
        self, int64_t first, int64_t end, uint64_t[:, :, ::1] opened not None,
        uint8_t[:, ::1] numbers=None,
    ):
        """Fill rows first .. end - 1 of planes (H, words, K), and of their numbers (H, W)."""
        cdef Poses *poses = &self._poses
        cdef uint8_t *target = NULL
        if not 0 <= first <= end <= poses.height:
            raise IndexError("no such rows")
        if (opened.shape[0], opened.shape[1], opened.shape[2]) != (
            poses.height, poses.words, poses.count
        ):
            raise ValueError("no such planes")
        if first == end:
            return
        if numbers is not None:
            if (numbers.shape[0], numbers.shape[1]) != (poses.height, poses.width):
                raise ValueError("no such numbers")
            target = &numbers[first, 0]
        self._make(first, end, &opened[first, 0, 0], target)

    cdef int _make(
        self, int64_t first, int64_t end, uint64_t *opened, uint8_t *numbers
    ) except -1:
        cdef uint64_t *area = <uint64_t *>malloc(area_words(&self._poses) * sizeof(uint64_t))
        if area == NULL:
            raise MemoryError
        with nogil:
            open_rows(&self._poses, first, end, area, opened, numbers)
        free(area)
        return 0


def flood(
    PoseMaker maker, uint64_t[:, :, ::1] left, uint64_t[:, ::1] reached,
    const int64_t[:, ::1] seeds, int64_t most,
):
    """Take what is reached from seeds (heading, row, column) out of `left`, and mark its cells.

    At most so many tiles wait at a time. If that is too few, open poses are made again where what
    waited was lost; returns how often.
    """
    cdef Flood state
    memset(&state, 0, sizeof(state))
    cdef int64_t tiles = maker._poses.height * maker._poses.words, count = maker._poses.count
    cdef int64_t k, rounds = 0
    if (left.shape[0], left.shape[1], left.shape[2]) != (
        maker._poses.height, maker._poses.words, count
    ) or (reached.shape[0], reached.shape[1]) != (left.shape[0], left.shape[1]):
        raise ValueError("no such layers")
    if not 4 <= most < 1 << 31 or seeds.shape[1] != 3:
        raise ValueError("no such seeds, or too few that may wait")
    state.height, state.words, state.count = maker._poses.height, maker._poses.words, count
    state.left, state.reached, state.most = &left[0, 0, 0], &reached[0, 0], most
    state.slots = <int32_t *>malloc(tiles * sizeof(int32_t))
    state.seeds = <uint64_t *>malloc(most * count * sizeof(uint64_t))
    state.free_slots = <int32_t *>malloc(most * sizeof(int32_t))
    state.line = <int64_t *>malloc(most * sizeof(int64_t))
    state.spilled = <uint8_t *>calloc(tiles, 1)
    state.work = <uint64_t *>malloc(2 * count * sizeof(uint64_t))
    try:
        if (
            state.slots == NULL or state.seeds == NULL or state.free_slots == NULL
            or state.line == NULL or state.spilled == NULL or state.work == NULL
        ):
            raise MemoryError
        memset(state.slots, 0xFF, tiles * sizeof(int32_t))
        for k in range(most):
            state.free_slots[k] = <int32_t>k
        for k in range(seeds.shape[0]):
            _begin(&state, seeds[k, 0], seeds[k, 1], seeds[k, 2])
        _drain(&state)
        while state.spills:
            rounds += 1
            _again(&state, maker)
        return rounds
    finally:
        free(state.slots)
        free(state.seeds)
        free(state.free_slots)
        free(state.line)
        free(state.spilled)
        free(state.work)


cdef int _begin(Flood *state, int64_t heading, int64_t row, int64_t col) except -1:
    cdef int64_t tile = row * state.words + col // 64
    cdef uint64_t *seeds = state.work
    if not (0 <= heading < state.count and 0 <= row < state.height and 0 <= col):
        raise IndexError("no such pose")
    if col // 64 >= state.words:
        raise IndexError("no such pose")
    memset(seeds, 0, state.count * sizeof(uint64_t))
    seeds[heading] = (<uint64_t>1 << (col % 64)) & state.left[tile * state.count + heading]
    if state.waiting == state.most:
        _drain(state)
    wait_with(state, tile, seeds)
    return 0


cdef int _drain(Flood *state) except -1:
    while state.waiting:
        with nogil:
            flood_on(state, 1 << 14)
        PyErr_CheckSignals()
    return 0


cdef int _again(Flood *state, PoseMaker maker) except -1:
    cdef int64_t row, k
    cdef uint64_t *opened = <uint64_t *>malloc(state.words * state.count * sizeof(uint64_t))
    if opened == NULL:
        raise MemoryError
    try:
        for row in range(state.height):
            for k in range(row * state.words, (row + 1) * state.words):
                if state.spilled[k]:
                    maker._make(row, row + 1, opened, NULL)
                    hand_on_again(state, row, opened)
                    _drain(state)
                    break
    finally:
        free(opened)
    return 0
