/* A sensor as the firmware sees it: configure it, then ask for what it has gathered.
 *
 * Two stand behind it: synthetic.c, whose every value the host can compute, and lsm6dsm.c, the real
 * part over I2C or SPI. */
#ifndef IMU_H
#define IMU_H

#include <stdbool.h>
#include <stdint.h>

#include "as_layout.h"

typedef struct {
    float rate_hz;
    float gyro_full_scale;  /* dps */
    float accel_full_scale; /* g */
} imu_config;

/* What one reading brought. */
typedef struct {
    uint8_t n;            /* contiguous samples */
    uint32_t lost_before; /* samples that the sensor's FIFO lost before the first of them */
    uint32_t behind;      /* samples that the sensor had gathered besides, after the last of them */
    uint32_t sensor_time; /* of the first, 25 us ticks unwrapped to 32 bits */
    uint8_t doubts;       /* IMU_STAMP_STALLED, IMU_STATUS_CONTRADICTS */
    int16_t temperature;
    int16_t samples[AS_MOST_SAMPLES][AS_AXES];
} imu_batch;

/* What a sensor that answers and has its settings says that cannot be. */
enum imu_doubt {
    IMU_STAMP_STALLED = 1,     /* samples come, and its time stamp stands still */
    IMU_STATUS_CONTRADICTS = 2 /* its FIFO is empty and is not; nothing is read from it */
};

/* How the sensor is. */
typedef enum {
    IMU_WELL,
    IMU_SILENT, /* nothing comes, or what a dead bus gives */
    IMU_RESET   /* it answers, but no longer has the settings that it was given */
} imu_health;

typedef struct imu imu;
struct imu {
    /* Set the sensor up; `config` is changed to what it really does. False: not possible, and
     * nothing was changed. */
    bool (*configure)(imu *self, imu_config *config);

    /* Read at most `most` samples; none unless the sensor is well. */
    imu_health (*read)(imu *self, uint8_t most, imu_batch *batch);

    /* Register contents worth telling the host, as pairs of address and content; returns bytes. */
    uint8_t (*registers)(imu *self, uint8_t *pairs, uint8_t room);

    const char *part;
    uint8_t who_am_i;
    uint8_t source; /* enum as_source: where the samples come from */
    uint8_t watermark; /* samples at which its interrupt rises; 0 when it has none */
    float counts_per_degc;
};

/* Sensitivities of the family, dps and g a count; 0 for a full scale that does not exist. */
float imu_gyro_sensitivity(float full_scale);
float imu_accel_sensitivity(float full_scale);

/* The rate of the family nearest to the one asked for, within 5 %; 0 when there is none. */
float imu_nearest_rate(float rate_hz);

/* Samples that go into one frame: 16, or what 20 ms bring. */
uint8_t imu_frame_samples(float rate_hz);

#endif
