/* LZF, the compression of PCD files: runs of literal bytes, and copies of what came before. */

#include <stdint.h>
#include <string.h>

/* Fill `to`, of exactly `size` bytes. Return 0 if the data are damaged or do not fit. */
static int lzf_expanded(const uint8_t *from, int64_t length, uint8_t *to, int64_t size)
{
    int64_t in = 0, out = 0;
    while (in < length) {
        const int control = from[in++];
        if (control < 32) {
            const int64_t run = control + 1;
            if (run > length - in || run > size - out) return 0;
            memcpy(to + out, from + in, (size_t)run);
            in += run;
            out += run;
            continue;
        }
        int64_t run = control >> 5;
        if (run == 7) {
            if (in >= length) return 0;
            run += from[in++];
        }
        if (in >= length) return 0;
        int64_t back = out - ((int64_t)(control & 31) << 8) - from[in++] - 1;
        run += 2;
        if (back < 0 || run > size - out) return 0;
        while (run-- > 0) to[out++] = to[back++]; /* may overlap: a pattern that repeats */
    }
    return out == size;
}
