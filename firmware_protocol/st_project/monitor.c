/* The device of this project in ST's DataLog project for the SensorTile: bus, loop and USB.
 *
 * Copy this file into the project (docs/sensortile.md says what else is needed), call monitor_init
 * once and monitor_poll from the main loop, monitor_opened when a host raises DTR, usb_sent and
 * usb_reset from ST's CDC class driver, and use usb_received as the body of CDC_Itf_Receive. time_us, random_number and the queue of received
 * bytes are the project's.
 */
#include "device.h"
#include "lsm6dsm.h"
#include "SensorTile.h"

uint64_t time_us(void);       /* 64 bits, on the crystal: TIM2 at 1 MHz, its overflows counted */
uint32_t random_number(void); /* the RNG or noise of an ADC: a reboot is seen as a new epoch */
void received_put(uint8_t byte);
int received_take(void); /* -1: none */
void usb_reset(void);
static void usb_send(void);

/* `handle` is a DrvContextTypeDef with spiDevice = LSM6DSM. */
static bool bus_write(void *handle, uint8_t reg, uint8_t value)
{
    return Sensor_IO_SPI_Write(handle, reg, &value, 1) == COMPONENT_OK;
}

static bool bus_read(void *handle, uint8_t reg, uint8_t *to, uint16_t n)
{
    return Sensor_IO_SPI_Read(handle, reg, to, n) == COMPONENT_OK;
}

static void bus_wait(void *handle, uint32_t ms)
{
    (void)handle;
    HAL_Delay(ms);
}

static uint8_t ring_bytes[16384];
static as_ring ring;
static lsm6dsm sensor;
static device board;

static volatile bool opened;
static volatile bool busy;         /* a transfer is under way */
static volatile uint32_t in_flight; /* bytes of it that leave the ring when it has ended */

void monitor_init(void *handle)
{
    const bool one_data_line = true; /* the driver sets SIM after every reset of the part */
    const uint8_t interrupt = 0; /* 2: tell device_watermark when PA2 rises */
    const lsm6_bus bus = {handle, bus_read, bus_write, bus_wait, one_data_line, interrupt};
    const imu_config config = {104.0f, 125.0f, 2.0f};
    lsm6dsm_init(&sensor, &lsm6_dsm, &bus); /* lsm6_dsl, lsm6_ds3h for another part */
    as_ring_init(&ring, ring_bytes, sizeof ring_bytes, 1024);
    device_init(&board, &sensor.base, &ring, &config, AS_CLOCK_CRYSTAL,
                (uint16_t)random_number(), time_us());
}

/* A conversation begins with a zero and the descriptor. What is old is thrown away, but for the
 * transfer under way, which is still read from the ring. */
static void begin_conversation(void)
{
    const uint32_t mask = __get_PRIMASK();
    __disable_irq(); /* a transfer must not end meanwhile */
    opened = false;
    device_opened(&board, in_flight);
    __set_PRIMASK(mask);
}

void monitor_poll(void) /* from the main loop, every millisecond or two */
{
    bool more = true;
    if (opened) {
        begin_conversation();
    }
    while (more) { /* one frame at a time, so that a backlog does not keep commands waiting */
        int byte;
        while ((byte = received_take()) >= 0) {
            device_receive(&board, (uint8_t)byte, time_us());
        }
        more = device_poll(&board, time_us());
        usb_send();
    }
}

void monitor_opened(void) /* from the interrupt that brings DTR */
{
    opened = true;
}

/* The encoder's ring is the transmit buffer: ST's CDC_Fill_Buffer writes into 2048 bytes without
 * checking for room. Where ST's driver has no hook for the end of a transfer, test
 * ((USBD_CDC_HandleTypeDef *)USBD_Device.pClassData)->TxState == 0 here, and drop then. */
static void usb_send(void)
{
    const uint8_t *from;
    if (!busy && USBD_Device.dev_state == USBD_STATE_CONFIGURED) {
        uint32_t n = as_ring_peek(&ring, &from);
        if (n > 0 && n % 64 == 0) {
            n--; /* a transfer of full packets would need an empty one behind it */
        }
        if (n > 0) {
            USBD_CDC_SetTxBuffer(&USBD_Device, (uint8_t *)from, (uint16_t)n);
            in_flight = n; /* first: it may have ended before the call returns */
            busy = true;
            if (USBD_CDC_TransmitPacket(&USBD_Device) != USBD_OK) {
                usb_reset();
            }
        }
    }
}

void usb_sent(void) /* from the class driver's DataIn, when a transfer has ended */
{
    as_ring_drop(&ring, in_flight);
    usb_reset();
}

void usb_reset(void) /* from the class driver's Init and DeInit: the cable was pulled */
{
    in_flight = 0; /* a transfer that was cut off never ends; what was in it is sent once more */
    busy = false;
}

int8_t usb_received(uint8_t *from, uint32_t *n)
{
    for (uint32_t i = 0; i < *n; i++) {
        received_put(from[i]); /* a small queue: commands are obeyed in the main loop */
    }
    USBD_CDC_ReceivePacket(&USBD_Device);
    return USBD_OK;
}
