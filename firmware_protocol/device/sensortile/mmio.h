/* The chip's registers by address. On the host a model of the chip stands behind them. */
#ifndef MMIO_H
#define MMIO_H

#include <stdint.h>

#ifdef MMIO_MODEL
extern uint32_t (*mmio_model_get)(uint32_t address);
extern void (*mmio_model_put)(uint32_t address, uint32_t value);

/* Writing here lets time pass: until the next interrupt, or so many cycles of the core. */
enum { MMIO_SLEEP = 0, MMIO_CYCLES = 1 };

static inline uint32_t mmio_get(uint32_t address)
{
    return mmio_model_get(address);
}

static inline void mmio_put(uint32_t address, uint32_t value)
{
    mmio_model_put(address, value);
}

static inline uint8_t mmio_get_byte(uint32_t address)
{
    return (uint8_t)mmio_model_get(address);
}

static inline void mmio_put_byte(uint32_t address, uint8_t value)
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

static inline uint8_t mmio_get_byte(uint32_t address)
{
    return *(volatile uint8_t *)address;
}

static inline void mmio_put_byte(uint32_t address, uint8_t value)
{
    *(volatile uint8_t *)address = value;
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
