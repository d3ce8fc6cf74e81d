"""A register-accurate model of the LSM6DSM for tests of its driver.

Registers that the driver uses behave as the datasheet says: reset values, self-clearing software
reset, power-down until an ODR is set, the FIFO with its pattern of data sets (gyro, accelerometer,
time stamp), its status, overwriting of the oldest word when it is full, and the 24-bit time stamp
of 25 us that shares the oscillator with the ODR, the interrupt at the FIFO's threshold, the output
registers, and the self-test. The bus can be stuck at a level, and the supply can break down.
"""

from collections import deque

RATES = {1: 12.5, 2: 26, 3: 52, 4: 104, 5: 208, 6: 416, 7: 833, 8: 1660, 9: 3330, 10: 6660}
FIFO_WORDS = 2048
RESET = {0x12: 0x04}
THRESHOLD = 0x08
SIGNED = 1 << 16


class Lsm6dsm:
    """One part on its bus.

    Attributes
    ----------
    produced : int
        Samples made since the ODR was set; sample k has counts `counts(k)`.
    off_nominal : float
        Relative error of the part's oscillator.
    answers : bool
        Whether it acknowledges on the bus.
    stuck : int or None
        What every byte reads as, and then nothing that is written arrives: 0x00 or 0xFF.
    one_data_line : bool
        Whether it is wired by SPI with one data line: then only writing works until SIM is set.
    ticks_off : float
        Relative error of the ticks in a period: rates and ticks are not quite in the ratio that the
        datasheet names.
    ticking : bool
        Whether its time stamp counts.
    status : int or None
        What FIFO_STATUS2 reads as, whatever the FIFO holds.
    interrupt : int
        Which of its interrupt pins is wired, 1 or 2; 0 none.
    edges : list of float
        When that pin rose, in seconds.
    forces : tuple of int
        By how many counts the self-test moves the accelerometer and the gyro.
    who_am_i : int
        0x6A, or 0x69 for an LSM6DS3H, whose time stamp is switched on elsewhere.
    """

    def __init__(
        self, off_nominal=0.0, one_data_line=False, ticks_off=0.0, interrupt=0, who_am_i=0x6A
    ):
        self.interrupt = interrupt
        self.who_am_i = who_am_i
        self.forces = (4000, 5000)
        self.temperature = 0x0180
        self.edges = []
        self.now_s = 0.0
        self.off_nominal = off_nominal
        self.ticks_off = ticks_off
        self.ticking = True
        self.status = None
        self.one_data_line = one_data_line
        self.answers = True
        self.stuck = None
        self.writes = []
        self._reset()

    def _reset(self):
        self.registers = dict(RESET) | {0x0F: self.who_am_i}
        self._line = False
        self.fifo = deque()
        self.pattern = 0
        self.overrun = False
        self.produced = 0
        self._phase = 0.0
        self._ticks = 0.0

    def brown_out(self):
        """Break down and come back: everything as after power-up, identity included."""
        self._reset()

    # --- time -----------------------------------------------------------------------------

    @property
    def rate_hz(self):
        """True rate, 0 when powered down."""
        codes = self.registers.get(0x10, 0) >> 4, self.registers.get(0x11, 0) >> 4
        nominal = RATES.get(max(codes), 0.0)
        return nominal * (1.0 + self.off_nominal)

    def advance(self, seconds):
        """Let time pass."""
        self.now_s += seconds
        if not self.rate_hz:
            return
        self._phase += seconds * self.rate_hz
        while self._phase >= 1.0:
            self._phase -= 1.0
            at_s = self.now_s - self._phase / self.rate_hz
            # Time stamp and ODR share an oscillator: a period is the nominal number of ticks.
            period = 40_000 * (1.0 + self.off_nominal) / self.rate_hz
            self._ticks += period * (1.0 + self.ticks_off) * self.ticking
            self._sample()
            self._look_at_line(at_s)

    def _look_at_line(self, at_s):
        """Note when the interrupt rises; it falls when the FIFO is below its threshold again."""
        enabled = self.registers.get(0x0C + self.interrupt, 0) & THRESHOLD if self.interrupt else 0
        threshold = self.registers.get(0x06, 0) | (self.registers.get(0x07, 0) & 7) << 8
        line = bool(enabled) and len(self.fifo) >= threshold > 0
        if line and not self._line:
            self.edges.append(at_s)
        self._line = line

    @staticmethod
    def counts(k):
        """Return the six counts of sample k."""
        return [((k * 7 + axis * 1000) % SIGNED) - (SIGNED >> 1) for axis in range(6)]

    def _sample(self):
        words = [value % SIGNED for value in self.counts(self.produced)]
        self.produced += 1
        if self.registers.get(0x0A, 0) & 7 != 6:
            return
        if self.registers.get(0x07, 0) & 0x80:
            where, bit = (0x58, 0x80) if self.who_am_i == 0x69 else (0x19, 0x20)
            stamp = int(self._ticks) & 0xFFFFFF if self.registers.get(where, 0) & bit else 0
            # ST's order: bits 15:8, 23:16, then one byte unused, bits 7:0.
            words += [stamp >> 8 & 0xFFFF, (stamp & 0xFF) << 8, 0]
        for word in words:
            if len(self.fifo) == FIFO_WORDS:
                self.fifo.popleft()
                self.pattern = (self.pattern + 1) % len(words)
                self.overrun = True
            self.fifo.append(word)

    # --- the bus --------------------------------------------------------------------------

    def write(self, register, value):
        """Write one register; returns whether it was acknowledged."""
        if not self.answers:
            return False
        if self.stuck is not None:
            return True
        self.writes.append((register, value))
        if register == 0x12 and value & 1:
            self._reset()
            return True
        if register == 0x0A and value & 7 == 0:
            self.fifo.clear()
            self.pattern = 0
            self.overrun = False
        self.registers[register] = value
        return True

    def read(self, register, n):
        """Read n bytes from a register on; None when it is not acknowledged."""
        if not self.answers:
            return None
        if self.stuck is not None:
            return bytes([self.stuck]) * n
        if self.one_data_line and not self.registers.get(0x12, 0) & 0x08:
            return b"\xff" * n
        if register == 0x3E:
            return bytes(byte for _ in range(n // 2) for byte in self._pop())
        return bytes(self._value(register + i) for i in range(n))

    def _pop(self):
        if not self.fifo:
            return (0, 0)
        word = self.fifo.popleft()
        self.pattern = (self.pattern + 1) % 9
        self.overrun = False
        self._look_at_line(self.now_s)
        return (word & 0xFF, word >> 8)

    def _output(self, register):
        """One byte of the output registers: the last sample, and what the self-test adds."""
        axis, half = divmod(register - 0x22, 2)
        test = self.registers.get(0x14, 0)
        gyro, accel = self.counts(0)[:3], [0, 0, 8197]
        moved = self.forces[1] * bool(test & 0x04), self.forces[0] * bool(test & 0x01)
        value = gyro[axis] + moved[0] if axis < 3 else accel[axis - 3] + moved[1]
        return value >> 8 * half & 0xFF

    def _value(self, register):
        waiting = len(self.fifo)
        if register == 0x3B and self.status is not None:
            return self.status
        if 0x22 <= register < 0x2E:
            return self._output(register)
        special = {
            0x1E: (self.registers.get(0x10, 0) >> 4 > 0)
            | (self.registers.get(0x11, 0) >> 4 > 0) << 1,
            0x20: self.temperature & 0xFF,
            0x21: self.temperature >> 8 & 0xFF,
            0x3A: waiting & 0xFF,
            0x3B: (waiting >> 8 & 7) | self.overrun << 6 | (waiting == 0) << 4,
            0x3C: self.pattern,
            0x3D: 0,
        }
        return special.get(register, self.registers.get(register, 0))
