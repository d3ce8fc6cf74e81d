/* Recursions along a series: a hidden telegraph signal, a tone's amplitude, a bank of poles, a running
   median. */

#include "kernels.h"

/* What n data say about a signal that hops between +size and -size: `random_telegraph.py`.
   `scalars` receives ln p(data), ln p(data, path) and the expected number of switches; `room` has
   5 n values and `came_from` 2 n. */
KERNEL(void, telegraph_posterior)
(const double *data, int64_t n, double size, double rate, double variance, double *mean,
 double *path, double *scalars, double *room, int8_t *came_from) {
    double *density = room, *forward = density + 2 * n, *scale = forward + 2 * n;
    double stay = 1.0 - rate, leave = rate;
    for (int64_t k = 0; k < n; k++) {
        double above = data[k] + size, below = data[k] - size;
        density[2 * k] = -(above * above) / (2 * variance);
        density[2 * k + 1] = -(below * below) / (2 * variance);
    }
    /* Forward: probability of each state given the samples up to it, and of all samples. */
    double log_z = 0.0;
    for (int64_t k = 0; k < n; k++) {
        const double *d = density + 2 * k, *p = forward + 2 * k - 2;
        double top = larger(d[0], d[1]), a0 = exp(d[0] - top), a1 = exp(d[1] - top);
        if (k == 0) {
            a0 = 0.5 * a0, a1 = 0.5 * a1;
        } else {
            a0 = (p[0] * stay + p[1] * leave) * a0;
            a1 = (p[0] * leave + p[1] * stay) * a1;
        }
        scale[k] = a0 + a1;
        forward[2 * k] = a0 / scale[k], forward[2 * k + 1] = a1 / scale[k];
        log_z += log(scale[k]) + top;
    }
    /* Backward: mean of each state given all samples. */
    double b0 = 1.0, b1 = 1.0, switches = 0.0;
    mean[n - 1] = forward[2 * n - 1] - forward[2 * n - 2];
    for (int64_t k = n - 2; k >= 0; k--) {
        const double *d = density + 2 * k + 2;
        double top = larger(d[0], d[1]);
        double e0 = exp(d[0] - top) * b0 / scale[k + 1], e1 = exp(d[1] - top) * b1 / scale[k + 1];
        double f0 = forward[2 * k], f1 = forward[2 * k + 1];
        switches += (f0 * e1 + f1 * e0) * leave;
        b0 = stay * e0 + leave * e1, b1 = leave * e0 + stay * e1;
        mean[k] = (f1 * b1 - f0 * b0) / (f0 * b0 + f1 * b1);
    }
    /* The most probable path (Viterbi). */
    double log_stay = log(1.0 - rate), log_leave = log(rate);
    double best0 = log(0.5) + density[0], best1 = log(0.5) + density[1];
    for (int64_t k = 1; k < n; k++) {
        double stayed0 = best0 + log_stay, hopped0 = best1 + log_leave;
        double stayed1 = best1 + log_stay, hopped1 = best0 + log_leave;
        came_from[2 * k] = hopped0 > stayed0;
        came_from[2 * k + 1] = !(hopped1 > stayed1);
        best0 = larger(stayed0, hopped0) + density[2 * k];
        best1 = larger(stayed1, hopped1) + density[2 * k + 1];
    }
    int state = best1 > best0;
    for (int64_t k = n - 1; k >= 0; k--) {
        path[k] = 2.0 * state - 1.0;
        if (k > 0) state = came_from[2 * k + state];
    }
    scalars[0] = log_z, scalars[1] = larger(best0, best1), scalars[2] = switches;
}

enum { TURNS = 1024 }; /* a wave is turned so often before it is computed anew */

/* Sum data less a mean, times exp(-i angle k), over each of `parts` parts of `size`: (re, im). */
KERNEL(void, demodulate)
(const double *data, int64_t parts, int64_t size, double mean, double angle, double *sums) {
    double turn_re = cos(-angle), turn_im = sin(-angle);
    for (int64_t part = 0; part < parts; part++) {
        double re = 0.0, im = 0.0;
        int64_t stop = (part + 1) * size;
        for (int64_t first = part * size; first < stop; first += TURNS) {
            double phase = -(angle * (double)first), wave_re = cos(phase), wave_im = sin(phase);
            for (int64_t k = first; k < least(first + TURNS, stop); k++) {
                double value = data[k] - mean, was_re = wave_re;
                re += value * wave_re;
                im += value * wave_im;
                wave_re = was_re * turn_re - wave_im * turn_im;
                wave_im = was_re * turn_im + wave_im * turn_re;
            }
        }
        sums[2 * part] = re, sums[2 * part + 1] = im;
    }
}

/* Filter n samples in place with first-order filters that share one input. */
KERNEL(void, filter_bank)
(const double *restrict poles, const double *restrict weights, int64_t count, double direct,
 double *restrict state, double *restrict samples, int64_t n) {
    for (int64_t i = 0; i < n; i++) {
        double sample = samples[i], total = direct * sample;
        for (int64_t k = 0; k < count; k++) {
            state[k] = poles[k] * state[k] + sample;
            total += weights[k] * state[k];
        }
        samples[i] = total;
    }
}

/* The medians of n windows of `size` codes, an odd number, of which `count`, all zero, has a place for
   each that occurs: how often each does in the window, and how many are below the median. */
KERNEL(void, running_median)
(const int32_t *codes, int64_t n, int64_t size, int32_t *count, int32_t *medians) {
    int64_t below = 0, half = size / 2;
    int32_t median = 0;
    for (int64_t k = 0; k < size - 1; k++) count[codes[k]]++;
    for (int64_t k = 0; k < n; k++) {
        int32_t in = codes[k + size - 1], out = codes[k];
        count[in]++;
        below += in < median;
        while (below > half) below -= count[--median];
        while (below + count[median] <= half) below += count[median++];
        medians[k] = median;
        count[out]--;
        below -= out < median;
    }
}
