/* What a block of samples is reduced to, and the tests of it: `watch/`.

   Axes lie side by side in lanes of eight, so that every loop does the same to each of them; an
   array of a spectrum is (groups of eight axes, bins, 8). Lanes without an axis hold anything. */

#include "kernels.h"

typedef float eight __attribute__((vector_size(32), aligned(4), may_alias));
typedef int32_t eight_int __attribute__((vector_size(32), aligned(4), may_alias));
typedef int16_t eight_short __attribute__((vector_size(16), aligned(2), may_alias));
typedef uint16_t eight_halves __attribute__((vector_size(16), aligned(2), may_alias));
typedef struct {
    eight re, im;
} wave; /* a complex number of each axis */

enum { AXES = 8, RUN = 64 };

#define ALL(v) ((eight){0.0f} + (float)(v))

static inline eight chosen(eight_int where, eight yes, eight no) {
    return (eight)(((eight_int)yes & where) | ((eight_int)no & ~where));
}

static inline eight lower(eight a, eight b) { return chosen(a < b, a, b); }

static inline eight higher(eight a, eight b) { return chosen(a > b, a, b); }

/* --- rows ------------------------------------------------------------------------------------ */

/* Return how many of n rows of so many bytes repeat the row before; `last` is that of the first. */
KERNEL(int64_t, watch_repeats)
(const uint8_t *rows, int64_t n, int64_t bytes, const uint8_t *last) {
    int64_t count = 0;
    for (int64_t i = 0; i < n; i++, last = rows, rows += bytes)
        if (*rows == *last && memcmp(rows, last, (size_t)bytes) == 0) count++;
    return count;
}

/* How many axes have an extreme that is so far from their mean; summed is (4, groups, 8). */
static int64_t
far_off(const double *summed, const double *reach, int64_t n, int64_t groups, int64_t axes) {
    int64_t stride = groups * AXES, count = 0;
    for (int64_t a = 0; a < axes; a++) {
        double mean = summed[a] / (double)n;
        count += summed[3 * stride + a] - mean > reach[a] || mean - summed[2 * stride + a] > reach[a];
    }
    return count;
}

/* Part rows into x (groups, n, 8), less an anchor (groups, 8), and sum them up: `summed` (4, groups,
   8) receives sums, sums of squares, the least and the most. Returns how many axes are far off. */
KERNEL(int64_t, watch_rows_int16)
(const int16_t *rows, int64_t n, int64_t axes, const double *reach, const double *anchor, float *x,
 double *summed) {
    int64_t groups = (axes + AXES - 1) / AXES, end = n * axes, stride = groups * AXES;
    for (int64_t g = 0; g < groups; g++) {
        eight_int zero = {0};
        eight low = ALL(INFINITY), high = ALL(-INFINITY);
        double *to = summed + AXES * g;
        for (int a = 0; a < AXES; a++) {
            zero[a] = (int32_t)anchor[AXES * g + a];
            to[a] = to[stride + a] = 0.0;
        }
        for (int64_t run = 0; run < n; run += RUN) {
            eight_int sum = {0};
            eight square = ALL(0.0f);
            for (int64_t i = run; i < least(run + RUN, n); i++, x += AXES) {
                int64_t at = i * axes + AXES * g;
                eight_short row = {0};
                if (at + AXES <= end) row = *(const eight_short *)(rows + at);
                else memcpy(&row, rows + at, (size_t)(end - at) * sizeof *rows);
                eight_int whole = __builtin_convertvector(row, eight_int) - zero;
                eight value = __builtin_convertvector(whole, eight);
                sum += whole;
                square += value * value;
                low = lower(value, low), high = higher(value, high);
                *(eight *)x = value;
            }
            for (int a = 0; a < AXES; a++) to[a] += sum[a], to[stride + a] += square[a];
        }
        for (int a = 0; a < AXES; a++) to[2 * stride + a] = low[a], to[3 * stride + a] = high[a];
    }
    return far_off(summed, reach, n, groups, axes);
}

/* The same of rows of float64. */
KERNEL(int64_t, watch_rows_float64)
(const double *rows, int64_t n, int64_t axes, const double *reach, const double *anchor, float *x,
 double *summed) {
    int64_t groups = (axes + AXES - 1) / AXES, stride = groups * AXES;
    for (int64_t g = 0; g < groups; g++) {
        int64_t here = least(AXES, axes - AXES * g);
        double *to = summed + AXES * g;
        for (int a = 0; a < AXES; a++) {
            to[a] = to[stride + a] = 0.0;
            to[2 * stride + a] = INFINITY, to[3 * stride + a] = -INFINITY;
        }
        for (int64_t i = 0; i < n; i++, x += AXES)
            for (int a = 0; a < AXES; a++) {
                int64_t at = i * axes + AXES * g + a;
                double value = a < here ? rows[at] - anchor[AXES * g + a] : 0.0;
                to[a] += value;
                to[stride + a] += value * value;
                if (value < to[2 * stride + a]) to[2 * stride + a] = value;
                if (value > to[3 * stride + a]) to[3 * stride + a] = value;
                x[a] = (float)value;
            }
    }
    return far_off(summed, reach, n, groups, axes);
}

/* What the sums of n rows say: levels (groups, 8), and a spread that moves by one over `memory` of what
   it is off, by little of what is much more than it was; `reach` is `times` the spread. The anchor of
   the next rows lies at the mean, which was there before outliers were replaced. */
KERNEL(void, watch_levels)
(int64_t groups, int64_t n, int64_t is_early, int64_t memory, double times, double *summed, double *mean,
 double *anchor, double *spread, double *level, double *reach) {
    for (int64_t i = 0; i < groups * AXES; i++) {
        double total = summed[i] / (double)n, square = summed[groups * AXES + i] / (double)n;
        double calm = sqrt(larger(square - total * total, 0.0)), most = 1.5 * spread[i];
        if (!is_early && calm > most) calm = most;
        spread[i] += (calm - spread[i]) / (double)memory;
        reach[i] = times * spread[i];
        level[i] = anchor[i] + total;
        anchor[i] = rint(anchor[i] + mean[i]);
    }
}

/* --- spectrum -------------------------------------------------------------------------------- */

static inline wave plus(wave a, wave b) { return (wave){a.re + b.re, a.im + b.im}; }

static inline wave minus(wave a, wave b) { return (wave){a.re - b.re, a.im - b.im}; }

static inline wave times(wave a, float s) { return (wave){a.re * s, a.im * s}; }

static inline wave turned(wave a) { return (wave){a.im, -a.re}; } /* times -i */

static inline wave by(wave a, const float *w) {
    return (wave){a.re * w[0] - a.im * w[1], a.re * w[1] + a.im * w[0]};
}

/* Replace `radix` values by their discrete Fourier transform. */
static inline __attribute__((always_inline)) void butterfly(wave *v, int radix) {
    if (radix == 2) {
        wave a = v[0];
        v[0] = plus(a, v[1]), v[1] = minus(a, v[1]);
    } else if (radix == 3) {
        wave sum = plus(v[1], v[2]), middle = minus(v[0], times(sum, 0.5f));
        wave beside = turned(times(minus(v[1], v[2]), 0.866025403784438647f));
        v[0] = plus(v[0], sum), v[1] = plus(middle, beside), v[2] = minus(middle, beside);
    } else if (radix == 4) {
        wave a = plus(v[0], v[2]), b = minus(v[0], v[2]), c = plus(v[1], v[3]);
        wave d = turned(minus(v[1], v[3]));
        v[0] = plus(a, c), v[1] = plus(b, d), v[2] = minus(a, c), v[3] = minus(b, d);
    } else {
        const float c1 = 0.309016994374947424f, s1 = 0.951056516295153572f;
        const float c2 = -0.809016994374947424f, s2 = 0.587785252292473129f;
        wave a = plus(v[1], v[4]), b = plus(v[2], v[3]);
        wave c = minus(v[1], v[4]), d = minus(v[2], v[3]);
        wave near = plus(v[0], plus(times(a, c1), times(b, c2)));
        wave far = plus(v[0], plus(times(a, c2), times(b, c1)));
        wave e = turned(plus(times(c, s1), times(d, s2)));
        wave f = turned(minus(times(c, s2), times(d, s1)));
        v[0] = plus(v[0], plus(a, b)), v[1] = plus(near, e), v[4] = minus(near, e);
        v[2] = plus(far, f), v[3] = minus(far, f);
    }
}

/* One step of a transform of n = radix * parts * stride values, in their order (Stockham). */
static inline __attribute__((always_inline)) void
step(const wave *in, wave *out, int radix, int64_t parts, int64_t stride, const float *turns) {
    for (int64_t p = 0; p < parts; p++) {
        for (int64_t q = 0; q < stride; q++) {
            wave v[5];
            for (int k = 0; k < radix; k++) v[k] = in[q + stride * (p + k * parts)];
            butterfly(v, radix);
            wave *to = out + q + stride * radix * p;
            to[0] = v[0];
            for (int j = 1; j < radix; j++) to[stride * j] = by(v[j], turns + 2 * j * p * stride);
        }
    }
}

/* Transform n values; `turns` are exp(-2 pi i k / n). Returns which of the two has the result. */
static wave *transform(
    wave *x, wave *room, int64_t n, const int64_t *radices, int64_t steps, const float *turns) {
    int64_t stride = 1;
    for (int64_t i = 0; i < steps; i++) {
        int64_t parts = n / (stride * radices[i]);
        if (radices[i] == 4) step(x, room, 4, parts, stride, turns);
        else if (radices[i] == 5) step(x, room, 5, parts, stride, turns);
        else if (radices[i] == 3) step(x, room, 3, parts, stride, turns);
        else step(x, room, 2, parts, stride, turns);
        stride *= radices[i];
        wave *other = x;
        x = room, room = other;
    }
    return x;
}

/* Bin k of the spectrum of 2 n real values, which were taken for n complex ones; 0 < k < n. */
static inline wave bin_of(const wave *z, int64_t n, int64_t k, const float *halves) {
    wave here = z[k], there = {z[n - k].re, -z[n - k].im};
    return plus(
        times(plus(here, there), 0.5f),
        by(turned(times(minus(here, there), 0.5f)), halves + 2 * k));
}

static inline eight square_of(wave a) { return a.re * a.re + a.im * a.im; }

/* Take the spectra of x (groups, rows, 8), of which 2 n rows are transformed and overwritten.

   `ratio` (groups, bins, 8) receives the power with a Hann window, bins from `first` on, over
   `power`, which then moves by `gain` where it is not `held` (all bits set), `most` times itself at
   most. `bands` (groups, 2, many, 8) receives means of the power without a window, and of the
   ratio, over bins from `edges[i]` to `edges[i + 1]`. */
KERNEL(void, watch_spectrum)
(int64_t groups, int64_t rows, int64_t n, int64_t steps, int64_t first, int64_t many, double gain,
 double most, const int32_t *held, const int64_t *radices, const float *turns, const float *halves,
 const int64_t *edges, float *x, float *room, float *power, float *ratio, float *bands) {
    for (int64_t g = 0; g < groups; g++, x += rows * AXES, bands += 2 * many * AXES) {
        const wave *z = transform((wave *)x, (wave *)room, n, radices, steps, turns);
        wave before = bin_of(z, n, first - 1, halves), here = bin_of(z, n, first, halves);
        for (int64_t band = 0; band < many; band++) {
            eight plain = ALL(0.0f), over = ALL(0.0f);
            for (int64_t k = edges[band]; k < edges[band + 1]; k++) {
                wave after = bin_of(z, n, first + k + 1, halves);
                wave beside = times(plus(before, after), 0.25f);
                eight now = square_of(minus(times(here, 0.5f), beside)), usual = *(eight *)power;
                eight share = now / (usual + 1e-20f);
                eight move = lower(usual * (float)most, now) - usual;
                move = (eight)((eight_int)move & ~*(const eight_int *)held);
                *(eight *)power = usual + move * (float)gain;
                *(eight *)ratio = share;
                plain += square_of(here);
                over += share;
                before = here, here = after;
                power += AXES, ratio += AXES, held += AXES;
            }
            float width = (float)(edges[band + 1] - edges[band]);
            *(eight *)(bands + AXES * band) = plain / width;
            *(eight *)(bands + AXES * (many + band)) = over / width;
        }
    }
}

/* Least first. */
static void sort(double *v, int64_t n) {
    for (int64_t i = 1; i < n; i++) {
        double value = v[i];
        int64_t k = i;
        for (; k > 0 && v[k - 1] > value; k--) v[k] = v[k - 1];
        v[k] = value;
    }
}

static double trimmed_mean(double *v, int64_t n, int64_t trim) {
    double sum = 0.0;
    sort(v, n);
    for (int64_t i = trim; i < n - trim; i++) sum += v[i];
    return sum / (double)(n - 2 * trim);
}

enum { MOST_BANDS = 16 };

/* What bands (groups, 2, many, 8) say of the noise of axes: 3 (r^(1/3) - 1) of its power r against
   `usual` (groups, many, 8), logs that move by `gain` where the noise is no `other`; and one over
   the level of the ratios, its mean over 16 blocks or, of a knock, that of this one. A trimmed mean
   is less than the mean; so the level is held against what it usually is, `rest`. */
KERNEL(void, watch_noise)
(int64_t groups, int64_t many, int64_t trim, int64_t is_first, double gain, double knock,
 const uint8_t *other, const float *bands, double *usual, float *level, float *rest, double *noise,
 float *scale) {
    double values[MOST_BANDS];
    for (int64_t g = 0; g < groups; g++, bands += 2 * many * AXES, usual += many * AXES)
        for (int64_t a = 0; a < AXES; a++) {
            int64_t axis = AXES * g + a;
            for (int64_t i = 0; i < many; i++) {
                double power = log((double)bands[i * AXES + a] + 1e-20), *was = usual + i * AXES + a;
                if (is_first) *was = power;
                double away = power - *was;
                /* The cube root of a power is as good as normal (Wilson and Hilferty). */
                values[i] = 3.0 * expm1(away / 3.0);
                if (!other[axis]) *was += gain * (away < -2.0 ? -2.0 : away > 2.0 ? 2.0 : away);
            }
            noise[axis] = trimmed_mean(values, many, trim);
            for (int64_t i = 0; i < many; i++)
                values[i] = is_first ? 1.0 : (double)bands[(many + i) * AXES + a];
            double over = trimmed_mean(values, many, trim), mean = (double)level[axis];
            double at_rest = (double)rest[axis], calm = over < 2.0 * at_rest ? over : 2.0 * at_rest;
            if (!other[axis]) at_rest += gain * (calm - at_rest);
            rest[axis] = (float)at_rest;
            mean += ((over < 2.0 * mean ? over : 2.0 * mean) - mean) / 16.0;
            level[axis] = (float)mean;
            if (over > knock * mean) mean = over;
            scale[axis] = (float)(at_rest / (mean > 0.05 ? mean : 0.05));
        }
}

/* --- lines ----------------------------------------------------------------------------------- */

static inline eight root_of(eight v) {
    eight root;
    for (int i = 0; i < AXES; i++) root[i] = sqrtf(v[i]);
    return root;
}

/* Numbers from 0 to 65504 in half precision, ties to even: one below 2^-14, the least normal, is rounded
   to a multiple of 2^-24 by the addition of 0.5. */
static inline eight_halves halves_of(eight v) {
    eight_int bits = (eight_int)v, half = (eight_int)ALL(0.5f);
    eight_int normal = (bits + 0xFFF + ((bits >> 13) & 1) - (112 << 23)) >> 13;
    eight_int small = (eight_int)(v + 0.5f) - half;
    eight_int chosen_bits = (eight_int)chosen(v < 0x1p-14f, (eight)small, (eight)normal);
    return __builtin_convertvector(chosen_bits, eight_halves);
}

/* Add what the ratios of a block say to the sums of weak and of clear lines (2, groups, bins, 8):
   gains[0] of a ratio less gains[1], and gains[2] of its root less gains[3].

   A ratio counts `scale` (groups, 8) times, `cap` at most, and for less where its mean square,
   `spread`, is over that of exponential deviates by more than `uncertain`. A sum that falls to zero
   begins anew at block `now`. `tops` (2, groups, 8) receives the largest sums, `kept` the scaled
   ratios, `most_kept` at most, in half precision. Before `is_on`, only the spread is learned. */
KERNEL(void, watch_lines)
(int64_t groups, int64_t bins, double gain, int64_t now, int64_t is_on, const float *ratio,
 const float *scale, const int32_t *held, double cap, double uncertain, double most_kept,
 uint16_t *kept, const float *gains, float *spread, float *sums, int32_t *since, float *tops) {
    int64_t all_bins = groups * bins * AXES;
    eight limit = ALL((float)cap), most = ALL(6.0f), none = ALL(0.0f), one = ALL(1.0f);
    eight largest = ALL((float)most_kept);
    eight error = ALL((float)uncertain);
    eight_int block = (eight_int){0} + (int32_t)now;
    for (int64_t g = 0; g < groups; g++, tops += AXES, scale += AXES) {
        eight top0 = none, top1 = none, level = *(const eight *)scale;
        for (int64_t k = 0; k < bins; k++, ratio += AXES, held += AXES, spread += AXES, kept += AXES) {
            eight scaled = *(const eight *)ratio * level, value = lower(scaled, limit), wide = *(eight *)spread;
            *(eight_halves *)kept = halves_of(lower(scaled, largest));
            eight mild = lower(value, most);
            wide += (mild * mild * 0.5f - wide) * (float)gain;
            *(eight *)spread = wide;
            if (is_on) {
                value /= higher(wide - error, one);
                eight sum0 = *(eight *)sums + (value * gains[0] - gains[1]);
                eight sum1 = *(eight *)(sums + all_bins) + (root_of(value) * gains[2] - gains[3]);
                eight_int known = *(const eight_int *)held;
                eight_int begun0 = (sum0 > none) & ~known, begun1 = (sum1 > none) & ~known;
                sum0 = (eight)((eight_int)sum0 & begun0), sum1 = (eight)((eight_int)sum1 & begun1);
                eight_int *from0 = (eight_int *)since, *from1 = (eight_int *)(since + all_bins);
                *from0 = (*from0 & begun0) | (block & ~begun0);
                *from1 = (*from1 & begun1) | (block & ~begun1);
                *(eight *)sums = sum0, *(eight *)(sums + all_bins) = sum1;
                top0 = higher(sum0, top0), top1 = higher(sum1, top1);
                sums += AXES, since += AXES;
            }
        }
        *(eight *)tops = top0, *(eight *)(tops + groups * AXES) = top1;
    }
}

/* --- scan ------------------------------------------------------------------------------------ */

/* part / whole, at most `most`, also where the whole is nothing. */
static double share_of(double part, double whole, double most) {
    if (!(part > 0.0)) return 0.0;
    return whole > 0.0 && part < most * whole ? part / whole : most;
}

static double less_of(double a, double b) { return b < a ? b : a; }

static double tail_of(double deviate, double dof) {
    double normal = (8.0 * dof + 1.0) / (8.0 * dof + 3.0)
                  * sqrt(dof * log1p(deviate * deviate / dof));
    double tail = 0.661 * normal + 0.339 * sqrt(normal * normal + 5.51);
    return normal * normal / 2.0 + log(1.2533141373155001 * tail);
}

/* -log of the two-sided tail of a t distribution, to a few per cent: Wallace's transformation to a
   normal deviate (1959), and the bound of Borjesson and Sundberg on the tail of that. */
KERNEL(double, log_tail)(double deviate, double dof) { return tail_of(deviate, dof); }

/* In the order of `_CONSTANTS` in `scan.py`. */
typedef struct {
    double clip, winsor, fewest, borrowed, lent, ring, delay, memory, settled;
} rules;

/* A look: the mean of so many blocks less that of those before, at least `least` of them. */
typedef struct {
    int64_t window, before, least, step;
} look;

static double per_block(const look *a) {
    return 1.0 / (double)a->window + 1.0 / (double)a->before;
}

/* -log of the p-value of a difference; 0 where it is less than the limit, or not to be judged. */
static double
judged(double difference, const look *a, const rules *is, double white, double own, double fourth,
       double looks, double limit, double *deviate) {
    double smallest = white > 0.0 && white < own ? white : own;
    double bound = difference * difference / smallest;
    /* No tail is thinner than that of a normal deviate of the smaller scale. */
    if (!(own > 0.0) || bound / 2.0 + sqrt(bound) + 0.3 < limit) return 0.0;
    /* Of white noise, differences a window apart have nothing in common; of flicker and random
       walk, what came before is in all of them. */
    double coloured = 1.0 - share_of(white, own, 1.0), window = (double)a->window;
    double kept = less_of(looks, 2.0 * is->memory); /* as many as an average that forgets has */
    double dof = kept * (double)a->step / (window + coloured * (window + (double)a->before / 4.0));
    if (dof < is->fewest) return 0.0;
    /* Where nothing speaks against white noise, short windows tell of the long ones. */
    double lent = own < white * (1.0 + sqrt(2.0 / dof)) ? less_of(is->borrowed, is->lent * dof) : 0.0;
    double heavy = fourth - 3.0 - 2.0 * sqrt(24.0 / dof);
    double tails = 4.0 + 6.0 / (heavy > 0.005 ? heavy : 0.005);
    *deviate = difference / sqrt((dof * own + lent * white) / (dof + lent));
    return tail_of(*deviate, less_of(dof + lent, tails));
}

/* Take the values of block `at` (channels) and return how many alarms there are. `found` (channels, 4) receives window, deviate and nats
   of an alarm, and by how much these exceed the limit, which is not above zero where there is none.
   `room` has (windows, channels). */
KERNEL(int64_t, scan_block)
(const double *values, int64_t channels, int64_t at, int64_t many, double log_weight,
 const int64_t *windows, const double *constants, const double *log_alpha, const int64_t *start,
 double *sums, double *raw, double *square, double *fourth, double *looks, double *pending,
 double *room, double *found) {
    const rules *is = (const rules *)constants;
    const look *all_looks = (const look *)windows;
    int64_t ring = (int64_t)is->ring, delay = (int64_t)is->delay, now = at + 1;
    double *here = sums + now % ring * channels, *last = sums + at % ring * channels;
    double shortest = per_block(all_looks);
    for (int64_t c = 0; c < channels; c++) {
        double value = values[c];
        int64_t before = least(at - start[c], all_looks->before);
        raw[at % ring * channels + c] = value;
        if (before >= (start[c] ? (int64_t)is->settled : all_looks->before)
            && looks[c] >= is->fewest) {
            double past = last[c] - sums[(at - before) % ring * channels + c];
            double centre = past / (double)before, reach = is->clip * sqrt(square[c] / shortest);
            if (value < centre - reach) value = centre - reach;
            if (value > centre + reach) value = centre + reach;
        }
        here[c] = last[c] + value;
        found[4 * c] = found[4 * c + 1] = found[4 * c + 2] = found[4 * c + 3] = 0.0;
    }
    for (int64_t w = 0; w < many; w++) {
        const look *a = all_looks + w;
        if (now % a->step || now < a->window + a->least) continue;
        const double *middle = sums + (now - a->window) % ring * channels;
        double white = per_block(a) / shortest;
        for (int64_t c = 0; c < channels; c++) {
            int64_t i = w * channels + c;
            double limit = -(log_alpha[i] + log_weight), deviate = 0.0, nats = 0.0;
            int64_t before = least(now - a->window - start[c], a->before);
            int64_t needed = start[c] ? least(2 * a->window + (int64_t)is->settled, a->least)
                                      : a->least;
            room[i] = NAN;
            if (before >= needed) {
                const double *first = sums + (now - a->window - before) % ring * channels;
                double difference = (here[c] - middle[c]) / (double)a->window
                                  - (middle[c] - first[c]) / (double)before;
                if (before < a->before) {
                    look own = {a->window, before, before, a->step};
                    difference *= sqrt(per_block(a) / per_block(&own));
                }
                if (before >= a->least) room[i] = difference;
                nats = judged(difference, a, is, white * square[c], square[i], fourth[i], looks[i],
                              limit, &deviate);
            }
            if (nats - limit > found[4 * c + 3] && nats > 0.0) {
                found[4 * c] = (double)a->window, found[4 * c + 1] = deviate;
                found[4 * c + 2] = nats, found[4 * c + 3] = nats - limit;
            }
        }
    }
    for (int64_t c = 0; c < channels; c++)
        if (found[4 * c + 3] > 0.0)
            for (int64_t i = c; i < delay * many * channels; i += channels) pending[i] = NAN;
    for (int64_t w = 0; w < many; w++) {
        const look *a = all_looks + w;
        if (now % a->step || now < a->window + a->least) continue;
        double *row = pending + (now / a->step % delay * many + w) * channels;
        for (int64_t c = 0; c < channels; c++) {
            int64_t i = w * channels + c;
            /* A look of long ago that no alarm has followed may move the scales. */
            double before = row[c];
            row[c] = found[4 * c + 3] > 0.0 ? NAN : room[i];
            if (before != before) continue;
            double usual = square[i], new = before * before, seen = looks[i] + 1.0;
            double gain = 1.0 / less_of(seen, is->memory), peak = share_of(new, usual, 16.0);
            double calm = seen <= 16.0 ? new : less_of(new, is->winsor * usual);
            square[i] = usual + gain * (calm - usual);
            fourth[i] += gain * ((seen <= 16.0 ? 3.0 : peak * peak) - fourth[i]);
            looks[i] = seen;
        }
    }
    int64_t alarms = 0;
    for (int64_t c = 0; c < channels; c++) alarms += found[4 * c + 3] > 0.0;
    return alarms;
}
