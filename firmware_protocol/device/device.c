#include "device.h"

#include "as_bytes.h"
#include "descriptor.h"

enum {
    PERIOD_US = 1000000,
    RETRY_US = 20000,         /* so often a sensor that does not answer is tried again */
    COUNTABLE_US = 300000000, /* after a longer silence its time stamp, 24 bits of 25 us, may have
                                 wrapped unseen: what is missing cannot be counted */
    MOST_AFTER_EDGE = 32,     /* samples after the watermark that are counted from it in time */
    LATE_US = 3000,           /* what the main loop may be late after an edge */
    MOST_MISSED_EDGES = 3     /* frames without the interrupt until it is taken for dead */
};

static uint64_t samples_us(const device *self, uint32_t samples)
{
    return (uint64_t)((float)samples * 1e6f / self->config.rate_hz);
}

static void send_descriptor(device *self)
{
    (void)as_send_body(&self->sender, AS_DESCRIPTOR, self->descriptor, self->descriptor_size);
}

/* A new epoch: the descriptor goes into the queue before any data of it. */
static void begin(device *self, uint64_t now_us)
{
    self->streaming = true;
    self->draining = false;
    self->watermarked = false;
    self->next_first_us = 0;
    self->began_us = now_us;
    self->next_read_us = now_us + samples_us(self, imu_frame_samples(self->config.rate_hz));
    self->next_periodic_us = now_us + PERIOD_US;
    self->descriptor_size =
        descriptor_write(self->sensor, &self->config, self->clock, self->descriptor);
    send_descriptor(self);
}

void device_tell(device *self, uint64_t now_us, uint8_t level, const char *text)
{
    (void)as_send_event(&self->sender, now_us, level, text);
}

void device_init(device *self, imu *sensor, as_ring *ring, const imu_config *config, uint8_t clock,
                 uint16_t epoch, uint64_t now_us)
{
    self->sensor = sensor;
    self->config = *config;
    self->clock = clock;
    self->doubts = 0;
    self->missed_edges = 0;
    self->deaf = false;
    self->health = sensor->configure(sensor, &self->config) ? IMU_WELL : IMU_SILENT;
    self->silent_since_us = now_us;
    as_sender_init(&self->sender, ring, epoch);
    as_receiver_init(&self->receiver);
    begin(self, now_us);
    if (self->health != IMU_WELL) {
        device_tell(self, now_us, 2, "the sensor does not answer");
    }
}

/* --- commands ---------------------------------------------------------------------------- */

/* Read the entries of a set command into `wanted`; nothing is applied here. */
static enum as_result read_entries(const as_command *command, imu_config *wanted)
{
    uint32_t at = 0;
    while (at < command->n) {
        if (command->n - at < 2 || command->body[at + 1] > command->n - at - 2) {
            return AS_BAD_ARGUMENT;
        }
        const uint8_t tag = command->body[at];
        const uint8_t length = command->body[at + 1];
        const uint8_t *value = command->body + at + 2;
        at += 2u + length;
        if (tag == AS_TAG_CHANNELS && length == 1) {
            if (value[0] != 0x3F) {
                return AS_NOT_POSSIBLE; /* this device always sends all six */
            }
            continue;
        }
        if (length != 4) {
            return AS_BAD_ARGUMENT;
        }
        const float number = as_float_of(as_get32(value));
        switch (tag) {
        case AS_TAG_RATE:
            wanted->rate_hz = number;
            break;
        case AS_TAG_GYRO_FULL_SCALE:
            wanted->gyro_full_scale = number;
            break;
        case AS_TAG_ACCEL_FULL_SCALE:
            wanted->accel_full_scale = number;
            break;
        default:
            return AS_BAD_ARGUMENT;
        }
    }
    return AS_OK;
}

static bool same(const imu_config *a, const imu_config *b)
{
    return a->rate_hz == b->rate_hz && a->gyro_full_scale == b->gyro_full_scale &&
           a->accel_full_scale == b->accel_full_scale;
}

/* Apply a set command; `restart` tells whether a new epoch must begin. */
static enum as_result set(device *self, const as_command *command, bool *restart)
{
    imu_config wanted = self->config;
    const enum as_result result = read_entries(command, &wanted);
    if (result != AS_OK) {
        return result;
    }
    if (wanted.rate_hz != self->config.rate_hz) {
        wanted.rate_hz = imu_nearest_rate(wanted.rate_hz);
    }
    if (same(&wanted, &self->config)) {
        return AS_OK;
    }
    if (wanted.rate_hz == 0.0f || imu_gyro_sensitivity(wanted.gyro_full_scale) == 0.0f ||
        imu_accel_sensitivity(wanted.accel_full_scale) == 0.0f) {
        return AS_NOT_POSSIBLE;
    }
    if (!self->sensor->configure(self->sensor, &wanted)) {
        (void)self->sensor->configure(self->sensor, &self->config);
        return AS_FAILED;
    }
    self->config = wanted;
    *restart = self->streaming;
    return AS_OK;
}

static void obey(device *self, const as_command *command, uint64_t now_us)
{
    enum as_result result = AS_OK;
    uint8_t payload[AS_REPLY_MAX];
    uint8_t length = 0;
    bool restart = false;
    bool describe = false;
    self->sender.commands++;
    if (command->version >> 4 != AS_VERSION >> 4) {
        result = AS_UNKNOWN_COMMAND;
    } else {
        switch (command->type) {
        case AS_START:
            restart = !self->streaming;
            /* The sensor gathered while nobody asked: begin with an empty FIFO. */
            if (restart && !self->sensor->configure(self->sensor, &self->config)) {
                restart = false;
                result = AS_FAILED;
            }
            break;
        case AS_STOP:
            self->streaming = false;
            break;
        case AS_DESCRIBE:
            describe = true;
            break;
        case AS_SET:
            result = set(self, command, &restart);
            break;
        case AS_PING:
            if (command->n > AS_PING_MAX) {
                result = AS_BAD_ARGUMENT;
                break;
            }
            (void)as_put64(as_put_bytes(payload, command->body, command->n), now_us);
            length = (uint8_t)(command->n + 8u);
            break;
        default:
            result = AS_UNKNOWN_COMMAND;
        }
    }
    if (restart) {
        as_new_epoch(&self->sender);
    }
    (void)as_send_reply(&self->sender, command->seq, command->type, result, payload, length);
    if (restart) {
        begin(self, now_us);
    } else if (describe) {
        send_descriptor(self);
    }
}

void device_receive(device *self, uint8_t byte, uint64_t now_us)
{
    as_command command;
    if (as_receive(&self->receiver, byte, &command)) {
        obey(self, &command, now_us);
    }
    self->sender.bad_commands = self->receiver.bad;
}

/* --- data -------------------------------------------------------------------------------- */

/* The sensor has lost its settings, or has been silent for so long that nobody can tell what is
 * missing: set it up anew. What follows is a new epoch. */
static bool set_up_again(device *self, uint64_t now_us)
{
    if (!self->sensor->configure(self->sensor, &self->config)) {
        return false;
    }
    as_new_epoch(&self->sender);
    begin(self, now_us);
    device_tell(self, now_us, 2, "the sensor was reset and has been set up again: samples are missing");
    return true;
}

/* Take note of how the sensor is; returns whether what was read from it is to be sent. */
static bool well(device *self, imu_health found, uint64_t now_us)
{
    const bool silent = self->health == IMU_SILENT;
    if (found == IMU_WELL && !silent) {
        return true;
    }
    const bool lost = found == IMU_RESET ||
                      (found == IMU_WELL && now_us - self->silent_since_us > COUNTABLE_US);
    if (lost && set_up_again(self, now_us)) {
        self->health = IMU_WELL;
        return false;
    }
    if (found == IMU_WELL && !lost) {
        device_tell(self, now_us, 0, "the sensor answers again");
        self->health = IMU_WELL;
        return true;
    }
    if (!silent) {
        device_tell(self, now_us, 2, "the sensor does not answer");
        self->silent_since_us = now_us;
        self->health = IMU_SILENT;
    }
    return false;
}

/* Say once what the sensor says that cannot be, and once that it is over. */
static void doubt(device *self, uint8_t found, uint64_t now_us)
{
    static const struct {
        uint8_t bit;
        const char *begins;
        const char *ends;
    } words[] = {
        {IMU_STAMP_STALLED,
         "the time stamp of the sensor stands still: a loss in its FIFO would not show",
         "the time stamp of the sensor runs again"},
        {IMU_STATUS_CONTRADICTS,
         "the FIFO of the sensor says that it is empty and that it is not: nothing is read",
         "the FIFO of the sensor is consistent again"},
    };
    for (unsigned i = 0; i < sizeof words / sizeof *words; i++) {
        const bool now = found & words[i].bit;
        if (now != ((self->doubts & words[i].bit) != 0)) {
            device_tell(self, now_us, now ? 1 : 0, now ? words[i].begins : words[i].ends);
        }
    }
    self->doubts = found;
}

/* When the newest sample's period ends.
 *
 * Where the interrupt told when the FIFO reached its watermark, that sample's time is known, and those
 * after it are counted from it, unless the edge cannot be theirs. Else the newest sample is taken as
 * new, though it is as old as half a period on average. */
static uint64_t newest_time(const device *self, const imu_batch *batch, uint64_t now_us,
                            bool *from_edge)
{
    const uint32_t level = batch->n + batch->behind;
    const uint32_t watermark = self->sensor->watermark;
    if (!self->watermarked || batch->lost_before > 0 || level < watermark ||
        level - watermark > MOST_AFTER_EDGE) {
        return now_us;
    }
    const uint64_t end_us = self->watermark_us + samples_us(self, level - watermark + 1);
    *from_edge = end_us <= now_us + samples_us(self, 3) &&
                 now_us <= end_us + samples_us(self, 3) + LATE_US;
    return *from_edge ? end_us : now_us;
}

/* When the first sample of a batch was taken: counted back from the newest one that the sensor has,
 * so that after a stall, when many frames come at one time, each has its own. What is left of a
 * reading that began at an edge goes on from it. */
static uint64_t first_time(device *self, const imu_batch *batch, uint64_t now_us)
{
    uint64_t first_us = self->next_first_us;
    bool from_edge = first_us > 0 && self->draining && batch->lost_before == 0;
    if (!from_edge) {
        const uint64_t end_us = newest_time(self, batch, now_us, &from_edge);
        const uint64_t age_us = samples_us(self, batch->n + batch->behind);
        first_us = end_us > age_us ? end_us - age_us : 0;
    }
    self->watermarked = false;
    self->next_first_us = from_edge ? first_us + samples_us(self, batch->n) : 0;
    return first_us;
}

static void send_batch(device *self, const imu_batch *batch, uint64_t now_us)
{
    if (batch->lost_before) {
        as_sensor_lost(&self->sender, batch->lost_before);
    }
    if (batch->n == 0) {
        return;
    }
    const uint64_t first_us = first_time(self, batch, now_us);
    const as_data data = {
        .mcu_time_us = first_us,
        .sensor_time = batch->sensor_time,
        .temperature = batch->temperature,
        .channels = AS_GYRO_VALID | AS_ACCEL_VALID,
        .n = batch->n,
        .samples = batch->samples,
    };
    (void)as_send_data(&self->sender, &data);
}

void device_watermark(device *self, uint64_t edge_us)
{
    self->watermarked = true;
    self->watermark_us = edge_us;
    self->missed_edges = 0;
    if (self->deaf) {
        self->deaf = false;
        device_tell(self, edge_us, 0, "the interrupt of the sensor comes again");
    }
}

/* A reading that was due by time: where it finds what the interrupt should have told of, that is
 * missing. Once may be chance, as the edge may be on its way. */
static void miss_edge(device *self, const imu_batch *batch, uint64_t now_us)
{
    const uint32_t watermark = self->sensor->watermark;
    if (watermark == 0 || self->deaf || batch->n + batch->behind <= watermark) {
        return;
    }
    if (++self->missed_edges >= MOST_MISSED_EDGES) {
        self->deaf = true;
        device_tell(self, now_us, 1,
                    "the interrupt of the sensor does not come: it is read by time, and the times of "
                    "samples are less exact");
    }
}

/* What waits is still what comes next, unless the queue had run over meanwhile: then it is old, and
 * newer samples are missing behind it anyway. The host can tell how many. */
bool device_opened(device *self, uint32_t under_way)
{
    const bool old = self->sender.pending_flags & AS_DROPPED_BEFORE;
    if (old) {
        as_ring_keep(self->sender.ring, under_way);
    }
    as_send_zero(&self->sender);
    if (self->streaming) {
        send_descriptor(self);
    }
    return old;
}

/* Read and send one frame of samples; returns whether the sensor has more. What is less than a frame
 * waits for the interrupt, where there is one. */
static bool read_frame(device *self, uint64_t now_us)
{
    const uint8_t usual = imu_frame_samples(self->config.rate_hz);
    imu_batch batch;
    if (!well(self, self->sensor->read(self->sensor, usual, &batch), now_us)) {
        if (self->health != IMU_WELL) {
            self->next_read_us = now_us + RETRY_US;
        }
        return false;
    }
    doubt(self, batch.doubts, now_us);
    if (!self->draining && !self->watermarked) {
        miss_edge(self, &batch, now_us);
    }
    send_batch(self, &batch, now_us);
    return batch.n == usual && (self->sensor->watermark == 0 || batch.behind >= usual);
}

/* How long to wait for a frame: where an interrupt tells, twice as long as it should take. */
static uint64_t read_after_us(const device *self)
{
    const uint32_t usual = imu_frame_samples(self->config.rate_hz);
    return samples_us(self, self->sensor->watermark > 0 && !self->deaf ? 2 * usual : usual);
}

bool device_poll(device *self, uint64_t now_us)
{
    if (!self->streaming) {
        return false;
    }
    if (self->draining) {
        self->draining = read_frame(self, now_us);
    } else if (self->watermarked || now_us >= self->next_read_us) {
        self->next_read_us += read_after_us(self);
        if (self->next_read_us <= now_us || self->watermarked) {
            self->next_read_us = now_us + read_after_us(self);
        }
        self->draining = read_frame(self, now_us);
    }
    if (now_us >= self->next_periodic_us) {
        send_descriptor(self);
        (void)as_send_status(&self->sender, now_us);
        self->next_periodic_us += PERIOD_US;
        if (self->next_periodic_us <= now_us) {
            self->next_periodic_us = now_us + PERIOD_US;
        }
    }
    return self->draining;
}
