#include "as_ring.h"

void as_ring_init(as_ring *ring, uint8_t *bytes, uint32_t size, uint32_t reserve)
{
    ring->bytes = bytes;
    ring->size = size;
    ring->reserve = reserve;
    ring->put = 0;
    ring->taken = 0;
}

uint32_t as_ring_room(const as_ring *ring, enum as_room room)
{
    const uint32_t room_left = ring->size - (ring->put - ring->taken);
    const uint32_t kept = room == AS_ROOM_DATA ? ring->reserve : 0;
    return room_left > kept ? room_left - kept : 0;
}

bool as_ring_put(as_ring *ring, const uint8_t *from, uint32_t n, enum as_room room)
{
    if (n > as_ring_room(ring, room)) {
        return false;
    }
    const uint32_t start = ring->put;
    for (uint32_t i = 0; i < n; i++) {
        ring->bytes[(start + i) & (ring->size - 1)] = from[i];
    }
    ring->put = start + n; /* last, so that the other side never sees half a frame */
    return true;
}

int as_ring_take(as_ring *ring)
{
    const uint32_t at = ring->taken;
    if (at == ring->put) {
        return -1;
    }
    const uint8_t byte = ring->bytes[at & (ring->size - 1)];
    ring->taken = at + 1;
    return byte;
}

uint32_t as_ring_waiting(const as_ring *ring)
{
    return ring->put - ring->taken;
}

uint32_t as_ring_peek(const as_ring *ring, const uint8_t **from)
{
    const uint32_t at = ring->taken & (ring->size - 1);
    const uint32_t waiting = as_ring_waiting(ring);
    const uint32_t to_end = ring->size - at;
    *from = ring->bytes + at;
    return waiting < to_end ? waiting : to_end;
}

void as_ring_drop(as_ring *ring, uint32_t n)
{
    const uint32_t waiting = as_ring_waiting(ring);
    ring->taken += n < waiting ? n : waiting;
}

void as_ring_keep(as_ring *ring, uint32_t n)
{
    if (n < as_ring_waiting(ring)) {
        ring->put = ring->taken + n;
    }
}
