"""Frames to events: epochs, losses to the sample, device time, temperature.

Two counters tell what happened between two data frames. The sequence number counts frames that were
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

Counts mean nothing without the descriptor of their epoch. Frames of an epoch that nobody has
described yet wait for it, up to about two seconds of them; they are never scaled by an older one.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from allanscope.samples import Block, Event, Gap, GapReason, Notice, Ticks
from allanscope.wire.base import LinkStats
from allanscope.wire.native import descriptor, remarks
from allanscope.wire.native.descriptor import Descriptor
from allanscope.wire.native.layout import (
    HEADER_BYTES,
    NO_TEMPERATURE,
    NO_TICKS,
    VERSION_MAJOR,
    Clock,
    Flag,
    FrameType,
)
from allanscope.wire.native.table import FrameTable

__all__ = ["Assembler"]

_MOST_WAITING = 1024
_ASK_EVERY = 64
_INDEX_RANGE = 1 << 32
_RAISED = Flag.GYRO_SATURATED | Flag.ACCEL_SATURATED | Flag.TIME_JUMP | Flag.SELF_TEST


@dataclass(frozen=True, slots=True)
class _Run:
    """Data frames that follow one another without a hole, and how they follow what came before."""

    headers: NDArray[np.void]
    samples: NDArray[np.int16]
    host_s: NDArray[np.float64]
    frames_missing: bool


class Assembler:
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
        self._next_seq: int | None = None
        self._frames_missing = False
        self._next_index: int | None = None
        self._last_repeat: tuple[int, int] | None = None
        self._gap_due: GapReason | None = None
        self._delivered = False
        self._raised = 0
        self._ticks: tuple[int, int] | None = None
        self._waiting: deque[_Run] = deque()
        self._waited = 0
        self._refused_version = False

    def take(self, table: FrameTable, host_s: NDArray[np.float64]) -> list[Event]:
        """Return the events of a table of frames and the host times of its data frames."""
        events: list[Event] = []
        row = 0
        for other in table.others:
            if other.row > row:
                events += self._data(table, host_s, row, other.row)
                row = other.row
            events += self._other(other.frame)
        if row < len(table.headers):
            events += self._data(table, host_s, row, len(table.headers))
        return events

    def interrupt(self, reason: GapReason) -> None:
        """Note that the stream was interrupted: the next Block follows a Gap of this reason."""
        if self._delivered:
            self._gap_due = reason
        self._next_seq = None
        self._refused_version = False

    def finish(self) -> list[Event]:
        """Say how much could not be understood for want of a descriptor."""
        samples = sum(len(run.samples) for run in self._waiting)
        self._waiting.clear()
        if not samples:
            return []
        return [
            Notice(
                "error",
                f"{samples} samples were dropped: the stream never said what its counts mean",
                {"samples": samples},
            )
        ]

    # -- frames that carry samples ---------------------------------------------------------------

    def _data(
        self, table: FrameTable, host_s: NDArray[np.float64], start: int, stop: int
    ) -> Iterator[Event]:
        headers = table.headers[start:stop]
        ends = np.cumsum(table.headers["n"][:stop], dtype=np.int64)[start:]
        first_sample = int(ends[0]) - int(headers["n"][0])
        bounds = [*_breaks(headers), len(headers)]
        for low, high in pairwise(bounds):
            begin = first_sample if low == 0 else int(ends[low - 1])
            run = headers[low:high]
            self._note_sequence(int(run["seq"][0]), len(run))
            missing, self._frames_missing = self._frames_missing, False
            yield from self._run(
                _Run(
                    run,
                    table.samples[begin : int(ends[high - 1])],
                    host_s[start + low : start + high],
                    missing,
                )
            )

    def _run(self, run: _Run) -> Iterator[Event]:
        self._stats.frames += len(run.headers)
        known = self._descriptor
        epoch = int(run.headers["epoch"][0])
        if known is None or known.info.epoch != epoch:
            yield from self._wait(run, epoch)
        else:
            yield from self._deliver(run, known)

    def _wait(self, run: _Run, epoch: int) -> Iterator[Event]:
        for row in range(len(run.headers)):
            if self._waited % _ASK_EVERY == 0:
                yield Notice(
                    "status",
                    f"waiting for the descriptor of epoch {epoch:#06x}",
                    {"wanted": "descriptor", "epoch": epoch},
                )
            self._waited += 1
            first = int(run.headers["n"][:row].sum())
            last = first + int(run.headers["n"][row])
            self._waiting.append(
                _Run(
                    run.headers[row : row + 1].copy(),
                    run.samples[first:last].copy(),
                    run.host_s[row : row + 1].copy(),
                    run.frames_missing and row == 0,
                )
            )
            if len(self._waiting) > _MOST_WAITING:
                self._waiting.popleft()

    def _deliver(self, run: _Run, known: Descriptor) -> Iterator[Event]:
        run = self._without_repeat(run)
        flags = run.headers["flags"]
        if len(flags) == 0 or (int(flags[0]) & (Flag.GYRO | Flag.ACCEL)) != known.valid:
            return  # not usable: the index will tell how many samples that cost
        yield from self._raise_flags(flags)
        index, gap = self._continue_index(run)
        if gap is not None:
            self._stats.lost_samples += gap.lost or 0
            self._stats.unknown_losses += gap.lost is None
            yield gap
        self._next_index = index + len(run.samples)
        last = run.headers[-1]
        self._last_repeat = (int(last["seq"]), int(last["index"]))
        self._delivered = True
        self._stats.samples += len(run.samples)
        counts = run.samples
        if len(known.columns) < counts.shape[1]:
            counts = np.ascontiguousarray(counts[:, known.columns])
        yield Block(index, counts, self._ticks_of(run, known))

    def _without_repeat(self, run: _Run) -> _Run:
        """Drop a first frame that is a second copy of the last one delivered."""
        first = run.headers[0]
        if (int(first["seq"]), int(first["index"])) != self._last_repeat:
            return run
        self.repeats += 1
        size = int(first["n"])
        return _Run(run.headers[1:], run.samples[size:], run.host_s[1:], False)

    def _continue_index(self, run: _Run) -> tuple[int, Gap | None]:
        """Return the unwrapped index of a run's first sample, and the hole before it."""
        first = int(run.headers["index"][0])
        due, self._gap_due = self._gap_due, None
        if self._next_index is None:
            return first, None if due is None else Gap(due, None)
        jump = (first - self._next_index) % _INDEX_RANGE
        if jump >= _INDEX_RANGE // 2:
            return first, Gap(due or "restarted", None)
        if due is not None:
            return self._next_index + jump, Gap(due, jump)
        if jump == 0:
            return self._next_index, None
        overrun = int(run.headers["flags"][0]) & Flag.SENSOR_OVERRUN
        reason: GapReason = "link" if run.frames_missing else "sensor" if overrun else "device"
        return self._next_index + jump, Gap(reason, jump)

    def _ticks_of(self, run: _Run, known: Descriptor) -> Ticks:
        headers = run.headers
        counts = headers["temperature"]
        temperature = counts / known.temperature_lsb_per_c + known.temperature_zero_c
        ends = np.cumsum(headers["n"], dtype=np.int64)
        return Ticks(
            offset=ends - headers["n"],
            device_s=self._device_time(headers, known),
            host_s=run.host_s,
            temperature_c=np.where(counts == NO_TEMPERATURE, np.nan, temperature),
        )

    def _device_time(self, headers: NDArray[np.void], known: Descriptor) -> NDArray[np.float64]:
        if known.clock is not Clock.NONE:
            return headers["mcu_us"] * 1e-6
        ticks = headers["sensor_ticks"].astype(np.int64)
        seconds = np.full(len(ticks), np.nan)
        present = ticks != NO_TICKS
        if present.any():
            seen = ticks[present]
            raw, unwrapped = self._ticks or (int(seen[0]), int(seen[0]))
            # A difference taken modulo 2^32 is right as long as two frames are nearer than that.
            steps = np.diff(seen, prepend=raw) % _INDEX_RANGE
            whole = unwrapped + np.cumsum(steps)
            self._ticks = int(seen[-1]), int(whole[-1])
            seconds[present] = whole * (known.tick_ns * 1e-9)
        return seconds

    def _raise_flags(self, flags: NDArray[np.uint8]) -> Iterator[Event]:
        """Say once that a frame is marked, until a frame comes that is not."""
        before = np.concatenate([[self._raised], flags[:-1]]).astype(np.uint8)
        risen = int(np.bitwise_or.reduce(flags & ~before)) & _RAISED
        self._raised = int(flags[-1])
        for flag in Flag(risen):
            yield Notice("status", remarks.FLAGS[flag], {"flag": int(flag)})

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
        notice = remarks.notice_of(kind, body) if frame[7] == len(body) else None
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
        known = descriptor.read(body, epoch)
        if known is None:
            self._stats.unknown += 1
            yield Notice("error", "a descriptor could not be understood and was skipped")
            return
        self._stats.frames += 1
        if known == self._descriptor:
            return
        self._descriptor = known
        self._next_index = self._last_repeat = self._ticks = None
        self._waited = 0
        if self._delivered and self._gap_due is None:
            self._gap_due = "restarted"
        yield known.info
        waiting, self._waiting = self._waiting, deque()
        for run in waiting:
            if int(run.headers["epoch"][0]) == epoch:
                yield from self._deliver(run, known)


def _breaks(headers: NDArray[np.void]) -> list[int]:
    """Return the rows that do not simply continue the row before, the first one included."""
    if len(headers) == 1:
        return [0]
    seq, index, n = headers["seq"], headers["index"], headers["n"]
    flags = headers["flags"] & np.uint8(Flag.GYRO | Flag.ACCEL)
    joined = (
        (seq[1:] == seq[:-1] + np.uint16(1))
        & (index[1:] == index[:-1] + n[:-1])
        & (headers["epoch"][1:] == headers["epoch"][:-1])
        & (flags[1:] == flags[:-1])
    )
    return [0, *(np.flatnonzero(~joined) + 1).tolist()]
