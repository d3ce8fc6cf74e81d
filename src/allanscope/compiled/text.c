/* Rows of plain numbers out of delimited text, many at a time: `wire/text/table.py`; and their time
   stamps as long as they come evenly: `wire/continuity.py`. */

#include "kernels.h"

#include <float.h>

enum { LONGEST_LINE = 4096, EXACT_POWER = 22, WIDE_POWER = 27 };
static const long double POWERS[] = {
    1e0L,  1e1L,  1e2L,  1e3L,  1e4L,  1e5L,  1e6L,  1e7L,  1e8L,  1e9L,  1e10L, 1e11L, 1e12L, 1e13L,
    1e14L, 1e15L, 1e16L, 1e17L, 1e18L, 1e19L, 1e20L, 1e21L, 1e22L, 1e23L, 1e24L, 1e25L, 1e26L, 1e27L};

static int is_digit(uint8_t c) { return c >= '0' && c <= '9'; }

/* Units of a power of ten as the nearest double; return 0 where that is not certain.

   Up to 2^53 units and 10^22 it is one exact product or quotient, rounded once (Clinger 1990). More
   digits are computed in 64 bits, and taken where all numbers within their error round alike; on
   Windows a processor may be told to use 53. */
static int nearest(uint64_t units, int power, double *value) {
    if (units <= (uint64_t)1 << 53 && power <= EXACT_POWER && power >= -EXACT_POWER) {
        double one = (double)units, ten = (double)POWERS[power < 0 ? -power : power];
        *value = power < 0 ? one / ten : one * ten;
        return 1;
    }
#if LDBL_MANT_DIG >= 64 && !defined(_WIN32)
    if (power > WIDE_POWER || power < -WIDE_POWER) return 0;
    long double one = (long double)units, ten = POWERS[power < 0 ? -power : power];
    long double wide = power < 0 ? one / ten : one * ten, error = wide * 0x1p-62L;
    *value = (double)(wide - error);
    return *value == (double)(wide + error);
#else
    return 0;
#endif
}

/* Read the number that a cell begins with; return where it ends, or NULL for what is left to Python,
   which rounds the same. */
static const uint8_t *number_at(const uint8_t *at, const uint8_t *end, double *value) {
    int negative = at < end && *at == '-', digits = 0, power = 0;
    uint64_t units = 0;
    if (at < end && (*at == '-' || *at == '+')) at++;
    for (; at < end && is_digit(*at); at++, digits++) {
        if (units > UINT64_MAX / 10 - 1) return NULL;
        units = 10 * units + (uint64_t)(*at - '0');
    }
    if (at < end && *at == '.')
        for (at++; at < end && is_digit(*at); at++, digits++, power--) {
            if (units > UINT64_MAX / 10 - 1) return NULL;
            units = 10 * units + (uint64_t)(*at - '0');
        }
    if (digits == 0) return NULL;
    if (at < end && (*at == 'e' || *at == 'E')) {
        int below = ++at < end && *at == '-', written = 0, figures = 0;
        if (at < end && (*at == '-' || *at == '+')) at++;
        for (; at < end && is_digit(*at) && figures < 4; at++, figures++)
            written = 10 * written + (*at - '0');
        if (figures == 0 || figures == 4) return NULL;
        power += below ? -written : written;
    }
    if (!nearest(units, power, value)) return NULL;
    if (negative) *value = -*value;
    return at;
}

/* Read rows as long as they are plain: `columns` cells, those `wanted` numbers, or nothing, which is
   NaN (2: not even nothing); the others anything that no rule for lines could change.

   `values` receives those of each row, `ends` where the row ends, and `newlines` how many line feeds
   came up to there. Returns the number of rows, `most` at most. */
KERNEL(int64_t, read_rows)
(const uint8_t *data, int64_t size, int64_t separator, int64_t columns, const uint8_t *wanted,
 int64_t most, double *values, int64_t *ends, int64_t *newlines) {
    const uint8_t *at = data, *stop = data + size;
    int64_t rows = 0, lines = 0;
    while (rows < most) {
        while (at < stop && *at == '\n') at++, lines++;
        const uint8_t *end = at < stop ? memchr(at, '\n', (size_t)(stop - at)) : NULL;
        if (end == NULL || end - at > LONGEST_LINE) break;
        const uint8_t *after = end + 1;
        if (end > at && end[-1] == '\r') end--;
        if (at == end) break;
        int64_t cells = 0;
        double *own = values;
        for (; cells < columns; cells++) {
            if (wanted[cells]) {
                while (at < end && *at == ' ') at++;
                if (at == end || *at == separator) {
                    /* A cell of blanks is another matter than an empty one. */
                    if (wanted[cells] == 2 || (at > data && at[-1] == ' ')) break;
                    *own = NAN;
                } else if ((at = number_at(at, end, own)) == NULL) {
                    break;
                }
                own++;
                while (at < end && *at == ' ') at++;
            } else {
                while (at < end && *at != separator && *at > 31 && *at < 127 && *at != ':') at++;
            }
            if (at == end || *at != separator) {
                cells++;
                break;
            }
            at++;
        }
        if (at == NULL || cells != columns || at != end) break;
        lines++;
        at = after;
        ends[rows] = at - data, newlines[rows++] = lines;
        values = own;
    }
    return rows;
}

/* Follow time stamps as `PeriodTracker.update` does, up to one of which `missing` says something.

   `limits`: least and most period, the share of a deviation that the clock is pulled by, and the
   lateness in periods from which a sample is missing. `state`: period, expected and last time, times
   of both anchors; `counts`: samples so far, those of both anchors. Returns the number of stamps. */
KERNEL(int64_t, accept_stamps)
(const double *times, int64_t n, int64_t trusted, int64_t anchored, const double *limits,
 double *state, int64_t *counts) {
    double period = state[0], expected = state[1], last = state[2];
    int64_t taken = 0;
    for (; taken < n; taken++) {
        double time = times[taken];
        /* Written so that NaN stops it, too. */
        double late = (time - expected) / period;
        if (time < last - limits[4] * period || !(late <= limits[3])) break;
        if (late < -0.5 && late > -1.5 && limits[3] < 1) break;
        last = time;
        if (counts[0] - counts[2] >= anchored) {
            counts[1] = counts[2], state[3] = state[4];
            counts[2] = counts[0], state[4] = time;
        }
        if (counts[0] - counts[1] >= trusted) {
            period = (time - state[3]) / (double)(counts[0] - counts[1]);
            period = period < limits[0] ? limits[0] : period > limits[1] ? limits[1] : period;
        }
        expected = expected + limits[2] * (time - expected) + period;
        counts[0]++;
    }
    state[0] = period, state[1] = expected, state[2] = last;
    return taken;
}
