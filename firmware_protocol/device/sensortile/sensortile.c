/* The SensorTile's firmware: LSM6DSM by its FIFO, out over USB, streaming from boot. */
#include "sensortile.h"

#include "board_sensortile.h"
#include "device.h"
#include "lsm6dsm.h"
#include "lsm6dsm_self_test.h"
#include "sensor_spi.h"
#include "usb_cdc.h"

#ifndef START_RATE_HZ
#define START_RATE_HZ 104.0f
#endif

enum { RING_SIZE = 32768, RING_RESERVE = 1024 };

static uint8_t ring_bytes[RING_SIZE];
static as_ring ring;
static lsm6dsm sensor;
static device board;

static void wait_ms(void *context, uint32_t ms)
{
    (void)context;
    board_wait_ms(ms);
}

void sensortile_begin(void)
{
    static const imu_config config = {START_RATE_HZ, 250.0f, 2.0f};
    static const lsm6_bus bus = {
        .read = sensor_spi_read,
        .write = sensor_spi_write,
        .wait_ms = wait_ms,
        .one_data_line = true,
        .interrupt = 2,
    };
    board_init();
    sensor_spi_init();
    as_ring_init(&ring, ring_bytes, RING_SIZE, RING_RESERVE);
    lsm6dsm_init(&sensor, &lsm6_dsm, &bus);
    const lsm6_verdict verdict = lsm6dsm_self_test(&sensor); /* before a host can ask anything */
    usb_cdc_init(&ring, board_unique_id(), board_wait_ms);
    device_init(&board, &sensor.base, &ring, &config, (uint8_t)board_clock(), board_random(),
                board_time_us());
    if (board_was_hung()) {
        device_tell(&board, board_time_us(), 2, "the device hung and its watchdog restarted it");
    }
    if (verdict != LSM6_PASSED) {
        device_tell(&board, board_time_us(), 1, lsm6_verdict_text(verdict));
    }
}

bool sensortile_turn(void)
{
    uint64_t edge_us;
    int byte;
    board_alive();
    usb_cdc_poll();
    while ((byte = usb_cdc_receive()) >= 0) {
        device_receive(&board, (uint8_t)byte, board_time_us());
    }
    if (usb_cdc_opened() && device_opened(&board, 0)) {
        usb_cdc_discard();
    }
    if (board_take_edge(&edge_us)) {
        device_watermark(&board, edge_us);
    }
    return device_poll(&board, board_time_us());
}

#ifndef MMIO_MODEL
int main(void)
{
    sensortile_begin();
    for (;;) {
        if (!sensortile_turn()) {
            board_sleep();
        }
    }
}
#endif
