#include "sensor_spi.h"

#include "board_sensortile.h"
#include "mmio.h"

#define RCC_AHB1ENR 0x40021048u
#define RCC_AHB2ENR 0x4002104Cu
#define RCC_APB1ENR1 0x40021058u
#define GPIOA 0x48000000u
#define GPIOB 0x48000400u
#define GPIOC 0x48000800u
#define SPI2_CR1 0x40003800u
#define SPI2_CR2 0x40003804u
#define SPI2_SR 0x40003808u
#define SPI2_DR 0x4000380Cu
#define DMA1_IFCR 0x40020004u
#define DMA1_CCR4 0x40020044u
#define DMA1_CNDTR4 0x40020048u
#define DMA1_CPAR4 0x4002004Cu
#define DMA1_CMAR4 0x40020050u
#define DMA1_CSELR 0x400200A8u
#define NVIC_ISER0 0xE000E100u

enum {
    MODER = 0x00,
    OSPEEDR = 0x08,
    PUPDR = 0x0C,
    BSRR = 0x18,
    AFRH = 0x24,

    SELECT = 12,               /* PB12: the LSM6DSM */
    CLOCK = 13,                /* PB13 */
    DATA = 15,                 /* PB15 */
    SELECT_MAGNETOMETER = 1,   /* PB1: LSM303AGR */
    SELECT_ACCELEROMETER = 4,  /* PC4: LSM303AGR */
    SELECT_PRESSURE = 3,       /* PA3: LPS22HB */
    SPI2_FUNCTION = 5,
    READ = 0x80,

    DMA_IRQ = 14, /* DMA1 channel 4, request 1: SPI2_RX */
    HALF_BYTE = 48, /* cycles, with what the handler takes before; a bit is 16 */
    QUEUE = 4, /* bytes */
    PATIENCE = 10000,
    MOST_WAKINGS = 64 /* while a reading of a millisecond runs; the tick alone comes once in it */
};

/* Master, mode 3, one data line, select by software, 80 MHz / 16 = 5 MHz. */
#define CR1 (1u | 1u << 1 | 1u << 2 | 3u << 3 | 1u << 8 | 1u << 9 | 1u << 15)
#define SPI_ON (1u << 6)
#define SENDS (1u << 14)
#define CR2 (7u << 8 | 1u << 12) /* bytes, and told of each */
#define BY_DMA 1u
#define HAS_BYTE 1u
#define BUSY (1u << 7 | 3u << 11) /* the shifter, or the queue before it */
#define DMA_ON 1u
#define DMA_TO_MEMORY (1u << 1 | 1u << 3 | 1u << 7 | 3u << 12) /* told of end and error; highest */
#define DMA_FLAGS (0xFu << 12)

uint8_t sensor_spi_bytes[SENSOR_SPI_MOST];
static volatile bool stopped;

void dma1_channel4_handler(void);

static void output(uint32_t port, uint32_t pin)
{
    mmio_put(port + BSRR, 1u << pin); /* high before it drives */
    mmio_field(port + MODER, 3u << 2 * pin, 1u << 2 * pin);
    mmio_field(port + OSPEEDR, 3u << 2 * pin, 2u << 2 * pin);
}

/* Pulled up: while the SPI is off nobody drives the line, and mode 3 rests high. */
static void spi_pin(uint32_t pin)
{
    mmio_field(GPIOB + PUPDR, 3u << 2 * pin, 1u << 2 * pin);
    mmio_field(GPIOB + OSPEEDR, 3u << 2 * pin, 2u << 2 * pin);
    mmio_field(GPIOB + AFRH, 0xFu << 4 * (pin - 8), (uint32_t)SPI2_FUNCTION << 4 * (pin - 8));
    mmio_field(GPIOB + MODER, 3u << 2 * pin, 2u << 2 * pin);
}

void sensor_spi_init(void)
{
    mmio_set(RCC_AHB2ENR, 7u);
    mmio_set(RCC_AHB1ENR, 1u);
    mmio_set(RCC_APB1ENR1, 1u << 14);
    output(GPIOA, SELECT_PRESSURE);
    output(GPIOC, SELECT_ACCELEROMETER);
    output(GPIOB, SELECT_MAGNETOMETER);
    output(GPIOB, SELECT);
    mmio_put(SPI2_CR1, CR1);
    mmio_put(SPI2_CR2, CR2);
    spi_pin(CLOCK);
    spi_pin(DATA);
    mmio_field(DMA1_CSELR, 0xFu << 12, 1u << 12);
    mmio_put(DMA1_CPAR4, SPI2_DR);
    mmio_put(DMA1_CMAR4, (uint32_t)(uintptr_t)sensor_spi_bytes);
    mmio_put(NVIC_ISER0, 1u << DMA_IRQ);
}

static bool wait_for(uint32_t mask, uint32_t wanted)
{
    for (uint32_t i = 0; i < PATIENCE; i++) {
        if ((mmio_get(SPI2_SR) & mask) == wanted) {
            return true;
        }
    }
    return false;
}

/* Switch the clock off between the first and the last bit of a byte: it is the last one. */
static void stop_in_byte(void)
{
#ifndef MMIO_MODEL
    for (uint32_t i = 0; i < HALF_BYTE / 4; i++) {
        __asm volatile("nop");
    }
#else
    mmio_put(MMIO_CYCLES, HALF_BYTE);
#endif
    mmio_put(SPI2_CR1, CR1);
    stopped = true;
}

void dma1_channel4_handler(void)
{
    mmio_put(DMA1_IFCR, DMA_FLAGS);
    stop_in_byte();
}

static bool send(const uint8_t *bytes, uint8_t n)
{
    mmio_put(SPI2_CR1, CR1 | SENDS | SPI_ON);
    for (uint8_t i = 0; i < n; i++) {
        mmio_put_byte(SPI2_DR, bytes[i]); /* the queue takes four */
    }
    const bool done = wait_for(BUSY, 0);
    mmio_put(SPI2_CR1, CR1 | SENDS);
    return done;
}

/* Receive n bytes into sensor_spi_bytes. */
static bool receive(uint16_t n)
{
    stopped = false;
    mmio_put(SPI2_CR1, CR1);
    if (n == 1) {
        board_no_interrupts(true);
        mmio_put(SPI2_CR1, CR1 | SPI_ON);
        stop_in_byte();
        board_no_interrupts(false);
    } else {
        mmio_put(DMA1_CNDTR4, n - 1u);
        mmio_put(DMA1_CCR4, DMA_TO_MEMORY | DMA_ON);
        mmio_put(SPI2_CR2, CR2 | BY_DMA);
        mmio_put(SPI2_CR1, CR1 | SPI_ON);
        for (uint32_t i = 0; i < MOST_WAKINGS && !stopped; i++) {
            board_no_interrupts(true); /* one that comes now wakes all the same */
            if (!stopped) {
                board_sleep();
            }
            board_no_interrupts(false);
        }
        mmio_put(SPI2_CR1, CR1);
        mmio_put(SPI2_CR2, CR2);
        mmio_put(DMA1_CCR4, 0);
    }
    const bool done = stopped && wait_for(HAS_BYTE, HAS_BYTE) && wait_for(BUSY, 0);
    sensor_spi_bytes[n - 1] = mmio_get_byte(SPI2_DR);
    bool late = false;
    for (uint8_t i = 0; i < QUEUE && mmio_get(SPI2_SR) & HAS_BYTE; i++) {
        (void)mmio_get_byte(SPI2_DR);
        late = true;
    }
    return done && !late;
}

static void select(bool on)
{
    mmio_put(GPIOB + BSRR, on ? 1u << (SELECT + 16) : 1u << SELECT);
}

bool sensor_spi_read(void *context, uint8_t reg, uint8_t *to, uint16_t n)
{
    (void)context;
    if (n == 0 || n > SENSOR_SPI_MOST) {
        return false;
    }
    const uint8_t address = (uint8_t)(READ | reg);
    select(true);
    const bool done = send(&address, 1) && receive(n);
    select(false);
    for (uint16_t i = 0; i < n; i++) {
        to[i] = sensor_spi_bytes[i];
    }
    return done;
}

bool sensor_spi_write(void *context, uint8_t reg, uint8_t value)
{
    (void)context;
    const uint8_t bytes[2] = {reg, value};
    select(true);
    const bool done = send(bytes, 2);
    select(false);
    return done;
}
