/* What lies on a line: the least of the numbers there, and whether all cells are open. The rules are
 * those of least_along in lookup.py. */

#include <math.h>
#include <stdint.h>

typedef struct {
    const int32_t *values;
    const uint8_t *is_open;
    int64_t height, width;
    double near;
} Plane;

static int is_open_around(const Plane *plane, double row, double col)
{
    for (int k = 0; k < 4; k++) {
        const double up = row + (k & 2 ? plane->near : -plane->near);
        const double on = col + (k & 1 ? plane->near : -plane->near);
        const double at = fmax(0.0, fmin(up, (double)(plane->height - 1)));
        const double beside = fmax(0.0, fmin(on, (double)(plane->width - 1)));
        if (!plane->is_open[(int64_t)at * plane->width + (int64_t)beside]) return 0;
    }
    return 1;
}

/* Look at `count` places from one to another. */
static void look_along(const Plane *plane, const double *start, const double *end, int64_t count,
                       int64_t *least, uint8_t *is_open)
{
    const double rows = end[0] - start[0], cols = end[1] - start[1], middle = 0.5 - plane->near;
    const double steps = count > 1 ? (double)(count - 1) : 1.0;
    *least = INT32_MAX;
    *is_open = 1;
    for (int64_t i = 0; i < count; i++) {
        const double share = (double)i / steps;
        const double y = start[0] + share * rows, x = start[1] + share * cols;
        const int64_t row = (int64_t)y, col = (int64_t)x, cell = row * plane->width + col;
        if (plane->values[cell] < *least) *least = plane->values[cell];
        if (!*is_open) continue;
        const int is_near = fabs(y - (double)row - 0.5) > middle ||
                            fabs(x - (double)col - 0.5) > middle;
        *is_open = plane->is_open[cell] && (!is_near || is_open_around(plane, y, x));
    }
}
