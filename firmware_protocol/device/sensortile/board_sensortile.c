/* The STM32L476JG of the SensorTile at 80 MHz, by register (RM0351). */
#include "board_sensortile.h"

#include "mmio.h"

#define RCC_CR 0x40021000u
#define RCC_CFGR 0x40021008u
#define RCC_PLLCFGR 0x4002100Cu
#define RCC_AHB2ENR 0x4002104Cu
#define RCC_APB1ENR1 0x40021058u
#define RCC_APB2ENR 0x40021060u
#define RCC_CCIPR 0x40021088u
#define RCC_BDCR 0x40021090u
#define RCC_CSR 0x40021094u
#define PWR_CR1 0x40007000u
#define PWR_CR2 0x40007004u
#define FLASH_ACR 0x40022000u
#define GPIOA_MODER 0x48000000u
#define GPIOA_OSPEEDR 0x48000008u
#define GPIOA_AFRH 0x48000024u
#define SYSCFG_EXTICR1 0x40010008u
#define EXTI_IMR1 0x40010400u
#define EXTI_RTSR1 0x40010408u
#define EXTI_PR1 0x40010414u
#define IWDG_KR 0x40003000u
#define IWDG_PR 0x40003004u
#define IWDG_RLR 0x40003008u
#define RNG_CR 0x50060800u
#define RNG_SR 0x50060804u
#define RNG_DR 0x50060808u
#define SYST_CSR 0xE000E010u
#define SYST_RVR 0xE000E014u
#define SYST_CVR 0xE000E018u
#define NVIC_ISER0 0xE000E100u
#define NVIC_IPR2 0xE000E408u
#define SCB_SHPR3 0xE000ED20u
#ifndef UNIQUE_ID
#define UNIQUE_ID 0x1FFF7590u /* QEMU has nothing there; its image takes another address */
#endif

enum {
    CORE_MHZ = 80,
    TICKS_A_MS = CORE_MHZ * 1000,
    EDGE_LINE = 2, /* PA2, the sensor's INT2: the one that is wired to the chip */
    EDGE_IRQ = 8,
    BELOW_DMA = 0x10, /* the end of a reading of the sensor cannot wait */
    WATCHDOG_RELOAD = 2000, /* of 32 kHz / 32: two seconds */
    CRYSTAL_TICKS = 100, /* of 20 ms, before the clock is at 80 MHz: the crystal may need two seconds */
    PATIENCE = 100000
};

#define LSE_ON (1u << 0)
#define LSE_READY (1u << 1)
#define MSI_READY (1u << 1)
#define MSI_LOCK (1u << 2)
#define MSI_RANGE_FROM_CR (1u << 3)
#define MSI_48_MHZ (11u << 4)
#define PLL_ON (1u << 24)
#define PLL_READY (1u << 25)
#define PLL_80_MHZ (1u | 5u << 4 | 20u << 8 | 1u << 24) /* 48 / 6 x 20 / 2 from the MSI */
#define WATCHDOG_RESET (1u << 29)

static volatile uint32_t milliseconds;
static volatile uint64_t edge_us;
static volatile bool edge_seen;
static bool crystal;
static bool hung;
static uint32_t unique_id[3];

void systick_handler(void);
void exti2_handler(void);

static bool wait_for(uint32_t address, uint32_t mask, uint32_t wanted)
{
    for (uint32_t i = 0; i < PATIENCE; i++) {
        if ((mmio_get(address) & mask) == wanted) {
            return true;
        }
    }
    return false;
}

/* 80 MHz from the MSI oscillator, which the crystal of 32 kHz keeps at 48 MHz. Its 48 MHz are the
 * clock of USB too: without the crystal they are not exact enough for it, and the board says RC. */
static void start_clocks(void)
{
    mmio_set(RCC_APB1ENR1, 1u << 28); /* PWR */
    mmio_set(PWR_CR1, 1u << 8);       /* the crystal's register may be written */
    mmio_set(RCC_BDCR, LSE_ON);
    while (!(mmio_get(RCC_BDCR) & LSE_READY) && milliseconds < CRYSTAL_TICKS) {
        board_sleep();
    }
    crystal = mmio_get(RCC_BDCR) & LSE_READY;
    mmio_put(FLASH_ACR, 0x700u | 4u); /* caches, prefetch, 4 wait states */
    (void)wait_for(FLASH_ACR, 7u, 4u);
    mmio_field(RCC_CR, 15u << 4, MSI_48_MHZ | MSI_RANGE_FROM_CR);
    (void)wait_for(RCC_CR, MSI_READY, MSI_READY);
    if (crystal) {
        mmio_set(RCC_CR, MSI_LOCK);
    }
    mmio_put(RCC_PLLCFGR, PLL_80_MHZ);
    mmio_set(RCC_CR, PLL_ON);
    (void)wait_for(RCC_CR, PLL_READY, PLL_READY);
    mmio_field(RCC_CFGR, 3u, 3u);
    (void)wait_for(RCC_CFGR, 3u << 2, 3u << 2);
    mmio_field(RCC_CCIPR, 3u << 26, 3u << 26); /* 48 MHz of USB and RNG from the MSI */
}

static void start_usb_supply(void)
{
    mmio_set(PWR_CR2, 1u << 10);
    mmio_set(RCC_AHB2ENR, 1u << 12 | 1u << 18 | 1u); /* OTG_FS, RNG, GPIOA */
    /* PA11 and PA12, alternate function 10 */
    mmio_field(GPIOA_OSPEEDR, 0xFu << 22, 0xFu << 22);
    mmio_field(GPIOA_AFRH, 0xFFu << 12, 0xAAu << 12);
    mmio_field(GPIOA_MODER, 0xFu << 22, 0xAu << 22);
}

static void start_edge(void)
{
    mmio_set(RCC_APB2ENR, 1u); /* SYSCFG */
    mmio_field(GPIOA_MODER, 3u << 2 * EDGE_LINE, 0);
    mmio_field(SYSCFG_EXTICR1, 0xFu << 4 * EDGE_LINE, 0);
    mmio_set(EXTI_RTSR1, 1u << EDGE_LINE);
    mmio_set(EXTI_IMR1, 1u << EDGE_LINE);
    mmio_field(NVIC_IPR2, 0xFFu, BELOW_DMA); /* EXTI2 is the first of its four */
    mmio_put(NVIC_ISER0, 1u << EDGE_IRQ);
}

static void start_watchdog(void)
{
    mmio_put(IWDG_KR, 0xCCCCu);
    mmio_put(IWDG_KR, 0x5555u);
    mmio_put(IWDG_PR, 3u); /* 32 */
    mmio_put(IWDG_RLR, WATCHDOG_RELOAD);
    board_alive();
}

void board_init(void)
{
    hung = mmio_get(RCC_CSR) & WATCHDOG_RESET;
    mmio_set(RCC_CSR, 1u << 23); /* the next boot tells its own reason */
    mmio_put(SYST_RVR, TICKS_A_MS - 1);
    mmio_put(SYST_CVR, 0);
    mmio_field(SCB_SHPR3, 0xFFu << 24, (uint32_t)BELOW_DMA << 24);
    mmio_put(SYST_CSR, 7u); /* core clock, interrupt, on */
    start_clocks();
    milliseconds = 0;
    for (uint8_t i = 0; i < 3; i++) {
        unique_id[i] = mmio_get(UNIQUE_ID + 4u * i);
    }
    start_usb_supply();
    start_edge();
    start_watchdog();
}

void systick_handler(void)
{
    milliseconds++;
}

/* Microseconds, also where the tick is due and its interrupt has to wait for this one. */
static uint64_t now_us(void)
{
    uint32_t whole;
    uint32_t left;
    do {
        whole = milliseconds;
        left = mmio_get(SYST_CVR);
    } while (whole != milliseconds);
    return (uint64_t)whole * 1000u + (TICKS_A_MS - 1 - left) / CORE_MHZ;
}

/* At the same priority as the tick, so that neither interrupts the other. Where the tick has become
 * due meanwhile the time is a millisecond short; the tick is behind by less than this handler. */
void exti2_handler(void)
{
    mmio_put(EXTI_PR1, 1u << EDGE_LINE);
    const uint32_t left = mmio_get(SYST_CVR);
    const bool due = mmio_get(0xE000ED04u) >> 26 & 1u; /* ICSR: the tick is pending */
    const uint32_t whole = milliseconds + (due && left > TICKS_A_MS / 2 ? 1u : 0u);
    edge_us = (uint64_t)whole * 1000u + (TICKS_A_MS - 1 - left) / CORE_MHZ;
    edge_seen = true;
}

enum as_clock board_clock(void)
{
    return crystal ? AS_CLOCK_CRYSTAL : AS_CLOCK_RC;
}

uint64_t board_time_us(void)
{
    return now_us();
}

void board_sleep(void)
{
#ifdef MMIO_MODEL
    mmio_put(MMIO_SLEEP, 0);
#else
    __asm volatile("wfi");
#endif
}

void board_no_interrupts(bool on)
{
#ifdef MMIO_MODEL
    (void)on; /* its interrupts come in board_sleep() alone */
#else
    if (on) {
        __asm volatile("cpsid i" ::: "memory");
    } else {
        __asm volatile("cpsie i" ::: "memory");
    }
#endif
}

void board_wait_ms(uint32_t ms)
{
    const uint32_t until = milliseconds + ms + 1;
    while ((int32_t)(until - milliseconds) > 0) {
        board_alive();
        board_sleep();
    }
}

void board_alive(void)
{
    mmio_put(IWDG_KR, 0xAAAAu);
}

bool board_was_hung(void)
{
    return hung;
}

bool board_take_edge(uint64_t *us)
{
    if (!edge_seen) {
        return false;
    }
    do {
        edge_seen = false;
        *us = edge_us;
    } while (edge_seen); /* another one came between: 64 bits are two loads */
    return true;
}

const uint32_t *board_unique_id(void)
{
    return unique_id;
}

uint16_t board_random(void)
{
    mmio_set(RNG_CR, 1u << 2);
    const bool ready = wait_for(RNG_SR, 1u, 1u);
    const uint32_t number = ready ? mmio_get(RNG_DR) : mmio_get(SYST_CVR) ^ unique_id[0];
    mmio_clear(RNG_CR, 1u << 2);
    return (uint16_t)(number ^ number >> 16);
}
