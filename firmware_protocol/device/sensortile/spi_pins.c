#include "spi_pins.h"

#include "mmio.h"

#define RCC_AHB2ENR 0x4002104Cu
#define GPIOA 0x48000000u
#define GPIOB 0x48000400u
#define GPIOC 0x48000800u

enum {
    MODER = 0x00,
    OSPEEDR = 0x08,
    IDR = 0x10,
    BSRR = 0x18,

    SELECT = 12,  /* PB12: the LSM6DSM */
    CLOCK = 13,   /* PB13 */
    DATA = 15,    /* PB15 */
    SELECT_MAGNETOMETER = 1,   /* PB1: LSM303AGR */
    SELECT_ACCELEROMETER = 4,  /* PC4: LSM303AGR */
    SELECT_PRESSURE = 3,       /* PA3: LPS22HB */
    READ = 0x80
};

static void output(uint32_t port, uint32_t pin)
{
    mmio_put(port + BSRR, 1u << pin); /* high before it drives */
    mmio_field(port + MODER, 3u << 2 * pin, 1u << 2 * pin);
    mmio_field(port + OSPEEDR, 3u << 2 * pin, 2u << 2 * pin);
}

static void high(uint32_t pin)
{
    mmio_put(GPIOB + BSRR, 1u << pin);
}

static void low(uint32_t pin)
{
    mmio_put(GPIOB + BSRR, 1u << (pin + 16));
}

static void data_direction(bool out)
{
    mmio_field(GPIOB + MODER, 3u << 2 * DATA, (out ? 1u : 0u) << 2 * DATA);
}

/* The part needs 50 ns from the falling edge to its bit; at 80 MHz that is four cycles. */
static void wait_for_bit(void)
{
#ifndef MMIO_MODEL
    __asm volatile("nop\n nop\n nop\n nop");
#endif
}

static void send(uint8_t byte)
{
    for (uint8_t bit = 0x80; bit != 0; bit >>= 1) {
        low(CLOCK);
        if (byte & bit) {
            high(DATA);
        } else {
            low(DATA);
        }
        wait_for_bit();
        high(CLOCK);
    }
}

static uint8_t receive(void)
{
    uint8_t byte = 0;
    for (uint8_t bit = 0; bit < 8; bit++) {
        low(CLOCK);
        wait_for_bit();
        high(CLOCK);
        const uint32_t level = mmio_get(GPIOB + IDR) >> DATA & 1u;
        byte = (uint8_t)((uint32_t)byte << 1 | level);
    }
    return byte;
}

void spi_pins_init(void)
{
    mmio_set(RCC_AHB2ENR, 7u);
    output(GPIOA, SELECT_PRESSURE);
    output(GPIOC, SELECT_ACCELEROMETER);
    output(GPIOB, SELECT_MAGNETOMETER);
    output(GPIOB, SELECT);
    output(GPIOB, CLOCK);
    output(GPIOB, DATA);
}

bool spi_pins_read(void *context, uint8_t reg, uint8_t *to, uint16_t n)
{
    (void)context;
    low(SELECT);
    send(READ | reg);
    data_direction(false);
    for (uint16_t i = 0; i < n; i++) {
        to[i] = receive();
    }
    high(SELECT);
    data_direction(true);
    return true;
}

bool spi_pins_write(void *context, uint8_t reg, uint8_t value)
{
    (void)context;
    low(SELECT);
    send(reg);
    send(value);
    high(SELECT);
    return true;
}
