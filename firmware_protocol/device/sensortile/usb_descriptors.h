/* What the board tells a USB host about itself: a serial port of the communications class (CDC ACM). */
#ifndef USB_DESCRIPTORS_H
#define USB_DESCRIPTORS_H

#include <stdint.h>

enum {
    USB_PACKET = 64,
    USB_DATA_ENDPOINT = 1,   /* bulk, both directions */
    USB_NOTICE_ENDPOINT = 2, /* interrupt IN; the class wants it, and nothing is ever sent on it */
    USB_NOTICE_PACKET = 8
};

/* The descriptor of a type and index, and its length; 0 for one that there is not. `unique_id` is the
 * chip's 96 bits, which become the serial number. */
const uint8_t *usb_descriptor(uint8_t type, uint8_t index, const uint32_t unique_id[3],
                              uint16_t *length);

#endif
