/* The transmit queue: whole frames in, single bytes out.
 *
 * One side puts (the main loop), the other takes (the interrupt of a USART, or the USB task); on one
 * core neither needs a lock, because each index is written by one side only. Data may fill the
 * ring only up to `reserve` bytes below its size: what is left belongs to replies, descriptors and
 * status, so that the answer to a stop finds room in a ring full of data. */
#ifndef AS_RING_H
#define AS_RING_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct {
    uint8_t *bytes;
    uint32_t size; /* a power of two */
    uint32_t reserve;
    volatile uint32_t put;   /* bytes ever put, modulo 2^32 */
    volatile uint32_t taken; /* bytes ever taken */
} as_ring;

enum as_room { AS_ROOM_DATA, AS_ROOM_REPLY };

/* size must be a power of two and larger than reserve. */
void as_ring_init(as_ring *ring, uint8_t *bytes, uint32_t size, uint32_t reserve);

/* Bytes that can be put now. */
uint32_t as_ring_room(const as_ring *ring, enum as_room room);

/* Put all of n bytes or none; returns whether they fitted. */
bool as_ring_put(as_ring *ring, const uint8_t *from, uint32_t n, enum as_room room);

/* Take one byte; returns -1 when there is none. */
int as_ring_take(as_ring *ring);

/* Bytes that wait to be taken. */
uint32_t as_ring_waiting(const as_ring *ring);

/* The longest run of waiting bytes that lies in one piece, for DMA and USB; as_ring_drop removes
 * what was sent of it, and never more than waits. */
uint32_t as_ring_peek(const as_ring *ring, const uint8_t **from);
void as_ring_drop(as_ring *ring, uint32_t n);

/* Throw away all but the n bytes that have waited longest. By the side that puts, while the other one
 * does not take. */
void as_ring_keep(as_ring *ring, uint32_t n);

#endif
