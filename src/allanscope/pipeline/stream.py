"""`open_stream` for Python: the samples of a device as they come, in a loop of one's own."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from types import TracebackType
from typing import Self

from allanscope.errors import DeviceError
from allanscope.pipeline.decoding import Decoding
from allanscope.pipeline.settings import DeviceSettings, SimulatedSettings
from allanscope.samples import Block, Event, Gap, StreamInfo
from allanscope.sources import Source, SourceSettings, open_source
from allanscope.wire import LinkStats, format_named

__all__ = ["Stream", "device_source", "no_samples_error", "open_stream"]


class Stream(Iterator[Block | Gap]):
    """Blocks and Gaps of one source, in order; made by `open_stream`.

    Iteration ends when the source does, which a device does not: leave the loop, or `close` from
    another thread. A device that is unplugged comes back as a Gap.

    Parameters
    ----------
    source : Source
        Where bytes come from; closed with the stream.
    decoding : Decoding
        Turns them into events.
    patience_s : float
        How long to wait for the first sample.
    """

    def __init__(self, source: Source, decoding: Decoding, patience_s: float) -> None:
        self._source = source
        self._decoding = decoding
        self._patience_s = patience_s
        self._waiting: deque[Event] = deque()
        self._info: StreamInfo | None = None
        self._has_received = False
        self._ended = False

    @property
    def name(self) -> str:
        """The port, the file, or ``sim``."""
        return self._source.name

    @property
    def info(self) -> StreamInfo:
        """What the Blocks mean (axes, scales, rate): of the last one, or of the first to come.

        A device that is configured anew changes it between two Blocks.

        Raises
        ------
        DeviceError
            When nothing comes that holds samples.
        """
        while self._info is None:
            for event in self._waiting:
                if isinstance(event, StreamInfo):
                    return event
            if not self._more():
                raise no_samples_error(self._source)
        return self._info

    @property
    def stats(self) -> LinkStats:
        """Counters of the link: bytes, frames, CRC errors, resyncs, samples, losses."""
        return self._decoding.stats

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> Block | Gap:
        while True:
            while self._waiting:
                event = self._waiting.popleft()
                if isinstance(event, StreamInfo):
                    self._info = event
                if isinstance(event, Block | Gap):
                    return event
            if not self._more():
                raise StopIteration

    def close(self) -> None:
        """Send the stop command, where the format has one, and close the source."""
        if not self._ended:
            self._ended = True
            self._decoding.stop_device()
            self._source.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _more(self) -> bool:
        """Read until there are events; False at the end of the source."""
        began = time.monotonic()
        while not self._ended:
            chunk = self._source.read()
            if chunk.event == "end":
                self._waiting += self._decoding.finish()
                self.close()
                return bool(self._waiting)
            self._waiting += self._decoding.feed(chunk)
            if self._waiting:
                self._has_received = True
                return True
            if not self._has_received and time.monotonic() - began > self._patience_s:
                raise no_samples_error(self._source)
        return False


def open_stream(
    port: str = "auto",
    *,
    part: str = "",
    rate: float | None = None,
    gyro_fs: float | None = None,
    accel_fs: float | None = None,
    wire: str = "",
    patience_s: float = 10.0,
) -> Stream:
    """Open a device and yield its samples as they come.

    Parameters
    ----------
    port : str
        A device path, a pyserial URL, ``auto`` (the board that is plugged in) or ``sim``; also a
        recording or a capture.
    part : str
        LSM6DS3H, LSM6DSL or LSM6DSM, where the stream does not say.
    rate, gyro_fs, accel_fs : float, optional
        Nominal rate in Hz, full scales in dps and g: where the stream does not say, and of the
        simulated device.
    wire : str
        Wire format; detected if not given.
    patience_s : float
        How long to wait for the first sample.

    Returns
    -------
    Stream
        An iterator over `Block` and `Gap`, and a context manager.

    Raises
    ------
    DeviceError
        When the port cannot be opened; from the loop, when nothing comes or the device is lost.
    InputError
        From the loop, when what comes is in no known format.
    UsageError
        For a part, a full scale or a wire format that does not exist.

    Examples
    --------
    >>> with open_stream("sim", rate=208.0) as stream:
    ...     first = next(stream)
    ...     print(stream.info.axes, stream.info.nominal_hz, first.counts.dtype)
    ('gx', 'gy', 'gz', 'ax', 'ay', 'az') 208.0 int16
    """
    device = DeviceSettings(part=part, rate_hz=rate, gyro_fs=gyro_fs, accel_fs=accel_fs, wire=wire)
    source = device_source(port, device, SimulatedSettings())

    def write(data: bytes) -> None:
        with suppress(DeviceError):
            source.write(data)

    return Stream(source, Decoding(device.for_wire(), wire, write), patience_s)


def no_samples_error(source: Source) -> DeviceError:
    """Return what to say of a source that was open and never gave a sample."""
    return DeviceError(f"{source.name}: no samples received; check that the device is streaming")


def device_source(port: str, device: DeviceSettings, simulated: SimulatedSettings) -> Source:
    """Open a port by its name; ``sim`` plugs in the device that the user described.

    Raises
    ------
    DeviceError
        When the port cannot be opened.
    """
    if port != "sim":
        usual = format_named(device.wire or "native").baud
        return open_source(port, SourceSettings(baud=device.baud or usual))
    from allanscope.pipeline.simulate import simulator
    from allanscope.sources import SimulatedSource

    return SimulatedSource(
        device.simulated_wire,
        sensor=simulator(device, simulated),
        faults=simulated.faults,
        seed=simulated.seed,
    )
