"""A board, its cable and a clock that runs as fast as it is read: a night in minutes.

The board makes real frames of the native protocol. What goes wrong is drawn in advance, and its
ledger says, sample by sample, what cannot have arrived. Unlike the simulated device it makes a
tenth of a second of frames at a time, which is what makes a night of 288 million samples possible;
the faults are those of the simulated device.
"""

from __future__ import annotations

import errno
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from allanscope.samples import Block, Ticks
from allanscope.simulator import Ledger, Simulator
from allanscope.wire import format_named
from allanscope.wire.native import NativeEncoder

__all__ = ["KINDS", "Night"]

STEP_S = 0.1
RING_BYTES = 1 << 16
ON_BYTES = ("bit_flip", "byte_loss", "byte_repeat", "garbage")
OF_DEVICE = ("stall", "unplug", "reset")
KINDS = (*ON_BYTES, *OF_DEVICE)
LONGEST_S = {"stall": 6.0, "unplug": 5.0}
START_S = 1000.0
"""Host time at which the board is switched on."""


class Night:
    """The far end of a `SerialSource`: its opener, its clock, its link, and the truth.

    Parameters
    ----------
    rate_hz, seconds : float
        Nominal rate, and how long the night is.
    faults : int
        How many of each kind.
    seed : int
        Of noise and faults.
    over : callable
        Called when the night is over.

    Attributes
    ----------
    zero : dict
        For each epoch, the number that its first sample had since power-up.
    """

    def __init__(
        self, rate_hz: float, seconds: float, faults: int, seed: int, over: Callable[[], None]
    ) -> None:
        self.sensor = Simulator(rate=rate_hz, seed=seed, duration_s=seconds)
        self.ledger = Ledger()
        self.faults: Counter[str] = Counter()
        self.now_s = 0.0
        self.zero: dict[int, int] = {}
        self._rng = np.random.default_rng(seed)
        self._seconds = seconds
        self._over = over
        self._due = {
            kind: deque(np.sort(self._rng.uniform(5.0, seconds - 10.0, faults))) for kind in KINDS
        }
        self._encoder = format_named("native").encoder()
        self._frame = NativeEncoder().samples_per_frame(rate_hz)
        self._ring: deque[tuple[bytes, int, int]] = deque()
        self._ring_bytes = 0
        self._silent_until_s = self._away_until_s = 0.0
        self._broken = False
        self._epoch = 0
        self._next_report_s = 0.0
        self._hello = self._boot()

    # -- what a SerialSource needs --------------------------------------------------------------

    def open(self, name: str, baud: int) -> Night:
        """Open the port, if the cable is in."""
        if self.now_s < self._away_until_s:
            raise FileNotFoundError(errno.ENOENT, "not there")
        self._broken = False
        self._hello = self._encoder.describe(self._info)
        return self

    def clock(self) -> int:
        return int((START_S + self.now_s) * 1e9)

    def sleep(self, seconds: float) -> None:
        """Let the host wait: only a host without a board has nothing else that passes time."""
        if self._broken:
            self._pass(seconds)

    def read(self, timeout_s: float) -> bytes:
        del timeout_s
        data = self._pass(STEP_S)
        if self._broken:
            raise OSError(errno.EIO, "gone")
        hello, self._hello = self._hello, b""
        return hello + data

    def write(self, data: bytes) -> None: ...

    def close(self) -> None: ...

    # -- the board ------------------------------------------------------------------------------

    def _boot(self) -> bytes:
        self._epoch += 1
        self.zero[self._epoch] = self.sensor.index
        self._info = replace(self.sensor.info, epoch=self._epoch)
        return self._encoder.describe(self._info)

    def _pass(self, seconds: float) -> bytes:
        """Let time pass and return what comes over the cable meanwhile."""
        self.now_s += seconds
        if self.now_s >= self._seconds:
            self._over()
            return b""
        block = self._measured()
        for kind in OF_DEVICE:
            if self._happens(kind):
                return self._fail(kind, block)
        if self._broken:
            self._lose(block, "no host")
            return b""
        self._push(block)
        if self.now_s < self._silent_until_s:
            return b""
        out = b"".join(self._damaged(*piece) for piece in self._ring)
        self._ring.clear()
        self._ring_bytes = 0
        return out + self._report()

    def _measured(self) -> Block:
        count = max(int(self.now_s * self.sensor.clock.true_hz) - self.sensor.index, 1)
        block = self.sensor.read(count)
        self.ledger.produced += count
        return block

    def _push(self, block: Block) -> None:
        first, count = block.index - self.zero[self._epoch], len(block)
        if self._ring_bytes + 16 * count > RING_BYTES:
            self._lose(block, "ring full")
            return
        data = self._encoder.encode(Block(first, block.counts, Ticks(*_plain(block.ticks))))
        self._ring.append((data, first, count))
        self._ring_bytes += len(data)

    def _report(self) -> bytes:
        """Say once a second what follows."""
        if self.now_s < self._next_report_s:
            return b""
        self._next_report_s = self.now_s + 1.0
        produced = self.sensor.index - self.zero[self._epoch]
        return self._encoder.describe(self._info) + self._encoder.status(
            produced, produced, 0, self.now_s
        )

    def _lose(self, block: Block, cause: str) -> None:
        self.ledger.lose(self._epoch, block.index - self.zero[self._epoch], len(block), cause)

    # -- faults ---------------------------------------------------------------------------------

    def _happens(self, kind: str) -> bool:
        due = self._due[kind]
        if not due or due[0] > self.now_s or self._broken:
            return False
        due.popleft()
        self.faults[kind] += 1
        return True

    def _fail(self, kind: str, block: Block) -> bytes:
        """Begin a stall, pull the cable or restart; what was under way is lost."""
        if kind == "stall":
            self._push(block)
            self._silent_until_s = self.now_s + self._rng.uniform(0.2, LONGEST_S[kind])
            return b""
        for _, first, count in self._ring:
            self.ledger.lose(self._epoch, first, count, kind)
        self._ring.clear()
        self._ring_bytes = 0
        self._lose(block, kind)
        if kind == "unplug":
            self._broken = True
            self._away_until_s = self.now_s + self._rng.uniform(0.1, LONGEST_S[kind])
            return b""
        self._hello = self._boot()
        return b""

    def _damaged(self, data: bytes, first: int, count: int) -> bytes:
        for kind in ON_BYTES:
            if self._happens(kind):
                data = self._hit(kind, data, first, count)
        return data

    def _hit(self, kind: str, data: bytes, first: int, count: int) -> bytes:
        """Damage one frame that is still whole, between its first byte and its last."""
        frames = data.split(b"\0")
        sound = [k for k in range(count // self._frame) if k not in self._hit_frames(first)]
        k = int(self._rng.choice(sound))
        body = bytearray(frames[k])
        at = int(self._rng.integers(2, len(body) - 40))
        if kind == "bit_flip":
            flips = [1 << bit for bit in range(8) if body[at] != 1 << bit]
            body[at] ^= int(self._rng.choice(flips))
        elif kind == "byte_loss":
            del body[at : at + int(self._rng.integers(1, 30))]
        elif kind == "byte_repeat":
            body.insert(at, body[at])
        else:
            body[at:at] = self._rng.bytes(32)
        self.ledger.lose(self._epoch, first + k * self._frame, self._frame, kind)
        frames[k] = bytes(body)
        return b"\0".join(frames)

    def _hit_frames(self, first: int) -> set[int]:
        """Return which frames of the piece that begins at `first` are damaged already."""
        return {
            (loss.first + step - first) // self._frame
            for loss in self.ledger.losses[-4:]
            if loss.epoch == self._epoch and loss.first >= first
            for step in range(0, loss.count, self._frame)
        }


def _plain(ticks: Ticks) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    return ticks.offset, ticks.device_s, ticks.host_s, ticks.temperature_c
