/* The device: a sensor on one side, the protocol on the other. Knows no register and no board, so
 * that the same code runs on the host in tests. */
#ifndef DEVICE_H
#define DEVICE_H

#include <stdbool.h>
#include <stdint.h>

#include "as_receiver.h"
#include "as_sender.h"
#include "imu.h"

typedef struct {
    as_sender sender;
    as_receiver receiver;
    imu *sensor;
    imu_config config;
    uint8_t clock;    /* enum as_clock: what drives the time that device_poll is given */
    imu_health health; /* of the sensor, when it was read the last time */
    uint64_t silent_since_us; /* since when it does not answer */
    uint8_t doubts; /* enum imu_doubt: what was said of it */
    bool streaming;
    uint64_t began_us;         /* when the epoch began */
    uint64_t next_read_us;     /* when a frame's worth of samples will have gathered */
    uint64_t next_periodic_us; /* when descriptor and status are due */
    uint32_t descriptor_size;
    uint8_t descriptor[AS_BODY_MAX]; /* of this epoch: it does not change, whatever the sensor does */
} device;

/* Start streaming from boot, without being asked. */
void device_init(device *self, imu *sensor, as_ring *ring, const imu_config *config, uint8_t clock,
                 uint16_t epoch, uint64_t now_us);

/* Take one byte of the host. */
void device_receive(device *self, uint8_t byte, uint64_t now_us);

/* Do what is due: read the sensor, send data, descriptor, status. */
void device_poll(device *self, uint64_t now_us);

/* Samples that go into one frame: 16, or what 20 ms bring. */
uint8_t device_frame_samples(float rate_hz);

#endif
