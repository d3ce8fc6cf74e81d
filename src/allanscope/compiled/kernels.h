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

static inline int64_t least(int64_t a, int64_t b) { return a < b ? a : b; }

static inline double larger(double a, double b) { return b > a ? b : a; }

#endif
