/* The cheapest path over the eight neighbours of cells: A*. paths.py has the rules. */

#include <stdint.h>
#include <stdlib.h>

typedef struct {
    double estimate;     /* cost from the start through the cell to the goal, at least */
    uint64_t turn;       /* counts down: of equal estimates the latest comes first */
    int64_t cell;
} Candidate;

typedef struct {
    const double *weights; /* of a straight step into each cell; not above 0 if closed */
    int64_t height, width, start, goal;
    double least, least_diagonal; /* of the weights of open cells, see `estimate_to_goal` */
    const double *surcharges; /* of each cell, on top of its estimate; NULL if there are none */
    double *costs;         /* from the start, infinite where no path is known yet */
    int8_t *steps;         /* the last step of that path, an index of STEPS; 0 at first */
    Candidate *heap;
    int64_t waiting, room;
    uint64_t turn;
    int64_t expanded;
} Search;

enum { SEARCH_GOES_ON, SEARCH_FOUND, SEARCH_IN_VAIN, SEARCH_OUT_OF_MEMORY };

enum { STEP = 7, CLOSED = 8 }; /* of `steps`: which step it was, and whether that is final */

static const double ROOT_OF_2 = 1.4142135623730951;
static const int STEPS[8][2] = {{-1, -1}, {-1, 0}, {-1, 1}, {0, -1},
                                {0, 1},   {1, -1}, {1, 0},  {1, 1}};

/* Whole numbers below 2^52 are what weights are, and their diagonals are rounded to such, so that
 * sums are exact and equal paths have equal costs. */
static inline double diagonal_of(double weight)
{
    return (weight * ROOT_OF_2 + 0x1p52) - 0x1p52;
}

/* `surcharges` are those of the search, or NULL. It is an argument so that the code of a search
 * without them, which is the usual one, does not ask for them at each cell. */
static inline double estimate_to_goal(const Search *search, int64_t cell, const double *surcharges)
{
    const int64_t rows = llabs(cell / search->width - search->goal / search->width);
    const int64_t cols = llabs(cell % search->width - search->goal % search->width);
    const int64_t diagonal = rows < cols ? rows : cols;
    const int64_t straight = rows + cols - 2 * diagonal;
    const double octile = search->least * (double)straight + search->least_diagonal * (double)diagonal;
    return surcharges == NULL ? octile : octile + surcharges[cell];
}

static inline int comes_first(const Candidate *one, const Candidate *other)
{
    if (one->estimate != other->estimate) return one->estimate < other->estimate;
    return one->turn < other->turn;
}

/* The heap has four branches at each fork: its levels are few, and siblings share a cache line. */
static int add_candidate(Search *search, double estimate, int64_t cell)
{
    if (search->waiting == search->room) {
        const int64_t room = search->room ? 2 * search->room : 1024;
        Candidate *heap = realloc(search->heap, (size_t)room * sizeof(Candidate));
        if (heap == NULL) return 0;
        search->heap = heap;
        search->room = room;
    }
    const Candidate added = {estimate, --search->turn, cell};
    int64_t place = search->waiting++;
    while (place > 0) {
        const int64_t parent = (place - 1) / 4;
        if (!comes_first(&added, &search->heap[parent])) break;
        search->heap[place] = search->heap[parent];
        place = parent;
    }
    search->heap[place] = added;
    return 1;
}

static Candidate take_first(Search *search)
{
    const Candidate first = search->heap[0];
    const Candidate moved = search->heap[--search->waiting];
    int64_t place = 0;
    for (;;) {
        const int64_t child = 4 * place + 1;
        if (child >= search->waiting) break;
        const int64_t end = child + 4 < search->waiting ? child + 4 : search->waiting;
        int64_t best = child;
        for (int64_t other = child + 1; other < end; other++)
            if (comes_first(&search->heap[other], &search->heap[best])) best = other;
        if (!comes_first(&search->heap[best], &moved)) break;
        search->heap[place] = search->heap[best];
        place = best;
    }
    search->heap[place] = moved;
    return first;
}

static inline int expand(Search *search, int64_t cell, const double *surcharges)
{
    const int64_t width = search->width;
    const int64_t row = cell / width, col = cell % width;
    const double cost = search->costs[cell];
    for (int step = 0; step < 8; step++) {
        const int rows = STEPS[step][0], cols = STEPS[step][1];
        if (row + rows < 0 || row + rows >= search->height || col + cols < 0 || col + cols >= width)
            continue;
        const int64_t next = cell + rows * width + cols;
        const double weight = search->weights[next];
        if (!(weight > 0)) continue;
        const int diagonal = rows != 0 && cols != 0;
        if (diagonal && !(search->weights[cell + rows * width] > 0) &&
            !(search->weights[cell + cols] > 0))
            continue; /* between two closed cells that touch there is no way */
        const double total = cost + (diagonal ? diagonal_of(weight) : weight);
        if (!(total < search->costs[next])) continue;
        if (surcharges != NULL && search->steps[next] & CLOSED) continue;
        search->costs[next] = total;
        search->steps[next] = (int8_t)step;
        const double estimate = total + estimate_to_goal(search, next, surcharges);
        if (!add_candidate(search, estimate, next)) return 0;
    }
    return 1;
}

static int begin_search(Search *search)
{
    search->costs[search->start] = 0;
    const double estimate = estimate_to_goal(search, search->start, search->surcharges);
    return add_candidate(search, estimate, search->start);
}

static inline int look_on(Search *search, int64_t most, const double *surcharges)
{
    while (most-- > 0) {
        if (search->waiting == 0) return SEARCH_IN_VAIN;
        const Candidate first = take_first(search);
        if (first.cell == search->goal) return SEARCH_FOUND;
        /* a cheaper path to it was found meanwhile, and followed */
        if (first.estimate >
            search->costs[first.cell] + estimate_to_goal(search, first.cell, surcharges))
            continue;
        search->expanded++;
        if (surcharges != NULL) search->steps[first.cell] |= CLOSED;
        if (!expand(search, first.cell, surcharges)) return SEARCH_OUT_OF_MEMORY;
    }
    return SEARCH_GOES_ON;
}

/* Look at so many candidates, and tell how things stand. */
static int search_on(Search *search, int64_t most)
{
    return search->surcharges == NULL ? look_on(search, most, NULL)
                                      : look_on(search, most, search->surcharges);
}

/* The cell that the known path comes from. */
static int64_t cell_before(const Search *search, int64_t cell)
{
    const int *step = STEPS[search->steps[cell] & STEP];
    return cell - step[0] * search->width - step[1];
}
