/* Numbers in text, as Python's float() reads them, to the last bit.
 *
 * Most numbers have at most 15 digits and a small power of ten: then both are exact doubles, and
 * their product or quotient is rounded once, which is what correct rounding means (Clinger 1990).
 * All others are left to the C library, whose strtod rounds correctly, too. What is not plainly a
 * number is refused, so that a slower reader can look at it and say what is wrong.
 */

#ifndef MAPDEAL_NUMBERS_H
#define MAPDEAL_NUMBERS_H

#include <locale.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#define MOST_EXACT (INT64_C(1) << 53)
#define MOST_DIGITS 18
#define LONGEST_NUMBER 400
#define MOST_POWER 22

static const double POWERS_OF_TEN[MOST_POWER + 1] = {
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11,
    1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22,
};

static inline int is_digit(char c) { return c >= '0' && c <= '9'; }
static inline int is_blank(char c) { return c == ' ' || c == '\t'; }

/* Whether strtod reads the point as a point. */
static int has_plain_locale(void) {
    const struct lconv *how = localeconv();
    return how != NULL && how->decimal_point[0] == '.' && how->decimal_point[1] == '\0';
}

static double rounded_number(const char *from, const char *to) {
    char copy[LONGEST_NUMBER + 1];
    memcpy(copy, from, (size_t)(to - from));
    copy[to - from] = '\0';
    return strtod(copy, NULL);
}

/* nan and inf, in any case; the place behind it, or NULL. */
static const char *word_number(const char *from, const char *end, int is_negative, double *value) {
    if (end - from < 3) return NULL;
    char word[3];
    for (int k = 0; k < 3; k++) word[k] = (char)(from[k] | 0x20);
    if (memcmp(word, "nan", 3) == 0)
        *value = NAN;
    else if (memcmp(word, "inf", 3) == 0)
        *value = is_negative ? -INFINITY : INFINITY;
    else
        return NULL;
    return from + 3;
}

/* Read the number that begins at `from`; return the place behind it, or NULL if there is none. */
static const char *read_number(const char *from, const char *end, double *value) {
    const char *at = from;
    int is_negative = 0, digits = 0, seen = 0;
    int64_t mantissa = 0;
    int64_t power = 0;
    if (at < end && (*at == '-' || *at == '+')) is_negative = *at++ == '-';
    for (; at < end && is_digit(*at); at++, seen = 1)
        if (digits < MOST_DIGITS) {
            mantissa = 10 * mantissa + (*at - '0');
            digits += mantissa > 0;
        } else {
            digits++;
        }
    if (at < end && *at == '.') {
        at++;
        for (; at < end && is_digit(*at); at++, seen = 1)
            if (digits < MOST_DIGITS) {
                mantissa = 10 * mantissa + (*at - '0');
                digits += mantissa > 0;
                power--;
            } else {
                digits++;
            }
    }
    if (!seen) return word_number(at, end, is_negative, value);
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
    if (digits <= MOST_DIGITS && mantissa <= MOST_EXACT && power >= -MOST_POWER
        && power <= MOST_POWER) {
        double exact = (double)mantissa;
        exact = power < 0 ? exact / POWERS_OF_TEN[-power] : exact * POWERS_OF_TEN[power];
        *value = is_negative ? -exact : exact;
        return at;
    }
    if (at - from > LONGEST_NUMBER) return NULL;
    *value = rounded_number(from, at);
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

/* Read lines of numbers into rows of `columns` each, up to `most` rows; empty lines and those that
 * begin with # are skipped. `delimiter` is between numbers, with blanks around it or not; 0 stands
 * for blanks alone. If `is_exact` a line has no more than these numbers. Each line ends with a line
 * feed, with a carriage return before it or not. Returns how many rows there are, or -1 at anything
 * else, and at which byte it stopped, and how many lines that were. */
static int64_t read_table(
    const char *text, int64_t length, char delimiter, int64_t columns, int is_exact, int64_t most,
    double *values, int64_t *stopped, int64_t *lines
) {
    const char *at = text, *end = text + length;
    int64_t rows = 0;
    *lines = 0;
    while (at < end && rows < most) {
        const char *line_end = memchr(at, '\n', (size_t)(end - at));
        if (line_end == NULL) return -1;
        const char *last = line_end;
        if (last > at && last[-1] == '\r') last--;
        while (at < last && is_blank(*at)) at++;
        if (at < last && *at != '#') {
            double *row = values + rows * columns;
            for (int64_t k = 0; k < columns; k++) {
                while (at < last && is_blank(*at)) at++;
                if (k > 0 && delimiter != 0) {
                    if (at == last || *at != delimiter) return -1;
                    at++;
                    while (at < last && is_blank(*at)) at++;
                }
                at = read_number(at, last, &row[k]);
                if (at == NULL || (at < last && !is_blank(*at) && *at != delimiter)) return -1;
            }
            while (at < last && is_blank(*at)) at++;
            if (at < last && (is_exact || (delimiter != 0 && *at != delimiter))) return -1;
            rows++;
        }
        at = line_end + 1;
        (*lines)++;
    }
    *stopped = at - text;
    return rows;
}

#endif
