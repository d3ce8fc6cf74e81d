/* What the library was made of, and which of its levels this processor can run. */

#include <stdint.h>

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

#define TEXT(words) #words
#define TEXT_OF(macro) TEXT(macro)

/* Fingerprint of the sources. */
EXPORT const char *sources(void) { return TEXT_OF(SOURCES); }

#if defined(__x86_64__)
#include <cpuid.h>

static int has(uint32_t word, uint32_t bits) { return (word & bits) == bits; }

/* 3 for x86-64-v3 (AVX2, FMA, BMI, and a system that saves the wide registers) and PCLMULQDQ, 4 for
   x86-64-v4 (AVX-512) and that, else 1. */
EXPORT int processor_level(void) {
    uint32_t a, b, c, d, low, high;
    if (!__get_cpuid(1, &a, &b, &c, &d)) return 1;
    /* PCLMULQDQ, FMA, CX16, SSSE3, SSE4.1, SSE4.2, MOVBE, POPCNT, OSXSAVE, AVX, F16C */
    if (!has(c, 1u << 1 | 1u << 12 | 1u << 13 | 1u << 9 | 1u << 19 | 1u << 20 | 1u << 22 | 1u << 23
                    | 1u << 27 | 1u << 28 | 1u << 29))
        return 1;
    __asm__ volatile("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
    if (!has(low, 6u)) return 1;
    if (!__get_cpuid_count(7, 0, &a, &b, &c, &d)) return 1;
    if (!has(b, 1u << 3 | 1u << 5 | 1u << 8)) return 1; /* BMI1, AVX2, BMI2 */
    /* AVX512F, DQ, CD, BW, VL, and the system saves their masks and both halves of 32 registers. */
    int wider = has(b, 1u << 16 | 1u << 17 | 1u << 28 | 1u << 30 | 1u << 31) && has(low, 0xE6u);
    if (!__get_cpuid(0x80000001u, &a, &b, &c, &d)) return 1;
    return !has(c, 1u << 0 | 1u << 5) ? 1 : wider ? 4 : 3; /* LAHF, LZCNT */
}
#else
EXPORT int processor_level(void) { return 1; }
#endif
