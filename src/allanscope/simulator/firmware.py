"""The program on the board, without board or port: commands in, time in, bytes out.

It is sans-IO: whoever owns the port and the clock calls `receive`, `advance`, `pending` and
`written`. So everything about it can be tested at any speed, to the sample.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

from allanscope.errors import UsageError
from allanscope.parts import part_named
from allanscope.samples import Block, Ticks
from allanscope.simulator.faults import FaultSpec, LineNoise, Occurrences
from allanscope.simulator.noise import stream
from allanscope.simulator.simulator import Simulator
from allanscope.simulator.transmitter import Ledger, Message, Ring, Transmitter
from allanscope.wire import Command, format_named

__all__ = ["Firmware", "reconfigure"]

STATUS_EVERY_S = 1.0
RING_BYTES = 65536
SETTINGS = {"rate_hz": "rate", "gyro_fs": "gyro_fs", "accel_fs": "accel_fs", "axes": "axes"}
"""What a host may set: names of a command, and those of `Simulator`."""
NEAREST = 0.05
"""A rate is taken for the nearest that the part has when it is within this share of it."""


@dataclass(slots=True)
class _Counts:
    """Samples of this epoch, as a status tells them."""

    produced: int = 0
    sent: int = 0
    dropped: int = 0


class Firmware:
    """A board that measures, frames, obeys and, when told to, fails.

    It streams from power-up, or when told to start, as its wire format has it. Without a host it
    measures on and drops what the host does not read.

    Parameters
    ----------
    sensor : Simulator
        What it measures with.
    wire : str
        Name of the wire format.
    faults : iterable of FaultSpec
        What goes wrong.
    ring_bytes : int
        Size of the transmit ring: what does not fit is dropped and counted.
    seed : int
        Of the faults and of the first epoch.

    Attributes
    ----------
    sensor : Simulator
        What it measures with now; another one after a change of settings.
    ledger : Ledger
        What became of every sample.
    now_s : float
        Device time: seconds since power-up.
    epoch : int
        Of the samples made now.
    plugged : bool
        False while an ``unplug`` lasts; the owner of the port pulls the cable meanwhile.
    """

    def __init__(
        self,
        sensor: Simulator,
        wire: str = "native",
        faults: Iterable[FaultSpec] = (),
        *,
        ring_bytes: int = RING_BYTES,
        seed: int = 0,
    ) -> None:
        faults = tuple(faults)
        rng = stream(seed, "faults")
        self.sensor = sensor
        self.ledger = Ledger()
        self.now_s = 0.0
        self.epoch = int(stream(seed, "epoch").integers(1 << 16))
        self.plugged = True
        self._encoder = format_named(wire).encoder()
        self._info = sensor.info
        self._ring = Ring(ring_bytes)
        self._transmitter = Transmitter(self._ring, LineNoise(faults, rng), self.ledger)
        self._happenings = [
            (fault, Occurrences(fault.rate, rng, fault.at))
            for fault in faults
            if not fault.on_bytes
        ]
        self._host = False
        self._silent_until_s = 0.0
        self._back_at_s = math.inf
        self._boot()

    # -- the host's side ------------------------------------------------------------------------

    def host_connected(self) -> None:
        """Take note that somebody opened the port."""
        self._host = True
        if self._streaming:
            self._push(self._encoder.describe(self._info))

    def host_disconnected(self, unread: int) -> None:
        """Take note that the port was closed, with `unread` bytes still in it."""
        self._host = False
        self._transmitter.cut(unread, "hang-up", "no host")

    def receive(self, data: bytes) -> None:
        """Execute the commands of the host. A reply precedes everything that the command causes."""
        for command in self._encoder.receive(data):
            self.ledger.commands += 1
            self._execute(command)

    def pending(self) -> bytes:
        """Return what is to be written to the port now; empty while there is nothing to say."""
        if not self._host or self.now_s < self._silent_until_s:
            return b""
        return self._transmitter.next_bytes(self.now_s)

    def written(self, n: int) -> None:
        """Take note that the port took the first `n` bytes of `pending`."""
        self._transmitter.written(n)

    # -- time -----------------------------------------------------------------------------------

    @property
    def next_s(self) -> float:
        """Device time at which something is next to be done; infinity when all is quiet."""
        return min(self._next_frame_s, self._back_at_s)

    @property
    def would_drop(self) -> bool:
        """Whether the next frame would be dropped, which waiting for the host could prevent."""
        silent = self.now_s < self._silent_until_s
        return self.plugged and not silent and not (self._host and self._ring.has_room())

    def advance(self, until_s: float) -> None:
        """Let device time pass, up to `until_s` or until a cable is pulled or put back."""
        plugged = self.plugged
        while self.plugged == plugged:
            next_s = min(
                self._next_status_s,
                self._back_at_s,
                *(occurrences.next for _, occurrences in self._happenings),
                math.inf,
            )
            self._measure(min(next_s, until_s))
            self.now_s = max(self.now_s, min(next_s, until_s))
            if next_s > until_s:
                return
            self._run_due()

    @property
    def _next_frame_s(self) -> float:
        if not self._streaming:
            return math.inf
        return self._origin_s + (self.sensor.index + self._frame) / self.sensor.clock.true_hz

    def _measure(self, until_s: float) -> None:
        while (ready_s := self._next_frame_s) <= until_s:
            self.now_s = max(self.now_s, ready_s)
            self._frame_out(self.sensor.read(self._frame))

    def _run_due(self) -> None:
        """Do what is due now, apart from samples."""
        if self._next_status_s <= self.now_s:
            self._next_status_s += STATUS_EVERY_S
            self._report()
        if self._back_at_s <= self.now_s:
            self._back_at_s, self.plugged = math.inf, True
        for fault, occurrences in self._happenings:
            if occurrences.until(self.now_s):
                self.ledger.faults[fault.kind] += 1
                self._fail(fault)

    def _fail(self, fault: FaultSpec) -> None:
        match fault.kind:
            case "stall":
                self._silent_until_s = self.now_s + fault.seconds
            case "unplug":
                self._back_at_s, self.plugged = self.now_s + fault.seconds, False
            case "reset":
                self._transmitter.cut(0, "reset", "reset")
                self._boot()

    # -- samples --------------------------------------------------------------------------------

    def _boot(self) -> None:
        self._boot_s = self.now_s
        self._next_status_s = self.now_s + STATUS_EVERY_S
        self._streaming = False
        if not self._encoder.silent_until_started:
            self._start()

    def _start(self) -> None:
        """Begin a new epoch with the sensor as it is."""
        self.epoch = (self.epoch + 1) & 0xFFFF
        self._info = replace(self.sensor.info, epoch=self.epoch)
        rate = self.sensor.info.nominal_hz
        # What is sent at a time is one frame, so that a fault on the line destroys exactly the
        # samples that the ledger names.
        self._frame = self._encoder.samples_per_frame(rate)
        self._origin_s = self.now_s - self.sensor.time_s
        self._zero = self.sensor.index
        self._counts = _Counts()
        self._streaming = True
        self._push(self._encoder.describe(self._info))

    def _frame_out(self, block: Block) -> None:
        """Frame a few samples, or drop them when they would not fit."""
        first, count = block.index - self._zero, len(block)
        self.ledger.produced += count
        self._counts.produced += count
        if not self._host or not self._ring.has_room():
            self._counts.dropped += count
            self.ledger.lose(self.epoch, first, count, "ring full" if self._host else "no host")
            return
        ticks = block.ticks
        since_boot = ticks.device_s + (self._origin_s - self._boot_s)
        ticks = Ticks(ticks.offset, since_boot, ticks.host_s, ticks.temperature_c)
        data = self._encoder.encode(Block(first, block.counts, ticks))
        self._counts.sent += count
        self._ring.push(Message(data, self.epoch, first, count))

    def _report(self) -> None:
        """Say once a second what follows and how it goes."""
        if self._streaming and self._ring.has_room():
            counts = self._counts
            self._push(self._encoder.describe(self._info))
            self._push(
                self._encoder.status(
                    counts.produced, counts.sent, counts.dropped, self.now_s - self._boot_s
                )
            )

    def _push(self, data: bytes) -> None:
        if data and self._host:
            self._ring.push(Message(data))

    # -- commands -------------------------------------------------------------------------------

    def _execute(self, command: Command) -> None:
        sensor = reconfigure(self.sensor, command)
        ok = command.name != "unknown" and sensor is not None
        if self._ring.has_reserve():
            command.fields["uptime_s"] = self.now_s - self._boot_s
            self._push(self._encoder.reply(command, ok))
        if not ok or sensor is None:
            return
        if command.name == "stop":
            self._streaming = False
        elif command.name == "describe" and self._ring.has_reserve():
            self._push(self._encoder.describe(self._info))
        changed = sensor is not self.sensor
        self.sensor = sensor
        if changed if self._streaming else command.name == "start":
            self._start()


def reconfigure(sensor: Simulator, command: Command) -> Simulator | None:
    """Return the sensor as a command wants it: `set`, and in some formats `start`.

    Returns
    -------
    Simulator or None
        The same object when nothing changes; None when the part cannot do it.

    Examples
    --------
    >>> sensor = Simulator(rate=104.0)
    >>> reconfigure(sensor, Command("set", fields={"rate_hz": 210.0})).info.nominal_hz
    208.0
    >>> reconfigure(sensor, Command("set", fields={"rate_hz": 150.0})) is None
    True
    >>> reconfigure(sensor, Command("set", fields={"rate_hz": 104.0})) is sensor
    True
    """
    wanted = {SETTINGS[name]: value for name, value in command.fields.items() if name in SETTINGS}
    if not wanted:
        return sensor
    if "rate" in wanted:
        rates = (sensor.info.nominal_hz, *part_named(sensor.info.part).rates_hz)
        nearest = min(rates, key=lambda rate: abs(rate - wanted["rate"]))
        if not abs(nearest - wanted["rate"]) <= NEAREST * nearest:
            return None
        wanted["rate"] = nearest
    try:
        changed = sensor.reconfigured(**wanted)
    except UsageError:
        return None
    same = changed.info == sensor.info
    return sensor if same else changed
