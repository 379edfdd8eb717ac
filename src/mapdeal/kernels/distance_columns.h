/* Distance transforms: the task, and its first pass, down and up the columns. The whole is
 * described in distance_rows.h. */

#ifndef MAPDEAL_DISTANCE_COLUMNS_H
#define MAPDEAL_DISTANCE_COLUMNS_H

#include <math.h>
#include <stdint.h>
#include <stddef.h>

#include "lanes.h"

enum {
    BLOCK = 32,       /* cells that are solved together */
    NEAR_REACH = 96,  /* offsets that are tried before a block counts as far */
    NEAR_SQUARE = NEAR_REACH * NEAR_REACH,
    NEAR_MOST = 176,  /* the same if a limit lets nothing farther matter: squares in 16 bits */
    NEAR_CAP = 181,   /* heights above count as this in 16 bits; its square is above NEAR_MOST's */
    RINGS = 6,        /* blocks on each side that offsets up to NEAR_MOST reach */
    MARGIN = RINGS * BLOCK,
    LONGEST_SIDE = 1500000, /* 2 side^2 * side stays below 2^63 */
};

static const int64_t UNREACHABLE = INT64_MAX;

typedef enum { SQUARES_32, SQUARES_64, METRES, BYTES } Form;

/* What is to be done for a grid of height x width cells, or for some rows of a higher one. */
typedef struct {
    const uint8_t *marked;
    int64_t height, width;
    int64_t whole_height; /* of the grid that the rows belong to */
    const uint8_t *row_before, *row_after;    /* the rows beside them; NULL: there is none */
    const uint32_t *down_before, *up_after;   /* lengths of the runs that end there */
    int64_t band_rows, bands;
    Form form;
    int both_kinds;     /* whether marked cells are measured too, negative; else they are 0 */
    int64_t limit;      /* squares above are unreachable; UNREACHABLE: none */
    int near_reach;     /* offsets that are tried, the root of: */
    int near_most;      /* the largest square that the trials settle */
    int has_far;        /* whether larger ones matter */
    double scale, outside_shift, inside_shift, clip, gain; /* METRES: see metres_of */
    const float *near_metres; /* METRES: of -NEAR_SQUARE .. NEAR_SQUARE, from the middle */
    const uint8_t *bytes;     /* BYTES: of squares 0 .. limit, then of those above */
    void *cells;              /* the result */
} Task;

static uint16_t squares_16[NEAR_MOST + 1];

static void fill_squares_16(void)
{
    for (int i = 0; i <= NEAR_MOST; i++) squares_16[i] = (uint16_t)(i * i);
}

static int64_t band_end(const Task *task, int64_t band)
{
    const int64_t end = (band + 1) * task->band_rows;
    return end < task->height ? end : task->height;
}

/* Metres of a signed square. The twin takes the same steps in the same order. */
static inline float metres_of(const Task *task, double square)
{
    double metres = sqrt(fabs(square)) * task->scale;
    metres = square < 0 ? task->inside_shift - metres : metres + task->outside_shift;
    metres = metres > task->clip ? task->clip : metres;
    metres = metres < -task->clip ? -task->clip : metres;
    return (float)(square < 0 ? metres : metres * task->gain);
}

/* Set `count` to the lengths of the runs of equal cells that end in the row `now`, where `before`
 * holds those that end in the row `last`. */
MANY_LANES static void run_on(const uint8_t *now, const uint8_t *last, const uint32_t *before,
                              uint32_t *restrict count, int64_t width)
{
    for (int64_t x = 0; x < width; x++) count[x] = now[x] == last[x] ? before[x] + 1 : 1;
}

MANY_LANES static void run_on_in_place(const uint8_t *now, const uint8_t *last,
                                       uint32_t *restrict count, int64_t width)
{
    for (int64_t x = 0; x < width; x++) count[x] = now[x] == last[x] ? count[x] + 1 : 1;
}

/* Fill `down` with the lengths of the runs that end in the band's last row, `up` with those that
 * end, upwards, in its first, as if there were nothing but the band. */
static void scan_band(const Task *task, int64_t band, uint32_t *down, uint32_t *up)
{
    const int64_t width = task->width, first = band * task->band_rows, end = band_end(task, band);
    down += band * width;
    up += band * width;
    for (int64_t x = 0; x < width; x++) down[x] = up[x] = 1;
    for (int64_t y = first + 1; y < end; y++)
        run_on_in_place(task->marked + y * width, task->marked + (y - 1) * width, down, width);
    for (int64_t y = end - 2; y >= first; y--)
        run_on_in_place(task->marked + y * width, task->marked + (y + 1) * width, up, width);
}

/* Lengthen those runs of a band that span all its rows by what runs into it over its row `edge`
 * from the row `last` of the band before; NULL: there is none, and such a run has no end. */
static void join_band(const uint8_t *edge, const uint8_t *last, const uint32_t *before,
                      uint32_t *here, uint32_t rows, uint32_t endless, int64_t width)
{
    for (int64_t x = 0; x < width; x++) {
        if (here[x] != rows) continue;
        if (last == NULL)
            here[x] = endless + rows;
        else if (edge[x] == last[x])
            here[x] = before[x] + rows;
    }
}

/* Where a run starts at the grid's edge there is no cell of the other kind: counts start high
 * enough there to be told from every height, low enough not to overflow. */
static uint32_t endless_height(const Task *task)
{
    return UINT32_MAX - (uint32_t)task->whole_height;
}

static void join_bands(const Task *task, uint32_t *down, uint32_t *up)
{
    const int64_t width = task->width, bands = task->bands;
    const uint32_t endless = endless_height(task) - 1;
    for (int64_t b = 0; b < bands; b++) {
        const int64_t first = b * task->band_rows, rows = band_end(task, b) - first;
        const uint8_t *edge = task->marked + first * width;
        uint32_t *here = down + b * width;
        join_band(edge, b ? edge - width : task->row_before, b ? here - width : task->down_before,
                  here, (uint32_t)rows, endless, width);
    }
    for (int64_t b = bands - 1; b >= 0; b--) {
        const int64_t end = band_end(task, b), rows = end - b * task->band_rows;
        const uint8_t *edge = task->marked + (end - 1) * width;
        uint32_t *here = up + b * width;
        const int last = b + 1 == bands;
        join_band(edge, last ? task->row_after : edge + width, last ? task->up_after : here + width,
                  here, (uint32_t)rows, endless, width);
    }
}

#endif
