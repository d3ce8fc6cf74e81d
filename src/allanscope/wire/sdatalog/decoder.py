"""Packets of the SDATALOG link to events.

Samples of one sensor are cut out of its packets, and samples of both sensors are paired from those
of each (`SensorPairing`).
"""

from __future__ import annotations

import math
import struct
from collections import deque
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from allanscope.parts import PARTS
from allanscope.samples import AXES, Event, GapReason, Notice, StreamInfo
from allanscope.sanitize import text_of
from allanscope.wire.base import LinkStats, WireSettings
from allanscope.wire.row_events import RowEvents
from allanscope.wire.rows import ABSENT, Interpretation, Row, Triple, Values
from allanscope.wire.sdatalog.conversation import Conversation, Sensor, Status
from allanscope.wire.sdatalog.packets import BINARY, CUSTOM, Packet, Unpacker

__all__ = ["HSDatalogFrames", "SDatalogDecoder", "SensorPairing", "sample_of_packet"]

_SINGLE = struct.Struct("<d3h")
_COUNTER = 4
_WRAP = 1 << 32
_STAMP = 8
_ROW = 6
_LATEST_S = 1e9
_HALF = 0.5
"""Two halves of a sample are less than so many periods apart."""

_MOST_WAITING = 20_000

Half = tuple[float, Triple]
"""Time in s, and what one sensor measured then."""


def sample_of_packet(content: bytes) -> list[Half] | None:
    """Return the sample of a packet with one: a time and three counts; None for anything else."""
    if len(content) != _SINGLE.size:
        return None
    time_s, x, y, z = _SINGLE.unpack(content)
    return [(time_s, (x, y, z))] if 0.0 <= time_s < _LATEST_S else None


class HSDatalogFrames:
    """The samples of one sensor in binary data of HSDatalog.

    A packet is a counter of bytes, up to its end, and a piece of a stream of frames: `rows` samples
    and the time of the last one. Where the counter jumps, frames are missing, and it tells where
    the next one begins.

    Parameters
    ----------
    rows : int
        Samples of a frame.
    period_s : float
        Nominal, for the times of the samples of a first frame.
    """

    def __init__(self, rows: int, period_s: float) -> None:
        self._rows = rows
        self._size = rows * _ROW + _STAMP
        self._period_s = period_s
        self._held = bytearray()
        self._position = -1
        self._skip = 0
        self._last_s = math.nan

    def feed(self, content: bytes) -> list[Half]:
        """Return the samples that a packet completes."""
        counter, data = int.from_bytes(content[:_COUNTER], "little"), content[_COUNTER:]
        if not data:
            return []
        before = max(self._position, 0)
        end = before + (counter - before) % _WRAP
        begin = end - len(data)
        if begin != self._position:
            self._held.clear()
            self._skip = -begin % self._size
            self._last_s = math.nan
        self._position = end
        self._held += data[self._skip :]
        self._skip = max(self._skip - len(data), 0)
        found: list[Half] = []
        while len(self._held) >= self._size:
            found += self._frame(bytes(self._held[: self._size]))
            del self._held[: self._size]
        return found

    def _frame(self, frame: bytes) -> list[Half]:
        (last_s,) = struct.unpack_from("<d", frame, self._rows * _ROW)
        if not 0.0 <= last_s < _LATEST_S:
            self._last_s = math.nan
            return []
        step = (last_s - self._last_s) / self._rows
        if not 0.0 < step < 2 * self._period_s:
            step = self._period_s
        self._last_s = last_s
        counts = np.frombuffer(frame[:-_STAMP], "<i2").reshape(-1, 3).tolist()
        ago = range(self._rows - 1, -1, -1)
        return [(last_s - step * i, (x, y, z)) for i, (x, y, z) in zip(ago, counts, strict=True)]


class SensorPairing:
    """Samples of a gyroscope and of an accelerometer to rows of six values.

    Those of one time belong together. One without its partner is dropped: the time of the next row
    shows that it is missing.

    Parameters
    ----------
    kinds : tuple of str
        Of the sensors that are on: ``gyro``, ``acc``.
    period_s : float
        Nominal.
    """

    def __init__(self, kinds: tuple[str, ...], period_s: float) -> None:
        self._waiting: dict[str, deque[Half]] = {
            kind: deque(maxlen=_MOST_WAITING) for kind in kinds
        }
        self._apart_s = _HALF * period_s

    def feed(self, kind: str, halves: list[Half]) -> list[tuple[tuple[float, ...], float]]:
        """Return the rows that these samples complete, with their times."""
        if len(self._waiting) == 1:
            if kind == "gyro":
                return [((*triple, *ABSENT), time_s) for time_s, triple in halves]
            return [((*ABSENT, *triple), time_s) for time_s, triple in halves]
        waiting = self._waiting[kind]
        for half in halves:
            if waiting and half[0] < waiting[-1][0]:  # the board was restarted
                for each in self._waiting.values():
                    each.clear()
            waiting.append(half)
        gyro, accel = self._waiting["gyro"], self._waiting["acc"]
        rows: list[tuple[tuple[float, ...], float]] = []
        while gyro and accel:
            later = gyro[0][0] - accel[0][0]
            if abs(later) <= self._apart_s:
                (one_s, rates), (other_s, forces) = gyro.popleft(), accel.popleft()
                rows.append(((*rates, *forces), min(one_s, other_s)))
            else:
                (accel if later > 0.0 else gyro).popleft()
        return rows


_RESOLUTION_S = 1e-6


class SDatalogDecoder:
    """Bytes of a board with SDATALOG firmware to events, and to what it must be answered.

    A packet of a sensor is one sample with its time, in seconds since the start by the crystal of
    the board, or a piece of HSDatalog's binary data. Losses are counted from these times: packets
    have no number, and a board that is busy sending leaves a sample out without a word.

    Parameters
    ----------
    settings : WireSettings
        What the user said about the device.
    """

    def __init__(self, settings: WireSettings) -> None:
        self.stats = LinkStats()
        self._settings = settings
        self._unpacker = Unpacker()
        self._conversation = Conversation(settings)
        self._rows = RowEvents(self.stats, self._decide)
        self._status: Status | None = None
        self._sensors: dict[int, Sensor] = {}
        self._frames: dict[int, HSDatalogFrames] = {}
        self._halves = SensorPairing((), math.inf)
        self._epoch = 0
        self._asked = False

    def feed(self, data: bytes, host_s: float) -> list[Event]:
        """Take bytes that arrived at host time `host_s` and return what they complete."""
        self.stats.bytes += len(data)
        events: list[Event] = []
        for packet in self._unpacker.feed(data):
            if packet is None:
                self.stats.resyncs += 1
                self._rows.note_damage()
            elif packet.kind in (BINARY, CUSTOM):
                events += self._data(packet, host_s)
            else:
                self.stats.frames += 1
                events += self._rows.events()
                events += self._other(packet)
        return events + self._rows.events()

    def answers(self) -> list[bytes]:
        """Return the commands to send now, each in a single write."""
        return self._conversation.answers()

    def interrupt(self, reason: str) -> list[Event]:
        """Forget a partial packet, e.g. after an unplug; the next Block follows a Gap."""
        self._unpacker.reset()
        self._conversation.reset()
        self._asked = False
        self._begin()
        self._rows.interrupt(cast("GapReason", reason))
        return []

    def finish(self) -> list[Event]:
        """Return what the end of the stream completes: rows that were held back."""
        return self._rows.events(final=True)

    def _data(self, packet: Packet, host_s: float) -> list[Event]:
        if self._status is None:
            return self._request_configuration()
        sensor = self._sensors.get(packet.channel)
        if sensor is None:
            self.stats.unknown += 1
            return []
        if packet.kind == CUSTOM:
            halves = sample_of_packet(packet.content)
        else:
            frames = self._frames.get(packet.channel)
            halves = frames.feed(packet.content) if frames else None
        if halves is None:
            self.stats.unknown += 1
            self._rows.note_damage()
            return []
        self.stats.frames += 1
        for values, time_s in self._halves.feed(sensor.kind, halves):
            self._rows.add(values, time_s, host_s)
        return []

    def _request_configuration(self) -> list[Event]:
        """Ask a board that streams already what it sends; until it says so nothing has a scale."""
        self.stats.unknown += 1
        if self._asked:
            return []
        self._asked = True
        self._conversation.ask_for_status()
        wanted: dict[str, int | float | str] = {"host": 1, "wanted": "descriptor"}
        return [Notice("text", "samples before the description of the board", wanted)]

    def _other(self, packet: Packet) -> list[Event]:
        whole = self._conversation.feed(packet)
        if whole is None:
            return []
        events: list[Event] = []
        status = self._conversation.status
        if status is not None and status != self._status:
            changed = _scales_and_rate(status) != _scales_and_rate(self._status)
            self._status = status
            if changed:
                events += self._rows.change()
                self._learn(status)
        return [*events, Notice("reply", text_of(whole.rstrip(b"\0")) or "done")]

    def _learn(self, status: Status) -> None:
        """Take note of what the samples that follow mean."""
        self._sensors = {one.channel: one for one in status.sensors if one.enabled}
        self._begin()

    def _begin(self) -> None:
        """Forget what was waiting for the rest of a sample."""
        sensors = self._sensors.values()
        rate_hz = max((one.rate_hz for one in sensors), default=0.0)
        period_s = 1.0 / rate_hz if rate_hz else math.inf
        self._halves = SensorPairing(tuple(one.kind for one in sensors), period_s)
        self._frames = {
            one.channel: HSDatalogFrames(one.rows, period_s) for one in sensors if one.rows
        }

    def _decide(self, rows: list[Row]) -> Interpretation | None:
        sensors = {one.kind: one for one in self._sensors.values()}
        if not sensors or self._status is None:
            return None
        of_axis = {axis: sensors.get("gyro" if axis[0] == "g" else "acc") for axis in AXES}
        measured = {axis: sensor for axis, sensor in of_axis.items() if sensor is not None}
        columns = [i for i, axis in enumerate(AXES) if axis in measured]
        first = next(iter(measured.values()))
        self._epoch += 1
        info = StreamInfo(
            axes=tuple(measured),
            scale=tuple(sensor.scale for sensor in measured.values()),
            nominal_hz=self._settings.rate_hz or first.rate_hz,
            part=first.part if first.part in PARTS else "",
            wire="sdatalog",
            time_resolution_s=_RESOLUTION_S,
            device_clock=True,
            epoch=self._epoch,
            details=self._status.details,
        )

        def convert(new: Values) -> tuple[NDArray[Any], NDArray[np.bool_]]:
            values = new[:, columns]
            agree = np.asarray(np.isfinite(values).all(axis=1))
            return np.nan_to_num(values).astype(np.int16), agree

        return Interpretation(info, convert)


def _scales_and_rate(status: Status | None) -> object:
    """Return what makes the counts of one status another scale or rate than those of the next."""
    return status and tuple(one for one in status.sensors if one.enabled)
