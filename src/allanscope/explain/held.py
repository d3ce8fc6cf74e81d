r"""The noise beside effects that are known, on a record that has grown since they were found.

A search takes seconds and comes when the record has doubled; in between every refresh still has to
say what N, B and K are now. So the effects are held and the noise alone is fitted again: what an
effect adds to the samples is prolonged and subtracted, its place in the spectrum stays.

A record that grows is kept in rows of twice the samples now and then. With r old rows in a new one,
what was at x_j (j = 0 .. r-1, the frequencies that alias to f) is now at f, and a process with the
ordinates S has

.. math:: S_r(f) = \frac{1}{r} \sum_j S(x_j) D(x_j), \qquad
          D(x) = \frac{\sin^2(\pi r x / f_s)}{r^2 \sin^2(\pi x / f_s)}.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from allanscope.explain.candidate import Candidate
from allanscope.explain.coefficients import coefficients_of
from allanscope.explain.effects import KINDS
from allanscope.explain.grid import grid_of
from allanscope.explain.models import model_of
from allanscope.explain.series import Series, series_of
from allanscope.explain.spectral import Term
from allanscope.explain.view import View
from allanscope.history import Record
from allanscope.noise.model import NoiseModel

if TYPE_CHECKING:
    from allanscope.noise.coefficients import Coefficient

__all__ = ["HeldEffects", "NoiseBeside", "fit_beside"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class HeldEffects:
    """What a search accepted on each axis, and the rows that it looked at.

    Attributes
    ----------
    accepted : mapping
        Axis name to its effects; only axes that have one of their own.
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


@dataclass(frozen=True)
class NoiseBeside:
    """The noise of one axis beside the effects that are held.

    Attributes
    ----------
    coefficients : mapping
        Q, N, B, K, R.
    model : NoiseModel
        What was fitted, the effects' own noise included.
    signals : mapping
        Kind of effect to what it adds to the samples, shape (n,).
    row_s : float
        Time between those samples.
    """

    coefficients: Mapping[str, Coefficient]
    model: NoiseModel
    signals: Mapping[str, Array] = field(repr=False)
    row_s: float


def fit_beside(held: HeldEffects, record: Record) -> dict[str, NoiseBeside]:
    """Fit the noise of every axis that has effects, the effects held.

    Parameters
    ----------
    held : HeldEffects
        Of an earlier search of the same run.
    record : Record
        All that is held of the run by now.

    Returns
    -------
    dict
        Axis name to its noise; axes without effects of their own are missing.

    Raises
    ------
    ValueError
        As `series_of`.
    """
    axes = [axis for axis in record.axes if axis in held.accepted]
    if not axes:
        return {}
    series = series_of(record)
    return {axis: _beside(held, series, axis) for axis in axes}


def _beside(held: HeldEffects, series: Series, axis: str) -> NoiseBeside:
    samples = np.ascontiguousarray(series.values[:, series.column(axis)])
    view = View(series, grid_of(len(series), series.rate_hz), axis, samples, held.steps[axis])
    ratio = max(1, round(series.stride / held.stride))
    late = (series.start_s - held.start_s) * held.rate_hz
    base_hz = ratio * series.rate_hz
    known = [_moved(c, base_hz, ratio, late, len(series)) for c in held.accepted[axis]]
    # Processes first: a signal is estimated beside the noise that the others leave.
    for candidate in sorted(known, key=lambda c: c.signal is not None):
        view = view.accept(KINDS[candidate.kind].prolong(view, candidate))
    signals: dict[str, Array] = {}
    for candidate in view.accepted:
        if candidate.signal is not None:
            signals[candidate.kind] = signals.get(candidate.kind, 0.0) + candidate.signal
    drawn = replace(view.spectrum, terms=tuple(_unfolded(t) for t in view.spectrum.terms))
    return NoiseBeside(coefficients_of(view), model_of(view, drawn), signals, 1.0 / series.rate_hz)


def _moved(candidate: Candidate, base_hz: float, ratio: int, late: float, rows: int) -> Candidate:
    """Put an effect on rows of `ratio` times the samples that begin `late` old rows later."""
    signal, terms = candidate.signal, candidate.terms
    if signal is not None:
        signal = prolonged(signal, ratio, late, rows)
    if ratio > 1:
        terms = tuple(replace(t, shape=Folded(t.shape, t.role, base_hz)) for t in terms)
    return replace(candidate, signal=signal, terms=terms)


def prolonged(signal: Array, ratio: int, late: float, rows: int) -> Array:
    """Return the means of a signal over `ratio` rows each; after its end the last value stays.

    >>> prolonged(np.array([0.0, 0.0, 1.0, 3.0]), 2, 0.0, 3)
    array([0., 2., 3.])
    """
    edges = late + ratio * np.arange(rows + 1, dtype=np.float64)
    total = np.concatenate([[0.0], np.cumsum(signal)])
    inside = np.interp(edges, np.arange(len(total)), total)
    inside += signal[-1] * np.maximum(edges - len(signal), 0.0)
    inside += signal[0] * np.minimum(edges, 0.0)
    return np.asarray(np.diff(inside) / ratio)


@dataclass(frozen=True)
class Folded:
    """The shape of a term, seen in rows that are means of the rows for which it was found.

    Parameters
    ----------
    shape : callable
        As in `Term`.
    role : str
        As in `Term`.
    base_hz : float
        Rate of the rows for which it holds.
    """

    shape: Callable[[Array, float, tuple[float, ...]], Array]
    role: str
    base_hz: float

    @property
    def __name__(self) -> str:
        """Name of the shape itself."""
        return str(self.shape.__name__)

    def __call__(self, frequency: Array, rate_hz: float, nonlinear: tuple[float, ...]) -> Array:
        """Evaluate the shape in rows of another rate."""
        ratio = max(1, round(self.base_hz / rate_hz))
        base_hz = ratio * rate_hz
        total = np.ones_like(frequency) if self.role == "excludes" else np.zeros_like(frequency)
        for j in range(ratio):
            image = frequency + j * rate_hz
            image = np.minimum(image, base_hz - image)
            value = self.shape(image, base_hz, nonlinear)
            if self.role == "excludes":
                total *= value
            else:
                total += value * _block_mean(image / base_hz, ratio)
        return total / ratio if self.role == "adds" else total


def _block_mean(x: Array, ratio: int) -> Array:
    """Power response of the mean of so many rows, at a frequency in units of their rate."""
    below = ratio * np.sin(np.pi * x)
    return np.asarray(np.divide(np.sin(np.pi * ratio * x), below, out=np.ones_like(x),
                                where=np.abs(below) > 1e-12) ** 2)  # fmt: skip


def _unfolded(term: Term) -> Term:
    """Return a term with its own shape: a model is asked at samples, not at rows."""
    return replace(term, shape=term.shape.shape) if isinstance(term.shape, Folded) else term
