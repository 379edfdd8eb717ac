/* Numbers in text, as Python's float() reads them, to the last bit.
 *
 * The digits of a number make a whole number of at most 64 bits, times a power of ten. If both are
 * exact doubles, their product or quotient is rounded once, which is what correct rounding means
 * (Clinger, "How to read floating point numbers accurately", 1990). If the whole number is longer,
 * the product or quotient is worked out exactly in 128 bits, and rounded by hand. All others are
 * left to the C library, whose strtod rounds correctly, too. What is not plainly a number is
 * refused, so that a slower reader can look at it and report what is wrong.
 */

#ifndef MAPDEAL_NUMBERS_H
#define MAPDEAL_NUMBERS_H

#include <float.h>
#include <locale.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#define MOST_EXACT (UINT64_C(1) << 53)
#define MOST_DIGITS 19 /* whose whole number has 64 bits or fewer */
#define MOST_POWER 22  /* of ten that is an exact double */
#define LONGEST_NUMBER 400

/* Where sums are kept in more bits than a double has, they are rounded twice. */
#define ROUNDS_ONCE (FLT_EVAL_METHOD == 0)

static const double POWERS_OF_TEN[MOST_POWER + 1] = {
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11,
    1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22,
};

static inline int is_digit(char c) { return (unsigned char)(c - '0') < 10; }
static inline int is_blank(char c) { return c == ' ' || c == '\t'; }
/* What a line of text in ASCII is made of; numpy refuses some other bytes, wherever they stand. */
static inline int is_plain(char c) { return (c >= ' ' && c < 0x7f) || c == '\t'; }

/* Whether strtod reads the point as a point. */
static int has_plain_locale(void) {
    const struct lconv *how = localeconv();
    return how != NULL && how->decimal_point[0] == '.' && how->decimal_point[1] == '\0';
}

static double rounded_by_library(const char *from, const char *to) {
    char copy[LONGEST_NUMBER + 1];
    memcpy(copy, from, (size_t)(to - from));
    copy[to - from] = '\0';
    return strtod(copy, NULL);
}

#ifdef __SIZEOF_INT128__
#define MOST_WIDE_POWER 19
__extension__ typedef unsigned __int128 Wide;

#define E18 UINT64_C(1000000000000000000)
static const uint64_t WHOLE_POWERS_OF_TEN[MOST_WIDE_POWER + 1] = {
    1, 10, 100, 1000, 10000, 100000, 1000000, 10000000, 100000000, 1000000000,
    E18 / 100000000, E18 / 10000000, E18 / 1000000, E18 / 100000, E18 / 10000, E18 / 1000,
    E18 / 100, E18 / 10, E18, 10 * E18,
};

/* 2 to a power within the normal range */
static inline double power_of_two(int power) {
    const uint64_t bits = (uint64_t)(power + 1023) << 52;
    double value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

/* A divisor, shifted so that its highest bit is set, and 2^127 divided by it, rounded down. */
typedef struct {
    uint64_t divisor, reciprocal;
    int shift;
} Divisor;

#define DIVISOR(d, bits) {(uint64_t)(d) << (bits), (uint64_t)(((Wide)1 << 127) / ((uint64_t)(d) << (bits))), bits}
static const Divisor TENS[MOST_WIDE_POWER + 1] = {
    {0, 0, 0}, /* 1 is not divided by */
    DIVISOR(10, 60), DIVISOR(100, 57), DIVISOR(1000, 54), DIVISOR(10000, 50), DIVISOR(100000, 47),
    DIVISOR(1000000, 44), DIVISOR(10000000, 40), DIVISOR(100000000, 37), DIVISOR(1000000000, 34),
    DIVISOR(E18 / 100000000, 30), DIVISOR(E18 / 10000000, 27), DIVISOR(E18 / 1000000, 24),
    DIVISOR(E18 / 100000, 20), DIVISOR(E18 / 10000, 17), DIVISOR(E18 / 1000, 14),
    DIVISOR(E18 / 100, 10), DIVISOR(E18 / 10, 7), DIVISOR(E18, 4), DIVISOR(10 * E18, 0),
};

/* a, not 0, divided by 10^power, rounded to the nearest double, to the even one of two */
static double rounded_quotient(uint64_t a, int power) {
    const Divisor by = TENS[power];
    const int shift = __builtin_clzll(a);
    a <<= shift;
    const int is_less = a < by.divisor;
    /* The quotient has exactly 64 bits, 11 more than a double. By the reciprocal it is found too
       small by less than 4, which seldom makes a difference. */
    uint64_t quotient = (uint64_t)((Wide)a * by.reciprocal >> (64 - is_less));
    uint64_t below = quotient & 0x7ff, is_inexact = 1;
    if (below > 0x400 - 4 && below <= 0x400) {
        const Wide above = (Wide)a << (63 + is_less);
        quotient = (uint64_t)(above / by.divisor);
        is_inexact = (uint64_t)above != quotient * by.divisor;
        below = quotient & 0x7ff;
    }
    uint64_t whole = quotient >> 11;
    whole += below > 0x400 || (below == 0x400 && (is_inexact || (whole & 1)));
    return (double)whole * power_of_two(by.shift - shift - 52 - is_less);
}
#endif

/* mantissa * 10^power; whether it could be worked out here */
static inline int scaled(uint64_t mantissa, int64_t power, double *value) {
    if (!ROUNDS_ONCE) return 0;
    if (mantissa <= MOST_EXACT && power >= -MOST_POWER && power <= MOST_POWER) {
        const double exact = (double)mantissa;
        *value = power < 0 ? exact / POWERS_OF_TEN[-power] : exact * POWERS_OF_TEN[power];
        return 1;
    }
#ifdef __SIZEOF_INT128__
    if (mantissa > 0 && power < 0 && power >= -MOST_WIDE_POWER) {
        *value = rounded_quotient(mantissa, (int)-power);
        return 1;
    }
    if (power >= 0 && power <= MOST_WIDE_POWER) {
        *value = (double)((Wide)mantissa * WHOLE_POWERS_OF_TEN[power]);
        return 1;
    }
#endif
    return 0;
}

/* nan and inf behind a sign, in any case; the place behind it, or NULL. A nan with a sign is left to
   others. */
static const char *word_number(const char *sign, const char *from, const char *end, double *value) {
    if (end - from < 3) return NULL;
    char word[3];
    for (int k = 0; k < 3; k++) word[k] = (char)(from[k] | 0x20);
    if (memcmp(word, "nan", 3) == 0 && sign == from)
        *value = NAN;
    else if (memcmp(word, "inf", 3) == 0)
        *value = *sign == '-' ? -INFINITY : INFINITY;
    else
        return NULL;
    return from + 3;
}

#if defined(__BYTE_ORDER__) && __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__ && defined(__GNUC__)
#define READS_EIGHT 1
/* How many of eight characters, from the first on, are digits. Digits become 0 to 9, and what else
   there is more, so that adding 0x76 sets its highest bit; what is carried comes behind it. */
static inline int leading_digits(uint64_t word) {
    word ^= UINT64_C(0x3030303030303030);
    word = ((word + UINT64_C(0x7676767676767676)) | word) & UINT64_C(0x8080808080808080);
    return word == 0 ? 8 : __builtin_ctzll(word) / 8;
}

/* The value of eight digits: pairs are joined, then pairs of pairs, then both fours. */
static inline uint64_t value_of_eight(uint64_t word) {
    word = (word & UINT64_C(0x0f0f0f0f0f0f0f0f)) * 2561 >> 8;
    word = (word & UINT64_C(0x00ff00ff00ff00ff)) * 6553601 >> 16;
    return (word & UINT64_C(0x0000ffff0000ffff)) * UINT64_C(42949672960001) >> 32;
}
#else
#define READS_EIGHT 0
#endif

/* Add digits to a whole number, which wraps around if they are too many; the place behind them. */
static inline const char *read_digits(const char *at, const char *end, uint64_t *whole) {
#if READS_EIGHT
    static const uint64_t above[9] = {1, 10, 100, 1000, 10000, 100000, 1000000, 10000000, 100000000};
    while (end - at >= 8) {
        uint64_t word;
        memcpy(&word, at, 8);
        const int count = leading_digits(word);
        if (count == 0) return at;
        *whole = above[count] * *whole + value_of_eight(word << (64 - 8 * count));
        at += count;
        if (count < 8) return at;
    }
#endif
    for (; at < end && is_digit(*at); at++) *whole = 10 * *whole + (uint64_t)(*at - '0');
    return at;
}

/* Read the number that begins at `from`; return the place behind it, or NULL if there is none. */
static inline const char *read_number(const char *from, const char *end, double *value) {
    if (from == end) return NULL;
    const char *at = from;
    const int is_negative = *at == '-';
    at += is_negative | (*at == '+');
    const char *first = at;
    uint64_t mantissa = 0;
    int64_t power = 0;
    at = read_digits(at, end, &mantissa);
    int64_t digits = at - first;
    if (at < end && *at == '.') {
        const char *point = at++;
        at = read_digits(at, end, &mantissa);
        power = point + 1 - at;
        digits -= power;
    }
    if (digits == 0) return at == first ? word_number(from, first, end, value) : NULL;
    if (at < end && (*at == 'e' || *at == 'E')) {
        int64_t exponent = 0;
        int is_down = 0;
        at++;
        if (at < end && (*at == '-' || *at == '+')) is_down = *at++ == '-';
        if (at == end || !is_digit(*at)) return NULL;
        for (; at < end && is_digit(*at); at++)
            if (exponent < 100000) exponent = 10 * exponent + (*at - '0');
        power += is_down ? -exponent : exponent;
    }
    double size;
    if (digits <= MOST_DIGITS && scaled(mantissa, power, &size)) {
        *value = is_negative ? -size : size;
        return at;
    }
    if (at - from > LONGEST_NUMBER) return NULL;
    *value = rounded_by_library(from, at);
    return at;
}

static inline int is_line_end(const char *at, const char *end) {
    return at == end || *at == '\n' || (*at == '\r' && at + 1 < end && at[1] == '\n');
}

static inline const char *behind_blanks(const char *at, const char *end) {
    while (at < end && is_blank(*at)) at++;
    return at;
}

/* Read so many numbers with blanks between them; return the place behind the last, or NULL. */
static const char *read_numbers(const char *at, const char *end, int64_t count, double *values) {
    for (int64_t k = 0; k < count; k++) {
        at = read_number(behind_blanks(at, end), end, &values[k]);
        if (at == NULL || (at < end && !is_blank(*at) && !is_line_end(at, end))) return NULL;
    }
    return at;
}

typedef struct {
    char delimiter;       /* between numbers, with blanks around it or not; 0: blanks alone */
    int is_exact;         /* whether a line has no more than these numbers */
    int64_t columns;      /* how many */
    int64_t longest_line; /* bytes, with its end */
} Table;

typedef struct {
    int64_t rows, lines, bytes;
} Taken;

/* Read the numbers of a line into a row; return the place of its end, or NULL at anything else. */
static inline const char *read_row(const Table *table, const char *at, const char *end,
                                   double *row) {
    const char delimiter = table->delimiter;
    for (int64_t k = 0; k < table->columns; k++) {
        if (k > 0) {
            const char *before = at;
            at = behind_blanks(at, end);
            if (delimiter == 0) {
                if (at == before) return NULL;
            } else {
                if (at == end || *at != delimiter) return NULL;
                at = behind_blanks(at + 1, end);
            }
        }
        at = read_number(at, end, &row[k]);
        if (at == NULL) return NULL;
    }
    const char *before = at;
    at = behind_blanks(at, end);
    if (is_line_end(at, end)) return at;
    if (table->is_exact || (delimiter == 0 ? at == before : *at != delimiter)) return NULL;
    while (at < end && is_plain(*at)) at++;
    return is_line_end(at, end) ? at : NULL;
}

/* Read lines of numbers into rows, up to so many of each, and until so many bytes are passed; empty
   lines and those that begin with # are passed over. A line ends with a line feed, with a carriage
   return before it or not, or with the text. Returns whether there was nothing else. */
static int read_table(const Table *table, const char *text, int64_t length, const Taken *most,
                      double *values, Taken *taken) {
    const char *at = text, *end = text + length;
    taken->rows = taken->lines = 0;
    while (at < end && taken->rows < most->rows && taken->lines < most->lines &&
           at - text < most->bytes) {
        const char *line = at;
        at = behind_blanks(at, end);
        if (at < end && *at == '#') {
            at = memchr(at, '\n', (size_t)(end - at));
            if (at == NULL) at = end;
        } else if (!is_line_end(at, end)) {
            at = read_row(table, at, end, values + taken->rows * table->columns);
            if (at == NULL) return 0;
            taken->rows++;
        }
        at += at < end && *at == '\r';
        at += at < end;
        if (at - line > table->longest_line) return 0;
        taken->lines++;
    }
    taken->bytes = at - text;
    return 1;
}

static inline int is_space(char c) { return c == ' ' || (c >= '\t' && c <= '\r'); }

/* Read whole numbers of at most 9 digits with white space between them, up to so many; return how
   many there are, or -1 at anything else. */
static int64_t read_whole_numbers(const char *at, const char *end, int64_t most, int32_t *values) {
    int64_t count = 0;
    for (;;) {
        while (at < end && is_space(*at)) at++;
        if (at == end) return count;
        const char *first = at;
        int32_t value = 0;
        for (; at < end && is_digit(*at) && at - first < 9; at++) value = 10 * value + (*at - '0');
        if (at == first || (at < end && !is_space(*at)) || count == most) return -1;
        values[count++] = value;
    }
}

#endif
