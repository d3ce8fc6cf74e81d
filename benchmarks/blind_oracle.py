"""The error that is left, against that of an oracle who was told what is hidden.

The error is held out: the model of one run is asked to describe other runs of the same axis, with
other noise and the same effects. It is the rms over taus of measured / modelled Allan deviation - 1
(the figure (b) of the report), and the other runs are the same for the loop and for the oracle.

- *The loop* hands over its model after, and the signal that it took out. What of the true signal it
  left in, or took too much, is in every other run as well, because it is subtracted there too.
- *The oracle* subtracts the true signal and fits what is left; or, where the effect is noise of its
  own, is told its kind and fits that. It has the same samples to fit its noise to.

The rms of the run itself would not do: a wrong slow signal can make that curve look better than the
truth does, and at the longest taus sampling alone moves the ratio of two honest fits by far more
than 5 %.
"""

from __future__ import annotations

from dataclasses import replace

import blind_generator as generator
import numpy as np
from blind_effects import OUTSIDE, Truth
from numpy.typing import NDArray

from allanscope.explain import Budget, Explanation, explain
from allanscope.explain.error import deviation_of
from allanscope.noise.model import NoiseModel

_RUNS = 4
_LONGEST = 3
"""The longest tau is a third of the run."""


def error_over_oracle(
    blind: generator.Blind, result: Explanation, truth: Truth, seed: int
) -> float | None:
    """Return our held-out error over the oracle's; None where there is no such axis or kind."""
    if not truth.axis or truth.kind in OUTSIDE:
        return None
    axis, hidden = truth.axis, truth.signal if truth.again is None else None
    column = blind.record.axes.index(axis)
    values = blind.record.values[:, [column]]
    kinds = {t.kind for t in blind.truths if not t.axis}
    if hidden is None:
        kinds.add(truth.kind)
    else:
        values = values - hidden[:, np.newaxis]
    alone = replace(blind.record, axes=(axis,), values=values, lsb=(blind.record.lsb[column],))
    told = explain(alone, budget=Budget(kinds=frozenset(kinds)))
    used = len(result.cleaned[axis])
    left = np.zeros(used) if hidden is None else hidden[:used].copy()
    for signal in result.signals[axis].values():
        left -= signal
    rng = np.random.default_rng([seed, 5])
    runs = [generator.another_run(blind, truth, rng)[:used] for _ in range(_RUNS)]
    rate = blind.record.rate_hz
    ours = _error([run + left for run in runs], rate, result.models_after[axis])
    return ours / _error(runs, rate, told.models_after[axis])


def _error(runs: list[NDArray[np.float64]], rate: float, model: NoiseModel) -> float:
    """Return the rms over runs and taus of measured / model - 1."""
    squares = []
    for run in runs:
        curve = deviation_of(run, rate)
        m = curve.m[curve.m <= len(run) // _LONGEST]
        ratio = curve.deviation[: len(m)] / model.deviation("oadev", m)
        squares.append(np.mean((ratio - 1) ** 2))
    return float(np.sqrt(np.mean(squares)))
