#include "as_sender.h"

#include "as_bytes.h"
#include "as_cobs.h"
#include "as_crc32.h"

static uint8_t *put_header(const as_sender *sender, uint8_t *at, enum as_type type, uint8_t flags,
                           uint8_t n)
{
    at = as_put8(at, (uint8_t)type);
    at = as_put8(at, AS_VERSION);
    at = as_put16(at, sender->seq);
    at = as_put16(at, sender->epoch);
    at = as_put8(at, flags);
    return as_put8(at, n);
}

/* Add the CRC, stuff, queue; the number is used up only if there was room. */
static bool queue_frame(as_sender *sender, uint8_t *frame, uint8_t *end, enum as_room room)
{
    uint8_t wire[AS_WIRE_MAX];
    end = as_put32(end, as_crc32(frame, (size_t)(end - frame)));
    size_t n = as_cobs_encode(frame, (size_t)(end - frame), wire);
    wire[n++] = 0;
    if (!as_ring_put(sender->ring, wire, (uint32_t)n, room)) {
        return false;
    }
    sender->seq++;
    return true;
}

void as_sender_init(as_sender *sender, as_ring *ring, uint16_t epoch)
{
    sender->ring = ring;
    sender->seq = 0;
    sender->epoch = (uint16_t)(epoch - 1);
    sender->overruns = 0;
    sender->commands = 0;
    sender->bad_commands = 0;
    as_new_epoch(sender);
    as_send_zero(sender);
}

void as_send_zero(as_sender *sender)
{
    static const uint8_t zero = 0;
    (void)as_ring_put(sender->ring, &zero, 1, AS_ROOM_REPLY);
}

void as_new_epoch(as_sender *sender)
{
    sender->epoch++;
    sender->produced = 0;
    sender->sent = 0;
    sender->dropped = 0;
    sender->pending_flags = 0;
}

void as_sensor_lost(as_sender *sender, uint32_t samples)
{
    sender->produced += samples;
    sender->overruns++;
    sender->pending_flags |= AS_SENSOR_OVERRUN;
}

static uint8_t saturation(const as_data *data)
{
    uint8_t flags = 0;
    for (uint8_t i = 0; i < data->n; i++) {
        for (uint8_t axis = 0; axis < AS_AXES; axis++) {
            const int16_t v = data->samples[i][axis];
            if (v == 32767 || v == -32768) {
                flags |= axis < 3 ? AS_GYRO_SATURATED : AS_ACCEL_SATURATED;
            }
        }
    }
    return flags;
}

bool as_send_data(as_sender *sender, const as_data *data)
{
    uint8_t frame[AS_FRAME_MAX];
    if (data->n < 1 || data->n > AS_MOST_SAMPLES) {
        return false;
    }
    const uint8_t flags = (uint8_t)(data->channels | sender->pending_flags | saturation(data));
    uint8_t *at = put_header(sender, frame, AS_DATA, flags, data->n);
    at = as_put32(at, sender->produced);
    at = as_put64(at, data->mcu_time_us);
    at = as_put32(at, data->sensor_time);
    at = as_put16(at, (uint16_t)data->temperature);
    for (uint8_t i = 0; i < data->n; i++) {
        for (uint8_t axis = 0; axis < AS_AXES; axis++) {
            at = as_put16(at, (uint16_t)data->samples[i][axis]);
        }
    }
    sender->produced += data->n;
    if (!queue_frame(sender, frame, at, AS_ROOM_DATA)) {
        sender->dropped += data->n;
        sender->pending_flags |= AS_DROPPED_BEFORE;
        return false;
    }
    sender->sent += data->n;
    sender->pending_flags = 0;
    return true;
}

bool as_send_body(as_sender *sender, enum as_type type, const uint8_t *body, uint32_t n)
{
    uint8_t frame[AS_FRAME_MAX];
    if (n > AS_BODY_MAX) {
        return false;
    }
    uint8_t *at = put_header(sender, frame, type, 0, (uint8_t)n);
    at = as_put_bytes(at, body, n);
    return queue_frame(sender, frame, at, AS_ROOM_REPLY);
}

bool as_send_status(as_sender *sender, uint64_t mcu_time_us)
{
    uint8_t body[AS_STATUS_SIZE];
    uint8_t *at = as_put64(body, mcu_time_us);
    at = as_put32(at, sender->produced);
    at = as_put32(at, sender->sent);
    at = as_put32(at, sender->dropped);
    at = as_put32(at, sender->overruns);
    at = as_put32(at, sender->commands);
    (void)as_put32(at, sender->bad_commands);
    return as_send_body(sender, AS_STATUS, body, sizeof body);
}

bool as_send_event(as_sender *sender, uint64_t mcu_time_us, uint8_t level, const char *text)
{
    uint8_t body[9 + AS_EVENT_TEXT_MAX];
    uint32_t n = 9;
    (void)as_put8(as_put64(body, mcu_time_us), level);
    while (*text != '\0' && n < sizeof body) {
        body[n++] = (uint8_t)*text++;
    }
    return as_send_body(sender, AS_EVENT, body, n);
}

bool as_send_reply(as_sender *sender, uint16_t command_seq, uint8_t command,
                   enum as_result result, const uint8_t *payload, uint32_t n)
{
    uint8_t body[AS_REPLY_FIXED + AS_REPLY_MAX];
    if (n > AS_REPLY_MAX) {
        return false;
    }
    uint8_t *at = as_put16(body, command_seq);
    at = as_put8(at, command);
    at = as_put8(at, (uint8_t)result);
    at = as_put_bytes(at, payload, n);
    return as_send_body(sender, AS_REPLY, body, (uint32_t)(at - body));
}
