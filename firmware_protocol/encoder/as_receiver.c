#include "as_receiver.h"

#include "as_bytes.h"
#include "as_cobs.h"
#include "as_crc32.h"

void as_receiver_init(as_receiver *receiver)
{
    receiver->used = 0;
    receiver->too_long = false;
    receiver->bad = 0;
}

/* The chunk between two zeros as a command; false where it is none. */
static bool parse(as_receiver *receiver, as_command *command)
{
    uint8_t *frame = receiver->bytes;
    const size_t n = as_cobs_decode(frame, receiver->used, frame);
    if (n < AS_HEADER_SIZE + AS_CRC_SIZE || n > AS_FRAME_MAX) {
        return false;
    }
    const size_t body = n - AS_HEADER_SIZE - AS_CRC_SIZE;
    if (as_crc32(frame, n - AS_CRC_SIZE) != as_get32(frame + n - AS_CRC_SIZE)) {
        return false;
    }
    if (frame[7] != body || frame[0] < 0x80) {
        return false;
    }
    command->type = frame[0];
    command->version = frame[1];
    command->seq = as_get16(frame + 2);
    command->n = frame[7];
    command->body = frame + AS_HEADER_SIZE;
    return true;
}

bool as_receive(as_receiver *receiver, uint8_t byte, as_command *command)
{
    if (byte != 0) {
        if (receiver->used == sizeof receiver->bytes) {
            receiver->too_long = true;
        } else {
            receiver->bytes[receiver->used++] = byte;
        }
        return false;
    }
    const bool empty = receiver->used == 0; /* zeros between frames are legal */
    const bool good = !empty && !receiver->too_long && parse(receiver, command);
    if (!empty && !good) {
        receiver->bad++;
    }
    receiver->used = 0;
    receiver->too_long = false;
    return good;
}
