/* Texts of numbers: the shortest that is read as the same number again, and nine digits.
 *
 * A double is a whole number times a power of two. Times a power of ten of at most 10^19 it fits
 * into 128 bits, so within a range that holds nearly all coordinates and distances every digit is
 * worked out exactly. What lies outside of the range is left to the caller.
 *
 * The shortest text is sought as Ryu does (Adams, "Ryu: fast float-to-string conversion", 2018),
 * here with exact numbers in the place of its tables: among the decimals that lie nearer to the
 * number than to its neighbours, one that ends in as many zeros as possible, and of these the
 * nearest.
 */

#ifndef MAPDEAL_NUMBER_TEXTS_H
#define MAPDEAL_NUMBER_TEXTS_H

#include <math.h>
#include <stdint.h>
#include <string.h>

#define LONGEST_TEXT 26 /* -1.7976931348623157e+308 has 24 characters */

#ifdef __SIZEOF_INT128__
#define WRITES_NUMBERS 1
__extension__ typedef unsigned __int128 Product;

#define E9 UINT64_C(1000000000)
static const uint64_t TEN_TO[20] = {
    1, 10, 100, 1000, 10000, 100000, 1000000, 10000000, 100000000, E9, 10 * E9, 100 * E9,
    1000 * E9, 10000 * E9, 100000 * E9, 1000000 * E9, 10000000 * E9, 100000000 * E9, E9 * E9,
    10 * E9 * E9,
};

/* digits * 10^power */
typedef struct {
    uint64_t digits;
    int power;
} Decimal;

/* whole * 2^power, whole of 53 or 24 bits */
typedef struct {
    uint64_t whole;
    int power;
} Binary;

/* Of a normal number above 0. */
static inline Binary binary_of(double size) {
    uint64_t bits;
    memcpy(&bits, &size, sizeof bits);
    const Binary binary = {(bits & 0xfffffffffffff) | UINT64_C(1) << 52, (int)(bits >> 52) - 1075};
    return binary;
}

/* The power of ten at or just below a number, at most one too small; 0.30103 is log10(2). */
static inline int power_of_ten_below(double size) {
    const int power = binary_of(size).power + 52;
    return (int)((power * INT64_C(78913)) >> 18);
}

/* The shortest decimal that is read as the number; it lies in `places` decimals at most. */
static inline Decimal shortest(Binary number, int places) {
    const int is_power_of_two = (number.whole & (number.whole - 1)) == 0;
    const int is_even = (number.whole & 1) == 0;
    const int shift = 2 - number.power; /* in units of a quarter of the last bit */
    const uint64_t scale = TEN_TO[places], middle = 4 * number.whole;
    const Product value = (Product)middle * scale;
    const Product low = (Product)(middle - (is_power_of_two ? 1 : 2)) * scale;
    const Product high = (Product)(middle + 2) * scale;
    const Product unit = (Product)1 << shift, below_unit = unit - 1;
    uint64_t least = (uint64_t)((low + below_unit) >> shift);
    uint64_t most = (uint64_t)(high >> shift);
    if (!is_even) { /* bounds are read as a neighbour */
        least += (low & below_unit) == 0;
        most -= (high & below_unit) == 0;
    }
    /* a multiple of ten lies within as long as fewer of them lie below than up to its end */
    int zeros = 0;
    uint64_t below = least - 1, within = most;
    if (within / 100000000 > below / 100000000) {
        within /= 100000000, below /= 100000000;
        zeros = 8;
    }
    while (within / 10 > below / 10) within /= 10, below /= 10, zeros++;
    const uint64_t step = TEN_TO[zeros], whole = (uint64_t)(value >> shift);
    Decimal found = {whole / step, zeros - places};
    const uint64_t under = found.digits * step;
    const Product rest = value - ((Product)under << shift), half = (Product)step << (shift - 1);
    const int is_over = rest > half || (rest == half && (found.digits & 1));
    found.digits += (is_over && under + step <= most) || under < least;
    return found;
}

/* Nine digits, rounded to the nearest, to the even ones of two. */
static inline Decimal nine_digits(Binary number, int below) {
    int places = 8 - below;
    const int shift = -number.power;
    Product value = (Product)number.whole * TEN_TO[places];
    if ((uint64_t)(value >> shift) >= E9) value = (Product)number.whole * TEN_TO[--places];
    const Product rest = value & (((Product)1 << shift) - 1), half = (Product)1 << (shift - 1);
    Decimal found = {(uint64_t)(value >> shift), -places};
    found.digits += rest > half || (rest == half && (found.digits & 1));
    return found;
}

static const char PAIRS[] =
    "00010203040506070809101112131415161718192021222324252627282930313233343536373839404142434445464748"
    "49505152535455565758596061626364656667686970717273747576777879808182838485868788899091929394959697"
    "9899";

static inline char *digits_written(uint64_t digits, char *to) {
    char text[20];
    int at = 20;
    while (digits >= 100) {
        at -= 2;
        memcpy(text + at, PAIRS + 2 * (digits % 100), 2);
        digits /= 100;
    }
    if (digits >= 10) {
        at -= 2;
        memcpy(text + at, PAIRS + 2 * digits, 2);
    } else {
        text[--at] = (char)('0' + digits);
    }
    memcpy(to, text + at, (size_t)(20 - at));
    return to + 20 - at;
}

/* A decimal, with an exponent if it is below 10^-4 or at or above 10^`widest`; whole numbers end in
   .0 if they are `pointed` and have no exponent. */
static char *decimal_written(Decimal decimal, int widest, int is_pointed, char *to) {
    if (decimal.digits % 100000000 == 0) decimal.digits /= 100000000, decimal.power += 8;
    if (decimal.digits % 1000 == 0) decimal.digits /= 1000, decimal.power += 3;
    while (decimal.digits % 10 == 0) decimal.digits /= 10, decimal.power++;
    char digits[20];
    const int count = (int)(digits_written(decimal.digits, digits) - digits);
    const int first = decimal.power + count - 1; /* the power of ten of the first digit */
    if (first < -4 || first >= widest) {
        *to++ = digits[0];
        if (count > 1) {
            *to++ = '.';
            memcpy(to, digits + 1, (size_t)(count - 1));
            to += count - 1;
        }
        *to++ = 'e';
        *to++ = first < 0 ? '-' : '+';
        const int size = first < 0 ? -first : first;
        if (size < 10) *to++ = '0';
        return digits_written((uint64_t)size, to);
    }
    if (first < 0) {
        memcpy(to, "0.0000", 6);
        to += 1 - first;
        memcpy(to, digits, (size_t)count);
        return to + count;
    }
    const int before = first + 1;
    if (count > before) {
        memcpy(to, digits, (size_t)before);
        to[before] = '.';
        memcpy(to + before + 1, digits + before, (size_t)(count - before));
        return to + count + 1;
    }
    memcpy(to, digits, (size_t)count);
    memset(to + count, '0', (size_t)(before - count));
    to += before;
    if (is_pointed) {
        *to++ = '.';
        *to++ = '0';
    }
    return to;
}

static inline char *sign_written(double value, char *to) {
    if (signbit(value)) *to++ = '-';
    return to;
}

/* Each of these returns the end of the text, or NULL for a number outside of its range. */

/* As Python's repr. */
static char *double_written(double value, char *to) {
    const double size = fabs(value);
    to = sign_written(value, to);
    if (size == 0) {
        memcpy(to, "0.0", 3);
        return to + 3;
    }
    /* Decimals of up to 15 digits are read as different numbers: if one is read as this number,
       there is no shorter one. Both sides of the quotient are exact, so it is what is read. */
    const double billionths = rint(size * 1e9);
    if (billionths < 1e15 && billionths / 1e9 == size) {
        const Decimal decimal = {(uint64_t)billionths, -9};
        return decimal_written(decimal, 16, 1, to);
    }
    if (!(size >= 1e-3 && size < 1e15)) return NULL;
    int places = 16 - power_of_ten_below(size);
    if (places > 19) places = 19; /* just above 1e-3, where it was taken one too large */
    return decimal_written(shortest(binary_of(size), places), 16, 1, to);
}

/* As numpy's text of a float32, which the value must be. */
static char *single_written(double value, char *to) {
    const double size = fabs(value);
    to = sign_written(value, to);
    if (size == 0) {
        memcpy(to, "0.0", 3);
        return to + 3;
    }
    if (!(size >= 1e-4 && size < 1e6)) return NULL; /* where all versions of numpy agree */
    Binary binary = binary_of(size);
    binary.whole >>= 29;
    binary.power += 29;
    return decimal_written(shortest(binary, 9 - power_of_ten_below(size)), 16, 1, to);
}

/* As the format .9g. */
static char *nine_written(double value, char *to) {
    const double size = fabs(value);
    if (!(size >= 1e-10 && size < 1e8)) return NULL;
    to = sign_written(value, to);
    return decimal_written(nine_digits(binary_of(size), power_of_ten_below(size)), 9, 0, to);
}
#else
#define WRITES_NUMBERS 0
static char *double_written(double value, char *to) { return NULL; }
static char *single_written(double value, char *to) { return NULL; }
static char *nine_written(double value, char *to) { return NULL; }
static char *digits_written(uint64_t digits, char *to) { return NULL; }
#endif

#endif
