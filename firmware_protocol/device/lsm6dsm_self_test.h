/* The self-test of the LSM6DSM and its family: a known force on each proof mass, and what it moves.
 *
 * The part must lie still for a second. The limits are those of the datasheets, table 3. */
#ifndef LSM6DSM_SELF_TEST_H
#define LSM6DSM_SELF_TEST_H

#include "lsm6dsm.h"

typedef enum { LSM6_PASSED, LSM6_NO_ANSWER, LSM6_ACCEL_FAILED, LSM6_GYRO_FAILED } lsm6_verdict;

/* Run it and leave the part reset. */
lsm6_verdict lsm6dsm_self_test(lsm6dsm *self);

/* What to tell the host. */
const char *lsm6_verdict_text(lsm6_verdict verdict);

#endif
