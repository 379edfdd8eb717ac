/* NavFn's search and the trace of its path, bit for bit; kernels/searches.py has the rules. */

#include <limits.h>
#include <math.h>
#include <stdint.h>
#include <string.h>

enum { NAVFN_NEUTRAL = 50, NAVFN_CLOSED = 254, NAVFN_ROOM = 10000 };

static const float NAVFN_UNREACHED = 1.0e10f;

typedef struct {
    int64_t width, size, target_x, target_y;
    int is_astar;
    const uint8_t *costs;
    uint8_t *pending;
    float *potential;
    int64_t *current, *next, *overflow;
    int64_t current_count, next_count, overflow_count;
    float threshold;
} Navfn;

/* A full buffer drops the cell silently. */
static inline void navfn_push(Navfn *search, int64_t cell, int64_t *buffer, int64_t *count)
{
    if (cell < 0 || cell >= search->size || *count >= NAVFN_ROOM) return;
    if (search->pending[cell] || search->costs[cell] >= NAVFN_CLOSED) return;
    search->pending[cell] = 1;
    buffer[(*count)++] = cell;
}

static float navfn_distance(const Navfn *search, int64_t x, int64_t y)
{
    const double dx = (double)(x - search->target_x), dy = (double)(y - search->target_y);
    return (float)(sqrt(dx * dx + dy * dy) * NAVFN_NEUTRAL);
}

static inline void navfn_update(Navfn *search, int64_t cell)
{
    const int64_t width = search->width;
    const uint8_t *costs = search->costs;
    float *potential = search->potential;
    if (costs[cell] >= NAVFN_CLOSED) return;
    const float left = potential[cell - 1], right = potential[cell + 1];
    const float down = potential[cell - width], up = potential[cell + width];
    const float across = left < right ? left : right;
    float lowest = up < down ? up : down;
    const float cost = (float)costs[cell];
    float difference = across - lowest, reached;
    if (difference < 0) {
        difference = -difference;
        lowest = across;
    }
    if (difference >= cost) {
        reached = lowest + cost;
    } else {
        const float share = difference / cost;
        const float factor = (float)(-0.2301 * share * share + 0.5307 * share + 0.7040);
        reached = lowest + cost * factor;
    }
    if (!(reached < potential[cell])) return;
    potential[cell] = reached;
    float key = reached;
    if (search->is_astar) key += navfn_distance(search, cell % width, cell / width);
    const int is_next = key < search->threshold;
    int64_t *buffer = is_next ? search->next : search->overflow;
    int64_t *count = is_next ? &search->next_count : &search->overflow_count;
    const int64_t cells[4] = {cell - 1, cell + 1, cell - width, cell + width};
    const float before[4] = {left, right, down, up};
    for (int k = 0; k < 4; k++) {
        const float step = (float)(0.707106781 * (float)costs[cells[k]]);
        if (before[k] > key + step) navfn_push(search, cells[k], buffer, count);
    }
}

/* Compute potentials from the start until the target is reached. `work` has two bytes per cell,
 * `buffers` 3 * NAVFN_ROOM places; `table` has NavFn's cost of each byte of a costmap. */
static void navfn_search(
    const uint8_t *costmap, const uint8_t *table, int64_t width, int64_t height, int64_t start,
    int64_t start_x, int64_t start_y, int64_t target_x, int64_t target_y, int is_astar,
    float *potential, uint8_t *work, int64_t *buffers)
{
    const int64_t size = width * height;
    Navfn search = {
        .width = width, .size = size, .target_x = target_x, .target_y = target_y,
        .is_astar = is_astar, .costs = work, .pending = work + size, .potential = potential,
        .current = buffers, .next = buffers + NAVFN_ROOM, .overflow = buffers + 2 * NAVFN_ROOM,
        .threshold = NAVFN_CLOSED,
    };
    memset(work, NAVFN_CLOSED, (size_t)size);
    memset(search.pending, 0, (size_t)size);
    for (int64_t y = 1; y < height - 1; y++)
        for (int64_t k = y * width + 1; k < (y + 1) * width - 1; k++) work[k] = table[costmap[k]];
    for (int64_t k = 0; k < size; k++) potential[k] = NAVFN_UNREACHED;
    potential[start] = 0.0f;
    const int64_t around[4] = {start + 1, start - 1, start - width, start + width};
    for (int k = 0; k < 4; k++)
        navfn_push(&search, around[k], search.current, &search.current_count);
    if (is_astar) search.threshold += navfn_distance(&search, start_x, start_y);
    const int64_t target = target_y * width + target_x;
    const int64_t most_by_area = size / 20, most_by_sides = width + height;
    const int64_t most = most_by_area > most_by_sides ? most_by_area : most_by_sides;
    for (int64_t cycle = 0; cycle < most && search.current_count > 0; cycle++) {
        for (int64_t k = 0; k < search.current_count; k++) search.pending[search.current[k]] = 0;
        for (int64_t k = 0; k < search.current_count; k++) navfn_update(&search, search.current[k]);
        int64_t *done = search.current;
        search.current = search.next;
        search.current_count = search.next_count;
        search.next = done;
        search.next_count = 0;
        if (search.current_count == 0) {
            search.threshold += 2 * NAVFN_NEUTRAL;
            done = search.current;
            search.current = search.overflow;
            search.current_count = search.overflow_count;
            search.overflow = done;
            search.overflow_count = 0;
        }
        if (target < size && potential[target] < NAVFN_UNREACHED) break;
    }
}

typedef struct {
    const float *potential;
    int64_t width, size;
} NavfnField;

static inline float navfn_at(const NavfnField *field, int64_t cell)
{
    return cell < 0 || cell >= field->size ? NAVFN_UNREACHED : field->potential[cell];
}

/* A float beyond the range of an int converts to INT_MIN on x86-64. */
static inline int navfn_truncated(float value)
{
    return value < 2147483648.0f ? (int)value : INT_MIN;
}

static inline float navfn_norm(float x, float y)
{
    return (float)sqrt((double)x * x + (double)y * y);
}

/* Gradient of a reached cell, of length 1. */
static void navfn_gradient(const NavfnField *field, int64_t cell, float *x, float *y)
{
    const int64_t width = field->width;
    *x = *y = 0.0f;
    if (cell < width || cell > field->size - width) return;
    const float here = navfn_at(field, cell);
    const float left = navfn_at(field, cell - 1), right = navfn_at(field, cell + 1);
    const float down = navfn_at(field, cell - width), up = navfn_at(field, cell + width);
    float dx = 0.0f, dy = 0.0f;
    if (left < NAVFN_UNREACHED) dx += left - here;
    if (right < NAVFN_UNREACHED) dx += here - right;
    if (down < NAVFN_UNREACHED) dy += down - here;
    if (up < NAVFN_UNREACHED) dy += here - up;
    const float norm = navfn_norm(dx, dy);
    if (norm > 0) {
        const float scale = (float)(1.0 / norm);
        *x = scale * dx;
        *y = scale * dy;
    }
}

static inline float navfn_between(float first, float second, float share)
{
    return (float)((1.0 - share) * first + share * second);
}

enum { NAVFN_FOUND, NAVFN_LEFT_MAP, NAVFN_LEFT_REACHED, NAVFN_NO_GRADIENT, NAVFN_NO_TURNS };

/* Trace the path from a cell to the start; return the number of its points, and the outcome.
 * `path` has room for one point, x and y in cells, for each turn. */
static int64_t navfn_trace(
    const float *potential, int64_t width, int64_t height, int64_t start_x, int64_t start_y,
    int64_t cell, int64_t turns, float *path, int *outcome)
{
    const NavfnField field = {potential, width, width * height};
    float dx = 0.0f, dy = 0.0f;
    int64_t count = 0;
    for (int64_t turn = 0; turn < turns; turn++) {
        int64_t nearest = cell + (int64_t)roundf(dx) + width * (int64_t)roundf(dy);
        nearest = nearest < 0 ? 0 : nearest > field.size - 1 ? field.size - 1 : nearest;
        float *point = path + 2 * count;
        if (potential[nearest] < NAVFN_NEUTRAL) {
            point[0] = (float)start_x;
            point[1] = (float)start_y;
            *outcome = NAVFN_FOUND;
            return count + 1;
        }
        if (cell < width || cell > field.size - width) {
            *outcome = NAVFN_LEFT_MAP;
            return count;
        }
        point[0] = (float)(cell % width) + dx;
        point[1] = (float)(cell / width) + dy;
        count++;
        const int64_t around[8] = {
            cell - width - 1, cell - width, cell - width + 1, cell - 1,
            cell + 1, cell + width - 1, cell + width, cell + width + 1,
        };
        int is_lowest_next = count > 2 && point[0] == point[-4] && point[1] == point[-3];
        is_lowest_next = is_lowest_next || potential[cell] >= NAVFN_UNREACHED;
        for (int k = 0; k < 8 && !is_lowest_next; k++)
            is_lowest_next = navfn_at(&field, around[k]) >= NAVFN_UNREACHED;
        if (is_lowest_next) {
            int lowest = navfn_truncated(potential[cell]);
            for (int k = 0; k < 8; k++) {
                const float beside = navfn_at(&field, around[k]);
                if (beside < (float)lowest) {
                    lowest = navfn_truncated(beside);
                    cell = around[k];
                }
            }
            dx = dy = 0.0f;
            if (navfn_at(&field, cell) >= NAVFN_UNREACHED) {
                *outcome = NAVFN_LEFT_REACHED;
                return count;
            }
            continue;
        }
        float x[4], y[4];
        const int64_t corners[4] = {cell, cell + 1, cell + width, cell + width + 1};
        for (int k = 0; k < 4; k++) navfn_gradient(&field, corners[k], &x[k], &y[k]);
        const float along_x = navfn_between(
            navfn_between(x[0], x[1], dx), navfn_between(x[2], x[3], dx), dy);
        const float along_y = navfn_between(
            navfn_between(y[0], y[1], dx), navfn_between(y[2], y[3], dx), dy);
        if (along_x == 0.0f && along_y == 0.0f) {
            *outcome = NAVFN_NO_GRADIENT;
            return count;
        }
        const float step = 0.5f / navfn_norm(along_x, along_y);
        dx += along_x * step;
        dy += along_y * step;
        if (dx > 1.0f) { cell++; dx -= 1.0f; }
        if (dx < -1.0f) { cell--; dx += 1.0f; }
        if (dy > 1.0f) { cell += width; dy -= 1.0f; }
        if (dy < -1.0f) { cell -= width; dy += 1.0f; }
    }
    *outcome = NAVFN_NO_TURNS;
    return count;
}
