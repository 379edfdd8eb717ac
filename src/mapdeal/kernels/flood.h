/* Lengths of the shortest ways from several cells: Dijkstra's algorithm, with a list of cells for
 * each length. skeleton.py has the rules. */

#ifndef MAPDEAL_FLOOD_H
#define MAPDEAL_FLOOD_H

#include <stdint.h>
#include <stdlib.h>

enum { LISTS = 18 }; /* one more than the longest step */

typedef struct {
    int64_t *cells;
    int64_t count, room;
} CellList;

typedef struct {
    const uint8_t *is_open; /* closed along the border */
    int64_t width;
    const int64_t *sources, *starts; /* what is still to come, by the lengths at the start */
    int64_t count, limit;
    uint32_t *lengths; /* the largest number where no way is known */
    int32_t *origin; /* or NULL */
    uint8_t *steps; /* the last ones of these ways, by their places in the ring; 0 at first */
    int64_t length, waiting;
    CellList lists[LISTS];
} Flood;

static int append_cell(CellList *list, int64_t cell)
{
    if (list->count == list->room) {
        const int64_t room = list->room ? 2 * list->room : 256;
        int64_t *cells = realloc(list->cells, (size_t)room * sizeof(int64_t));
        if (cells == NULL) return 0;
        list->cells = cells;
        list->room = room;
    }
    list->cells[list->count++] = cell;
    return 1;
}

static int note_cell(Flood *flood, int64_t length, int64_t cell)
{
    flood->waiting++;
    return append_cell(&flood->lists[length % LISTS], cell);
}

/* Go one step on from all cells at the next length. Returns 0 if there is no memory. */
static int flood_on(Flood *flood)
{
    static const int RING[8][2] = {{0, 1},  {1, 1},   {1, 0},  {1, -1},
                                   {0, -1}, {-1, -1}, {-1, 0}, {-1, 1}};
    if (flood->waiting == 0) flood->length = *flood->starts;
    const int64_t length = flood->length++;
    for (; flood->count && *flood->starts == length; flood->count--, flood->starts++)
        if (!note_cell(flood, length, *flood->sources++)) return 0;
    CellList *now = &flood->lists[length % LISTS];
    for (int64_t i = 0; i < now->count; i++) {
        const int64_t cell = now->cells[i];
        if (flood->lengths[cell] != length) continue; /* a shorter way was found meanwhile */
        for (uint8_t k = 0; k < 8; k++) {
            const int64_t up = RING[k][0] * flood->width, on = RING[k][1], next = cell + up + on;
            const int64_t following = length + (k % 2 ? 17 : 12);
            if (flood->lengths[next] < following || !flood->is_open[next]) continue;
            if (following > flood->limit) continue;
            if (k % 2 && !flood->is_open[cell + up] && !flood->is_open[cell + on]) continue;
            if (flood->lengths[next] > following) {
                flood->lengths[next] = (uint32_t)following;
                if (!note_cell(flood, following, next)) return 0;
            } else if (k >= flood->steps[next] || (k ^ flood->steps[next]) % 2)
                continue; /* of ways as long that with a diagonal step, then the first of the ring */
            flood->steps[next] = k;
            if (flood->origin) flood->origin[next] = flood->origin[cell];
        }
    }
    flood->waiting -= now->count;
    now->count = 0;
    return 1;
}

#endif
