#include "lsm6dsm.h"

#include "as_bytes.h"

enum {
    FIFO_CTRL1 = 0x06,
    FIFO_CTRL2 = 0x07,
    FIFO_CTRL3 = 0x08,
    FIFO_CTRL4 = 0x09,
    FIFO_CTRL5 = 0x0A,
    INT1_CTRL = 0x0D,
    INT2_CTRL = 0x0E,
    WHO_AM_I = 0x0F,
    CTRL1_XL = 0x10,
    CTRL2_G = 0x11,
    CTRL3_C = 0x12,
    CTRL4_C = 0x13,
    CTRL6_C = 0x15,
    CTRL7_G = 0x16,
    CTRL8_XL = 0x17,
    CTRL10_C = 0x19,
    OUT_TEMP_L = 0x20,
    FIFO_STATUS1 = 0x3A,
    FIFO_DATA_OUT_L = 0x3E,
    TAP_CFG = 0x58,
    WAKE_UP_DUR = 0x5C,

    SW_RESET = 0x01,
    BDU = 0x40,
    IF_INC = 0x04,
    SIM = 0x08, /* SPI with one data line */
    DRDY_MASK = 0x08,
    I2C_DISABLE = 0x04, /* the clock of other parts on the bus must not look like a start */
    TIMER_EN = 0x20,     /* in CTRL10_C of DSL and DSM */
    TIMER_EN_TAP = 0x80, /* in TAP_CFG of DS3H */
    FIFO_THRESHOLD = 0x08, /* in INT1_CTRL and INT2_CTRL */
    TIMER_HR = 0x10,       /* 25 us instead of 6.4 ms */
    TIMER_FIFO_EN = 0x80,  /* the time stamp as the fourth data set */
    NO_DECIMATION = 0x01,
    FIFO_BYPASS = 0x00,
    FIFO_CONTINUOUS = 0x06,
    FIFO_OVER_RUN = 0x40,  /* in FIFO_STATUS2 */
    FIFO_EMPTY = 0x10,

    FIFO_WORDS = 2048,
    FIRST_RUN = 256, /* samples after which the period is measured for the first time */
    LONGEST_RUN = 16384,
    MOST_CONTRADICTIONS = 3, /* a sample that comes between two registers may look like one */
    RESET_MS = 15,
    TICKS_PER_S = 40000
};

const lsm6_part lsm6_dsm = {"LSM6DSM", 0x6A, 6660.0f, 256.0f, CTRL10_C, TIMER_EN};
const lsm6_part lsm6_dsl = {"LSM6DSL", 0x6A, 6660.0f, 256.0f, CTRL10_C, TIMER_EN};
const lsm6_part lsm6_ds3h = {"LSM6DS3H", 0x69, 1660.0f, 16.0f, TAP_CFG, TIMER_EN_TAP};

typedef struct {
    float rate_hz;
    uint8_t code;     /* for CTRL1_XL, CTRL2_G and FIFO_CTRL5 alike */
    uint8_t settling; /* samples of the gyro's filter to discard after a change */
} odr;

static const odr odrs[] = {
    {12.5f, 1, 2},  {26.0f, 2, 3},  {52.0f, 3, 3},    {104.0f, 4, 5},   {208.0f, 5, 16},
    {416.0f, 6, 16}, {833.0f, 7, 16}, {1660.0f, 8, 16}, {3330.0f, 9, 16}, {6660.0f, 10, 16},
};

static const odr *find_odr(float rate_hz)
{
    for (unsigned i = 0; i < sizeof odrs / sizeof *odrs; i++) {
        if (odrs[i].rate_hz == rate_hz) {
            return &odrs[i];
        }
    }
    return 0;
}

/* FS_G and FS_125 of CTRL2_G. */
static uint8_t gyro_bits(float full_scale)
{
    if (full_scale == 125.0f) {
        return 0x02;
    }
    return full_scale == 250.0f ? 0x00 : full_scale == 500.0f ? 0x04
                                     : full_scale == 1000.0f  ? 0x08
                                                              : 0x0C;
}

/* FS_XL of CTRL1_XL: 16 g has the code that follows 2 g. */
static uint8_t accel_bits(float full_scale)
{
    return full_scale == 2.0f ? 0x00 : full_scale == 4.0f ? 0x08
                                   : full_scale == 8.0f   ? 0x0C
                                                          : 0x04;
}

static bool get(lsm6dsm *self, uint8_t reg, uint8_t *to, uint16_t n)
{
    return self->bus.read(self->bus.context, reg, to, n);
}

static bool put(lsm6dsm *self, uint8_t reg, uint8_t value)
{
    return self->bus.write(self->bus.context, reg, value);
}

static bool put4(lsm6dsm *self, uint8_t reg, const uint8_t *values)
{
    for (uint8_t i = 0; i < 4; i++) {
        if (!put(self, (uint8_t)(reg + i), values[i])) {
            return false;
        }
    }
    return true;
}

/* CTRL3_C as it is while the part works. */
static uint8_t interface(const lsm6dsm *self)
{
    return (uint8_t)(BDU | IF_INC | (self->bus.one_data_line ? SIM : 0));
}

static bool identified(lsm6dsm *self)
{
    uint8_t identity = 0;
    if (self->bus.one_data_line && !put(self, CTRL3_C, interface(self))) {
        return false;
    }
    return get(self, WHO_AM_I, &identity, 1) && identity == self->part->who_am_i;
}

bool lsm6dsm_reset(lsm6dsm *self)
{
    if (!identified(self) || !put(self, CTRL3_C, SW_RESET)) {
        return false;
    }
    self->bus.wait_ms(self->bus.context, RESET_MS);
    return put(self, CTRL3_C, interface(self));
}

static bool holds(lsm6dsm *self, uint8_t reg, const uint8_t *expected)
{
    uint8_t found[4];
    if (!get(self, reg, found, 4)) {
        return false;
    }
    for (uint8_t i = 0; i < 4; i++) {
        if (found[i] != expected[i]) {
            return false;
        }
    }
    return true;
}

/* Compare the settings. FIFO_CTRL5 and CTRL1_XL are neither 0x00 nor 0xFF nor their reset values,
 * so that neither a dead bus nor a part that was reset can have them. */
static imu_health health(lsm6dsm *self)
{
    const bool configured = self->fifo[3] != FIFO_BYPASS;
    if (configured && holds(self, FIFO_CTRL2, self->fifo) && holds(self, CTRL1_XL, self->control)) {
        return IMU_WELL;
    }
    return identified(self) ? IMU_RESET : IMU_SILENT;
}

/* An interrupt when the FIFO holds a frame: its length in words fits the first eight bits. */
static bool set_watermark(lsm6dsm *self, uint8_t samples)
{
    if (self->bus.interrupt == 0) {
        return true;
    }
    self->base.watermark = samples;
    return put(self, FIFO_CTRL1, (uint8_t)(samples * SET_WORDS)) &&
           put(self, self->bus.interrupt == 1 ? INT1_CTRL : INT2_CTRL, FIFO_THRESHOLD);
}

static bool configure(imu *base, imu_config *config)
{
    lsm6dsm *self = (lsm6dsm *)base;
    const odr *wanted = find_odr(imu_nearest_rate(config->rate_hz));
    if (wanted == 0 || wanted->rate_hz > self->part->most_rate_hz ||
        imu_gyro_sensitivity(config->gyro_full_scale) == 0.0f ||
        imu_accel_sensitivity(config->accel_full_scale) == 0.0f) {
        return false;
    }
    config->rate_hz = wanted->rate_hz;
    const uint8_t rate_bits = (uint8_t)(wanted->code << 4);
    const uint8_t control[4] = {
        (uint8_t)(rate_bits | accel_bits(config->accel_full_scale)),
        (uint8_t)(rate_bits | gyro_bits(config->gyro_full_scale)),
        interface(self),
        (uint8_t)(DRDY_MASK | (self->bus.one_data_line ? I2C_DISABLE : 0)),
    };
    const uint8_t watermark = imu_frame_samples(wanted->rate_hz);
    const uint8_t fifo[4] = {
        TIMER_FIFO_EN,
        NO_DECIMATION << 3 | NO_DECIMATION,
        NO_DECIMATION << 3,
        (uint8_t)(wanted->code << 3 | FIFO_CONTINUOUS),
    };
    for (uint8_t i = 0; i < 4; i++) {
        self->control[i] = control[i];
        self->fifo[i] = fifo[i];
    }
    /* The FIFO goes on last and is emptied by bypass before, so that its first set is a whole one. */
    const bool done = lsm6dsm_reset(self) && put(self, WAKE_UP_DUR, TIMER_HR) &&
                      put(self, self->part->timer_register, self->part->timer_on) &&
                      set_watermark(self, watermark) &&
                      put4(self, CTRL1_XL, control) && put(self, FIFO_CTRL5, FIFO_BYPASS) &&
                      put4(self, FIFO_CTRL2, fifo) && health(self) == IMU_WELL;
    self->settling = (uint8_t)(wanted->settling + 1); /* the first after a change of mode is void */
    self->has_last = false;
    self->stalled = false;
    self->contradictions = 0;
    self->run = 0;
    self->measured = 0;
    self->nominal_q16 = (uint32_t)(TICKS_PER_S * 65536.0f / wanted->rate_hz);
    self->period_q16 = self->nominal_q16;
    return done;
}

/* Skip words until the FIFO stands at the beginning of a set again; an overrun may have cut one. */
static bool align(lsm6dsm *self, uint32_t *words, uint32_t pattern)
{
    uint8_t skipped[2];
    while (pattern % SET_WORDS != 0 && *words > 0) {
        if (!get(self, FIFO_DATA_OUT_L, skipped, 2)) {
            return false;
        }
        pattern++;
        (*words)--;
    }
    return true;
}

/* The 24-bit time stamp of a set, in the odd order in which the FIFO holds it. */
static uint32_t stamp_of(const uint8_t *set)
{
    return (uint32_t)set[12] << 8 | (uint32_t)set[13] << 16 | (uint32_t)set[15];
}

/* Unwrap by the distance to the last one: the counter wraps every 419 s. */
static uint32_t unwrapped(const lsm6dsm *self, uint32_t stamp)
{
    if (!self->has_last) {
        return stamp;
    }
    return self->last_ticks + ((stamp - self->last_ticks) & 0xFFFFFFu);
}

/* Samples that are missing between the last one and this, from their time stamps. */
static uint32_t missing(const lsm6dsm *self, uint32_t ticks)
{
    if (!self->has_last) {
        return 0;
    }
    const uint64_t since_q16 = (uint64_t)(ticks - self->last_ticks) << 16;
    const uint32_t periods = (uint32_t)((since_q16 + self->period_q16 / 2) / self->period_q16);
    return periods > 1 ? periods - 1 : 0;
}

/* Measure the period on samples without a gap: the rates of the part are not quite the ratios of
 * its ticks that the datasheet names, and a long overrun counts in periods. */
static void measure(lsm6dsm *self, uint32_t ticks, uint32_t lost)
{
    if (!self->has_last || lost > 0) {
        self->run = 0;
    }
    if (self->run == 0) {
        self->run_ticks = ticks;
    } else if (self->run >= FIRST_RUN && (self->run & (self->run - 1)) == 0) {
        const uint64_t since_q16 = (uint64_t)(ticks - self->run_ticks) << 16;
        const uint32_t measured = (uint32_t)(since_q16 / self->run);
        const uint32_t off = measured > self->nominal_q16 ? measured - self->nominal_q16
                                                          : self->nominal_q16 - measured;
        /* A tick more or less counts the less the longer the run: never by a shorter one. */
        if (off < self->nominal_q16 / 16 && self->run >= self->measured) {
            self->period_q16 = measured;
            self->measured = self->run;
        }
        if (self->run == LONGEST_RUN) {
            self->run = 0;
            self->run_ticks = ticks;
        }
    }
    self->run++;
}

/* Whether all bytes of a set are 0x00 or all are 0xFF: what a bus gives on which nobody speaks. */
static bool is_level(const uint8_t *set)
{
    if (set[0] != 0x00 && set[0] != 0xFF) {
        return false;
    }
    for (uint8_t i = 1; i < SET_BYTES; i++) {
        if (set[i] != set[0]) {
            return false;
        }
    }
    return true;
}

/* Take a set into the batch; false when it is none. */
static bool take(lsm6dsm *self, imu_batch *batch, const uint8_t *set)
{
    if (is_level(set)) {
        return false;
    }
    if (self->settling > 0) {
        self->settling--;
        return true;
    }
    const uint32_t ticks = unwrapped(self, stamp_of(set));
    const uint32_t lost = missing(self, ticks);
    if (lost > 0 && batch->n > 0) { /* a batch is contiguous: what came before is given up */
        batch->lost_before += batch->n;
        batch->n = 0;
    }
    if (batch->n == 0) {
        batch->lost_before += lost;
        batch->sensor_time = ticks;
    }
    self->stalled = self->has_last && ticks == self->last_ticks;
    measure(self, ticks, lost);
    for (uint8_t axis = 0; axis < AS_AXES; axis++) {
        batch->samples[batch->n][axis] = (int16_t)as_get16(set + 2 * axis);
    }
    batch->n++;
    self->last_ticks = ticks;
    self->has_last = true;
    return true;
}

/* Words in the FIFO, from its status. */
static uint32_t level_of(const uint8_t *status)
{
    const uint32_t words = (uint32_t)(status[0] | (status[1] & 7u) << 8);
    /* eleven bits cannot say that it is full */
    return words == 0 && status[1] & FIFO_OVER_RUN ? FIFO_WORDS : words;
}

/* Where in a set the next word lies. */
static uint32_t pattern_of(const uint8_t *status)
{
    return as_get16(status + 2) & 0x3FFu;
}

/* Whether the status says both that the FIFO is empty and that it holds something. */
static bool contradicts(const uint8_t *status)
{
    return (level_of(status) == 0) != ((status[1] & FIFO_EMPTY) != 0);
}

/* A full FIFO gives up its oldest words for every set that comes, also in the middle of a reading: the
 * words of two samples would lie side by side. Make room for two sets before anything is believed. */
static bool make_room(lsm6dsm *self, uint8_t *status)
{
    return get(self, FIFO_DATA_OUT_L, self->burst, 2 * SET_BYTES) &&
           get(self, FIFO_STATUS1, status, 4);
}

/* Read what the FIFO holds; false when the bus fails. */
static bool drain(lsm6dsm *self, uint8_t most, imu_batch *batch)
{
    uint8_t status[4];
    uint8_t temperature[2];
    if (!get(self, FIFO_STATUS1, status, 4) || !get(self, OUT_TEMP_L, temperature, 2)) {
        return false;
    }
    batch->temperature = (int16_t)as_get16(temperature);
    if (contradicts(status) || pattern_of(status) >= SET_WORDS) {
        if (self->contradictions < MOST_CONTRADICTIONS) {
            self->contradictions++;
        }
        batch->doubts |= self->contradictions == MOST_CONTRADICTIONS ? IMU_STATUS_CONTRADICTS : 0;
        return true;
    }
    self->contradictions = 0;
    if (status[1] & FIFO_OVER_RUN && !make_room(self, status)) {
        return false;
    }
    uint32_t words = level_of(status);
    if (!align(self, &words, pattern_of(status))) {
        return false;
    }
    while (words >= SET_WORDS && batch->n < most) {
        const uint32_t room = (uint32_t)(most - batch->n);
        const uint32_t sets = words / SET_WORDS < room ? words / SET_WORDS : room;
        if (!get(self, FIFO_DATA_OUT_L, self->burst, (uint16_t)(sets * SET_BYTES))) {
            return false;
        }
        words -= sets * SET_WORDS;
        for (uint32_t i = 0; i < sets; i++) {
            if (!take(self, batch, self->burst + i * SET_BYTES)) {
                return false;
            }
        }
    }
    batch->behind = words / SET_WORDS;
    batch->doubts |= self->stalled ? IMU_STAMP_STALLED : 0;
    return true;
}

static imu_health read(imu *base, uint8_t most, imu_batch *batch)
{
    lsm6dsm *self = (lsm6dsm *)base;
    const uint32_t last_ticks = self->last_ticks;
    const bool had_last = self->has_last;
    batch->n = 0;
    batch->lost_before = 0;
    batch->behind = 0;
    batch->doubts = 0;
    batch->sensor_time = AS_NO_SENSOR_TIME;
    const bool drained = drain(self, most, batch);
    const imu_health found = health(self); /* after the reading: so it vouches for what was read */
    if (drained && found == IMU_WELL) {
        return IMU_WELL;
    }
    batch->n = 0;
    batch->lost_before = 0;
    self->run = 0;
    self->last_ticks = last_ticks; /* what is thrown away counts as missing */
    self->has_last = had_last;
    return found == IMU_WELL ? IMU_SILENT : found;
}

static uint8_t registers(imu *base, uint8_t *pairs, uint8_t room)
{
    static const uint8_t wanted[] = {CTRL1_XL, CTRL2_G,  CTRL3_C,    CTRL4_C,    CTRL6_C,
                                     CTRL7_G,  CTRL8_XL, CTRL10_C,   FIFO_CTRL2, FIFO_CTRL3,
                                     FIFO_CTRL4, FIFO_CTRL5, WAKE_UP_DUR};
    uint8_t n = 0;
    for (unsigned i = 0; i < sizeof wanted && n + 2 <= room; i++) {
        pairs[n] = wanted[i];
        if (!get((lsm6dsm *)base, wanted[i], pairs + n + 1, 1)) {
            return 0;
        }
        n = (uint8_t)(n + 2);
    }
    return n;
}

void lsm6dsm_init(lsm6dsm *self, const lsm6_part *part, const lsm6_bus *bus)
{
    self->base.configure = configure;
    self->base.read = read;
    self->base.registers = registers;
    self->base.part = part->name;
    self->base.who_am_i = part->who_am_i;
    self->base.watermark = 0;
    self->base.counts_per_degc = part->counts_per_degc;
    self->part = part;
    self->base.source = AS_SOURCE_PART;
    self->bus = *bus;
    self->has_last = false;
    self->settling = 0;
    self->fifo[3] = FIFO_BYPASS;
}
