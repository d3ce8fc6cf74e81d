#include "usb_cdc.h"

#include "mmio.h"
#include "usb_descriptors.h"

/* Reference manual RM0351, chapter 47. */
#define OTG 0x50000000u
#define GOTGCTL (OTG + 0x000u)
#define GUSBCFG (OTG + 0x00Cu)
#define GRSTCTL (OTG + 0x010u)
#define GINTSTS (OTG + 0x014u)
#define GRXSTSP (OTG + 0x020u)
#define GRXFSIZ (OTG + 0x024u)
#define DIEPTXF0 (OTG + 0x028u)
#define GCCFG (OTG + 0x038u)
#define DIEPTXF(n) (OTG + 0x100u + 4u * (n))
#define DCFG (OTG + 0x800u)
#define DCTL (OTG + 0x804u)
#define PCGCCTL (OTG + 0xE00u)
#define DIEPCTL(n) (OTG + 0x900u + 0x20u * (n))
#define DIEPINT(n) (OTG + 0x908u + 0x20u * (n))
#define DIEPTSIZ(n) (OTG + 0x910u + 0x20u * (n))
#define DOEPCTL(n) (OTG + 0xB00u + 0x20u * (n))
#define DOEPINT(n) (OTG + 0xB08u + 0x20u * (n))
#define DOEPTSIZ(n) (OTG + 0xB10u + 0x20u * (n))
#define FIFO(n) (OTG + 0x1000u * ((n) + 1u))

#define B_SESSION_VALID (3u << 6) /* GOTGCTL: VBUS is not wired to the chip's pin, take it as there */
#define FORCE_DEVICE (1u << 30)   /* GUSBCFG */
#define TURNAROUND (0xFu << 10)
#define TURNAROUND_80_MHZ (6u << 10)
#define POWER_UP (1u << 16) /* GCCFG */
#define CORE_RESET (1u << 0) /* GRSTCTL */
#define FLUSH_RX (1u << 4)
#define FLUSH_TX (1u << 5)
#define ALL_FIFOS (16u << 6)
#define AHB_IDLE (1u << 31)
#define RX_LEVEL (1u << 4) /* GINTSTS */
#define BUS_RESET (1u << 12)
#define SPEED_KNOWN (1u << 13)
#define FULL_SPEED 3u          /* DCFG */
#define ADDRESS (0x7Fu << 4)
#define SOFT_DISCONNECT (1u << 1) /* DCTL */
#define CLEAR_GLOBAL_IN_NAK (1u << 8)
#define ACTIVE (1u << 15) /* DIEPCTL, DOEPCTL */
#define BULK (2u << 18)
#define INTERRUPT (3u << 18)
#define STALL (1u << 21)
#define CLEAR_NAK (1u << 26)
#define SET_NAK (1u << 27)
#define DATA0 (1u << 28)
#define DISABLE (1u << 30)
#define ENABLE (1u << 31)
#define TX_DONE (1u << 0)     /* DIEPINT */
#define ONE_PACKET (1u << 19) /* DIEPTSIZ, DOEPTSIZ */
#define THREE_SETUPS (3u << 29)

enum {
    /* The peripheral's memory, 320 words: what is received, then one queue an endpoint. */
    RX_WORDS = 64,
    TX0_WORDS = 16,
    TX1_WORDS = 192,
    TX2_WORDS = 16,
    MOST_AT_ONCE = 4 * TX1_WORDS - 1, /* never a whole number of packets: no empty one is due */

    /* what a word of the receive queue is */
    OUT_DATA = 2,
    OUT_DONE = 3,
    SETUP_DONE = 4,
    SETUP_DATA = 6,

    GET_STATUS = 0,
    CLEAR_FEATURE = 1,
    SET_FEATURE = 3,
    SET_ADDRESS = 5,
    GET_DESCRIPTOR = 6,
    GET_CONFIGURATION = 8,
    SET_CONFIGURATION = 9,
    GET_INTERFACE = 10,
    SET_INTERFACE = 11,
    SET_LINE_CODING = 0x20,
    GET_LINE_CODING = 0x21,
    SET_CONTROL_LINES = 0x22,
    SEND_BREAK = 0x23,

    STANDARD = 0x00,
    CLASS = 0x20,
    KIND = 0x60,
    TO_HOST = 0x80,
    TO_ENDPOINT = 2,

    LINE_CODING_SIZE = 7,
    RECEIVE_SIZE = 512, /* a power of two */
    FORCE_MS = 50, /* the manual asks for 25 before the change of mode is sure */
    PATIENCE = 200000
};

typedef struct {
    uint8_t kind;
    uint8_t request;
    uint16_t value;
    uint16_t index;
    uint16_t length;
} setup_packet;

static as_ring *out;
static const uint32_t *identity;

static struct {
    setup_packet setup;
    const uint8_t *answer; /* what of an answer is still to be sent */
    uint16_t left;
    bool empty_last;  /* the answer ends with an empty packet */
    bool taking_line; /* seven bytes of line coding are on their way */
} control;

static uint8_t line_coding[LINE_CODING_SIZE] = {0x00, 0xC2, 0x01, 0x00, 0, 0, 8}; /* 115200 8N1 */
static uint8_t small[2];
static uint8_t configured;
static bool dtr;
static bool opened;
static uint8_t received[RECEIVE_SIZE];
static uint32_t received_put;
static uint32_t received_taken;

static bool wait_for(uint32_t address, uint32_t mask, uint32_t wanted)
{
    for (uint32_t i = 0; i < PATIENCE; i++) {
        if ((mmio_get(address) & mask) == wanted) {
            return true;
        }
    }
    return false;
}

static void flush(uint32_t what)
{
    mmio_put(GRSTCTL, what);
    (void)wait_for(GRSTCTL, FLUSH_RX | FLUSH_TX, 0);
}

/* --- packets ----------------------------------------------------------------------------- */

static void write_fifo(uint8_t endpoint, const uint8_t *from, uint32_t n)
{
    for (uint32_t i = 0; i < n; i += 4) {
        uint32_t word = 0;
        for (uint32_t j = 0; j < 4 && i + j < n; j++) {
            word |= (uint32_t)from[i + j] << 8 * j;
        }
        mmio_put(FIFO(endpoint), word);
    }
}

/* Read a packet of n bytes out of the receive queue; what goes beyond `room` is thrown away. */
static void read_fifo(uint8_t *to, uint32_t n, uint32_t room)
{
    for (uint32_t i = 0; i < n; i += 4) {
        const uint32_t word = mmio_get(FIFO(0));
        for (uint32_t j = 0; j < 4 && i + j < n && i + j < room; j++) {
            to[i + j] = (uint8_t)(word >> 8 * j);
        }
    }
}

static void expect_control(void)
{
    mmio_put(DOEPTSIZ(0), THREE_SETUPS | ONE_PACKET | USB_PACKET);
    mmio_set(DOEPCTL(0), ENABLE | CLEAR_NAK);
}

static void expect_data(void)
{
    mmio_put(DOEPTSIZ(USB_DATA_ENDPOINT), ONE_PACKET | USB_PACKET);
    mmio_set(DOEPCTL(USB_DATA_ENDPOINT), ENABLE | CLEAR_NAK);
}

/* --- control transfers ------------------------------------------------------------------- */

static void answer_packet(void)
{
    const uint16_t n = control.left < USB_PACKET ? control.left : (uint16_t)USB_PACKET;
    mmio_put(DIEPTSIZ(0), ONE_PACKET | n);
    mmio_set(DIEPCTL(0), ENABLE | CLEAR_NAK);
    write_fifo(0, control.answer, n);
    control.answer += n;
    control.left = (uint16_t)(control.left - n);
    if (n < USB_PACKET) {
        control.empty_last = false;
    }
}

/* Send what was asked for, never more than was asked for; an answer that is shorter ends with a
 * packet that is not full. */
static void answer(const uint8_t *from, uint16_t n)
{
    const uint16_t asked = control.setup.length;
    control.answer = from;
    control.left = n < asked ? n : asked;
    control.empty_last = n < asked;
    answer_packet();
    expect_control(); /* the host confirms with an empty packet */
}

/* Confirm a request that wants no answer. */
static void confirm(void)
{
    control.left = 0;
    control.empty_last = false;
    mmio_put(DIEPTSIZ(0), ONE_PACKET);
    mmio_set(DIEPCTL(0), ENABLE | CLEAR_NAK);
}

static void refuse(void)
{
    mmio_set(DIEPCTL(0), STALL);
    mmio_set(DOEPCTL(0), STALL);
}

/* Forget what was to be sent to the host on an endpoint. */
static void cancel_in(uint8_t endpoint)
{
    if (mmio_get(DIEPCTL(endpoint)) & ENABLE) {
        mmio_set(DIEPCTL(endpoint), DISABLE | SET_NAK);
        (void)wait_for(DIEPCTL(endpoint), ENABLE, 0);
    }
    flush(FLUSH_TX | (uint32_t)endpoint << 6);
}

static void configure(uint8_t value)
{
    configured = value;
    cancel_in(USB_DATA_ENDPOINT);
    if (value == 0) {
        mmio_clear(DIEPCTL(USB_DATA_ENDPOINT), ACTIVE);
        mmio_clear(DOEPCTL(USB_DATA_ENDPOINT), ACTIVE);
        mmio_clear(DIEPCTL(USB_NOTICE_ENDPOINT), ACTIVE);
        return;
    }
    mmio_put(DIEPCTL(USB_DATA_ENDPOINT),
             DATA0 | ACTIVE | BULK | USB_DATA_ENDPOINT << 22 | USB_PACKET);
    mmio_put(DOEPCTL(USB_DATA_ENDPOINT), DATA0 | ACTIVE | BULK | USB_PACKET);
    mmio_put(DIEPCTL(USB_NOTICE_ENDPOINT),
             DATA0 | ACTIVE | INTERRUPT | USB_NOTICE_ENDPOINT << 22 | USB_NOTICE_PACKET);
    expect_data();
}

/* The control register of the endpoint that a request names; 0 for one that there is not. */
static uint32_t endpoint_control(uint16_t index)
{
    const uint8_t number = index & 0x7Fu;
    const bool in = index & 0x80u;
    if (number == 0 || (configured && (number == USB_DATA_ENDPOINT ||
                                       (number == USB_NOTICE_ENDPOINT && in)))) {
        return in ? DIEPCTL(number) : DOEPCTL(number);
    }
    return 0;
}

/* Halting an endpoint, asking for it, and ending it. */
static void endpoint_request(const setup_packet *setup)
{
    const uint32_t address = endpoint_control(setup->index);
    if (address == 0 || (setup->request != GET_STATUS && setup->value != 0)) {
        refuse();
    } else if (setup->request == GET_STATUS) {
        small[0] = mmio_get(address) & STALL ? 1 : 0;
        small[1] = 0;
        answer(small, 2);
    } else {
        if ((setup->index & 0x7Fu) != 0) {
            if (setup->request == SET_FEATURE) {
                mmio_set(address, STALL);
            } else {
                mmio_field(address, STALL, DATA0);
            }
        }
        confirm();
    }
}

static void standard_request(const setup_packet *setup)
{
    const uint8_t *descriptor;
    uint16_t length = 0;
    switch (setup->request) {
    case GET_STATUS:
        small[0] = 0;
        small[1] = 0;
        answer(small, 2);
        break;
    case SET_ADDRESS:
        /* The peripheral wants it before the confirmation and uses it after. */
        mmio_field(DCFG, ADDRESS, (setup->value & 0x7Fu) << 4);
        confirm();
        break;
    case GET_DESCRIPTOR:
        descriptor = usb_descriptor((uint8_t)(setup->value >> 8), (uint8_t)setup->value, identity,
                                    &length);
        if (descriptor == 0) {
            refuse();
        } else {
            answer(descriptor, length);
        }
        break;
    case GET_CONFIGURATION:
        answer(&configured, 1);
        break;
    case SET_CONFIGURATION:
        if (setup->value > 1) {
            refuse();
        } else {
            configure((uint8_t)setup->value);
            confirm();
        }
        break;
    case GET_INTERFACE:
        small[0] = 0;
        answer(small, 1);
        break;
    case SET_INTERFACE:
        if (setup->value == 0) {
            confirm();
        } else {
            refuse();
        }
        break;
    default:
        refuse();
    }
}

static void class_request(const setup_packet *setup)
{
    switch (setup->request) {
    case SET_LINE_CODING: /* kept for those who ask; there is no line behind it */
        if (setup->length == LINE_CODING_SIZE) {
            control.taking_line = true;
            expect_control();
        } else {
            refuse();
        }
        break;
    case GET_LINE_CODING:
        answer(line_coding, sizeof line_coding);
        break;
    case SET_CONTROL_LINES:
        opened = opened || ((setup->value & 1u) && !dtr);
        dtr = setup->value & 1u;
        confirm();
        break;
    case SEND_BREAK:
        confirm();
        break;
    default:
        refuse();
    }
}

static void obey(const setup_packet *setup)
{
    /* A new request ends the one before, whatever had become of it. */
    if (mmio_get(DIEPCTL(0)) & ENABLE) {
        cancel_in(0);
    }
    control.left = 0;
    control.empty_last = false;
    control.taking_line = false;
    mmio_put(DIEPINT(0), TX_DONE);
    if ((setup->kind & KIND) == CLASS) {
        class_request(setup);
    } else if ((setup->kind & KIND) != STANDARD) {
        refuse();
    } else if ((setup->kind & 0x1Fu) == TO_ENDPOINT &&
               (setup->request == GET_STATUS || setup->request == CLEAR_FEATURE ||
                setup->request == SET_FEATURE)) {
        endpoint_request(setup);
    } else {
        standard_request(setup);
    }
}

/* --- what comes in ----------------------------------------------------------------------- */

static uint32_t receive_room(void)
{
    return RECEIVE_SIZE - (received_put - received_taken);
}

static void take_data(uint32_t n)
{
    uint8_t packet[USB_PACKET];
    read_fifo(packet, n, sizeof packet);
    for (uint32_t i = 0; i < n && i < sizeof packet; i++) {
        received[received_put++ & (RECEIVE_SIZE - 1)] = packet[i];
    }
}

static void take_setup(uint32_t n)
{
    uint8_t packet[8] = {0};
    read_fifo(packet, n, sizeof packet);
    control.setup.kind = packet[0];
    control.setup.request = packet[1];
    control.setup.value = (uint16_t)(packet[2] | packet[3] << 8);
    control.setup.index = (uint16_t)(packet[4] | packet[5] << 8);
    control.setup.length = (uint16_t)(packet[6] | packet[7] << 8);
}

static void take_control_data(uint32_t n)
{
    uint8_t packet[LINE_CODING_SIZE] = {0};
    read_fifo(packet, n, sizeof packet);
    if (control.taking_line && n == LINE_CODING_SIZE) {
        for (uint8_t i = 0; i < LINE_CODING_SIZE; i++) {
            line_coding[i] = packet[i];
        }
    }
}

static void take_received(void)
{
    const uint32_t word = mmio_get(GRXSTSP);
    const uint32_t endpoint = word & 0xFu;
    const uint32_t n = word >> 4 & 0x7FFu;
    switch (word >> 17 & 0xFu) {
    case SETUP_DATA:
        take_setup(n);
        break;
    case SETUP_DONE: /* of several in a row the last one counts */
        obey(&control.setup);
        break;
    case OUT_DATA:
        if (endpoint == 0) {
            take_control_data(n);
        } else {
            take_data(n);
        }
        break;
    case OUT_DONE:
        if (endpoint == 0 && control.taking_line) {
            control.taking_line = false;
            confirm();
        }
        break;
    default:
        break;
    }
}

/* --- the bus ----------------------------------------------------------------------------- */

/* The host has plugged in, or wants to begin again. */
static void bus_reset(void)
{
    cancel_in(0);
    configure(0);
    mmio_clear(DCFG, ADDRESS);
    control.left = 0;
    control.empty_last = false;
    control.taking_line = false;
    dtr = false;
    received_taken = received_put;
    expect_control();
}

static void send_waiting(void)
{
    uint8_t packet[USB_PACKET];
    const uint32_t waiting = as_ring_waiting(out);
    uint32_t n = waiting < MOST_AT_ONCE ? waiting : MOST_AT_ONCE;
    if (n > 0 && n % USB_PACKET == 0) {
        n--;
    }
    if (n == 0 || (mmio_get(DIEPCTL(USB_DATA_ENDPOINT)) & (ENABLE | STALL))) {
        return; /* nothing to send, or the host has not yet fetched what is there */
    }
    const uint32_t packets = (n + USB_PACKET - 1) / USB_PACKET;
    mmio_put(DIEPINT(USB_DATA_ENDPOINT), TX_DONE);
    mmio_put(DIEPTSIZ(USB_DATA_ENDPOINT), packets << 19 | n);
    mmio_set(DIEPCTL(USB_DATA_ENDPOINT), ENABLE | CLEAR_NAK);
    while (n > 0) {
        const uint32_t some = n < USB_PACKET ? n : USB_PACKET;
        for (uint32_t i = 0; i < some; i++) {
            packet[i] = (uint8_t)as_ring_take(out);
        }
        write_fifo(USB_DATA_ENDPOINT, packet, some);
        n -= some;
    }
}

void usb_cdc_init(as_ring *ring, const uint32_t unique_id[3], void (*wait_ms)(uint32_t ms))
{
    out = ring;
    identity = unique_id;
    configured = 0;
    (void)wait_for(GRSTCTL, AHB_IDLE, AHB_IDLE);
    mmio_put(GRSTCTL, CORE_RESET);
    (void)wait_for(GRSTCTL, CORE_RESET, 0);
    mmio_put(GCCFG, POWER_UP);
    mmio_field(GUSBCFG, TURNAROUND, FORCE_DEVICE | TURNAROUND_80_MHZ);
    wait_ms(FORCE_MS);
    mmio_set(GOTGCTL, B_SESSION_VALID);
    mmio_put(PCGCCTL, 0);
    mmio_set(DCTL, SOFT_DISCONNECT);
    mmio_set(DCFG, FULL_SPEED);
    mmio_put(GRXFSIZ, RX_WORDS);
    mmio_put(DIEPTXF0, TX0_WORDS << 16 | RX_WORDS);
    mmio_put(DIEPTXF(1), TX1_WORDS << 16 | (RX_WORDS + TX0_WORDS));
    mmio_put(DIEPTXF(2), TX2_WORDS << 16 | (RX_WORDS + TX0_WORDS + TX1_WORDS));
    flush(FLUSH_TX | ALL_FIFOS);
    flush(FLUSH_RX);
    mmio_put(GINTSTS, 0xBFFFFFFFu);
    mmio_clear(DCTL, SOFT_DISCONNECT);
}

void usb_cdc_poll(void)
{
    const uint32_t status = mmio_get(GINTSTS);
    if (status & BUS_RESET) {
        mmio_put(GINTSTS, BUS_RESET);
        bus_reset();
    }
    if (status & SPEED_KNOWN) {
        mmio_put(GINTSTS, SPEED_KNOWN);
        mmio_set(DCTL, CLEAR_GLOBAL_IN_NAK);
    }
    /* A packet is taken out only when there is room for it; the host waits. */
    while ((mmio_get(GINTSTS) & RX_LEVEL) && receive_room() >= USB_PACKET) {
        take_received();
    }
    if (mmio_get(DIEPINT(0)) & TX_DONE) {
        mmio_put(DIEPINT(0), TX_DONE);
        if (control.left > 0 || control.empty_last) {
            answer_packet();
        }
    }
    if (configured) {
        const uint32_t receiving = mmio_get(DOEPCTL(USB_DATA_ENDPOINT));
        if (!(receiving & (ENABLE | STALL)) && receive_room() >= 2 * USB_PACKET) {
            expect_data();
        }
        send_waiting();
    }
}

int usb_cdc_receive(void)
{
    if (received_taken == received_put) {
        return -1;
    }
    return received[received_taken++ & (RECEIVE_SIZE - 1)];
}

bool usb_cdc_opened(void)
{
    const bool was = opened;
    opened = false;
    return was;
}

void usb_cdc_discard(void)
{
    cancel_in(USB_DATA_ENDPOINT);
}
