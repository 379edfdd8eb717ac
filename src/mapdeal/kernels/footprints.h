/* The costs of a footprint at poses, as Nav2's FootprintCollisionChecker: footprints.py has the
 * rules, and a twin whose steps these are. */

#include <math.h>
#include <stdint.h>
#include <stdlib.h>

enum { MOST_CORNERS = 512 };

typedef struct {
    const uint8_t *costs;
    int64_t height, width;
    double resolution, x, y, cos, sin; /* of the grid: cell, and origin with its turn */
    const double *corners;
    int64_t count;
    int filled; /* whether the inside counts, too */
} FootprintTask;

typedef struct {
    int64_t row, col;
} GridCell;

/* How much worse is a cost than others: 254, then 255, then all others by size. */
static inline int severity_of(uint8_t cost)
{
    return cost == 254 ? 255 : cost == 255 ? 254 : cost;
}

/* The cells of the corners of a footprint at a pose; whether all of them lie in the grid. */
static int corner_cells(const FootprintTask *task, const double *pose, GridCell *cells)
{
    const double turn_cos = cos(pose[2]), turn_sin = sin(pose[2]);
    for (int64_t k = 0; k < task->count; k++) {
        const double fx = task->corners[2 * k], fy = task->corners[2 * k + 1];
        const double dx = pose[0] + (fx * turn_cos - fy * turn_sin) - task->x;
        const double dy = pose[1] + (fx * turn_sin + fy * turn_cos) - task->y;
        const double along = dx * task->cos + dy * task->sin;
        const double across = dy * task->cos - dx * task->sin;
        const double col = along / task->resolution, row = across / task->resolution;
        if (!(along >= 0 && across >= 0 && col < (double)task->width && row < (double)task->height))
            return 0; /* nor does a cell hold what is no number */
        cells[k].row = (int64_t)row;
        cells[k].col = (int64_t)col;
    }
    return 1;
}

/* The severity of the worst cell of a line, both ends included. */
static int severity_of_line(const FootprintTask *task, GridCell from, GridCell to)
{
    const int64_t rows = llabs(to.row - from.row), cols = llabs(to.col - from.col);
    const int64_t row_step = to.row >= from.row ? task->width : -task->width;
    const int64_t col_step = to.col >= from.col ? 1 : -1;
    const int is_flat = cols >= rows;
    const int64_t n = is_flat ? cols : rows, minor = is_flat ? rows : cols;
    const int64_t along = is_flat ? col_step : row_step, across = is_flat ? row_step : col_step;
    const uint8_t *cell = task->costs + from.row * task->width + from.col;
    int64_t sum = n / 2;
    int worst = severity_of(*cell);
    for (int64_t i = 0; i < n && worst < 255; i++) {
        sum += minor;
        if (sum >= n) {
            sum -= n;
            cell += across;
        }
        cell += along;
        const int severity = severity_of(*cell);
        worst = severity > worst ? severity : worst;
    }
    return worst;
}

/* The first column of a row that is not left of an edge which is not level. */
static inline int64_t crossing_of(GridCell a, GridCell b, int64_t row)
{
    const GridCell low = a.row < b.row ? a : b, high = a.row < b.row ? b : a;
    const int64_t product = (row - low.row) * (high.col - low.col), rows = high.row - low.row;
    return low.col + (product > 0 ? (product + rows - 1) / rows : product / rows);
}

/* The severity of the worst cell within a polygon, by the even-odd rule; those on its edges are
 * left to severity_of_line. */
static int severity_inside(const FootprintTask *task, const GridCell *cells)
{
    int64_t crossings[MOST_CORNERS];
    int64_t bottom = cells[0].row, top = cells[0].row;
    int worst = 0;
    for (int64_t k = 1; k < task->count; k++) {
        bottom = cells[k].row < bottom ? cells[k].row : bottom;
        top = cells[k].row > top ? cells[k].row : top;
    }
    for (int64_t row = bottom; row < top && worst < 255; row++) {
        int64_t found = 0;
        for (int64_t k = 0; k < task->count; k++) {
            const GridCell a = cells[k], b = cells[k + 1 < task->count ? k + 1 : 0];
            if ((a.row <= row) == (b.row <= row)) continue;
            const int64_t col = crossing_of(a, b, row);
            int64_t place = found++;
            for (; place > 0 && crossings[place - 1] > col; place--)
                crossings[place] = crossings[place - 1];
            crossings[place] = col;
        }
        const uint8_t *line = task->costs + row * task->width;
        for (int64_t k = 0; k + 1 < found; k += 2)
            for (int64_t col = crossings[k]; col < crossings[k + 1]; col++) {
                const int severity = severity_of(line[col]);
                worst = severity > worst ? severity : worst;
            }
    }
    return worst;
}

static int severity_of_footprint(const FootprintTask *task, const GridCell *cells)
{
    const GridCell first = cells[0], last = cells[task->count - 1];
    int worst = 0;
    /* A line that meets 254 or 255 decides for the outline: 255 is the larger of the two. */
    for (int64_t k = 0; k + 1 < task->count && worst < (task->filled ? 255 : 254); k++) {
        const int severity = severity_of_line(task, cells[k], cells[k + 1]);
        worst = severity > worst ? severity : worst;
    }
    if (worst < (task->filled ? 255 : 254)) {
        const int severity = severity_of_line(task, first, last);
        worst = severity > worst ? severity : worst;
    }
    if (!task->filled) return worst;
    if (worst < 255) {
        const int severity = severity_of_line(task, last, first);
        worst = severity > worst ? severity : worst;
    }
    if (worst < 255) {
        const int severity = severity_inside(task, cells);
        worst = severity > worst ? severity : worst;
    }
    return worst;
}

static void costs_of_footprint(const FootprintTask *task, const double *poses, int64_t count,
                               uint8_t *costs, uint8_t *inside)
{
    GridCell cells[MOST_CORNERS];
    for (int64_t i = 0; i < count; i++) {
        inside[i] = (uint8_t)corner_cells(task, poses + 3 * i, cells);
        /* severities and costs are exchanged by the same rule */
        const int severity = inside[i] ? severity_of_footprint(task, cells) : 255;
        costs[i] = (uint8_t)severity_of((uint8_t)severity);
    }
}
