"""From chunks to events: listen until the wire format is known, wake the device, then decode.

The same object serves a live port and a replay, and it looks at nothing but the chunks and their
times; that is why a recording gives the same events, bit for bit, as the night it was made in.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from allanscope.errors import InputError
from allanscope.recording import Buffer
from allanscope.samples import Block, Event, Gap, Notice, StreamInfo
from allanscope.sanitize import excerpt
from allanscope.sources import Chunk
from allanscope.wire import (
    Decoder,
    LinkStats,
    WireFormat,
    WireSettings,
    answers,
    feed_chunks,
    format_named,
    formats,
    sniff,
)
from allanscope.wire.text import why_no_rows

__all__ = ["Decoding"]

LISTEN_S = 2.0
"""A port is listened to for this long before it is given up as speaking none of the formats."""

LISTEN_BYTES = 1 << 18
"""As much of a file is read before the same decision."""

SILENCE_S = 0.6
"""After this much silence the device is told to start, in every format that knows how to say it."""

SHORT_SILENCE_S = 0.35
"""And before that in a format whose devices are put out of step by what all others say."""

MUTE_S = 3.0
"""A device that has said nothing at all for this long may not be one."""

BYTES_WITHOUT_SAMPLES = 2 << 20
"""A file whose first bytes, so many of them, hold no sample is none of ours: reading on may take as
long as it likes."""

FROM_HOST = {"host": 1}
"""Marks a notice as the host's own remark, not the device's."""

ENOUGH = 0.5
"""Score above which a format is taken without waiting for more bytes."""

SECONDS_WITHOUT_SAMPLES = 3.0
"""Bytes that come for so long without a sample are worth a line."""

_REASONS = {"disconnected": "disconnected", "overrun": "link", "hole": "file"}
"""Why samples are missing around what happened to the link."""


class Decoding:
    """Turn the chunks of one source into events.

    Parameters
    ----------
    settings : WireSettings
        What the user said about the device.
    wire : str
        Name of the format, or empty to find out.
    write : callable, optional
        Sends bytes to the device; None where there is none, as in a replay.
    """

    def __init__(
        self,
        settings: WireSettings,
        wire: str = "",
        write: Callable[[bytes], None] | None = None,
    ) -> None:
        self._settings = settings
        self._write = write
        self._format: WireFormat | None = None
        self._decoder: Decoder | None = None
        self._unsniffed: list[Chunk] = []
        self._unsniffed_bytes = 0
        self.reconnects = 0
        self._numbered = True  # or timed
        self._counts_frames = False
        self._watchdog = SampleWatchdog()
        self._begin()
        if wire:
            self._choose(wire)

    def resume(self, write: Callable[[bytes], None]) -> None:
        """Go on with a live device after a replay of what it said before; a gap lies between.

        The decoder stays as it is, so that a device that counts its samples and was not restarted
        still tells how many are missing.
        """
        self._write = write
        self._begin()
        if self._decoder is not None:
            self._decoder.interrupt("resumed")

    def _begin(self) -> None:
        self._opened_ns: int | None = None
        self._first_byte_ns: int | None = None
        self._wakes = [(SHORT_SILENCE_S, True), (SILENCE_S, False)]
        self._missed = False

    @property
    def wire(self) -> str:
        """Name of the format, empty while it is not known."""
        return self._format.name if self._format else ""

    @property
    def stats(self) -> LinkStats:
        """Counters of the link so far."""
        if self._decoder is None:
            return LinkStats(bytes=self._unsniffed_bytes)
        return self._decoder.stats

    def feed(self, chunk: Chunk) -> list[Event]:
        """Take one chunk and return the events that it completes.

        Raises
        ------
        InputError
            When enough was received and no format fits it; the message has a sample.
        """
        events: list[Event] = []
        if self._opened_ns is None:
            self._opened_ns = chunk.host_ns
        if chunk.event == "mark":
            events.append(Notice("mark", chunk.text))
        elif chunk.event not in ("", "end"):
            events += self._link_event(chunk)
        if not chunk.data and self._first_byte_ns is None:
            events += self._wake_if_silent(chunk.host_ns)
        if not chunk.data:
            return events
        if self._decoder is not None:
            self._first_byte_ns = self._first_byte_ns or chunk.host_ns
            found = self._decoder.feed(chunk.data, _seconds(chunk))
            self._refuse_without_samples(chunk.host_ns)
            self._complete_events(found)
            return events + found + self._check_samples(found, np.array([chunk.host_ns]))
        return events + self._listen(chunk)

    def feed_buffer(self, buffer: Buffer) -> list[Event]:
        """Take many reads in one piece, as a replay does; Blocks that follow each other are joined.

        The events are those of `take` for each read, bit for bit.

        Raises
        ------
        InputError
            As `take`.
        """
        events: list[Event] = []
        ends = np.append(buffer.offset[1:], len(buffer.data))
        taken = 0
        if buffer.event:
            events += self.feed(Chunk(buffer.event_ns, b"", buffer.event, buffer.text))
        while self._decoder is None and taken < len(buffer.offset):
            data = buffer.data[buffer.offset[taken] : ends[taken]]
            events += self.feed(Chunk(int(buffer.host_ns[taken]), data))
            taken += 1
        if taken < len(buffer.offset):
            assert self._decoder is not None
            self._first_byte_ns = self._first_byte_ns or int(buffer.host_ns[taken])
            begin = int(buffer.offset[taken])
            host_ns = buffer.host_ns[taken:]
            host_s = np.where(host_ns != 0, host_ns * 1e-9, np.nan)
            data = buffer.data[begin:] if begin else buffer.data
            found = feed_chunks(self._decoder, data, ends[taken:] - begin, host_s)
            self._refuse_without_samples(int(host_ns[0]))
            self._complete_events(found)
            events += found + self._check_samples(found, host_ns)
        return events

    def finish(self) -> list[Event]:
        """Return what the end of the stream completes.

        Raises
        ------
        InputError
            When there were bytes and no format fits them.
        """
        events: list[Event] = []
        if self._decoder is None and self._unsniffed:
            events += self._decide(last=True)
        if self._decoder is not None:
            events += self._decoder.finish()
            if self._watchdog.is_due and self.stats.samples:
                if not self._watchdog.reported:
                    events.append(Notice("error", self._watchdog.text(), FROM_HOST))
                self.stats.unknown_losses += 1
                events.append(Gap("link", None))
        return events

    def stop_device(self) -> None:
        """Send the stop command, where the format has one."""
        if self._format is not None and self._write is not None:
            for message in self._format.stop():
                self._write(message)

    def _complete_events(self, events: list[Event]) -> None:
        """Note whether samples are numbered or timed; ask the device for what the decoder needs."""
        for at, event in enumerate(events):
            if isinstance(event, StreamInfo):
                self._numbered = event.numbered or event.time_resolution_s > 0.0
                self._counts_frames = event.numbered
                events[at] = replace(event, origin=event.origin or self._settings.origin)
        if self._decoder is None or self._format is None:
            return
        to_say = answers(self._decoder)
        if self._write is None:
            return  # a replay: it has been said
        for message in to_say:
            self._write(message)
        if any(isinstance(e, Notice) and "wanted" in e.fields for e in events):
            for message in self._format.describe():
                self._write(message)

    def _check_samples(self, events: list[Event], read_ns: NDArray[np.int64]) -> list[Event]:
        """Say when bytes come and no samples: garbage, or a stream that never describes itself.

        At once only of a device that is there; a replay, which takes many reads in one piece, says
        at its end whether its end was so.
        """
        assert self._decoder is not None
        self._watchdog.update(events, read_ns)
        if self._write is None:
            return []
        framed = self._format is not None and self._format.framed
        text = self._watchdog.message(self._decoder.stats, framed)
        if not text:
            return []
        missing = [] if self._numbered else self._decoder.interrupt("stalled")
        return [*missing, Notice("error", text, FROM_HOST)]

    def _refuse_without_samples(self, host_ns: int) -> None:
        """Raise InputError for a file, which has no times, that begins with too much of nothing."""
        stats = self.stats
        if (
            not host_ns
            and not stats.samples
            and not stats.frames
            and stats.bytes > BYTES_WITHOUT_SAMPLES
        ):
            raise InputError(
                f"no samples as {self.wire} in the first {stats.bytes} bytes; "
                "cut off what comes before them, or name another --wire"
            )

    def _choose(self, name: str) -> None:
        self._format = format_named(name)
        self._decoder = self._format.decoder(self._settings)

    def _listen(self, chunk: Chunk) -> list[Event]:
        if self._first_byte_ns is None:
            self._first_byte_ns = chunk.host_ns
        self._unsniffed.append(chunk)
        self._unsniffed_bytes += len(chunk.data)
        patience_over = (
            chunk.host_ns - self._first_byte_ns > LISTEN_S * 1e9
            or self._unsniffed_bytes > LISTEN_BYTES
        )
        return self._decide(last=patience_over)

    def _decide(self, last: bool) -> list[Event]:
        sample = b"".join(chunk.data for chunk in self._unsniffed)
        found = sniff(sample)
        if found.name is None or (not last and found.scores[found.name] < ENOUGH):
            if not last:
                return []
            if found.name is None:
                why = why_no_rows(sample)
                said = f"{why}; it begins {excerpt(sample, 40)}" if why else found.excerpt
                hint = "" if why or self._write is None else "; at a UART, check --baud"
                raise InputError(
                    f"none of the formats {', '.join(formats())} fits the data: {said}{hint}"
                )
        self._choose(found.name)
        assert self._decoder is not None
        events: list[Event] = [Notice("text", f"wire format {found.name}", FROM_HOST)]
        for chunk in self._unsniffed:
            events += self._decoder.feed(chunk.data, _seconds(chunk))
        self._unsniffed.clear()
        self._complete_events(events)
        return events

    def _wake_if_silent(self, now_ns: int) -> list[Event]:
        """Start a silent device, as stock ST firmware needs; then report silence."""
        assert self._opened_ns is not None
        silent_s = (now_ns - self._opened_ns) * 1e-9
        if self._wakes and silent_s > self._wakes[0][0]:
            _, first = self._wakes.pop(0)
            if self._format is not None:
                self._wakes.clear()
            self._send_start(first)
        if self._missed or silent_s <= MUTE_S:
            return []
        self._missed = True
        text = f"no data for {silent_s:.0f} s; check the port and whether the board is on"
        if self._format is None:
            text += "; firmware with SDATALOG at a UART needs --wire sdatalog"
        return [Notice("error", text, FROM_HOST)]

    def _link_event(self, chunk: Chunk) -> list[Event]:
        self._watchdog.restart()
        if chunk.event == "reconnected":
            self.reconnects += 1
            self._send_start()
        if self._decoder is None:
            return self._restart_listening(chunk.host_ns) if chunk.event == "stalled" else []
        if chunk.event == "overrun" and self._counts_frames:
            return []  # nothing need be missing, and numbers tell what is: half a frame may go on
        if chunk.event in _REASONS:
            return self._decoder.interrupt(_REASONS[chunk.event])
        if chunk.event == "stalled":
            # A board that restarted without leaving the bus may wait to be told to start.
            self._send_start()
            return [Notice("error", "no data from the device", FROM_HOST)]
        if chunk.event == "resumed":
            # Numbers or times tell what is missing; without either nothing does.
            missing = [] if self._numbered else self._decoder.interrupt("stalled")
            return [*missing, Notice("text", "data from the device again", FROM_HOST)]
        return []

    def _restart_listening(self, now_ns: int) -> list[Event]:
        """Take what came before a silence for debris of a board that waits to be started."""
        debris = b"".join(chunk.data for chunk in self._unsniffed)
        self._unsniffed.clear()
        self._begin()
        self._opened_ns = now_ns
        text = f"silence after bytes that fit no format: {excerpt(debris)}"
        return [Notice("error", text, FROM_HOST)]

    def _send_start(self, first: bool | None = None) -> None:
        """Tell the device to start; where its format is not known, in those that must start first.

        Or in the others (False), or in all of them (None).
        """
        if self._write is None:
            return
        known = (
            [self._format]
            if self._format
            else sorted(map(format_named, formats()), key=lambda one: not one.must_start_first)
        )
        for one in known:
            if self._format or first in (None, one.must_start_first):
                for message in one.start(self._settings):
                    self._write(message)


def _seconds(chunk: Chunk) -> float:
    """Host time in s; a file has none, which its source says by the time 0."""
    return chunk.host_ns * 1e-9 if chunk.host_ns else math.nan


class SampleWatchdog:
    """Follow a stream and know for how long its bytes have brought no samples, garbage or not.

    Attributes
    ----------
    reported : bool
        Whether the message was sent and no sample has come since.
    """

    def __init__(self) -> None:
        self.reported = False
        self._described = True
        self._frames = 0
        self.restart()

    def restart(self) -> None:
        """Start again with the next bytes, after a silence or a reconnection."""
        self._first_ns: int | None = None
        self._held_ns = self._last_ns = 0

    @property
    def is_due(self) -> bool:
        """Whether bytes have come for too long since the last sample, if there was one."""
        return (
            self._first_ns is not None
            and self._last_ns - self._first_ns > SECONDS_WITHOUT_SAMPLES * 1e9
        )

    def update(self, events: list[Event], read_ns: NDArray[np.int64]) -> None:
        """Take what some reads were decoded to, with the host time of each; 0 is unknown."""
        if not read_ns[0]:
            return  # a file: nothing comes late
        self._last_ns = int(read_ns[-1])
        for event in events:
            if isinstance(event, Notice) and "wanted" in event.fields:
                self._described = False
        sample_ns = _last_sample_ns(events)
        if sample_ns:
            self.reported, self._described, self._first_ns = False, True, None
        later = read_ns[read_ns > sample_ns]
        if self._first_ns is None and len(later):
            self._first_ns = int(later[0])

    def message(self, stats: LinkStats, framed: bool) -> str:
        """Return the message that is due now, once; empty where none is.

        Parameters
        ----------
        stats : LinkStats
            Counters of the decoder.
        framed : bool
            Whether frames may hold no samples. In all other formats one is a row, and rows are
            held back until it is known what they mean.
        """
        if not framed and stats.frames > self._frames:
            self._held_ns = self._last_ns
        self._frames = stats.frames
        held = self._last_ns - self._held_ns <= SECONDS_WITHOUT_SAMPLES * 1e9
        if self.reported or held or not self.is_due:
            return ""
        return self.text()

    def text(self) -> str:
        """Return the message, and remember that it was sent."""
        self.reported = True
        why = "" if self._described else ": no descriptor says what they mean"
        return (
            f"bytes arrive, but nothing could be decoded for {SECONDS_WITHOUT_SAMPLES:g} s{why}; "
            "how many samples are lost is not known"
        )


def _last_sample_ns(events: list[Event]) -> int:
    """Return when the last sample came, in ns of the host's clock, a little late; 0 without one."""
    for event in reversed(events):
        if isinstance(event, Block):
            known = event.ticks.host_s[np.isfinite(event.ticks.host_s)]
            if len(known):
                return round(float(known[-1]) * 1e9) + 1000  # seconds are less exact than ns
    return 0
