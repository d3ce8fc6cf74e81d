"""A register-level model of what the SensorTile's firmware uses of its STM32L476.

The OTG_FS peripheral in device mode (reference manual RM0351, chapter 47): its queues with their
sizes, transfers that are armed by size, count and enable, handshakes, latched events. The SPI with
an LSM6DSM at its end and the DMA behind it (chapters 42 and 11), byte by byte, with a clock that
runs until it is switched off. The tick, the interrupt of the sensor, the watchdog. What the manual
forbids is an AssertionError.
"""

import ctypes as c
from collections import deque

OTG = 0x50000000
SPI2 = 0x40003800
DMA1 = 0x40020000
TICKS = 80_000
ACCESS = 6
"""Cycles that an access to a register takes."""
STALL, NAK = "stall", None
GET = c.CFUNCTYPE(c.c_uint32, c.c_uint32)
PUT = c.CFUNCTYPE(None, c.c_uint32, c.c_uint32)


class OtgFs:
    """The USB peripheral; its `host_` methods are the other end of the cable."""

    def __init__(self):
        self._reset()

    def _reset(self):
        self.registers = {0x804: 2}  # disconnected
        self.events = 0
        self.rx = deque()
        self.reading = deque()
        self.tx = {n: bytearray() for n in range(4)}
        self.nak = {(way, n): True for way in ("in", "out") for n in range(4)}

    # --- the firmware's side ----------------------------------------------------------------

    def get(self, offset):
        """Read a register."""
        if offset == 0x14:
            return self.events | bool(self.rx) << 4
        if offset == 0x10:
            return 1 << 31
        if offset == 0x20:
            assert not self.reading, "the packet before was not read to its end"
            word, data = self.rx.popleft()
            padded = data + bytes(-len(data) % 4)
            self.reading = deque(padded[i : i + 4] for i in range(0, len(padded), 4))
            return word
        if offset == 0x1000:
            return int.from_bytes(self.reading.popleft(), "little")
        return self.registers.get(offset, 0)

    def put(self, offset, value):
        """Write a register."""
        if offset == 0x14:
            self.events &= ~value
        elif offset == 0x10:
            self._reset_control(value)
        elif 0x900 <= offset < 0xB00 and offset % 0x20 == 0:
            self._control("in", (offset - 0x900) // 0x20, offset, value)
        elif 0xB00 <= offset < 0xD00 and offset % 0x20 == 0:
            self._control("out", (offset - 0xB00) // 0x20, offset, value)
        elif 0x900 <= offset < 0xD00 and offset % 0x20 == 8:
            self.registers[offset] = self.registers.get(offset, 0) & ~value
        elif offset >= 0x1000:
            self._queue((offset >> 12) - 1, value)
        else:
            self.registers[offset] = value

    def _reset_control(self, value):
        if value & 1:
            self._reset()
        if value & 1 << 5:
            number = value >> 6 & 0x1F
            for n in self.tx if number == 16 else (number,):
                self.tx[n].clear()

    def _control(self, way, n, offset, value):
        old = self.registers.get(offset, 0)
        enabled = old & 1 << 31
        if value & 1 << 31 and not enabled:
            size = self.registers.get(offset + 0x10, 0)
            assert size >> 19 & 0x3FF, f"{way} {n} enabled for no packet"
            if n:
                assert value & 1 << 15, f"{way} {n} enabled before it is active"
            enabled = 1 << 31
        if value & 1 << 30:
            assert enabled, f"{way} {n} disabled that was not enabled"
            enabled = 0
        if value & 1 << 26:
            self.nak[way, n] = False
        if value & 1 << 27:
            self.nak[way, n] = True
        kept = value & ~(1 << 26 | 1 << 27 | 1 << 28 | 1 << 30 | 1 << 31)
        self.registers[offset] = kept | enabled

    def words_of(self, n):
        """Size of a transmit queue."""
        return self.registers.get(0x28 if n == 0 else 0x100 + 4 * n, 0) >> 16

    def _queue(self, n, value):
        control, size = self.registers.get(0x900 + 0x20 * n, 0), self.registers[0x910 + 0x20 * n]
        assert control & 1 << 31, f"written into queue {n} before its endpoint was enabled"
        self.tx[n] += value.to_bytes(4, "little")
        assert len(self.tx[n]) <= 4 * self.words_of(n), f"queue {n} ran over"
        assert len(self.tx[n]) < (size & 0x7FFFF) + 4, f"more in queue {n} than its transfer says"

    # --- the host's side ----------------------------------------------------------------------

    @property
    def attached(self):
        """Whether the pull-up is on."""
        on = self.registers.get(0x38, 0) & 1 << 16 and self.registers.get(0xC, 0) & 1 << 30
        session = self.registers.get(0, 0) >> 6 & 3 == 3
        return bool(on and session and not self.registers[0x804] & 2)

    @property
    def address(self):
        return self.registers.get(0x800, 0) >> 4 & 0x7F

    def check_memory(self):
        """Check that the queues lie behind one another in 320 words."""
        at = self.registers[0x24]
        assert at >= 16 + 13, "room for a packet, its status, and three setups"
        for n in range(3):
            where = self.registers[0x28 if n == 0 else 0x100 + 4 * n]
            assert where & 0xFFFF == at, f"queue {n} begins where the one before ends"
            at += where >> 16
        assert at <= 320

    def host_reset(self):
        """Reset the bus: endpoints but 0 are no longer active."""
        self.events |= 1 << 12 | 1 << 13
        for n in range(1, 4):
            for base in (0x900, 0xB00):
                offset = base + 0x20 * n
                self.registers[offset] = self.registers.get(offset, 0) & ~(1 << 15)

    def host_setup(self, packet):
        """Send a SETUP packet: always accepted; ends stalls and what endpoint 0 was about to do."""
        assert self.registers.get(0xB10, 0) >> 29, "no setup packet is expected"
        for base in (0x900, 0xB00):
            self.registers[base] = self.registers.get(base, 0) & ~(1 << 21)
        self.nak["in", 0] = self.nak["out", 0] = True
        self.rx.append((6 << 17 | len(packet) << 4, packet))
        self.rx.append((4 << 17, b""))

    def host_in(self, n):
        """Ask for a packet: bytes, NAK or STALL."""
        offset = 0x900 + 0x20 * n
        control, size = self.registers.get(offset, 0), self.registers.get(offset + 0x10, 0)
        if control & 1 << 21:
            return STALL
        if not control & 1 << 31 or self.nak["in", n] or (n and not control & 1 << 15):
            return NAK
        most = 64 if n == 0 else control & 0x7FF
        length = min(size & 0x7FFFF, most)
        if len(self.tx[n]) < length:
            return NAK
        data = bytes(self.tx[n][:length])
        del self.tx[n][: -(-length // 4) * 4]
        packets = (size >> 19 & 0x3FF) - 1
        self.registers[offset + 0x10] = packets << 19 | (size & 0x7FFFF) - length
        if packets == 0:
            assert n == 0 or length < most, "a full last packet: the host waits for more"
            self.registers[offset] = control & ~(1 << 31)
            self.registers[offset + 8] = self.registers.get(offset + 8, 0) | 1
        return data

    def host_out(self, n, data):
        """Send a packet: True when taken, else NAK or STALL."""
        offset = 0xB00 + 0x20 * n
        control, size = self.registers.get(offset, 0), self.registers.get(offset + 0x10, 0)
        if control & 1 << 21:
            return STALL
        waiting = sum(2 + -(-len(data) // 4) for _, data in self.rx)
        full = waiting + 2 + 16 > self.registers.get(0x24, 0)
        if full or not control & 1 << 31 or self.nak["out", n]:
            return NAK
        assert len(data) <= (size & 0x7FFFF)
        self.rx.append((2 << 17 | len(data) << 4 | n, data))
        self.rx.append((3 << 17 | n, b""))
        self.registers[offset] = control & ~(1 << 31)
        self.nak["out", n] = True
        return True


class SensorSpi:
    """SPI2 with one data line on PB13 and PB15, select on PB12, and channel 4 of DMA1 behind it.

    As a receiver the clock runs from the moment the SPI is switched on until it is switched off,
    and the byte that is under way then is the last. Before its first bit there is none.

    Attributes
    ----------
    bursts : list of int
        Bytes of each reading that DMA took.
    late_cycles : int
        By how much the next interrupt of the DMA is late that ends a reading of the FIFO.
    """

    BYTE, BIT = 128, 16
    ENTRY = 24
    """Cycles from the end of a transfer by DMA to the first instruction of its handler."""

    def __init__(self, part, memory):
        self.part, self._memory = part, memory
        self.late_cycles = 0
        self.was_late = False
        self.bursts = []
        self.registers = {}
        self.channel = {}
        self.rx = deque()
        self.cycles = 0
        self._select(False)

    def _select(self, on):
        self.selected, self.command, self.reg, self.spare = on, None, 0, b""

    def get(self, offset):
        """Read a register of the SPI."""
        if offset == 0x08:
            return bool(self.rx) | 2
        if offset == 0x0C:
            return self.rx.popleft() if self.rx else 0
        return self.registers.get(offset, 0)

    def put(self, offset, value):
        """Write a register of the SPI."""
        control = self.registers.get(0, 0)
        if offset == 0:
            on = control & 1 << 6
            assert not on or not (control ^ value) & ~(1 << 6), "changed while it is on"
            assert value & 0x8307 == 0x8307, "master, mode 3, one line, select by software"
            assert 80e6 / (2 << (value >> 3 & 7)) == 80e6 * 8 / self.BYTE <= 10e6
            if on and not value & 1 << 6 and self.receiving:
                assert self.cycles > self.BIT or self.was_late, "no bit of the last byte came yet"
                self._byte()
            self.cycles = 0
        elif offset == 0x0C:
            assert control & 1 << 6, "sent by an SPI that is off"
            assert control & 1 << 14, "both ends drive the data line"
            self._sent(value)
        self.registers[offset] = value

    @property
    def receiving(self):
        """Whether the clock runs."""
        return self.registers.get(0, 0) & (1 << 6 | 1 << 14) == 1 << 6

    def pin(self, value):
        """Move the select."""
        if value & 1 << 12:
            self._select(False)
        elif value & 1 << 28:
            self._select(True)

    def pass_cycles(self, cycles):
        """Let the clock run."""
        if self.receiving:
            self.cycles += cycles
            while self.cycles >= self.BYTE:
                self.cycles -= self.BYTE
                self._byte()

    def _byte(self):
        byte, channel = self._next(), self.channel
        by_dma = self.registers.get(0x04, 0) & 1 and channel.get(0x44, 0) & 1
        if by_dma and channel[0x48]:
            assert channel[0x44] & 0x0FF2 == 0x0082, "bytes to memory, told of the end"
            assert channel.get(0xA8, 0) >> 12 & 0xF == 1, "request 1 of channel 4 is SPI2_RX"
            assert channel[0x4C] == SPI2 + 0x0C
            self._memory(channel[0x50], self.taken, byte)
            self.taken += 1
            channel[0x48] -= 1
            channel[0] = (not channel[0x48]) << 13
        else:
            self.rx.append(byte)

    def dma_put(self, offset, value):
        """Write a register of the DMA."""
        if offset == 0x04:
            self.channel[0] = self.channel.get(0, 0) & ~value
            return
        enabled = self.channel.get(0x44, 0) & 1
        assert offset == 0x44 or not enabled, "changed while it is on"
        if offset == 0x44 and value & 1 and not enabled:
            self.taken = 0
            self.bursts.append(self.channel[0x48] + 1)
        self.channel[offset] = value

    def late(self):
        """Return by how many cycles this handler is late."""
        self.was_late = bool(self.late_cycles) and self.bursts[-1] > 4
        late = self.late_cycles if self.was_late else 0
        self.late_cycles -= late
        return late

    def interrupts(self):
        """Whether the DMA has all that it was to take and its handler has not heard of it."""
        return bool(self.channel.get(0, 0))

    def _sent(self, byte):
        if not self.selected:
            return
        if self.command is None:
            self.command, self.reg = byte, byte & 0x7F
        else:
            assert not self.command & 0x80, "written in a reading"
            self.part.write(self.reg, byte)
            self.reg += 1

    def _next(self):
        """Return the next byte of a reading: the FIFO's registers roll, others go on."""
        assert self.selected
        assert self.command is not None
        assert self.command & 0x80, "read in a writing"
        if self.spare:
            byte, self.spare = self.spare[0], b""
            return byte
        if self.reg == 0x3E:
            word = self.part.read(0x3E, 2)
            self.spare = word[1:]
            return word[0]
        byte = self.part.read(self.reg, 1)[0]
        self.reg += 1
        return byte


class Watchdog:
    """The independent watchdog: it resets the chip when its key does not come in time.

    Attributes
    ----------
    started : bool
        Whether it runs; nothing can stop it then.
    longest_us : float
        Longest time between two keys since.
    """

    def __init__(self):
        self.started = False
        self.longest_us = self._kicked_us = 0.0
        self._prescaler, self._reload, self._open = 0, 0xFFF, False

    @property
    def period_s(self):
        """Time that it waits for its key."""
        return 4 * 2**self._prescaler * (self._reload + 1) / 32_000

    def put(self, offset, value, now_us):
        """Take a write: of prescaler and reload only after their key."""
        if offset == 0:
            assert value in (0xAAAA, 0xCCCC, 0x5555), hex(value)
            if value == 0xAAAA and self.started:
                self.longest_us = max(self.longest_us, now_us - self._kicked_us)
            self._kicked_us = now_us
            self.started |= value == 0xCCCC
            self._open = value == 0x5555
            return
        assert self._open, "prescaler and reload are protected"
        if offset == 4:
            self._prescaler = value
        else:
            self._reload = value


class Chip:
    """The chip with the firmware in it, its sensor and its cable.

    Parameters
    ----------
    library : CDLL
        The firmware, built with MMIO_MODEL.
    part : Lsm6dsm
        On its bus.
    crystal : bool
        Whether the crystal of 32 kHz swings.
    hung : bool
        Whether the watchdog had restarted it.

    Attributes
    ----------
    busy_ms : int
        What a turn of the main loop takes in which samples were read: 0 for a fast processor.
    """

    def __init__(self, library, part, crystal=True, hung=False):
        self.part, self.usb, self.spi = part, OtgFs(), SensorSpi(part, self._to_memory)
        self.registers = {0x40021094: hung << 29}
        self.watchdog = Watchdog()
        self.busy_ms = 0
        self.now_us = 0.0
        self._crystal = crystal
        self._library = library
        self._broken = []
        self._get, self._put = GET(self._guard(self.get)), PUT(self._guard(self.put))
        library.sensortile_turn.restype = c.c_bool
        for name, function in (("get", self._get), ("put", self._put)):
            c.c_void_p.in_dll(library, f"mmio_model_{name}").value = c.cast(
                function, c.c_void_p
            ).value

    def _guard(self, function):
        """Keep what goes wrong below the C, where it would be printed and forgotten."""

        def guarded(*arguments):
            try:
                return function(*arguments) or 0
            except Exception as wrong:
                self._broken.append(wrong)
                return 0

        return guarded

    def _check(self):
        if self._broken:
            raise self._broken[0]

    def get(self, address):
        """Read a register of the chip."""
        if OTG <= address < OTG + 0x10000:
            return self.usb.get(address - OTG)
        self.spi.pass_cycles(ACCESS)
        if SPI2 <= address < SPI2 + 0x10:
            return self.spi.get(address - SPI2)
        if address == 0xE000E018:
            return TICKS - 1 - int(self.now_us % 1000.0 * 80.0)
        value = self.registers.get(address, 0)
        ready = {
            0x40021000: 2 | (value & 1 << 24) << 1,  # MSI, PLL
            0x40021008: (value & 3) << 2,  # the clock that was chosen is used
            0x40021090: (value & 1 and self._crystal) << 1,
            0x50060804: 1,
            0x50060808: 0x12345678,
        }
        unique = {0x1FFF7590: 0x00210045, 0x1FFF7594: 0x33365101, 0x1FFF7598: 0x20373357}
        return value | ready.get(address, 0) | unique.get(address, 0)

    def put(self, address, value):
        """Write a register of the chip."""
        if OTG <= address < OTG + 0x10000:
            self.usb.put(address - OTG, value)
        elif address == 0:
            self.sleep()
        elif address == 1:
            self.spi.pass_cycles(value)
        elif SPI2 <= address < SPI2 + 0x10:
            self.spi.pass_cycles(ACCESS)
            if address == SPI2 and value & 1 << 6:
                self._check_bus()
            self.spi.put(address - SPI2, value)
        elif DMA1 <= address < DMA1 + 0xAC:
            self.spi.pass_cycles(ACCESS)
            self.spi.dma_put(address - DMA1, value)
        elif address == 0x48000418:
            self.spi.pin(value)
        elif 0x40003000 <= address <= 0x40003008:
            self.watchdog.put(address - 0x40003000, value, self.now_us)
        else:
            self.registers[address] = value

    def _check_bus(self):
        """Check clocks and pins of the SPI before it drives them."""
        got = self.registers.get
        assert got(0x40021048, 0) & 1, "DMA1 has no clock"
        assert got(0x40021058, 0) & 1 << 14, "SPI2 has no clock"
        for pin in (13, 15):
            assert got(0x48000400, 0) >> 2 * pin & 3 == 2, "alternate function"
            assert got(0x48000424, 0) >> 4 * (pin - 8) & 15 == 5, "that of SPI2"
            assert got(0x4800040C, 0) >> 2 * pin & 3 == 1, "rests high"

    def _to_memory(self, base, offset, byte):
        """Write what the DMA took; its addresses have 32 bits, those of the host more."""
        where = c.c_uint8.in_dll(self._library, "sensor_spi_bytes")
        assert c.addressof(where) & 0xFFFFFFFF == base
        c.memset(c.addressof(where) + offset, byte, 1)

    def sleep(self):
        """Let time pass until the next tick, or until the DMA has what it was to take."""
        tick_us = (self.now_us // 1000 + 1) * 1000.0
        while self.spi.receiving and self.now_us < tick_us:
            self._advance_to(min(tick_us, self.now_us + SensorSpi.BYTE / 80.0))
            self.spi.pass_cycles(SensorSpi.BYTE)
            if self.spi.interrupts():
                self.spi.pass_cycles(SensorSpi.ENTRY + self.spi.late())
                self._library.dma1_channel4_handler()
                return
        self._advance_to(tick_us)
        self._library.systick_handler()

    def _advance_to(self, until_us):
        """Let time pass; the interrupt of the sensor comes when it rises."""
        begun_s, begun_us = self.part.now_s, self.now_us
        self.part.advance((until_us - self.now_us) * 1e-6)
        for edge_s in self.part.edges:
            self.now_us = begun_us + (edge_s - begun_s) * 1e6
            self._library.exti2_handler()
        self.part.edges.clear()
        self.now_us = until_us

    def begin(self):
        """Power on."""
        self._library.sensortile_begin()
        self._check()

    def turn(self):
        """One turn of the main loop."""
        waiting = len(self.part.fifo)
        more = self._library.sensortile_turn()
        self._check()
        if len(self.part.fifo) < waiting:
            for _ in range(self.busy_ms):
                self.sleep()
        if not more:
            self.sleep()
