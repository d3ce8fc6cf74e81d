/* A synthetic LSM6DSM whose every value is a function of its index, so that the host can check each
 * one.
 *
 * Counts of axis a at index k come from a hash of (k, a): four bytes added up are close to normal
 * with a standard deviation of 148 / 16 = 9.2 counts. The accelerometer's z carries 1 g. */
#ifndef SYNTHETIC_H
#define SYNTHETIC_H

#include "imu.h"

/* Samples that it keeps until it is read; older ones are lost, as in a part's FIFO. */
enum { SYNTHETIC_FIFO = 2048 };

typedef struct {
    imu base;
    imu_config config;
    uint32_t index; /* of the next sample */
    uint32_t due;   /* samples that time has brought */
} synthetic_imu;

void synthetic_init(synthetic_imu *self);

/* The count of one axis at one index. */
int16_t synthetic_count(uint32_t index, uint32_t axis, float accel_sensitivity);

/* Let time bring samples: those up to `index`, exclusive. */
void synthetic_advance(synthetic_imu *self, uint32_t index);

#endif
