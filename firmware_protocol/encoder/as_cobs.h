/* Consistent overhead byte stuffing (Cheshire and Baker 1999): removes all zeros from a frame, so
 * that a zero can end it. */
#ifndef AS_COBS_H
#define AS_COBS_H

#include <stddef.h>
#include <stdint.h>

/* Room that the encoded form of n bytes can need. */
#define AS_COBS_MAX(n) ((n) + (n) / 254 + 1)

/* Encode n bytes; out needs AS_COBS_MAX(n). Returns the encoded length, no zero at the end. */
size_t as_cobs_encode(const uint8_t *in, size_t n, uint8_t *out);

/* Decode n bytes, none of which is the final zero; out needs n and may be in itself. Returns the
 * decoded length, or 0 where the bytes are no COBS: a zero inside, or a distance past the end. */
size_t as_cobs_decode(const uint8_t *in, size_t n, uint8_t *out);

#endif
