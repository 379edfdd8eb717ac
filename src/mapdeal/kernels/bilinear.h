/* Values between the centres of cells. */

#include <math.h>
#include <stdint.h>

/* The two indices, held within 0..last, between whose centres a place lies, and its share of the
 * way from the first to the second. */
static inline double corners_of(double place, int64_t last, int64_t *first, int64_t *second)
{
    const double from_centre = place - 0.5;
    const double below = floor(from_centre);
    const int64_t index = (int64_t)below;
    *first = index < 0 ? 0 : index > last ? last : index;
    *second = index + 1 < 0 ? 0 : index + 1 > last ? last : index + 1;
    return from_centre - below;
}

/* The steps of `interpolate` in bilinear.py's twin, place by place. */
static void interpolate_places(const float *values, int64_t height, int64_t width,
                               const double *places, int64_t count, double *between,
                               double *slopes)
{
    for (int64_t i = 0; i < count; i++) {
        const double row = places[2 * i], col = places[2 * i + 1];
        int64_t south, north, west, east;
        if (!(row >= -1.0 && row <= (double)height + 1.0 && col >= -1.0 &&
              col <= (double)width + 1.0)) { /* nan, too */
            between[i] = slopes[2 * i] = slopes[2 * i + 1] = NAN;
            continue;
        }
        const double v = corners_of(row, height - 1, &south, &north);
        const double u = corners_of(col, width - 1, &west, &east);
        const double a = values[south * width + west], b = values[south * width + east];
        const double c = values[north * width + west], d = values[north * width + east];
        if (!(isfinite(a) && isfinite(b) && isfinite(c) && isfinite(d))) {
            between[i] = values[(v < 0.5 ? south : north) * width + (u < 0.5 ? west : east)];
            slopes[2 * i] = slopes[2 * i + 1] = NAN;
            continue;
        }
        between[i] = (1.0 - v) * ((1.0 - u) * a + u * b) + v * ((1.0 - u) * c + u * d);
        slopes[2 * i] = (1.0 - u) * (c - a) + u * (d - b);
        slopes[2 * i + 1] = (1.0 - v) * (b - a) + v * (d - c);
    }
}
