/* The eikonal equation over the eight triangles around each cell. paths.py has the rules. */

#include <math.h>
#include <stdint.h>
#include <stdlib.h>

#include "flood.h"

static const double DIAGONAL = 1.4142135623730951;

typedef struct {
    const uint8_t *classes; /* of cells; those along the border are closed */
    const double *weights; /* of each class; 0 if it is closed */
    int64_t width;
    double *costs; /* infinite where no way is known */
    double lists_per_cost;
    CellList *lists; /* a ring */
    int64_t list_count, list, waiting;
} Front;

static int lower_cost(Front *front, int64_t cell, double cost)
{
    const double before = front->costs[cell];
    if (!(cost < before)) return 1;
    const int64_t place = (int64_t)(cost * front->lists_per_cost);
    front->costs[cell] = cost;
    if (before < INFINITY && (int64_t)(before * front->lists_per_cost) == place) return 1;
    front->waiting++;
    return append_cell(&front->lists[place % front->list_count], cell);
}

static int update_around(Front *front, int64_t cell)
{
    const int64_t steps[4] = {-front->width, -1, 1, front->width};
    const double cost = front->costs[cell];
    for (int k = 0; k < 4; k++) {
        const int64_t next = cell + steps[k], side = k == 0 || k == 3 ? 1 : front->width;
        const double weight = front->weights[front->classes[next]];
        if (!(weight > 0)) continue;
        if (front->costs[next] > cost) {
            const double a = front->costs[cell - side], b = front->costs[cell + side];
            const double drop = cost - (a < b ? a : b), square = weight * weight - drop * drop;
            if (drop <= 0) {
                if (!lower_cost(front, next, cost + weight)) return 0;
            } else if (square > drop * drop && !lower_cost(front, next, cost + sqrt(square)))
                return 0;
        }
        for (int64_t turn = -side; turn <= side; turn += 2 * side) { /* past an open cell */
            const double beyond = front->weights[front->classes[next + turn]] * DIAGONAL;
            if (beyond > 0 && !lower_cost(front, next + turn, cost + beyond)) return 0;
        }
    }
    return 1;
}

/* Update the neighbours of all cells of one list. Returns 0 if there is no memory. */
static int advance_front(Front *front)
{
    CellList *now = &front->lists[front->list % front->list_count];
    for (int64_t i = 0; i < now->count; i++) {
        const int64_t cell = now->cells[i];
        if ((int64_t)(front->costs[cell] * front->lists_per_cost) != front->list) continue;
        if (!update_around(front, cell)) return 0;
    }
    front->waiting -= now->count;
    now->count = 0;
    front->list++;
    return 1;
}
