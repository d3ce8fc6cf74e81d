/* The SensorTile's sensor bus: SPI mode 3 with one data line (PB15), clock PB13, moved by software.
 *
 * The SPI peripheral would be no help here. With one line its clock runs on after the last byte until
 * the program switches it off, by DMA too, and every byte too many takes a word out of the FIFO. */
#ifndef SPI_PINS_H
#define SPI_PINS_H

#include <stdbool.h>
#include <stdint.h>

/* Pins, and all four chip selects high. */
void spi_pins_init(void);

/* For lsm6_bus; `context` is not used. SPI does not acknowledge, so they cannot fail. */
bool spi_pins_read(void *context, uint8_t reg, uint8_t *to, uint16_t n);
bool spi_pins_write(void *context, uint8_t reg, uint8_t value);

#endif
