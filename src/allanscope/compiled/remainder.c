/* The maximum of a penalised Whittle likelihood of a smooth log-ratio: `noise/remainder.py`. */

#include "kernels.h"

enum { NEWTON_STEPS = 30 };
static const double LAST_GAIN = 1e-6; /* nats below which a step is the last one */
static const double LEAST_FRACTION = 1e-4;

/* Ratios of power to expectation, `half` their degrees of freedom over 2; s is linear between nodes.
   Matrices are symmetric and banded: row p holds what is p below the diagonal. */
typedef struct {
    const int64_t *left;
    const double *share, *ratio, *half, *prior;
    int64_t bins, bands, k;
} smooth;

/* Decompose a banded matrix after Cholesky; return the logarithm of its determinant, NaN where it is
   not positive. */
static double decompose(const double *matrix, int64_t bands, int64_t k, double *factor) {
    double log_determinant = 0.0;
    for (int64_t j = 0; j < k; j++)
        for (int64_t q = 0; q < bands && j + q < k; q++) {
            double rest = matrix[q * k + j];
            for (int64_t p = 1; p + q < bands && p <= j; p++)
                rest -= factor[(p + q) * k + j - p] * factor[p * k + j - p];
            factor[q * k + j] = q == 0 ? sqrt(rest) : rest / factor[j];
            if (q == 0) log_determinant += 2.0 * log(factor[j]);
        }
    return log_determinant;
}

/* Solve with a decomposed matrix; `x` is the right side, and the solution. */
static void solve_banded(const double *factor, int64_t bands, int64_t k, double *x) {
    for (int64_t j = 0; j < k; j++) {
        for (int64_t p = 1; p < bands && p <= j; p++) x[j] -= factor[p * k + j - p] * x[j - p];
        x[j] /= factor[j];
    }
    for (int64_t j = k - 1; j >= 0; j--) {
        for (int64_t p = 1; p < bands && j + p < k; p++) x[j] -= factor[p * k + j] * x[j + p];
        x[j] /= factor[j];
    }
}

/* prior s */
static void pull_of(const smooth *of, const double *s, double *pull) {
    int64_t k = of->k;
    for (int64_t j = 0; j < k; j++) pull[j] = of->prior[j] * s[j];
    for (int64_t p = 1; p < of->bands; p++)
        for (int64_t j = 0; j + p < k; j++) {
            pull[j + p] += of->prior[p * k + j] * s[j];
            pull[j] += of->prior[p * k + j] * s[j + p];
        }
}

/* Fill in what is expected of each ratio over s, and the pull of the prior; return the value. */
static double penalised(const smooth *of, const double *s, double *scaled, double *pull) {
    double total = 0.0;
    for (int64_t b = 0; b < of->bins; b++) {
        const double *node = s + of->left[b];
        double at = (1.0 - of->share[b]) * node[0] + of->share[b] * node[1];
        scaled[b] = of->ratio[b] * exp(-at);
        total += of->half[b] * (at + scaled[b]);
    }
    pull_of(of, s, pull);
    return -total - 0.5 * dot(pull, s, of->k);
}

/* Find s, beginning at zero, by Newton's method with the expected information; return the logarithm
   of the marginal likelihood ratio against s = 0, NaN where the prior is no precision. `room` has
   k (2 bands + 4) + bins values. */
KERNEL(double, smooth_maximum)
(const int64_t *left, const double *share, const double *ratio, const double *half,
 const double *prior, int64_t bins, int64_t bands, int64_t k, double *s, double *room) {
    smooth of = {left, share, ratio, half, prior, bins, bands, k};
    double *information = room, *factor = information + bands * k, *step = factor + bands * k;
    double *trial = step + k, *pull = trial + k, *kept = pull + k, *scaled = kept + k;
    double log_prior = decompose(prior, bands, k, factor);
    memcpy(information, prior, (size_t)(bands * k) * sizeof(double));
    for (int64_t b = 0; b < bins; b++) {
        double a = 1.0 - share[b], c = share[b];
        information[left[b]] += a * a * half[b];
        information[left[b] + 1] += c * c * half[b];
        information[k + left[b]] += a * c * half[b];
    }
    double log_information = decompose(information, bands, k, factor);
    memset(s, 0, (size_t)k * sizeof(double));
    double none = penalised(&of, s, scaled, pull), value = none;
    for (int i = 0; i < NEWTON_STEPS; i++) {
        for (int64_t j = 0; j < k; j++) step[j] = -pull[j];
        for (int64_t b = 0; b < bins; b++) {
            double slope = half[b] * (scaled[b] - 1.0);
            step[left[b]] += (1.0 - share[b]) * slope;
            step[left[b] + 1] += share[b] * slope;
        }
        solve_banded(factor, bands, k, step);
        for (int64_t j = 0; j < k; j++) step[j] = step[j] > 1.0 ? 1.0 : step[j] < -1.0 ? -1.0 : step[j];
        double fraction = 1.0, gained = -1.0;
        while (gained < 0.0 && fraction > LEAST_FRACTION) {
            for (int64_t j = 0; j < k; j++) trial[j] = s[j] + fraction * step[j];
            gained = penalised(&of, trial, scaled, kept) - value;
            fraction /= 2.0;
        }
        if (gained < 0.0) break;
        memcpy(s, trial, (size_t)k * sizeof(double));
        memcpy(pull, kept, (size_t)k * sizeof(double));
        value += gained;
        if (gained < LAST_GAIN) break;
    }
    return value - none + log_prior / 2.0 - log_information / 2.0;
}
