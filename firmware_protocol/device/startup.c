/* From reset to main: the vector table, the memory that C expects, the FPU. */
#include <stdint.h>

extern uint32_t stack_top, data_load, data_start, data_end, bss_start, bss_end;

int main(void);
void systick_handler(void);

/* A board has those that it uses. */
__attribute__((weak)) void exti2_handler(void);
__attribute__((weak)) void dma1_channel4_handler(void);
__attribute__((weak)) void usart1_handler(void);

void reset_handler(void);
static void stuck(void);

enum { EXTI2_IRQ = 8, DMA1_CHANNEL4_IRQ = 14, USART1_IRQ = 37, SYSTEM_VECTORS = 16 };

__attribute__((section(".vectors"), used)) static const struct {
    void *stack;
    void (*handlers[SYSTEM_VECTORS - 1 + USART1_IRQ + 1])(void);
} vectors = {
    &stack_top,
    {
        [0] = reset_handler,
        [1] = stuck, /* NMI */
        [2] = stuck, /* hard fault */
        [3] = stuck, /* memory management */
        [4] = stuck, /* bus fault */
        [5] = stuck, /* usage fault */
        [14] = systick_handler,
        [SYSTEM_VECTORS - 1 + EXTI2_IRQ] = exti2_handler,
        [SYSTEM_VECTORS - 1 + DMA1_CHANNEL4_IRQ] = dma1_channel4_handler,
        [SYSTEM_VECTORS - 1 + USART1_IRQ] = usart1_handler,
    },
};

void reset_handler(void)
{
    const uint32_t *from = &data_load;
    for (uint32_t *to = &data_start; to < &data_end; to++) {
        *to = *from++;
    }
    for (uint32_t *to = &bss_start; to < &bss_end; to++) {
        *to = 0;
    }
    *(volatile uint32_t *)0xE000ED88u |= 0xFu << 20; /* CPACR: full access to the FPU */
    __asm volatile("dsb\n isb");
    (void)main();
    stuck();
}

/* A fault stops the board, and a watchdog starts it again: the host sees a device that has fallen
 * silent, never a wrong sample. */
static void stuck(void)
{
    for (;;) {
        __asm volatile("wfi");
    }
}
