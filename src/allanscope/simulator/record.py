"""A recording of the simulated device without waiting for it: raw bytes with host times."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.random import Generator

from allanscope.errors import UsageError
from allanscope.samples import Block, StreamInfo
from allanscope.simulator.noise import stream
from allanscope.simulator.simulator import Simulator
from allanscope.wire import Encoder, WireFormat, WireSettings, answers, format_named

__all__ = ["simulate_blocks", "start_messages"]

READ_S = 0.05
"""A host reads what has come this often."""
LATENCY_S = 1e-3
JITTER_S = 0.5e-3
"""Bytes reach the program this long after they were sent: a fixed part, and an exponential one."""
EPOCH = 1


def simulate_blocks(
    hours: float,
    sensor: Simulator | None = None,
    wire: str = "native",
    *,
    start_ns: int = 0,
    seed: int = 0,
) -> Iterator[tuple[int, bytes]]:
    """Yield what a host reads from the device in so many hours, as fast as it can be made.

    Parameters
    ----------
    hours : float
        Length of the recording in true time.
    sensor : Simulator, optional
        What it measures with; give it ``duration_s=hours * 3600``.
    wire : str
        Name of the wire format.
    start_ns : int
        Host monotonic time at power-up.
    seed : int
        Of the host's delays.

    Yields
    ------
    host_ns : int
        Host monotonic time of a read, ascending. The host's clock is true.
    data : bytes
        What was read.

    Raises
    ------
    UsageError
        If the length is not positive.

    Examples
    --------
    >>> reads = list(simulate_blocks(2 / 3600, Simulator(rate=104.0)))
    >>> 30 < len(reads) <= 45, sum(len(data) for _, data in reads) > 4000
    (True, True)
    """
    if not hours > 0.0:
        raise UsageError(f"a recording of {hours:g} hours cannot be made")
    sensor = sensor or Simulator(duration_s=hours * 3600.0)
    encoder = format_named(wire).encoder()
    info = replace(sensor.info, epoch=EPOCH)
    rate = sensor.clock.true_hz
    frame = encoder.samples_per_frame(info.nominal_hz)
    a_second = frame * max(1, round(rate / frame))
    total = int(hours * 3600.0 * rate)
    reads = _Reads(start_ns, stream(seed, "host"))
    yield reads.time_ns(0.0), start_messages(format_named(wire), encoder, info)
    while sensor.index < total:
        block = sensor.read(min(a_second, total - sensor.index))
        yield from reads.of_block(encoder.encode(block), block, frame, rate)
        count = block.index + len(block)
        status = encoder.describe(info) + encoder.status(count, count, 0, count / rate)
        if status:
            yield reads.time_ns(count / rate), status


def start_messages(wire: WireFormat, device: Encoder, info: StreamInfo) -> bytes:
    """Return all that a device says before its first sample to a host that starts it."""
    host, received = wire.decoder(WireSettings()), device.describe(info)
    if not device.silent_until_started:
        return received
    orders = wire.start(WireSettings())
    while orders:
        commands = [command for order in orders for command in device.receive(order)]
        said = b"".join(map(device.reply, commands))
        host.feed(said, 0.0)
        received, orders = received + said, answers(host)
    return received


class _Reads:
    """Cuts what was sent into what a host reads at a time."""

    def __init__(self, start_ns: int, rng: Generator) -> None:
        self._start_ns = start_ns
        self._last_ns = 0
        self._rng = rng

    def time_ns(self, sent_s: float) -> int:
        """Return the host time at which what was sent at a true time is read; never goes back."""
        late_s = LATENCY_S + self._rng.exponential(JITTER_S)
        self._last_ns = max(self._last_ns, self._start_ns + round((sent_s + late_s) * 1e9))
        return self._last_ns

    def of_block(
        self, data: bytes, block: Block, frame: int, rate: float
    ) -> Iterator[tuple[int, bytes]]:
        """Yield the reads of one block; a frame is there when its last sample is."""
        n = len(block)
        times = np.arange(READ_S, n / rate, READ_S)
        whole = np.minimum((times * rate).astype(np.int64) // frame * frame, n)
        ends = [*(whole * len(data) // n).tolist(), len(data)]
        begin = 0
        for time_s, end in zip([*times.tolist(), n / rate], ends, strict=True):
            if end > begin:
                yield self.time_ns(block.index / rate + time_s), data[begin:end]
            begin = end
