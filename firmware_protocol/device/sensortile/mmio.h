/* The chip's registers by address. On the host a model of the chip stands behind them. */
#ifndef MMIO_H
#define MMIO_H

#include <stdint.h>

#ifdef MMIO_MODEL
extern uint32_t (*mmio_model_get)(uint32_t address);
extern void (*mmio_model_put)(uint32_t address, uint32_t value);

enum { MMIO_SLEEP = 0 }; /* writing here lets a millisecond pass */

static inline uint32_t mmio_get(uint32_t address)
{
    return mmio_model_get(address);
}

static inline void mmio_put(uint32_t address, uint32_t value)
{
    mmio_model_put(address, value);
}
#else
static inline uint32_t mmio_get(uint32_t address)
{
    return *(volatile uint32_t *)address;
}

static inline void mmio_put(uint32_t address, uint32_t value)
{
    *(volatile uint32_t *)address = value;
}
#endif

static inline void mmio_set(uint32_t address, uint32_t bits)
{
    mmio_put(address, mmio_get(address) | bits);
}

static inline void mmio_clear(uint32_t address, uint32_t bits)
{
    mmio_put(address, mmio_get(address) & ~bits);
}

/* Replace the bits of a field. */
static inline void mmio_field(uint32_t address, uint32_t mask, uint32_t value)
{
    mmio_put(address, (mmio_get(address) & ~mask) | value);
}

#endif
