"""A USB host that enumerates a serial port the way Linux does and reads its descriptors."""

import struct
from dataclasses import dataclass, field

from support.stm32l476_model import NAK, STALL

PATIENCE = 50


class Refused(Exception):
    """The device stalled a request."""


@dataclass
class Interface:
    """One interface: class codes, the class's own descriptors, endpoints by address."""

    codes: tuple
    functional: dict = field(default_factory=dict)
    endpoints: dict = field(default_factory=dict)


def parse_configuration(data):
    """Return the interfaces of a configuration descriptor; every length must fit."""
    size, kind, total, count, value, _, attributes, _ = struct.unpack_from("<BBHBBBBB", data)
    assert (size, kind, total) == (9, 2, len(data))
    assert value == 1
    assert attributes & 0x80
    interfaces, at = [], size
    while at < len(data):
        size, kind = data[at], data[at + 1]
        assert 2 <= size <= len(data) - at, "a descriptor reaches beyond the end"
        body = data[at : at + size]
        if kind == 4:
            assert (size, body[2]) == (9, len(interfaces))
            interfaces.append(Interface(tuple(body[5:8])))
            left = body[4]
        elif kind == 5:
            assert size == 7
            left -= 1
            interfaces[-1].endpoints[body[2]] = (body[3], struct.unpack_from("<H", body, 4)[0])
        elif kind == 0x24:
            interfaces[-1].functional[body[2]] = body[3:]
        at += size
        if at == len(data) or data[at + 1] == 4:
            assert left == 0, "fewer endpoints than the interface says"
    assert len(interfaces) == count
    return interfaces


class UsbHost:
    """The other end of the cable of a `Chip`."""

    def __init__(self, chip):
        self.chip, self.usb = chip, chip.usb
        self.received = bytearray()

    def _until(self, attempt):
        for _ in range(PATIENCE):
            if (got := attempt()) is not NAK:
                if got is STALL:
                    raise Refused
                return got
            self.chip.turn()
        raise TimeoutError("the device answers NAK for ever")

    def control(self, kind, request, value=0, index=0, length=0, data=b""):
        """Run one control transfer and return what the device sent."""
        length = len(data) or length
        self.usb.host_setup(struct.pack("<BBHHH", kind, request, value, index, length))
        answer = b""
        if kind & 0x80 and length:
            while len(answer) < length:
                packet = self._until(lambda: self.usb.host_in(0))
                answer += packet
                if len(packet) < 64:
                    break
            assert len(answer) <= length, "more than was asked for"
            assert self._until(lambda: self.usb.host_out(0, b""))
        else:
            if data:
                self._until(lambda: self.usb.host_out(0, data))
            assert self._until(lambda: self.usb.host_in(0)) == b""
        self.chip.turn()
        return answer

    def descriptor(self, kind, index=0, length=255):
        return self.control(0x80, 6, kind << 8 | index, 0, length)

    def text(self, index):
        """Return a string descriptor."""
        raw = self.descriptor(3, index)
        assert (raw[0], raw[1]) == (len(raw), 3)
        return raw[2:].decode("utf-16-le")

    def enumerate(self):
        """Do what a host does when a device is plugged in; returns its interfaces."""
        assert self.usb.attached
        self.usb.check_memory()
        self.usb.host_reset()
        self.chip.turn()
        assert self.descriptor(1, length=64)[7] == 64, "size of packets on endpoint 0"
        self.usb.host_reset()
        self.chip.turn()
        assert self.usb.address == 0
        self.control(0x00, 5, 9)
        assert self.usb.address == 9
        self.device = self.descriptor(1, length=18)
        assert len(self.descriptor(2, length=9)) == 9
        total = struct.unpack_from("<H", self.descriptor(2, length=9), 2)[0]
        interfaces = parse_configuration(self.descriptor(2, length=total))
        self.control(0x00, 9, 1)
        return interfaces

    def open(self):
        """Do what a program does that opens the port."""
        self.control(0x21, 0x20, data=struct.pack("<IBBB", 115200, 0, 0, 8))
        self.control(0x21, 0x22, 3)

    def close(self):
        self.control(0x21, 0x22, 0)

    def read(self, most=1 << 20):
        """Take what the device has on its data endpoint; returns it."""
        got = bytearray()
        while len(got) < most and (packet := self.usb.host_in(1)) not in (NAK, STALL):
            got += packet
        return bytes(got)

    def run(self, seconds, reading=True):
        """Let time pass; returns what came."""
        until = self.chip.now_us + seconds * 1e6
        got = bytearray()
        while self.chip.now_us < until:
            self.chip.turn()
            if reading:
                got += self.read()
        return bytes(got)

    def write(self, data):
        """Send bytes to the data endpoint, in packets."""
        for at in range(0, len(data), 64):
            self._until(lambda at=at: self.usb.host_out(1, data[at : at + 64]))
