/* What the firmware needs of a board: a byte pipe to the host, and the time. */
#ifndef BOARD_H
#define BOARD_H

#include <stdbool.h>
#include <stdint.h>

#include "as_layout.h"
#include "as_ring.h"

/* Start clocks, the serial port and the tick; bytes of `out` are sent from then on. */
void board_init(as_ring *out);

/* Wake the transmitter after something was put into the ring. */
void board_kick(void);

/* What drives board_time_us, and whether the board itself is emulated. */
enum as_clock board_clock(void);
bool board_emulated(void);

/* The next byte of the host, or -1. */
int board_receive(void);

/* Time since boot. */
uint64_t board_time_us(void);

/* Sleep until the next interrupt. */
void board_wait(void);

#endif
