/* Distances back to whole squares of cells, and through a table. */

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
