/* Periodograms and the low-pass between two levels: `spectrum/ladder.py`. */

#include "kernels.h"

#if defined(__AVX2__)
#include <immintrin.h>
#endif

enum { SEGMENT = 2048, QUARTER = SEGMENT / 4, WAYS = 8, BINS = SEGMENT / 2 + 1 };

/* The same sample of eight segments. */
typedef float ways __attribute__((vector_size(32), aligned(4), may_alias));

/* --- the transform of eight real segments at once -----------------------------------------------

   Halves first, then quarters (Swarztrauber 1982): the real transform of n = l r samples is made of
   that of each r-th sample, l long, times waves. Arrays are (blocks, parts, width) or (parts, blocks,
   width) of eight numbers each; `turn` has cos and sin of 2 pi i / SEGMENT, by pairs. The order of
   sums is that of FFTPACK, so the bits are those of `scipy.fft.rfft`. */

typedef struct {
    ways re, im;
} pair;

static inline pair turned_by(pair v, const float *turn, int64_t i) {
    float c = turn[2 * i], s = turn[2 * i + 1];
    return (pair){c * v.re + s * v.im, c * v.im - s * v.re};
}

static inline void quarters(
    const ways *from, ways *to, int64_t width, int64_t blocks, const float *turn) {
    const float half = 0.707106781186547524400844362104849f;
    for (int64_t k = 0; k < blocks; k++) {
        const ways *a = from + k * width, *b = a + blocks * width, *c = b + blocks * width;
        const ways *d = c + blocks * width;
        ways *p = to + 4 * k * width, *q = p + width, *r = q + width, *s = r + width;
        int64_t last = width - 1;
        ways odd = d[0] + b[0], even = a[0] + c[0];
        r[0] = d[0] - b[0], q[last] = a[0] - c[0];
        p[0] = even + odd, s[last] = even - odd;
        if (width == 1) continue;
        ways sum = -half * (b[last] + d[last]), rest = half * (b[last] - d[last]), middle = c[last];
        for (int64_t i = 2; i < width; i += 2) {
            int64_t j = width - i, turns = blocks * (i / 2);
            pair one = turned_by((pair){b[i - 1], b[i]}, turn, turns);
            pair two = turned_by((pair){c[i - 1], c[i]}, turn, 2 * turns);
            pair three = turned_by((pair){d[i - 1], d[i]}, turn, 3 * turns);
            ways re_1 = three.re + one.re, re_4 = three.re - one.re;
            ways im_1 = one.im + three.im, im_4 = one.im - three.im;
            ways re_2 = a[i - 1] + two.re, re_3 = a[i - 1] - two.re;
            ways im_2 = a[i] + two.im, im_3 = a[i] - two.im;
            p[i - 1] = re_2 + re_1, s[j - 1] = re_2 - re_1;
            p[i] = im_1 + im_2, s[j] = im_1 - im_2;
            r[i - 1] = re_3 + im_4, q[j - 1] = re_3 - im_4;
            r[i] = re_4 + im_3, q[j] = re_4 - im_3;
        }
        p[last] = a[last] + rest, r[last] = a[last] - rest;
        s[0] = sum + middle, q[0] = sum - middle;
    }
}

static inline ways square(ways re, ways im, float norm) {
    re *= norm, im *= norm;
    return re * re + im * im;
}

/* The last pass of halves, so wide, and the squares of each bin: of the real part of the first and of
   the last. */
static inline void squares_of_halves(
    const ways *a, ways *bins, int64_t width, const float *turn, float norm) {
    const ways *b = a + width;
    ways mean = (a[0] + b[0]) * norm, end = (a[0] - b[0]) * norm;
    bins[0] = mean * mean, bins[width] = end * end;
    bins[width / 2] = square(a[width - 1], -b[width - 1], norm);
    for (int64_t i = 2; i < width; i += 2) {
        pair two = turned_by((pair){b[i - 1], b[i]}, turn, i / 2);
        bins[i / 2] = square(a[i - 1] + two.re, two.im + a[i], norm);
        bins[width - i / 2] = square(a[i - 1] - two.re, two.im - a[i], norm);
    }
}

/* The squares of each bin of a transform of a length that has no last pass of halves. */
static inline void squares_of(const ways *a, ways *bins, int64_t size) {
    bins[0] = a[0] * a[0], bins[size / 2] = a[size - 1] * a[size - 1];
    for (int64_t k = 1; k < size / 2; k++) bins[k] = square(a[2 * k - 1], a[2 * k], 1.0f);
}

/* Part eight rows of eight numbers into columns. */
static inline void transpose(const ways *rows, ways *columns) {
#if defined(__AVX2__)
    __m256 a[8], b[8];
    for (int i = 0; i < 4; i++) {
        a[2 * i] = _mm256_unpacklo_ps((__m256)rows[2 * i], (__m256)rows[2 * i + 1]);
        a[2 * i + 1] = _mm256_unpackhi_ps((__m256)rows[2 * i], (__m256)rows[2 * i + 1]);
    }
    for (int i = 0; i < 2; i++) {
        b[4 * i] = _mm256_shuffle_ps(a[4 * i], a[4 * i + 2], 0x44);
        b[4 * i + 1] = _mm256_shuffle_ps(a[4 * i], a[4 * i + 2], 0xEE);
        b[4 * i + 2] = _mm256_shuffle_ps(a[4 * i + 1], a[4 * i + 3], 0x44);
        b[4 * i + 3] = _mm256_shuffle_ps(a[4 * i + 1], a[4 * i + 3], 0xEE);
    }
    for (int i = 0; i < 4; i++) {
        columns[i] = (ways)_mm256_permute2f128_ps(b[i], b[i + 4], 0x20);
        columns[i + 4] = (ways)_mm256_permute2f128_ps(b[i], b[i + 4], 0x31);
    }
#else
    for (int i = 0; i < WAYS; i++)
        for (int j = 0; j < WAYS; j++) columns[i][j] = rows[j][i];
#endif
}

/* Samples of an axis that lie in two pieces, `p` in the first. */
typedef struct {
    const float *before, *after;
    int64_t p;
} pieces;

static inline float sample_at(pieces of, int64_t i) { return i < of.p ? of.before[i] : of.after[i - of.p]; }

static inline ways eight_at(pieces of, int64_t i) {
    if (i >= of.p) return *(const ways *)(of.after + (i - of.p));
    if (i + WAYS <= of.p) return *(const ways *)(of.before + i);
    ways v;
    for (int w = 0; w < WAYS; w++) v[w] = sample_at(of, i + w);
    return v;
}

/* Add |FFT|^2 / SEGMENT of windowed segments, each `hop` samples after the one before, to power
   (axes, bins). Samples are p of every axis, then n. `room` has place for two times eight segments. */
KERNEL(void, periodograms)
(const float *before, const float *samples, int64_t axes, int64_t p, int64_t n, int64_t segments,
 int64_t hop, const float *window, const float *turn, float *room, double *power) {
    ways *a = (ways *)room, *b = a + SEGMENT;
    for (int64_t first = 0; first < axes * segments; first += WAYS) {
        int64_t many = least(WAYS, axes * segments - first);
        pieces from[WAYS];
        int64_t start[WAYS];
        for (int64_t w = 0; w < WAYS; w++) {
            int64_t one = first + least(w, many - 1), axis = one / segments;
            from[w] = (pieces){before + axis * p, samples + axis * n, p};
            start[w] = one % segments * hop;
        }
        /* The first pass takes quarters of a segment as they come. */
        for (int64_t i = 0; i < QUARTER; i += WAYS) {
            ways of_quarters[4 * WAYS];
            for (int k = 0; k < 4; k++) {
                ways rows[WAYS];
                int64_t at = k * QUARTER + i;
                for (int w = 0; w < WAYS; w++)
                    rows[w] = eight_at(from[w], start[w] + at) * *(const ways *)(window + at);
                transpose(rows, of_quarters + k * WAYS);
            }
            quarters(of_quarters, b + 4 * i, 1, WAYS, turn);
        }
        quarters(b, a, 4, 128, turn);
        quarters(a, b, 16, 32, turn);
        quarters(b, a, 64, 8, turn);
        quarters(a, b, 256, 2, turn);
        squares_of_halves(b, a, SEGMENT / 2, turn, (float)(1.0 / sqrt((double)SEGMENT)));
        for (int64_t k = 0; k < BINS; k += WAYS) {
            ways bins[WAYS];
            transpose(a + k, bins);
            for (int64_t w = 0; w < many; w++) {
                double *own = power + (first + w) / segments * BINS + k;
                for (int64_t i = 0; i < least(WAYS, BINS - k); i++) own[i] += (double)bins[w][i];
            }
        }
    }
}

/* |FFT|^2 of eight pieces of `form` times the series, each from its start on; the size is a power of
   two, 64 or more. Returns the bins; `room` has place for two times eight pieces. */
static inline const ways *powers_of_eight(
    const float *series, const int64_t *start, int64_t size, const float *form, const float *turn,
    float *room) {
    ways *a = (ways *)room, *b = a + size;
    for (int64_t i = 0; i < size / 4; i += WAYS) {
        ways of_quarters[4 * WAYS];
        for (int k = 0; k < 4; k++) {
            ways rows[WAYS];
            int64_t at = k * (size / 4) + i;
            for (int w = 0; w < WAYS; w++)
                rows[w] = *(const ways *)(series + start[w] + at) * *(const ways *)(form + at);
            transpose(rows, of_quarters + k * WAYS);
        }
        quarters(of_quarters, a + 4 * i, 1, WAYS, turn);
    }
    int64_t width = 4;
    for (; 4 * width <= size; width *= 4) {
        quarters(a, b, width, size / (4 * width), turn);
        ways *other = a;
        a = b, b = other;
    }
    if (width < size)
        squares_of_halves(a, b, width, turn, 1.0f);
    else
        squares_of(a, b, size);
    return b;
}

/* The powers of pieces of a series, shape (size / 2 + 1, count): the same bin of all side by side. */
KERNEL(void, powers_of_pieces)
(const float *series, const int64_t *starts, int64_t count, int64_t size, const float *form,
 const float *turn, float *room, float *power) {
    for (int64_t first = 0; first < count; first += WAYS) {
        int64_t many = least(WAYS, count - first), start[WAYS];
        for (int64_t w = 0; w < WAYS; w++) start[w] = starts[first + least(w, many - 1)];
        const ways *bins = powers_of_eight(series, start, size, form, turn, room);
        for (int64_t k = 0; k <= size / 2; k++)
            memcpy(power + k * count + first, bins + k, (size_t)many * sizeof(float));
    }
}

/* The largest ratio of the power of each of `count` pieces, `hop` apart, to a mean, from the bin `low`
   up to `high`. */
KERNEL(void, largest_powers)
(const float *series, int64_t hop, int64_t count, int64_t size, const float *form, const float *turn,
 float *room, const double *mean, int64_t low, int64_t high, double *largest) {
    for (int64_t first = 0; first < count; first += WAYS) {
        int64_t many = least(WAYS, count - first), start[WAYS];
        for (int64_t w = 0; w < WAYS; w++) start[w] = hop * (first + least(w, many - 1));
        const ways *bins = powers_of_eight(series, start, size, form, turn, room);
        double most[WAYS] = {0.0};
        for (int64_t k = low; k < high; k++)
            for (int w = 0; w < WAYS; w++) most[w] = larger(most[w], (double)bins[k][w] / mean[k]);
        memcpy(largest + first, most, (size_t)many * sizeof(double));
    }
}

/* The samples of each axis, less its anchor, one after another; `rows` has those of a moment together. */
KERNEL(void, narrow_columns_of_int16)
(const int16_t *rows, const double *anchor, int64_t axes, int64_t n, float *columns) {
    enum { AT_A_TIME = 64 };
    for (int64_t done = 0; done < n; done += AT_A_TIME) {
        int64_t size = least(AT_A_TIME, n - done);
        for (int64_t axis = 0; axis < axes; axis++) {
            const int16_t *own = rows + done * axes + axis;
            float *column = columns + axis * n + done;
            for (int64_t j = 0; j < size; j++) column[j] = (float)((double)own[j * axes] - anchor[axis]);
        }
    }
}

enum { TAPS = 48, FACTOR = 4, OUTPUTS = 64, TOGETHER = 256, PHASE = TOGETHER + TAPS / FACTOR };

/* Outputs side by side, in one register: more than one at a time gcc keeps in memory. */
#if defined(WIDE)
typedef float outputs __attribute__((vector_size(64), aligned(4), may_alias));
#else
typedef float outputs __attribute__((vector_size(32), aligned(4), may_alias));
#endif

/* Filter `OUTPUTS` outputs: each is one sum, in the order of the taps, of numbers that lie side by
   side for all of them. */
static inline void filtered(const float (*phases)[PHASE], const float *taps, float *out) {
    enum { SIDE_BY_SIDE = sizeof(outputs) / sizeof(float), GROUPS = OUTPUTS / SIDE_BY_SIDE };
    outputs sums[GROUPS] = {{0.0f}};
    for (int j = 0; j < TAPS; j++) {
        const float *own = phases[j % FACTOR] + j / FACTOR;
        for (int i = 0; i < GROUPS; i++) sums[i] += taps[j] * *(const outputs *)(own + SIDE_BY_SIDE * i);
    }
    for (int i = 0; i < GROUPS; i++) *(outputs *)(out + SIDE_BY_SIDE * i) = sums[i];
}

/* Low-pass the samples of every axis, p and then n, and keep `count` outputs, one from every fourth.
   Samples are parted by their number modulo 4 first: then neighbouring outputs take neighbouring
   samples. */
KERNEL(void, decimate)
(const float *restrict before, const float *restrict samples, const float *restrict taps, int64_t axes,
 int64_t p, int64_t n, int64_t count, float *restrict out) {
    float phases[FACTOR][PHASE] = {{0.0f}}, sums[TOGETHER];
    for (int64_t axis = 0; axis < axes; axis++, before += p, samples += n, out += count) {
        const pieces all = {before, samples, p};
        for (int64_t done = 0; done < count; done += TOGETHER) {
            int64_t size = least(TOGETHER, count - done), wanted = size + TAPS / FACTOR - 1;
            int64_t here = FACTOR * done, i = 0;
            for (; i < wanted && here + FACTOR * i < p; i++)
                for (int k = 0; k < FACTOR; k++) phases[k][i] = sample_at(all, here + FACTOR * i + k);
            for (; i < wanted; i++)
                for (int k = 0; k < FACTOR; k++) phases[k][i] = samples[here - p + FACTOR * i + k];
            for (i = 0; i < size; i += OUTPUTS) {
                const float(*own)[PHASE] = (const float(*)[PHASE])(phases[0] + i);
                filtered(own, taps, sums + i);
            }
            memcpy(out + done, sums, (size_t)size * sizeof(float));
        }
    }
}
