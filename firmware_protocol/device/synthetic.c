#include "synthetic.h"

/* Marsaglia's xorshift, started from index and axis; 32 bits that look random. */
static uint32_t hash(uint32_t index, uint32_t axis)
{
    uint32_t x = index * 2654435761u + axis * 40503u + 1u;
    for (int round = 0; round < 3; round++) {
        x ^= x << 13;
        x ^= x >> 17;
        x ^= x << 5;
    }
    return x;
}

int16_t synthetic_count(uint32_t index, uint32_t axis, float accel_sensitivity)
{
    const uint32_t x = hash(index, axis);
    const int32_t sum = (int32_t)((x & 255u) + (x >> 8 & 255u) + (x >> 16 & 255u) + (x >> 24));
    const int32_t noise = (sum - 510) / 16;
    const int32_t gravity = axis == 5 ? (int32_t)(1.0f / accel_sensitivity) : 0;
    return (int16_t)(noise + gravity);
}

static bool configure(imu *base, imu_config *config)
{
    synthetic_imu *self = (synthetic_imu *)base;
    const float rate = imu_nearest_rate(config->rate_hz);
    if (rate == 0.0f || imu_gyro_sensitivity(config->gyro_full_scale) == 0.0f ||
        imu_accel_sensitivity(config->accel_full_scale) == 0.0f) {
        return false;
    }
    config->rate_hz = rate;
    self->config = *config;
    self->index = 0;
    self->due = 0;
    return true;
}

static imu_health read(imu *base, uint8_t most, imu_batch *batch)
{
    synthetic_imu *self = (synthetic_imu *)base;
    const float sensitivity = imu_accel_sensitivity(self->config.accel_full_scale);
    uint32_t waiting = self->due - self->index;
    batch->lost_before = waiting > SYNTHETIC_FIFO ? waiting - SYNTHETIC_FIFO : 0;
    self->index += batch->lost_before;
    waiting -= batch->lost_before;
    batch->n = (uint8_t)(waiting < most ? waiting : most);
    batch->behind = waiting - batch->n;
    batch->doubts = 0;
    batch->temperature = (int16_t)(self->index >> 8 & 0xFF);
    batch->sensor_time = (uint32_t)((float)40000 / self->config.rate_hz) * self->index;
    for (uint8_t i = 0; i < batch->n; i++) {
        for (uint32_t axis = 0; axis < AS_AXES; axis++) {
            batch->samples[i][axis] = synthetic_count(self->index, axis, sensitivity);
        }
        self->index++;
    }
    return IMU_WELL;
}

static uint8_t registers(imu *base, uint8_t *pairs, uint8_t room)
{
    (void)base;
    (void)pairs;
    (void)room;
    return 0;
}

void synthetic_init(synthetic_imu *self)
{
    self->base.configure = configure;
    self->base.read = read;
    self->base.registers = registers;
    self->base.part = "LSM6DSM";
    self->base.who_am_i = 0x6A;
    self->base.source = AS_SOURCE_SYNTHETIC;
    self->base.watermark = 0;
    self->base.counts_per_degc = 256.0f;
    self->index = 0;
    self->due = 0;
}

void synthetic_advance(synthetic_imu *self, uint32_t index)
{
    self->due = index;
}
