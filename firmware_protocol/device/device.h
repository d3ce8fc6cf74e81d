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
    bool draining;    /* the sensor has more than was read in one go */
    bool watermarked; /* the sensor's interrupt rose, and nothing was read since */
    uint64_t watermark_us;
    uint8_t missed_edges; /* frames in a row that had gathered without the interrupt */
    bool deaf;            /* the interrupt does not come: the sensor is read by time */
    uint64_t next_first_us; /* time of the next sample, counted from an edge; 0 not known */
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

/* The sensor's interrupt rose at this time: its FIFO reached the watermark. */
void device_watermark(device *self, uint64_t edge_us);

/* A host has opened the port. Returns whether what waited for it was old and has been thrown away,
 * but for the bytes under way. */
bool device_opened(device *self, uint32_t under_way);

/* Say something in words: level 0 a remark, 1 a warning, 2 an error. */
void device_tell(device *self, uint64_t now_us, uint8_t level, const char *text);

/* Do what is due: read one frame of samples, send it, descriptor and status. Returns whether the
 * sensor has more: poll again at once, but take commands in between. */
bool device_poll(device *self, uint64_t now_us);

#endif
