#include "usb_descriptors.h"

enum {
    DEVICE = 1,
    CONFIGURATION = 2,
    STRING = 3,
    INTERFACE = 4,
    ENDPOINT = 5,
    CLASS_INTERFACE = 0x24,
    CONFIGURATION_SIZE = 67,
    SERIAL_DIGITS = 24,
    LONGEST_TEXT = 32
};

/* 0483:5740 is ST's number for a virtual serial port, which its examples for this board have too. */
static const uint8_t device[] = {
    18,   DEVICE, 0x00, 0x02,        /* USB 2.0 */
    0x02, 0,      0,    USB_PACKET,  /* communications class */
    0x83, 0x04,   0x40, 0x57,        /* vendor, product */
    0x00, 0x03,   1,    2,    3,  1, /* release, manufacturer, product, serial number; 1 configuration */
};

static const uint8_t configuration[CONFIGURATION_SIZE] = {
    9, CONFIGURATION, CONFIGURATION_SIZE, 0, 2, 1, 0, 0xC0, 50, /* own supply possible, 100 mA */
    /* interface 0, control: ACM, no protocol */
    9, INTERFACE, 0, 0, 1, 0x02, 0x02, 0x00, 0,
    5, CLASS_INTERFACE, 0x00, 0x10, 0x01, /* header: CDC 1.10 */
    5, CLASS_INTERFACE, 0x01, 0x00, 1,    /* no call management; data on interface 1 */
    4, CLASS_INTERFACE, 0x02, 0x02,       /* ACM: line coding and control lines */
    5, CLASS_INTERFACE, 0x06, 0, 1,       /* union of interfaces 0 and 1 */
    7, ENDPOINT, 0x80 | USB_NOTICE_ENDPOINT, 3, USB_NOTICE_PACKET, 0, 255,
    /* interface 1, data */
    9, INTERFACE, 1, 0, 2, 0x0A, 0x00, 0x00, 0,
    7, ENDPOINT, USB_DATA_ENDPOINT, 2, USB_PACKET, 0, 0,
    7, ENDPOINT, 0x80 | USB_DATA_ENDPOINT, 2, USB_PACKET, 0, 0,
};

static const uint8_t languages[] = {4, STRING, 0x09, 0x04};

static const char *const texts[] = {"allanscope", "SensorTile, native protocol"};

static uint8_t built[2 + 2 * LONGEST_TEXT];

static const uint8_t *text(const char *from, uint16_t *length)
{
    uint8_t n = 0;
    while (from[n] != '\0' && n < LONGEST_TEXT) {
        built[2 + 2 * n] = (uint8_t)from[n];
        built[3 + 2 * n] = 0;
        n++;
    }
    built[0] = (uint8_t)(2 + 2 * n);
    built[1] = STRING;
    *length = built[0];
    return built;
}

static const uint8_t *serial_number(const uint32_t unique_id[3], uint16_t *length)
{
    char digits[SERIAL_DIGITS + 1];
    for (uint8_t i = 0; i < SERIAL_DIGITS; i++) {
        digits[i] = "0123456789ABCDEF"[unique_id[i / 8] >> (28 - 4 * (i % 8)) & 0xFu];
    }
    digits[SERIAL_DIGITS] = '\0';
    return text(digits, length);
}

const uint8_t *usb_descriptor(uint8_t type, uint8_t index, const uint32_t unique_id[3],
                              uint16_t *length)
{
    if (type == DEVICE && index == 0) {
        *length = sizeof device;
        return device;
    }
    if (type == CONFIGURATION && index == 0) {
        *length = sizeof configuration;
        return configuration;
    }
    if (type == STRING && index == 0) {
        *length = sizeof languages;
        return languages;
    }
    if (type == STRING && index <= 2) {
        return text(texts[index - 1], length);
    }
    if (type == STRING && index == 3) {
        return serial_number(unique_id, length);
    }
    return 0;
}
