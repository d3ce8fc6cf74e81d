/* The numbers of the native protocol: types, flags, tags, results, sizes.
 * PROTOCOL.md is the norm; its section numbers stand beside each group. */
#ifndef AS_LAYOUT_H
#define AS_LAYOUT_H

enum {
    AS_VERSION = 0x12, /* major 1, minor 2 */
    AS_AXES = 6,       /* gx gy gz ax ay az */

    /* sections 1, 2, 4: sizes in bytes */
    AS_HEADER_SIZE = 8,
    AS_CRC_SIZE = 4,
    AS_DATA_FIXED = 18, /* index, mcu_time, sensor_time, temperature */
    AS_SAMPLE_SIZE = 2 * AS_AXES,
    AS_MOST_SAMPLES = 18,
    AS_USUAL_SAMPLES = 16,
    AS_FRAME_MAX = 246,
    AS_BODY_MAX = AS_FRAME_MAX - AS_HEADER_SIZE - AS_CRC_SIZE,
    AS_WIRE_MAX = AS_FRAME_MAX + 2, /* one byte of COBS, one zero */
    AS_STATUS_SIZE = 32,
    AS_EVENT_TEXT_MAX = 200,
    AS_PING_MAX = 32,
    AS_REPLY_MAX = 40, /* what a command returns: the body of a ping and the time */
    AS_REPLY_FIXED = 4
};

/* section 3 */
enum as_type {
    AS_DATA = 0x01,
    AS_DESCRIPTOR = 0x02,
    AS_STATUS = 0x03,
    AS_EVENT = 0x04,
    AS_REPLY = 0x06,
    AS_START = 0x81,
    AS_STOP = 0x82,
    AS_DESCRIBE = 0x83,
    AS_SET = 0x84,
    AS_PING = 0x85
};

/* section 4 */
enum as_flag {
    AS_GYRO_VALID = 1 << 0,
    AS_ACCEL_VALID = 1 << 1,
    AS_SENSOR_OVERRUN = 1 << 2,
    AS_DROPPED_BEFORE = 1 << 3,
    AS_GYRO_SATURATED = 1 << 4,
    AS_ACCEL_SATURATED = 1 << 5,
    AS_TIME_JUMP = 1 << 6,
    AS_SELF_TEST = 1 << 7
};

#define AS_NO_SENSOR_TIME 0xFFFFFFFFu
#define AS_NO_TEMPERATURE (-32768)

/* section 5 */
enum as_tag {
    AS_TAG_PART = 0x01,
    AS_TAG_WHO_AM_I = 0x02,
    AS_TAG_FIRMWARE = 0x03,
    AS_TAG_UNIQUE_ID = 0x04,
    AS_TAG_GYRO_FULL_SCALE = 0x05,
    AS_TAG_GYRO_SENSITIVITY = 0x06,
    AS_TAG_ACCEL_FULL_SCALE = 0x07,
    AS_TAG_ACCEL_SENSITIVITY = 0x08,
    AS_TAG_TEMPERATURE = 0x09,
    AS_TAG_RATE = 0x0A,
    AS_TAG_SENSOR_TICK = 0x0B,
    AS_TAG_CHANNELS = 0x0C,
    AS_TAG_CLOCK = 0x0D,
    AS_TAG_REGISTERS = 0x0E,
    AS_TAG_AXIS_MAP = 0x0F,
    AS_TAG_MOST_SAMPLES = 0x10,
    AS_TAG_BOARD = 0x11,
    AS_TAG_SOURCE = 0x12
};

enum as_clock { AS_CLOCK_NONE = 0, AS_CLOCK_CRYSTAL = 1, AS_CLOCK_RC = 2, AS_CLOCK_EMULATED = 3 };

enum as_source { AS_SOURCE_PART = 1, AS_SOURCE_SYNTHETIC = 2, AS_SOURCE_EMULATED = 3 };

/* section 7 */
enum as_result {
    AS_OK = 0,
    AS_UNKNOWN_COMMAND = 1,
    AS_BAD_ARGUMENT = 2,
    AS_NOT_POSSIBLE = 3,
    AS_FAILED = 4
};

#endif
