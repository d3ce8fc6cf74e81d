"""The host's end: bytes to frames to events, with epochs, losses to the sample, times.

Two counters show what happened between two data frames. The sequence number counts frames that were
sent, of any type; the index counts samples that the sensor made. So:

=============  ============  ==========================================================
sequence       index         meaning
=============  ============  ==========================================================
goes on        goes on       nothing is missing
jumps          goes on       frames without samples were lost, e.g. a status
jumps          jumps         frames with samples were lost on the way: ``link``
goes on        jumps         the device never sent them: ``sensor`` when it says that
                             the sensor's FIFO overran, else ``device``
=============  ============  ==========================================================

Counts mean nothing without the descriptor of their epoch. Frames of an epoch that nothing has
described yet wait for it, up to about two seconds of them; they are never scaled by an older one.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import cast

import numpy as np
from numpy.typing import NDArray

from allanscope.samples import Block, Event, Gap, GapReason, Notice, Ticks
from allanscope.wire.base import LinkStats
from allanscope.wire.native import descriptor, messages
from allanscope.wire.native.descriptor import Descriptor
from allanscope.wire.native.framing import Deframer
from allanscope.wire.native.layout import (
    HEADER_BYTES,
    NO_TEMPERATURE,
    NO_TICKS,
    VERSION_MAJOR,
    Clock,
    Flag,
    FrameType,
)
from allanscope.wire.native.table import FrameTable, Run, batch_table, runs_of, table_of

__all__ = ["NativeDecoder"]

_SLICE = 1 << 22
"""Bytes read at a time: a piece of a replay, without a copy."""
_RANGE = 1 << 32
"""Of the sample index, and of the time stamp of the sensor."""
# As numbers: each run is compared with them, and a Flag takes ten times as long.
_RAISED = int(Flag.GYRO_SATURATED | Flag.ACCEL_SATURATED | Flag.TIME_JUMP | Flag.SELF_TEST)
_SENSORS = int(Flag.GYRO | Flag.ACCEL)
_MOST_FRAMES = 1024
_ASK_EVERY = 64


class NativeDecoder:
    """Bytes of the native protocol to events.

    Parameters
    ----------
    batch : bool
        Whether to read with the compiled loop; frame by frame in plain Python gives the same.
    """

    def __init__(self, batch: bool = True) -> None:
        self.stats = LinkStats()
        self._batch = batch
        self._deframer = Deframer()
        self._assembler = _Assembler(self.stats)

    def feed(self, data: bytes, host_s: float) -> list[Event]:
        """Take bytes that arrived at host time `host_s` and return what they complete."""
        return self.feed_chunks(data, np.array([len(data)]), np.array([host_s]))

    def feed_chunks(
        self, data: bytes, ends: NDArray[np.int64], host_s: NDArray[np.float64]
    ) -> list[Event]:
        """Take many chunks at once; a recording is replayed this way.

        Parameters
        ----------
        data : bytes
            The chunks, one after another.
        ends : ndarray of int64, shape (c,)
            Where each chunk ends in `data`, ascending.
        host_s : ndarray of float64, shape (c,)
            When each chunk arrived.
        """
        self.stats.bytes += len(data)
        events: list[Event] = []
        for start in range(0, len(data), _SLICE):
            piece = data[start : start + _SLICE]
            table = self._read(piece)
            arrival = np.searchsorted(ends, table.ends + start)
            events += self._assembler.feed(table, host_s[arrival])
        self.stats.crc_errors = self._deframer.crc_errors
        self.stats.resyncs = self._deframer.malformed + self._assembler.repeats
        return events

    def interrupt(self, reason: str) -> list[Event]:
        """Forget a partial frame, e.g. after an unplug; the next Block follows a Gap."""
        self._deframer.reset()
        self._assembler.interrupt(cast("GapReason", reason))
        return []

    def finish(self) -> list[Event]:
        """Return what the end of the stream completes: never samples, at most an error."""
        return self._assembler.finish()

    def _read(self, data: bytes) -> FrameTable:
        if not self._batch:
            return table_of(self._deframer.feed(data))
        return batch_table(self._deframer, data)


class _Assembler:
    """Turns tables of frames into events and keeps the counters.

    Attributes
    ----------
    repeats : int
        Frames that came a second time and were ignored.
    """

    def __init__(self, stats: LinkStats) -> None:
        self.repeats = 0
        self._stats = stats
        self._descriptor: Descriptor | None = None
        self._described_by: tuple[bytes, int] | None = None
        self._waiting = _UndescribedFrames()
        self._times = _FrameTimes()
        self._next_seq: int | None = None
        self._frames_missing = False
        self._next_index: int | None = None
        self._last_frame: tuple[int, int] | None = None
        self._gap_due: GapReason | None = None
        self._delivered = False
        self._raised = 0
        self._refused_version = False

    def feed(self, table: FrameTable, host_s: NDArray[np.float64]) -> list[Event]:
        """Return the events of a table of frames and the host times of its data frames."""
        events: list[Event] = []
        for run, other in runs_of(table, host_s):
            if run is not None:
                events += self._data(run)
            if other is not None:
                events += self._other(other)
        return events

    def interrupt(self, reason: GapReason) -> None:
        """Note that the stream was interrupted: the next Block follows a Gap of this reason."""
        if self._delivered:
            self._gap_due = reason
        self._next_seq = None
        self._frames_missing = False
        self._waiting.release()
        self._refused_version = False

    def finish(self) -> list[Event]:
        """Report how much could not be decoded without a descriptor."""
        samples = self._waiting.samples
        self._waiting.release()
        if not samples:
            return []
        return [
            Notice(
                "error",
                f"{samples} samples were dropped: the stream has no descriptor of its counts",
                {"samples": samples},
            )
        ]

    # -- frames that carry samples ---------------------------------------------------------------

    def _data(self, run: Run) -> Iterator[Event]:
        self._stats.frames += len(run)
        self._note_sequence(run.first_seq, len(run))
        missing, self._frames_missing = self._frames_missing, False
        known = self._descriptor
        if known is None or known.info.epoch != run.epoch:
            yield from self._waiting.add(run, missing)
        else:
            yield from self._deliver(run, missing, known)

    def _deliver(self, run: Run, frames_missing: bool, known: Descriptor) -> Iterator[Event]:
        first = run.headers[0]
        if (int(first["seq"]), int(first["index"])) == self._last_frame:
            self.repeats += 1  # a second copy of the last frame
            run = run.frames(1, len(run))
        flags = run.headers["flags"]
        if len(flags) == 0 or (int(flags[0]) & _SENSORS) != known.valid:
            return  # not usable: the index will tell how many samples that cost
        yield from self._raise_flags(flags)
        index, gap = self._continue_index(run, frames_missing)
        if gap is not None:
            self._stats.lost_samples += gap.lost or 0
            self._stats.unknown_losses += gap.lost is None
            yield gap
        self._next_index = index + len(run.samples)
        last = run.headers[-1]
        self._last_frame = int(last["seq"]), int(last["index"])
        self._delivered = True
        self._stats.samples += len(run.samples)
        counts = run.samples
        if len(known.columns) < counts.shape[1]:
            counts = np.ascontiguousarray(counts[:, known.columns])
        yield Block(index, counts, self._times.ticks(run, known))

    def _continue_index(self, run: Run, frames_missing: bool) -> tuple[int, Gap | None]:
        """Return the unwrapped index of a run's first sample, and the gap before it."""
        first = int(run.headers["index"][0])
        due, self._gap_due = self._gap_due, None
        if self._next_index is None:
            return first, None if due is None else Gap(due, None)
        jump = (first - self._next_index) % _RANGE
        if jump >= _RANGE // 2:
            return first, Gap(due or "restarted", None)
        if due is not None:
            return self._next_index + jump, Gap(due, jump)
        if jump == 0:
            return self._next_index, None
        overrun = int(run.headers["flags"][0]) & Flag.SENSOR_OVERRUN
        reason: GapReason = "link" if frames_missing else "sensor" if overrun else "device"
        return self._next_index + jump, Gap(reason, jump)

    def _raise_flags(self, flags: NDArray[np.uint8]) -> Iterator[Event]:
        """Say once that a frame is marked, until a frame comes that is not."""
        if not int(np.bitwise_or.reduce(flags)) & _RAISED:
            self._raised = int(flags[-1])
            return
        before = np.concatenate([[self._raised], flags[:-1]]).astype(np.uint8)
        risen = int(np.bitwise_or.reduce(flags & ~before)) & _RAISED
        self._raised = int(flags[-1])
        for flag in Flag(risen):
            yield Notice("status", messages.FLAGS[flag], {"flag": int(flag)})

    # -- all other frames ------------------------------------------------------------------------

    def _note_sequence(self, first: int, frames: int) -> None:
        if self._next_seq is not None and first != self._next_seq:
            self._frames_missing = True
        self._next_seq = (first + frames) & 0xFFFF

    def _other(self, frame: bytes) -> Iterator[Event]:
        kind, version, seq = frame[0], frame[1], int.from_bytes(frame[2:4], "little")
        if version >> 4 != VERSION_MAJOR:
            yield from self._refuse(version)
            return
        if kind < FrameType.START:
            self._note_sequence(seq, 1)
        body = frame[HEADER_BYTES:]
        if kind == FrameType.DESCRIPTOR:
            yield from self._described(body, int.from_bytes(frame[4:6], "little"))
            return
        notice = messages.notice_of(kind, version, body) if frame[7] == len(body) else None
        if notice is None:
            self._stats.unknown += 1
            return
        self._stats.frames += 1
        yield notice

    def _refuse(self, version: int) -> Iterator[Event]:
        self._stats.unknown += 1
        if not self._refused_version:
            self._refused_version = True
            yield Notice(
                "error",
                f"the device speaks version {version >> 4}.{version & 15} of the native protocol; "
                f"this program reads version {VERSION_MAJOR}: update one of them",
                {"version": version},
            )

    def _described(self, body: bytes, epoch: int) -> Iterator[Event]:
        if (body, epoch) == self._described_by:  # devices repeat it every second
            self._stats.frames += 1
            return
        known = descriptor.read(body, epoch)
        if known is None:
            self._stats.unknown += 1
            yield Notice("error", "an invalid descriptor was skipped")
            return
        self._stats.frames += 1
        if known == self._descriptor:
            return
        self._descriptor, self._described_by = known, (body, epoch)
        self._next_index = self._last_frame = None
        self._times = _FrameTimes()
        if self._delivered and self._gap_due is None:
            self._gap_due = "restarted"
        yield known.info
        for run, missing in self._waiting.release(epoch):
            yield from self._deliver(run, missing, known)


class _UndescribedFrames:
    """Keeps about two seconds of frames, and asks for the descriptor until it comes."""

    def __init__(self) -> None:
        self._runs: deque[tuple[Run, bool]] = deque()
        self._asked = 0

    def add(self, run: Run, frames_missing: bool) -> Iterator[Notice]:
        """Keep a run, the oldest frames making room, and yield what to ask for."""
        for number in range(len(run)):
            if self._asked % _ASK_EVERY == 0:
                yield Notice(
                    "status",
                    f"waiting for the descriptor of epoch {run.epoch:#06x}",
                    {"wanted": "descriptor", "epoch": run.epoch},
                )
            self._asked += 1
            frame = run.frames(number, number + 1)
            # Copies, because a slice would keep all that was read with it.
            frame = Run(frame.headers.copy(), frame.samples.copy(), frame.host_s.copy())
            self._runs.append((frame, frames_missing and number == 0))
            if len(self._runs) > _MOST_FRAMES:
                self._runs.popleft()

    def release(self, epoch: int | None = None) -> list[tuple[Run, bool]]:
        """Return the frames of an epoch and forget all others."""
        runs, self._runs = self._runs, deque()
        self._asked = 0
        return [(run, missing) for run, missing in runs if run.epoch == epoch]

    @property
    def samples(self) -> int:
        """Number of samples that wait."""
        return sum(len(run.samples) for run, _ in self._runs)


class _FrameTimes:
    """Times of the frames of one epoch, one tick a frame."""

    def __init__(self) -> None:
        self._last: tuple[int, int] | None = None

    def ticks(self, run: Run, known: Descriptor) -> Ticks:
        """Return the ticks of a run."""
        headers = run.headers
        crystal = known.clock is not Clock.NONE
        return Ticks(
            offset=np.cumsum(headers["n"], dtype=np.int64) - headers["n"],
            device_s=headers["mcu_us"] / 1e6 if crystal else self._sensor_time(run, known),
            host_s=run.host_s,
            temperature_c=_temperature_c(headers["temperature"], known),
        )

    def _sensor_time(self, run: Run, known: Descriptor) -> NDArray[np.float64]:
        """Return the sensor's own time, unwrapped, for a device that has no clock."""
        stamps = run.headers["sensor_ticks"].astype(np.int64)
        seconds = np.full(len(stamps), np.nan)
        present = stamps != NO_TICKS
        if present.any():
            seen = stamps[present]
            raw, total = self._last or (int(seen[0]), int(seen[0]))
            # A difference modulo 2^32 is right as long as two frames are nearer than that.
            totals = total + np.cumsum(np.diff(seen, prepend=raw) % _RANGE)
            self._last = int(seen[-1]), int(totals[-1])
            seconds[present] = totals * (known.tick_ns * 1e-9)
        return seconds


def _temperature_c(counts: NDArray[np.int16], known: Descriptor) -> NDArray[np.float64]:
    """Return temperatures in degC; NaN where none was sent, or the device does not scale them."""
    if known.temperature_lsb_per_c is None:
        return np.full(len(counts), np.nan)
    degrees = counts / known.temperature_lsb_per_c + known.temperature_zero_c
    return np.where(counts == NO_TEMPERATURE, np.nan, degrees)
