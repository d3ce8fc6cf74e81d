/* What all compiled loops share.

   Each is compiled once for every level of the processor that a library serves, under a name that
   ends in the level (`KERNEL`). Sums whose order is free are taken in four lanes (`lanes`), on every
   processor alike, and products are never fused with sums: so all levels, compilers and machines
   give the same bits. No loop allocates memory or can fail; room to work in comes from the caller. */

#ifndef KERNELS_H
#define KERNELS_H

#include <math.h>
#include <stdint.h>
#include <string.h>

#define JOIN(a, b) a##_##b
#define JOINED(a, b) JOIN(a, b)
#if defined(_WIN32)
#define KERNEL(type, name) __declspec(dllexport) type JOINED(name, LEVEL)
#else
#define KERNEL(type, name) __attribute__((visibility("default"))) type JOINED(name, LEVEL)
#endif

#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wpsabi" /* vectors are passed within a file alone */
#endif

/* Four doubles, wherever they lie. */
typedef double lanes __attribute__((vector_size(32), aligned(8), may_alias));
enum { LANES = 4 };

#if defined(__AVX512F__)
/* Eight terms in one register. They are added to four lanes, the first four first: the same bits. */
#define WIDE
typedef double wide __attribute__((vector_size(64), aligned(8), may_alias));

static inline lanes first_of(wide v) { return (lanes){v[0], v[1], v[2], v[3]}; }

static inline lanes second_of(wide v) { return (lanes){v[4], v[5], v[6], v[7]}; }
#endif

static inline double sum_of(lanes v) { return (v[0] + v[1]) + (v[2] + v[3]); }

static inline double dot(const double *a, const double *b, int64_t n) {
    lanes sums = {0.0, 0.0, 0.0, 0.0};
    int64_t i = 0;
    for (; i + LANES <= n; i += LANES) sums += *(const lanes *)(a + i) * *(const lanes *)(b + i);
    double total = sum_of(sums);
    for (; i < n; i++) total += a[i] * b[i];
    return total;
}

/* Four bits of doubles. */
typedef uint64_t lanes_bits __attribute__((vector_size(32), aligned(8), may_alias));

/* Natural logarithms to 1 ulp, of normal positive numbers: fdlibm's, without a branch. A number is
   2^k m with m from sqrt(1/2) to sqrt(2), and ln m = f - f^2/2 + s (f^2/2 + R), s = f / (2 + f). */
static inline lanes log_of(lanes x) {
    const uint64_t root = 0x3fe6a09e00000000u, one = 0x3ff0000000000000u;
    lanes_bits shifted = (lanes_bits)x + (one - root);
    lanes k = (lanes)((shifted >> 52) | 0x4330000000000000u) - (4503599627370496.0 + 1023.0);
    lanes f = (lanes)((shifted & 0x000fffffffffffffu) + root) - 1.0;
    lanes s = f / (2.0 + f), z = s * s, w = z * z, half = 0.5 * f * f;
    lanes even = w * (3.999999999940941908e-01 + w * (2.222219843214978396e-01 + w * 1.531383769920937332e-01));
    lanes odd = z * (6.666666666666735130e-01
                     + w * (2.857142874366239149e-01 + w * (1.818357216161805012e-01 + w * 1.479819860511658591e-01)));
    lanes low = s * (half + (even + odd)) + k * 1.90821492927058770002e-10;
    return k * 6.93147180369123816490e-01 - ((half - low) - f);
}

/* Up to four values from `at` on; `rest` where there are no more. */
static inline __attribute__((always_inline)) lanes some_of(
    const double *values, int64_t at, int64_t n, double rest) {
    if (at + LANES <= n) return *(const lanes *)(values + at);
    lanes found = {rest, rest, rest, rest};
    for (int64_t b = at; b < n; b++) found[b - at] = values[b];
    return found;
}

static inline int64_t least(int64_t a, int64_t b) { return a < b ? a : b; }

static inline double larger(double a, double b) { return b > a ? b : a; }

#endif
