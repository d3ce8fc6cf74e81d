#include "as_cobs.h"

size_t as_cobs_encode(const uint8_t *in, size_t n, uint8_t *out)
{
    size_t code_at = 0; /* where the distance to the next zero will stand */
    size_t used = 1;
    uint8_t code = 1;
    for (size_t i = 0; i < n; i++) {
        if (in[i] != 0) {
            out[used++] = in[i];
            code++;
        }
        if (in[i] == 0 || code == 0xFF) {
            out[code_at] = code;
            /* A full run of 254 that ends the data needs no further distance. */
            if (in[i] != 0 && i + 1 == n) {
                return used;
            }
            code_at = used++;
            code = 1;
        }
    }
    out[code_at] = code;
    return used;
}

size_t as_cobs_decode(const uint8_t *in, size_t n, uint8_t *out)
{
    size_t read = 0;
    size_t used = 0;
    while (read < n) {
        const uint8_t code = in[read++];
        if (code == 0 || (size_t)(code - 1) > n - read) {
            return 0;
        }
        for (uint8_t i = 1; i < code; i++) {
            if (in[read] == 0) {
                return 0;
            }
            out[used++] = in[read++];
        }
        if (code != 0xFF && read < n) {
            out[used++] = 0;
        }
    }
    return used;
}
