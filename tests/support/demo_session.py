"""A made-up session, told to a listener as the pipeline would tell it."""

from __future__ import annotations

import numpy as np

from allanscope.samples import AXES, Block, Gap, Notice, StreamInfo, Ticks
from support.demo_analysis import RATE_HZ, demo_analysis

SCALE = (8.75e-3,) * 3 + (0.061e-3,) * 3
INFO = StreamInfo(AXES, SCALE, nominal_hz=6660.0, part="LSM6DSM", wire="native", device_clock=True)
LEVELS = (0.31, -1.2, 0.6, 0.012, -0.031, 1.004)
SIGMAS = (0.21, 0.24, 0.19, 3.6e-3, 3.2e-3, 4.8e-3)


def blocks(duration_s: float, seed: int = 3):
    """Yield one Block a second of white noise about a level, warming up."""
    rng = np.random.default_rng(seed)
    n = round(RATE_HZ)
    noise = rng.standard_normal((40 * n, 6)) * SIGMAS
    for second in range(int(duration_s)):
        start = rng.integers(0, 39 * n)
        warm = np.exp(-second / 720.0) * np.array([0, 0, -0.4, 0, 0, 2e-3])
        counts = np.round((noise[start : start + n] + LEVELS + warm) / SCALE).astype(np.int16)
        ticks = Ticks(
            np.array([0]),
            np.array([float(second)]),
            np.array([100.0 + second]),
            np.array([31.6 - 7.5 * np.exp(-second / 900.0)]),
        )
        yield Block(second * n, counts, ticks)


def perform(view, duration_s: float = 7300.0) -> None:
    """Tell a view a whole session."""
    view.info(INFO)
    view.notice(Notice("text", "firmware 2.1.0, LSM6DSM, 6660 Hz, 250 dps, 2 g"))
    gap_at, mark_at, due = 900, 600, 1.0
    for second, block in enumerate(blocks(duration_s)):
        if second == gap_at:
            view.gap(Gap("device", 1998))
        if second == mark_at:
            view.notice(Notice("mark", "fan off"))
        view.samples(INFO, block)
        if second % 20 == 0:
            produced = round((second + 1) * RATE_HZ)
            sent = produced - (1998 if second >= gap_at else 0)
            view.notice(Notice("status", "ok", {"produced": produced, "dropped": produced - sent}))
        if second + 1 >= due:
            view.snapshot(demo_analysis(second + 1.0))
            due *= 1.06
            view.settle()
    view.snapshot(demo_analysis(duration_s))
