/* CRC-32 of zlib and Ethernet; of "123456789" it is 0xCBF43926. */
#ifndef AS_CRC32_H
#define AS_CRC32_H

#include <stddef.h>
#include <stdint.h>

uint32_t as_crc32(const uint8_t *data, size_t n);

#endif
