/* The maximum of a Whittle likelihood that is linear in variances: `noise/amplitudes.py`. */

#include "kernels.h"

enum { SCORING_STEPS = 40 };
static const double GAIN = 1e-6;        /* nats below which a step is the last one */
static const double SHORTEST_STEP = 1e-3;
static const double DEPENDENT = 1e-13;  /* what a column leaves over that adds nothing to others */

/* Orthogonalise p columns of n values one after the other (modified Gram-Schmidt), and the target by
   them. Taken as one more column, the target makes least squares as stable as Householder's
   reflections do (Bjorck 1967). Columns and target are overwritten. */
static void triangulate(
    double *columns, double *target, int64_t p, int64_t n, double *triangle, double *right) {
    memset(triangle, 0, (size_t)(p * p) * sizeof(double));
    memset(right, 0, (size_t)p * sizeof(double));
    for (int64_t j = 0; j < p; j++) {
        double before = 0.0, *unit = columns + j * n;
        for (int64_t i = 0; i < j; i++) before += triangle[i * p + j] * triangle[i * p + j];
        double rest = dot(unit, unit, n);
        if (rest <= DEPENDENT * DEPENDENT * (before + rest)) continue;
        double length = triangle[j * p + j] = sqrt(rest), inverse = 1.0 / length;
        for (int64_t b = 0; b < n; b++) unit[b] *= inverse;
        for (int64_t k = j + 1; k <= p; k++) {
            double *other = k < p ? columns + k * n : target, along = dot(unit, other, n);
            if (k < p)
                triangle[j * p + k] = along;
            else
                right[j] = along;
            for (int64_t b = 0; b < n; b++) other[b] -= along * unit[b];
        }
    }
}

/* Solve for some of the unknowns, all others zero; `room` has 2 p (p + 2) values. */
static void solve_among(
    const double *triangle, const double *right, const uint8_t *passive, int64_t p, double *room,
    double *solution) {
    double *columns = room, *target = columns + p * p, *reduced = target + p;
    double *along = reduced + p * p;
    int64_t *chosen = (int64_t *)(along + p), count = 0;
    for (int64_t j = 0; j < p; j++) {
        solution[j] = 0.0;
        if (!passive[j]) continue;
        for (int64_t i = 0; i < p; i++) columns[count * p + i] = triangle[i * p + j];
        chosen[count++] = j;
    }
    memcpy(target, right, (size_t)p * sizeof(double));
    triangulate(columns, target, count, p, reduced, along);
    for (int64_t j = count - 1; j >= 0; j--) {
        if (reduced[j * count + j] == 0.0) continue;
        double rest = along[j];
        for (int64_t k = j + 1; k < count; k++) rest -= reduced[j * count + k] * solution[chosen[k]];
        solution[chosen[j]] = rest / reduced[j * count + j];
    }
}

/* triangle^T (right - triangle solution); `room` has p values. */
static void slope_of(
    const double *triangle, const double *right, const double *solution, int64_t p, double *room,
    double *slope) {
    for (int64_t i = 0; i < p; i++) {
        double reached = 0.0;
        for (int64_t j = i; j < p; j++) reached += triangle[i * p + j] * solution[j];
        room[i] = right[i] - reached;
    }
    for (int64_t j = 0; j < p; j++) {
        slope[j] = 0.0;
        for (int64_t i = 0; i <= j; i++) slope[j] += triangle[i * p + j] * room[i];
    }
}

/* Solve a triangular least-squares problem with no unknown below zero, by the active sets of Lawson
   and Hanson; `room` has 2 p (p + 5) values, bytes of the last p of which are flags. */
KERNEL(void, nonnegative)
(const double *triangle, const double *right, int64_t p, double *room, double *solution) {
    double *wanted = room, *slope = wanted + p, *rest = slope + p, *deeper = rest + p;
    uint8_t *passive = (uint8_t *)(deeper + 2 * p * (p + 2));
    memset(passive, 0, (size_t)p);
    for (int64_t j = 0; j < p; j++) solution[j] = 0.0;
    slope_of(triangle, right, solution, p, rest, slope);
    double least_slope = 1e-13 * sqrt(dot(right, right, p));
    for (int64_t step = 0; step < 3 * p; step++) {
        int64_t entering = -1;
        double steepest = least_slope;
        for (int64_t j = 0; j < p; j++)
            if (!passive[j] && slope[j] > steepest) entering = j, steepest = slope[j];
        if (entering < 0) break;
        passive[entering] = 1;
        solve_among(triangle, right, passive, p, deeper, wanted);
        if (wanted[entering] <= 0.0) { /* its slope was rounding */
            passive[entering] = 0, slope[entering] = 0.0;
            continue;
        }
        for (;;) {
            int64_t blocking = -1;
            double share = 1.0;
            for (int64_t j = 0; j < p; j++) {
                if (!passive[j] || wanted[j] >= 0.0) continue;
                double reach = solution[j] / (solution[j] - wanted[j]);
                if (reach < share) blocking = j, share = reach;
            }
            if (blocking < 0) break;
            for (int64_t j = 0; j < p; j++)
                if (passive[j]) solution[j] += share * (wanted[j] - solution[j]);
            passive[blocking] = 0, solution[blocking] = 0.0;
            solve_among(triangle, right, passive, p, deeper, wanted);
        }
        memcpy(solution, wanted, (size_t)p * sizeof(double));
        slope_of(triangle, right, solution, p, rest, slope);
    }
}

KERNEL(void, triangulate)
(double *columns, double *target, int64_t p, int64_t n, double *triangle, double *right) {
    triangulate(columns, target, p, n, triangle, right);
}

typedef struct {
    const double *columns, *power, *count, *fixed, *root; /* of half the count */
    double smallest;
    int64_t p, bins;
} problem;

/* Fill in the variances and return the log-likelihood. */
static double log_likelihood(const problem *of, const double *theta, double *restrict variance) {
    memcpy(variance, of->fixed, (size_t)of->bins * sizeof(double));
    for (int64_t j = 0; j < of->p; j++)
        if (theta[j] != 0.0)
            for (int64_t b = 0; b < of->bins; b++)
                variance[b] += theta[j] * of->columns[j * of->bins + b];
    for (int64_t b = 0; b < of->bins; b++)
        if (variance[b] < of->smallest) variance[b] = of->smallest;
    lanes total = {0.0};
    for (int64_t b = 0; b < of->bins; b += LANES) {
        lanes own = some_of(variance, b, of->bins, 1.0), count = some_of(of->count, b, of->bins, 0.0);
        total += count * (log_of(own) + some_of(of->power, b, of->bins, 0.0) / own);
    }
    return -0.5 * sum_of(total);
}

/* The slope of the log-likelihood along a step. */
static double slope_along(const problem *of, const double *variance, const double *step) {
    lanes total = {0.0};
    for (int64_t b = 0; b < of->bins; b += LANES) {
        lanes own = some_of(variance, b, of->bins, 1.0), count = some_of(of->count, b, of->bins, 0.0);
        lanes change = {0.0};
        for (int64_t j = 0; j < of->p; j++)
            change += step[j] * some_of(of->columns + j * of->bins, b, of->bins, 0.0);
        total += count * (some_of(of->power, b, of->bins, 0.0) / own - 1.0) * (change / own);
    }
    return 0.5 * sum_of(total);
}

/* Non-negative variances nearest to power - fixed, weighted by `variance`. */
static void least_squares(
    const problem *of, const double *variance, double floor_at, double *room, double *theta) {
    int64_t p = of->p, bins = of->bins;
    double *scaled = room, *weight = scaled + p * bins, *target = weight + bins;
    double *size = target + bins, *triangle = size + p, *right = triangle + p * p;
    double *deeper = right + p;
    for (int64_t b = 0; b < bins; b++) {
        double own = variance[b] < floor_at ? floor_at : variance[b];
        weight[b] = of->root[b] / own;
        target[b] = (of->power[b] - of->fixed[b]) * weight[b];
    }
    for (int64_t j = 0; j < p; j++) {
        double *one = scaled + j * bins;
        for (int64_t b = 0; b < bins; b++) one[b] = of->columns[j * bins + b] * weight[b];
        double length = sqrt(dot(one, one, bins));
        size[j] = 1.0;
        if (length > 0.0) {
            size[j] = length;
            double inverse = 1.0 / length;
            for (int64_t b = 0; b < bins; b++) one[b] *= inverse;
        }
    }
    triangulate(scaled, target, p, bins, triangle, right);
    JOINED(nonnegative, LEVEL)(triangle, right, p, deeper, theta);
    for (int64_t j = 0; j < p; j++) theta[j] /= size[j];
}

/* Fisher scoring from `theta`, or from least squares where that is not known. `theta` and `variance`
   receive the result; `room` has bins (p + 4) + 3 p (p + 6) values. Returns the log-likelihood. */
KERNEL(double, maximise)
(const double *columns, const double *power, const double *count, const double *fixed, int64_t p,
 int64_t bins, double smallest, int64_t known, double *theta, double *variance, double *room) {
    double *root = room, *tried = root + bins, *step = tried + bins, *trial = step + p, *deeper = trial + p;
    problem of = {columns, power, count, fixed, root, smallest, p, bins};
    for (int64_t b = 0; b < bins; b++) root[b] = sqrt(count[b] / 2);
    if (!known) least_squares(&of, power, 1e-300, deeper, theta);
    double value = log_likelihood(&of, theta, variance);
    for (int i = 0; i < SCORING_STEPS; i++) {
        double size = 1.0, gained;
        least_squares(&of, variance, 0.0, deeper, step);
        for (int64_t j = 0; j < p; j++) {
            step[j] -= theta[j];
            trial[j] = theta[j] + step[j];
        }
        if (slope_along(&of, variance, step) <= GAIN) break; /* a step gains less than at its beginning */
        gained = log_likelihood(&of, trial, tried);
        while (gained < value && size > SHORTEST_STEP) {
            size /= 2;
            for (int64_t j = 0; j < p; j++) trial[j] = theta[j] + size * step[j];
            gained = log_likelihood(&of, trial, tried);
        }
        if (gained <= value + GAIN) break;
        memcpy(theta, trial, (size_t)p * sizeof(double));
        memcpy(variance, tried, (size_t)bins * sizeof(double));
        value = gained;
    }
    return value;
}

/* Size of one signal and the noise beside it, in turn: `explain/regression.py`. The first m ordinates
   of the data and of a signal of size 1, which of them are kept (1 or 0), and their variances: those
   of what is fixed, and of every part at a power of 1, whose rows are `apart`. The low bins begin at
   `edges`, and `kept_count` is how many ordinates are kept in each, 1 at the least. `theta` is where
   the powers begin, and `power` holds the mean squares of all bins without a signal: both receive the
   result, with the information about the size in `found[0]` and the size in `found[1]`. `room` has
   m + bins (p + 5) + 3 p (p + 6) values.
   Returns the log-likelihood. */
KERNEL(double, fit_signal)
(const double *signal, const double *data, const double *kept, const double *first_fixed,
 const double *first, int64_t m, int64_t apart, const int64_t *edges, const double *kept_count,
 int64_t low, const double *columns, const double *count, const double *fixed, int64_t p,
 int64_t bins, double smallest, int64_t turns, double close, double *theta, double *power,
 double *found, double *room) {
    double *variance = room, *expected = variance + m, *deeper = expected + bins;
    double reached = INFINITY;
    for (int64_t turn = 0; turn < turns; turn++) {
        memcpy(variance, first_fixed, (size_t)m * sizeof(double));
        for (int64_t j = 0; j < p; j++)
            for (int64_t k = 0; k < m; k++) variance[k] += theta[j] * first[j * apart + k];
        lanes squares = {0.0}, products = {0.0};
        for (int64_t k = 0; k < m; k += LANES) {
            lanes own = some_of(signal, k, m, 0.0);
            lanes weighted = own * some_of(kept, k, m, 0.0) / some_of(variance, k, m, 1.0);
            squares += weighted * own;
            products += weighted * some_of(data, k, m, 0.0);
        }
        double information = found[0] = sum_of(squares);
        double size = found[1] = information > 0.0 ? sum_of(products) / information : 0.0;
        for (int64_t b = 0; b < low; b++) {
            int64_t begin = edges[b], end = b + 1 < low ? edges[b + 1] : m;
            lanes total = {0.0};
            for (int64_t k = begin; k < end; k += LANES) {
                lanes rest = some_of(data, k, end, 0.0) - size * some_of(signal, k, end, 0.0);
                total += rest * rest * some_of(kept, k, end, 0.0);
            }
            power[b] = sum_of(total) / kept_count[b];
        }
        double before = reached;
        reached = JOINED(maximise, LEVEL)(
            columns, power, count, fixed, p, bins, smallest, 1, theta, expected, deeper);
        if (fabs(reached - before) < close) break;
    }
    return reached;
}
