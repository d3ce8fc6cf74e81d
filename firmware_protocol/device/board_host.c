/* A host as the board: what the device sends goes to standard output, the first so many bytes of it.
 * For the virtual clock only. The same bytes come from the real board; tests compare their hash. */
#include "board.h"

#include <stdio.h>
#include <stdlib.h>

static as_ring *transmit;
static unsigned long left;

int firmware_main(void);

int main(int argc, char **argv)
{
    left = argc > 1 ? strtoul(argv[1], NULL, 10) : 100000;
    return firmware_main();
}

void board_init(as_ring *out)
{
    transmit = out;
}

void board_kick(void)
{
    int byte;
    while ((byte = as_ring_take(transmit)) >= 0) {
        putchar(byte);
        if (--left == 0) {
            exit(fflush(stdout));
        }
    }
}

enum as_clock board_clock(void)
{
    return AS_CLOCK_EMULATED;
}

bool board_emulated(void)
{
    return true;
}

int board_receive(void)
{
    return -1;
}

uint64_t board_time_us(void)
{
    return 0;
}

void board_wait(void)
{
}
