/* The SensorTile's sensor bus: SPI2 in mode 3 with one data line (PB15), clock PB13, select PB12.
 *
 * Bytes come by DMA while the processor sleeps. As a receiver with one data line the master's clock
 * runs until it is switched off, and every byte too many takes a word out of the part's FIFO. So the
 * DMA takes all bytes but the last, and its interrupt, above all others, switches the clock off while
 * the last is on its way (RM0351, disabling the SPI in receive-only modes). Where that came too late
 * the reading has failed: what it brought is thrown away, and the loss is counted. */
#ifndef SENSOR_SPI_H
#define SENSOR_SPI_H

#include <stdbool.h>
#include <stdint.h>

/* Longest reading in bytes. */
enum { SENSOR_SPI_MOST = 512 };

/* Where the DMA writes. */
extern uint8_t sensor_spi_bytes[SENSOR_SPI_MOST];

/* Pins, with all four chip selects high, SPI and DMA. */
void sensor_spi_init(void);

/* For lsm6_bus; `context` is not used. False when the peripheral does not finish, or
 * was stopped too late. */
bool sensor_spi_read(void *context, uint8_t reg, uint8_t *to, uint16_t n);
bool sensor_spi_write(void *context, uint8_t reg, uint8_t value);

#endif
