"""A made-up session for the report: two axes, their samples, two marks."""

from dataclasses import replace

import numpy as np

from allanscope.history import Record
from support.demo_analysis import demo_analysis

AXES = ("gx", "ax")


def two_axes(duration_s=7300.0, seed=1):
    """Return the demo's result of gx and ax, with a record of 20 s."""
    whole = demo_analysis(duration_s, seed)
    rng = np.random.default_rng(seed)
    rows = 2000
    record = Record(
        rate_hz=100.0,
        stride=1,
        axes=AXES,
        values=rng.standard_normal((rows, 2)) * [0.03, 6e-4] + [0.31, 0.02],
        lsb=(4.375e-3, 61e-6),
        temperature_c=np.full(rows, 25.0),
        start_s=np.arange(rows) / 100.0,
        segments=np.array([[0, rows]]),
    )
    facts = {**whole.input, "path": "/data/my session", "sha256": "ab" * 32}
    return replace(
        whole,
        input=facts,
        axes={name: whole.axes[name] for name in AXES},
        record=record,
        marks=((5.0, "fan off"), (12.0, "door")),
    )
