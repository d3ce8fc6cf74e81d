"""A live session whose every output may fail, from a seed: disk, files, terminal, arrival of bytes.

The session is the real one, `main(["live", ...])`: reader, inbox, decoder, sums, recorder, results,
terminal. What is simulated is the source, which has a clock of its own and brings the bytes of a
device in a pattern of the seed, and the system below the calls that write: a call may fail, write
less than it was given, or take its time. (SQLite tests its database so, TigerBeetle its cluster.)
Left out is what costs seconds and writes nothing: kernels, the full search, the pictures.

What must hold after it is in `fault_invariants`.
"""

from __future__ import annotations

import errno
import io
import os
import shutil
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from allanscope.__main__ import main
from allanscope.analysis import Analysis, summarise
from allanscope.recording import Chunk, Recorder
from allanscope.simulator import Simulator
from allanscope.wire import format_named
from allanscope.worker_process import WorkerError

RATE_HZ = 416.0
SAMPLES = 1200
START_NS = 5_000_000_000
ERRORS = (errno.ENOSPC, errno.EIO, errno.EDQUOT, errno.EROFS, errno.EACCES)

DISK = ("write", "fsync", "fdatasync", "ftruncate", "lseek", "open", "replace", "rename", "unlink")
"""Calls of `os` that concern the session's folder."""


@dataclass
class Plan:
    """What happens in one run: which calls fail, how, and how bytes arrive.

    Attributes
    ----------
    failing : dict of str to (float, float, str)
        A call, the share of the run in which it fails (from, to; by the number of bytes that have
        come) and how: ``error``, ``short``, ``slow``.
    number : int
        The error.
    arrival : str
        Pattern in which bytes come.
    """

    seed: int
    failing: dict[str, tuple[float, float, str]] = field(default_factory=dict)
    number: int = errno.ENOSPC
    arrival: str = "even"
    backlog_bytes: int = 32 << 20
    quiet: bool = False

    @classmethod
    def of(cls, seed: int) -> Plan:
        """Draw a plan; every eighth one is without any fault of an output."""
        rng = np.random.default_rng(seed)
        plan = cls(seed, number=int(rng.choice(ERRORS)))
        plan.arrival = str(rng.choice(["even", "bursts", "drops", "stall", "unplug", "at once"]))
        plan.quiet = bool(rng.random() < 0.3)
        if seed % 8 == 0:
            return plan
        sites = ["write", "write", "fsync", "fdatasync", "ftruncate", "open", "replace"]
        sites += ["file", "terminal", "stderr", "spare", "report", "view", "refresh", "unlink"]
        for site in rng.choice(sites, size=int(rng.integers(1, 4))):
            begin = float(rng.choice([0.0, rng.uniform(0.0, 1.0), 1.0]))
            end = float(rng.choice([begin + rng.uniform(0.0, 0.5), 9.0]))
            how = str(rng.choice(["error", "error", "short", "slow"]))
            plan.failing[str(site)] = (begin, end, how)
        if rng.random() < 0.3:
            plan.backlog_bytes = 8_000
        return plan


@cache
def device_bytes() -> tuple[tuple[bytes, int], ...]:
    """Return the frames of a device, each with the number of samples in it."""
    encoder = format_named("native").encoder()
    sensor = Simulator(rate=RATE_HZ, seed=3, axes=("gx", "az"))
    per = encoder.samples_per_frame(RATE_HZ)
    frames = [(encoder.describe(sensor.info), 0)]
    while sum(count for _, count in frames) < SAMPLES:
        block = sensor.read(per)
        frames.append((encoder.encode(block), len(block)))
    return tuple(frames)


class Source:
    """The device and its port, on a clock of their own; reads return at once."""

    def __init__(self, plan: Plan, faults: Faults) -> None:
        self.name, self.identity, self.reader, self.trouble = "virtual", {}, "", ""
        self.arrived = 0
        self._faults = faults
        self._script = self._chunks(plan)
        self._closed = False

    def read(self) -> Chunk:
        time.sleep(0.0002)
        if self._closed:
            return Chunk(0, event="end")
        return next(self._script, Chunk(0, event="end"))

    def write(self, data: bytes) -> None: ...

    def close(self) -> None:
        self._closed = True

    def _chunks(self, plan: Plan) -> Iterator[Chunk]:
        rng = np.random.default_rng(plan.seed + 10_000)
        now, frames = START_NS, device_bytes()
        held, done = b"", 0
        for number, (data, count) in enumerate(frames):
            now += round(1e9 * count / RATE_HZ)
            self._faults.progress = number / len(frames)
            if plan.arrival == "drops" and number > 4 and rng.random() < 0.05:
                continue
            held += data
            done += count
            if plan.arrival == "bursts" and rng.random() < 0.9:
                continue
            if plan.arrival == "at once" and number < len(frames) - 1:
                continue
            if plan.arrival == "stall" and number == len(frames) // 2:
                yield Chunk(now, event="stalled")
                now += 4_000_000_000
                yield Chunk(now, held, "resumed")
                held, self.arrived = b"", done
                continue
            if plan.arrival == "unplug" and number == len(frames) // 2:
                yield Chunk(now, event="disconnected")
                done -= count  # the frame is lost with the cable
                held = b""
                yield Chunk(now + 500_000_000, event="reconnected")
                continue
            cut = int(rng.integers(0, len(held) + 1)) if rng.random() < 0.2 else 0
            self.arrived = done
            if cut:
                yield Chunk(now, held[:cut])
            yield Chunk(now, held[cut:])
            held = b""
        if held:
            yield Chunk(now, held)
        self.arrived = done
        self._faults.progress = 1.0


class Faults:
    """The system below the calls that write."""

    def __init__(self, plan: Plan, folder: Path) -> None:
        self.plan, self.folder = plan, str(folder)
        self.progress = 0.0
        self.struck: set[str] = set()
        self._real = {name: getattr(os, name) for name in DISK}
        self._rng = np.random.default_rng(plan.seed + 20_000)

    def strike(self, site: str) -> str:
        """Return how a call fails now, empty if it does not; a slow one has taken its time."""
        begin, end, how = self.plan.failing.get(site, (0.0, 0.0, ""))
        if not how or not begin <= self.progress <= end:
            return ""
        if how == "slow":
            time.sleep(0.002)
            return ""
        self.struck.add(site)
        return how

    def error(self) -> OSError:
        return OSError(self.plan.number, os.strerror(self.plan.number))

    def concerns(self, place: object) -> bool:
        """Return whether a path or descriptor lies in the session's folder."""
        try:
            name = os.readlink(f"/proc/self/fd/{place}") if isinstance(place, int) else str(place)
        except OSError:
            return False
        return name.startswith(self.folder)

    def call(self, name: str) -> Callable[..., Any]:
        """Return a call of `os` that may fail."""
        real = self._real[name]

        def called(*given: Any, **named: Any) -> Any:
            if not self.concerns(given[0]):
                return real(*given, **named)
            if name == "open" and not given[1] & (os.O_WRONLY | os.O_RDWR):
                return real(*given, **named)
            how = self.strike(name)
            if how == "short" and name == "write" and len(given[1]) > 1:
                return real(given[0], bytes(given[1])[: max(1, len(given[1]) // 3)])
            if how:
                raise self.error()
            return real(*given, **named)

        return called

    def write_text(self, real: Callable[..., int]) -> Callable[..., int]:
        """Return `Path.write_text`, which may write a part and fail."""

        def called(path: Path, text: str, *given: Any, **named: Any) -> int:
            site = "file" if self.concerns(path) else "spare" if "allanscope-" in str(path) else ""
            how = self.strike(site) if site else ""
            if how == "short":
                real(path, text[: len(text) // 2], *given, **named)
            if how:
                raise self.error()
            return real(path, text, *given, **named)

        return called


class Terminal(io.StringIO):
    """Standard output or error that may fail."""

    def __init__(self, faults: Faults, site: str) -> None:
        super().__init__()
        self._faults, self._site = faults, site

    def write(self, text: str) -> int:
        if self._faults.strike(self._site):
            raise self._faults.error()
        return super().write(text)


@dataclass
class Ran:
    """What became of a run."""

    code: int
    out: str
    err: str
    analysis: Analysis | None
    recorder: Recorder | None
    arrived: int
    folder: Path
    spare: Path
    struck: set[str]
    thread_errors: list[str]


def run(plan: Plan, place: Path) -> Ran:
    """Run one session with its faults."""
    folder, spare = place / "session", place / "spare"
    spare.mkdir()
    faults = Faults(plan, folder)
    source = Source(plan, faults)
    kept: dict[str, Any] = {}
    thread_errors: list[str] = []
    with ExitStack() as stack:
        for patch in _patches(plan, faults, source, spare, kept):
            stack.enter_context(patch)
        stack.enter_context(
            mock.patch.object(
                threading, "excepthook", lambda one: thread_errors.append(repr(one.exc_value))
            )
        )
        out, err = Terminal(faults, "terminal"), Terminal(faults, "stderr")
        stack.enter_context(mock.patch.object(sys, "stdout", out))
        stack.enter_context(mock.patch.object(sys, "stderr", err))
        words = ["live", "virtual", "--view", "none", "--out", str(folder), "--wire", "native"]
        code = main([*words, "--quiet"] if plan.quiet else words)
    return Ran(
        code, out.getvalue(), err.getvalue(), kept.get("analysis"), kept.get("recorder"),
        source.arrived, folder, spare, faults.struck, thread_errors,
    )  # fmt: skip


def _patches(
    plan: Plan, faults: Faults, source: Source, spare: Path, kept: dict[str, Any]
) -> Iterator[Any]:
    from allanscope.pipeline import run, session

    real_recorder, real_run = run.Recorder, run.run_live
    for name in DISK:
        yield mock.patch.object(os, name, faults.call(name))
    yield mock.patch.object(Path, "write_text", faults.write_text(Path.write_text))
    yield mock.patch.object(run, "device_source", return_value=source)
    yield mock.patch.object(run, "load_rerun")
    yield mock.patch.object(run, "RerunView", return_value=View(faults))
    yield mock.patch("tempfile.mkdtemp", lambda prefix: _mkdtemp(faults, spare, prefix))
    yield mock.patch("allanscope.pipeline.outputs.WorkerProcess", NoWorker)
    yield mock.patch.object(run, "search_processes", return_value=[])
    yield mock.patch("allanscope.report.render", side_effect=lambda *_, **__: _page(faults))

    def recorder(*given: Any, **named: Any) -> Recorder:
        named |= {"commit_s": 0.01, "sync_s": 0.02, "backlog_bytes": plan.backlog_bytes}
        kept["recorder"] = real_recorder(*given, **named)
        return kept["recorder"]

    def summary(*given: Any, **named: Any) -> Analysis:
        if named["depth"] == "live" and faults.strike("refresh"):
            raise MemoryError("no memory for a result")
        return summarise(*given, **{**named, "depth": "live"})

    def run_live(*given: Any, **named: Any) -> Analysis:
        kept["analysis"] = real_run(*given, **named)
        return kept["analysis"]

    yield mock.patch.object(run, "Recorder", recorder)
    yield mock.patch.object(session, "summarise", summary)
    yield mock.patch("allanscope.pipeline.run_live", run_live)
    yield mock.patch("allanscope.pipeline.read_queue.TOGETHER_S", 0.002)


class View:
    """A view whose calls may fail."""

    def __init__(self, faults: Faults) -> None:
        self._faults = faults
        self.serves_page, self.failure = False, ""

    def start(self) -> None: ...

    def size_notice(self, *_: object) -> str:
        return ""

    def _called(self, *_: object) -> None:
        if self._faults.strike("view"):
            raise RuntimeError("the view has failed")

    info = samples = gap = notice = snapshot = _called

    def close(self, final: object, stay: Callable[[], None]) -> None:
        stay()


def _mkdtemp(faults: Faults, spare: Path, prefix: str) -> str:
    if faults.strike("spare"):
        raise faults.error()
    made = spare / f"{prefix}x"
    made.mkdir()
    return str(made)


class NoWorker:
    """A worker process that could not be started: what it is asked for is done here."""

    def __init__(self, preload: str) -> None: ...

    def ask(self, *_: object) -> None:
        raise WorkerError("not started")

    answer = ask

    def close(self) -> None: ...


def _page(faults: Faults) -> str:
    if faults.strike("report"):
        raise ZeroDivisionError("a picture that cannot be drawn")
    return "<html></html>"


@contextmanager
def folder_of(place: Path, seed: int) -> Iterator[Path]:
    """Yield a folder for one run that is gone afterwards."""
    made = place / f"seed-{seed}"
    made.mkdir()
    try:
        yield made
    finally:
        shutil.rmtree(made, ignore_errors=True)
