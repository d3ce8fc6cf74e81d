/* Estimators from every term there is: `allan/estimators`. */

#include "kernels.h"

enum { WINDOWS = 4 };

/* Sum of (x[i] - 2 x[i+m] + x[i+2m])^2, i = 0, stride, ... */
KERNEL(double, squares_of_second)(const double *x, int64_t n, int64_t m, int64_t stride) {
    lanes in_lanes = {0.0};
    int64_t i = 0;
    for (; stride == 1 && i + LANES <= n - 2 * m; i += LANES) {
        lanes middle = *(const lanes *)(x + i + m);
        lanes term = (*(const lanes *)(x + i) - middle) + (*(const lanes *)(x + i + 2 * m) - middle);
        in_lanes += term * term;
    }
    double total = sum_of(in_lanes);
    for (; i < n - 2 * m; i += stride) {
        double difference = (x[i] - x[i + m]) + (x[i + 2 * m] - x[i + m]);
        total += difference * difference;
    }
    return total;
}

/* Sum of (x[i] - 3 x[i+m] + 3 x[i+2m] - x[i+3m])^2. */
KERNEL(double, squares_of_third)(const double *x, int64_t n, int64_t m, int64_t stride) {
    lanes in_lanes = {0.0};
    int64_t i = 0;
    for (; stride == 1 && i + LANES <= n - 3 * m; i += LANES) {
        lanes inner = *(const lanes *)(x + i + 2 * m) - *(const lanes *)(x + i + m);
        lanes term = (*(const lanes *)(x + i) - *(const lanes *)(x + i + 3 * m)) + 3.0 * inner;
        in_lanes += term * term;
    }
    double total = sum_of(in_lanes);
    for (; i < n - 3 * m; i += stride) {
        double difference = (x[i] - x[i + 3 * m]) + 3.0 * (x[i + 2 * m] - x[i + m]);
        total += difference * difference;
    }
    return total;
}

/* Sum of squares of sums over m second differences at lag m, `terms` of them, one at least. */
KERNEL(double, squares_of_sums)(const double *x, int64_t m, int64_t terms) {
    double window = 0.0;
    for (int64_t j = 0; j < m; j++) window += (x[j] - x[j + m]) + (x[j + 2 * m] - x[j + m]);
    double total = window * window;
    for (int64_t i = 1; i < terms; i++) {
        window += (x[i + 3 * m - 1] - x[i - 1]) - 3.0 * (x[i + 2 * m - 1] - x[i + m - 1]);
        total += window * window;
    }
    return total;
}

/* Sum of (sum_k ((m - 1)/2 - k) u[i + k])^2 over the first `terms` i; u has m values more. */
KERNEL(double, squares_of_slopes)(const double *u, int64_t m, int64_t terms) {
    double total = 0.0, plain = 0.0, weighted = 0.0;
    for (int64_t k = 0; k < m; k++) {
        plain += u[k];
        weighted += (double)k * u[k];
    }
    for (int64_t i = 0; i < terms; i++) {
        double slope = 0.5 * (double)(m - 1) * plain - weighted;
        total += slope * slope;
        plain += u[i + m] - u[i];
        weighted += (double)m * u[i + m] - plain;
    }
    return total;
}

/* The running sum of a detrended window of `length` values and of half its mirror images; `below`
   has 0 + 1 + ... up to before each index. */
static void mirror(
    const double *running, const double *below, int64_t length, double *restrict sums) {
    int64_t half = length / 2;
    double base = running[0];
    double rise = (running[length] - running[length - half]) - (running[half] - base);
    double slope = rise / (double)(half * (length - half));
    double *window = sums + half, *after = window + length;
    for (int64_t k = 0; k <= length; k++)
        window[k] = (running[k] - base) - slope * below[k];
    double end = 2.0 * window[length];
    for (int64_t k = 0; k < half; k++) {
        sums[k] = -window[half - k];
        after[k + 1] = end - window[length - 1 - k];
    }
}

static double mirrored_square(const double *p, int64_t m) {
    double term = (p[3 * m] - p[0]) - 3.0 * (p[2 * m] - p[m]);
    return term * term;
}

/* Sum over windows, begun at every `stride`, of the mean square of the second difference of
   m-means: `allan/estimators/reflected.py`. `room` has 4 length + 2 half + 3 values. */
KERNEL(double, reflected_squares)
(const double *values, int64_t n, int64_t m, int64_t stride, double *room) {
    int64_t length = 3 * m, half = length / 2, origin = -length, count = 2 * half + 1;
    double *running = room, *below = running + 2 * length + 1, *sums = below + length + 1;
    double total = 0.0;
    running[0] = 0.0;
    for (int64_t k = 0; k <= length; k++) below[k] = (double)k * ((double)k - 1.0) / 2.0;
    for (int64_t start = 0; start < n - length + 1; start += stride) {
        if (start >= origin + length) {
            /* Start the running sum afresh, from a value near by, so that it stays small. */
            origin = start;
            for (int64_t k = 0; k < least(2 * length, n - origin); k++)
                running[k + 1] = running[k] + (values[origin + k] - values[origin]);
        }
        mirror(running + (start - origin), below, length, sums);
        lanes squares_in_lanes = {0.0};
        int64_t j = 0;
        for (; j + LANES <= count; j += LANES) {
            const double *p = sums + j;
            lanes term = (*(const lanes *)(p + 3 * m) - *(const lanes *)p)
                         - 3.0 * (*(const lanes *)(p + 2 * m) - *(const lanes *)(p + m));
            squares_in_lanes += term * term;
        }
        double squares = sum_of(squares_in_lanes);
        for (; j < count; j++) squares += mirrored_square(sums + j, m);
        squares *= 2.0;
        /* Both ends are their own mirror images where there are such. */
        if (m % 2 == 0) squares -= mirrored_square(sums, m) + mirrored_square(sums + 2 * half, m);
        total += squares / (6.0 * (double)m);
    }
    return total;
}

/* THEO1's sums over `count` windows begun at every `stride` from i on: side by side, because each
   waits for its own last sum. */
static inline void theo1_windows(
    const double *x, const double *backward, const double *weight, int64_t n, int64_t m, int64_t i,
    int64_t stride, int count, double *squares) {
    int64_t half = m / 2, v = 0;
    lanes in_lanes[WINDOWS];
    for (int w = 0; w < count; w++) in_lanes[w] = (lanes){0.0};
    for (; v + LANES <= half; v += LANES)
        for (int w = 0; w < count; w++) {
            int64_t at = i + w * stride;
            lanes term = (x[at] + x[at + m]) - *(const lanes *)(x + at + 1 + v)
                         - *(const lanes *)(backward + (n - m - at) + v);
            in_lanes[w] += *(const lanes *)(weight + v) * (term * term);
        }
    for (int w = 0; w < count; w++) {
        int64_t at = i + w * stride;
        squares[w] = sum_of(in_lanes[w]);
        for (int64_t k = v; k < half; k++) {
            double term = (x[at] + x[at + m]) - x[at + 1 + k] - backward[n - m - at + k];
            squares[w] += weight[k] * (term * term);
        }
    }
}

/* THEO1's sum: x read forwards and `backward`, weights 1/v. */
KERNEL(double, theo1_squares)
(const double *x, const double *backward, const double *weight, int64_t n, int64_t m,
 int64_t stride) {
    double total = 0.0, squares[WINDOWS];
    int64_t i = 0;
    for (; i + (WINDOWS - 1) * stride < n - m; i += WINDOWS * stride) {
        theo1_windows(x, backward, weight, n, m, i, stride, WINDOWS, squares);
        for (int w = 0; w < WINDOWS; w++) total += squares[w];
    }
    for (; i < n - m; i += stride) {
        theo1_windows(x, backward, weight, n, m, i, stride, 1, squares);
        total += squares[0];
    }
    return total;
}

/* What `steps` of THEO1 at windows of 12 + 4 i are to OAVAR at the same tau: `ratios`, NaN where
   THEO1 is 0. A window begins at every `window / per_tau`-th phase. */
KERNEL(void, theobr_ratios)
(const double *x, const double *backward, const double *weight, int64_t n, const int64_t *steps,
 int64_t count, int64_t per_tau, double *ratios) {
    for (int64_t k = 0; k < count; k++) {
        int64_t m = 9 + 3 * steps[k], window = 12 + 4 * steps[k];
        int64_t stride = window / per_tau > 1 ? window / per_tau : 1;
        double square = (double)m * (double)m, wide = (double)window * (double)window;
        double allan = JOINED(squares_of_second, LEVEL)(x, n, m, 1) / (double)(n - 2 * m);
        double windows = (double)((n - window - 1) / stride + 1);
        double theo1 = JOINED(theo1_squares, LEVEL)(x, backward, weight, n, window, stride);
        theo1 /= 0.75 * windows * wide;
        ratios[k] = theo1 > 0.0 ? allan / (2.0 * square) / theo1 : (double)NAN;
    }
}

/* Sum over windows, begun at every `stride`, of THEO1's squares at each distance v, k // 2 of them;
   added to `profile`, a few windows at a time, so that it is read and written less often. */
KERNEL(void, theo1_profile)
(const double *restrict x, const double *restrict backward, int64_t n, int64_t k, int64_t stride,
 double *restrict profile) {
    int64_t half = k / 2, windows = n - k, i = 0;
    for (; i + (WINDOWS - 1) * stride < windows; i += WINDOWS * stride) {
        const double *left = x + i + 1, *right = backward + (windows - i);
        double ends[WINDOWS];
        for (int w = 0; w < WINDOWS; w++) ends[w] = x[i + w * stride] + x[i + w * stride + k];
        for (int64_t v = 0; v < half; v++) {
            double sum = profile[v];
            for (int w = 0; w < WINDOWS; w++) {
                double term = ends[w] - left[v + w * stride] - right[v - w * stride];
                sum += term * term;
            }
            profile[v] = sum;
        }
    }
    for (; i < windows; i += stride) {
        double ends = x[i] + x[i + k];
        const double *left = x + i + 1, *right = backward + (windows - i);
        for (int64_t v = 0; v < half; v++) {
            double term = ends - left[v] - right[v];
            profile[v] += term * term;
        }
    }
}
