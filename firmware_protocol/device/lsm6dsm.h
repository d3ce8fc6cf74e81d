/* The LSM6DSM, LSM6DSL, LSM6DS3TR-C and LSM6DS3H at register level, over any bus.
 *
 * Gyro, accelerometer and the part's own time stamp go through its FIFO, so that a sample is never
 * read twice or torn, and a loss is known from the time stamps to the sample. No sample is believed
 * unless the part still has the settings that it was given: a dead bus reads as all ones or all
 * zeros, and a part whose supply broke down answers again without measuring. Registers are those
 * of ST's datasheets DocID028475 (LSM6DSL) and DocID028165 (LSM6DSM); where the LSM6DS3H differs, of
 * ST's register driver of the LSM6DS3, which shares its map. */
#ifndef LSM6DSM_H
#define LSM6DSM_H

#include "imu.h"

/* A set of the FIFO: gyro 3 words, accelerometer 3, time stamp 3. */
enum { SET_WORDS = 9, SET_BYTES = 2 * SET_WORDS };

/* What sets one part of the family apart. */
typedef struct {
    const char *name;
    uint8_t who_am_i;
    float most_rate_hz; /* of the gyro */
    float counts_per_degc;
    uint8_t timer_register; /* where the time stamp is switched on, and by what */
    uint8_t timer_on;
} lsm6_part;

extern const lsm6_part lsm6_dsm, lsm6_dsl, lsm6_ds3h;

/* Two functions and a clock are all that a board must give.
 *
 * one_data_line: SPI with one line for both directions. The part begins with two and has to be told,
 * after every reset, before it can be read. interrupt: which pin of the part is wired, 1 or 2, and rises
 * when its FIFO holds a frame; 0 none. */
typedef struct {
    void *context;
    bool (*read)(void *context, uint8_t reg, uint8_t *to, uint16_t n);
    bool (*write)(void *context, uint8_t reg, uint8_t value);
    void (*wait_ms)(void *context, uint32_t ms);
    bool one_data_line;
    uint8_t interrupt;
} lsm6_bus;

typedef struct {
    imu base;
    lsm6_bus bus;
    const lsm6_part *part;
    uint32_t period_q16; /* 25 us ticks between samples, times 65536: nominal, then measured */
    uint32_t nominal_q16;
    uint32_t run_ticks; /* time stamp of the sample from which the period is measured */
    uint32_t run;       /* samples since then, none of them missing */
    uint32_t measured;  /* samples over which the period was measured; 0 not yet */
    uint32_t last_ticks;      /* unwrapped time stamp of the last sample that was delivered */
    bool has_last;
    uint8_t fifo[4]; /* what FIFO_CTRL2 to 5 and CTRL1_XL to CTRL4_C were set to */
    uint8_t control[4];
    uint8_t settling; /* samples still to be thrown away after a change */
    uint8_t contradictions; /* readings in a row whose status cannot be */
    uint8_t burst[AS_MOST_SAMPLES * SET_BYTES]; /* as the FIFO gave them */
    bool stalled;           /* whether the last sample had the time stamp of the one before */
} lsm6dsm;

void lsm6dsm_init(lsm6dsm *self, const lsm6_part *part, const lsm6_bus *bus);

/* Reset the part and leave it powered down; false when it does not answer as what it should be. */
bool lsm6dsm_reset(lsm6dsm *self);

#endif
