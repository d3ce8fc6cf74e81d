/* A USB serial port on the OTG_FS peripheral of the STM32L476, asked from the main loop.
 *
 * No interrupt and no callback: the peripheral holds what the host sends until it is asked and tells
 * the host to wait meanwhile, so that one millisecond more or less costs nothing. A transfer that an
 * unplugged cable cuts off is forgotten when the host resets the bus; no state outlives it. */
#ifndef USB_CDC_H
#define USB_CDC_H

#include <stdbool.h>
#include <stdint.h>

#include "as_ring.h"

/* Connect to the bus; what is in `out` is sent from then on. The clock of 48 MHz must run. */
void usb_cdc_init(as_ring *out, const uint32_t unique_id[3], void (*wait_ms)(uint32_t ms));

/* Do what the host wants and send what waits; at least every few milliseconds. */
void usb_cdc_poll(void);

/* The next byte of the host, or -1. */
int usb_cdc_receive(void);

/* Whether a program has opened the port since this was asked the last time (DTR has risen). */
bool usb_cdc_opened(void);

/* Throw away what has left the queue and was not fetched yet. */
void usb_cdc_discard(void);

#endif
