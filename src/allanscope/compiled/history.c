/* Sums of neighbouring rows, and of neighbouring pairs of those: `history.py`. */

#include "kernels.h"

/* What is known of the temperature of a row: the first, the sum of what the others lie above it, and
   how many there were. So the mean of equal temperatures is that temperature. */
static inline void add_temperatures(double *known, const double *values, int64_t n) {
    double first = known[0], above = known[1], number = known[2];
    for (int64_t i = 0; i < n; i++) {
        if (isnan(values[i])) continue;
        if (number == 0.0) first = values[i];
        above += values[i] - first;
        number += 1.0;
    }
    known[0] = first, known[1] = above, known[2] = number;
}

static inline double mean_of(const double *known) {
    return known[2] > 0.0 ? known[0] + known[1] / known[2] : NAN;
}

/* Add rows of all axes, one after another in memory, to the sums of the axes. */
static void add_rows_int16(const int16_t *rows, int64_t n, int64_t axes, double *sums) {
    enum { AXES_AT_ONCE = 8, EXACT = 1 << 15 };
    typedef int16_t eight_narrow __attribute__((vector_size(16), aligned(2), may_alias));
    typedef int32_t eight_wide __attribute__((vector_size(32), aligned(4), may_alias));
    const int16_t *end = rows + n * axes;
    for (int64_t first = 0; first < axes; first += AXES_AT_ONCE) {
        int64_t many = least(AXES_AT_ONCE, axes - first);
        for (int64_t done = 0; done < n; done += EXACT) { /* so many that no sum leaves 32 bits */
            const int16_t *own = rows + done * axes + first;
            eight_wide sum = {0};
            for (int64_t i = 0; i < least(EXACT, n - done); i++, own += axes) {
                eight_narrow row = {0};
                if (own + AXES_AT_ONCE <= end) row = *(const eight_narrow *)own;
                else memcpy(&row, own, (size_t)many * sizeof *own);
                sum += __builtin_convertvector(row, eight_wide);
            }
            for (int64_t a = 0; a < many; a++) sums[first + a] += (double)sum[a];
        }
    }
}

static void add_rows_float64(const double *rows, int64_t n, int64_t axes, double *sums) {
    for (int64_t i = 0; i < n; i++, rows += axes)
        for (int64_t axis = 0; axis < axes; axis++) sums[axis] += rows[axis];
}

/* Sum each `stride` of n samples (rows of all axes) up in the rows that follow. `part` is the row
   that is not complete, of which `filled` samples are here: sums of the axes, then what is known of
   the temperature. There may be no temperatures at all. */
#define ROWS(name, type, add)                                                                    \
    KERNEL(void, name)                                                                           \
    (const type *samples, int64_t n, const double *temperature_c, int64_t temperatures,          \
     int64_t axes, int64_t stride, double *part, int64_t filled, double *sums, double *means) {  \
        double *known = part + axes;                                                             \
        if (stride == 1) { /* each a sum of its own, which begins at 0.0 */                      \
            for (int64_t i = 0; i < n * axes; i++) sums[i] = 0.0 + (double)samples[i];           \
            for (int64_t i = 0; i < n; i++) means[i] = temperatures ? temperature_c[i] + 0.0 : NAN;\
            return;                                                                              \
        }                                                                                        \
        for (int64_t done = 0; done < n;) {                                                      \
            int64_t size = least(stride - filled, n - done);                                     \
            add(samples + done * axes, size, axes, part);                                        \
            if (temperatures) add_temperatures(known, temperature_c + done, size);               \
            done += size, filled += size;                                                        \
            if (filled < stride) continue;                                                       \
            memcpy(sums, part, (size_t)axes * sizeof(double));                                   \
            *means++ = mean_of(known);                                                           \
            sums += axes, filled = 0;                                                            \
            memset(part, 0, (size_t)(axes + 3) * sizeof(double));                                \
        }                                                                                        \
    }

ROWS(history_rows_int16, int16_t, add_rows_int16)
ROWS(history_rows_float64, double, add_rows_float64)

/* Join neighbouring rows of one segment in pairs; a row without a neighbour is given up. Return how many
   there are. */
KERNEL(int64_t, history_halve)
(const double *sums, const double *means, const int64_t *position, const int64_t *segment, int64_t used,
 int64_t axes, double *new_sums, double *new_means, int64_t *new_position, int64_t *new_segment) {
    int64_t kept = 0;
    for (int64_t i = 0; i + 1 < used;) {
        if (segment[i] != segment[i + 1]) {
            i++;
            continue;
        }
        for (int64_t axis = 0; axis < axes; axis++)
            new_sums[kept * axes + axis] = sums[i * axes + axis] + sums[(i + 1) * axes + axis];
        double known[3] = {0.0, 0.0, 0.0};
        add_temperatures(known, means + i, 2);
        new_means[kept] = mean_of(known);
        new_position[kept] = position[i], new_segment[kept] = segment[i];
        kept++, i += 2;
    }
    return kept;
}

/* Sum rows (n, axes) up, `each` of them from each `first` on, in their order. */
KERNEL(void, history_sums)
(const double *rows, const int64_t *first, int64_t count, int64_t each, int64_t axes, double *sums) {
    for (int64_t k = 0; k < count; k++, sums += axes) {
        const double *from = rows + first[k] * axes;
        memcpy(sums, from, (size_t)axes * sizeof(double));
        add_rows_float64(from + axes, each - 1, axes, sums);
    }
}
