/* The firmware: the synthetic sensor on a B-L475E-IOT01A, streaming from boot.
 *
 * Two clocks are built from this file. With SysTick the board keeps real time, overflows when the
 * host does not read, and drops. With VIRTUAL_CLOCK the time of a sample is its index over the rate
 * and the loop runs as fast as the link accepts, so that every byte can be foretold. */
#include "as_ring.h"
#include "board.h"
#include "device.h"
#include "synthetic.h"

enum { RING_SIZE = 8192, RING_RESERVE = 1024, FIRST_EPOCH = 0x4C41 };

static uint8_t ring_bytes[RING_SIZE];
static as_ring ring;
static synthetic_imu sensor;
static device board_device;

#ifndef START_RATE_HZ
#define START_RATE_HZ 104.0f
#endif

static void take_commands(uint64_t now_us)
{
    int byte;
    while ((byte = board_receive()) >= 0) {
        device_receive(&board_device, (uint8_t)byte, now_us);
    }
}

/* Samples that time has brought since the epoch began. */
static uint32_t due(uint64_t now_us)
{
    const uint64_t since = now_us - board_device.began_us;
    return (uint32_t)((since * (uint64_t)(board_device.config.rate_hz * 2.0f)) / 2000000u);
}

int main(void)
{
    static const imu_config config = {START_RATE_HZ, 250.0f, 2.0f};
    as_ring_init(&ring, ring_bytes, RING_SIZE, RING_RESERVE);
    synthetic_init(&sensor);
    if (board_emulated()) {
        sensor.base.source = AS_SOURCE_EMULATED;
    }
    board_init(&ring);
#ifdef VIRTUAL_CLOCK
    uint64_t now_us = 0;
    device_init(&board_device, &sensor.base, &ring, &config, AS_CLOCK_EMULATED, FIRST_EPOCH, 0);
    for (;;) {
        take_commands(now_us);
        if (board_device.streaming && as_ring_room(&ring, AS_ROOM_DATA) > AS_WIRE_MAX) {
            if (!board_device.draining) {
                now_us = board_device.next_read_us;
                synthetic_advance(&sensor, due(now_us));
            }
            (void)device_poll(&board_device, now_us);
        } else {
            board_wait();
        }
        board_kick();
    }
#else
    device_init(&board_device, &sensor.base, &ring, &config, (uint8_t)board_clock(), FIRST_EPOCH,
                board_time_us());
    for (;;) {
        const uint64_t now_us = board_time_us();
        take_commands(now_us);
        synthetic_advance(&sensor, due(now_us));
        const bool more = device_poll(&board_device, now_us);
        board_kick();
        if (!more) {
            board_wait();
        }
    }
#endif
}
