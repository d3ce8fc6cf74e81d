/* The descriptor: what the device says about itself, PROTOCOL.md section 5. */
#ifndef DESCRIPTOR_H
#define DESCRIPTOR_H

#include <stdint.h>

#include "imu.h"

/* Write the body of a descriptor frame; `body` has room for AS_BODY_MAX. Returns its length. */
uint32_t descriptor_write(imu *sensor, const imu_config *config, uint8_t clock, uint8_t *body);

#endif
