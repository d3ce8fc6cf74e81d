"""The error that is left, against that of an oracle who was told what is hidden.

The error is held out: the model of one run is asked to describe other runs of the same axis, with
other noise and the same effects. It is the rms over taus of measured / modelled Allan deviation - 1
(the figure (b) of the report), and the other runs are the same for the loop and for the oracle.

- *The loop* hands over its model after, and the signal that it took out. What of the true signal it
  left in, or took too much, is in every other run as well, because it is subtracted there too.
- *The oracle* is told the kind of the effect and the axis, that it is there, and that nothing else
  is; size and place it must estimate from the same samples.
- *The omniscient oracle* subtracts the true signal and fits the noise to what is left. Near the
  limit of detection nobody can reach it: a size known to a fifth leaves a fifth of the signal.

The rms of the run itself would not do: a wrong slow signal can make that curve look better than the
truth does, and at the longest taus sampling alone moves the ratio of two honest fits by far more
than 5 %.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import blind_generator as generator
import numpy as np
from blind_effects import OUTSIDE, Truth
from numpy.typing import NDArray

from allanscope.explain import Budget, Explanation, explain
from allanscope.explain.series import deviation_of

_RUNS = 4
_FREE = 1e3
"""Nats that the oracle has to spend: it need not be convinced that the effect is there."""
_LONGEST = 3
"""The longest tau is a third of the run."""


@dataclass(frozen=True)
class Errors:
    """Held-out errors on one axis: of the loop, of the oracle, and of the omniscient oracle."""

    loop: float
    oracle: float
    omniscient: float


def errors_of(
    blind: generator.Blind, result: Explanation, truth: Truth, seed: int
) -> Errors | None:
    """Return the errors on the axis of an effect.

    None where there is no such axis or kind, or nothing to search without the effect.
    """
    if not truth.axis or truth.kind in OUTSIDE:
        return None
    used = len(result.cleaned[truth.axis])
    hidden = np.zeros(len(blind.record.values))
    if truth.signal is not None and truth.again is None:
        hidden = truth.signal
    rng = np.random.default_rng([seed, 5])
    runs = [generator.another_run(blind, truth, rng)[:used] for _ in range(_RUNS)]
    error = partial(_error, runs, blind.record.rate_hz, truth.axis)
    told = _told(blind, truth, {truth.kind})
    loop, oracle = error(result, hidden[:used]), error(told, hidden[:used])
    if not hidden.any():
        return Errors(loop, oracle, oracle)
    known = _told(_without(blind, truth, hidden), truth, set())
    if truth.axis not in known.models_after:  # values that hardly change
        return None
    return Errors(loop, oracle, error(known, np.zeros(used)))


def _told(blind: generator.Blind, truth: Truth, kinds: set[str]) -> Explanation:
    """Explain the axis by the given kinds, and by what all axes have."""
    kinds = kinds | {t.kind for t in blind.truths if not t.axis}
    axes = [truth.axis]
    if truth.kind in kinds and "source" in truth.parameters:
        axes.append(str(truth.parameters["source"]))
    columns = [blind.record.axes.index(axis) for axis in axes]
    record = replace(
        blind.record,
        axes=tuple(axes),
        values=blind.record.values[:, columns],
        lsb=tuple(blind.record.lsb[column] for column in columns),
    )
    return explain(
        record, budget=Budget(effects=len(kinds), kinds=frozenset(kinds), spent_nats=-_FREE)
    )


def _without(blind: generator.Blind, truth: Truth, signal: NDArray[np.float64]) -> generator.Blind:
    values = blind.record.values.copy()
    values[:, blind.record.axes.index(truth.axis)] -= signal
    return replace(blind, record=replace(blind.record, values=values))


def _error(
    runs: list[NDArray[np.float64]],
    rate: float,
    axis: str,
    result: Explanation,
    hidden: NDArray[np.float64],
) -> float:
    """Return the rms over runs and taus of measured / modelled - 1."""
    left = hidden - sum(result.signals[axis].values(), np.zeros(len(hidden)))
    squares = []
    for run in runs:
        curve = deviation_of((run + left)[:, np.newaxis], rate).axis(0)
        m = curve.m[curve.m <= len(run) // _LONGEST]
        modelled = result.models_after[axis].deviation("oadev", m)
        squares.append(np.mean((curve.deviation[: len(m)] / modelled - 1) ** 2))
    return float(np.sqrt(np.mean(squares)))
