"""One session: a source is read, recorded, decoded, analysed and shown until it ends.

Three threads, so that none waits for another::

    reader    source.read ──▶ recorder (its own writer) and ──▶ queue
    session   queue ──▶ decode ──▶ analyser and listeners       (the caller's thread)
    refresh   a frozen copy of the analyser ──▶ result ──▶ listeners
                                        └─ when the run has doubled ──▶ a worker looks for effects

The reader does nothing but move bytes, so a slow disk, a long fit or a stalled viewer costs no
sample. The session thread never computes a result: it copies the running sums, which takes
milliseconds, and the refresh thread does the rest; the next refresh starts only when the last one
has ended and after a multiple of what it took, so refreshing adapts to the machine; but no result
on a screen grows older than a tenth of the run or a minute.
"""

from __future__ import annotations

import json
import math
import queue
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Literal, Protocol

from allanscope.analysis import FEWEST_ROWS, Analyser, Analysis, Depth, event_dict, summarise
from allanscope.pipeline.decoding import Decoding
from allanscope.pipeline.read_queue import (
    LIVE_ROOM,
    REPLAY_ROOM,
    TOGETHER_S,
    UNWATCHED_READ_S,
    ReadQueue,
    joined,
)
from allanscope.pipeline.refreshing import UNWATCHED, LoopProcess, Refresher, RefreshPolicy
from allanscope.quantities import duration
from allanscope.recording import Buffer
from allanscope.samples import Block, Event, Gap, Notice, StreamInfo
from allanscope.sanitize import one_line
from allanscope.sources import Chunk, Source
from allanscope.worker_process import WorkerProcess

__all__ = ["Listener", "NoticeQueue", "Session", "SessionRecorder"]

SPACE_FIRST_NS, SPACE_EVERY_NS = 10_000_000_000, 60_000_000_000
"""When the room on the disk is first told, and how often."""

_PATIENCE_S = 1.0
"""A slow device has a result, which shows that it is heard, before it has a curve."""

_SETTLED_S = 1.0
"""After the first bytes it is said who reads the port: by then the process that reads it has taken
over from the thread that began."""


class Listener(Protocol):
    """Whoever watches a session: the viewer, the terminal. No method may block."""

    def info(self, info: StreamInfo) -> None:
        """Tell what the samples that follow mean."""

    def samples(self, info: StreamInfo, block: Block) -> None:
        """Show a run of samples."""

    def gap(self, gap: Gap) -> None:
        """Show a gap."""

    def notice(self, notice: Notice) -> None:
        """Show a remark."""

    def snapshot(self, analysis: Analysis) -> None:
        """Show the result so far."""


class SessionRecorder(Protocol):
    """Whoever keeps what was read: the recorder."""

    @property
    def space_left_s(self) -> float | None:
        """Time that the disk has room for, in seconds; None while unknown."""

    def rx(self, chunk: Chunk) -> None:
        """Keep what came from the device."""

    def tx(self, data: bytes, host_ns: int) -> None:
        """Keep what was sent to it."""

    def mark(self, text: str, host_ns: int) -> None:
        """Keep a remark of the user."""


NoticeQueue = queue.SimpleQueue[Notice]
"""Notices from other threads, for the session to emit: marks, and alarms of the recorder."""


class Session:
    """Run one source to its end.

    Parameters
    ----------
    source : Source
        Where bytes come from; closed at the end.
    decoding : Decoding
        Turns them into events.
    analyser : Analyser
        Sums them up.
    listeners : sequence of Listener
        Who is shown what happens.
    recorder : SessionRecorder, optional
        Who records it.
    duration_s : float, optional
        Stop this long after the first byte, or after the start when none has come by then.
    input_facts : callable
        Returns what the result says about where the samples came from.
    notices : NoticeQueue, optional
        Notices of other threads, reported before the next chunk.
    earlier : iterable of Event
        What the session held before it was interrupted: processed first, not shown, while the
        source is already read and recorded.
    policy : RefreshPolicy
        How often the result is computed, which depends on who looks.
    """

    def __init__(
        self,
        source: Source,
        decoding: Decoding,
        analyser: Analyser,
        *,
        listeners: Sequence[Listener] = (),
        recorder: SessionRecorder | None = None,
        duration_s: float | None = None,
        input_facts: Callable[[], dict[str, str]] = dict,
        notices: NoticeQueue | None = None,
        earlier: Iterable[Event] = (),
        policy: RefreshPolicy = UNWATCHED,
    ) -> None:
        self.source = source
        self.decoding = decoding
        self.analyser = analyser
        self.listeners: Sequence[Listener] = listeners
        self.recorder = recorder
        self._duration_s = duration_s
        self._input_facts = input_facts
        self._earlier = earlier
        self._stop = threading.Event()
        if recorder is None:
            self._reads = ReadQueue(REPLAY_ROOM)
        else:
            # At once at first: a device that has to be asked for samples waits for each next word.
            self._reads = ReadQueue(LIVE_ROOM, 0.0, live=True)
        self._together_s = UNWATCHED_READ_S if policy is UNWATCHED else TOGETHER_S
        self._notices = NoticeQueue() if notices is None else notices
        self._reader_error: BaseException | None = None
        self.failures: list[str] = []
        self.loop_process = LoopProcess(fail=self.fail, report=self._remark)
        self._refresher = Refresher(self._show, policy, self.fail)
        self._space_due_ns = 0
        self._space_reported = False
        self._first_result_s = 0.0

    def stop(self) -> None:
        """End the session soon, as if the source had ended; callable from anywhere."""
        self._stop.set()

    def mark(self, text: str) -> None:
        """Set a mark at the present moment; callable from any thread."""
        self._notices.put(Notice("mark", text))

    def _remark(self, line: str) -> None:
        """Say something of our own; callable from any thread."""
        self._notices.put(Notice("text", one_line(line), {"host": 1}))

    def fail(self, line: str) -> None:
        """Say that something beside the measurement failed, once; callable from any thread."""
        line = one_line(line)
        if line not in self.failures:
            self.failures.append(line)
            self._notices.put(Notice("error", line, {"host": 1}))

    def run(self) -> None:
        """Read until the source ends, the duration is over, or `stop` is called.

        Raises
        ------
        InputError
            When no wire format fits what the source says.
        DeviceError
            When the source is lost for good.
        """
        reader = threading.Thread(target=self._read, name="reader", daemon=True)
        reader.start()
        try:
            for event in self._earlier:
                self.analyser.feed(event)
            self._fresh_events()  # what was found before is in the result, and not reported again
            while (chunks := self._reads.get_all())[-1].event != "end":
                self._process(chunks)
                if self.recorder is not None and self._has_result():
                    self._reads.together_s = self._together_s
            self._process(chunks[:-1])
            for event in self.decoding.finish():
                self._emit(event)
            self.decoding.stop_device()
        finally:
            self._stop.set()
            self._reads.release_reader()
            self.loop_process.close()
            self._refresher.close()
            self.source.close()
            reader.join(timeout=10.0)
        if self._reader_error is not None:
            raise self._reader_error

    def result(self, depth: Depth, workers: Sequence[WorkerProcess] = ()) -> Analysis:
        """Return the result of what was taken so far; see `summarise` for the workers."""
        analysis = summarise(
            self.analyser,
            self.decoding.stats,
            depth=depth,
            input_facts={**self._input_facts(), "wire": self.decoding.wire},
            reconnects=self.decoding.reconnects,
            workers=workers,
        )
        return replace(analysis, failures=tuple(self.failures))

    def emit_notices(self, host_ns: int) -> None:
        """Emit the notices of other threads; a mark is recorded with this host time."""
        while not self._notices.empty():
            notice = self._notices.get()
            if notice.kind == "mark" and self.recorder is not None:
                self.recorder.mark(notice.text, host_ns)
            self._emit(notice)

    def _emit_disk_space(self, host_ns: int) -> None:
        """Say once for how long the disk has room, and then plot it; the recorder alarms."""
        left_s = self.recorder.space_left_s if self.recorder is not None else None
        if left_s is None or host_ns < self._space_due_ns:
            return
        first = self._space_due_ns == 0
        self._space_due_ns = host_ns + (SPACE_FIRST_NS if first else SPACE_EVERY_NS)
        if first:
            return  # so soon after the start the rate of writing is not known
        hours = left_s / 3600.0
        text = f"the disk has room for {duration(left_s)}"
        kind: Literal["status", "text"] = "status" if self._space_reported else "text"
        self._emit(Notice(kind, text, {"host": 1, "disk_left_h": hours}))
        self._space_reported = True

    def _read(self) -> None:
        """Move chunks from the source to the recorder and the queue; the reader thread."""
        most_s = math.inf if self._duration_s is None else self._duration_s
        deadline, received, who = time.monotonic() + most_s, False, ""
        settled = math.inf
        try:
            while not self._stop.is_set():
                chunk = self.source.read()
                now = time.monotonic()
                if chunk.data and not received:
                    deadline, received = now + most_s, True
                    settled = now + _SETTLED_S
                if chunk.data and now >= settled and self.source.reader != who:
                    who = self.source.reader
                    self._notices.put(Notice("text", f"the port is read by {who}", {"host": 1}))
                if self.recorder is not None and (chunk.data or chunk.event):
                    self.recorder.rx(chunk)
                if chunk.event == "end":
                    break
                self._reads.put(chunk)
                if time.monotonic() >= deadline:
                    break
        except Exception as error:
            self._reader_error = error
        self._reads.end()

    def _process(self, chunks: Sequence[Chunk]) -> None:
        if not chunks:
            return
        self._emit_disk_space(chunks[0].host_ns)
        self.emit_notices(chunks[0].host_ns)
        for piece in joined(chunks):
            feed = self.decoding.feed_buffer if isinstance(piece, Buffer) else self.decoding.feed
            for event in feed(piece):  # type: ignore[arg-type]
                self._emit(event)
        if self.listeners and self._has_result():
            self._refresher.offer(self.analyser)

    def _has_result(self) -> bool:
        """Return whether there are samples enough for a curve, or have been any for a while."""
        state = self.analyser.state
        if state is None or not state.samples:
            return False
        if not self._first_result_s:
            self._first_result_s = time.monotonic() + _PATIENCE_S
        return state.samples >= FEWEST_ROWS or time.monotonic() > self._first_result_s

    def _fresh_events(self) -> list[Notice]:
        """Return what the watch has found, or seen go, since this was last asked for."""
        state = self.analyser.state
        if state is None or not state.watch.tracks.unreported:
            return []
        rate_hz = state.clock.rate().hz or state.info.nominal_hz or 1.0
        notices = []
        for what, event in state.watch.changes(rate_hz):
            told = json.dumps({"news": what, **event_dict(event)}, allow_nan=False)
            text = event.words if what == "found" else f"ended: {event.words}"
            notices.append(Notice("event", text, {"host": 1, "news": what, "event": told}))
        return notices

    def _emit(self, event: Event) -> None:
        self._show_all(event)
        for notice in self._fresh_events():
            self._show_all(notice)

    def _show_all(self, event: Event) -> None:
        self.analyser.feed(event)
        for listener in self.listeners:
            try:
                self._emit_to(listener, event)
            except Exception as error:  # whoever watches must not end the measurement
                self.listeners = [one for one in self.listeners if one is not listener]
                self.fail(f"a view failed and was closed: {type(error).__name__}: {error}")

    def _emit_to(self, listener: Listener, event: Event) -> None:
        state = self.analyser.state
        match event:
            case StreamInfo():
                listener.info(event)
            case Block():
                assert state is not None
                listener.samples(state.info, event)
            case Gap():
                listener.gap(event)
            case Notice():
                listener.notice(event)

    def _show(self, frozen: Analyser) -> None:
        analysis = summarise(
            frozen,
            self.decoding.stats,
            depth="live",
            input_facts={**self._input_facts(), "wire": self.decoding.wire},
            reconnects=self.decoding.reconnects,
            known=self.loop_process.explanation,
        )
        for listener in self.listeners:
            listener.snapshot(analysis)
        self.loop_process.offer(frozen)
