/* The batch reader of the native protocol: `wire/native/table.py`. */

#include "kernels.h"

enum {
    DATA = 0x01,
    VERSION_MAJOR = 1,
    MOST_SAMPLES = 18,
    HEAD_BYTES = 26,
    SAMPLE_BYTES = 12,
    CRC_BYTES = 4,
    SHORTEST = 8 + CRC_BYTES,
    LONGEST_CHUNK = 247
};

static uint32_t word_at(const uint8_t *bytes) {
    return (uint32_t)bytes[0] | (uint32_t)bytes[1] << 8 | (uint32_t)bytes[2] << 16
           | (uint32_t)bytes[3] << 24;
}

/* Go on with a CRC-32, by eight bytes at a time. */
static uint32_t crc_with(uint32_t crc, const uint8_t *data, int64_t size, const uint32_t (*table)[256]) {
    int64_t whole = size & ~(int64_t)7;
    for (int64_t i = 0; i < whole; i += 8) {
        uint32_t low = crc ^ word_at(data + i), high = word_at(data + i + 4);
        crc = table[7][low & 0xFF] ^ table[6][low >> 8 & 0xFF] ^ table[5][low >> 16 & 0xFF]
              ^ table[4][low >> 24] ^ table[3][high & 0xFF] ^ table[2][high >> 8 & 0xFF]
              ^ table[1][high >> 16 & 0xFF] ^ table[0][high >> 24];
    }
    for (int64_t i = whole; i < size; i++) crc = crc >> 8 ^ table[0][(crc ^ data[i]) & 0xFF];
    return crc;
}

#if defined(__AVX2__)
#include <immintrin.h>

/* Replace the first blocks of 16 bytes by one that has the same remainder, by products without carries
   with x^160 and x^96 modulo the polynomial (Gopal et al., "Fast CRC computation for generic polynomials
   using PCLMULQDQ", Intel 2009); `folded` receives it. Return how many bytes it stands for. Every
   processor with AVX2 that `processor.c` takes has the instruction. */
__attribute__((target("pclmul"))) static int64_t
fold(uint32_t crc, const uint8_t *data, int64_t size, uint8_t *folded) {
    const __m128i powers = _mm_set_epi64x(0x0ccaa009e, 0x1751997d0);
    __m128i rest = _mm_xor_si128(_mm_loadu_si128((const __m128i *)data), _mm_cvtsi32_si128((int32_t)crc));
    int64_t i = 16;
    for (; i + 16 <= size; i += 16) {
        __m128i low = _mm_clmulepi64_si128(rest, powers, 0x00);
        __m128i high = _mm_clmulepi64_si128(rest, powers, 0x11);
        rest = _mm_xor_si128(_mm_xor_si128(low, high), _mm_loadu_si128((const __m128i *)(data + i)));
    }
    _mm_storeu_si128((__m128i *)folded, rest);
    return i;
}
#endif

static uint32_t crc32(const uint8_t *data, int64_t size, const uint32_t (*table)[256]) {
    uint32_t crc = 0xFFFFFFFFu;
#if defined(__AVX2__)
    if (size >= 32) {
        uint8_t folded[16];
        int64_t done = fold(crc, data, size, folded);
        crc = crc_with(0, folded, sizeof folded, table);
        data += done, size -= done;
    }
#endif
    return crc_with(crc, data, size, table) ^ 0xFFFFFFFFu;
}

/* Write the frame that starts at `data` and return how far off its final zero is, or -1. */
static int64_t cobs_decode(const uint8_t *data, int64_t left, uint8_t *frame) {
    int64_t size = least(left, LONGEST_CHUNK + 1), here = data[0];
    if (here == 0) return -1;
    memcpy(frame, data + 1, (size_t)size - 1);
    while (here < size && data[here] != 0) {
        frame[here - 1] = 0;
        here += data[here];
    }
    if (here >= size) return -1;
    if (memchr(data + 1, 0, (size_t)here - 1) != NULL)
        return -1; /* the walk has stepped over the end of a truncated frame */
    return here;
}

static int is_data(const uint8_t *frame, int64_t size) {
    int n = frame[7];
    return frame[0] == DATA && frame[1] >> 4 == VERSION_MAJOR && 1 <= n && n <= MOST_SAMPLES
           && size == HEAD_BYTES + SAMPLE_BYTES * n;
}

/* Read all complete frames of a buffer that starts at the beginning of a chunk.

   `found` receives: data frames, bytes of their samples, other frames, CRC errors, malformed frames,
   where the first incomplete chunk starts, whether the next may be the tail of a frame, and whether
   it is already longer than a frame can be. The other arrays: see `wire/native/table.py`. */
KERNEL(void, read_frames)
(const uint8_t *data, int64_t end, int64_t joining, const uint32_t *tables, uint8_t *headers,
 int64_t *ends, uint8_t *samples, uint8_t *others, int64_t *other_rows, int64_t *other_ends,
 int64_t *found) {
    const uint32_t(*table)[256] = (const uint32_t(*)[256])tables;
    uint8_t frame[LONGEST_CHUNK + 1];
    int64_t rows = 0, filled = 0, other_count = 0, other_filled = 0, crc_errors = 0, malformed = 0;
    int64_t start = 0;
    while (start < end) {
        if (data[start] == 0) {
            start++;
            continue;
        }
        int64_t length = cobs_decode(data + start, end - start, frame);
        int sound = length >= 0;
        if (!sound) {
            const uint8_t *stop = memchr(data + start, 0, (size_t)(end - start));
            if (stop == NULL) break;
            length = stop - (data + start);
        }
        int64_t was_joining = joining, size = length - 1;
        joining = 0;
        start += length + 1;
        if (!sound || size < SHORTEST) {
            malformed++;
            continue;
        }
        size -= CRC_BYTES;
        if (crc32(frame, size, table) != word_at(frame + size)) {
            if (was_joining)
                malformed++;
            else
                crc_errors++;
        } else if (is_data(frame, size)) {
            memcpy(headers + rows * HEAD_BYTES, frame, HEAD_BYTES);
            memcpy(samples + filled, frame + HEAD_BYTES, (size_t)size - HEAD_BYTES);
            filled += size - HEAD_BYTES;
            ends[rows++] = start;
        } else {
            memcpy(others + other_filled, frame, (size_t)size);
            other_filled += size;
            other_rows[other_count] = rows;
            other_ends[other_count++] = other_filled;
        }
    }
    found[0] = rows, found[1] = filled, found[2] = other_count, found[3] = crc_errors;
    found[4] = malformed, found[5] = start, found[6] = joining, found[7] = end - start > LONGEST_CHUNK;
}
