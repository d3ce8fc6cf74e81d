"""Every lost sample of a night with hundreds of faults of every kind must be reported.

    python benchmarks/soak.py                        12 h x 6.66 kHz against a virtual clock
    python benchmarks/soak.py --hours 0.1 --faults 5
    python benchmarks/soak.py --real 2h              the same rate in real time over a real port
    python benchmarks/soak.py --real 5m --busy 6     beside six processes that take all they get
    python benchmarks/soak.py --real 2m --busy 16 --real-time    with an emitter that is never late

The virtual night runs the whole of a live session but its viewer: serial source with its watchdog
and its search for a lost device, recorder, decoder, sums, a live result whenever the machine can.
Then it is held against the truth: the ledger of the board, one pass over the undisturbed sensor
with the lost samples cut out, and a replay of what was recorded. Exit code 1 if anything differs.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path

import numpy as np
from real_night import run_real_night
from virtual_night import KINDS, Night

from allanscope.allan import AllanBank
from allanscope.analysis import Analyser, Analysis
from allanscope.pipeline import Decoding
from allanscope.pipeline.process import configure_malloc
from allanscope.pipeline.replaying import feed_analyser
from allanscope.pipeline.session import Session
from allanscope.recording import Recorder
from allanscope.samples import Block, Gap, Notice, StreamInfo
from allanscope.simulator import Simulator
from allanscope.sources import SerialSource
from allanscope.wire import WireSettings

CURVES = ("oadev", "mdev", "ohdev", "totdev")
TELLING_HOURS = 0.25
"""A shorter run in real time is not judged by what it holds: it has only begun by then."""
MOST_GROWTH_MB = 30.0
"""What may be held more late in a run than early."""
LAG = 1 << 20
"""Samples that the board may be ahead of the sums, so that memory is that of a live run."""


@dataclass
class Witness:
    """A listener that notes which samples came, to the sample."""

    ranges: list[list[int]] = field(default_factory=list)
    epoch: int = -1
    taken: int = 0
    _joined: bool = False

    def info(self, info: StreamInfo) -> None:
        self.epoch, self._joined = info.epoch, False

    def samples(self, info: StreamInfo, block: Block) -> None:
        self.taken += len(block)
        stop = block.index + len(block)
        if self._joined:
            assert self.ranges[-1][2] == block.index, "blocks without a gap between them must join"
            self.ranges[-1][2] = stop
        else:
            self.ranges.append([info.epoch, block.index, stop])
        self._joined = True

    def gap(self, gap: Gap) -> None:
        self._joined = False

    def notice(self, notice: Notice) -> None: ...

    def snapshot(self, analysis: Analysis) -> None: ...


SEARCH_HANDLES, SEARCH_THREADS = 4, 2
"""What a search for effects, which is a process of its own, takes while it runs; it may run late in
a short run and not early. What is not given back after a fault is ten times as much."""


class Health(threading.Thread):
    """Watches memory, file handles and threads of a process."""

    def __init__(self, pid: int, progress: Callable[[], float], every_s: float = 5.0) -> None:
        super().__init__(name="health", daemon=True)
        self._pid, self._progress, self._every_s = pid, progress, every_s
        self._done = threading.Event()
        self.rows: list[tuple[float, float, int, int, float]] = []

    def run(self) -> None:
        while not self._done.wait(self._every_s):
            self.look()

    def look(self) -> None:
        try:
            status = Path(f"/proc/{self._pid}/status").read_text()
            handles = len(os.listdir(f"/proc/{self._pid}/fd"))
        except OSError:
            return
        lines = dict(line.split(":", 1) for line in status.splitlines())
        if "VmRSS" not in lines:
            return  # it has just ended
        memory, files = (int(lines[name].split()[0]) / 1024 for name in ("VmRSS", "RssFile"))
        self.rows.append((self._progress(), memory, handles, int(lines["Threads"]), files))

    def end(self) -> None:
        self._done.set()
        self.join()

    def summary(self) -> list[str]:
        """Return a few lines, and what grew from the first tenth of the run to its last."""
        rows = np.array(self.rows)
        lines = ["   at      memory  of it of files  handles  threads"]
        for row in rows[:: max(1, len(rows) // 12)]:
            lines.append(
                f"{row[0]:7.3f}  {row[1]:7.1f} MB  {row[4]:10.1f} MB  {row[2]:6.0f}  {row[3]:6.0f}"
            )
        return lines

    def growth(self) -> tuple[float, float, int, int]:
        """Return by how much the last sixth of the run exceeds its second quarter.

        In MB what is held, and by how much memory rises above that late in the run; then handles
        and threads. Held is the least that was seen: a result takes some 45 MB until it is shown,
        which in a short run may be most of its last sixth.
        """
        rows = np.array(self.rows)
        part = rows[:, 0] / rows[-1, 0]
        early, late = rows[(part >= 1 / 4) & (part < 1 / 2)], rows[part >= 5 / 6]
        if len(early) < 3:
            return 0.0, 0.0, 0, 0
        held = late[:, 1].min()
        usual = np.median(late[:, 2:4], axis=0) - np.median(early[:, 2:4], axis=0)
        above = late[:, 1].max() - held
        return float(held - early[:, 1].min()), float(above), int(usual[0]), int(usual[1])


# -- the virtual night ---------------------------------------------------------------------------


def virtual(options: argparse.Namespace, folder: Path) -> bool:
    seconds = 3600.0 * options.hours
    over = threading.Event()
    witness = Witness()
    night = Night(options.rate, seconds, options.faults, options.seed, over.set)
    source = SerialSource(
        "virtual", comports=list, opener=night.open, clock=night.clock, sleep=night.sleep
    )
    recorder = Recorder(folder, {}, max_seconds=3600.0, on_alarm=lambda line: print(line or "ok"))
    session = Session(
        _Paced(source, night, witness, over),
        Decoding(WireSettings()),
        Analyser(),
        listeners=(witness,),
        recorder=recorder,
    )
    every_s = 5.0 if options.hours >= 1.0 else 0.1
    health = Health(os.getpid(), lambda: night.now_s / 3600.0, every_s)
    configure_malloc()
    began, cpu = time.monotonic(), time.process_time()
    health.start()
    session.run()
    health.end()
    health.look()  # no result is being computed any more
    recorder.close()
    assert session.analyser.state is not None
    session.analyser.state.settle()
    took, cpu = time.monotonic() - began, time.process_time() - cpu
    print(
        f"{options.hours:g} h at {options.rate:g} Hz x 6 axes in {took:.0f} s, CPU {cpu:.0f} s: "
        f"{night.ledger.produced} samples made, {witness.taken} taken; "
        f"recorded {recorder.bytes_written / 1e9:.2f} GB, {recorder.dropped_bytes} bytes dropped"
    )
    print("faults:", ", ".join(f"{night.faults[kind]} {kind}" for kind in KINDS))
    print("\n".join(health.summary()))
    checks = [*_losses(night, witness, session), *_growth(health)]
    checks += _against_truth(night, witness, session, options)
    checks += _against_replay(folder, session)
    return _verdict(checks)


class _Paced:
    """A source that waits when the sums lag behind, and ends when the night is over."""

    def __init__(
        self, source: SerialSource, night: Night, witness: Witness, over: threading.Event
    ) -> None:
        self._source, self._night, self._witness, self._over = source, night, witness, over
        self.name, self.identity, self.reader = "virtual", {}, ""
        self.write, self.close = source.write, source.close

    def read(self):  # type: ignore[no-untyped-def]
        ledger = self._night.ledger
        while ledger.produced - ledger.lost.total() - self._witness.taken > LAG:
            time.sleep(0.002)
        if self._over.is_set():
            self._source.close()
        return self._source.read()


def _losses(night: Night, witness: Witness, session: Session) -> list[tuple[bool, str]]:
    """Between the first and the last sample of every epoch: lost = reported lost."""
    known = expected = 0
    for epoch, ranges in groupby(witness.ranges, key=lambda one: one[0]):
        each = list(ranges)
        first, stop = each[0][1], each[-1][2]
        known += stop - first - sum(b - a for _, a, b in each)
        expected += night.ledger.missing(epoch, first, stop)
    state = session.analyser.state
    assert state is not None
    restarts = len({epoch for epoch, _, _ in witness.ranges}) - 1
    return [
        (
            known == expected == state.lost == session.decoding.stats.lost_samples,
            f"lost by the board's ledger {expected}, reported {state.lost}",
        ),
        (
            state.unknown_losses == restarts,
            f"{restarts} restarts, {state.unknown_losses} gaps of unknown length",
        ),
        (
            session.decoding.reconnects == night.faults["unplug"],
            f"{night.faults['unplug']} cables pulled, {session.decoding.reconnects} reconnections",
        ),
        (state.segments == len(witness.ranges), f"{state.segments} segments"),
    ]


def _growth(health: Health) -> list[tuple[bool, str]]:
    memory, above, handles, threads = health.growth()
    return [
        (
            memory < MOST_GROWTH_MB,
            f"memory grew by {memory:+.1f} MB from early to late; {above:.1f} MB more for a moment",
        ),
        (
            handles <= SEARCH_HANDLES and threads <= SEARCH_THREADS,
            f"handles {handles:+d}, threads {threads:+d}",
        ),
    ]


def _against_truth(
    night: Night, witness: Witness, session: Session, options: argparse.Namespace
) -> list[tuple[bool, str]]:
    """One pass over the undisturbed sensor, with what was lost cut out."""
    sensor = Simulator(rate=options.rate, seed=options.seed, duration_s=3600.0 * options.hours)
    bank = AllanBank(options.rate, axes=6)
    at = 0
    for epoch, first, stop in witness.ranges:
        start, end = night.zero[epoch] + first, night.zero[epoch] + stop
        while at < start:
            at += len(sensor.read(min(start - at, 1 << 16)))
        while at < end:
            block = sensor.read(min(end - at, 1 << 16))
            bank.update(block.counts)
            at += len(block)
        bank.gap()
    state = session.analyser.state
    assert state is not None
    return [_same("the undisturbed run on what survived", bank, state.bank)]


def _against_replay(folder: Path, session: Session) -> list[tuple[bool, str]]:
    began = time.monotonic()
    decoding = Decoding(WireSettings())
    state = feed_analyser(folder, decoding, Analyser(), quiet=True).state
    took = time.monotonic() - began
    live = session.analyser.state
    assert state is not None
    assert live is not None
    state.settle()
    stats = decoding.stats == session.decoding.stats
    return [
        _same(f"a replay of the recording ({took:.0f} s)", state.bank, live.bank),
        (
            (state.samples, state.lost, stats) == (live.samples, live.lost, True),
            "the same counters",
        ),
    ]


def _same(what: str, one: AllanBank, other: AllanBank) -> tuple[bool, str]:
    worst = 0.0
    one.scale = other.scale = np.ones(6)
    for kind in CURVES:
        a, b = one.deviation(kind), other.deviation(kind)
        if a.tau.shape != b.tau.shape or not np.array_equal(a.terms, b.terms):
            return False, f"{what}: {kind} has other taus or terms"
        worst = max(worst, float(np.nanmax(np.abs(a.deviation / b.deviation - 1.0))))
    return worst < 1e-9, f"{what}: curves differ by {worst:.1e} at most"


# -- real time -----------------------------------------------------------------------------------


def real(options: argparse.Namespace, folder: Path) -> bool:
    """Run the device and the monitor as two processes, as a user would."""
    began = time.monotonic()
    health: list[Health] = []

    def watching(pid: int) -> Health:
        health.append(Health(pid, lambda: (time.monotonic() - began) / 3600.0))
        return health[0]

    night = run_real_night(
        options.rate,
        options.real,
        options.busy,
        options.real_time,
        folder,
        watching,
    )
    result, rate = night.result, night.result["rate"]
    hours = result["samples"] / rate["measured_hz"] / 3600.0
    health[0].rows = [row for row in health[0].rows if row[0] < hours]  # no final analysis
    print("\n".join(health[0].summary()))
    low, middle, high = np.quantile(night.load, (0.0, 0.5, 1.0))
    print(f"{hours:.2f} h; load of the machine {low:.1f} to {high:.1f}, median {middle:.1f}")
    print(f"{night.cpu_s:.1f} s of processor time, the full analysis included")
    print(f"read by {result['input'].get('reader') or 'a thread'}")
    print(f"measured {rate['measured_hz']:.4f} Hz, true {night.books['true_hz']:.4f} Hz")
    print("\n".join(f"gap at {at:.1f} s: {gap}" for at, gap in night.gaps))
    return _verdict(
        [
            *night.losses(),
            *(_growth(health[0]) if hours > TELLING_HOURS else ()),
            *night.reading(),
            *night.latency(),
            *night.drift(),
        ]
    )


def _verdict(checks: list[tuple[bool, str]]) -> bool:
    for good, line in checks:
        print("ok  " if good else "FAIL", line)
    return all(good for good, _ in checks)


def main() -> int:
    """Run one of the two nights and say how it went."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hours", type=float, default=12.0)
    parser.add_argument("--rate", type=float, default=6660.0)
    parser.add_argument("--faults", type=int, default=200, help="of each kind")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--real", metavar="TIME", help="in real time over a real port, e.g. 30m")
    parser.add_argument("--busy", type=int, default=0, help="processes beside the real-time run")
    parser.add_argument("--real-time", action="store_true", help="give the emitter SCHED_RR 20")
    options = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="soak-"))
    try:
        good = (real if options.real else virtual)(options, folder)
    except BaseException:
        print(f"what there is of the run stays in {folder}", file=sys.stderr)
        raise
    shutil.rmtree(folder)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
