"""Deterministic signals by generalised least squares, the noise refitted along with them.

A score test under the null fit is masked: what is missing inflates K and hides itself. Here the
noise is fitted jointly with the amplitudes, and the gain is the ratio of two maximised likelihoods.

All slow effects of an axis are solved in one regression. A warm-up that is fitted alone takes along
what belongs to the temperature, and the temperature that is fitted to the rest then fails in the
quarter where the warm-up was. Together they share the level as the data do, each has the error that
it has beside the others, and gains what it gains when all others are free to take its place.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct

from allanscope.compiled import Pointer, kernel
from allanscope.explain.candidate import Candidate
from allanscope.explain.effect import Estimate
from allanscope.explain.spectrum import Spectrum, SpectrumFitter
from allanscope.explain.view import View
from allanscope.lazy import once
from allanscope.noise.amplitudes import least_power
from allanscope.noise.grid import Grid, Ranges
from allanscope.noise.likelihood import inverse
from allanscope.noise.part import Filter
from allanscope.quantities import CHI_SQUARE_95, TWO_SIDED_95

__all__ = [
    "Regression",
    "exponential_ordinates",
    "joint_fit",
    "likely_interval",
    "likely_time",
    "marginal_covariance",
    "ordinates_of",
    "ramp_ordinates",
    "reach_at_95",
    "refit_jointly",
    "restricted_loglik",
    "step_ordinates",
    "with_likely_times",
]

Array = NDArray[np.float64]
_IN, _MATRIX, _EDGES = Pointer(np.float64, 1), Pointer(np.float64, 2), Pointer(np.int64, 1)
_OUT = Pointer(np.float64, 1, written=True)
_fit_loop = kernel(
    "fit_signal",
    *(_IN, _IN, _IN, _IN, _MATRIX, int, int, _EDGES, _IN, int, _MATRIX, _IN, _IN, int, int),
    *(float, int, float, _OUT, _OUT, _OUT, _OUT),
    returns=float,
)

_ROUNDS = 8
"""Most turns of amplitudes and noise."""
_CLOSE = 1e-3
"""Nats by which the last of them may change the log-likelihood."""
_STEPS, _FARTHEST = 12, 30.0
"""Most turns of the search for the end of an interval, and its end in standard errors."""
_ERRORS, _FARTHEST_LOG, _TERMS = 5.0, 3.0, 21
"""Reach of the log of a time constant over which its likelihood is summed, in errors and at the
most, and terms."""
_TAIL = 0.025
"""Probability on each side of its interval."""
_TURNS = 12
"""Most turns of a joint regression of several effects."""
_SETTLED = 3e-3
"""Largest relative change of a time constant in the last turn."""


@dataclass(frozen=True, eq=False)
class Regression:
    """Amplitudes of given signals with the noise refitted.

    Attributes
    ----------
    amplitude : ndarray, shape (p,)
    covariance : ndarray, shape (p, p)
    gain : float
        Log-likelihood against no signal, both at their own best noise.
    fitter : SpectrumFitter
        What fits the noise.
    power, powers : ndarray
        Mean square of every bin without the signals, and the squared amplitudes fitted to it.
    """

    amplitude: Array
    covariance: Array
    gain: float
    fitter: SpectrumFitter
    power: Array
    powers: Array

    @once
    def spectrum(self) -> Spectrum:
        """The noise beside the signals."""
        return self.fitter.spectrum(self.power, self.powers)


def ordinates_of(signal: Array) -> Array:
    """DCT-II ordinates of a signal, mean removed, shape (n - 1,)."""
    return np.asarray(dct(signal - signal.mean(), norm="ortho")[1:])


def step_ordinates(grid: Grid, at: int, size: int) -> Array:
    """First ordinates of a unit step at sample `at`, in closed form."""
    return np.asarray(-np.sqrt(2 / grid.n) * _sine(grid, at, size) / (2 * _halves(grid, size)[1]))


@lru_cache(maxsize=4)
def _halves(grid: Grid, size: int) -> tuple[Array, Array, Array]:
    """Return cos and sin of half the phase from one sample to the next, and the sign at the end."""
    half = 0.5 * _phases(grid, size)
    return np.cos(half), np.sin(half), np.where(np.arange(1, size + 1) % 2, -1.0, 1.0)


@lru_cache(maxsize=4)
def _phases(grid: Grid, size: int) -> Array:
    """Return by what the first cosines go on from one sample to the next, in rad."""
    return np.pi * np.arange(1, size + 1) / grid.n


@lru_cache(maxsize=4)  # a step and what relaxes after it begin together, many with the record
def _sine(grid: Grid, at: int, size: int) -> Array:
    """Return the sine of the phase in which the first cosines are at sample `at`."""
    return np.asarray(np.sin(_phases(grid, size) * at))


@lru_cache(maxsize=4)
def _cosine(grid: Grid, at: int, size: int) -> Array:
    """Return its cosine."""
    return np.asarray(np.cos(_phases(grid, size) * at))


@lru_cache(maxsize=64)  # every axis is searched for the same few time constants
def exponential_ordinates(grid: Grid, tau: float, size: int) -> Array:
    """First ordinates of exp(-t / tau)."""
    found = relaxing_ordinates(grid, 0, tau, size)
    found.flags.writeable = False
    return found


def relaxing_ordinates(grid: Grid, at: int, tau: float, size: int) -> Array:
    r"""First ordinates of exp(-(t - t0) / tau) from sample `at` on, in closed form.

    With the phase a from one sample to the next and f = exp(-1 / (tau rate)) they are the geometric
    series

    .. math:: \sqrt{2/n} \, \mathrm{Re} \left[ \left(e^{i a t_0} - (-1)^k f^{n - t_0}\right)
              \frac{e^{i a / 2}}{1 - f e^{i a}} \right]
    """
    cosine, sine = _cosine(grid, at, size), _sine(grid, at, size)
    real, imaginary, last = _series(grid, tau, size)
    left = float(np.exp(-(grid.n - at) / (tau * grid.rate_hz)))
    return np.asarray(real * cosine - imaginary * sine - left * last)


@lru_cache(maxsize=4)  # of one time constant every instant is tried
def _series(grid: Grid, tau: float, size: int) -> tuple[Array, Array, Array]:
    """Return both parts of what the last factor is, and the real one as it ends, all scaled."""
    cosine, sine, sign = _halves(grid, size)
    gone = -float(np.expm1(-1 / (tau * grid.rate_hz)))  # 1 - f
    scale = np.sqrt(2 / grid.n) / (gone**2 + 4 * (1 - gone) * sine**2)
    real = gone * cosine * scale
    return real, (2 - gone) * sine * scale, sign * real


def ramp_ordinates(grid: Grid, size: int) -> Array:
    """First ordinates of the time in s, in closed form: only the odd ones are not zero."""
    k = np.arange(1, size + 1)
    half = np.pi * k / (2 * grid.n)
    total = -np.sqrt(2 / grid.n) * np.cos(half) / (2 * np.sin(half) ** 2)
    return np.asarray(np.where(k % 2, total, 0.0) / grid.rate_hz)


def joint_fit(
    view: View, columns: Array, rounds: int = _ROUNDS, filters: tuple[Filter, ...] = ()
) -> Regression:
    """Fit amplitudes and noise together.

    Parameters
    ----------
    columns : ndarray, shape (p, m)
        First m ordinates of p signals; beyond m they must be negligible.
    filters : tuple of Filter
        What the noise passes beside the parts of the view; the gain is that of signals and filters.
    """
    columns = np.atleast_2d(columns)
    m = columns.shape[1]
    fitter = view.fitter.plus(*filters) if filters else view.fitter
    if len(columns) == 1 and fitter.has_table(m):
        return _fit_signal(view, columns[0], fitter, rounds)
    return _fit_in_turn(view, columns, fitter, rounds)


def _fit_in_turn(
    view: View, columns: Array, fitter: SpectrumFitter, rounds: int, *, restricted: bool = False
) -> Regression:
    """Fit amplitudes and noise in turn.

    With `restricted` what the amplitudes take of the ordinates is put back (`marginal_covariance`).
    """
    m, power = columns.shape[1], view.power.copy()
    d, low = view.ordinates[:m], _low_bins(view.grid, view.spectrum.excluded, m)
    powers, loglik = view.spectrum.powers, np.inf
    for _ in range(rounds):
        weighted = columns * (low.kept / fitter.first(powers, m))
        covariance = _inverse(weighted @ columns.T)
        amplitude = covariance @ (weighted @ d)
        squares = (d - amplitude @ columns) ** 2
        if restricted:
            squares += _taken_by(covariance, columns)
        power[: len(low.edges)] = low.means(squares)
        before = loglik
        powers, loglik = fitter.powers(power, powers)
        if abs(loglik - before) < _CLOSE:
            break
    gain = loglik - view.spectrum.loglik
    return Regression(amplitude, covariance, gain, fitter, power, powers)


def _taken_by(covariance: Array, columns: Array) -> Array:
    """Return what amplitudes are expected to take of the squares of the ordinates."""
    return np.asarray(np.sum(columns * (covariance @ columns), axis=0))


def _fit_signal(view: View, signal: Array, fitter: SpectrumFitter, rounds: int) -> Regression:
    """Do the same for one signal, as most fits are, in one compiled loop (not restricted)."""
    power, powers, found = view.power.copy(), view.spectrum.powers.copy(), np.empty(2)
    basis, low = fitter.basis, _low_bins(view.grid, view.spectrum.excluded, len(signal))
    p, bins = basis.columns.shape
    fixed, columns = fitter.table
    loglik = _fit_loop(
        *(signal, view.ordinates, low.kept, fixed, columns, len(signal), columns.shape[1]),
        *(low.edges, low.count, len(low.edges), basis.columns, fitter.dof, basis.fixed, p, bins),
        *(least_power(power), rounds, _CLOSE, powers, power, found),
        np.empty(len(signal) + bins * (p + 5) + 3 * p * (p + 6)),
    )
    information, size = found.tolist()
    covariance = np.array([[1.0 / information if information > 0.0 else 0.0]])
    gain = float(loglik) - view.spectrum.loglik
    return Regression(np.array([size]), covariance, gain, fitter, power, powers)


def _inverse(normal: Array) -> Array:
    """Return the inverse of a symmetric matrix; 0 where everything slow is cut out of the fit."""
    if normal.shape == (1, 1) and normal[0, 0] > 0.0:
        return 1.0 / normal  # as most are
    return inverse(normal)


def marginal_covariance(view: View, columns: Array, fit: Regression) -> Array:
    """Return the covariance of the amplitudes, the noise not being known.

    `Regression.covariance` takes the fitted noise for the true one. Where that happened to come out
    low (no random walk was seen) it promises several times too much: off the maximum the noise
    would have come out higher. Each amplitude is moved to where the likelihood, the noise fitted
    again, has dropped as far as it does at 95 %, and the covariance is scaled to reach there.

    Where few ordinates tell the noise, what p amplitudes have taken of it is missed. What it is
    expected to be is put back: restricted maximum likelihood (Patterson and Thompson, Biometrika
    58, 1971) by expectation and maximisation in turn.
    """
    m, power = columns.shape[1], view.power.copy()
    low = _low_bins(view.grid, view.spectrum.excluded, m)
    d, covariance, powers = view.ordinates[:m], fit.covariance, fit.powers

    def noise(amplitude: Array, taken: Array) -> tuple[Array, float]:
        power[: len(low.edges)] = low.means((d - amplitude @ columns) ** 2 + taken)
        return view.fitter.powers(power, powers)

    for _ in range(_ROUNDS):
        before = powers, covariance
        powers, _ = noise(fit.amplitude, _taken_by(covariance, columns))
        covariance = _inverse((columns * low.kept / view.fitter.first(powers, m)) @ columns.T)
        if all(map(np.array_equal, before, (powers, covariance))):
            break  # to the last bit, and so they would stay
    taken = _taken_by(covariance, columns)

    def loglik(amplitude: Array) -> float:
        return noise(amplitude, taken)[1]

    top = loglik(fit.amplitude)

    def drop(step: Array, distance: float) -> float:
        return top - loglik(fit.amplitude + distance * step)

    factors = np.ones(len(columns))
    for j, variance in enumerate(np.diag(covariance)):
        if variance > 0:
            step = covariance[j] / np.sqrt(variance)  # the others go along
            sides = [reach_at_95(partial(drop, step)), reach_at_95(partial(drop, -step))]
            factors[j] = max(1.0, float(np.mean(sides)) / TWO_SIDED_95)
    return np.asarray(covariance * np.outer(factors, factors))


def restricted_loglik(view: View, columns: Array) -> float:
    """Return the log-likelihood of the shapes of signals, whatever their amplitudes are.

    What the amplitudes take of the ordinates is put back, as in `marginal_covariance`.
    """
    fit = _fit_in_turn(view, columns, view.fitter, _ROUNDS, restricted=True)
    loglik = fit.gain + view.spectrum.loglik
    return loglik + 0.5 * float(np.linalg.slogdet(fit.covariance)[1])


def likely_time(time: Estimate, loglik: Callable[[float], float], error: float) -> Estimate:
    """Return a time constant with the interval that holds 95 % of them, as likely as they are.

    Parameters
    ----------
    time : Estimate
        The likeliest, in s.
    loglik : callable
        Log-likelihood of a time constant in s.
    error : float
        Standard error of its logarithm on a straight line, from which half and twice a time
        constant are far.

    Examples
    --------
    >>> known = Estimate(10.0, unit="s")
    >>> found = likely_time(known, lambda tc: -((np.log(tc / 10.0) / 0.1) ** 2) / 2, 0.1)
    >>> round(found.lower, 1), round(found.upper, 1)
    (8.2, 12.2)
    """
    tau, reach = time.value, min(_ERRORS * error, _FARTHEST_LOG)
    moved = np.linspace(-reach, reach, _TERMS)
    ends = likely_interval(moved, lambda x: loglik(tau * float(np.exp(x))))
    lower, upper = (tau * float(np.exp(end)) for end in ends)
    return replace(time, lower=min(lower, tau), upper=max(upper, tau))


def likely_interval(values: Array, loglik: Callable[[float], float]) -> tuple[float, float]:
    """Return the ends of the interval that holds 95 % of equally distant values by likelihood."""
    nats = np.array([loglik(value) for value in values.tolist()])
    weight = np.exp(nats - nats.max())
    below = (np.cumsum(weight) - weight / 2) / weight.sum()
    lower, upper = np.interp([_TAIL, 1 - _TAIL], below, values).tolist()
    return lower, upper


def reach_at_95(drop: Callable[[float], float]) -> float:
    """Return how far one must go for a likelihood to drop by what 95 % allow.

    Distances are in standard errors: it is 1.96 where the likelihood is a parabola.
    """
    reach = TWO_SIDED_95
    for _ in range(_STEPS):
        ratio = (CHI_SQUARE_95 / 2) / max(drop(reach), 1e-3)
        reach = min(reach * float(np.sqrt(ratio)), _FARTHEST)
        if abs(ratio - 1) < 0.05 or reach == _FARTHEST:
            break
    return reach


@dataclass(frozen=True, eq=False)
class _LowBins:
    """The bins of the first ordinates.

    Attributes
    ----------
    kept : ndarray, shape (m,)
        1 for the ordinates that take part in the fit, 0 for the others.
    edges : ndarray of int64, shape (bins,)
        First ordinate of each bin.
    count : ndarray, shape (bins,)
        Ordinates of each that take part, 1 at the least.
    """

    kept: Array
    edges: NDArray[np.int64]
    count: Array

    def means(self, squares: Array) -> Array:
        """Average the squares of ordinates over every bin, shape (m,) to (bins,)."""
        return np.asarray(np.add.reduceat(squares * self.kept, self.edges) / self.count)


@lru_cache(maxsize=16)  # a search asks for the same few thousands of times
def _low_bins(grid: Grid, excluded: Ranges, m: int) -> _LowBins:
    kept = grid.kept(excluded)[:m].astype(np.float64)
    bins = int(np.searchsorted(grid.edges, m))
    if m < grid.n - 1 and grid.edges[bins] != m:
        raise ValueError("signals must end at the border of a bin")
    edges = grid.edges[:bins]
    return _LowBins(kept, edges, np.maximum(np.add.reduceat(kept, edges), 1.0))


def refit_jointly(view: View, fewest: int = 2) -> View:
    """Estimate the slow deterministic effects of a view again, all at once.

    A view with fewer of them is returned as it is: one alone is as it was fitted.
    """
    members = [c for c in view.accepted if c.effect.columns(view) is not None]
    if len(members) < fewest:
        return view
    bare = view.without(*members)
    parts = [part for c in members for part in c.parts]
    noise = bare.with_parts(*parts) if parts else bare
    found = members
    for _ in range(_TURNS):
        before, found = found, _solved(noise, found)
        if _moved(before, found) < _SETTLED:
            break
    found = [candidate.finished() for candidate in _with_gains(noise, found)]
    grown = bare
    for candidate in found:
        grown = grown.accept(candidate)
    places = {id(old): new for old, new in zip(members, found, strict=True)}
    return grown.relisted(places.get(id(c), c) for c in view.accepted)


def with_likely_times(view: View) -> View:
    """Give time constants that were estimated together with others the interval of each.

    It holds 95 % of the time constants, each as likely as it is with the others and the noise
    estimated again (restricted likelihood). What several slow signals take of the few ordinates
    that tell a random walk leaves that uncertain, and the time constants with it: a parabola
    promises too much.
    """
    members = [c for c in view.accepted if c.effect.columns(view) is not None]
    if len(members) < 2:
        return view
    bare = view.without(*members)

    def known(candidate: Candidate) -> Candidate:
        tau = candidate.effect.relaxation
        if tau is None or tau.lower is None or tau.upper is None or not 0 < tau.lower < tau.upper:
            return candidate
        beside = [_columns(bare, other) for other in members if other is not candidate]

        def loglik(time: float) -> float:
            moved = candidate.effect.with_relaxation(replace(tau, value=time))
            columns = moved.columns(bare)
            assert columns is not None
            return restricted_loglik(bare, np.vstack([columns[:-1], *beside]))

        error = float(np.log(tau.upper / tau.lower)) / (2 * TWO_SIDED_95)
        likely = likely_time(tau, loglik, error)
        return replace(candidate, effect=candidate.effect.with_relaxation(likely))

    found = {id(c): known(c) for c in members}
    return view.relisted(found.get(id(c), c) for c in view.accepted)


def _columns(view: View, candidate: Candidate) -> Array:
    columns = candidate.effect.columns(view)
    assert columns is not None
    return columns


def _solved(bare: View, members: list[Candidate]) -> list[Candidate]:
    """Take one Gauss-Newton step of all numbers of all members."""
    parts = [_columns(bare, c) for c in members]
    fit = joint_fit(bare, np.vstack(parts))
    covariance = marginal_covariance(bare, np.vstack(parts), fit)
    ends = np.cumsum([len(part) for part in parts])
    found = []
    for candidate, part, end in zip(members, parts, ends, strict=True):
        own = slice(int(end) - len(part), int(end))
        amplitude, error = fit.amplitude[own], covariance[own, own]
        found.append(candidate.effect.solved(bare, candidate, amplitude, error))
    return found


def _moved(before: list[Candidate], after: list[Candidate]) -> float:
    """Return the largest relative change of what the regression is not linear in."""
    times = [[c.effect.relaxation for c in members] for members in (before, after)]
    pairs = zip(*times, strict=True)
    return max((abs(b.value / a.value - 1) for a, b in pairs if a and b), default=0.0)


def _with_gains(bare: View, members: list[Candidate]) -> list[Candidate]:
    """Give every member what it gains beside the others, these fitted again without it."""
    parts = [_columns(bare, c) for c in members]
    whole = joint_fit(bare, np.vstack(parts)).gain
    found = []
    for k, candidate in enumerate(members):
        others = parts[:k] + parts[k + 1 :]
        beside = joint_fit(bare, np.vstack(others)).gain if others else 0.0
        found.append(replace(candidate, gain=whole - beside))
    return found
