"""A run in real time over a real port, judged by what the device wrote down.

Three processes, as on a desk. The emitter is a simulated board on a pseudo-terminal that writes
down every sample that it made and lost, every write with its time, and when it made the level of an
axis step. The monitor is ``allanscope live`` on a terminal, which notes when samples were in the
sums and results on the screen. This one watches both, and compares::

    loss       board's ledger               against    what the recording holds, and the result says
    reader     time of a write              against    time of the read that brought it
    latency    time at which it was made    against    time when it was in the sums, or shown
    events     number of the sample         against    onset told, over the whole run

What of the reader's delay is its own, the time for which it ran, and what is the system's, which
let it wait for a core (``/proc/PID/schedstat``) or had not yet handed the bytes on, is told apart.
"""

from __future__ import annotations

import json
import os
import pty
import resource
import signal
import struct
import subprocess
import sys
import threading
import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from allanscope.cli import parser
from allanscope.pipeline import Decoding
from allanscope.recording import Recording
from allanscope.samples import Block, Gap, StreamInfo
from allanscope.simulator import Device, Simulator
from allanscope.wire import WireSettings

__all__ = ["RealNight", "run_real_night"]

PAIR = struct.Struct("<qq")
"""Host monotonic time in ns, and a count of bytes or samples."""

STEP_COUNTS = 200
"""Each step of the level of gx: some eight standard deviations of a sample."""
STEPS_A_RUN, SHORTEST_S, LONGEST_S = 12, 100.0, 600.0
"""How often: the watch has to know a level before it can say that it has changed."""
PHASES = 4
"""The watch tells an onset to a block of a second. Steps come a quarter of a block later each time,
so that one in four falls into the same place of a block, and shows a drift of less than that."""
LOOK_S = 1.0


# -- the emitter -----------------------------------------------------------------------------------


class Stair(Simulator):
    """A sensor whose gx takes a step each so many samples.

    Parameters
    ----------
    rate : float
        Nominal rate in Hz.
    every : int
        Samples between two steps.
    """

    def __init__(self, rate: float, every: int) -> None:
        super().__init__(rate=rate, seed=1)
        self._every = every

    def read(self, n: int) -> Block:
        block = super().read(n)
        counts = block.counts.astype(np.int64)
        counts[:, 0] += STEP_COUNTS * ((block.index + np.arange(len(block))) // self._every)
        return replace(block, counts=np.clip(counts, -32768, 32767).astype(np.int16))


def emit(folder: Path, rate: float, every: int) -> None:
    """Be the board until interrupted; then leave its books in `folder`."""
    from allanscope.simulator.pty_port import PtyPort

    with (folder / "writes.bin").open("wb", buffering=1 << 16) as log:

        class Noting(PtyPort):
            """A port that notes when it took which bytes."""

            taken = 0

            def write(self, data: bytes) -> int:
                count = super().write(data)
                if count:
                    self.taken += count
                    log.write(PAIR.pack(time.monotonic_ns(), self.taken))
                return count

        signal.signal(signal.SIGTERM, signal.default_int_handler)
        sensor = Stair(rate, every)
        device = Device(sensor, port=Noting())
        try:
            with device:
                print(device.url, flush=True)
                device.wait()
        except KeyboardInterrupt:
            pass
    books = {
        **device.ledger.to_dict(),
        "true_hz": device.true_hz,
        "start_s": device.start_s,
        "every": every,
    }
    (folder / "books.json").write_text(json.dumps(books))


# -- the monitor -----------------------------------------------------------------------------------


def monitor(folder: Path, arguments: list[str]) -> int:
    """Be ``allanscope``, with a screen that notes when samples and results came to it."""
    from allanscope.__main__ import main
    from allanscope.analysis import Analysis
    from allanscope.pipeline import run

    sums = (folder / "sums.bin").open("wb", buffering=1 << 13)
    shown = (folder / "shown.bin").open("wb", buffering=1 << 10)

    class Noting(run.TerminalView):
        """The screen of a session. What it is told has already been summed up."""

        def samples(self, info: StreamInfo, block: Block) -> None:
            sums.write(PAIR.pack(time.monotonic_ns(), block.index + len(block)))
            super().samples(info, block)

        def snapshot(self, analysis: Analysis) -> None:
            super().snapshot(analysis)
            shown.write(PAIR.pack(time.monotonic_ns(), analysis.samples + analysis.lost_samples))

    run.TerminalView = Noting  # type: ignore[misc]
    try:
        return main(arguments)
    finally:
        sums.close()
        shown.close()


# -- what is seen from outside ---------------------------------------------------------------------


@dataclass
class Watched(threading.Thread):
    """How long the reader waited for a core, and how busy the machine was, each second.

    Attributes
    ----------
    rows : list of (int, int, int)
        Host monotonic time, and for how long the reader has run and has waited for a core since it
        began, all in ns.
    load : list of float
        Load of the machine over a minute.
    """

    monitor: int
    rows: list[tuple[int, int, int]] = field(default_factory=list)
    load: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__(name="watched", daemon=True)
        self._done = threading.Event()

    __hash__ = threading.Thread.__hash__

    def run(self) -> None:
        reader = None
        while not self._done.wait(LOOK_S):
            self.load.append(os.getloadavg()[0])
            reader = reader or _child(self.monitor, "port_reader.py")
            if reader is None:
                continue
            try:
                ran, waited, _ = Path(f"/proc/{reader}/schedstat").read_text().split()
            except OSError:
                return  # it has ended
            self.rows.append((time.monotonic_ns(), int(ran), int(waited)))

    def end(self) -> None:
        self._done.set()
        self.join()


def _child(pid: int, name: str) -> int | None:
    """Return the process below `pid` that runs a script of this name."""
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            parent = int((folder / "stat").read_text().rsplit(")", 1)[1].split()[1])
            if parent == pid and name in (folder / "cmdline").read_text():
                return int(folder.name)
        except OSError:
            continue
    return None


# -- the run ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class RealNight:
    """What the processes of a run left.

    Attributes
    ----------
    result : dict
        The result as JSON has it.
    books : dict
        Of the board.
    writes, reads, sums, shown : ndarray of int64, shape (n, 2)
        Host monotonic time in ns; bytes that the port took, bytes read, samples in the sums,
        samples in a result on the screen.
    taken : list of (int, int, int)
        Epoch, first and last + 1 of each run of samples in the recording.
    gaps : list of (float, Gap)
        Gaps of the recording, with the time of the run in s.
    events : list of dict
        What was told while it happened.
    reader : ndarray of int64, shape (n, 3)
        See `Watched.rows`.
    load : list of float
    cpu_s : float
        Of the monitor and its children, the final analysis included.
    """

    result: dict[str, Any]
    books: dict[str, Any]
    writes: NDArray[np.int64]
    reads: NDArray[np.int64]
    sums: NDArray[np.int64]
    shown: NDArray[np.int64]
    taken: list[tuple[int, int, int]]
    gaps: list[tuple[float, Gap]]
    events: list[dict[str, Any]]
    reader: NDArray[np.int64]
    load: list[float]
    cpu_s: float

    def losses(self) -> list[tuple[bool, str]]:
        """Of what was made up to the last sample that came, lost = told."""
        made = sum(stop for _, stop in self._last_of_epochs().items())
        got = sum(stop - first for _, first, stop in self.taken)
        book = sum(
            max(0, min(loss["first"] + loss["count"], self._last_of_epochs()[loss["epoch"]]))
            - loss["first"]
            for loss in self.books["losses"]
            if loss["epoch"] in self._last_of_epochs()
            and loss["first"] < self._last_of_epochs()[loss["epoch"]]
        )
        told = self.result["lost_samples"]
        return [
            (
                book == 0 and made == got,
                f"{made - got} of {made} samples that the board made did not arrive; "
                f"its ledger: {book} lost",
            ),
            (told == made - got == book, f"{told} told by the monitor"),
            (self.result["samples"] == got, f"{got} in the recording, as many in the result"),
            (
                self.result["unknown_losses"] == 0,
                f"{self.result['unknown_losses']} gaps of unknown length",
            ),
            (self.result["segments"] == 1, f"{self.result['segments']} segments"),
            (
                self.result["link"]["crc_errors"] == 0,
                f"{self.result['link']['crc_errors']} bad checksums",
            ),
        ]

    def _last_of_epochs(self) -> dict[int, int]:
        last: dict[int, int] = {}
        for epoch, _, stop in self.taken:
            last[epoch] = max(stop, last.get(epoch, 0))
        return last

    def reading(self) -> list[tuple[bool, str]]:
        """Delay of the oldest byte of each read, and how much of it was waiting for a core."""
        ends = self.reads[:, 1]
        firsts = np.concatenate([[0], ends[:-1]])
        written = self.writes[np.searchsorted(self.writes[:, 1], firsts, side="right"), 0]
        delay = 1e-9 * (self.reads[:, 0] - written)
        at, used, waited = self.reader.T
        reads = np.diff(np.searchsorted(self.reads[:, 0], at))
        own = 1e-9 * np.diff(used)[reads > 0] / reads[reads > 0]
        return [
            (
                float(np.quantile(delay, 0.99)) < READ_S,
                f"reader: oldest byte of a read {_spread(delay)} after it was written "
                f"(99 % below {1e3 * READ_S:.0f} ms asked; it gathers for up to "
                f"{1e3 * BATCHING_S:.0f})",
            ),
            (
                bool(own.max() < OWN_S),
                f"of this its own: {1e3 * own.mean():.2f} ms of processor time a read, at most "
                f"{1e3 * own.max():.2f} ms in any second; it waited for a core "
                f"{1e-6 * (waited[-1] - waited[0]):.0f} ms in all, in one second at most "
                f"{1e-6 * np.diff(waited).max():.0f} ms; the rest is the system handing bytes on",
            ),
        ]

    def latency(self) -> list[tuple[bool, str]]:
        """Age of the newest sample when it was in the sums, and of a result when it was shown."""
        in_sums, shown = self._ages(self.sums), self._ages(self.shown)
        third = len(in_sums) // 3
        early, late = (
            float(np.quantile(part, 0.99)) for part in (in_sums[:third], in_sums[-third:])
        )
        return [
            (
                float(np.quantile(in_sums, 0.99)) < SUMS_S,
                f"newest sample in the sums after {_spread(in_sums)} (99 % below "
                f"{SUMS_S * 1e3:.0f} ms asked)",
            ),
            (
                late < 2.0 * early + 0.05,
                f"99 % of the first third {1e3 * early:.0f} ms, of the last {1e3 * late:.0f} ms",
            ),
            (
                float(np.quantile(shown, 0.9)) < SHOWN_S,
                f"newest sample of a result on the screen {_spread(shown)}, {len(shown)} results",
            ),
        ]

    def _ages(self, rows: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the time from the making of the newest sample to each row, in s."""
        made = self.books["start_s"] + rows[:, 1] / self.books["true_hz"]
        return 1e-9 * rows[:, 0] - made

    def drift(self) -> list[tuple[bool, str]]:
        """Onsets told against the samples at which the board stepped, over the run."""
        rate, every = self.books["true_hz"], self.books["every"]
        told: dict[int, dict[str, Any]] = {}
        others = 0
        for event in self.events:
            last = event["occurrences"][-1]
            step = round(last["sample"] / every)
            if event["news"] != "found":
                continue
            if event["kind"] == "step" and "gx" in event["axes"] and step not in told:
                told[step] = last
            else:
                others += 1
        # The watch needs some seconds, so a step at the very end is not asked for.
        most = int((self.result["samples"] - NOT_ASKED_S * rate) // every)
        steps = range(1, most + 1)
        missed = [k for k in steps if k not in told]
        if not steps or missed:
            return [(not missed, f"{most - len(missed)} of {most} steps told")]
        true_s = np.arange(1, most + 1) * every / rate
        row = {key: np.array([told[k][key] for k in steps]) for key in told[1]}
        late, known = row["onset_s"] - true_s, row["found_s"] - true_s
        # A block's edge may be the moment itself.
        held = int(np.sum((row["lower_s"] - EDGE_S < true_s) & (true_s < row["upper_s"] + EDGE_S)))
        checks = [
            (True, f"{most} of {most} steps told, {others} other events"),
            (
                bool(np.abs(late).max() < ONSET_S) and held == most,
                f"onset off by {late.min():+.3f} to {late.max():+.3f} s (a block is 1 s), {held} "
                f"of {most} intervals hold it; known {known.min():.1f} to {known.max():.1f} s "
                "later",
            ),
        ]
        if most > PHASES:
            drift = [late[k] - late[k % PHASES] for k in range(PHASES, most)]
            worst = max(drift, key=abs)
            checks.append(
                (
                    abs(worst) < DRIFT_S,
                    f"over the run onsets drift by {1e3 * worst:+.3f} ms at most, "
                    f"{1e3 * drift[-1]:+.3f} ms at the end",
                )
            )
        return checks


BATCHING_S = 0.025
"""So long the reader lets bytes gather (`ReadPacer`), at most."""
READ_S, OWN_S = 0.06, 0.002
SUMS_S = 0.4
SHOWN_S = 70.0
"""On a screen no result grows older than a minute."""
ONSET_S, EDGE_S, DRIFT_S = 1.1, 0.01, 0.01
NOT_ASKED_S = 30.0


def _spread(seconds: NDArray[np.float64]) -> str:
    middle, most = (1e3 * float(np.quantile(seconds, q)) for q in (0.5, 0.99))
    return f"median {middle:.0f}, 99 % {most:.0f}, most {1e3 * float(seconds.max()):.0f} ms"


def run_real_night(
    rate: float,
    duration: str,
    busy: int,
    real_time: bool,
    folder: Path,
    health: Any,
) -> RealNight:
    """Run device and monitor, as a user would, and return what they left.

    Parameters
    ----------
    rate : float
        Nominal rate in Hz.
    duration : str
        How long, as the command line has it.
    busy : int
        Processes that take all they get.
    real_time : bool
        Give the emitter real-time priority, so that it is never late.
    folder : Path
        Where everything goes.
    health : callable
        Called with the number of the monitor's process; returns a thread that is then started, and
        ended before the final analysis.
    """
    seconds = parser().parse_args(["live", "--for", duration]).duration
    me = [sys.executable, str(Path(__file__).resolve())]
    between_s = min(max(seconds / STEPS_A_RUN, SHORTEST_S), LONGEST_S)
    every = int(rate * round(between_s)) + int(rate) // PHASES
    if real_time:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(20))  # the emitter inherits it
    device = subprocess.Popen(
        [*me, "emit", str(folder), str(rate), str(every)], stdout=subprocess.PIPE, text=True
    )
    if real_time:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    assert device.stdout is not None
    port = device.stdout.readline().strip()
    others = [
        subprocess.Popen([sys.executable, "-c", "while True: sorted(range(20000))"])
        for _ in range(busy)
    ]
    session = folder / "S"
    live = [*me, "monitor", str(folder), "live", port, "--for", duration, "--out", str(session)]
    live += ["--view", "none", "--events-to", str(folder / "events.jsonl")]
    screen, inside = pty.openpty()
    child = subprocess.Popen(live, stdout=inside, stderr=inside, stdin=inside)
    os.close(inside)
    threading.Thread(target=_looked_at, args=(screen,), daemon=True).start()
    looking, watched = health(child.pid), Watched(child.pid)
    looking.start()
    watched.start()
    _until_recorded(session / "session.mcap", child)
    looking.end()
    watched.end()
    for process in others:  # the full analysis that follows is no part of this
        process.terminate()
    child.wait()
    used = resource.getrusage(resource.RUSAGE_CHILDREN)  # of the monitor: the others still run
    for process in (device, *others):
        process.terminate()
        process.wait()
    taken, gaps = _taken(session)
    events = (folder / "events.jsonl").read_text() if (folder / "events.jsonl").exists() else ""
    return RealNight(
        json.loads((session / "result.json").read_text()),
        json.loads((folder / "books.json").read_text()),
        _pairs(folder / "writes.bin"),
        _reads(session),
        _pairs(folder / "sums.bin"),
        _pairs(folder / "shown.bin")[:-1],  # the last one is the final result
        taken,
        gaps,
        [json.loads(line) for line in events.splitlines()],
        np.array(watched.rows, dtype=np.int64),
        watched.load,
        used.ru_utime + used.ru_stime,
    )


def _looked_at(screen: int) -> None:
    """Take what is written to the screen, as a terminal does."""
    try:
        while os.read(screen, 1 << 16):
            pass
    except OSError:
        os.close(screen)


def _until_recorded(path: Path, child: subprocess.Popen[bytes]) -> None:
    """Wait until a recording has not grown for five seconds, or its process has ended."""
    grown, size = time.monotonic(), 0
    while child.poll() is None and (not size or time.monotonic() - grown < 5.0):
        time.sleep(0.2)
        if path.exists() and path.stat().st_size != size:
            grown, size = time.monotonic(), path.stat().st_size


def _pairs(path: Path) -> NDArray[np.int64]:
    data = path.read_bytes()
    whole = len(data) - len(data) % PAIR.size
    return np.frombuffer(data[:whole], "<i8").reshape(-1, 2)


def _reads(session: Path) -> NDArray[np.int64]:
    """Return the time of each recorded read, and how many bytes had come with it."""
    times, ends, total = [], [], 0
    for buffer in Recording(session).buffers():
        if len(buffer.offset):
            times.append(buffer.host_ns)
            ends.append(total + np.append(buffer.offset[1:], len(buffer.data)))
            total += len(buffer.data)
    return np.column_stack([np.concatenate(times), np.concatenate(ends)])


def _taken(session: Path) -> tuple[list[tuple[int, int, int]], list[tuple[float, Gap]]]:
    """Return the runs of samples of a recording, and its gaps with the time of the run."""
    decoding, runs, gaps = Decoding(WireSettings()), [], []
    rate_hz, epoch, joined = 1.0, 0, False
    for buffer in Recording(session).buffers():
        for event in decoding.feed_buffer(buffer):
            if isinstance(event, StreamInfo):
                rate_hz, epoch, joined = event.nominal_hz, event.epoch, False
            elif isinstance(event, Gap):
                gaps.append((runs[-1][2] / rate_hz if runs else 0.0, event))
                joined = False
            elif isinstance(event, Block):
                stop = event.index + len(event)
                first = runs.pop()[1] if joined else event.index
                runs.append((epoch, first, stop))
                joined = True
    return runs, gaps


if __name__ == "__main__":
    if sys.argv[1] == "emit":
        emit(Path(sys.argv[2]), float(sys.argv[3]), int(sys.argv[4]))
    else:
        sys.exit(monitor(Path(sys.argv[2]), sys.argv[3:]))
