/* Little-endian writing and reading, whatever the machine's own order. */
#ifndef AS_BYTES_H
#define AS_BYTES_H

#include <stdint.h>

static inline uint8_t *as_put8(uint8_t *at, uint8_t v)
{
    *at = v;
    return at + 1;
}

static inline uint8_t *as_put16(uint8_t *at, uint16_t v)
{
    return as_put8(as_put8(at, (uint8_t)v), (uint8_t)(v >> 8));
}

static inline uint8_t *as_put32(uint8_t *at, uint32_t v)
{
    return as_put16(as_put16(at, (uint16_t)v), (uint16_t)(v >> 16));
}

static inline uint8_t *as_put64(uint8_t *at, uint64_t v)
{
    return as_put32(as_put32(at, (uint32_t)v), (uint32_t)(v >> 32));
}

static inline uint8_t *as_put_bytes(uint8_t *at, const uint8_t *from, unsigned n)
{
    for (unsigned i = 0; i < n; i++) {
        *at++ = from[i];
    }
    return at;
}

static inline uint16_t as_get16(const uint8_t *at)
{
    return (uint16_t)(at[0] | at[1] << 8);
}

static inline uint32_t as_get32(const uint8_t *at)
{
    return (uint32_t)as_get16(at) | (uint32_t)as_get16(at + 2) << 16;
}

/* The bits of a float; a union is the one way that C99 and every compiler agree on. */
static inline uint32_t as_float_bits(float v)
{
    union {
        float f;
        uint32_t u;
    } both;
    both.f = v;
    return both.u;
}

static inline float as_float_of(uint32_t bits)
{
    union {
        float f;
        uint32_t u;
    } both;
    both.u = bits;
    return both.f;
}

#endif
