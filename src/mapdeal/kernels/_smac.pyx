# cython: language_level=3, binding=False, embedsignature=False
# cython: boundscheck=False, wraparound=False, cdivision=True
"""Compiled searches of Nav2's Smac and Theta* planners, without the GIL.

The module searches.py is their face to the rest; the algorithms are in smac.h.
"""

from libc.stdint cimport int64_t, uint8_t
from libc.stdlib cimport calloc, free, malloc


cdef extern from "smac.h" nogil:
    int64_t NO_MEMORY
    ctypedef struct GridSearch:
        const uint8_t *costs
        const float *step_costs
        int64_t width, height, start, goal
        float goal_x, goal_y, tolerance
        int64_t most_iterations, most_near_goal, iterations
        uint8_t *moves
        float *reached
    int64_t search_grid(GridSearch *search)
    double smooth_once(
        const double *raw, double *path, int64_t count, double data_weight, double smooth_weight
    )
    ctypedef struct ThetaSearch:
        const uint8_t *costs
        const double *step_costs
        const double *sight_costs
        int64_t width, height, start, goal
        int corners
        double distance_weight, heuristic_weight
        int64_t *parents
        double *reached
        double *estimates
        uint8_t *is_waiting
    int64_t search_theta(ThetaSearch *search)


def grid(
    const uint8_t[:, ::1] costs, const float[:, ::1] step_costs, int64_t start, int64_t goal,
    float goal_x, float goal_y, float tolerance, int64_t most_iterations, int64_t most_near_goal,
    uint8_t[::1] moves,
):
    """Fill the moves; return the last cell of the path, or -1, and the number of iterations."""
    cdef GridSearch search
    cdef int64_t end, size = costs.shape[0] * costs.shape[1]
    if step_costs.shape[0] != 2 or step_costs.shape[1] != 256 or moves.shape[0] != size:
        raise ValueError("the arrays do not fit")
    if not (0 <= start < size and 0 <= goal < size):
        raise ValueError("the cells are not in the costmap")
    search.costs, search.step_costs, search.moves = &costs[0, 0], &step_costs[0, 0], &moves[0]
    search.height, search.width = costs.shape[0], costs.shape[1]
    search.start, search.goal = start, goal
    search.goal_x, search.goal_y, search.tolerance = goal_x, goal_y, tolerance
    search.most_iterations, search.most_near_goal = most_iterations, most_near_goal
    search.reached = <float *>malloc(size * sizeof(float))
    if search.reached == NULL:
        raise MemoryError
    with nogil:
        end = search_grid(&search)
        free(search.reached)
    if end == NO_MEMORY:
        raise MemoryError
    return end, search.iterations


def smooth(
    const double[:, ::1] raw, double[:, ::1] path, double data_weight, double smooth_weight
):
    """Move the inner points of a path once; return the sum of their moves."""
    if raw.shape[1] != 2 or path.shape[1] != 2 or path.shape[0] != raw.shape[0] < 3:
        raise ValueError("the arrays do not fit")
    return smooth_once(&raw[0, 0], &path[0, 0], raw.shape[0], data_weight, smooth_weight)


def theta(
    const uint8_t[:, ::1] costs, const double[::1] step_costs, const double[::1] sight_costs,
    int64_t start, int64_t goal, int corners, double distance_weight, double heuristic_weight,
    int64_t[::1] parents,
):
    """Fill the parents, the cell + 1 of each; return the goal, or -1 if there is no path."""
    cdef ThetaSearch search
    cdef int64_t end, size = costs.shape[0] * costs.shape[1]
    if step_costs.shape[0] != 256 or sight_costs.shape[0] != 256 or parents.shape[0] != size:
        raise ValueError("the arrays do not fit")
    if not (0 <= start < size and 0 <= goal < size and 0 <= corners <= 8):
        raise ValueError("the cells are not in the costmap")
    search.costs, search.step_costs = &costs[0, 0], &step_costs[0]
    search.sight_costs, search.parents = &sight_costs[0], &parents[0]
    search.height, search.width = costs.shape[0], costs.shape[1]
    search.start, search.goal = start, goal
    search.corners, search.distance_weight = corners, distance_weight
    search.heuristic_weight = heuristic_weight
    search.reached = <double *>malloc(2 * size * sizeof(double))
    search.is_waiting = <uint8_t *>calloc(size, 1)
    if search.reached == NULL or search.is_waiting == NULL:
        free(search.reached)
        free(search.is_waiting)
        raise MemoryError
    search.estimates = search.reached + size
    with nogil:
        end = search_theta(&search)
        free(search.reached)
        free(search.is_waiting)
    if end == NO_MEMORY:
        raise MemoryError
    return end
