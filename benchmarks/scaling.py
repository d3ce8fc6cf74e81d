"""How cost and memory grow with length, axes, averaging times and rate: over three decades.

    python benchmarks/scaling.py [--json FILE] [--quick]

Processor time of the sums (deviations, spectrum, history, clock) of int16 samples that lie in
memory, per sample and axis; a cost that is the same from the shortest to the longest is linear. The
rate enters as the number of samples and of frames in a second. Memory is the peak of a process of
its own that takes so many samples without keeping them.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from figures import Figure, written

from allanscope.analysis import Analyser, AnalyserSettings
from allanscope.samples import AXES, Block, StreamInfo, Ticks

FRAME = 16
PIECE = 1 << 16
RATES_HZ = (1.6, 26.0, 104.0, 833.0, 6660.0)
"""From the slowest of the accelerometer to the fastest."""


def analyser(axes: int, per_octave: int = 4, rate_hz: float = 6660.0) -> Analyser:
    """Return an analyser that waits for samples, as a live run has it."""
    made = Analyser(AnalyserSettings(per_octave=per_octave))
    made.feed(StreamInfo(AXES[:axes], (0.004375,) * axes, nominal_hz=rate_hz, device_clock=True))
    return made


def fed(taker: Analyser, samples: int, rate_hz: float = 6660.0, piece: int = PIECE) -> float:
    """Let an analyser take so many samples; return its processor seconds."""
    axes = len(taker.configurations[-1].info.axes)
    pool = np.random.default_rng(1).normal(0, 12, (2 * piece, axes)).round().astype(np.int16)
    offset = np.arange(0, piece, FRAME)
    blank = np.full(len(offset), np.nan)
    began = time.process_time()
    for index in range(0, samples, piece):
        size = min(piece, samples - index)
        rows = offset[offset < size]
        ticks = Ticks(rows, (index + rows) / rate_hz, blank[: len(rows)], blank[: len(rows)])
        start = index // piece % piece
        taker.feed(Block(index, pool[start : start + size], ticks))
    taker.configurations[-1].settle()
    return time.process_time() - began


def ns(axes: int, samples: int, per_octave: int = 4) -> float:
    """Return nanoseconds per sample and axis."""
    return 1e9 * fed(analyser(axes, per_octave), samples) / samples / axes


def ns_framed(rate_hz: float, frames: int) -> float:
    """Return nanoseconds per sample of six axes of a device that is read frame by frame.

    A frame holds what 20 ms bring, 16 rows at most.
    """
    rows = max(1, min(FRAME, int(rate_hz / 50)))
    taker = analyser(6, rate_hz=rate_hz)
    return 1e9 * fed(taker, rows * frames, rate_hz, piece=rows) / (rows * frames) / 6


def peak_mib(samples: int) -> float:
    """Return the peak memory of a process that takes so many samples of six axes."""
    command = [sys.executable, __file__, "--child", str(samples)]
    ran = subprocess.run(command, capture_output=True, text=True, check=True)
    return float(ran.stdout)


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="a tenth of the samples")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the results here too")
    parser.add_argument("--child", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child is not None:
        fed(analyser(6), options.child)
        print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
        return
    most = 10**6 if options.quick else 10**7
    ns(6, 200_000)
    lengths = {most // step: ns(6, most // step) for step in (1000, 100, 10, 1)}
    axes = {count: ns(count, most // 10) for count in (1, 2, 3, 6)}
    taus = {density: ns(6, most // 10, density) for density in (1, 2, 4, 8, 16)}
    rates = {hz: ns_framed(hz, most // 200) for hz in RATES_HZ}
    memory = {most // step: peak_mib(most // step) for step in (1000, 10, 1)}
    low, high = min(lengths), max(lengths)
    load = {hz: 1e-7 * 6 * hz * cost for hz, cost in rates.items()}  # per cent of a core
    figures = [
        Figure(f"cost at {high:.0e} over {low:.0e} samples", lengths[high] / lengths[low], "", 1.3),
        Figure("cost of an axis of six over one alone", axes[6] / axes[1], "", goal=1.3),
        Figure("cost of 16 over 1 taus an octave", taus[16] / taus[1], "", goal=16.0),
        Figure("frame by frame, 104 Hz", rates[104.0], "ns/sample/axis"),
        Figure("frame by frame, 6660 Hz", rates[6660.0], "ns/sample/axis"),
        Figure("sums of six axes at 6660 Hz", load[6660.0], "% of a core"),
        Figure(f"peak memory, {high:.0e} samples", memory[max(memory)], "MiB", goal=400.0),
        Figure("memory beyond the first tenth", memory[most] - memory[most // 10], "MiB", 20.0),
    ]
    written(
        figures,
        options.json,
        ns_by_length=lengths,
        ns_by_axes=axes,
        ns_by_taus_per_octave=taus,
        ns_by_rate=rates,
        percent_of_a_core_by_rate=load,
        mib_by_length=memory,
    )


if __name__ == "__main__":
    main()
