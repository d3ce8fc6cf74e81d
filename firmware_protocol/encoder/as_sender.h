/* Everything that a device sends: frames with their header, number and CRC, into the queue.
 *
 * The sender keeps the books that PROTOCOL.md section 8 asks for. A frame takes a number only when
 * it has found room in the queue; samples that find none are dropped, counted, and announced by a
 * flag of the next data frame, whose index has gone on. */
#ifndef AS_SENDER_H
#define AS_SENDER_H

#include <stdbool.h>
#include <stdint.h>

#include "as_layout.h"
#include "as_ring.h"

typedef struct {
    as_ring *ring;
    uint16_t seq;
    uint16_t epoch;
    uint32_t produced; /* samples of this epoch, lost ones included: the index of the next one */
    uint32_t sent;
    uint32_t dropped;
    uint32_t overruns;
    uint32_t commands;
    uint32_t bad_commands;
    uint8_t pending_flags; /* for the next data frame that finds room */
} as_sender;

/* Contiguous samples, 1 to AS_MOST_SAMPLES, with the times of the first. */
typedef struct {
    uint64_t mcu_time_us;
    uint32_t sensor_time;
    int16_t temperature;
    uint8_t channels; /* AS_GYRO_VALID, AS_ACCEL_VALID, AS_SELF_TEST */
    uint8_t n;
    const int16_t (*samples)[AS_AXES];
} as_data;

/* Start with an empty queue; puts the zero that ends whatever the host heard before. */
void as_sender_init(as_sender *sender, as_ring *ring, uint16_t epoch);

/* Put a zero, which ends whatever the host heard before. */
void as_send_zero(as_sender *sender);

/* Begin a new epoch: index and counters of samples start at 0. */
void as_new_epoch(as_sender *sender);

/* Count samples that the sensor lost before they could be read. */
void as_sensor_lost(as_sender *sender, uint32_t samples);

/* Each returns whether the frame found room. Bodies that are too long are refused. */
bool as_send_data(as_sender *sender, const as_data *data);
bool as_send_body(as_sender *sender, enum as_type type, const uint8_t *body, uint32_t n);
bool as_send_status(as_sender *sender, uint64_t mcu_time_us);
bool as_send_event(as_sender *sender, uint64_t mcu_time_us, uint8_t level, const char *text);
bool as_send_reply(as_sender *sender, uint16_t command_seq, uint8_t command,
                   enum as_result result, const uint8_t *payload, uint32_t n);

#endif
