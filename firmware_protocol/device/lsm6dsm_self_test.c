#include "lsm6dsm_self_test.h"

#include "as_bytes.h"

enum {
    CTRL1_XL = 0x10,
    CTRL2_G = 0x11,
    CTRL5_C = 0x14,
    STATUS = 0x1E,
    OUTX_G = 0x22,
    OUTX_XL = 0x28,
    ACCEL_52_HZ_4_G = 0x38,
    GYRO_208_HZ_2000_DPS = 0x5C,
    ACCEL_FORCE = 0x01,
    GYRO_FORCE = 0x04,
    ACCEL_READY = 0x01,
    GYRO_READY = 0x02,
    SETTLE_MS = 150,
    SAMPLES = 5,
    PATIENCE_MS = 200
};

/* One sensor's half of the test. */
typedef struct {
    uint8_t control;
    uint8_t setting;
    uint8_t force;
    uint8_t ready;
    uint8_t out;
    int32_t least; /* change by the force, in counts */
    int32_t most;
} half;

/* 90 to 1700 mg at 0.122 mg a count, 150 to 700 dps at 70 mdps a count. */
static const half accel = {CTRL1_XL, ACCEL_52_HZ_4_G, ACCEL_FORCE, ACCEL_READY, OUTX_XL, 738, 13934};
static const half gyro = {CTRL2_G, GYRO_208_HZ_2000_DPS, GYRO_FORCE, GYRO_READY, OUTX_G, 2143, 10000};

static bool put(lsm6dsm *self, uint8_t reg, uint8_t value)
{
    return self->bus.write(self->bus.context, reg, value);
}

static bool get(lsm6dsm *self, uint8_t reg, uint8_t *to, uint16_t n)
{
    return self->bus.read(self->bus.context, reg, to, n);
}

static bool wait_ready(lsm6dsm *self, uint8_t ready)
{
    for (uint32_t ms = 0; ms < PATIENCE_MS; ms++) {
        uint8_t status = 0;
        if (!get(self, STATUS, &status, 1)) {
            return false;
        }
        if (status & ready) {
            return true;
        }
        self->bus.wait_ms(self->bus.context, 1);
    }
    return false;
}

/* The sum of five samples of each axis; the one before them may be older than the setting. */
static bool sums(lsm6dsm *self, const half *tested, int32_t sum[3])
{
    uint8_t bytes[6];
    self->bus.wait_ms(self->bus.context, SETTLE_MS);
    sum[0] = sum[1] = sum[2] = 0;
    for (uint8_t k = 0; k <= SAMPLES; k++) {
        if (!wait_ready(self, tested->ready) || !get(self, tested->out, bytes, sizeof bytes)) {
            return false;
        }
        for (uint8_t axis = 0; axis < 3 && k > 0; axis++) {
            sum[axis] += (int16_t)as_get16(bytes + 2 * axis);
        }
    }
    return true;
}

/* Whether every axis moved by what it should. */
static bool passes(lsm6dsm *self, const half *tested, bool *answers)
{
    int32_t without[3];
    int32_t with[3];
    *answers = lsm6dsm_reset(self) && put(self, tested->control, tested->setting) &&
               sums(self, tested, without) && put(self, CTRL5_C, tested->force) &&
               sums(self, tested, with);
    for (uint8_t axis = 0; axis < 3 && *answers; axis++) {
        const int32_t moved = with[axis] - without[axis];
        const int32_t size = moved < 0 ? -moved : moved;
        if (size < SAMPLES * tested->least || size > SAMPLES * tested->most) {
            return false;
        }
    }
    return *answers;
}

lsm6_verdict lsm6dsm_self_test(lsm6dsm *self)
{
    bool answers;
    lsm6_verdict verdict = LSM6_PASSED;
    if (!passes(self, &accel, &answers)) {
        verdict = answers ? LSM6_ACCEL_FAILED : LSM6_NO_ANSWER;
    } else if (!passes(self, &gyro, &answers)) {
        verdict = answers ? LSM6_GYRO_FAILED : LSM6_NO_ANSWER;
    }
    (void)lsm6dsm_reset(self);
    return verdict;
}

const char *lsm6_verdict_text(lsm6_verdict verdict)
{
    switch (verdict) {
    case LSM6_ACCEL_FAILED:
        return "the self-test of the accelerometer failed, or the board was moved during it";
    case LSM6_GYRO_FAILED:
        return "the self-test of the gyroscope failed, or the board was moved during it";
    case LSM6_NO_ANSWER:
        return "the sensor did not answer to its self-test";
    default:
        return "the self-test passed";
    }
}
