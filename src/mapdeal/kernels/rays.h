/* Rays from cell to cell, and what they leave in the cells that they pass. sensing.py has the rules.

   A line has n + 1 cells, n the larger difference of its ends. After i steps the other coordinate
   has moved (n / 2 + i * minor) / n times: costmap_2d's line. */

#include <math.h>
#include <stdint.h>

typedef struct {
    int64_t first, last;        /* the steps within the part; none if last < first */
    int64_t at;                 /* the cell of the first step, as an index */
    int64_t step, turn;         /* what is added to it with each step, and with each move */
    int64_t error, minor, n;
} Line;

typedef struct {
    int64_t bottom, top, width; /* rows bottom .. top - 1 of a grid */
} Part;

static int64_t least_of(int64_t a, int64_t b) { return a < b ? a : b; }
static int64_t most_of(int64_t a, int64_t b) { return a > b ? a : b; }

/* a / b rounded up, for b > 0 */
static int64_t ceiling(int64_t a, int64_t b) { return a > 0 ? (a + b - 1) / b : -(-a / b); }

/* Steps i for which start + sign * i lies in low .. high. */
static void within(int64_t start, int64_t sign, int64_t low, int64_t high,
                   int64_t *first, int64_t *last)
{
    *first = sign > 0 ? low - start : start - high;
    *last = sign > 0 ? high - start : start - low;
}

/* The part of a line from start to end, in steps 0 .. last, that lies in a part of a grid. */
static Line line_in(const Part *part, const int64_t *start, const int64_t *end, int with_end)
{
    Line line = {0, -1, 0, 0, 0, 0, 0, 1};
    const int64_t high_row = part->top - 1, high_col = part->width - 1;
    if (most_of(start[0], end[0]) < part->bottom || least_of(start[0], end[0]) > high_row ||
        most_of(start[1], end[1]) < 0 || least_of(start[1], end[1]) > high_col)
        return line;
    const int64_t down = end[0] < start[0] ? -1 : 1, left = end[1] < start[1] ? -1 : 1;
    const int64_t across = (end[0] - start[0]) * down, along = (end[1] - start[1]) * left;
    const int by_rows = across >= along;
    const int64_t n = most_of(by_rows ? across : along, 1), minor = by_rows ? along : across;
    int64_t first, last, few, many;
    line.last = (by_rows ? across : along) - !with_end;
    if (by_rows) {
        within(start[0], down, part->bottom, high_row, &first, &last);
        within(start[1], left, 0, high_col, &few, &many);
    } else {
        within(start[1], left, 0, high_col, &first, &last);
        within(start[0], down, part->bottom, high_row, &few, &many);
    }
    line.first = most_of(first, 0);
    line.last = least_of(line.last, last);
    if (minor == 0) {
        if (few > 0 || many < 0) line.last = -1;
    } else {
        line.first = most_of(line.first, ceiling(few * n - n / 2, minor));
        line.last = least_of(line.last, ceiling((many + 1) * n - n / 2, minor) - 1);
    }
    if (line.last < line.first) return line;
    const int64_t sum = n / 2 + line.first * minor, moved = sum / n;
    const int64_t row = start[0] + down * (by_rows ? line.first : moved);
    const int64_t col = start[1] + left * (by_rows ? moved : line.first);
    line.at = row * part->width + col;
    line.step = by_rows ? down * part->width : left;
    line.turn = by_rows ? left : down * part->width;
    line.error = sum - moved * n;
    line.minor = minor;
    line.n = n;
    return line;
}

static int holds(const Part *part, const int64_t *cell)
{
    return cell[0] >= part->bottom && cell[0] < part->top && cell[1] >= 0 && cell[1] < part->width;
}

/* Go to the next cell: one step, and a move if it is due. */
#define NEXT(line, at, error)                                        \
    do {                                                             \
        (error) += (line).minor;                                     \
        const int64_t due = -(int64_t)((error) >= (line).n);         \
        (error) -= due & (line).n;                                   \
        (at) += (line).step + (due & (line).turn);                   \
    } while (0)

/* Steps up to which moves are counted in fractions of 2^32: what rounding adds to one with each step
   is less than 2^-32, in all less than 1 / n, by which the sum is short of the next move at least. */
#define MOST_IN_FRACTIONS 65535

/* Count a beam in each cell of a line. No step waits for the one before, as it does by `NEXT`. */
static void count_line(const Line *line, int32_t *counts)
{
    int64_t left = line->last - line->first + 1, at = line->at, error = line->error;
    if (line->n <= MOST_IN_FRACTIONS) {
        const uint64_t n = (uint64_t)line->n;
        const uint64_t each = (((uint64_t)line->minor << 32) + n - 1) / n;
        uint64_t moves = (((uint64_t)error << 32) + n - 1) / n;
        for (; left > 0; left--) {
            counts[at + (int64_t)(moves >> 32) * line->turn]++;
            moves += each;
            at += line->step;
        }
        return;
    }
    for (; left > 0; left--) {
        counts[at]++;
        NEXT(*line, at, error);
    }
}

static void count_in(const Part *part, const int64_t *starts, const int64_t *ends,
                     const uint8_t *is_hit, int64_t beams, int32_t *hits, int32_t *misses)
{
    for (int64_t k = 0; k < beams; k++) {
        const int64_t *start = starts + 2 * k, *end = ends + 2 * k;
        const Line line = line_in(part, start, end, 0);
        count_line(&line, misses);
        if (is_hit[k] && holds(part, end)) hits[end[0] * part->width + end[1]]++;
    }
}

typedef struct {
    int32_t on_miss, on_hit, lowest, highest;
} Odds;

static int32_t clamped(const Odds *odds, int32_t value)
{
    value = value < odds->lowest ? odds->lowest : value;
    return value > odds->highest ? odds->highest : value;
}

/* What `seen` is made of; hits are counted up to a few. */
enum { SEEN = 1, A_HIT = 2, MOST_HITS = 3 };

static void weigh_in(const Part *part, const int64_t *starts, const int64_t *ends,
                     const uint8_t *is_hit, int64_t beams, const Odds *odds, int32_t *values,
                     uint8_t *seen)
{
    for (int64_t k = 0; k < beams; k++) {
        const int64_t *start = starts + 2 * k, *end = ends + 2 * k;
        const Line line = line_in(part, start, end, 0);
        int64_t at = line.at, error = line.error;
        for (int64_t i = line.first; i <= line.last; i++) {
            values[at] = clamped(odds, values[at] + odds->on_miss);
            seen[at] |= SEEN;
            NEXT(line, at, error);
        }
        if (is_hit[k] && holds(part, end)) {
            at = end[0] * part->width + end[1];
            values[at] = clamped(odds, values[at] + odds->on_hit);
            seen[at] = (uint8_t)(least_of(seen[at] + A_HIT, MOST_HITS * A_HIT + SEEN) | SEEN);
        }
    }
}

#define DISTANCE_UNIT 1048576.0 /* what a signed distance of one truncation is */

/* With `means`, they are kept, one beam after the other, instead of sums, and ends do not count. */
static void measure_in(const Part *part, const int64_t *starts, const int64_t *ends,
                       const double *sensors, const double *ranges, int64_t beams,
                       double truncation, double behind, double cell, int64_t *sums,
                       double *means, int32_t *weights)
{
    for (int64_t k = 0; k < beams; k++) {
        const int64_t *start = starts + 2 * k, *end = ends + 2 * k;
        const Line line = line_in(part, start, end, means == NULL);
        int64_t at = line.at, error = line.error;
        for (int64_t i = line.first; i <= line.last; i++) {
            const double y = (double)(at / part->width) + 0.5 - sensors[2 * k];
            const double x = (double)(at % part->width) + 0.5 - sensors[2 * k + 1];
            const double distance = (ranges[k] - sqrt(y * y + x * x) * cell) / truncation;
            if (distance >= -behind) {
                const double least = distance < -1.0 ? -1.0 : distance;
                const double share = least > 1.0 ? 1.0 : least;
                if (means != NULL)
                    means[at] = (weights[at] * means[at] + share) / (weights[at] + 1);
                else
                    sums[at] += (int64_t)(share * DISTANCE_UNIT + (DISTANCE_UNIT + 0.5)) -
                                (int64_t)DISTANCE_UNIT;
                weights[at]++;
            }
            NEXT(line, at, error);
        }
    }
}

/* The cells of a grid, as frame.py has them: a corner, and the cosine and sine of what turns points
   of the map frame into its axes. */
typedef struct {
    double x, y, cosine, sine, resolution;
    double rounding, tolerance; /* relative to coordinates; of a cell, at least */
    double farthest;
} Lattice;

static double larger_of(double a, double b) { return a > b ? a : b; }

static int64_t floor_of(double value)
{
    const int64_t cut = (int64_t)value;
    return cut - ((double)cut > value);
}

/* Row and column of each point, within the grid or not; 0 if one is too far away, or not finite. */
static int cells_of_points(const Lattice *lattice, const double *points, int64_t count,
                           int64_t *cells)
{
    const double corner = larger_of(fabs(lattice->x), fabs(lattice->y));
    for (int64_t k = 0; k < count; k++) {
        const double x = points[2 * k], y = points[2 * k + 1];
        if (!(fabs(x) <= lattice->farthest && fabs(y) <= lattice->farthest)) return 0;
        const double dx = x - lattice->x, dy = y - lattice->y;
        const double along = (dx * lattice->cosine - dy * lattice->sine) / lattice->resolution;
        const double across = (dx * lattice->sine + dy * lattice->cosine) / lattice->resolution;
        const double largest = larger_of(larger_of(fabs(x), fabs(y)), corner);
        const double off = larger_of(lattice->rounding * largest / lattice->resolution,
                                     lattice->tolerance);
        cells[2 * k] = floor_of(across + off);
        cells[2 * k + 1] = floor_of(along + off);
    }
    return 1;
}

/* `room` of a cell: 0 in obstacles, 1 where a ray ends without a hit, else at least 2; from all places
   in such a cell, the next cell of another kind is more than room - 2 cells away. */
enum { OBSTACLE = 0, OPAQUE = 1, ROOM = 2 };

/* The distance along each ray from its start to the obstacle that it enters first, in cells; infinite
   if it enters none within the limit. Starts and directions of length 1 are y and x, in cells. */
static void cast_in(const uint8_t *room, int64_t height, int64_t width, const double *starts,
                    const double *directions, int64_t scans, int64_t beams, double limit,
                    double *distances)
{
    for (int64_t k = 0; k < scans * beams; k++) {
        const double y = starts[k / beams * 2], x = starts[k / beams * 2 + 1];
        const double dy = directions[2 * k], dx = directions[2 * k + 1];
        const double per_row = 1.0 / fabs(dy), per_col = 1.0 / fabs(dx);
        int64_t row = floor_of(y), col = floor_of(x);
        double at = 0.0;
        distances[k] = INFINITY;
        while (at < limit && row >= 0 && row < height && col >= 0 && col < width) {
            const int here = room[row * width + col];
            if (here < ROOM) {
                if (here == OBSTACLE) distances[k] = at;
                break;
            }
            if (here > ROOM) {
                at += here - ROOM;
                row = floor_of(y + at * dy);
                col = floor_of(x + at * dx);
                continue;
            }
            const double to_row = (dy < 0 ? y - (double)row : (double)(row + 1) - y) * per_row;
            const double to_col = (dx < 0 ? x - (double)col : (double)(col + 1) - x) * per_col;
            /* no step leads back, or rounding at an edge would repeat a jump for ever */
            at = larger_of(at, to_col <= to_row ? to_col : to_row);
            if (to_col <= to_row)
                col += dx < 0 ? -1 : 1;
            else
                row += dy < 0 ? -1 : 1;
        }
    }
}
