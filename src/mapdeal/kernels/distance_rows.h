/* Exact squared Euclidean distances between cells of two kinds, marked (1) and unmarked (0).
 *
 * Every cell is measured to the nearest cell of the other kind, in bands of rows that fit into
 * the cache, and in two passes:
 *
 *   columns  A cell's height is its distance, within its column, to the nearest cell of the other
 *            kind: one running count downwards, one upwards. What runs on across the edges of
 *            bands is found beforehand, by scan_band and join_bands.
 *   rows     A cell's square is the smallest (x - i)^2 + height(i)^2 over all columns i. Only the
 *            cell's own run of equal cells can hold the minimum, with the cells that end the run:
 *            those are of the other kind and have height 0. So one pass serves both kinds.
 *
 * Rows are solved in blocks of cells. Near the other kind all offsets are tried, many cells at a
 * time, in 16 bits. Blocks that lie farther are gathered into stretches and solved by the lower
 * envelope of the parabolas over their columns (Felzenszwalb and Huttenlocher, 2012), which is
 * the lower convex hull of the points (i, height(i)^2 + i^2). All in integers; sides of up to
 * LONGEST_SIDE cells keep them within 64 bits.
 */

#include <stdlib.h>
#include <string.h>

#include "distance_columns.h"

/* Scratch for one row. */
typedef struct {
    uint32_t *down;           /* the band's counts, row by row */
    uint32_t *up;             /* this row's counts */
    uint32_t *heights;        /* the smaller of both */
    uint16_t *outside;        /* capped squares of heights, 0 on marked cells; with margins */
    uint16_t *inside;         /* the same, 0 on unmarked cells */
    uint16_t *lowest_outside; /* the smallest of each block; with RINGS more on both sides */
    uint16_t *lowest_inside;
    int64_t *sites;           /* columns on the envelope */
    int64_t *values;          /* their height^2 + column^2 */
    int64_t *squares;         /* signed, of a stretch */
} Row;

/* Split heights into the two kinds, as capped squares. */
MANY_LANES static void split_row(const uint8_t *restrict marked, const uint32_t *restrict down,
                                 const uint32_t *restrict up, uint32_t *restrict heights,
                                 uint16_t *restrict outside, uint16_t *restrict inside,
                                 int64_t width)
{
    for (int64_t x = 0; x < width; x++) {
        const uint32_t height = down[x] < up[x] ? down[x] : up[x];
        const uint32_t capped = height < NEAR_CAP ? height : NEAR_CAP;
        const uint32_t square = capped * capped;
        heights[x] = height;
        outside[x] = (uint16_t)(marked[x] ? 0 : square);
        inside[x] = (uint16_t)(marked[x] ? square : 0);
    }
}

MANY_LANES static uint16_t lowest_of_block(const uint16_t *cells)
{
    uint16_t lowest = cells[0];
    for (int i = 1; i < BLOCK; i++) lowest = cells[i] < lowest ? cells[i] : lowest;
    return lowest;
}

/* Try all offsets up to `reach` for the cells of a block, as far as one could still be better.
 *
 * `squares` points to the first of them in a row with margins, `lowest` to the block's entry.
 * Returns the largest result; those up to `most` are exact, others no more than too large. */
MANY_LANES static int solve_near(const uint16_t *squares, const uint16_t *lowest, int count,
                                 int reach, int most, uint16_t *best)
{
    uint16_t now[BLOCK];
    memcpy(now, squares, sizeof now);
    for (int i = count; i < BLOCK; i++) now[i] = 0; /* beyond the row */
    uint16_t highest = 0;
    for (int i = 0; i < BLOCK; i++) highest = now[i] > highest ? now[i] : highest;
    for (int ring = 0; ring * BLOCK < reach; ring++) {
        const int start = ring * BLOCK + 1;
        if (start * start >= highest) break;
        uint16_t low = lowest[-ring - 1];
        low = lowest[-ring] < low ? lowest[-ring] : low;
        low = lowest[ring] < low ? lowest[ring] : low;
        low = lowest[ring + 1] < low ? lowest[ring + 1] : low;
        if (low + start * start >= highest || low + start * start > most) continue;
        const int stop = start + BLOCK <= reach ? start + BLOCK : reach + 1;
        for (int offset = start; offset < stop && offset * offset < highest;) {
            for (int k = 0; k < 4; k++, offset++) {
                const uint16_t *left = squares - offset, *right = squares + offset;
                const uint16_t square = squares_16[offset];
                for (int i = 0; i < BLOCK; i++) {
                    uint16_t other = left[i] < right[i] ? left[i] : right[i];
                    other = (uint16_t)(other + square);
                    now[i] = other < now[i] ? other : now[i];
                }
            }
            highest = 0;
            for (int i = 0; i < BLOCK; i++) highest = now[i] > highest ? now[i] : highest;
        }
    }
    memcpy(best, now, sizeof now);
    return highest;
}

/* Solve the cells first..end, all of one kind, by the lower envelope over their run. */
static void solve_far(const Task *task, const Row *row, const uint8_t *marked, int64_t first,
                      int64_t end)
{
    const int64_t width = task->width, none = task->whole_height; /* no height is larger */
    const uint8_t kind = marked[first];
    const uint32_t *heights = row->heights;
    /* The cell before the stretch, if there is one, lies in a block that is settled: its nearest
     * column is within NEAR_REACH, and from there on better than all columns farther off. */
    const int64_t reach = NEAR_REACH + 1;
    int64_t low = first, high = end;
    while (low > 0 && marked[low - 1] == kind && first - low < reach) low--;
    while (high < width && marked[high] == kind && high - end < reach) high++;
    const int64_t from = low > 0 && marked[low - 1] != kind ? low - 1 : low;
    const int64_t to = high < width && marked[high] != kind ? high + 1 : high;

    /* The hull's last corner, and its last edge: none is longer than 0 cells. */
    int64_t *restrict sites = row->sites, *restrict values = row->values;
    int64_t top = -1, site = 0, value = 0, run = 0, rise = 0;
    for (int64_t i = from; i < to; i++) {
        const int64_t height = i >= low && i < high ? (int64_t)heights[i] : 0;
        if (height > none) continue;
        const int64_t new_value = height * height + i * i;
        /* never better than the last corner up to the stretch's end */
        if (top >= 0 && new_value - value >= 2 * (end - 1) * (i - site)) continue;
        /* drop corners on or above the line from the one before them to the new one */
        while (run > 0 && (new_value - value) * run <= rise * (i - site)) {
            top--;
            site = sites[top];
            value = values[top];
            run = top > 0 ? site - sites[top - 1] : 0;
            rise = top > 0 ? value - values[top - 1] : 0;
        }
        if (top >= 0) {
            run = i - site;
            rise = new_value - value;
        }
        top++;
        sites[top] = site = i;
        values[top] = value = new_value;
    }
    const int64_t sign = kind ? -1 : 1;
    int64_t *restrict squares = row->squares;
    if (top < 0) {
        for (int64_t x = first; x < end; x++) squares[x - first] = sign * UNREACHABLE;
        return;
    }
    /* Corner k gives way to the next where the edge between them is no steeper than 2x; square
     * and edge are followed from cell to cell by their differences. */
    int64_t x = first;
    for (int64_t k = 0; k <= top && x < end; k++) {
        rise = k < top ? values[k + 1] - values[k] : INT64_MAX;
        run = k < top ? 2 * (sites[k + 1] - sites[k]) : 0;
        int64_t slope = x * run, step = 2 * (x - sites[k]) + 1;
        int64_t square = values[k] + x * (x - 2 * sites[k]);
        for (; x < end && slope < rise; x++, slope += run, square += step, step += 2)
            squares[x - first] = sign * square;
    }
}

static int64_t limited(const Task *task, int64_t square)
{
    return square > task->limit ? UNREACHABLE : square < -task->limit ? -UNREACHABLE : square;
}

/* Store the squares of a block that trials have settled: `outside` is 0 on marked cells, `inside`
 * on others. Look-ups stay single: gathering them is slower on many processors. */
static void store_near(const Task *task, int64_t at, const uint16_t *outside,
                       const uint16_t *inside, int count, int highest)
{
    if (task->form == METRES && highest <= NEAR_SQUARE) {
        float *restrict cells = (float *)task->cells + at;
        const float *near_metres = task->near_metres;
        for (int i = 0; i < count; i++) cells[i] = near_metres[outside[i] - inside[i]];
    } else if (task->form == METRES) {
        float *cells = (float *)task->cells + at;
        for (int i = 0; i < count; i++) {
            const int out = outside[i] < NEAR_SQUARE ? outside[i] : NEAR_SQUARE;
            const int in = inside[i] < NEAR_SQUARE ? inside[i] : NEAR_SQUARE;
            cells[i] = task->near_metres[out - in];
        }
    } else if (task->form == BYTES) {
        uint8_t *cells = (uint8_t *)task->cells + at;
        if (count == BLOCK && lowest_of_block(outside) > task->limit) {
            memset(cells, task->bytes[task->limit + 1], BLOCK);
            return;
        }
        for (int i = 0; i < count; i++)
            cells[i] = task->bytes[outside[i] <= task->limit ? outside[i] : task->limit + 1];
    } else if (task->form == SQUARES_32) {
        int32_t *cells = (int32_t *)task->cells + at;
        const int most = task->limit < NEAR_CAP * NEAR_CAP ? (int)task->limit : INT32_MAX;
        for (int i = 0; i < count; i++) {
            const int square = outside[i] - inside[i];
            cells[i] = square > most ? INT32_MAX : square < -most ? -INT32_MAX : square;
        }
    } else {
        int64_t *cells = (int64_t *)task->cells + at;
        for (int i = 0; i < count; i++) cells[i] = limited(task, outside[i] - inside[i]);
    }
}

/* Store signed squares of neighbouring cells. */
MANY_LANES static void store_far(const Task *task, int64_t at, const int64_t *squares,
                                 int64_t count)
{
    if (task->form == METRES) {
        float *restrict cells = (float *)task->cells + at;
        for (int64_t i = 0; i < count; i++) {
            const int64_t size = squares[i] < 0 ? -squares[i] : squares[i];
            const double square = size > task->limit || size == UNREACHABLE ? INFINITY : (double)size;
            cells[i] = metres_of(task, squares[i] < 0 ? -square : square);
        }
    } else if (task->form == BYTES) {
        uint8_t *cells = (uint8_t *)task->cells + at;
        for (int64_t i = 0; i < count; i++)
            cells[i] = task->bytes[squares[i] <= task->limit ? squares[i] : task->limit + 1];
    } else if (task->form == SQUARES_32) {
        int32_t *cells = (int32_t *)task->cells + at;
        for (int64_t i = 0; i < count; i++) {
            const int64_t square = limited(task, squares[i]);
            cells[i] = square == UNREACHABLE    ? INT32_MAX
                       : square == -UNREACHABLE ? -INT32_MAX
                                                : (int32_t)square;
        }
    } else {
        int64_t *cells = (int64_t *)task->cells + at;
        for (int64_t i = 0; i < count; i++) cells[i] = limited(task, squares[i]);
    }
}

/* Solve and store row y. */
static void solve_row(const Task *task, const Row *row, int64_t y, const uint32_t *down)
{
    const int64_t width = task->width, blocks = (width + BLOCK - 1) / BLOCK, at = y * width;
    const uint8_t *marked = task->marked + at;
    split_row(marked, down, row->up, row->heights, row->outside, row->inside, width);
    for (int64_t b = 0; b < blocks; b++) {
        row->lowest_outside[b] = lowest_of_block(row->outside + b * BLOCK);
        row->lowest_inside[b] = lowest_of_block(row->inside + b * BLOCK);
    }
    int64_t far = -1; /* where a stretch of far blocks begins */
    uint16_t outside[BLOCK], inside[BLOCK];
    for (int64_t b = 0; b < blocks; b++) {
        const int64_t x = b * BLOCK;
        const int count = width - x < BLOCK ? (int)(width - x) : BLOCK;
        int highest = 0;
        memset(outside, 0, sizeof outside);
        memset(inside, 0, sizeof inside);
        if (row->lowest_inside[b] == 0) /* not all cells are marked */
            highest = solve_near(row->outside + x, row->lowest_outside + b, count,
                                 task->near_reach, task->near_most, outside);
        if (row->lowest_outside[b] == 0 && task->both_kinds) {
            const int other = solve_near(row->inside + x, row->lowest_inside + b, count,
                                         task->near_reach, task->near_most, inside);
            if (other > highest) highest = other;
        }
        if (task->has_far && highest > task->near_most) {
            if (far < 0) far = x;
            continue;
        }
        if (far >= 0) {
            solve_far(task, row, marked, far, x);
            store_far(task, at + far, row->squares, x - far);
            far = -1;
        }
        store_near(task, at + x, outside, inside, count, highest);
    }
    if (far >= 0) {
        solve_far(task, row, marked, far, width);
        store_far(task, at + far, row->squares, width - far);
    }
}

/* Solve the rows of a band, given by join_bands how runs go on beyond it. Returns whether there
 * was memory for it. */
static int solve_band(const Task *task, const uint32_t *down, const uint32_t *up, int64_t band)
{
    const int64_t width = task->width, height = task->height;
    const int64_t first = band * task->band_rows, end = band_end(task, band);
    const uint8_t *marked = task->marked;

    const size_t cells = (size_t)width, blocks = (cells + BLOCK - 1) / BLOCK;
    const size_t padded = blocks * BLOCK + 2 * MARGIN, lows = blocks + 2 * RINGS;
    const size_t counts = cells * (size_t)(end - first);
    char *memory = malloc((3 * cells + 4) * sizeof(int64_t)
                          + (counts + 2 * cells) * sizeof(uint32_t)
                          + 2 * (padded + lows) * sizeof(uint16_t));
    if (memory == NULL) return 0;
    Row row;
    row.sites = (int64_t *)memory;
    row.values = row.sites + cells + 2;
    row.squares = row.values + cells + 2;
    row.down = (uint32_t *)(row.squares + cells);
    row.up = row.down + counts;
    row.heights = row.up + cells;
    row.outside = (uint16_t *)(row.heights + cells);
    row.inside = row.outside + padded;
    row.lowest_outside = row.inside + padded;
    row.lowest_inside = row.lowest_outside + lows;
    for (size_t i = 0; i < 2 * (padded + lows); i++) row.outside[i] = NEAR_CAP * NEAR_CAP;
    row.outside += MARGIN;
    row.inside += MARGIN;
    row.lowest_outside += RINGS;
    row.lowest_inside += RINGS;

    if (first == 0 && task->row_before == NULL)
        for (int64_t x = 0; x < width; x++) row.down[x] = endless_height(task);
    else if (first == 0)
        run_on(marked, task->row_before, task->down_before, row.down, width);
    else
        run_on(marked + first * width, marked + (first - 1) * width, down + (band - 1) * width,
               row.down, width);
    for (int64_t y = first + 1; y < end; y++)
        run_on(marked + y * width, marked + (y - 1) * width, row.down + (y - 1 - first) * width,
               row.down + (y - first) * width, width);
    for (int64_t y = end - 1; y >= first; y--) {
        if (y == height - 1 && task->row_after == NULL)
            for (int64_t x = 0; x < width; x++) row.up[x] = endless_height(task);
        else if (y == height - 1)
            run_on(marked + y * width, task->row_after, task->up_after, row.up, width);
        else if (y == end - 1)
            run_on(marked + y * width, marked + end * width, up + (band + 1) * width, row.up, width);
        else
            run_on_in_place(marked + y * width, marked + (y + 1) * width, row.up, width);
        solve_row(task, &row, y, row.down + (y - first) * width);
    }
    free(memory);
    return 1;
}
