#include "descriptor.h"

#include "as_bytes.h"
#include "as_layout.h"

enum { DESCRIPTOR_VERSION = 1, ALL_CHANNELS = 0x3F, SENSOR_TICK_NS = 25000, REGISTER_BYTES = 40 };

static const char firmware_version[] = "1.2.0";

static uint8_t *put_text(uint8_t *at, uint8_t tag, const char *text)
{
    uint8_t length = 0;
    while (text[length] != '\0') {
        length++;
    }
    at = as_put8(as_put8(at, tag), length);
    return as_put_bytes(at, (const uint8_t *)text, length);
}

static uint8_t *put_byte(uint8_t *at, uint8_t tag, uint8_t value)
{
    return as_put8(as_put8(as_put8(at, tag), 1), value);
}

static uint8_t *put_float(uint8_t *at, uint8_t tag, float value)
{
    return as_put32(as_put8(as_put8(at, tag), 4), as_float_bits(value));
}

uint32_t descriptor_write(imu *sensor, const imu_config *config, uint8_t clock, uint8_t *body)
{
    uint8_t *at = as_put8(body, DESCRIPTOR_VERSION);
    at = put_text(at, AS_TAG_PART, sensor->part);
    at = put_byte(at, AS_TAG_WHO_AM_I, sensor->who_am_i);
    at = put_text(at, AS_TAG_FIRMWARE, firmware_version);
    at = put_float(at, AS_TAG_GYRO_FULL_SCALE, config->gyro_full_scale);
    at = put_float(at, AS_TAG_GYRO_SENSITIVITY, imu_gyro_sensitivity(config->gyro_full_scale));
    at = put_float(at, AS_TAG_ACCEL_FULL_SCALE, config->accel_full_scale);
    at = put_float(at, AS_TAG_ACCEL_SENSITIVITY, imu_accel_sensitivity(config->accel_full_scale));
    at = as_put8(as_put8(at, AS_TAG_TEMPERATURE), 8);
    at = as_put32(at, as_float_bits(sensor->counts_per_degc));
    at = as_put32(at, as_float_bits(25.0f));
    at = put_float(at, AS_TAG_RATE, config->rate_hz);
    at = as_put32(as_put8(as_put8(at, AS_TAG_SENSOR_TICK), 4), SENSOR_TICK_NS);
    at = put_byte(at, AS_TAG_CHANNELS, ALL_CHANNELS);
    at = put_byte(at, AS_TAG_CLOCK, clock);
    at = put_byte(at, AS_TAG_SOURCE, sensor->source);
    at = put_byte(at, AS_TAG_MOST_SAMPLES, AS_USUAL_SAMPLES);
    uint8_t pairs[REGISTER_BYTES];
    const uint8_t n = sensor->registers(sensor, pairs, sizeof pairs);
    if (n > 0) {
        at = as_put_bytes(as_put8(as_put8(at, AS_TAG_REGISTERS), n), pairs, n);
    }
    return (uint32_t)(at - body);
}
