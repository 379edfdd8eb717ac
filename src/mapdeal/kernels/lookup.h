/* Bytes through tables, counted and compared; distances back to whole squares of cells. */

#include <string.h>

#include "lanes.h"

enum { STRIP = 512 }; /* cells whose indices are held at a time */

/* How a field's distances were made, see squares_of_distances in lookup.py. */
typedef struct {
    double scale, shift, gain, clip;
    int64_t last; /* the table's last index */
} Measure;

/* The steps of squares_of_distances, without branches; `last` where it is larger or infinite. */
MANY_LANES static void indices_of_distances(const Measure *measure, const float *distance,
                                            const uint8_t *obstacles, int32_t *restrict indices,
                                            int count)
{
    const double scale = measure->scale, shift = measure->shift, gain = measure->gain;
    const double clip = measure->clip, last = (double)measure->last;
    for (int i = 0; i < count; i++) {
        const double metres = gain == 1.0 ? (double)distance[i] : (double)distance[i] / gain;
        const double cells = (metres + shift) / scale;
        double square = cells * cells;
        square = square < last ? square : last;
        square = (square + 0x1p52) - 0x1p52; /* leaves no place for fractions: half to even */
        square = metres >= clip ? last : square;
        square = obstacles[i] ? 0.0 : square;
        indices[i] = (int32_t)square;
    }
}

static void bytes_of_row(const Measure *measure, const float *distance, const uint8_t *obstacles,
                         const uint8_t *table, uint8_t *bytes, int64_t width)
{
    int32_t indices[STRIP];
    for (int64_t x = 0; x < width; x += STRIP) {
        const int count = width - x < STRIP ? (int)(width - x) : STRIP;
        indices_of_distances(measure, distance + x, obstacles + x, indices, count);
        for (int i = 0; i < count; i++) bytes[x + i] = table[indices[i]];
    }
}

enum { MOST_RUNS = 8, LOOKED_UP = 4096 };

/* A table of 256 bytes as runs of equal entries: which are compared with, many at a time. */
typedef struct {
    int count;
    uint8_t starts[MOST_RUNS], values[MOST_RUNS];
} Runs;

/* Return whether a table has few enough runs. */
static int runs_of_table(const uint8_t *table, Runs *runs)
{
    runs->count = 0;
    for (int i = 0; i < 256; i++) {
        if (i > 0 && table[i] == table[i - 1]) continue;
        if (runs->count == MOST_RUNS) return 0;
        runs->starts[runs->count] = (uint8_t)i;
        runs->values[runs->count++] = table[i];
    }
    return 1;
}

MANY_LANES static void look_up_runs(const Runs *runs, const uint8_t *restrict source,
                                    uint8_t *restrict target, int64_t count)
{
    for (int64_t first = 0; first < count; first += LOOKED_UP) { /* stays in the nearest cache */
        const int64_t end = count - first < LOOKED_UP ? count : first + LOOKED_UP;
        memset(target + first, runs->values[0], (size_t)(end - first));
        for (int k = 1; k < runs->count; k++) {
            const uint8_t start = runs->starts[k], value = runs->values[k];
            for (int64_t i = first; i < end; i++)
                target[i] = source[i] >= start ? value : target[i];
        }
    }
}

static void look_up_bytes(const uint8_t *table, const uint8_t *source, uint8_t *target,
                          int64_t count)
{
    for (int64_t i = 0; i < count; i++) target[i] = table[source[i]];
}

/* Add to `counts`. Maps have long runs, of which 32 cells are counted at once; elsewhere there are
 * four tables, so that equal neighbours need not wait for each other. */
static void count_all(const uint8_t *cells, int64_t count, int64_t *counts)
{
    uint64_t parts[4][256];
    memset(parts, 0, sizeof parts);
    int64_t i = 0;
    for (; i + 32 <= count; i += 32) {
        uint64_t words[4];
        memcpy(words, cells + i, sizeof words);
        const uint64_t same = 0x0101010101010101u * cells[i];
        if (((words[0] ^ same) | (words[1] ^ same) | (words[2] ^ same) | (words[3] ^ same)) == 0) {
            parts[0][cells[i]] += 32;
            continue;
        }
        for (int k = 0; k < 32; k += 4) {
            parts[0][cells[i + k]]++;
            parts[1][cells[i + k + 1]]++;
            parts[2][cells[i + k + 2]]++;
            parts[3][cells[i + k + 3]]++;
        }
    }
    for (; i < count; i++) parts[0][cells[i]]++;
    for (int value = 0; value < 256; value++)
        counts[value] += (int64_t)(parts[0][value] + parts[1][value] + parts[2][value]
                                   + parts[3][value]);
}

/* Raise costs to what is asked for; unknown ones, 255, only from `least` on. */
MANY_LANES static void raise_bytes(uint8_t *restrict costs, const uint8_t *restrict asked,
                                   uint8_t least, int64_t count)
{
    for (int64_t i = 0; i < count; i++) {
        const uint8_t larger = costs[i] > asked[i] ? costs[i] : asked[i];
        costs[i] = costs[i] == 255 && asked[i] >= least ? asked[i] : larger;
    }
}

/* An even scale of colours for distances, see level_rows in lookup.py. */
typedef struct {
    float low, factor, last; /* steps = (distance - low) * factor, up to the last */
    uint8_t first, below, faded_by;
} LevelScale;

MANY_LANES static void levels_of(const LevelScale *scale, const float *restrict distance,
                                 const uint8_t *restrict obstacles, const uint8_t *restrict unknown,
                                 uint8_t *restrict levels, int64_t count)
{
    const float low = scale->low, factor = scale->factor, last = scale->last;
    const uint8_t first = scale->first, below = scale->below, faded_by = scale->faded_by;
    for (int64_t i = 0; i < count; i++) {
        float step = (distance[i] - low) * factor;
        step = step > 0 ? step : 0;
        step = step < last ? step : last;
        const uint8_t level = (uint8_t)((uint8_t)(int32_t)step + first);
        const uint8_t inside = level < below - 1 ? level : (uint8_t)(below - 1);
        const uint8_t outside = level > below ? level : below;
        levels[i] = (uint8_t)((obstacles[i] ? inside : outside) + (unknown[i] ? faded_by : 0));
    }
}
