/* What a host says: bytes in, commands out. A damaged frame is counted and forgotten. */
#ifndef AS_RECEIVER_H
#define AS_RECEIVER_H

#include <stdbool.h>
#include <stdint.h>

#include "as_layout.h"

typedef struct {
    uint8_t type;
    uint8_t version;
    uint16_t seq;
    uint8_t n;
    const uint8_t *body; /* valid until the next byte is fed */
} as_command;

typedef struct {
    uint8_t bytes[AS_WIRE_MAX];
    uint32_t used;
    bool too_long;
    uint32_t bad; /* chunks that were no frame */
} as_receiver;

void as_receiver_init(as_receiver *receiver);

/* Take one byte; returns true when it completes a command. */
bool as_receive(as_receiver *receiver, uint8_t byte, as_command *command);

#endif
