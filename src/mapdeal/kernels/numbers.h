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

static const uint64_t WHOLE_POWERS_OF_TEN[MOST_WIDE_POWER + 1] = {
    UINT64_C(1), UINT64_C(10), UINT64_C(100), UINT64_C(1000), UINT64_C(10000), UINT64_C(100000),
    UINT64_C(1000000), UINT64_C(10000000), UINT64_C(100000000), UINT64_C(1000000000),
    UINT64_C(10000000000), UINT64_C(100000000000), UINT64_C(1000000000000),
    UINT64_C(10000000000000), UINT64_C(100000000000000), UINT64_C(1000000000000000),
    UINT64_C(10000000000000000), UINT64_C(100000000000000000), UINT64_C(1000000000000000000),
    UINT64_C(10000000000000000000),
};

/* 2 to a power within the normal range */
static double power_of_two(int power) {
    const uint64_t bits = (uint64_t)(power + 1023) << 52;
    double value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

/* a / b, neither of them 0, rounded to the nearest double, to the even one of two */
static double rounded_quotient(uint64_t a, uint64_t b) {
    const int a_shift = __builtin_clzll(a), b_shift = __builtin_clzll(b);
    a <<= a_shift;
    b <<= b_shift;
    const int is_less = a < b;
    /* a shift that makes the quotient one of exactly 64 bits */
    const Wide above = (Wide)a << (63 + is_less);
    const uint64_t quotient = (uint64_t)(above / b);
    const uint64_t rest = (uint64_t)above - quotient * b;
    uint64_t whole = quotient >> 11;
    const uint64_t below = quotient & 0x7ff;
    whole += below > 0x400 || (below == 0x400 && (rest != 0 || (whole & 1)));
    return (double)whole * power_of_two(b_shift - a_shift - 52 - is_less);
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
        *value = rounded_quotient(mantissa, WHOLE_POWERS_OF_TEN[-power]);
        return 1;
    }
    if (power >= 0 && power <= MOST_WIDE_POWER) {
        *value = (double)((Wide)mantissa * WHOLE_POWERS_OF_TEN[power]);
        return 1;
    }
#endif
    return 0;
}

/* nan and inf, in any case; the place behind it, or NULL. The sign of a nan is left to others. */
static const char *word_number(const char *from, const char *end, char sign, double *value) {
    if (end - from < 3) return NULL;
    char word[3];
    for (int k = 0; k < 3; k++) word[k] = (char)(from[k] | 0x20);
    if (memcmp(word, "nan", 3) == 0 && sign == 0)
        *value = NAN;
    else if (memcmp(word, "inf", 3) == 0)
        *value = sign == '-' ? -INFINITY : INFINITY;
    else
        return NULL;
    return from + 3;
}

#if defined(__BYTE_ORDER__) && __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__
#define READS_EIGHT 1
/* Eight digits at once, as bytes of a word: the tens of each pair are added, then the hundreds of
   each two pairs, then the ten thousands. */
static inline int are_eight_digits(uint64_t word) {
    return ((word & UINT64_C(0xf0f0f0f0f0f0f0f0)) |
            (((word + UINT64_C(0x0606060606060606)) & UINT64_C(0xf0f0f0f0f0f0f0f0)) >> 4)) ==
           UINT64_C(0x3333333333333333);
}

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
    uint64_t sum = *whole;
#if READS_EIGHT
    uint64_t word;
    while (end - at >= 8 && (memcpy(&word, at, 8), are_eight_digits(word))) {
        sum = 100000000 * sum + value_of_eight(word);
        at += 8;
    }
#endif
    for (; at < end && is_digit(*at); at++) sum = 10 * sum + (uint64_t)(*at - '0');
    *whole = sum;
    return at;
}

/* Read the number that begins at `from`; return the place behind it, or NULL if there is none. */
static const char *read_number(const char *from, const char *end, double *value) {
    const char *at = from;
    char sign = 0;
    uint64_t mantissa = 0;
    int64_t power = 0;
    if (at < end && (*at == '-' || *at == '+')) sign = *at++;
    const char *first = at;
    at = read_digits(at, end, &mantissa);
    int64_t digits = at - first;
    if (at < end && *at == '.') {
        const char *point = at++;
        at = read_digits(at, end, &mantissa);
        power = point + 1 - at;
        digits -= power;
    }
    if (digits == 0) return at == first ? word_number(at, end, sign, value) : NULL;
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
        *value = sign == '-' ? -size : size;
        return at;
    }
    if (at - from > LONGEST_NUMBER) return NULL;
    *value = rounded_by_library(from, at);
    return at;
}

/* Read so many numbers with blanks between them; return the place behind the last, or NULL. */
static const char *read_numbers(const char *at, const char *end, int64_t count, double *values) {
    for (int64_t k = 0; k < count; k++) {
        while (at < end && is_blank(*at)) at++;
        at = read_number(at, end, &values[k]);
        if (at == NULL || (at < end && !is_blank(*at) && *at != '\n' && *at != '\r')) return NULL;
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

/* Read the numbers of a line without its end into a row; whether it is made of them. */
static int read_row(const Table *table, const char *at, const char *end, double *row) {
    const char delimiter = table->delimiter;
    for (int64_t k = 0; k < table->columns; k++) {
        if (k > 0) {
            while (at < end && is_blank(*at)) at++;
            if (delimiter != 0) {
                if (at == end || *at != delimiter) return 0;
                at++;
                while (at < end && is_blank(*at)) at++;
            }
        }
        at = read_number(at, end, &row[k]);
        if (at == NULL) return 0;
        if (at < end && !is_blank(*at) && (delimiter == 0 || *at != delimiter)) return 0;
    }
    while (at < end && is_blank(*at)) at++;
    if (at == end) return 1;
    if (table->is_exact || (delimiter != 0 && *at != delimiter)) return 0;
    while (at < end && is_plain(*at)) at++;
    return at == end;
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
        const char *feed = memchr(at, '\n', (size_t)(end - at));
        const char *last = feed == NULL ? end : feed, *next = feed == NULL ? end : feed + 1;
        if (next - at > table->longest_line) return 0;
        if (feed != NULL && last > at && last[-1] == '\r') last--;
        while (at < last && is_blank(*at)) at++;
        if (at < last && *at != '#') {
            if (!read_row(table, at, last, values + taken->rows * table->columns)) return 0;
            taken->rows++;
        }
        at = next;
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
