/* The ladder of rungs: the loop through which every sample goes. `allan/kernels.py` explains it. */

#include "kernels.h"

#if defined(__AVX2__)
#include <immintrin.h>
#endif

enum { BATCH = 256, HEAD = 128, WIDTH = 21, ENTRIES = 2 * BATCH };
enum { GROUP = 2 * LANES };
enum { LONGEST_TERM = 2 * 63, NOTED = -2, MOST_LEVELS = 64, CUBED = 8 };
enum { OSTDEV, OADEV, OHDEV, MDEV, PDEV, STDEV, ADEV, HDEV, TOTDEV, OSTDEV_MOMENTS, STDEV_MOMENTS = 15 };

/* `Ladder` of allan/kernels.py, as kernels receive it. */
#define LADDER                                                                                   \
    double *rungs, double *heads, const int64_t *lags, const int64_t *first, double *sums,       \
        double *offsets, int64_t *marks, double *marked, int64_t axes, int64_t levels, int64_t slots
#define THE_LADDER                                                                               \
    ladder_of(rungs, heads, lags, first, sums, offsets, marks, marked, axes, levels, slots)

/* The largest step of x, second difference of z, and rest of the steps of q, of the new entries of a
   rung; a step below zero where that is not known. */
typedef struct {
    double step, curve, rest;
} sizes;

typedef struct {
    double *rungs, *heads;
    const int64_t *lags, *first;
    double *sums, *offsets;
    int64_t *marks;
    double *marked;
    int64_t axes, levels, slots;
    int64_t due[MOST_LEVELS];    /* the first mark that waits on each level */
    sizes (*known)[MOST_LEVELS]; /* of the last batch, of a group of axes; or nothing */
    double (*cubes)[BATCH / 2];  /* of `promote`, where it has been on a level; or nothing */
} ladder;

static void find_due(ladder *l, int64_t level) {
    l->due[level] = INT64_MAX;
    for (const int64_t *mark = l->marks + level * l->slots, *end = mark + l->slots; mark < end; mark++)
        if (*mark >= 0) l->due[level] = least(*mark, l->due[level]);
}

static ladder ladder_of(LADDER) {
    ladder all = {rungs, heads, lags, first, sums, offsets, marks, marked, axes, levels, slots, {0}, NULL, NULL};
    for (int64_t level = 0; level < levels; level++) find_due(&all, level);
    return all;
}

/* Forget the sizes of a rung: it counts from another offset. */
static void forget_sizes(const ladder *l, int64_t axis, int64_t level) {
    if (l->known != NULL) l->known[axis % GROUP][level].step = -1.0;
}

/* Entries x, z, q of a rung, ENTRIES each. */
static double *rung_of(const ladder *l, int64_t axis, int64_t level) {
    return l->rungs + (axis * l->levels + level) * 3 * ENTRIES;
}

static double *head_of(const ladder *l, int64_t axis, int64_t level) {
    return l->heads + (axis * l->levels + level) * HEAD;
}

static double *offset_of(const ladder *l, int64_t axis, int64_t level) {
    return l->offsets + axis * l->levels + level;
}

static double *sums_of(const ladder *l, int64_t axis, int64_t t) {
    return l->sums + (axis * l->first[l->levels] + t) * WIDTH;
}

/* Sums in two doubles: `allan/moments.py`. */

static inline double two_sum(double a, double b, double *low) {
    double total = a + b, of_b = total - a;
    *low = (a - (total - of_b)) + (b - of_b);
    return total;
}

static inline double two_product(double a, double b, double *low) {
    double product = a * b, wide_a = 134217729.0 * a, wide_b = 134217729.0 * b;
    double high_a = wide_a - (wide_a - a), high_b = wide_b - (wide_b - b);
    double low_a = a - high_a, low_b = b - high_b;
    *low = ((high_a * high_b - product) + high_a * low_b + low_a * high_b) + low_a * low_b;
    return product;
}

/* Add `number` values, each `step` short, to a sum and a sum of squares; clear what was added. */
static void restore_moments(double *moments, double *squares, double step) {
    double *total = moments + 2;
    double number = moments[0], first = moments[1], second = *squares;
    double more_low, low_1, low_2, twice_low, product_low;
    double more = two_product(number, step, &more_low);
    double high = two_sum(total[0], first, &low_1);
    total[0] = two_sum(high, more, &low_2);
    total[1] += (low_1 + low_2) + more_low;
    double twice = two_sum(2.0 * first, more, &twice_low);
    double product = two_product(step, twice, &product_low);
    high = two_sum(total[2], second, &low_1);
    total[2] = two_sum(high, product, &low_2);
    total[3] += (low_1 + low_2) + (product_low + step * (twice_low + more_low));
    moments[0] = moments[1] = *squares = 0.0;
}

/* Move the sums of w of a rung to those without its offset, which may change then. */
static void restore_offset(const ladder *l, int64_t axis, int64_t level) {
    double stride = ldexp(1.0, (int)level);
    for (int64_t t = l->first[level]; t < l->first[level + 1]; t++) {
        double *total = sums_of(l, axis, t), step = *offset_of(l, axis, level) * ((double)l->lags[t] * stride);
        restore_moments(total + OSTDEV_MOMENTS, total + OSTDEV, step);
        restore_moments(total + STDEV_MOMENTS, total + STDEV, step);
    }
}

KERNEL(void, cascade_restore_offsets)(LADDER) {
    ladder all = THE_LADDER, *l = &all;
    for (int64_t axis = 0; axis < axes; axis++)
        for (int64_t level = 0; level < levels; level++) restore_offset(l, axis, level);
}

/* A round number near the mean of samples that rise by `rise` above an offset: 24 bits, so that
   products with lags and strides are exact, and whole for integers, so that they stay integers. */
static double offset_near(double offset, double rise, double samples) {
    double mean = offset + rise / samples;
    if (rise == floor(rise) && offset == floor(offset)) mean = floor(mean + 0.5);
    double wide = 536870913.0 * mean;
    return wide - (wide - mean);
}

/* Let the samples below n entries be `step` more; `number` is that of the first, from the origin. */
static void with_offset(
    double *x, double *z, double *q, int64_t n, int64_t number, double stride, double step) {
    if (step == 0.0) return;
    for (int64_t j = 0; j < n; j++) {
        double s = (double)(number + j) * stride;
        q[j] += step * ((s - 1.0) * s * (2.0 * s - 1.0) / 12.0);
        z[j] += step * (0.5 * s * (s - 1.0));
        x[j] += step * s;
    }
}

/* Add the terms that end at n entries, all estimators at once.

   On rung 0 MDEV sums z + x, which include the last phase: one more term, as SP 1065 counts. */
static inline __attribute__((always_inline)) void overlap(
    const double *restrict rung, int64_t start, int64_t n, int64_t k, double stride, int inclusive,
    double *restrict total) {
    const double *x = rung + start, *z = x + ENTRIES, *q = z + ENTRIES;
    double half = 0.5 * (double)k * stride;
    lanes w_sums = {0.0}, ww = {0.0}, dd = {0.0}, hh = {0.0}, ee = {0.0}, rr = {0.0};
#define TERMS(type, j)                                                                           \
    type x0 = *(const type *)(x + (j)), x1 = *(const type *)(x + (j) - k);                       \
    type x2 = *(const type *)(x + (j) - 2 * k), x3 = *(const type *)(x + (j) - 3 * k);           \
    type z0 = *(const type *)(z + (j)), z1 = *(const type *)(z + (j) - k);                       \
    type z2 = *(const type *)(z + (j) - 2 * k), z3 = *(const type *)(z + (j) - 3 * k);           \
    type q0 = *(const type *)(q + (j)), q1 = *(const type *)(q + (j) - k);                       \
    type q2 = *(const type *)(q + (j) - 2 * k);                                                  \
    type w = x0 - x1, before = x1 - x2, d = w - before, h = d - (before - (x2 - x3));            \
    type e = (z0 - z3) - 3.0 * (z1 - z2);                                                        \
    if (inclusive) e += h;                                                                       \
    type r = half * (z0 - z2) - ((q0 - q1) - (q1 - q2));
    int64_t j = 0;
#if defined(WIDE)
#define ADD(sums, value) sums += first_of(value), sums += second_of(value)
    for (; j + 2 * LANES <= n; j += 2 * LANES) {
        TERMS(wide, j)
        wide w2 = w * w, d2 = d * d, h2 = h * h, e2 = e * e, r2 = r * r;
        ADD(w_sums, w), ADD(ww, w2), ADD(dd, d2), ADD(hh, h2), ADD(ee, e2), ADD(rr, r2);
    }
#undef ADD
#endif
    for (; j + LANES <= n; j += LANES) {
        TERMS(lanes, j)
        w_sums += w, ww += w * w, dd += d * d, hh += h * h, ee += e * e, rr += r * r;
    }
    for (int lane = 0; lane < LANES && j < n; j++, lane++) { /* fewer: gcc cannot tell */
        TERMS(double, j)
        w_sums[lane] += w, ww[lane] += w * w, dd[lane] += d * d;
        hh[lane] += h * h, ee[lane] += e * e, rr[lane] += r * r;
    }
#undef TERMS
    total[OSTDEV_MOMENTS] += (double)n;
    total[OSTDEV_MOMENTS + 1] += sum_of(w_sums);
    total[OSTDEV] += sum_of(ww);
    total[OADEV] += sum_of(dd);
    total[OHDEV] += sum_of(hh);
    total[MDEV] += sum_of(ee);
    total[PDEV] += sum_of(rr);
}

#include "whole.c"

static void full_overlap(
    const double *rung, int64_t start, int64_t n, int64_t k, double stride, double *total) {
    if (stride == 1.0)
        overlap(rung, start, n, k, stride, 1, total);
    else
        overlap(rung, start, n, k, stride, 0, total);
}

/* Add the terms of a segment's first 3 k entries, where the longer differences do not fit. */
static void full_overlap_start(
    const double *rung, int64_t stop, int64_t k, double stride, double *total) {
    const double *x = rung, *z = x + ENTRIES, *q = z + ENTRIES;
    const int64_t origin = BATCH - 1;
    for (int64_t j = origin + k; j < least(origin + 3 * k, stop); j++) {
        double w = x[j] - x[j - k];
        total[OSTDEV_MOMENTS] += 1.0;
        total[OSTDEV_MOMENTS + 1] += w;
        total[OSTDEV] += w * w;
    }
    for (int64_t j = origin + 2 * k; j < least(origin + 3 * k, stop); j++) {
        double d = x[j] - 2.0 * x[j - k] + x[j - 2 * k];
        double r = 0.5 * (double)k * stride * (z[j] - z[j - 2 * k])
                   - (q[j] - 2.0 * q[j - k] + q[j - 2 * k]);
        total[OADEV] += d * d;
        total[PDEV] += r * r;
    }
    int64_t j = origin + 3 * k - 1;
    if (stride == 1.0 && j < stop) {
        /* The inclusive sum before the first phase is nought: one term more than for exclusive. */
        double e = (z[j] + x[j]) - 3.0 * (z[j - k] + x[j - k]) + 3.0 * (z[j - 2 * k] + x[j - 2 * k]);
        total[MDEV] += e * e;
    }
}

/* Add the terms that end at entries whose number in the segment is a multiple of k. These entries
   are gathered first: then neighbouring terms take neighbouring entries. */
static void no_overlap(const double *x, int64_t before, int64_t stop, int64_t k, double *total) {
    const int64_t origin = BATCH - 1 - before;
    int64_t number = before - before % k + k;
    lanes w_sums = {0.0}, ww = {0.0}, dd = {0.0}, hh = {0.0};
    total[STDEV_MOMENTS] += (double)((before + stop - BATCH) / k - before / k);
    for (; number < 3 * k && origin + number < stop; number += k) {
        int64_t j = origin + number;
        double w = x[j] - x[j - k];
        w_sums[0] += w;
        ww[0] += w * w;
        if (number == 2 * k) {
            double d = w - (x[j - k] - x[j - 2 * k]);
            dd[0] += d * d;
        }
    }
    int64_t start = origin + number, n = start < stop ? (stop - start + k - 1) / k : 0, j = 0;
    double room[BATCH + 3];
    const double *own = x + start - 3;
    if (n > 0 && k > 1) {
        for (int64_t i = 0; i < n + 3; i++) room[i] = x[start + (i - 3) * k];
        own = room;
    }
#define TERMS(type, j)                                                                           \
    type x0 = *(const type *)(own + (j) + 3), x1 = *(const type *)(own + (j) + 2);               \
    type x2 = *(const type *)(own + (j) + 1), x3 = *(const type *)(own + (j));                   \
    type w = x0 - x1, before_w = x1 - x2, d = w - before_w, h = d - (before_w - (x2 - x3));
    for (; j + LANES <= n; j += LANES) {
        TERMS(lanes, j)
        w_sums += w, ww += w * w, dd += d * d, hh += h * h;
    }
    for (int lane = 0; j < n; j++, lane++) {
        TERMS(double, j)
        w_sums[lane] += w, ww[lane] += w * w, dd[lane] += d * d, hh[lane] += h * h;
    }
#undef TERMS
    total[STDEV_MOMENTS + 1] += sum_of(w_sums);
    total[STDEV] += sum_of(ww);
    total[ADEV] += sum_of(dd);
    total[HDEV] += sum_of(hh);
}

/* Number of the first term after entry `from`, by its end: it begins with its segment at the earliest. */
static int64_t first_end(int64_t from, int64_t k) { return from < 2 * k ? 2 * k : from + 1; }

/* Sum of the squares that OADEV has of the terms that end after entry `from`, up to `to`, of a rung
   that has spent `before`. */
static double squares_between(const double *rung, int64_t before, int64_t from, int64_t to, int64_t k) {
    int64_t shift = BATCH - 1 - before, j = shift + first_end(from, k), stop = shift + to + 1;
    lanes sums = {0.0};
#define TERM(type, j)                                                                            \
    type middle = *(const type *)(rung + (j) - k);                                               \
    type d = (*(const type *)(rung + (j)) - middle) - (middle - *(const type *)(rung + (j) - 2 * k));
    for (; j + LANES <= stop; j += LANES) {
        TERM(lanes, j)
        sums += d * d;
    }
    for (int lane = 0; j < stop; j++, lane++) {
        TERM(double, j)
        sums[lane] += d * d;
    }
#undef TERM
    return sum_of(sums);
}

/* Entries that a rung has had when the last term of a mark has come. */
static int64_t done_at(int64_t mark, int64_t level) {
    return ((mark - 1) >> level) + 1 + LONGEST_TERM;
}

/* Note for each mark of a rung, a number of samples, the squares of all terms that end there or
   before, and of those that reach across it with their number: `allan/dynamic.py`. It is done when
   the last of these has come, and `spend` has not yet taken them. */
static void note_marks(ladder *l, int64_t axis, int64_t level, int64_t before, int64_t new, int is_end) {
    const double *rung = rung_of(l, axis, level);
    int64_t *marks = l->marks + level * l->slots, now = before + new;
    if (l->due[level] == INT64_MAX || (!is_end && done_at(l->due[level], level) > now)) return;
    for (int64_t slot = 0; slot < l->slots; slot++) {
        int64_t mark = marks[slot], here = mark >> level, done = done_at(mark, level);
        if (mark < 0 || done <= before || (!is_end && done > now)) continue;
        for (int64_t t = l->first[level]; t < l->first[level + 1]; t++) {
            int64_t k = l->lags[t], last = least(done - LONGEST_TERM + 2 * k - 1, now);
            double *found = l->marked + ((axis * l->first[l->levels] + t) * l->slots + slot) * 3;
            double spent = sums_of(l, axis, t)[OADEV];
            found[0] = here < before ? spent - squares_between(rung, before, here, before, k)
                                     : spent + squares_between(rung, before, before, here, k);
            found[1] = squares_between(rung, before, here, last, k);
            found[2] = last < first_end(here, k) ? 0.0 : (double)(last - first_end(here, k) + 1);
        }
        if (axis == l->axes - 1) marks[slot] = NOTED;
    }
    if (axis == l->axes - 1) find_due(l, level);
}

/* Add all terms that end in the `new` entries of a rung that has spent `before` of them. */
static void spend(const ladder *l, int64_t axis, int64_t level, int64_t before, int64_t new) {
    double *rung = rung_of(l, axis, level), stride = ldexp(1.0, (int)level);
    int64_t stop = BATCH + new;
    if (before == 0) {
        /* Only now is there a mean to count from. The first sample may lie anywhere. */
        double old = *offset_of(l, axis, level);
        double offset = offset_near(old, rung[stop - 1], (double)new * stride);
        restore_offset(l, axis, level);
        with_offset(
            rung + BATCH, rung + ENTRIES + BATCH, rung + 2 * ENTRIES + BATCH, new, 1, stride,
            old - offset);
        *offset_of(l, axis, level) = offset;
        memcpy(head_of(l, axis, level), rung + BATCH - 1, HEAD * sizeof(double));
    }
    uint64_t overlapping = 0, apart = 0; /* what whole numbers have done, by lag */
    sizes unknown = {-1.0, 0.0, 0.0}, *known = l->known ? &l->known[axis % GROUP][level] : &unknown;
    if (before > 0 && new == BATCH)
        spend_whole(
            rung, before, (int64_t)1 << level, l->lags + l->first[level], l->first[level + 1] - l->first[level],
            known, sums_of(l, axis, l->first[level]), &overlapping, &apart);
    for (int64_t t = l->first[level]; t < l->first[level + 1]; t++, overlapping >>= 1, apart >>= 1) {
        int64_t k = l->lags[t], start = overlapping & 1 ? stop : BATCH;
        double *total = sums_of(l, axis, t);
        if (before == 0) {
            full_overlap_start(rung, stop, k, stride, total);
            start = BATCH - 1 + 3 * k;
        }
        if (start < stop) full_overlap(rung, start, stop - start, k, stride, total);
        if (!(apart & 1)) no_overlap(rung, before, stop, k, total);
    }
}

static inline lanes four_of_int16(const int16_t *p) {
#if defined(__AVX2__)
    return (lanes)_mm256_cvtepi32_pd(_mm_cvtepi16_epi32(_mm_loadl_epi64((const __m128i *)p)));
#else
    return (lanes){(double)p[0], (double)p[1], (double)p[2], (double)p[3]};
#endif
}

static inline lanes four_of_float64(const double *p) { return *(const lanes *)p; }

/* Store four rows as columns. */
static inline void store_columns(const lanes *rows, double *const *columns, int64_t at) {
#if defined(__AVX2__)
    __m256d r0 = (__m256d)rows[0], r1 = (__m256d)rows[1], r2 = (__m256d)rows[2], r3 = (__m256d)rows[3];
    __m256d a = _mm256_unpacklo_pd(r0, r1), b = _mm256_unpackhi_pd(r0, r1);
    __m256d c = _mm256_unpacklo_pd(r2, r3), d = _mm256_unpackhi_pd(r2, r3);
    _mm256_storeu_pd(columns[0] + at, _mm256_permute2f128_pd(a, c, 0x20));
    _mm256_storeu_pd(columns[1] + at, _mm256_permute2f128_pd(b, d, 0x20));
    _mm256_storeu_pd(columns[2] + at, _mm256_permute2f128_pd(a, c, 0x31));
    _mm256_storeu_pd(columns[3] + at, _mm256_permute2f128_pd(b, d, 0x31));
#else
    for (int i = 0; i < LANES; i++)
        for (int a = 0; a < LANES; a++) columns[a][at + i] = rows[i][a];
#endif
}

/* Sum rows of all axes up on rung 0, from entry `at` on, for up to four axes from `first` on: in one
   axis the sums wait for each other, so axes lie side by side. The samples end at `end`, behind which
   nothing may be read. Sums are put down some at a time: entries of all axes compete for the same
   places in a cache. */
#define TAKE_IN(name, type, four)                                                                \
    static void name(                                                                            \
        const ladder *l, int64_t first, int64_t at, const type *rows, const type *end,           \
        int64_t n, const double *anchor) {                                                       \
        enum { X, Z, Q, SUMS, SOME = 64, APART = SOME + 8 };                                     \
        const int64_t axes = l->axes, many = least(LANES, axes - first);                         \
        lanes x = {0.0}, z = x, q = x, zero = x, offset = x;                                     \
        double *to[LANES] = {NULL}, sums[SUMS][LANES][APART], *columns[SUMS][LANES];             \
        for (int64_t a = 0; a < LANES; a++) {                                                    \
            for (int sum = X; sum < SUMS; sum++) columns[sum][a] = sums[sum][a];                 \
            if (a >= many) continue;                                                             \
            to[a] = rung_of(l, first + a, 0) + at;                                               \
            x[a] = to[a][-1], z[a] = to[a][ENTRIES - 1], q[a] = to[a][2 * ENTRIES - 1];          \
            zero[a] = anchor[first + a], offset[a] = *offset_of(l, first + a, 0);                \
        }                                                                                        \
        for (int64_t done = 0; done < n; done += SOME) {                                         \
            const type *own = rows + done * axes + first;                                        \
            int64_t size = least(SOME, n - done), i = 0;                                         \
            lanes x_rows[LANES], z_rows[LANES], q_rows[LANES];                                   \
            for (; i + LANES <= size && own + (LANES - 1) * axes + LANES <= end; i += LANES) {   \
                for (int k = 0; k < LANES; k++, own += axes) {                                   \
                    q += z + 0.5 * x, z += x, x += (four(own) - zero) - offset;                  \
                    x_rows[k] = x, z_rows[k] = z, q_rows[k] = q;                                 \
                }                                                                                \
                store_columns(x_rows, columns[X], i);                                            \
                store_columns(z_rows, columns[Z], i);                                            \
                store_columns(q_rows, columns[Q], i);                                            \
            }                                                                                    \
            for (; i < size; i++, own += axes) {                                                 \
                type last[LANES] = {0};                                                          \
                memcpy(last, own, (size_t)many * sizeof *own);                                   \
                q += z + 0.5 * x, z += x, x += (four(last) - zero) - offset;                     \
                for (int64_t a = 0; a < many; a++)                                               \
                    sums[X][a][i] = x[a], sums[Z][a][i] = z[a], sums[Q][a][i] = q[a];            \
            }                                                                                    \
            for (int64_t a = 0; a < many; a++)                                                   \
                for (int sum = X; sum < SUMS; sum++) {                                           \
                    double *here = to[a] + sum * ENTRIES + done;                                 \
                    if (size == SOME) memcpy(here, sums[sum][a], SOME * sizeof(double));         \
                    else for (i = 0; i < size; i++) here[i] = sums[sum][a][i];                   \
                }                                                                                \
        }                                                                                        \
    }

TAKE_IN(take_in_int16, int16_t, four_of_int16)
TAKE_IN(take_in_float64, double, four_of_float64)

/* Every second of 2 n entries, as they are seen from where a body was at x, z, q `stride` before the
   first of them, and whose samples are `more`. Numbers are of 32 bits: of 64 AVX2 makes no doubles. */

static inline void carry_x(
    const double *restrict from, int32_t n, double stride, double x, double more, double *restrict to) {
    for (int32_t j = 0; j < n; j++) {
        double s = (double)(j + 1) * stride;
        to[j] = from[2 * j] + (x + more * s);
    }
}

static inline void carry_z(
    const double *restrict from, int32_t n, double stride, double x, double z, double more,
    double *restrict to) {
    for (int32_t j = 0; j < n; j++) {
        double s = (double)(j + 1) * stride;
        to[j] = from[2 * j] + (z + s * x + more * (0.5 * (s * (s - 1.0))));
    }
}

static inline void carry_q(
    const double *restrict from, int32_t n, double stride, double x, double z, double q, double more,
    const double *restrict cubes, double *restrict to) {
    for (int32_t j = 0; j < n; j++) {
        double s = (double)(j + 1) * stride;
        to[j] = from[2 * j] + (q + s * z + 0.5 * s * s * x + more * cubes[j]);
    }
}

/* Carry every second of the new entries of a rung to the next: there it is a stretch of time on from
   the last entry before. */
static void promote(const ladder *l, int64_t axis, int64_t level, int64_t before, int64_t new) {
    const double *lx = rung_of(l, axis, level) + BATCH + 1, *lz = lx + ENTRIES, *lq = lz + ENTRIES;
    if (before == 0) *offset_of(l, axis, level + 1) = *offset_of(l, axis, level);
    double stride = ldexp(1.0, (int)level + 1);
    double more = *offset_of(l, axis, level) - *offset_of(l, axis, level + 1);
    double *xs = rung_of(l, axis, level + 1) + BATCH + (before / 2) % BATCH;
    double *zs = xs + ENTRIES, *qs = zs + ENTRIES;
    double own[BATCH / 2] = {0.0}, *cubes = l->cubes && level < CUBED ? l->cubes[level] : own;
    if (cubes[BATCH / 2 - 1] == 0.0)
        for (int32_t j = 0; j < BATCH / 2; j++) {
            double s = (double)(j + 1) * stride;
            cubes[j] = s * (s - 1.0) * (2.0 * s - 1.0) / 12.0;
        }
    carry_x(lx, (int32_t)new / 2, stride, xs[-1], more, xs);
    carry_z(lz, (int32_t)new / 2, stride, xs[-1], zs[-1], more, zs);
    carry_q(lq, (int32_t)new / 2, stride, xs[-1], zs[-1], qs[-1], more, cubes, qs);
}

/* Move the new half to the history, in a frame with its origin at the last entry; return the rise
   of the phase in it. */
static double make_history(double *rung, double stride) {
    double *xs = rung, *zs = xs + ENTRIES, *qs = zs + ENTRIES;
    double x = xs[ENTRIES - 1], z = zs[ENTRIES - 1], q = qs[ENTRIES - 1];
    for (int32_t j = 0; j < BATCH; j++) { /* 32 bits: of 64 AVX2 makes no doubles */
        double s = (double)(j - BATCH + 1) * stride;
        qs[j] = qs[BATCH + j] - q - s * z - 0.5 * s * s * x;
        zs[j] = zs[BATCH + j] - z - s * x;
        xs[j] = xs[BATCH + j] - x;
    }
    return x;
}

/* Give a rung the mean of its last batch, in which the phase rose by `rise`, for an offset. */
static void count_from_mean(const ladder *l, int64_t axis, int64_t level, double rise) {
    double stride = ldexp(1.0, (int)level), old = *offset_of(l, axis, level), *rung = rung_of(l, axis, level);
    double offset = offset_near(old, rise, BATCH * stride);
    restore_offset(l, axis, level);
    with_offset(
        rung, rung + ENTRIES, rung + 2 * ENTRIES, BATCH, 1 - BATCH, stride, old - offset);
    *offset_of(l, axis, level) = offset;
    forget_sizes(l, axis, level);
}

/* Spend the full batch of a rung, its number `batches`, and those that it fills above. */
static void spend_batches(ladder *l, int64_t axis, int64_t level, int64_t batches) {
    for (int full = 1; full; level++, batches /= 2) {
        int64_t before = (batches - 1) * BATCH;
        note_marks(l, axis, level, before, BATCH, 0);
        spend(l, axis, level, before, BATCH);
        if (level + 1 < l->levels) promote(l, axis, level, before, BATCH);
        double rise = make_history(rung_of(l, axis, level), ldexp(1.0, (int)level));
        /* When the segment has doubled is often enough: a level that changes between is no offset
           of the whole, but varies as much as its change. */
        if ((batches & (batches - 1)) == 0) count_from_mean(l, axis, level, rise);
        full = level + 1 < l->levels && batches % 2 == 0;
    }
}

#include "stretch.c"

/* Take in n rows of samples of all axes, less the anchor of each, after `taken` of this segment. */
#define ADVANCE(name, type, take_in, stretch)                                                    \
    KERNEL(void, name)                                                                           \
    (const type *rows, const double *anchor, int64_t n, int64_t taken, LADDER) {                 \
        ladder all = THE_LADDER, *l = &all;                                                      \
        sizes known[GROUP][MOST_LEVELS];                                                         \
        double cubes[CUBED][BATCH / 2] = {{0.0}};                                                \
        l->known = known, l->cubes = cubes;                                                      \
        for (int64_t group = 0; group < axes; group += GROUP) {                                  \
            int64_t many = least(GROUP, axes - group);                                           \
            for (int64_t i = 0; i < many * levels; i++) forget_sizes(l, i / levels, i % levels); \
            for (int64_t done = 0, count = taken; done < n;) {                                   \
                int64_t length = stretch(l, group, many, rows + done * axes, n - done, count, anchor);\
                done += length, count += length;                                                 \
                if (length > 0) continue;                                                        \
                int64_t at = BATCH + count % BATCH, size = least(ENTRIES - at, n - done);        \
                for (int64_t a = 0; a < many; a += LANES)                                        \
                    take_in(l, group + a, at, rows + done * axes, rows + n * axes, size, anchor);\
                done += size;                                                                    \
                count += size;                                                                   \
                for (int64_t a = 0; a < many && count % BATCH == 0; a++)                         \
                    spend_batches(l, group + a, 0, count / BATCH);                               \
            }                                                                                    \
        }                                                                                        \
    }

ADVANCE(cascade_advance_int16, int16_t, take_in_int16, stretch_int16)
ADVANCE(cascade_advance_float64, double, take_in_float64, stretch_float64)

/* The squares that TOTDEV has beyond OADEV: those that reach past an end. Beyond it the record goes
   on as its own image turned by 180 degrees about the last point, x[-j] = 2 x[0] - x[j] (Howe
   2000). Both ends look alike, one read forwards from `head`, one backwards from `tail`. */
static double reflected(const double *head, const double *tail, int64_t entries, int64_t k) {
    double total = 0.0;
    if (entries >= 2 * k) {
        for (int64_t i = 1; i < k; i++) {
            double left = 2.0 * head[0] - head[k - i] - 2.0 * head[i] + head[i + k];
            double right = 2.0 * tail[0] - tail[i - k] - 2.0 * tail[-i] + tail[-i - k];
            total += left * left + right * right;
        }
    } else if (entries >= k) {
        double end = head[entries];
        for (int64_t i = 1; i < entries; i++) {
            double left = i >= k ? head[i - k] : 2.0 * head[0] - head[k - i];
            double right = i + k <= entries ? head[i + k] : 2.0 * end - head[2 * entries - i - k];
            double term = left - 2.0 * head[i] + right;
            total += term * term;
        }
    }
    return total;
}

/* Add the terms of half-filled rungs and TOTDEV's reflected ends: the segment ends here. */
KERNEL(void, cascade_settle)(int64_t taken, LADDER) {
    ladder all = THE_LADDER, *l = &all;
    for (int64_t axis = 0; axis < axes; axis++) {
        for (int64_t level = 0; level < levels; level++) {
            int64_t entries = taken >> level, new = entries % BATCH, before = entries - new;
            note_marks(l, axis, level, before, new, 1);
            if (new > 0) {
                spend(l, axis, level, before, new);
                if (level + 1 < levels) promote(l, axis, level, before, new);
            }
            const double *head = head_of(l, axis, level);
            const double *tail = rung_of(l, axis, level) + BATCH - 1 + new;
            for (int64_t t = first[level]; t < first[level + 1]; t++)
                sums_of(l, axis, t)[TOTDEV] += reflected(head, tail, entries, lags[t]);
        }
    }
    for (int64_t axis = 0; axis < axes; axis++)
        for (int64_t level = 0; level < levels; level++) restore_offset(l, axis, level);
}

/* Take sums (X, Z, Q) of k blocks of 2^level samples in at a rung, as the rung below would pass
   them on; `taken` blocks of the segment came before. */
KERNEL(void, cascade_add_block_sums)
(const double *block_sums, int64_t k, int64_t level, int64_t taken, LADDER) {
    ladder all = THE_LADDER, *l = &all;
    double s = ldexp(1.0, (int)level), half = 0.5 * s * s;
    for (int64_t axis = 0; axis < axes; axis++) {
        const double *blocks = block_sums + axis * k * 3;
        if (taken == 0 && k > 0) {
            double rise = 0.0;
            for (int64_t i = 0; i < k; i++) rise += blocks[3 * i];
            *offset_of(l, axis, level) = offset_near(0.0, rise, s * (double)k);
        }
        for (int64_t done = 0, count = taken; done < k;) {
            int64_t at = BATCH + count % BATCH, size = least(ENTRIES - at, k - done);
            double *xs = rung_of(l, axis, level) + at, *zs = xs + ENTRIES, *qs = zs + ENTRIES;
            double x = xs[-1], z = zs[-1], q = qs[-1], offset = *offset_of(l, axis, level);
            for (int64_t j = 0; j < size; j++) {
                double X = blocks[3 * (done + j)], Z = blocks[3 * (done + j) + 1];
                double Q = blocks[3 * (done + j) + 2];
                with_offset(&X, &Z, &Q, 1, 1, s, -offset);
                q += s * z + half * x + Q;
                z += s * x + Z;
                x += X;
                xs[j] = x, zs[j] = z, qs[j] = q;
            }
            done += size;
            count += size;
            if (count % BATCH == 0) spend_batches(l, axis, level, count / BATCH);
        }
    }
}

/* (X, Z, Q) of each `length` of n rows of samples of all axes, less the anchor of each. */
KERNEL(void, block_sums)
(const double *samples, const double *anchor, int64_t axes, int64_t n, int64_t length, double *found) {
    for (int64_t axis = 0; axis < axes; axis++) {
        const double *own = samples + axis, zero = anchor[axis];
        for (int64_t i = 0; i < n / length; i++, found += 3) {
            double x = 0.0, z = 0.0, q = 0.0;
            for (int64_t j = i * length; j < (i + 1) * length; j++) {
                q += z + 0.5 * x;
                z += x;
                x += own[j * axes] - zero;
            }
            found[0] = x, found[1] = z, found[2] = q;
        }
    }
}

/* Fill rows (u, v) of the archive from `size` rows of samples of all axes, less the anchor of each:
   `allan/archive.py`. The samples end at `end`, behind which nothing may be read. */
#define SUMMARISE(name, type, four)                                                              \
    KERNEL(void, name)                                                                           \
    (const type *samples, const double *anchor, int64_t axes, int64_t size, double *rows,        \
     int64_t room, int64_t used, double *part, int64_t filled, int64_t stride) {                 \
        const type *end = samples + size * axes;                                                 \
        for (int64_t first = 0; first < axes; first += GROUP) {                                  \
            int64_t many = least(GROUP, axes - first), count = filled, row = used;               \
            lanes from[3][2] = {{{0.0}}}; /* u, v, anchor */                                     \
            for (int64_t a = 0; a < many; a++) {                                                 \
                const double *own = part + 2 * (first + a);                                      \
                from[0][a / LANES][a % LANES] = own[0], from[1][a / LANES][a % LANES] = own[1];  \
                from[2][a / LANES][a % LANES] = anchor[first + a];                               \
            }                                                                                    \
            lanes u0 = from[0][0], u1 = from[0][1], v0 = from[1][0], v1 = from[1][1];            \
            for (int64_t i = 0; i <= size; i++) {                                                \
                if (count == stride || i == size) {                                              \
                    from[0][0] = u0, from[0][1] = u1, from[1][0] = v0, from[1][1] = v1;          \
                    for (int64_t a = 0; a < many; a++) {                                         \
                        double *own = part + 2 * (first + a);                                    \
                        double *to = rows + 2 * (first + a) * room + row;                        \
                        own[0] = from[0][a / LANES][a % LANES];                                  \
                        own[1] = from[1][a / LANES][a % LANES];                                  \
                        if (count < stride) continue;                                            \
                        to[0] = own[0], to[room] = own[1];                                       \
                        own[0] = own[1] = 0.0;                                                   \
                    }                                                                            \
                    if (i == size) break;                                                        \
                    u0 = u1 = v0 = v1 = (lanes){0.0};                                            \
                    count = 0, row++;                                                            \
                }                                                                                \
                const type *own = samples + i * axes + first;                                    \
                type last[GROUP] = {0};                                                          \
                if (own + GROUP > end) {                                                         \
                    memcpy(last, own, (size_t)many * sizeof *own);                               \
                    own = last;                                                                  \
                }                                                                                \
                v0 += u0, v1 += u1;                                                              \
                u0 += four(own) - from[2][0], u1 += four(own + LANES) - from[2][1];              \
                count++;                                                                         \
            }                                                                                    \
        }                                                                                        \
    }

SUMMARISE(archive_summarise_int16, int16_t, four_of_int16)
SUMMARISE(archive_summarise_float64, double, four_of_float64)

/* Fill rows from sums (u, v, ...) of `size` blocks of `length` samples, `columns` numbers each. */
KERNEL(void, archive_add_blocks)
(const double *block_sums, int64_t axes, int64_t width, int64_t columns, int64_t done, int64_t size,
 int64_t length, double *rows, int64_t room, int64_t used, double *part, int64_t filled,
 int64_t stride) {
    for (int64_t axis = 0; axis < axes; axis++) {
        const double *own = block_sums + (axis * width + done) * columns;
        double *us = rows + axis * 2 * room + used, *vs = us + room;
        double u = part[2 * axis], v = part[2 * axis + 1];
        for (int64_t i = 0, count = filled; i < size; i++) {
            v += own[i * columns + 1] + (double)length * u;
            u += own[i * columns];
            count += length;
            if (count == stride) {
                *us++ = u, *vs++ = v;
                count = 0, u = 0.0, v = 0.0;
            }
        }
        part[2 * axis] = u, part[2 * axis + 1] = v;
    }
}
