/* Searches of Nav2's Smac and Theta* planners; kernels/searches.py has the rules. */

#include <math.h>
#include <stdint.h>
#include <stdlib.h>

typedef struct {
    double key;
    int64_t node;
} Entry;

/* Binary heap that exchanges entries in the order of C++'s std::priority_queue, as the order of
 * equal keys decides between paths of equal cost. */
typedef struct {
    Entry *entries;
    int64_t count, room;
    const double *live_keys; /* of nodes, where these change while they wait; else NULL */
} Queue;

static inline double key_of(const Queue *queue, const Entry *entry)
{
    return queue->live_keys != NULL ? queue->live_keys[entry->node] : entry->key;
}

static void queue_sift_up(Queue *queue, int64_t place, Entry added)
{
    const double key = key_of(queue, &added);
    while (place > 0 && key_of(queue, &queue->entries[(place - 1) / 2]) > key) {
        queue->entries[place] = queue->entries[(place - 1) / 2];
        place = (place - 1) / 2;
    }
    queue->entries[place] = added;
}

static int queue_push(Queue *queue, double key, int64_t node)
{
    if (queue->count == queue->room) {
        const int64_t room = queue->room ? 2 * queue->room : 1024;
        Entry *entries = realloc(queue->entries, (size_t)room * sizeof(Entry));
        if (entries == NULL) return 0;
        queue->entries = entries;
        queue->room = room;
    }
    queue_sift_up(queue, queue->count++, (Entry){key, node});
    return 1;
}

static Entry queue_pop(Queue *queue)
{
    const Entry first = queue->entries[0], moved = queue->entries[--queue->count];
    int64_t place = 0, child;
    while ((child = 2 * place + 1) < queue->count) {
        if (child + 1 < queue->count && !(key_of(queue, &queue->entries[child]) <
                                          key_of(queue, &queue->entries[child + 1])))
            child++;
        queue->entries[place] = queue->entries[child];
        place = child;
    }
    if (queue->count) queue_sift_up(queue, place, moved);
    return first;
}

enum { NO_PATH = -1, NO_MEMORY = -2, CAME_BY = 15, IS_VISITED = 16 };

/* dx, dy; the order in which Smac 2D offers neighbours */
static const int GRID_STEPS[8][2] = {{-1, 0},  {1, 0},  {0, -1}, {0, 1},
                                     {-1, -1}, {1, -1}, {-1, 1}, {1, 1}};

typedef struct {
    const uint8_t *costs;
    const float *step_costs; /* [straight, diagonal][cost of the entered cell] */
    int64_t width, height, start, goal;
    float goal_x, goal_y, tolerance;
    int64_t most_iterations, most_near_goal, iterations;
    uint8_t *moves; /* CAME_BY: number of the step to a cell, from 1; IS_VISITED */
    float *reached;
} GridSearch;

/* Return the last cell of the path. */
static int64_t search_grid(GridSearch *search)
{
    Queue open = {NULL, 0, 0, NULL};
    int64_t end = NO_PATH, near_goal = 0, nearest = search->start;
    float least = INFINITY;
    search->iterations = 0;
    search->reached[search->start] = 0;
    if (!queue_push(&open, 0, search->start)) return NO_MEMORY;
    while (search->iterations < search->most_iterations && open.count) {
        const int64_t cell = queue_pop(&open).node, x = cell % search->width;
        if (search->moves[cell] & IS_VISITED) continue;
        search->iterations++;
        search->moves[cell] |= IS_VISITED;
        if (cell == search->goal) {
            end = cell;
            break;
        }
        if (least < search->tolerance && ++near_goal >= search->most_near_goal) break;
        for (int step = 0; step < 8; step++) {
            const int64_t to_x = x + GRID_STEPS[step][0];
            const int64_t next = cell + GRID_STEPS[step][1] * search->width + GRID_STEPS[step][0];
            if (to_x < 0 || to_x >= search->width || next < 0 ||
                next >= search->width * search->height || search->moves[next] & IS_VISITED)
                continue;
            const float cost = search->step_costs[256 * (step >= 4) + search->costs[next]];
            const float reached = search->reached[cell] + cost;
            if (cost == INFINITY || (search->moves[next] && reached >= search->reached[next]))
                continue;
            search->reached[next] = reached;
            search->moves[next] = (uint8_t)(step + 1);
            const float dx = search->goal_x - (float)to_x;
            const float dy = search->goal_y - (float)(next / search->width);
            const float distance = sqrtf(dx * dx + dy * dy);
            if (distance < least) {
                least = distance;
                nearest = next;
            }
            if (!queue_push(&open, reached + distance, next)) {
                free(open.entries);
                return NO_MEMORY;
            }
        }
    }
    free(open.entries);
    return end == NO_PATH && least < search->tolerance ? nearest : end;
}

/* Move the inner points of a path once; return the sum of their moves. */
static double smooth_once(const double *raw, double *path, int64_t count, double data_weight,
                          double smooth_weight)
{
    double change = 0;
    for (int64_t i = 2; i < 2 * count - 2; i++) {
        const double before = path[i];
        path[i] = before + (data_weight * (raw[i] - before) +
                            smooth_weight * (path[i + 2] + path[i - 2] - 2.0 * before));
        change += fabs(path[i] - before);
    }
    return change;
}

/* dx, dy; the order in which Theta* offers neighbours */
static const int THETA_STEPS[8][2] = {{0, 1},  {0, -1}, {1, 0}, {-1, 0},
                                      {1, -1}, {-1, 1}, {1, 1}, {-1, -1}};

typedef struct {
    const uint8_t *costs;
    const double *step_costs, *sight_costs; /* of a cost; infinite if it is closed */
    int64_t width, height, start, goal;
    int corners;
    double distance_weight, heuristic_weight;
    int64_t *parents; /* the parent's cell + 1; 0 if a cell was not reached */
    double *reached, *estimates;
    uint8_t *is_waiting;
} ThetaSearch;

static inline double theta_distance(const ThetaSearch *search, int64_t a, int64_t b)
{
    const double dx = (double)(a % search->width - b % search->width);
    const double dy = (double)(a / search->width - b / search->width);
    return sqrt(dx * dx + dy * dy);
}

/* Return the costs on the line from a cell to just before another; infinite if it is blocked. */
static double theta_sight(const ThetaSearch *search, int64_t from, int64_t to)
{
    const int64_t width = search->width;
    const int64_t dx = llabs(to % width - from % width), dy = llabs(to / width - from / width);
    const int64_t right = from % width < to % width ? 1 : -1;
    const int64_t up = from / width < to / width ? width : -width;
    int64_t cell = from, error = dx - dy;
    double sum = 0;
    while (cell != to) {
        const double cost = search->sight_costs[search->costs[cell]];
        if (cost == INFINITY) return INFINITY;
        sum += cost;
        const int is_across = 2 * error > -dy, is_along = 2 * error <= dx;
        if (is_across && is_along &&
            (search->step_costs[search->costs[cell + right]] == INFINITY ||
             search->step_costs[search->costs[cell + up]] == INFINITY))
            return INFINITY;
        if (is_across) error -= dy;
        if (is_along || !is_across) error += dx;
        cell += (is_across ? right : 0) + (is_along || !is_across ? up : 0);
    }
    return sum;
}

/* Return the goal if there is a path. */
static int64_t search_theta(ThetaSearch *search)
{
    Queue open = {NULL, 0, 0, search->estimates};
    int64_t cell = search->start;
    search->parents[cell] = cell + 1;
    search->reached[cell] = search->step_costs[search->costs[cell]];
    search->estimates[cell] = search->reached[cell] +
                              search->heuristic_weight * theta_distance(search, cell, search->goal);
    search->is_waiting[cell] = 1;
    if (!queue_push(&open, 0, cell)) return NO_MEMORY;
    while (open.count && cell != search->goal) {
        const int64_t ancestor = search->parents[search->parents[cell] - 1] - 1;
        search->is_waiting[cell] = 0;
        const double sight = theta_sight(search, cell, ancestor);
        const double direct = search->reached[ancestor] +
                              search->distance_weight * theta_distance(search, cell, ancestor) +
                              sight;
        if (direct < search->reached[cell]) {
            search->parents[cell] = ancestor + 1;
            search->reached[cell] = direct;
            search->estimates[cell] =
                direct + search->heuristic_weight * theta_distance(search, cell, search->goal);
        }
        for (int step = 0; step < search->corners; step++) {
            const int64_t to_x = cell % search->width + THETA_STEPS[step][0];
            const int64_t to_y = cell / search->width + THETA_STEPS[step][1];
            const int64_t next = to_y * search->width + to_x;
            if (to_x < 0 || to_x >= search->width || to_y < 0 || to_y >= search->height) continue;
            const double cost = search->step_costs[search->costs[next]];
            if (cost == INFINITY) continue;
            const double reached = search->reached[cell] +
                                   search->distance_weight * theta_distance(search, cell, next) +
                                   cost;
            const double estimate =
                reached + search->heuristic_weight * theta_distance(search, next, search->goal);
            if (search->parents[next] && search->estimates[next] <= estimate) continue;
            search->reached[next] = reached;
            search->estimates[next] = estimate;
            search->parents[next] = cell + 1;
            if (search->is_waiting[next]) continue;
            search->is_waiting[next] = 1;
            if (!queue_push(&open, 0, next)) {
                free(open.entries);
                return NO_MEMORY;
            }
        }
        cell = queue_pop(&open).node;
    }
    free(open.entries);
    return open.count ? cell : NO_PATH;
}
