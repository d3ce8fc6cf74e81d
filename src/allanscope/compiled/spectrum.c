/* Periodograms and the low-pass between two levels: `spectrum/ladder.py`. */

#include "kernels.h"

/* Add |z|^2 of spectra (axes, segments, bins) to power (axes, bins). */
KERNEL(void, add_squares)
(const float *restrict spectra, int64_t axes, int64_t segments, int64_t bins,
 double *restrict power) {
    for (int64_t axis = 0; axis < axes; axis++, power += bins)
        for (int64_t segment = 0; segment < segments; segment++, spectra += 2 * bins)
            for (int64_t k = 0; k < bins; k++) {
                float re = spectra[2 * k], im = spectra[2 * k + 1];
                power[k] += (double)(re * re + im * im);
            }
}

enum { TAPS = 48, FACTOR = 4, TOGETHER = 256, PHASE = TOGETHER + TAPS / FACTOR };

/* Low-pass n samples of every axis and keep `count` outputs, one from every fourth. Samples are
   parted by their number modulo 4 first: then neighbouring outputs take neighbouring samples. */
KERNEL(void, decimate)
(const float *restrict samples, const float *restrict taps, int64_t axes, int64_t n, int64_t count,
 float *restrict out) {
    float phases[FACTOR][PHASE], sums[TOGETHER];
    for (int64_t axis = 0; axis < axes; axis++, samples += n, out += count)
        for (int64_t done = 0; done < count; done += TOGETHER) {
            int64_t size = least(TOGETHER, count - done), wanted = size + TAPS / FACTOR - 1;
            const float *here = samples + FACTOR * done;
            for (int64_t i = 0; i < wanted; i++)
                for (int p = 0; p < FACTOR; p++) phases[p][i] = here[FACTOR * i + p];
            for (int64_t i = 0; i < size; i++) sums[i] = 0.0f;
            for (int j = 0; j < TAPS; j += FACTOR) {
                const float *p0 = phases[0] + j / FACTOR, *p1 = phases[1] + j / FACTOR;
                const float *p2 = phases[2] + j / FACTOR, *p3 = phases[3] + j / FACTOR;
                float t0 = taps[j], t1 = taps[j + 1], t2 = taps[j + 2], t3 = taps[j + 3];
                for (int64_t i = 0; i < size; i++)
                    sums[i] = sums[i] + t0 * p0[i] + t1 * p1[i] + t2 * p2[i] + t3 * p3[i];
            }
            memcpy(out + done, sums, (size_t)size * sizeof(float));
        }
}
