r"""The whitening domain: the noise of one axis fitted to its ordinates, and evaluated at each.

Matched filters for steps and boxes at every instant at once follow from it: the score of a unit
step at sample t is a running sum of the inverse cosine transform of d/lambda, and its information
follows from one cosine sum,

.. math:: n I(t) = F(0) - F(2t), \qquad F(u) = \sum_k q_k \cos(\pi k u / n), \quad
          q_k = \frac{1}{4 \lambda_k \sin^2(\pi k / 2n)}

and a box from a to b is the difference of two steps,
:math:`n I(a, b) = 2F(0) - F(2a) - F(2b) - 2F(b - a) + 2F(a + b)`.

A stretch of loud noise (found later, as `variance_change`) makes the level move more there than a
stationary model lets expect: what is gained is divided by the `local_power_ratio` around it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct, idct

from allanscope.lazy import once
from allanscope.noise import NoiseModel
from allanscope.noise.amplitudes import maximise
from allanscope.noise.components import Component
from allanscope.noise.evidence import Ordinates
from allanscope.noise.filters import combined_response
from allanscope.noise.grid import Grid, Ranges
from allanscope.noise.likelihood import Basis, Fit, Likelihood
from allanscope.noise.part import Filter, Part

__all__ = [
    "Place",
    "Spectrum",
    "SpectrumFitter",
    "StepScan",
    "ends_of",
    "instants_before",
    "local_power_ratio",
]

Array = NDArray[np.float64]

Evaluation = Callable[[Component], Array]
Passing = Callable[[Component, Array], Array]

_CLEARLY = 1.5
"""Power of a part over that of all which its scatter does not explain."""
_ROUNDING = 1e-12
"""Share of the information that rounding leaves of none."""
_DARK = 3e-3
"""Response of a filter with zeros below which there is nothing but leakage, which no signal is
measured by."""
_OUT = 0.025
"""Probability on each side of the interval of a place."""
_AROUND_S, _AROUND_ROWS = 30.0, 200
"""A level is compared over so many seconds: noise farther away does not move it. The power of so
many rows at the least scatters by an eighth."""


@dataclass(frozen=True, eq=False)
class Spectrum:
    """A fitted noise spectrum.

    Attributes
    ----------
    fit : Fit
        Maximum of the likelihood of the bins.
    excluded : tuple of (low, high)
        Left out of it.
    """

    grid: Grid
    fit: Fit
    excluded: Ranges = ()

    @property
    def model(self) -> NoiseModel:
        """The fitted model."""
        return self.fit.model

    @property
    def loglik(self) -> float:
        """Whittle log-likelihood at the maximum."""
        return self.fit.loglik

    @once
    def powers(self) -> Array:
        """Squared amplitudes, from which another fit may start."""
        return np.array([c.power for c in self.model if c.has_amplitude])

    def first(self, m: int) -> Array:
        """Variances of the first m ordinates."""
        if m > self.grid.low:
            return self.ordinates[:m]
        grid, frequency = self.grid, self.grid.frequency[:m]
        passed = self.model.passing_with(lambda one: grid.first_response(one)[:m])
        return self._sum(self.model, lambda c: grid.first(c, m), frequency, passed)

    def at(self, frequency: Array) -> Array:
        """Variance of a DCT ordinate at given frequencies (two-sided density times the rate)."""
        return self.of(self.model, frequency)

    def of(self, components: Iterable[Component], frequency: Array) -> Array:
        """Return what some of the components contribute to that, behind the filters."""
        return self.split([components], frequency)[0]

    def split(self, groups: Iterable[Iterable[Component]], frequency: Array) -> list[Array]:
        """Return the same of several groups of components, which pass the filters once."""
        passed, at = self.model.passing(frequency), cache(lambda c: self.grid.at(c, frequency))
        return [self._sum(group, at, frequency, passed) for group in groups]

    def _sum(
        self, components: Iterable[Component], of: Evaluation, frequency: Array, passed: Passing
    ) -> Array:
        total, floor = np.zeros_like(frequency), np.zeros_like(frequency)
        zeros = any(one.has_zeros for one in self.model.filters)
        for component in components:
            part = of(component)
            if zeros:
                floor += _DARK * part
            total += passed(component, part)
        return np.maximum(total, floor)

    @once
    def ordinates(self) -> Array:
        """Variance of every ordinate, shape (n - 1,).

        The first ones are exact, those further up interpolated, but for filters with ripples.
        """
        grid, model, every = self.grid, self.model, self.grid.frequency
        nodes = grid.nodes_beside(peak for one in model for peak in one.peaks)
        at = nodes * (grid.rate_hz / (2 * grid.n))

        def of(one: Component) -> Array:
            # In a record shorter than it lasts, a peak has other even than odd ordinates.
            return one.spectrum(at, grid.dt, grid.stride) if one.peaks else grid.at(one, at)

        if any(one.has_ripples for one in model.filters):
            passed = model.passing(every)
            total = self._sum(model, lambda one: grid.interpolate(of(one), nodes), every, passed)
        else:
            total = grid.interpolate(self._sum(model, of, at, model.passing(at)), nodes)
        total[: grid.low] = self.first(grid.low)
        return total

    @once
    def kept(self) -> NDArray[np.bool_]:
        """Ordinates that take part in the fit."""
        return self.grid.kept(self.excluded)

    @once
    def outside_zeros(self) -> NDArray[np.bool_]:
        """Those of them that are not at a zero of a filter, where what leaks in is all there is."""
        lit = self.kept
        for one in self.model.filters:
            if one.has_zeros:
                lit = lit & (one.response(self.grid.frequency, self.grid.dt) > _DARK)
        return lit

    def loglik_of(self, power: Array) -> float:
        """Log-likelihood of other binned power (mean square ordinates) under this spectrum."""
        dof, expected = self.fit.likelihood.dof, self.fit.expected
        return float(-0.5 * np.sum(dof * (np.log(expected) + power / expected)))


@dataclass(frozen=True, eq=False)
class SpectrumFitter:
    """Fits the amplitudes of one model to binned powers by maximum likelihood, shapes held.

    A search fits the same model to other powers, and the same powers with one part more, again and
    again: what does not depend on either is computed once.

    Attributes
    ----------
    basis : Basis
        What the amplitudes of the model multiply.
    dof : ndarray, shape (bins,)
        Ordinates of each bin that take part.
    excluded : tuple of (low, high)
        Frequencies in Hz that are left out.
    """

    grid: Grid
    basis: Basis
    dof: Array
    excluded: Ranges = ()

    @classmethod
    def of(cls, grid: Grid, model: NoiseModel, excluded: Ranges = ()) -> SpectrumFitter:
        """Return what fits a model of the samples behind the rows."""
        dof = grid.counts(excluded)
        likelihood = Likelihood([Ordinates(grid, np.ones(len(dof)), dof)])
        return cls(grid, likelihood.basis(model, model.shapes), dof, excluded)

    def plus(self, *parts: Part) -> SpectrumFitter:
        """Return what fits the model with more parts; of components only these are computed."""
        model = self.basis.model.plus(*parts)
        if any(isinstance(part, Filter) for part in parts):
            if self.is_bare and all(isinstance(part, Filter) for part in parts):
                fixed, columns = self._behind(model.filters_on)
                held = model.shapes
                return replace(
                    self,
                    basis=replace(self.basis, model=model, held=held, columns=columns, fixed=fixed),
                )
            return SpectrumFitter.of(self.grid, model, self.excluded)
        likelihood = self._likelihood(np.ones(len(self.dof)))
        return replace(self, basis=likelihood.extended(self.basis, model, model.shapes))

    @property
    def is_bare(self) -> bool:
        """Whether filters may be added to what is known: there are none, and one fixed part."""
        return not self.basis.model.filters and self.basis.free.count(False) <= 1

    def _behind(self, filters_on: Callable[[Component], tuple[Filter, ...]]) -> tuple[Array, Array]:
        """Return the fixed part and the columns behind filters, of which the model has none."""

        @cache
        def passed(filters: tuple[Filter, ...]) -> Array | np.float64:
            return combined_response(filters, self.grid.dt, self.grid.response)

        fixed, columns = self.basis.fixed, self.basis.columns.copy()
        left = iter(columns)
        for component, is_free in zip(self.basis.model, self.basis.free, strict=True):
            column = next(left) if is_free else None
            filters = filters_on(component)
            if filters and column is not None:
                column *= passed(filters)
            elif filters:
                fixed = fixed * passed(filters)
        return fixed, columns

    def fit(self, power: Array, start: Array | None = None) -> Spectrum:
        """Return the likeliest spectrum.

        Parameters
        ----------
        power : ndarray, shape (bins,)
            Mean square of the ordinates in every bin (see `Grid.binned`).
        start : ndarray, optional
            Squared amplitudes to start from.
        """
        found = self._likelihood(power).maximum(self.basis, start)
        return Spectrum(self.grid, found, self.excluded)

    def spectrum(self, power: Array, powers: Array) -> Spectrum:
        """Return the spectrum with given squared amplitudes."""
        likelihood = self._likelihood(power)
        expected = self.basis.fixed + powers @ self.basis.columns
        found = self.basis.model_of(powers)
        fit = Fit(likelihood, found, likelihood.value(expected), self.basis.held, True, expected)
        return Spectrum(self.grid, fit, self.excluded)

    def loglik(self, power: Array, start: Array | None = None) -> float:
        """Return the log-likelihood of the spectrum that `fit` returns."""
        return self.powers(power, start)[1]

    def loglik_beside(self, component: Component, power: Array, start: Array) -> float:
        """Return the same of `plus` one component: of its basis only what the fit needs."""
        more = self._likelihood(power).column(self.basis.model, component.with_power(1.0))
        columns = np.vstack([self.basis.columns, more])
        return maximise(columns, power, self.dof, self.basis.fixed, start)[1]

    def loglik_behind(self, one: Filter, power: Array, start: Array) -> float:
        """Return the same of `plus` one filter, where the model `is_bare`."""
        fixed, columns = self._behind(lambda c: (one,) if one.acts_on(c) else ())
        return maximise(columns, power, self.dof, fixed, start)[1]

    def powers(self, power: Array, start: Array | None = None) -> tuple[Array, float]:
        """Return the squared amplitudes of that spectrum, and its log-likelihood."""
        return maximise(self.basis.columns, power, self.dof, self.basis.fixed, start)[:2]

    def first(self, powers: Array, m: int) -> Array:
        """Return `Spectrum.first` under given squared amplitudes, from a table where that does."""
        if not self.has_table(m):
            return self.spectrum(np.ones(len(self.dof)), powers).first(m)
        fixed, columns = self.table
        return np.asarray(fixed[:m] + powers @ columns[:, :m])

    def has_table(self, m: int) -> bool:
        """Return whether the first m ordinates are sums of what is in a table of each part."""
        zeros = any(one.has_zeros for one in self.basis.model.filters)
        return m <= self.grid.low and not zeros

    @once
    def table(self) -> tuple[Array, Array]:
        """Variances of the first ordinates, of the fixed parts, and of each other at a power of 1.

        The shapes are (grid.low,) and (p, grid.low).
        """
        grid, model = self.grid, self.basis.model
        passed = model.passing_with(grid.first_response)
        fixed, columns = np.zeros(grid.low), []
        for component, is_free in zip(model, self.basis.free, strict=True):
            one = component.with_power(1.0) if is_free else component
            part = passed(one, grid.first(one, grid.low))
            if is_free:
                columns.append(part)
            else:
                fixed = fixed + part
        return fixed, np.array(columns).reshape(-1, grid.low)

    def _likelihood(self, power: Array) -> Likelihood:
        return Likelihood([Ordinates(self.grid, power, self.dof)])


Ints = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Place:
    """Where a jump is, every instant being as likely beforehand.

    Where it fits best it looks largest; its size is the mean over all places, by what each gains.

    Attributes
    ----------
    best : int
        Likeliest first row after it.
    instants : ndarray
        Equally probable instants of it, in rows (`instants_before`).
    shrinkage, scatter : float
        Mean and standard deviation of the size over the places, as shares of that at the best.
    """

    best: int
    instants: Array
    shrinkage: float
    scatter: float


def instants_before(at: Ints, gain: Array) -> Array:
    """Return a hundred equally probable instants of a jump, in rows.

    The first row after a jump is known only: the jump is anywhere since the row before.

    Parameters
    ----------
    at : ndarray of int64, shape (m,)
        First rows after it that were tried, which stand for all rows since the one tried before.
    gain : ndarray, shape (m,)
        Log-likelihood of each.

    Examples
    --------
    >>> sure = instants_before(np.array([6, 7, 8]), np.array([-50.0, 0.0, -50.0]))
    >>> float(sure.min()), float(sure.max())
    (6.005, 6.995)
    """
    apart = np.diff(at, prepend=at[0] - 1)
    below = np.concatenate([[0.0], np.cumsum(apart * np.exp(gain - gain.max()))])
    borders = np.concatenate([at[:1] - 1, at])
    return np.asarray(np.interp((np.arange(100) + 0.5) / 100 * below[-1], below, borders))


def ends_of(instants: Array) -> tuple[float, float]:
    """Return the interval that holds 95 of a hundred equally probable values."""
    low, high = np.quantile(instants, [_OUT, 1 - _OUT], method="hazen").tolist()
    return low, high


class StepScan:
    """Gains in nats of steps and boxes in a series of given ordinates under a noise spectrum."""

    def __init__(self, grid: Grid, ordinates: Array, spectrum: Spectrum) -> None:
        self.n, self.cells = grid.n, grid.low
        weight = spectrum.kept / spectrum.ordinates
        white = np.zeros(grid.n)
        np.multiply(ordinates, weight, out=white[1:])
        self.score = np.zeros(grid.n + 1)
        np.cumsum(idct(white, norm="ortho", overwrite_x=True), out=self.score[1:])
        k = np.arange(1, self.cells + 1)
        q = np.concatenate(
            [[0.0], weight[: self.cells] / (2 * np.sin(np.pi * k / (2 * grid.n))) ** 2]
        )
        self._cells = np.asarray(dct(np.append(q[:-1], 2 * q[-1]), type=1)) / 2

    def _sum(self, at: Ints) -> Array:
        """F at 0 to 2 n samples, even about n; linear between the cells."""
        within = np.minimum(at, 2 * self.n - at) * (self.cells / self.n)
        return np.interp(within, np.arange(self.cells + 1), self._cells)

    def step(self, at: Ints) -> Array:
        """Gain of a step at samples `at`."""
        return self._gain(*self._of_step(at))

    def boxes(self, first: range, rows: int) -> Array:
        """Gain of boxes of so many rows that begin at evenly spaced samples."""
        begin, end, step = first.start, first.stop, first.step
        at = np.arange(begin, end, step)
        information = self._information_of_box(at, at + rows)
        score = self.score[begin:end:step] - self.score[begin + rows : end + rows : step]
        return self._gain(score, information)

    def place_of_step(self, at: Ints) -> Place:
        """Return where among samples a step is."""
        return self._place(at, *self._of_step(at))

    def place_of_box(self, first: Ints, last: Ints, at: Ints) -> Place:
        """Return where among samples the border of a box is that is one of both."""
        return self._place(at, *self._of_box(first, last))

    def _of_step(self, at: Ints) -> tuple[Array, Array]:
        """Return scores and information."""
        return self.score[at], (self._cells[0] - self._sum(2 * at)) / self.n

    def _of_box(self, first: Ints, last: Ints) -> tuple[Array, Array]:
        return self.score[first] - self.score[last], self._information_of_box(first, last)

    def _information_of_box(self, first: Ints, last: Ints) -> Array:
        edges = 2 * self._cells[0] - self._sum(2 * first) - self._sum(2 * last)
        total = edges - 2 * self._sum(last - first) + 2 * self._sum(first + last)
        return np.asarray(total / self.n)

    def _gain(self, score: Array, information: Array) -> Array:
        """Gain of what has a score, none where all that would know is left out of the fit."""
        return self._size(score, information) * score / 2

    def _size(self, score: Array, information: Array) -> Array:
        is_known = information * self.n > _ROUNDING * self._cells[0]
        return np.divide(score, information, out=np.zeros(len(score)), where=is_known)

    def _place(self, at: Ints, score: Array, information: Array) -> Place:
        size = self._size(score, information)
        gain = size * score / 2
        top = int(np.argmax(gain))
        weight = np.exp(gain - gain[top])
        weight /= weight.sum()
        share = size / size[top] if size[top] else np.ones(len(size))
        mean = float(weight @ share)
        scatter = float(np.sqrt(max(weight @ share**2 - mean**2, 0.0)))
        return Place(int(at[top]), instants_before(at, gain), mean, scatter)


def local_power_ratio(data: Array, rate_hz: float, first: int, last: int) -> float:
    """Return the white power around samples `first` to `last` over that of all, 1 at the least.

    Where it is clearly louder before, between or after them, that part decides.
    """
    reach = max(int(_AROUND_S * rate_hz), _AROUND_ROWS)
    squares = np.diff(data) ** 2
    everywhere = float(np.mean(squares))
    if everywhere <= 0:
        return 1.0
    before, after = max(0, first - reach), last + reach
    parts = [squares[a:b] for a, b in ((before, first), (first, last), (last, after))]
    loudest = max(float(np.mean(part)) for part in parts if len(part)) / everywhere
    around = float(np.mean(squares[before:after])) / everywhere
    return max(1.0, loudest if loudest > _CLEARLY else around)
