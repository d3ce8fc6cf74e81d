"""The noise beside effects that are known, on a record that has grown since they were found.

A search takes seconds and comes when the record has doubled; in between every refresh still has to
say what N, B and K are now. So the effects are held and the noise alone is fitted again: what an
effect adds to the samples is prolonged and subtracted, its place in the spectrum stays.

A record that grows is kept in rows of twice the samples now and then; the model is one of samples,
so it needs no translation.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from allanscope.explain.candidate import Candidate
from allanscope.explain.series import Series, series_of
from allanscope.explain.view import View
from allanscope.history import Record
from allanscope.noise import NoiseFit, fit_noise
from allanscope.noise.fit import Known
from allanscope.noise.gap_bridging import bridge_gaps
from allanscope.spectrum import Density

__all__ = ["KnownEffects", "NoiseBeside", "fit_beside", "known_of", "signals_of"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class KnownEffects:
    """What a search accepted on each axis, and the rows that it looked at.

    Attributes
    ----------
    accepted : mapping
        Axis name to its effects, none for an axis that the textbook explains.
    steps : mapping
        Axis name to the distance of the values that occur.
    stride : int
        Samples in a row.
    rate_hz, start_s : float
        Rows per second, and the time of the first.
    """

    accepted: Mapping[str, tuple[Candidate, ...]] = field(default_factory=dict)
    steps: Mapping[str, float] = field(default_factory=dict)
    stride: int = 1
    rate_hz: float = 1.0
    start_s: float = 0.0

    def in_single_precision(self) -> KnownEffects:
        """Return the same in half the memory: what is held for hours is as long as the record."""
        accepted = {
            axis: tuple(
                c if c.signal is None else replace(c, signal=c.signal.astype(np.float32))
                for c in candidates
            )
            for axis, candidates in self.accepted.items()
        }
        return replace(self, accepted=accepted)


@dataclass(frozen=True)
class NoiseBeside:
    """The noise of one axis beside the effects that are held.

    Attributes
    ----------
    fit : NoiseFit
        Coefficients and model.
    signals : mapping
        Kind of effect to what it adds to the samples, shape (n,).
    row_s : float
        Time between those samples.
    """

    fit: NoiseFit
    signals: Mapping[str, Array] = field(repr=False)
    row_s: float


def known_of(view: View) -> Known:
    """Return what a search has found, for a fit of the noise beside it.

    The ramp is left to that fit: R is a coefficient. Frequencies that the search left out hold a
    line with its profile, or what the remainder of the final model describes; only those that a
    subtracted drift has emptied stay out, and those of a tone above the rows.
    """
    effects = [c for c in view.accepted if not c.effect.is_coefficient]
    signals = [c.signal for c in effects if c.signal is not None]
    signal = view.series.at_record(np.sum(signals, axis=0)) if signals else None
    profiles = [one for c in effects for one in c.profiles]
    lines = {(one.low, one.high) for one in profiles}
    left_out = [c.excluded for c in effects if c.signal is not None or c.seen_in]
    excluded = tuple(one for ranges in left_out for one in ranges)
    doubtful = tuple(r for r in view.excluded if r not in excluded and r not in lines)
    return Known((*view.parts, *profiles), signal, excluded, doubtful)


def fit_beside(
    held: KnownEffects, record: Record, densities: Mapping[str, Density] | None = None
) -> dict[str, NoiseBeside]:
    """Fit the noise of every axis that was searched, the effects held.

    Parameters
    ----------
    held : KnownEffects
        Of an earlier search of the same run.
    record : Record
        All that is held of the run by now.
    densities : mapping of str to Density, optional
        Density of each axis, which knows more than the rows of a long run.

    Returns
    -------
    dict
        Axis name to its noise; axes that were not searched are missing.

    Raises
    ------
    ValueError
        As `series_of` and `fit_noise`.
    """
    axes = [axis for axis in record.axes if axis in held.accepted]
    if not axes:
        return {}
    record, densities = bridge_gaps(record), densities or {}
    series = series_of(record)
    found = {}
    for axis in axes:
        view = _prolonged(held, series, axis)
        fit = fit_noise(record, axis, densities.get(axis), known=known_of(view))
        found[axis] = NoiseBeside(fit, signals_of(view), 1.0 / series.rate_hz)
    return found


def signals_of(view: View) -> dict[str, Array]:
    """Return the deterministic parts of a view by kind."""
    found: dict[str, Array] = {}
    for candidate in view.accepted:
        if candidate.signal is not None:
            found[candidate.kind] = found.get(candidate.kind, 0.0) + candidate.signal
    return found


def _prolonged(held: KnownEffects, series: Series, axis: str) -> View:
    view = View.of(series, axis, step=held.steps[axis])
    ratio = max(1, round(series.stride / held.stride))
    late = (series.start_s - held.start_s) * held.rate_hz
    known = [_moved(c, ratio, late, len(series)) for c in held.accepted[axis]]
    # Processes first: a signal is estimated beside the noise that the others leave.
    for candidate in sorted(known, key=lambda c: c.signal is not None):
        view = view.accept(candidate.effect.prolong(view, candidate))
    return view


def _moved(candidate: Candidate, ratio: int, late: float, rows: int) -> Candidate:
    """Put an effect on rows of `ratio` times the samples that begin `late` old rows later."""
    if candidate.signal is None:
        return candidate
    return replace(candidate, signal=prolonged(candidate.signal, ratio, late, rows))


def prolonged(signal: Array, ratio: int, late: float, rows: int) -> Array:
    """Return the means of a signal over `ratio` rows each; after its end the last value stays.

    >>> prolonged(np.array([0.0, 0.0, 1.0, 3.0]), 2, 0.0, 3)
    array([0., 2., 3.])
    """
    edges = late + ratio * np.arange(rows + 1, dtype=np.float64)
    total = np.concatenate([[0.0], np.cumsum(signal, dtype=np.float64)])
    inside = np.interp(edges, np.arange(len(total)), total)
    inside += signal[-1] * np.maximum(edges - len(signal), 0.0)
    inside += signal[0] * np.minimum(edges, 0.0)
    return np.asarray(np.diff(inside) / ratio)
