/* What the firmware needs of the SensorTile besides its bus and its USB port. */
#ifndef BOARD_SENSORTILE_H
#define BOARD_SENSORTILE_H

#include <stdbool.h>
#include <stdint.h>

#include "as_layout.h"

/* Clocks, pins, tick, interrupt of the sensor, watchdog. */
void board_init(void);

/* What drives board_time_us: the crystal of 32 kHz, or the RC oscillator alone where it is dead. */
enum as_clock board_clock(void);

/* Time since boot. */
uint64_t board_time_us(void);

/* Wait; the watchdog knows of it. */
void board_wait_ms(uint32_t ms);

/* Sleep until the next interrupt, at most a millisecond. */
void board_sleep(void);

/* Hold interrupts back, or let them come. One that is held back ends a sleep all the same. */
void board_no_interrupts(bool on);

/* Tell the watchdog that the main loop turns; two seconds without restart the chip. */
void board_alive(void);

/* Whether the watchdog had to restart the chip. */
bool board_was_hung(void);

/* The last rising edge of the sensor's interrupt, once; false when there was none. */
bool board_take_edge(uint64_t *edge_us);

/* The chip's own number of 96 bits. */
const uint32_t *board_unique_id(void);

/* A number that is another one at every boot. */
uint16_t board_random(void);

#endif
