/* Updates of a robot's costmap, as costmap_2d makes them: rays that clear cells or voxels, and the
   queue of the older inflation layer. sensing.py and distance.py have the same on numpy. */

#include <stdint.h>

typedef struct {
    int64_t height, width;
    uint8_t *costs;
    uint32_t *columns;          /* NULL if there are no voxels */
    int mark_threshold, unknown_threshold;
} Sensed;

static int bits_of(uint32_t value)
{
    int count = 0;
    for (; value; value &= value - 1) count++;
    return count;
}

static void clear_at(const Sensed *grid, const int64_t *cell)
{
    const int64_t at = cell[1] * grid->width + cell[0];
    if (grid->columns == NULL) {
        grid->costs[at] = 0;
        return;
    }
    const uint32_t column = grid->columns[at] &= ~(0x10001u << cell[2]);
    if (bits_of(column >> 16) > grid->mark_threshold) return;
    const int unknown = bits_of((column >> 16) ^ (column & 0xFFFF));
    grid->costs[at] = unknown <= grid->unknown_threshold ? 0 : 255;
}

static int is_in(const Sensed *grid, const int64_t *cell)
{
    return cell[0] >= 0 && cell[0] < grid->width && cell[1] >= 0 && cell[1] < grid->height &&
           cell[2] >= 0 && cell[2] < 16;
}

/* Arrays have a row for each axis: x, y and z. Returns 0 if a ray leaves the grid. */
static int clear_along(const Sensed *grid, const int64_t *starts, const int64_t *deltas,
                       const int64_t *steps, int64_t axes, int64_t rays)
{
    for (int64_t k = 0; k < rays; k++) {
        int64_t cell[3] = {0, 0, 0}, end[3] = {0, 0, 0}, length[3], sign[3], error[3], longest = 0;
        for (int64_t axis = 0; axis < axes; axis++) {
            const int64_t delta = deltas[axis * rays + k];
            cell[axis] = starts[axis * rays + k];
            end[axis] = cell[axis] + delta;
            sign[axis] = delta > 0 ? 1 : -1;
            length[axis] = delta * sign[axis];
            if (length[axis] > longest) longest = length[axis];
        }
        if (!is_in(grid, cell) || !is_in(grid, end) || steps[k] > longest) return 0;
        error[0] = error[1] = error[2] = longest / 2;
        clear_at(grid, cell);
        for (int64_t step = 0; step < steps[k]; step++) {
            for (int64_t axis = 0; axis < axes; axis++) {
                error[axis] += length[axis];
                if (error[axis] < longest) continue;
                error[axis] -= longest;
                cell[axis] += sign[axis];
            }
            clear_at(grid, cell);
        }
    }
    return 1;
}

typedef struct {
    int64_t width, most;        /* the largest square */
    int32_t *squares;           /* larger than `most` until a cell is reached */
    int32_t *queue;             /* a cell, a seed and the next entry's number in each */
    int32_t *firsts, *lasts;    /* numbers of the entries of each square; -1 without any */
    int32_t count;
} Queue;

static void enqueue(Queue *of, int64_t cell, int64_t seed)
{
    const int64_t rows = cell / of->width - seed / of->width;
    const int64_t cols = cell % of->width - seed % of->width, square = rows * rows + cols * cols;
    if (square > of->most || of->squares[cell] <= of->most) return;
    const int32_t number = of->count++;
    int32_t *entry = of->queue + 3 * (int64_t)number;
    entry[0] = (int32_t)cell, entry[1] = (int32_t)seed, entry[2] = -1;
    if (of->firsts[square] < 0) of->firsts[square] = number;
    else of->queue[3 * (int64_t)of->lasts[square] + 2] = number;
    of->lasts[square] = number;
}

static void spread_queue(Queue *of, const uint8_t *seeds, int64_t cells)
{
    const int64_t width = of->width;
    for (int64_t cell = 0; cell < cells; cell++)
        if (seeds[cell]) enqueue(of, cell, cell);
    for (int64_t square = 0; square <= of->most; square++)
        for (int64_t k = of->firsts[square]; k >= 0; k = of->queue[3 * k + 2]) {
            const int64_t cell = of->queue[3 * k], seed = of->queue[3 * k + 1], col = cell % width;
            if (of->squares[cell] <= of->most) continue;
            of->squares[cell] = (int32_t)square;
            if (col > 0) enqueue(of, cell - 1, seed);
            if (cell >= width) enqueue(of, cell - width, seed);
            if (col < width - 1) enqueue(of, cell + 1, seed);
            if (cell < cells - width) enqueue(of, cell + width, seed);
        }
}
