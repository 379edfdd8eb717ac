/* Clearance trees: basins around the peaks of squared distances, and the widest ways between them.
 *
 * Cells are ordered by square and, where squares are equal, by flat index. Each open cell points to
 * the largest of its four neighbours that is larger than itself. Bands of rows, which stay in the
 * cache, are worked on alone: `point_band` follows the pointers up to a peak, or to where they leave
 * the band; `join_bands` follows those exits; `label_band` gives each cell the number of its basin.
 *
 * An edge between basins matters only where cells that came together before do not connect it
 * already: at saddles, which the eight neighbours of a cell tell. Of the larger straight neighbours
 * some hang together over larger corners; each group but that of the steepest one gives an edge,
 * from its last neighbour in reading order. Kruskal's algorithm takes the edges by falling order of
 * cells, so that of all edges, too, it would take the same.
 *
 * While pointers are followed, a cell of the result holds
 *     0                   if it is closed,
 *     n + 1               if it points to cell n and leaves its band there (an exit), or is not
 *                         followed yet,
 *     -1 - n              if its way through the band ends at cell n: a peak, or an exit,
 *     NUMBERED + number   if it is a peak, or is known to lead to it.
 * So there may be up to 2^30 cells. */

#ifndef MAPDEAL_CLEARANCE_TREE_H
#define MAPDEAL_CLEARANCE_TREE_H

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "lanes.h"

#define NUMBERED INT32_MIN
#define LEAST_END (-(1 << 30)) /* numbers are below, ends of ways are not */

enum { CLOSED = -1, UP = 0, LEFT = 1, RIGHT = 2, DOWN = 3 };

static const int64_t MOST_TREE_CELLS = (int64_t)1 << 30;

/* What was found in a band: its peaks as cells, rising, and its saddles as keys (see key_of),
 * rising by cell and direction. */
typedef struct {
    int32_t *peaks;
    uint64_t *saddles;
    int64_t peak_count, peak_space, saddle_count, saddle_space;
    int64_t first_number, first_saddle; /* among all bands */
} Band;

typedef struct {
    const int32_t *squared;
    const uint8_t *traversable;
    int64_t height, width, band_rows, bands;
    int32_t *basins; /* the result */
    Band *found;     /* of each band */
} Forest;

/* Which straight neighbours are connected to each: bits 0 .. 3 of the index are the larger straight
 * neighbours by direction, 4 .. 7 the larger corners up left, up right, down left, down right. */
static uint8_t connected_straights[256][4];

static void fill_connected_straights(void)
{
    static const uint8_t sides[4] = {1 << UP | 1 << LEFT, 1 << UP | 1 << RIGHT,
                                     1 << DOWN | 1 << LEFT, 1 << DOWN | 1 << RIGHT};
    for (int mask = 0; mask < 256; mask++) {
        for (int from = 0; from < 4; from++) {
            uint8_t reached = (uint8_t)(1 << from);
            for (int turn = 0; turn < 3; turn++)
                for (int corner = 0; corner < 4; corner++)
                    if (mask >> (4 + corner) & 1 && (mask & sides[corner]) == sides[corner] &&
                        reached & sides[corner])
                        reached |= sides[corner];
            connected_straights[mask][from] = reached;
        }
    }
}

static uint64_t key_of(int32_t square, int64_t cell, int direction)
{
    return (uint64_t)square << 32 | (uint64_t)cell << 2 | (uint64_t)direction;
}

static inline int64_t step_of(int direction, int64_t width)
{
    return direction == UP ? -width : direction == LEFT ? -1 : direction == RIGHT ? 1 : width;
}

static int64_t first_row(const Forest *forest, int64_t band) { return band * forest->band_rows; }

static int64_t row_beyond(const Forest *forest, int64_t band)
{
    const int64_t end = (band + 1) * forest->band_rows;
    return end < forest->height ? end : forest->height;
}

/* Fill `heights` with the squares of a row, CLOSED where no way may go, and at both ends. */
MANY_LANES static void fill_heights(const int32_t *squared, const uint8_t *traversable,
                                    int32_t *restrict heights, int64_t width)
{
    heights[0] = heights[width + 1] = CLOSED;
    for (int64_t x = 0; x < width; x++)
        heights[x + 1] = traversable[x] && squared[x] > 0 ? squared[x] : CLOSED;
}

static void fill_row(const Forest *forest, int64_t y, int32_t *heights)
{
    const int64_t width = forest->width;
    if (y < 0 || y >= forest->height)
        for (int64_t x = 0; x < width + 2; x++) heights[x] = CLOSED;
    else
        fill_heights(forest->squared + y * width, forest->traversable + y * width, heights, width);
}

/* Point the cells of a row, of which `base` is the first, and tell which are peaks or saddles. */
MANY_LANES static void point_row(const int32_t *up, const int32_t *here, const int32_t *down,
                                 int32_t base, int32_t width, int32_t *restrict towards,
                                 uint8_t *restrict is_critical)
{
    for (int32_t x = 0; x < width; x++) {
        const int32_t c = here[x + 1], u = up[x + 1], l = here[x], r = here[x + 2], d = down[x + 1];
        /* by rising index, so that of equal squares the last one wins */
        int32_t most = u, to = -width;
        to = l >= most ? -1 : to;
        most = l >= most ? l : most;
        to = c >= most ? 0 : to;
        most = c >= most ? c : most;
        to = r >= most ? 1 : to;
        most = r >= most ? r : most;
        to = d >= most ? width : to;
        const int32_t is_u = u > c, is_l = l > c, is_r = r >= c, is_d = d >= c;
        /* -1 - n of a peak, which nothing is larger than, else n + 1; without a branch */
        const int32_t sign = (is_u | is_l | is_r | is_d) - 1;
        towards[x] = c == CLOSED ? 0 : ((base + x + to) ^ sign) + 1 + sign;
        const int32_t groups = is_u + is_l + is_r + is_d - (is_u & is_l & (up[x] > c)) -
                               (is_u & is_r & (up[x + 2] > c)) - (is_d & is_l & (down[x] >= c)) -
                               (is_d & is_r & (down[x + 2] >= c));
        is_critical[x] = (uint8_t)(((groups > 1) | (sign != 0)) & (c != CLOSED));
    }
}

/* Make space for what so many critical cells may add: each is a peak, or has up to 3 edges. */
static int make_space(Band *band, int64_t cells)
{
    const int64_t peaks = band->peak_count + cells, saddles = band->saddle_count + 3 * cells;
    if (peaks > band->peak_space) {
        const int64_t space = peaks + peaks / 2;
        int32_t *larger = realloc(band->peaks, (size_t)space * sizeof(int32_t));
        if (larger == NULL) return 0;
        band->peaks = larger;
        band->peak_space = space;
    }
    if (saddles > band->saddle_space) {
        const int64_t space = saddles + saddles / 2;
        uint64_t *larger = realloc(band->saddles, (size_t)space * sizeof(uint64_t));
        if (larger == NULL) return 0;
        band->saddles = larger;
        band->saddle_space = space;
    }
    return 1;
}

/* Add the edges of the saddle at the middle of three rows. */
static void add_saddle(Band *band, const int32_t *up, const int32_t *here, const int32_t *down,
                       int64_t cell)
{
    const int32_t c = here[1], straight[4] = {up[1], here[0], here[2], down[1]};
    const unsigned mask = (unsigned)((straight[UP] > c) << UP | (straight[LEFT] > c) << LEFT |
                                     (straight[RIGHT] >= c) << RIGHT |
                                     (straight[DOWN] >= c) << DOWN | (up[0] > c) << 4 |
                                     (up[2] > c) << 5 | (down[0] >= c) << 6 | (down[2] >= c) << 7);
    int steepest = UP;
    for (int k = LEFT; k <= DOWN; k++)
        if (straight[k] >= straight[steepest]) steepest = k;
    unsigned left = mask & 15 & ~(unsigned)connected_straights[mask][steepest], last = 0;
    for (int k = DOWN; k >= UP; k--) {
        if (!(left >> k & 1)) continue;
        last |= 1u << k;
        left &= ~(unsigned)connected_straights[mask][k];
    }
    for (int k = UP; k <= DOWN; k++)
        if (last >> k & 1) band->saddles[band->saddle_count++] = key_of(c, cell, k);
}

/* Note the peaks and saddles of a row. */
static int note_critical(Band *band, const int32_t *up, const int32_t *here, const int32_t *down,
                         const int32_t *towards, const uint8_t *is_critical, int64_t base,
                         int64_t width)
{
    enum { TOGETHER = 256 };
    for (int64_t from = 0; from < width; from += TOGETHER) {
        const int64_t end = from + TOGETHER < width ? from + TOGETHER : width;
        int64_t count = 0;
        for (int64_t x = from; x < end; x++) count += is_critical[x];
        if (count == 0) continue;
        if (!make_space(band, count)) return 0;
        for (int64_t x = from; x < end; x++) {
            if (!is_critical[x]) continue;
            if (towards[x] < 0)
                band->peaks[band->peak_count++] = (int32_t)(base + x);
            else
                add_saddle(band, up + x, here + x, down + x, base + x);
        }
    }
    return 1;
}

/* Follow the pointers of a band, of the cells first .. end - 1; `p` are those of the whole grid. */
static void follow(int32_t *p, int32_t first, int32_t end)
{
    for (int32_t cell = first; cell < end; cell++) {
        int32_t last = cell, to;
        for (;;) {
            to = p[last] - 1;
            if (to < 0) break;                  /* a peak, or followed before */
            if (to < first || to >= end) break; /* an exit */
            last = to;
        }
        const int32_t way = p[last] < 0 ? p[last] : -1 - last;
        for (int32_t at = cell; at != last; at = to) {
            to = p[at] - 1;
            p[at] = way;
        }
    }
}

/* Point the cells of a band and follow them within it, and note its peaks and saddles; return 0
 * if there is no memory. */
static int point_band(const Forest *forest, int64_t number)
{
    const int64_t width = forest->width, space = width + 2;
    const int64_t bottom = first_row(forest, number), top = row_beyond(forest, number);
    Band *band = forest->found + number;
    int32_t *rows = malloc((size_t)(3 * space) * sizeof(int32_t));
    uint8_t *is_critical = malloc((size_t)width);
    int done = rows != NULL && is_critical != NULL;
    if (done) {
        int32_t *up = rows, *here = rows + space, *down = rows + 2 * space;
        fill_row(forest, bottom - 1, up);
        fill_row(forest, bottom, here);
        for (int64_t y = bottom; done && y < top; y++) {
            fill_row(forest, y + 1, down);
            int32_t *towards = forest->basins + y * width;
            point_row(up, here, down, (int32_t)(y * width), (int32_t)width, towards, is_critical);
            done = note_critical(band, up, here, down, towards, is_critical, y * width, width);
            int32_t *free_row = up;
            up = here;
            here = down;
            down = free_row;
        }
    }
    free(rows);
    free(is_critical);
    if (done) follow(forest->basins, (int32_t)(bottom * width), (int32_t)(top * width));
    return done;
}

/* Number the peaks of a band, and fill in what is known of them. */
static void number_band(const Forest *forest, int64_t number, int64_t *peaks, int64_t *peak_cells)
{
    const Band *band = forest->found + number;
    for (int64_t k = 0; k < band->peak_count; k++) {
        const int32_t cell = band->peaks[k];
        const int64_t basin = band->first_number + k;
        forest->basins[cell] = (int32_t)(NUMBERED + basin);
        peaks[basin] = forest->squared[cell];
        peak_cells[basin] = cell;
    }
}

/* Follow an exit over all bands, and write the basin into those that are met on the way. */
static void follow_exit(int32_t *p, int32_t cell)
{
    int32_t last = cell;
    while (p[last] >= LEAST_END) last = p[last] > 0 ? p[last] - 1 : -1 - p[last];
    const int32_t numbered = p[last];
    for (int32_t at = cell, next; at != last; at = next) {
        const int is_exit = p[at] > 0;
        next = is_exit ? p[at] - 1 : -1 - p[at];
        if (is_exit) p[at] = numbered;
    }
}

/* Follow the exits of a band, once the peaks of all bands are numbered; one band at a time. */
static void join_band(const Forest *forest, int64_t number)
{
    const int64_t width = forest->width;
    const int64_t bottom = first_row(forest, number), top = row_beyond(forest, number);
    for (int64_t turn = 0; turn < 2; turn++) {
        const int64_t base = (turn ? top - 1 : bottom) * width;
        for (int64_t cell = base; cell < base + width; cell++)
            if (forest->basins[cell] > 0) follow_exit(forest->basins, (int32_t)cell);
    }
}

/* Set `labels` to what the ends of ways hold. */
MANY_LANES static void look_up_ends(const int32_t *p, const int32_t *row, int32_t *restrict labels,
                                    int64_t width)
{
    for (int64_t x = 0; x < width; x++) {
        const int32_t held = row[x];
        labels[x] = held < 0 && held >= LEAST_END ? p[-1 - held] : held;
    }
}

MANY_LANES static void strip_numbers(int32_t *cells, int64_t count)
{
    for (int64_t k = 0; k < count; k++) cells[k] = cells[k] == 0 ? -1 : cells[k] - NUMBERED;
}

/* Label the cells of a band, once all exits are followed; return 0 if there is no memory. */
static int label_band(const Forest *forest, int64_t number)
{
    const int64_t width = forest->width;
    const int64_t bottom = first_row(forest, number), top = row_beyond(forest, number);
    int32_t *labels = malloc((size_t)width * sizeof(int32_t));
    if (labels == NULL) return 0;
    for (int64_t y = bottom; y < top; y++) {
        int32_t *row = forest->basins + y * width;
        look_up_ends(forest->basins, row, labels, width);
        memcpy(row, labels, (size_t)width * sizeof(int32_t));
    }
    free(labels);
    strip_numbers(forest->basins + bottom * width, (top - bottom) * width);
    return 1;
}

/* Move the saddles of a band to their places among all keys. */
static void take_saddles(const Forest *forest, int64_t number, uint64_t *keys)
{
    Band *band = forest->found + number;
    if (band->saddle_count > 0)
        memcpy(keys + band->first_saddle, band->saddles,
               (size_t)band->saddle_count * sizeof(uint64_t));
    free(band->saddles);
    band->saddles = NULL;
}

/* Radix sort of keys by falling square: stable, of keys that rise by cell at first, so that in the
 * end they fall. One digit of the square at a time; `shift` is where it begins. */
enum { DIGIT_BITS = 11, DIGITS = 1 << DIGIT_BITS };

static inline int digit_of(uint64_t key, int shift) { return (int)(key >> shift) & (DIGITS - 1); }

static void sort_by_digit(const uint64_t *keys, uint64_t *sorted, int64_t count, int shift,
                          int is_first)
{
    int64_t place[DIGITS] = {0}, before = 0;
    for (int64_t k = 0; k < count; k++) place[digit_of(keys[k], shift)]++;
    for (int digit = DIGITS - 1; digit >= 0; digit--) {
        const int64_t here = place[digit];
        place[digit] = before;
        before += here;
    }
    for (int64_t k = 0; k < count; k++) {
        const uint64_t key = keys[is_first ? count - 1 - k : k];
        sorted[place[digit_of(key, shift)]++] = key;
    }
}

/* A spanning forest by Kruskal's algorithm. */
typedef struct {
    const int32_t *basins;
    int64_t width;
    const uint64_t *keys;
    int32_t *sets; /* of each basin one of the same set that is not larger, or itself */
    int32_t *one, *other;
    int64_t *squares, *cells;
    int64_t kept; /* edges so far */
} Spanning;

static inline int32_t set_of(int32_t *sets, int32_t basin)
{
    while (sets[basin] != basin) {
        sets[basin] = sets[sets[basin]];
        basin = sets[basin];
    }
    return basin;
}

static inline int64_t cell_of(uint64_t key)
{
    return (int64_t)(key >> 2 & (((uint64_t)1 << 30) - 1));
}

static inline void span_edge(Spanning *spanning, uint64_t key, int32_t one, int32_t other)
{
    const int32_t first = set_of(spanning->sets, one), second = set_of(spanning->sets, other);
    if (first == second) return;
    if (first < second)
        spanning->sets[second] = first;
    else
        spanning->sets[first] = second;
    spanning->one[spanning->kept] = one;
    spanning->other[spanning->kept] = other;
    spanning->squares[spanning->kept] = (int64_t)(key >> 32);
    spanning->cells[spanning->kept] = cell_of(key);
    spanning->kept++;
}

static void span(Spanning *spanning, int64_t first, int64_t end)
{
    enum { TOGETHER = 64 }; /* look-ups that do not wait for each other */
    int32_t one[TOGETHER], other[TOGETHER];
    for (int64_t from = first; from < end; from += TOGETHER) {
        const uint64_t *keys = spanning->keys + from;
        const int64_t count = end - from < TOGETHER ? end - from : TOGETHER;
        for (int64_t k = 0; k < count; k++) {
            const int32_t *basin = spanning->basins + cell_of(keys[k]);
            one[k] = *basin;
            other[k] = basin[step_of((int)(keys[k] & 3), spanning->width)];
        }
        for (int64_t k = 0; k < count; k++)
            if (one[k] != other[k]) span_edge(spanning, keys[k], one[k], other[k]);
    }
}

/* A tree seen from one of its basins. */
typedef struct {
    const int32_t *one, *other;
    const int64_t *squares;
    int64_t basins, edges;
    int32_t *begins; /* where each basin's entries begin, and where the last ones end */
    int32_t *ends;   /* the edges of each basin, rising */
    int32_t *order, *parent_edges;
    int64_t *bottlenecks;
    int64_t found, done; /* basins in `order`, and how many of them have been left */
} Rooted;

static void list_edges_of_basins(Rooted *rooted)
{
    int32_t *begins = rooted->begins;
    memset(begins, 0, (size_t)(rooted->basins + 1) * sizeof(int32_t));
    for (int64_t k = 0; k < rooted->edges; k++) {
        begins[rooted->one[k]]++;
        begins[rooted->other[k]]++;
    }
    int32_t total = 0;
    for (int64_t basin = 0; basin <= rooted->basins; basin++) {
        total += begins[basin];
        begins[basin] = total;
    }
    /* backwards, so that each begin ends up where it belongs */
    for (int64_t k = rooted->edges - 1; k >= 0; k--) {
        rooted->ends[--begins[rooted->one[k]]] = (int32_t)k;
        rooted->ends[--begins[rooted->other[k]]] = (int32_t)k;
    }
}

/* Go on breadth first, over `most` basins at most. */
static void root_on(Rooted *rooted, int64_t most)
{
    for (; rooted->done < rooted->found && most > 0; rooted->done++, most--) {
        const int32_t basin = rooted->order[rooted->done];
        const int64_t bottleneck = rooted->bottlenecks[basin];
        for (int32_t k = rooted->begins[basin]; k < rooted->begins[basin + 1]; k++) {
            const int32_t edge = rooted->ends[k];
            const int32_t child = rooted->one[edge] ^ rooted->other[edge] ^ basin;
            if (edge == rooted->parent_edges[basin]) continue;
            const int64_t square = rooted->squares[edge];
            rooted->bottlenecks[child] = square < bottleneck ? square : bottleneck;
            rooted->parent_edges[child] = edge;
            rooted->order[rooted->found++] = child;
        }
    }
}

/* Metres of a square, as in the twin: one rounding at the end. */
static inline float metres_of_square(int32_t square, double resolution)
{
    return square == INT32_MAX ? INFINITY : (float)(sqrt((double)square) * resolution);
}

enum { PAINTED = 512 }; /* cells that are painted together, so that the result may lie over them */

MANY_LANES static void metres_of_some(const int32_t *squared, double resolution,
                                      float *restrict metres, int64_t count)
{
    for (int64_t k = 0; k < count; k++) metres[k] = metres_of_square(squared[k], resolution);
}

/* The lesser of each cell's metres and the limit of its basin; limits begin with that of -1. */
MANY_LANES static void limit_some(const int32_t *basins, const float *limits, float *restrict metres,
                                  int64_t count)
{
    for (int64_t k = 0; k < count; k++) {
        const float limit = limits[basins[k] + 1];
        metres[k] = metres[k] < limit ? metres[k] : limit;
    }
}

/* Paint metres of squares, or, if there are basins, the lesser of them and their basins' limits.
 * `painted` may be the memory of the squares or of the basins. */
static void paint_metres(const int32_t *squared, const int32_t *basins, const float *limits,
                         double resolution, char *painted, int64_t count)
{
    float metres[PAINTED];
    for (int64_t from = 0; from < count; from += PAINTED) {
        const int64_t some = count - from < PAINTED ? count - from : PAINTED;
        metres_of_some(squared + from, resolution, metres, some);
        if (basins != NULL) limit_some(basins + from, limits, metres, some);
        memcpy(painted + from * (int64_t)sizeof(float), metres, (size_t)some * sizeof(float));
    }
}

MANY_LANES static void limit_squares(const int32_t *squared, const int32_t *basins,
                                     const int32_t *limits, int32_t *restrict widest, int64_t count)
{
    for (int64_t k = 0; k < count; k++) {
        const int32_t limit = limits[basins[k] + 1];
        widest[k] = squared[k] < limit ? squared[k] : limit;
    }
}

/* Add to the counts, the first of which is of -1, the cells of each basin whose square is above. */
static void count_cells_above(const int32_t *squared, const int32_t *basins, int32_t above,
                              int64_t count, int32_t *counts)
{
    int32_t basin = -1, run = 0;
    for (int64_t k = 0; k < count; k++) {
        if (basins[k] != basin) {
            counts[basin + 1] += run;
            basin = basins[k];
            run = 0;
        }
        run += squared[k] > above;
    }
    counts[basin + 1] += run;
}

#endif
