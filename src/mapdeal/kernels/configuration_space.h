/* Open poses of a footprint, and a flood through them. paths.py has the rules.

   Poses are bits: words of 64 cells of a row, of which those of all headings stand together, so that
   one instruction serves many headings, and a cell's neighbours in heading are next to it. */

#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "lanes.h"

#if defined(__BYTE_ORDER__) && __BYTE_ORDER__ != __ORDER_LITTLE_ENDIAN__
#error "bits of a row must stand in the order of its bytes"
#endif

enum { WORD = 64, WIDE = 16, CHUNK = WIDE - 1, SHIFTS = 8, DIGITS = 8 };

typedef struct {
    const uint8_t *blocked;   /* a bit a cell, the lowest first; those behind the last are set */
    int64_t height, width, stride, words, count; /* stride: bytes of a row; count: of headings */
    /* Of each heading and each shift of 0 .. 7 bits where its runs begin in a work area, whose
       rows hold `levels` copies of a row of the map, in which level e tells of each cell whether
       one of 2^e cells from there is blocked. A heading without runs is closed. */
    const int64_t *firsts, *offsets;
    int64_t first_row, first_byte; /* of the work area, from the pose's cell */
    int64_t halo, levels, level_words;
    int64_t band_rows;
} Poses;

static inline int64_t smaller(int64_t a, int64_t b) { return a < b ? a : b; }

/* target[j] = source[j] | source[j + n], in bits */
static inline void dilate_row(const uint64_t *restrict source, uint64_t *restrict target,
                              int64_t words, int64_t n)
{
    const int64_t whole = n / WORD, part = n % WORD, last = words - whole - 1;
    memcpy(target, source, (size_t)words * sizeof(uint64_t));
    if (part == 0) {
        for (int64_t i = 0; i <= last; i++) target[i] |= source[i + whole];
    } else {
        for (int64_t i = 0; i < last; i++)
            target[i] |= source[i + whole] >> part | source[i + whole + 1] << (WORD - part);
        if (last >= 0) target[last] |= source[last + whole] >> part;
    }
}

/* Make the work area for the poses in `rows` rows from `row` and a chunk of words from `word`. */
MANY_LANES
static void fill_area(const Poses *poses, int64_t row, int64_t rows, int64_t word,
                             uint64_t *area)
{
    const int64_t bytes = poses->level_words * 8, from = word * 8 + poses->first_byte;
    const int64_t before = smaller(from < 0 ? -from : 0, bytes);
    const int64_t there = smaller(bytes - before, poses->stride - (from + before));
    for (int64_t r = 0; r < rows + poses->halo; r++) {
        const int64_t at = row + poses->first_row + r;
        uint64_t *level = area + r * poses->levels * poses->level_words;
        memset(level, 0xFF, (size_t)bytes);
        if (at >= 0 && at < poses->height && there > 0)
            memcpy((uint8_t *)level + before, poses->blocked + at * poses->stride + from + before,
                   (size_t)there);
        for (int64_t e = 1; e < poses->levels; e++, level += poses->level_words)
            dilate_row(level, level + poses->level_words, poses->level_words, (int64_t)1 << (e - 1));
    }
}

/* The union of `count` runs, WIDE words each. Compilers keep vectors in registers, but not arrays. */
static inline void unite(const uint8_t *area, const int64_t *offsets, int64_t count, uint64_t *sum)
{
#if defined(__GNUC__)
    typedef uint64_t Lanes __attribute__((vector_size(WIDE * 4)));
    Lanes low = {0}, high = {0}, more_low, more_high;
    for (int64_t i = 0; i < count; i++) {
        memcpy(&more_low, area + offsets[i], sizeof low);
        memcpy(&more_high, area + offsets[i] + sizeof low, sizeof high);
        low |= more_low;
        high |= more_high;
    }
    memcpy(sum, &low, sizeof low);
    memcpy(sum + WIDE / 2, &high, sizeof high);
#else
    memset(sum, 0, WIDE * sizeof(uint64_t));
    for (int64_t i = 0; i < count; i++) {
        uint64_t more[WIDE];
        memcpy(more, area + offsets[i], sizeof more);
        for (int w = 0; w < WIDE; w++) sum[w] |= more[w];
    }
#endif
}

/* The cells of a chunk in which a heading is closed: runs of one shift together, then shifted. */
static inline void touched_in(const Poses *poses, const uint8_t *area, int64_t heading,
                              uint64_t *restrict touched)
{
    const int64_t *firsts = poses->firsts + heading * SHIFTS;
    uint64_t some[SHIFTS][WIDE + 1];
    for (int shift = 0; shift < SHIFTS; shift++) {
        unite(area, poses->offsets + firsts[shift], firsts[shift + 1] - firsts[shift], some[shift]);
        some[shift][WIDE] = 0;
    }
    for (int w = 0; w < WIDE; w++) touched[w] = some[0][w];
    for (int shift = 1; shift < SHIFTS; shift++)
        for (int w = 0; w < WIDE; w++)
            touched[w] |= some[shift][w] >> shift | some[shift][w + 1] << (WORD - shift);
}

/* Add a bit to a number for each cell, whose digits are in words of their own. */
static inline void add_bits(uint64_t (*restrict digits)[WIDE], const uint64_t *restrict bits)
{
    uint64_t carry[WIDE];
    for (int w = 0; w < WIDE; w++) carry[w] = bits[w];
    for (int d = 0; d < DIGITS; d++)
        for (int w = 0; w < WIDE; w++) {
            const uint64_t both = digits[d][w] & carry[w];
            digits[d][w] ^= carry[w];
            carry[w] = both;
        }
}

/* The numbers of 8 cells, a byte each, from a byte of each digit. */
static inline uint64_t turned(uint64_t x)
{
    uint64_t t;
    t = (x ^ x >> 7) & UINT64_C(0x00AA00AA00AA00AA), x ^= t ^ t << 7;
    t = (x ^ x >> 14) & UINT64_C(0x0000CCCC0000CCCC), x ^= t ^ t << 14;
    t = (x ^ x >> 28) & UINT64_C(0x00000000F0F0F0F0), x ^= t ^ t << 28;
    return x;
}

static inline void write_numbers(uint64_t (*restrict digits)[WIDE], uint8_t *restrict numbers,
                                 int64_t cells)
{
    uint64_t bytes[CHUNK + 1][8];
    for (int b = 0; b < 8; b++)
        for (int w = 0; w < WIDE; w++) {
            uint64_t x = 0;
            for (int d = 0; d < DIGITS; d++) x |= (digits[d][w] >> 8 * b & 0xFF) << 8 * d;
            bytes[w][b] = turned(x);
        }
    memcpy(numbers, bytes, (size_t)cells);
}

/* Write the open poses of a chunk of a row, and how many they are in each cell. */
MANY_LANES
static void open_chunk(const Poses *poses, const uint8_t *area, int64_t word,
                              uint64_t *restrict opened, uint8_t *restrict numbers)
{
    const int64_t cells = smaller(poses->width - word * WORD, CHUNK * WORD);
    const int64_t words = (cells + WORD - 1) / WORD, rest = cells % WORD;
    const uint64_t last = rest ? ~(~UINT64_C(0) << rest) : ~UINT64_C(0);
    uint64_t digits[DIGITS][WIDE] = {{0}}, bits[WIDE];
    for (int64_t k = 0; k < poses->count; k++) {
        const int64_t *firsts = poses->firsts + k * SHIFTS;
        if (firsts[0] == firsts[SHIFTS]) {
            for (int64_t w = 0; w < words; w++) opened[w * poses->count + k] = 0;
            continue;
        }
        touched_in(poses, area, k, bits);
        for (int w = 0; w < WIDE; w++) bits[w] = ~bits[w];
        bits[words - 1] &= last;
        for (int64_t w = 0; w < words; w++) opened[w * poses->count + k] = bits[w];
        if (numbers != NULL) add_bits(digits, bits);
    }
    if (numbers != NULL) write_numbers(digits, numbers, cells);
}

static inline int64_t area_words(const Poses *poses)
{
    return (poses->band_rows + poses->halo) * poses->levels * poses->level_words;
}

/* Open poses of the rows first .. end - 1: `opened` and `numbers` (or NULL) begin at row first. */
static void open_rows(const Poses *poses, int64_t first, int64_t end, uint64_t *area,
                      uint64_t *opened, uint8_t *numbers)
{
    const int64_t work_row = poses->levels * poses->level_words;
    for (int64_t row = first; row < end; row += poses->band_rows) {
        const int64_t rows = smaller(poses->band_rows, end - row);
        for (int64_t word = 0; word < poses->words; word += CHUNK) {
            fill_area(poses, row, rows, word, area);
            for (int64_t r = 0; r < rows; r++) {
                const int64_t from = row + r - first;
                open_chunk(poses, (const uint8_t *)(area + r * work_row), word,
                           opened + (from * poses->words + word) * poses->count,
                           numbers == NULL ? NULL : numbers + from * poses->width + word * WORD);
            }
        }
    }
}

/* The flood. A tile is a word of cells in all headings. Tiles that something was reached in from
   beside wait in line with these poses, their seeds. */
typedef struct {
    int64_t height, words, count;
    uint64_t *left;          /* open poses that are not reached yet: [row][word][heading] */
    uint64_t *reached;       /* cells that are reached in any heading: [row][word] */
    int32_t *slots;          /* of each tile the slot of its seeds; -1 if it does not wait */
    uint64_t *seeds;         /* [slot][heading] */
    int32_t *free_slots;     /* those that no tile has */
    int64_t *line;           /* the tiles that wait, a ring as long as there are slots */
    int64_t most, waiting, next; /* slots; tiles in line, and where the first of them is */
    uint8_t *spilled;        /* of each tile whether a neighbour found no slot for what it got */
    int64_t spills;
    uint64_t *work;          /* 2 x count */
} Flood;

/* All of the runs of `open` bits in which a seed is. */
static inline uint64_t run_fill(uint64_t seeds, uint64_t open)
{
    /* a sum carries from a seed to the end of its run */
    uint64_t fill = open & (((open + seeds) ^ open) | seeds), way = open;
    fill |= way & fill >> 1, way &= way >> 1;
    fill |= way & fill >> 2, way &= way >> 2;
    fill |= way & fill >> 4, way &= way >> 4;
    fill |= way & fill >> 8, way &= way >> 8;
    fill |= way & fill >> 16, way &= way >> 16;
    return fill | (way & fill >> 32);
}

/* Extend seeds to all that they reach within a tile. */
static inline void spread(uint64_t *restrict seeds, const uint64_t *restrict left,
                          uint64_t *restrict other, int64_t count)
{
    for (;;) {
        uint64_t rest = 0, more = 0;
        for (int64_t k = 0; k < count; k++) {
            seeds[k] = run_fill(seeds[k], left[k]);
            rest |= seeds[k] ^ left[k];
        }
        if (!rest) return;
        for (;;) {
            other[0] = seeds[0] | (left[0] & (seeds[count - 1] | seeds[1 % count]));
            uint64_t fresh = other[0] ^ seeds[0];
            for (int64_t k = 1; k < count - 1; k++) {
                other[k] = seeds[k] | (left[k] & (seeds[k - 1] | seeds[k + 1]));
                fresh |= other[k] ^ seeds[k];
            }
            if (count > 1) {
                other[count - 1] =
                    seeds[count - 1] | (left[count - 1] & (seeds[count - 2] | seeds[0]));
                fresh |= other[count - 1] ^ seeds[count - 1];
            }
            if (!fresh) break;
            more |= fresh;
            memcpy(seeds, other, (size_t)count * sizeof(uint64_t));
        }
        if (!more) return;
    }
}

/* Have a tile wait with seeds, among those it may have; return 0 if there is no slot for it. */
static inline int wait_with(Flood *flood, int64_t tile, const uint64_t *restrict seeds)
{
    const int64_t count = flood->count;
    int32_t slot = flood->slots[tile];
    if (slot < 0) {
        if (flood->waiting == flood->most) return 0;
        slot = flood->free_slots[flood->most - ++flood->waiting];
        flood->slots[tile] = slot;
        flood->line[(flood->next + flood->waiting - 1) % flood->most] = tile;
        memcpy(flood->seeds + slot * count, seeds, (size_t)count * sizeof(uint64_t));
    } else {
        uint64_t *restrict mine = flood->seeds + slot * count;
        for (int64_t k = 0; k < count; k++) mine[k] |= seeds[k];
    }
    return 1;
}

/* Hand what is reached in a tile on to the tile beside it, its cells moved by so many bits. */
static inline int hand_on(Flood *flood, const uint64_t *restrict reached, int64_t tile, int up,
                          int down)
{
    const int64_t count = flood->count;
    const uint64_t *restrict left = flood->left + tile * count;
    uint64_t *restrict seeds = flood->work, any = 0;
    for (int64_t k = 0; k < count; k++) {
        seeds[k] = left[k] & (reached[k] << up >> down);
        any |= seeds[k];
    }
    return any == 0 || wait_with(flood, tile, seeds);
}

/* Hand what is reached in a tile on to the four tiles beside it. */
static inline void hand_to_all(Flood *flood, const uint64_t *reached, int64_t tile)
{
    const int64_t word = tile % flood->words;
    int held = 1;
    if (tile >= flood->words) held &= hand_on(flood, reached, tile - flood->words, 0, 0);
    if (tile + flood->words < flood->height * flood->words)
        held &= hand_on(flood, reached, tile + flood->words, 0, 0);
    if (word > 0) held &= hand_on(flood, reached, tile - 1, WORD - 1, 0);
    if (word < flood->words - 1) held &= hand_on(flood, reached, tile + 1, 0, WORD - 1);
    if (!held) {
        flood->spills += !flood->spilled[tile];
        flood->spilled[tile] = 1;
    }
}

/* Serve the first of the tiles in line. */
static inline void serve(Flood *flood)
{
    const int64_t count = flood->count, tile = flood->line[flood->next];
    const int32_t slot = flood->slots[tile];
    uint64_t *restrict left = flood->left + tile * count;
    uint64_t *restrict seeds = flood->work + count, cells = 0;
    for (int64_t k = 0; k < count; k++) seeds[k] = flood->seeds[slot * count + k] & left[k];
    flood->next = (flood->next + 1) % flood->most;
    flood->free_slots[flood->most - flood->waiting--] = slot;
    flood->slots[tile] = -1;
    spread(seeds, left, flood->work, count);
    for (int64_t k = 0; k < count; k++) {
        left[k] ^= seeds[k];
        cells |= seeds[k];
    }
    flood->reached[tile] |= cells;
    hand_to_all(flood, seeds, tile);
}

/* Serve so many tiles, or all. */
MANY_LANES
static void flood_on(Flood *flood, int64_t most)
{
    while (most-- > 0 && flood->waiting > 0) serve(flood);
}

/* Hand on what was reached in the tiles of a row that found no slot; of `opened`, its open poses. */
MANY_LANES
static void hand_on_again(Flood *flood, int64_t row, const uint64_t *opened)
{
    const int64_t count = flood->count;
    uint64_t *reached = flood->work + count;
    for (int64_t word = 0; word < flood->words; word++) {
        const int64_t tile = row * flood->words + word;
        if (!flood->spilled[tile]) continue;
        flood->spilled[tile] = 0;
        flood->spills--;
        for (int64_t k = 0; k < count; k++)
            reached[k] = opened[word * count + k] & ~flood->left[tile * count + k];
        hand_to_all(flood, reached, tile);
    }
}
