#include "imu.h"

float imu_gyro_sensitivity(float full_scale)
{
    static const float table[][2] = {
        {125.0f, 4.375e-3f}, {250.0f, 8.75e-3f}, {500.0f, 17.5e-3f},
        {1000.0f, 35e-3f},   {2000.0f, 70e-3f},
    };
    for (unsigned i = 0; i < sizeof table / sizeof *table; i++) {
        if (table[i][0] == full_scale) {
            return table[i][1];
        }
    }
    return 0.0f;
}

float imu_accel_sensitivity(float full_scale)
{
    static const float table[][2] = {
        {2.0f, 0.061e-3f}, {4.0f, 0.122e-3f}, {8.0f, 0.244e-3f}, {16.0f, 0.488e-3f},
    };
    for (unsigned i = 0; i < sizeof table / sizeof *table; i++) {
        if (table[i][0] == full_scale) {
            return table[i][1];
        }
    }
    return 0.0f;
}

float imu_nearest_rate(float rate_hz)
{
    static const float rates[] = {12.5f,  26.0f,  52.0f,   104.0f,  208.0f,
                                  416.0f, 833.0f, 1660.0f, 3330.0f, 6660.0f};
    for (unsigned i = 0; i < sizeof rates / sizeof *rates; i++) {
        const float off = rate_hz > rates[i] ? rate_hz - rates[i] : rates[i] - rate_hz;
        if (off <= 0.05f * rates[i]) {
            return rates[i];
        }
    }
    return 0.0f;
}

uint8_t imu_frame_samples(float rate_hz)
{
    const uint32_t n = 1 + (uint32_t)(rate_hz * 20e-3f);
    return (uint8_t)(n < AS_USUAL_SAMPLES ? n : AS_USUAL_SAMPLES);
}
