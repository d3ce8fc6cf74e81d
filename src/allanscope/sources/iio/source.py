"""A sensor of Linux IIO as a source: scans of its buffers as frames of the native protocol."""

from __future__ import annotations

import errno
import math
import os
import select
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from allanscope.errors import DeviceError, UsageError
from allanscope.parts import PARTS
from allanscope.samples import AXES, Block, StreamInfo, Ticks
from allanscope.sources.base import Chunk, LinkEvent, SourceSettings
from allanscope.sources.iio.devices import IioDevice, IioSensor, iio_sensor
from allanscope.sources.iio.scans import Numbering, ScanLayout, pair, period_of
from allanscope.wire import Command, format_named

__all__ = ["IioSource"]

WAIT_MS = 100
READ_BYTES = 1 << 16
RETRY_S = 1.0
STATUS_EVERY_S = 1.0
LONGEST_UNPAIRED_S = 2.0
"""A scan whose partner of the other device has not come by then has none."""
_SETTINGS = {"rate_hz": "", "gyro_fs": "gx", "accel_fs": "ax"}
"""What a host may set, and an axis of the sensor that it is about."""


@dataclass(slots=True)
class _Buffer:
    """The buffer of one device, and what came of it so far."""

    device: IioDevice
    layout: ScanLayout
    fd: int
    rest: bytes = b""
    times: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    counts: NDArray[np.int64] = field(default_factory=lambda: np.empty((0, 3), np.int64))

    def read(self) -> int:
        """Take what waits; return its bytes."""
        try:
            data = os.read(self.fd, READ_BYTES)
        except BlockingIOError:
            return 0
        scan = self.layout.dtype
        whole = self.rest + data
        count = len(whole) // scan.itemsize
        self.rest = whole[count * scan.itemsize :]
        scans = np.frombuffer(whole, scan, count)
        self.times = np.concatenate([self.times, self.layout.times_ns(scans)])
        counts = self.layout.counts(scans)
        self.counts = np.concatenate([self.counts.reshape(-1, counts.shape[1]), counts])
        return len(data)

    def drop(self, count: int) -> None:
        """Forget the first scans."""
        self.times, self.counts = self.times[count:], self.counts[count:]


class IioSource:
    """Reads the buffers of one part, at the settings that the host's commands ask for.

    Gyroscope and accelerometer are two devices with st_lsm6dsx: their scans are paired by time, and
    one without its partner counts as lost, like all that the times say is missing. A driver that is
    unbound counts as disconnected, and is looked for until it is back.

    Parameters
    ----------
    spec : str
        ``iio``, ``iio:lsm6dsm``, ``iio:device0``.
    settings : SourceSettings, optional
    clock : callable, optional
        The host's monotonic time in ns.

    Raises
    ------
    DeviceError
        If there is no such sensor, or it cannot be switched on.
    """

    reader = ""

    def __init__(
        self,
        spec: str,
        settings: SourceSettings | None = None,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._spec = spec
        self._settings = settings or SourceSettings()
        self._clock = clock
        self._encoder = format_named("native").encoder()
        self._requests: deque[bytes] = deque()
        self._closing = threading.Event()
        self._reading = threading.Lock()
        self._buffers: list[_Buffer] = []
        self._out = bytearray()
        self._epoch = clock() // 1_000_000 & 0xFFFF
        self._sensor: IioSensor = iio_sensor(spec)
        self._streaming = True
        self._stalled = False
        self._lost_ns: int | None = None
        self._retry_ns = 0
        self._start()

    @property
    def name(self) -> str:
        """``iio:`` and the part as the driver calls it."""
        return f"iio:{self._sensor.name}"

    @property
    def identity(self) -> dict[str, str]:
        """The devices, by their nodes and names."""
        devices = self._sensor.devices
        return {
            "path": " ".join(str(one.node) for one in devices),
            "product": " ".join(one.name for one in devices),
        }

    def read(self) -> Chunk:
        """Return the frames of what has come, or an empty chunk after a tenth of a second.

        Raises
        ------
        DeviceError
            When the driver has been disconnected for longer than the settings allow.
        """
        with self._reading:
            if self._closing.is_set():
                return Chunk(self._clock(), event="end")
            if self._lost_ns is not None:
                return self._find_driver()
            while self._requests:
                for command in self._encoder.receive(self._requests.popleft()):
                    self._execute(command)
            try:
                came = self._read_scans()
            except OSError:
                return self._disconnect()
            now = self._clock()
            if came:
                self._last_data_ns = now
                self._frame()
            event: LinkEvent = "resumed" if came and self._stalled else ""
            if came:
                self._stalled = False
            elif self._streaming and not self._stalled and self._is_silent(now):
                self._stalled, event = True, "stalled"
            self._send_status(now)
            data, self._out = bytes(self._out), bytearray()
            return Chunk(now, data, event)

    def write(self, data: bytes) -> None:
        """Send commands of the native protocol; they are obeyed by the next read."""
        self._requests.append(data)

    def close(self) -> None:
        """Switch the buffers off."""
        self._closing.set()
        with self._reading:
            self._stop()

    # --- the buffers --------------------------------------------------------------------------

    def _start(self) -> None:
        """Switch the buffers on; what follows is a new epoch."""
        self._epoch = (self._epoch + 1) & 0xFFFF
        part = self._sensor.part
        scales: dict[str, float] = {}
        try:
            for device in self._sensor.devices:
                layout = device.start(device.axes)
                scales |= {axis: device.scale(axis, part) for axis in layout.axes}
                try:
                    fd = os.open(device.node, os.O_RDONLY | os.O_NONBLOCK)
                except OSError as error:
                    reason = "no permission" if error.errno in (errno.EACCES, errno.EPERM) else ""
                    reason = reason or error.strerror or str(error)
                    raise DeviceError(f"cannot open {device.node}: {reason}") from None
                self._buffers.append(_Buffer(device, layout, fd))
        except DeviceError:
            self._stop()
            raise
        axes = tuple(axis for axis in AXES if axis in scales)
        columns = [axis for buffer in self._buffers for axis in buffer.layout.axes]
        self._order = [columns.index(axis) for axis in axes]
        rate = self._sensor.devices[0].rate_hz
        self._info = StreamInfo(
            axes,
            tuple(scales[axis] for axis in axes),
            nominal_hz=rate,
            part=part,
            epoch=self._epoch,
            origin="measured",
            details={"firmware": "Linux IIO", "board": self._sensor.name},
        )
        self._numbering = Numbering(1e9 / rate if rate else 0.0)
        self._first_ns: int | None = None
        self._produced = self._sent = 0
        self._last_data_ns = self._began_ns = self._clock()
        self._next_ns = self._began_ns + int(STATUS_EVERY_S * 1e9)
        self._out += self._encoder.describe(self._info)

    def _stop(self) -> None:
        for buffer in self._buffers:
            os.close(buffer.fd)
        for device in self._sensor.devices:
            with suppress(DeviceError):  # it may be gone
                device.stop()
        self._buffers = []

    def _read_scans(self) -> int:
        """Wait for scans and take them; return the bytes."""
        if not self._buffers:
            self._closing.wait(WAIT_MS * 1e-3)
            return 0
        poll = select.poll()
        for buffer in self._buffers:
            poll.register(buffer.fd, select.POLLIN)
        found = poll.poll(WAIT_MS)
        if any(what & (select.POLLERR | select.POLLNVAL) for _, what in found):
            raise OSError(errno.ENODEV, "the driver was removed")
        ready = {fd for fd, what in found if what & select.POLLIN}
        if not ready and not all(one.device.node.exists() for one in self._buffers):
            raise OSError(errno.ENODEV, "the driver was removed")
        came = sum(buffer.read() for buffer in self._buffers if buffer.fd in ready)
        if found and not ready:  # the other side is closed, and says so without end
            self._closing.wait(WAIT_MS * 1e-3)
        return came

    def _is_silent(self, now: int) -> bool:
        return now - self._last_data_ns > self._settings.stall_s * 1e9

    # --- scans to frames ----------------------------------------------------------------------

    def _frame(self) -> None:
        """Frame the samples that are complete."""
        times, counts = self._samples()
        if not len(times):
            return
        try:
            runs = self._numbering.runs(times)
        except ValueError:  # the clock was set: a new epoch, as after a restart
            self._stop()
            self._start()
            return
        if self._first_ns is None:
            self._first_ns = int(times[0])
        seconds = (times - self._first_ns).astype(np.float64) * 1e-9
        for index, run in runs:
            rows = np.arange(run.stop - run.start)
            unknown = np.full(len(rows), math.nan)
            block = Block(index, counts[run], Ticks(rows, seconds[run], unknown, unknown))
            self._out += self._encoder.encode(block)
            self._produced = index + len(rows)
            self._sent += len(rows)

    def _samples(self) -> tuple[NDArray[np.int64], NDArray[Any]]:
        """Return times and counts, in the order of the axes, of what both devices have."""
        first = self._buffers[0]
        if len(self._buffers) == 1:
            times, counts = first.times, first.counts
            first.drop(len(times))
            return times, counts[:, self._order]
        second = self._buffers[1]
        rate = self._info.nominal_hz
        period = period_of(first.times, 1e9 / rate if rate else 0.0)
        mine, others = pair(first.times, second.times, period)
        times = first.times[mine]
        counts = np.column_stack([first.counts[mine], second.counts[others]])
        used, used_second = (int(one[-1]) + 1 if len(one) else 0 for one in (mine, others))
        # Whatever is older than the last pair has no partner; nor what has waited for too long.
        first.drop(max(used, self._too_old(first.times)))
        second.drop(max(used_second, self._too_old(second.times)))
        return times, counts[:, self._order]

    def _too_old(self, times: NDArray[np.int64]) -> int:
        if not len(times):
            return 0
        return int(np.searchsorted(times, times[-1] - int(LONGEST_UNPAIRED_S * 1e9)))

    def _send_status(self, now: int) -> None:
        """Say once a second what follows and how it goes."""
        if now < self._next_ns or not self._streaming:
            return
        self._next_ns = now + int(STATUS_EVERY_S * 1e9)
        lost = self._produced - self._sent
        uptime_s = (now - self._began_ns) * 1e-9
        self._out += self._encoder.describe(self._info)
        self._out += self._encoder.status(self._produced, self._sent, lost, uptime_s)

    # --- commands -----------------------------------------------------------------------------

    def _execute(self, command: Command) -> None:
        ok = command.name != "unknown"
        changes = {name: value for name, value in command.fields.items() if name in _SETTINGS}
        if command.name == "set" and changes:
            ok = self._set(changes)
        command.fields["uptime_s"] = (self._clock() - self._began_ns) * 1e-9
        self._out += self._encoder.reply(command, ok)
        if command.name == "describe":
            self._out += self._encoder.describe(self._info)
        elif command.name == "stop":
            self._streaming = False
            self._stop()
        elif command.name == "start" and not self._streaming:
            self._streaming = True
            self._start()

    def _set(self, changes: dict[str, float]) -> bool:
        """Set rate and full scales; whether the driver has them."""
        self._stop()  # a driver takes no settings while it measures
        ok = all(
            self._set_one(device, name, value)
            for device in self._sensor.devices
            for name, value in changes.items()
        )
        if self._streaming:
            self._start()
        return ok

    def _set_one(self, device: IioDevice, name: str, value: float) -> bool:
        if name == "rate_hz":
            return device.set_rate(value)
        first = _SETTINGS[name]
        if first not in device.axes:
            return True
        part = PARTS.get(self._sensor.part, PARTS["LSM6DSM"])
        try:
            scale = part.gyro_scale(value) if first == "gx" else part.accel_scale(value)
        except UsageError:
            return False
        return device.set_scale(first, scale, self._sensor.part)

    # --- while the driver is gone -------------------------------------------------------------

    def _disconnect(self) -> Chunk:
        self._stop()
        self._lost_ns = self._clock()
        self._retry_ns = self._lost_ns + int(RETRY_S * 1e9)
        self._stalled = False
        return Chunk(self._lost_ns, event="disconnected")

    def _find_driver(self) -> Chunk:
        """Look for the driver once a second."""
        now = self._clock()
        if now < self._retry_ns:
            self._closing.wait(WAIT_MS * 1e-3)
            return Chunk(self._clock())
        self._retry_ns = now + int(RETRY_S * 1e9)
        lost_ns = self._lost_ns or now
        try:
            self._sensor = iio_sensor(self._spec)
            self._start()
        except DeviceError as error:
            if now - lost_ns > self._settings.give_up_s * 1e9:
                gone_s = self._settings.give_up_s
                raise DeviceError(
                    f"{self.name} has been disconnected for {gone_s:g} s: {error}"
                ) from error
            return Chunk(now)
        self._lost_ns = None
        return Chunk(now, event="reconnected")
