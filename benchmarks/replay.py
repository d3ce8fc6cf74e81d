"""From a raw recording at the highest rate to the full result, and where the time goes.

    python benchmarks/replay.py [--hours 0.5] [--recording FILE] [--json FILE] [--quick]

Makes a recording of six axes at 6.66 kHz (`long_recording`), or takes one, and analyses it to the
end. First every stage by itself, in processor time; then all together, in processor and wall time:
unpacked, decoded and summed up on two cores, fitted, and the loop closed. The peer is allantools'
OADEV alone at octave taus, on one axis of the same samples in memory, times six. The bound is what
the memory traffic and the arithmetic of the deviations need: 12.6 ns a sample and axis on the
machine of docs/performance.md.
"""

from __future__ import annotations

import argparse
import resource
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import allantools
import numpy as np
from figures import Figure, all_cpu_s, written
from long_recording import make

from allanscope.analysis import Analyser, StreamState, row_buffer, summarise
from allanscope.pipeline import Decoding
from allanscope.pipeline.analyse_file import FULL_ROWS, full_settings
from allanscope.pipeline.process import reuse_memory
from allanscope.pipeline.replaying import feed_analyser
from allanscope.recording import Fingerprint, Recording
from allanscope.samples import Block, StreamInfo
from allanscope.wire import WireSettings

BOUND_NS = 12.6
NIGHT_H = 12.0
MOST_BUFFERS = 100
"""Pieces of 4 MB that the single stages are timed with."""


def cpu_s(call: Callable[[], Any]) -> float:
    """Return the processor time of a call."""
    began = time.process_time()
    call()
    return time.process_time() - began


def stages(path: Path) -> dict[str, float]:
    """Return the nanoseconds of each stage, per sample of one axis."""
    reuse_memory()  # as `analyse` does
    buffers, seconds = [], {}

    def read() -> None:
        for buffer in Recording(path).buffers():
            buffers.append(buffer)
            if len(buffers) == MOST_BUFFERS:
                break

    seconds["read and unpack"] = cpu_s(read)
    fingerprint, decoding = Fingerprint(), Decoding(WireSettings())
    seconds["fingerprint"] = cpu_s(lambda: [fingerprint.add(one) for one in buffers])
    events: list[Any] = []
    seconds["decode"] = cpu_s(lambda: [events.extend(decoding.feed_buffer(b)) for b in buffers])
    blocks = [event for event in events if isinstance(event, Block)]
    info = next(event for event in events if isinstance(event, StreamInfo))
    state = StreamState(info, 4, FULL_ROWS)
    warm = [state.temperature.at_samples(block) for block in blocks]
    seconds["watch"] = cpu_s(lambda: [state.watch.rows(block.counts) for block in blocks])
    seconds["clock"] = cpu_s(lambda: [state.clock.update(b.index, b.ticks) for b in blocks])
    counts = [np.concatenate([b.counts for b in blocks])]
    seconds["deviations"] = cpu_s(lambda: state.bank.update(counts[0]))
    seconds["spectrum"] = cpu_s(lambda: state.spectrum.update(counts[0]))
    seconds["history"] = cpu_s(lambda: state.history.update(counts[0], np.concatenate(warm)))
    return {name: 1e9 * spent / counts[0].size for name, spent in seconds.items()}


def whole(path: Path) -> dict[str, float]:
    """Analyse a recording and return processor and wall time of the sums and of the rest."""
    reuse_memory()
    row_buffer.BackgroundTask().do(row_buffer.WORTH_IT, lambda: None)  # threads are there
    decoding = Decoding(WireSettings())
    analyser = Analyser(full_settings(""))
    marks = [(all_cpu_s(), time.monotonic())]
    feed_analyser(path, decoding, analyser, quiet=True, on_buffer=Fingerprint().add)
    assert analyser.state is not None
    analyser.state.settle()
    marks.append((all_cpu_s(), time.monotonic()))
    summarise(analyser, decoding.stats, "full", {})
    marks.append((all_cpu_s(), time.monotonic()))
    (a, b), (c, d), (e, f) = marks
    return {
        "sums_cpu_s": c - a,
        "sums_wall_s": d - b,
        "result_cpu_s": e - c,
        "result_wall_s": f - d,
        "wall_s": f - b,
        "samples": analyser.state.samples,
        "peak_mib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }


def peer_ns(samples: int = 2_000_000) -> float:
    """Return the nanoseconds that allantools' OADEV needs for one sample of one axis."""
    rates = np.random.default_rng(1).standard_normal(samples)
    taus = 2.0 ** np.arange(int(np.log2(samples / 3)) + 1)
    spent = cpu_s(lambda: allantools.oadev(rates, rate=1.0, data_type="freq", taus=taus))
    return 1e9 * spent / samples


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--hours", type=float, default=0.5)
    parser.add_argument("--recording", type=Path, help="use this one, of native frames at 6.66 kHz")
    parser.add_argument("--quick", action="store_true", help="three minutes of samples")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the results here too")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        hours = 0.05 if options.quick else options.hours
        path = options.recording or make(Path(folder) / "long.mcap", hours, 6660.0)
        each, together = stages(path), whole(path)
    axis_samples = 6 * together["samples"]
    sums_ns = 1e9 * together["sums_cpu_s"] / axis_samples
    night = NIGHT_H * 3600 * 6660 * 6
    figures = [Figure(f"{name}, one core", ns, "ns/sample/axis") for name, ns in each.items()]
    figures += [
        Figure(
            "recording to all sums",
            sums_ns,
            "ns/sample/axis",
            peer=peer_ns(),
            peer_name="allantools oadev",
            bound=BOUND_NS,
        ),
        Figure("12 h x 6.66 kHz x 6: sums, processor time", sums_ns * night * 1e-9, "s"),
        Figure("fit and closed loop, processor time", together["result_cpu_s"], "s"),
    ]
    is_night = together["samples"] > 0.9 * NIGHT_H * 3600 * 6660
    goal = 120.0 if is_night else None
    figures.append(Figure("recording to result, wall time", together["wall_s"], "s", goal=goal))
    written(figures, options.json, stages_ns=each, **together)


if __name__ == "__main__":
    main()
