/* Spectra at many frequencies. Of noise whose autocovariance is a sum of exponentials:
   `noise/components/correlated.py`. A pole p of amplitude a has the rate e = -ln p; `gap` is
   2 sinh^2(e / 2), so that gap + 2 sin^2(w / 2) = cosh e - cos w. */

#include "kernels.h"

/* Add Re(above / (gap + square)), above = a sinh e. */
KERNEL(void, pole_spectrum)
(const double *square, int64_t n, double above_real, double above_imag, double gap_real,
 double gap_imag, double *total) {
    for (int64_t i = 0; i < n; i++) {
        double x = gap_real + square[i], y = gap_imag;
        total[i] += (above_real * x + above_imag * y) / (x * x + y * y);
    }
}

/* Add Re(a (sinh e - ends / (gap + square)) / (gap + square)) with
   ends = (1 - sign exp(-e rows)) gap (2 - square) / rows. */
KERNEL(void, pole_ordinates)
(const double *square, const double *sign, int64_t n, double rows, double a_real, double a_imag,
 double sinh_real, double sinh_imag, double gap_real, double gap_imag, double last_real,
 double last_imag, double *total) {
    for (int64_t i = 0; i < n; i++) {
        double x = gap_real + square[i], y = gap_imag, norm = x * x + y * y;
        double share = (2.0 - square[i]) / rows;
        double one_real = 1.0 - sign[i] * last_real, one_imag = -sign[i] * last_imag;
        double ends_real = (one_real * gap_real - one_imag * gap_imag) * share;
        double ends_imag = (one_real * gap_imag + one_imag * gap_real) * share;
        double left_real = sinh_real - (ends_real * x + ends_imag * y) / norm;
        double left_imag = sinh_imag - (ends_imag * x - ends_real * y) / norm;
        double top_real = a_real * left_real - a_imag * left_imag;
        double top_imag = a_real * left_imag + a_imag * left_real;
        total[i] += (top_real * x + top_imag * y) / norm;
    }
}

/* Sum ln v + power / v over n bins, v = beside + white + tilt (1 - square) and what so many poles of
   (weight, above, gap) give. */
KERNEL(double, pole_misfit)
(const double *square, const double *power, const double *beside, int64_t n, double white,
 double tilt, const double *poles, int64_t count) {
    lanes total = {0.0};
    for (int64_t i = 0; i < n; i += LANES) {
        lanes at = some_of(square, i, n, 0.0);
        lanes variance = some_of(beside, i, n, 1.0) + white + tilt * (1.0 - at);
        for (const double *pole = poles; pole < poles + 5 * count; pole += 5) {
            lanes x = pole[3] + at;
            double y = pole[4];
            variance += pole[0] * ((pole[1] * x + pole[2] * y) / (x * x + y * y));
        }
        lanes own = log_of(variance) + some_of(power, i, n, 0.0) / variance;
        for (int64_t b = n - i; b < LANES; b++) own[b] = 0.0;
        total += own;
    }
    return sum_of(total);
}

/* Numbers at 1, 2, ... n, of which the logarithm is linear between so many nodes: `noise/grid.py`. */
KERNEL(void, between_logarithms)
(const double *nodes, const double *logarithms, int64_t count, int64_t n, double *found) {
    enum { AGAIN = 64 };
    int64_t k = 1;
    for (int64_t j = 0; j + 1 < count; j++) {
        double slope = (logarithms[j + 1] - logarithms[j]) / (nodes[j + 1] - nodes[j]);
        double ratio = exp(slope), value = 0.0;
        for (int64_t left = 0; k <= n && (double)k <= nodes[j + 1]; k++, left--) {
            if (left == 0) { /* rounding does not build up */
                value = exp(logarithms[j] + slope * ((double)k - nodes[j]));
                left = AGAIN;
            }
            found[k - 1] = value;
            value *= ratio;
        }
    }
}
