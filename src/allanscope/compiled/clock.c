/* The earliest arrivals of a window: `clock/clock.py`. */

#include "kernels.h"

/* Note the row with the least delay of each run of n rows that lie in one window of time and in one
   segment, the first of several; return how many there are. Rows count from the first of all, or
   each from the first of its run, so that long stretches keep their digits. */
KERNEL(int64_t, earliest_of_windows)
(const int64_t *index, const double *time_s, const int64_t *segment, int64_t n, int64_t from_first,
 double window_s, double period_s, int64_t *best) {
    int64_t runs = 0, origin = 0;
    double window = 0.0, least_delay = 0.0;
    for (int64_t i = 0; i < n; i++) {
        double here = floor(time_s[i] / window_s);
        int begins = i == 0 || here != window || segment[i] != segment[i - 1];
        if (begins && !from_first) origin = i;
        double delay = (time_s[i] - time_s[origin]) - (double)(index[i] - index[origin]) * period_s;
        if (begins || delay < least_delay) {
            runs += begins;
            best[runs - 1] = i;
            window = here, least_delay = delay;
        }
    }
    return runs;
}
