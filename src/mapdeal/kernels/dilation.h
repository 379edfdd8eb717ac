/* Cells near marked ones, by bytes: discs, squares and rings of small reach.
 *
 * Rows are taken in bands. Of each row of a band, and of `reach` rows around it, the distance along
 * the row to the nearest marked cell is found first, by doubling: what is known of cells up to d
 * away becomes known of cells up to 2 d + 1 away in one step over all lanes. A cell then lies within
 * a shape if for one of the rows near it that distance is at most the shape's half width there.
 * Where all rows are as wide, the least of many rows is found by doubling, too.
 */

#ifndef MAPDEAL_DILATION_H
#define MAPDEAL_DILATION_H

#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "lanes.h"

#define MOST_REACH 62
/* A distance that no cell has: with all steps of doubling added it still fits into a byte. */
#define FAR_AWAY 128
#define ROW_PAD 64
#define STRIP 512

typedef struct {
    const uint8_t *marked; /* or, if NULL, cells of at least `threshold` are marked */
    const int8_t *values;
    int8_t threshold;
    int64_t height, width;
    int64_t reach;
    const uint8_t *half_widths; /* by distance of rows, 0 .. reach */
} Shape;

/* What becomes of cells within a shape: `value`, but for those of `kept` below the threshold. */
typedef struct {
    int8_t value, threshold, kept;
} Put;

/* The distances of some rows, and the rows around them: each with ROW_PAD bytes on both sides. */
typedef struct {
    uint8_t *rows;
    int64_t stride, count;
} Band;

static inline uint8_t least(uint8_t a, uint8_t b) { return a < b ? a : b; }
static inline uint8_t most(uint8_t a, uint8_t b) { return a > b ? a : b; }

MANY_LANES static void mark_row(const Shape *shape, int64_t y, uint8_t *restrict row) {
    int64_t width = shape->width;
    if (shape->marked != NULL) {
        const uint8_t *marked = shape->marked + y * width;
        for (int64_t x = 0; x < width; x++) row[x] = marked[x] ? 0 : FAR_AWAY;
    } else {
        const int8_t *values = shape->values + y * width;
        int8_t threshold = shape->threshold;
        for (int64_t x = 0; x < width; x++) row[x] = values[x] >= threshold ? 0 : FAR_AWAY;
    }
}

MANY_LANES static void double_reach(
    const uint8_t *restrict old, int64_t width, int64_t step, uint8_t *restrict row
) {
    uint8_t add = (uint8_t)step;
    for (int64_t x = 0; x < width; x++) {
        uint8_t sides = least(old[x - step], old[x + step]);
        row[x] = least(old[x], (uint8_t)(sides + add));
    }
}

/* Distances along the rows `bottom` - reach .. `top` + reach - 1 to the nearest marked cell, exact
 * up to `reach`; rows outside of the grid are far away. 0 if there is no memory. */
static int band_distances(const Shape *shape, int64_t bottom, int64_t top, Band *band) {
    int64_t reach = shape->reach, width = shape->width;
    band->stride = width + 2 * ROW_PAD;
    band->count = top - bottom + 2 * reach;
    band->rows = malloc((size_t)((band->count + 1) * band->stride));
    if (band->rows == NULL) return 0;
    int steps = 0;
    for (int64_t step = 1; step <= reach; step *= 2) steps++;
    uint8_t *spare = band->rows + band->count * band->stride;
    memset(spare, FAR_AWAY, (size_t)band->stride);
    for (int64_t k = 0; k < band->count; k++) {
        int64_t y = bottom - reach + k;
        uint8_t *row = band->rows + k * band->stride;
        if (y < 0 || y >= shape->height) {
            memset(row, FAR_AWAY, (size_t)band->stride);
            continue;
        }
        memset(row, FAR_AWAY, ROW_PAD);
        memset(row + ROW_PAD + width, FAR_AWAY, ROW_PAD);
        /* to and fro, so that the last step ends where the row is to stand */
        uint8_t *now = (steps % 2 ? spare : row) + ROW_PAD;
        uint8_t *next = (steps % 2 ? row : spare) + ROW_PAD;
        mark_row(shape, y, now);
        for (int64_t step = 1; step <= reach; step *= 2) {
            double_reach(now, width, step, next);
            uint8_t *swap = now;
            now = next;
            next = swap;
        }
    }
    return 1;
}

MANY_LANES static void take_least(
    const uint8_t *restrict other, int64_t width, uint8_t *restrict row
) {
    for (int64_t x = 0; x < width; x++) row[x] = least(row[x], other[x]);
}

/* Make each row the least of itself and the `count` - 1 rows behind it, for the largest power of
 * two that is at most `most_rows`; return that. */
static int64_t least_of_rows(Band *band, int64_t width, int64_t most_rows) {
    int64_t count = 1;
    for (; 2 * count <= most_rows; count *= 2)
        for (int64_t k = 0; k + count < band->count; k++) {
            uint8_t *row = band->rows + k * band->stride + ROW_PAD;
            take_least(row + count * band->stride, width, row);
        }
    return count;
}

/* Whether the cells of a strip of a row lie within the shape around a marked cell. */
MANY_LANES static void cover_strip(
    const uint8_t *middle, int64_t stride, int64_t count, int64_t reach,
    const uint8_t *half_widths, uint8_t *restrict within
) {
    uint8_t half = half_widths[0];
    for (int64_t x = 0; x < count; x++) within[x] = middle[x] <= half;
    for (int64_t k = 1; k <= reach; k++) {
        const uint8_t *below = middle - k * stride, *above = middle + k * stride;
        half = half_widths[k];
        for (int64_t x = 0; x < count; x++) within[x] |= least(below[x], above[x]) <= half;
    }
}

/* The same of a square, from two rows of the least of many. */
MANY_LANES static void square_strip(
    const uint8_t *first, const uint8_t *last, int64_t count, int64_t reach,
    uint8_t *restrict within
) {
    uint8_t half = (uint8_t)reach;
    for (int64_t x = 0; x < count; x++) within[x] = least(first[x], last[x]) <= half;
}

MANY_LANES static void put_strip(
    const uint8_t *within, const int8_t *values, int64_t count, const Put *how,
    int8_t *restrict put
) {
    int8_t value = how->value, threshold = how->threshold, kept = how->kept;
    for (int64_t x = 0; x < count; x++) {
        uint8_t may = (values[x] != kept) | (values[x] >= threshold);
        put[x] = within[x] & may ? value : values[x];
    }
}

/* Chebyshev distances of a strip, up to `reach`, become costs; beyond that values stay. */
MANY_LANES static void ring_strip(
    const uint8_t *middle, int64_t stride, int64_t count, int64_t reach, const int8_t *values,
    const int8_t *costs, int8_t *restrict ringed
) {
    uint8_t distance[STRIP];
    memcpy(distance, middle, (size_t)count);
    for (int64_t k = 1; k <= reach; k++) {
        const uint8_t *below = middle - k * stride, *above = middle + k * stride;
        uint8_t rows = (uint8_t)k;
        for (int64_t x = 0; x < count; x++)
            distance[x] = least(distance[x], most(least(below[x], above[x]), rows));
    }
    memcpy(ringed, values, (size_t)count);
    for (int64_t k = 0; k <= reach; k++) {
        uint8_t ring = (uint8_t)k;
        int8_t cost = costs[k];
        for (int64_t x = 0; x < count; x++) ringed[x] = distance[x] == ring ? cost : ringed[x];
    }
}

/* Rows `bottom` .. `top` - 1 of what lies within the shape: of a mask, or if `put` is given of the
 * values, in which covered cells become `value`. 0 if there is no memory. */
static int cover_rows(
    const Shape *shape, int is_square, int64_t bottom, int64_t top, uint8_t *covered,
    const Put *how, int8_t *put
) {
    int64_t width = shape->width, reach = shape->reach, together = 1;
    Band band;
    uint8_t strip[STRIP];
    if (!band_distances(shape, bottom, top, &band)) return 0;
    if (is_square) together = least_of_rows(&band, width, 2 * reach + 1);
    for (int64_t y = bottom; y < top; y++) {
        const uint8_t *middle = band.rows + (y - bottom + reach) * band.stride + ROW_PAD;
        const uint8_t *first = middle - reach * band.stride;
        const uint8_t *last = middle + (reach + 1 - together) * band.stride;
        for (int64_t x = 0; x < width; x += STRIP) {
            int64_t count = width - x < STRIP ? width - x : STRIP, at = y * width + x;
            uint8_t *within = put == NULL ? covered + at : strip;
            if (is_square)
                square_strip(first + x, last + x, count, reach, within);
            else
                cover_strip(middle + x, band.stride, count, reach, shape->half_widths, within);
            if (put != NULL)
                put_strip(strip, shape->values + at, count, how, put + at);
        }
    }
    free(band.rows);
    return 1;
}

/* Rows of values, those of cells in a ring replaced by its cost. 0 if there is no memory. */
static int ring_rows(
    const Shape *shape, const int8_t *costs, const int8_t *values, int64_t bottom, int64_t top,
    int8_t *ringed
) {
    int64_t width = shape->width, reach = shape->reach;
    Band band;
    if (!band_distances(shape, bottom, top, &band)) return 0;
    for (int64_t y = bottom; y < top; y++) {
        const uint8_t *middle = band.rows + (y - bottom + reach) * band.stride + ROW_PAD;
        for (int64_t x = 0; x < width; x += STRIP) {
            int64_t count = width - x < STRIP ? width - x : STRIP, at = y * width + x;
            ring_strip(middle + x, band.stride, count, reach, values + at, costs, ringed + at);
        }
    }
    free(band.rows);
    return 1;
}

#endif
