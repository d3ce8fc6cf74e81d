/* The STM32L475 of the B-L475E-IOT01A: USART1 with interrupts, SysTick at 1 kHz. */
#include "board.h"

#include <stdint.h>

#define REG(address) (*(volatile uint32_t *)(address))

#define RCC_APB2ENR REG(0x40021060u)
#define RCC_AHB2ENR REG(0x4002104Cu)
#define GPIOB_MODER REG(0x48000400u)
#define GPIOB_AFRL REG(0x48000420u)
#define USART1_CR1 REG(0x40013800u)
#define USART1_BRR REG(0x4001380Cu)
#define USART1_ISR REG(0x4001381Cu)
#define USART1_ICR REG(0x40013820u)
#define USART1_RDR REG(0x40013824u)
#define USART1_TDR REG(0x40013828u)
#define NVIC_ISER1 REG(0xE000E104u)
#define SYST_CSR REG(0xE000E010u)
#define SYST_RVR REG(0xE000E014u)
#define SYST_CVR REG(0xE000E018u)

enum {
    CORE_HZ = 4000000, /* the MSI oscillator after reset */
    TICK_HZ = 1000,
    BAUD = 250000,
    CR1_UE = 1 << 0,
    CR1_RE = 1 << 2,
    CR1_TE = 1 << 3,
    CR1_RXNEIE = 1 << 5,
    CR1_TXEIE = 1 << 7,
    ISR_ORE = 1 << 3,
    ISR_RXNE = 1 << 5,
    ISR_TXE = 1 << 7,
    RECEIVE_SIZE = 512 /* a power of two */
};

static as_ring *transmit;
static uint8_t received[RECEIVE_SIZE];
static volatile uint32_t received_put;
static uint32_t received_taken;
static volatile uint32_t milliseconds;

void systick_handler(void);
void usart1_handler(void);

void board_init(as_ring *out)
{
    transmit = out;
    RCC_AHB2ENR |= 1u << 1;
    RCC_APB2ENR |= 1u << 14;
    /* PB6 and PB7 are USART1's TX and RX, alternate function 7. */
    GPIOB_MODER = (GPIOB_MODER & ~(0xFu << 12)) | 0xAu << 12;
    GPIOB_AFRL = (GPIOB_AFRL & ~(0xFFu << 24)) | 0x77u << 24;
    USART1_BRR = CORE_HZ / BAUD;
    USART1_CR1 = CR1_UE | CR1_RE | CR1_TE | CR1_RXNEIE;
    NVIC_ISER1 = 1u << (37 - 32);
    SYST_RVR = CORE_HZ / TICK_HZ - 1;
    SYST_CVR = 0;
    SYST_CSR = 7; /* core clock, interrupt, on */
}

void systick_handler(void)
{
    milliseconds++;
}

void usart1_handler(void)
{
    const uint32_t status = USART1_ISR;
    if (status & ISR_RXNE) {
        const uint8_t byte = (uint8_t)USART1_RDR;
        /* A full buffer loses the byte; the CRC of the command tells. */
        received[received_put & (RECEIVE_SIZE - 1)] = byte;
        received_put++;
    }
    if (status & ISR_ORE) {
        USART1_ICR = ISR_ORE;
    }
    if ((status & ISR_TXE) && (USART1_CR1 & CR1_TXEIE)) {
        const int next = as_ring_take(transmit);
        if (next < 0) {
            USART1_CR1 &= ~(uint32_t)CR1_TXEIE;
        } else {
            USART1_TDR = (uint32_t)next;
        }
    } else if (!(status & (ISR_RXNE | ISR_ORE))) {
        /* QEMU calls for ever while its port takes nothing, and the main loop would stand still; the
         * next kick asks again. */
        USART1_CR1 &= ~(uint32_t)CR1_TXEIE;
    }
}

void board_kick(void)
{
    /* The handler also writes CR1: without the mask its change could be undone here. */
    __asm volatile("cpsid i");
    USART1_CR1 |= CR1_TXEIE;
    __asm volatile("cpsie i");
}

/* The tick comes from the MSI oscillator, which is no crystal; an emulator has neither, and its
 * tick falls behind when the computer is busy. Nothing that the program could read tells the two
 * apart, so that the Makefile says for which one it builds. */
enum as_clock board_clock(void)
{
    return board_emulated() ? AS_CLOCK_EMULATED : AS_CLOCK_RC;
}

bool board_emulated(void)
{
#ifdef EMULATED
    return true;
#else
    return false;
#endif
}

int board_receive(void)
{
    if (received_taken == received_put) {
        return -1;
    }
    return received[received_taken++ & (RECEIVE_SIZE - 1)];
}

uint64_t board_time_us(void)
{
    /* Read the millisecond again when it changed in between: the two belong together. */
    uint32_t whole;
    uint32_t left;
    do {
        whole = milliseconds;
        left = SYST_CVR;
    } while (whole != milliseconds);
    return (uint64_t)whole * 1000u + (CORE_HZ / TICK_HZ - 1 - left) / (CORE_HZ / 1000000);
}

void board_wait(void)
{
    __asm volatile("wfi");
}
